"""What a study asks of its trials: how likely a response exceeds a threshold, and percentiles of it.

A question is read from the rows when they are done, and changes none of them: a finished study answers another one from
its ledger."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from .. import keys
from ..errors import InputError, nearest
from ..literature import INJURY_INVERSION, INJURY_INVERSION_TEXT, INJURY_MOMENT, INJURY_MOMENT_TEXT
from ..metrics import NAMES, OF_BRACE, unit_of
from ..units import Unit, quantity, split, unit
from ..uq.distributions import LogNormal, Marginal, Normal, Truncated, Uniform, Weibull
from ..uq.exceedance import SHAPES, Bounds, Threshold
from ..uq.measured import Measured
from .marginals import DISTRIBUTION, ENDS, NUMBER, SAMPLES, Measurements, marginal, strangeness
from .marginals import NAMES as LAWS

GRAMMAR = '"P(RESPONSE > VALUE UNIT)", with "VALUE +- SD UNIT", "LOW .. HIGH UNIT" and ", n = 10" where they apply'

THRESHOLD = keys.Either(
    NUMBER,
    keys.Table(
        (
            *DISTRIBUTION.table.keys,
            keys.Key("n", keys.whole(3), "beside normal, lognormal, weibull: specimens that it was estimated from"),
        ),
        more={"anyOf": [*({"required": [name]} for name in LAWS), {"required": list(ENDS)}]},
    ),
    "quantity, or distribution",
    "that of the response",
)


@dataclass(frozen=True)
class Question:
    """One question about one response.

    response    name of a metric
    threshold   in the response's unit, whose exceedance is asked for; None: percentiles alone
    levels      probabilities whose percentiles are asked for besides the study's own
    literature  the threshold is the literature's, not the study's
    """

    response: str
    threshold: Threshold | None = None
    levels: tuple[float, ...] = ()
    literature: bool = False

    @property
    def event(self) -> str:
        """ "above 35 ± 6 deg, n = 10"."""
        assert self.threshold is not None
        if self.literature:
            return QUESTIONS[self.response][0]
        return f"above {threshold_text(self.threshold, unit_of(self.response))}"

    @property
    def name(self) -> str:
        """What the summary calls it: the response alone for the literature's."""
        return self.response if self.literature else f"{self.response} {self.event}"

    @property
    def source(self) -> str:
        return "literature" if self.literature else "own"


# Injury thresholds: inversion of cadaver ankles at failure, counted from the neutral pose, and the anatomy's inversion
# moment at injury.
QUESTIONS: Mapping[str, tuple[str, Marginal]] = {
    "peak_inversion_from_neutral_deg": (f"above {INJURY_INVERSION_TEXT} deg", Normal(*INJURY_INVERSION)),
    "anatomy_jcs_inversion_moment_Nm": (f"above {INJURY_MOMENT_TEXT} N·m", Uniform(*INJURY_MOMENT)),
}
LITERATURE = tuple(Question(name, threshold, literature=True) for name, (_, threshold) in QUESTIONS.items())


def threshold_text(threshold: Threshold, unit_name: str) -> str:
    """A threshold in words: "24 deg", "35 ± 6 deg, lognormal, n = 10", "2.7 ... 4.3 N·m, nothing known between"."""
    after = f" {unit_name}" if unit_name else ""
    match threshold:
        case Bounds(low, high):
            return f"{low:g} ... {high:g}{after}, nothing known between"
        case Measured(law, n):
            return f"{threshold_text(law, unit_name)}, n = {n}"
        case Uniform(low, high):
            return f"{low:g} ... {high:g}{after}, uniform"
        case Marginal():
            shape = "" if isinstance(threshold, Normal) else f", {law_name(type(threshold).__name__.lower())}"
            return f"{threshold.mean:.4g} ± {threshold.sd:.3g}{after}{shape}"
        case number:
            return f"{number:g}{after}"


def law_name(law: str) -> str:
    """A law as people write it: Weibull was a man."""
    return "Weibull" if law == "weibull" else law


def unit_of_response(name: str) -> Unit | None:
    """The unit that the response's name carries; None where it has no dimension."""
    found = unit_of(name).replace("·", ".")
    return unit(found) if found else None


def known_response(name: str, place: str) -> str:
    """Itself. Raises InputError for what is no metric of a landing."""
    if name not in NAMES:
        raise InputError(f"{place}: no such metric {name!r}{nearest(name, NAMES)}")
    return name


def computed_response(name: str, metrics: Sequence[str]) -> str:
    """Itself. Raises InputError for what is not among the `metrics` of the landings."""
    if name not in metrics:
        without = "; it needs a brace on the plant" if name in OF_BRACE else ""
        raise InputError(f"response {name!r}: no such metric{nearest(name, metrics)}{without}")
    return name


