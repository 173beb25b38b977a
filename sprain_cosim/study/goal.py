"""The designer's question: for which values of a parameter is a response unlikely enough to exceed a threshold?"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ..cosim.system import System
from ..errors import InputError, nearest
from ..fmu.element import Connector
from ..units import quantity, split, unit
from ..uq.design import FEWEST, Find
from .inputs import parameter, unit_name
from .questions import Question, parse_question

LANDINGS = 300
GRAMMAR = '"P(RESPONSE > VALUE [+- SD] UNIT) <= 2 %"'
MOST = 2  # parameters of one question

_GOAL = re.compile(r"(.*\))\s*([<>]=?|≤|≥)\s*([^)]*)")
_RANGE = re.compile(r"\s*(.+?)\s*(?:\.{2,3}|…)\s*(.+?)\s*")


@dataclass(frozen=True)
class Goal:
    """P(response > threshold) <= at_most.

    question  the response and its threshold
    at_most   0 ... 1
    find      least, largest; None: by where the goal holds
    """

    question: Question
    at_most: float
    find: Find | None = None

    @property
    def text(self) -> str:
        """ "P(peak_inversion_from_neutral_deg above 35 ± 6 deg) <= 2 %"."""
        return f"P({self.question.response} {self.question.event}) <= {100 * self.at_most:g} %"


def parse_goal(text: str, find: Find | None = None, place: str = "--goal") -> Goal:
    """ "P(RESPONSE > VALUE [+- SD] UNIT) <= 2 %", the grammar of --question with a bound. Raises InputError that begins
    with `place`."""
    match = _GOAL.fullmatch(text.strip())
    if match is None:
        raise InputError(f"{place} {text!r}: must read {GRAMMAR}")
    question = parse_question(match[1], place)
    if match[2] not in ("<=", "<", "≤"):
        raise InputError(f"{place} {text!r}: a goal bounds the probability from above; write {GRAMMAR}")
    share = quantity(match[3].replace("%", " %"), unit("1"), f"{place} {text!r}, the bound")
    if not 0.0 < share < 1.0:
        raise InputError(
            f"{place} {text!r}: the bound must lie between 0 and 100 %: no number of landings shows 0, and 100 % "
            "always holds"
        )
    return Goal(question, share, find)


def parse_vary(text: str, system: System, place: str = "--vary") -> tuple[str, tuple[float, float], str]:
    """ "brace.angle_scale=0.5..3" as the name, the range in the parameter's own unit, and that unit."""
    name, equals, ends = (part.strip() for part in text.partition("="))
    match = _RANGE.fullmatch(ends)
    if not equals or not name or match is None:
        raise InputError(f"{place} {text}: must read COMPONENT.PARAMETER=LOW..HIGH, such as brace.angle_scale=0.5..3")
    first, second = match[1], match[2]
    named = split(second)
    if named is not None and named[1] and (one := split(first)) is not None and not one[1]:
        first = f"{first} {named[1]}"
    return name, *varied_range(name, (first, second), system, f"{place} {name}")


def varied_range(name: str, ends: Any, system: System, place: str) -> tuple[tuple[float, float], str]:
    """The range of a parameter in its own unit, and that unit. Raises InputError that begins with `place`."""
    connector = _parameter(name, system, place)
    if not isinstance(ends, list | tuple) or len(ends) != 2:
        raise InputError(f"{place}: must be its two ends, such as [0.5, 3]")
    low, high = (quantity(end, connector.unit, place) for end in ends)
    own = unit_name(connector.unit)
    if not low < high:
        raise InputError(f"{place} = {low:g} .. {high:g}: must rise")
    if low < connector.minimum or high > connector.maximum:
        allowed = f"{connector.minimum:g} ... {connector.maximum:g} {own}".strip()
        raise InputError(f"{place} = {low:g} .. {high:g}: reaches beyond what the parameter may be, {allowed}")
    return (low, high), own


def _parameter(name: str, system: System, place: str) -> Connector:
    try:
        return parameter(system, name)
    except InputError as problem:
        component = system.component(name.partition(".")[0])
        known = [] if component is None else [f"{component.name}.{n}" for n in component.parameters]
        offered = f"; it has {', '.join(known[:8])}" if known and not nearest(name, known) else ""
        raise InputError(f"{place}: {problem}{offered}") from None


def goal_problems(goal: Goal | None, vary: Mapping[str, tuple[float, float]], trials: int) -> list[str]:
    """What keeps a design question from being asked, one line each."""
    if goal is None or not vary:
        return [f"method design: needs [design] with goal = {GRAMMAR} and vary, or `sprain-cosim design STUDY`"]
    problems = []
    if len(vary) > MOST:
        problems.append(f"design: {len(vary)} parameters; one, or two for a trade-off curve")
    if trials < FEWEST:
        problems.append(f"design: {trials} landings; at least {FEWEST} are needed, {LANDINGS} are usual")
    return problems
