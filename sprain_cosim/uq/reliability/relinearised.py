"""The mean value family with the response linearised anew at each level's point: AMV+ and HMV.

Sources: Y.-T. Wu, H. R. Millwater, T. A. Cruse, AIAA J. 28 (1990) 1663-1669 (AMV+); B. D. Youn, K. K. Choi, Y. H. Park,
Hybrid analysis method for reliability-based design optimization, J. Mech. Des. 125 (2003) 221-232 (HMV).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtri

from ..distributions import Marginal
from .differences import Difference, Slopes, differences, standard_gradient, unit_vector
from .gate import Gate
from .linearisation import DEFAULT_LEVELS, Linearisation, Setting, Space
from .mean_value_family import LevelResult, level_result
from .points import DEFAULT_BUDGET, Array, BudgetSpent, BudgetTooSmall, Function, PointLedger

__all__ = ["amv_plus", "hmv"]


@dataclass
class _Search:
    """Where a relinearising method stands at one level."""

    u: Array
    value: float
    iterations: int = 0
    gradient_u: Array | None = None
    complaint: str | None = None


_Improve = Callable[[PointLedger, Setting, float, _Search, float], None]


def _relinearise(
    method: str,
    improve: _Improve,
    function: Function,
    setting: Setting,
    tolerance: float,
    budget: int,
    noise: float | None,
    variance: float | None,
) -> LevelResult:
    """The frame of AMV+ and HMV: start at each level's AMV point, let `improve` move it, judge it."""
    ledger = PointLedger(function, budget)
    joint = setting.joint
    try:
        linear = Linearisation.at_mean(ledger, setting)
        points = {p: setting.extreme(linear.slopes.gradient, p, linear.standard_point) for p in setting.levels}
        start = ledger(joint.from_standard(np.array(list(points.values()))))
    except BudgetSpent:
        raise BudgetTooSmall(f"a budget of {budget} evaluations does not even allow the AMV step") from None
    gate = Gate(setting, linear, noise)
    gate.look_at_slopes()
    searches = {p: _Search(points[p], float(z)) for p, z in zip(points, start, strict=True)}
    small = tolerance * (linear.sd or 1.0)
    for level, search in searches.items():
        try:
            improve(ledger, setting, level, search, small)
        except BudgetSpent:
            search.complaint = f"the budget of {budget} evaluations was spent before the search settled"
        if search.complaint:
            gate.suspicions.append(f"level {level:g}: {search.complaint}")
        if search.gradient_u is not None:
            gate.look_at_turn(level, search.gradient_u)
    value = {p: search.value for p, search in searches.items()}
    gate.look_at_order(value)
    gate.look_at_variance(variance)
    importance = {}
    for p, search in searches.items():
        beta = float(ndtri(p))
        gradient_u = linear.importance if search.gradient_u is None else search.gradient_u
        importance[p] = search.u / beta if beta else unit_vector(gradient_u)
    return level_result(
        method,
        setting,
        linear,
        gate,
        ledger,
        value,
        {p: search.u for p, search in searches.items()},
        importance,
        {p: search.iterations for p, search in searches.items()},
    )


def _slopes_at(ledger: PointLedger, setting: Setting, u: Array) -> tuple[Slopes, Array]:
    """Differences at x(u), and the gradient in u."""
    slopes = differences(ledger, setting.joint, setting.joint.from_standard(u), setting.step, setting.difference)
    return slopes, standard_gradient(setting.joint, slopes.gradient, u)


_AMV_PLUS_ITERATIONS = 100


def _iterate_amv(ledger: PointLedger, setting: Setting, level: float, search: _Search, small: float) -> None:
    """u ← extreme of the linearisation at u, until the response changes by less than `small`."""
    for _ in range(_AMV_PLUS_ITERATIONS):
        slopes, search.gradient_u = _slopes_at(ledger, setting, search.u)
        search.iterations += 1
        u = setting.extreme(slopes.gradient, level, search.u)
        value = ledger.at(setting.joint.from_standard(u))
        change, search.u, search.value = abs(value - search.value), u, value
        if change < small:
            return
    search.complaint = (
        f"plain relinearisation did not settle in {_AMV_PLUS_ITERATIONS} iterations (it cycles or crawls); use hmv"
    )