def threshold_of(spec: Any, own: Unit | None, place: str, measured: Measurements | None = None) -> Threshold:
    """A threshold as a study file writes it; `measured` takes the fits of its samples. Raises InputError that begins
    with `place`, ValueError for numbers that no distribution has."""
    if not isinstance(spec, dict):
        return quantity(spec, own, place)
    if set(spec) == set(ENDS):
        return Bounds(*(quantity(spec[end], own, f"{place}.{end}") for end in ENDS))
    law = marginal({key: value for key, value in spec.items() if key != "n"}, own, place, measured)
    if SAMPLES in spec and "n" in spec:
        raise InputError(f"{place}: n is the number of the samples; leave it out")
    if SAMPLES in spec and measured is not None and not isinstance(law, Truncated):
        return Measured(law, measured.fits[place].n)
    if law.is_fixed or law.is_discrete:
        raise InputError(f'{place}: a threshold is a value, such as "24 deg", a law or two ends')
    if "n" not in spec:
        return law
    if not keys.is_whole(spec["n"]):
        raise InputError(f"{place}.n = {spec['n']!r}: must be a whole number, the specimens behind the threshold")
    return Measured(law, spec["n"])


def questions_of(
    specs: Sequence[Mapping[str, Any]], problems: list[str], measured: Measurements | None = None
) -> tuple[Question, ...]:
    """The [[questions]] of a study file."""
    found: list[Question] = []
    for k, spec in enumerate(specs, 1):
        place = f"questions {k}"
        try:
            response = known_response(spec.get("response", ""), f"{place}.response")
            if "above" not in spec and "levels" not in spec:
                raise InputError(f'{place}: asks nothing; give above = "24 deg" or levels = [0.99]')
            above = spec.get("above")
            threshold = None
            if above is not None:
                threshold = threshold_of(above, unit_of_response(response), f"{place}.above", measured)
            found.append(Question(response, threshold, spec.get("levels", ())))
        except (InputError, ValueError) as problem:
            problems.append(str(problem) if place in str(problem) else f"{place}.above: {problem}")
    return tuple(found)


_QUESTION = re.compile(r"\s*P\s*\(\s*([^\s<>=]+)\s*([<>]=?)\s*(.*?)\s*\)\s*")
_BEHIND = re.compile(r"(.*?)\s*,\s*n\s*=\s*(\S+)")
_LAW = re.compile(r"([a-z]+)\s+(.*)")
_SPREAD, _RANGE = re.compile(r"\s*(?:\+\s*/?\s*-|±)\s*"), re.compile(r"\s*(?:\.{2,3}|…)\s*")


def parse_question(text: str, place: str = "--question") -> Question:
    """ "P(RESPONSE > VALUE [+- SD] UNIT)": the grammar of --question, and of --goal without its bound. Before VALUE may
    stand normal, lognormal or weibull; after the unit ", n = 10", the specimens behind the threshold; "LOW .. HIGH
    UNIT" are bounds. Raises InputError that begins with `place`."""
    match = _QUESTION.fullmatch(text)
    if match is None:
        raise InputError(f"{place} {text!r}: must read {GRAMMAR}")
    if match[2] not in (">", ">="):
        raise InputError(f"{place} {text!r}: asks what lies below; ask what lies above, P(... > ...)")
    response = known_response(match[1], f"{place} {text!r}")
    try:
        return Question(response, _threshold(match[3], unit_of_response(response), f"{place} {text!r}"))
    except ValueError as problem:
        raise InputError(f"{place} {text!r}: {problem}") from None


def _threshold(text: str, own: Unit | None, place: str) -> Threshold:
    behind = _BEHIND.fullmatch(text)
    if behind is not None:
        text = behind[1]
        if not behind[2].isdecimal():
            raise InputError(f"{place}: n = {behind[2]} must be a whole number, the specimens behind the threshold")
    word = _LAW.fullmatch(text)
    if word is not None:
        if word[1] not in SHAPES:
            raise InputError(f"{place}: unknown law {word[1]!r}{nearest(word[1], SHAPES)}")
        text = word[2]
    law = SHAPES[word[1]] if word else Normal
    spread = _SPREAD.split(text)
    if len(spread) == 2:
        stated = law(*_pair(spread, own, place))
        if strange := strangeness(stated):
            raise InputError(f"{place}: {strange.replace('fixed = ...', 'its value alone')}")
        found: Threshold = stated
    elif len(ends := _RANGE.split(text)) == 2:
        found = Bounds(*_pair(ends, own, place))
    else:
        found = quantity(text, own, place)
    if word is not None and not isinstance(found, Normal | LogNormal | Weibull):
        raise InputError(f"{place}: {word[1]} needs a mean and a standard deviation, such as 35 +- 6 deg")
    if behind is None:
        return found
    if not isinstance(found, Marginal):
        raise InputError(f"{place}: n goes with a mean and a standard deviation, such as 35 +- 6 deg, n = 10")
    return Measured(found, int(behind[2]))


def _pair(parts: Sequence[str], own: Unit | None, place: str) -> tuple[float, float]:
    """Two quantities, the unit of the second being that of both where the first has none."""
    first, second = parts
    named = split(second)
    if named is not None and named[1] and (one := split(first)) is not None and not one[1]:
        first = f"{first} {named[1]}"
    return quantity(first, own, place), quantity(second, own, place)
