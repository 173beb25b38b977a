"""The answer to a design question as the summary holds it, and what it costs in comfort."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ..errors import SprainError
from ..records import finite
from ..scenario.postures import resistances
from ..uq import design as uq
from ..uq.exceedance import Exceedance
from ..uq.statistics import Estimate
from .plan import Plan
from .summary import (
    PAIR,
    Comfort,
    DesignCurve,
    DesignPoint,
    DesignSearch,
    DoubtedProbability,
    StudySummary,
)

BETWEEN = 5  # values between the ends of the range at which the device is held, for the figure
LEAST_Q2 = 0.5  # below, a note says that the polynomial is a poor guide


def design_summary(summary: StudySummary, study: Plan, found: uq.DesignResult) -> StudySummary:
    """With the answer; `notes` say what a reader must know of it."""
    goal = study.goal
    assert goal is not None
    (parameter, ends), *others = study.vary.items()
    second = others[0][0] if others else None
    search = DesignSearch(
        goal.text,
        goal.at_most,
        goal.question.response,
        parameter,
        study.units[parameter],
        ends,
        found.find,
        tuple(_point(point) for point in found.points),
        found.evaluations,
        found.failed,
        finite(found.q2),
        finite(found.residual),
        second,
        None if second is None else study.units[second],
    )
    notes = _notes(search)
    if any(name.startswith("brace.") for name in study.vary):
        try:
            search = _with_comfort(study, search)
        except SprainError as problem:
            notes.append(f"no resistance in ordinary motion: the device could not be put into postures: {problem}")
    return replace(summary, design=search, notes=tuple(notes))


def _point(found: uq.GoalPoint) -> DesignPoint:
    curve = (found.curve.parameter, found.curve.probability, found.curve.low, found.curve.high)
    return DesignPoint(
        found.status,
        found.value,
        finite(found.low),
        finite(found.high),
        finite(found.value_95),
        doubted(found.probability),
        DesignCurve(*(tuple(float(v) for v in part) for part in curve)),
        found.fresh,
        found.failed,
        found.second,
        found.other_end,
        surface=finite(found.surface),
    )


def doubted(found: Exceedance) -> DoubtedProbability:
    return DoubtedProbability(
        finite(found.value),
        _pair(found.sampling),
        None if found.threshold is None else _pair(found.threshold),
        found.shapes,
        found.specimens,
        found.dominates,
        found.sentence().replace("more trials", "more landings"),
    )


def _pair(e: Estimate) -> PAIR:
    return finite(e.low), finite(e.high)


def _notes(search: DesignSearch) -> list[str]:
    notes = []
    if search.q2 is not None and search.q2 < LEAST_Q2:
        notes.append(
            f"the polynomial predicts only {100 * search.q2:.0f} % of the variance of landings left out: the interval, "
            "which rests on fresh landings, is wide for it; the curve away from the goal is not to be trusted"
        )
    if search.failed:
        notes.append(
            f"{search.failed} of {search.landings} landings failed; the intervals hold whatever they would have given"
        )
    for point in search.points:
        if point.other_end is not None:
            beyond = "above" if search.find == "least" else "below"
            notes.append(
                f"the goal ceases to hold again {beyond} {search.parameter} = {point.other_end:.3g}"
                + (f" at {search.second} = {point.second:.3g}" if point.second is not None else "")
            )
        low = (point.probability.sampling_ci or (None, None))[0]
        if point.status == "nowhere" and low is not None and low <= search.at_most:
            notes.append(
                f"whether {search.parameter} = {point.value:.3g} meets the goal is open: the interval of the landings "
                "reaches below it; more landings (--landings) or a wider range would tell"
            )
        if point.status == "everywhere" and point.second is None:
            side = "low" if search.find == "least" else "high"
            notes.append(
                f"by the best estimate the goal holds in all of the range: the {search.find} value lies beyond its "
                f"{side} end"
            )
    return notes


def _with_comfort(study: Plan, search: DesignSearch) -> DesignSearch:
    """At the values found, at those that hold with 95 % confidence, and over the range of a single parameter."""
    asked: list[tuple[int, str, float, Mapping[str, float]]] = []
    low, high = search.range
    for k, point in enumerate(search.points):
        alone = len(search.points) == 1 and low is not None and high is not None
        over = np.linspace(low or 0.0, high or 0.0, BETWEEN + 2).tolist() if alone else []
        places = ["low", *["between"] * BETWEEN, "high"] if alone else []
        ends = zip(places, over, strict=True)
        for at, value in (("value", point.value), ("value_95", point.value_95), *ends):
            if value is not None and math.isfinite(value):
                second = {} if search.second is None or point.second is None else {search.second: point.second}
                asked.append((k, at, value, {search.parameter: value, **second}))
    held = resistances(study.scenario, [values for _, _, _, values in asked])
    comfort: list[list[Comfort]] = [[] for _ in search.points]
    for (k, at, value, _), found in zip(asked, held, strict=True):
        if found:
            comfort[k].append(Comfort(at, value, {name: finite(torque) for name, torque in found.items()}))
    points = tuple(replace(p, comfort=tuple(c)) for p, c in zip(search.points, comfort, strict=True))
    return replace(search, points=points)