def amv_plus(
    function: Function,
    marginals: Sequence[Marginal],
    levels: Sequence[float] = DEFAULT_LEVELS,
    space: Space = "x",
    step: float = 0.1,
    difference: Difference = "central",
    correlation: ArrayLike | None = None,
    *,
    tolerance: float = 1e-6,
    budget: int = DEFAULT_BUDGET,
    noise: float | None = None,
    variance: float | None = None,
) -> LevelResult:
    """AMV with the response linearised anew at each design point until z_p changes by less than tolerance·sd.

    Arguments as in `amv`, but differences are central unless asked otherwise, since the result depends on the
    slopes at the design point; `budget` bounds the evaluations executed. A search that cycles, crawls or
    spends the budget is reported as suspect with the value it had reached: concave responses do that, `hmv`
    is made for them.
    """
    setting = Setting.checked(marginals, correlation, levels, space, step, difference)
    return _relinearise("amv+", _iterate_amv, function, setting, tolerance, budget, noise, variance)


_HMV_ITERATIONS = 100
_ARC_HALVINGS = 12


def _climb_hybrid(ledger: PointLedger, setting: Setting, level: float, search: _Search, small: float) -> None:
    """Hybrid mean value: steepest direction where the response is convex, the mean of the last three where it
    is concave, and an arc towards the steepest direction wherever either would not improve."""
    beta = float(ndtri(level))
    _, search.gradient_u = _slopes_at(ledger, setting, search.u)
    search.iterations = 1
    if beta == 0.0:
        return
    radius, sign = abs(beta), math.copysign(1.0, beta)
    recent: list[Array] = []
    for _ in range(_HMV_ITERATIONS):
        steepest = sign * unit_vector(search.gradient_u)
        here = search.u / radius
        gain = float(np.linalg.norm(search.gradient_u)) * radius * (1.0 - float(steepest @ here))
        if gain < small:
            return
        recent = [*recent[-2:], steepest]
        direction = steepest
        if len(recent) == 3 and (recent[2] - recent[1]) @ (recent[1] - recent[0]) <= 0:
            direction = unit_vector(recent[0] + recent[1] + recent[2])
        moved = _improved(ledger, setting, search, here, [direction, *_arc(here, steepest)], sign, radius)
        if not moved:
            if gain > math.sqrt(small):
                search.complaint = "no step improves the response although its slope promises it: noise or a kink"
            return
        _, search.gradient_u = _slopes_at(ledger, setting, search.u)
        search.iterations += 1
    search.complaint = f"the search did not settle in {_HMV_ITERATIONS} iterations"


def _arc(start: Array, end: Array) -> list[Array]:
    """Unit vectors on the great circle from `start` towards `end`, each half as far as the one before."""
    angle = math.acos(float(np.clip(start @ end, -1.0, 1.0)))
    across = unit_vector(end - (start @ end) * start)
    turns = [angle * 0.5**k for k in range(1, _ARC_HALVINGS + 1)]
    return [math.cos(turn) * start + math.sin(turn) * across for turn in turns]


def _improved(
    ledger: PointLedger,
    setting: Setting,
    search: _Search,
    here: Array,
    candidates: Sequence[Array],
    sign: float,
    radius: float,
) -> bool:
    """Move the search to the first candidate direction that is better than the present one."""
    for direction in candidates:
        if np.array_equal(direction, here):
            continue
        value = ledger.at(setting.joint.from_standard(radius * direction))
        if sign * (value - search.value) > 0:
            search.u, search.value = radius * direction, value
            return True
    return False


def hmv(
    function: Function,
    marginals: Sequence[Marginal],
    levels: Sequence[float] = DEFAULT_LEVELS,
    space: Space = "x",
    step: float = 0.1,
    difference: Difference = "central",
    correlation: ArrayLike | None = None,
    *,
    tolerance: float = 1e-9,
    budget: int = DEFAULT_BUDGET,
    noise: float | None = None,
    variance: float | None = None,
) -> LevelResult:
    """Hybrid mean value method: the true extreme of the response on each level's sphere, also where AMV+
    cycles.

    Arguments as in `amv_plus`; `space` chooses the AMV start only, the search itself runs in the standard
    space. It stops when the slope promises less than tolerance·sd. Every accepted step improves, so that the
    value never gets worse than AMV's; a search that ends for another reason is suspect and says why.
    """
    setting = Setting.checked(marginals, correlation, levels, space, step, difference)
    return _relinearise("hmv", _climb_hybrid, function, setting, tolerance, budget, noise, variance)
