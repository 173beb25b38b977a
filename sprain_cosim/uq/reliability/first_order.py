"""First-order reliability: the point of an event nearest to the origin of the standard space.

Source: Y. Zhang, A. Der Kiureghian, Two improved algorithms for reliability analysis, in Reliability and Optimization
of Structural Systems (1995) 297-304 (iHL-RF).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtr

from ..distributions import JointDistribution, Marginal
from .differences import Difference, check_differences, differences, standard_gradient, unit_vector
from .limit_state import Event, LimitState
from .points import DEFAULT_BUDGET, Array, BudgetSpent, BudgetTooSmall, Evaluations, Function, PointLedger, Status

__all__ = ["FormResult", "form", "form_exceedance", "search"]

_FORM_ITERATIONS = 200
_STEP_HALVINGS = 30


@dataclass(frozen=True)
class FormResult:
    """First-order reliability of the event `function <= threshold`.

    beta          reliability index: distance of the design point from the origin of the standard space,
                  negative where the median inputs already lie in the event
    probability   Φ(−beta)
    alpha         (d,) unit vector with u* = beta·alpha; points to smaller values of the function
    importance    (d,) alpha²
    design_point  (d,) physical inputs x*; `standard_point` (d,) is u*
    """

    beta: float
    probability: float
    alpha: Array
    importance: Array
    design_point: Array
    standard_point: Array
    iterations: int
    evaluations: Evaluations
    status: Status
    reasons: tuple[str, ...]


def form(
    function: Function,
    marginals: Sequence[Marginal],
    threshold: float,
    correlation: ArrayLike | None = None,
    *,
    start: ArrayLike | None = None,
    step: float = 1e-4,
    difference: Difference = "central",
    tolerance: float = 1e-6,
    budget: int = DEFAULT_BUDGET,
) -> FormResult:
    """First-order reliability method for the event `function <= threshold`, by the improved HL-RF algorithm.

    `start` (d,) is a point of the standard space, its origin by default. The default step suits a limit state given as
    a formula; for a simulator choose it above the noise of the response, as for `amv`. Stops when the limit state is
    met and u is parallel to its gradient within `tolerance` (and the finite differences allow it). A search that ends
    for another reason is reported as suspect; a design point that is a second-best one cannot be told from inside one
    search, `design_points` looks for others. Raises ValueError as `amv` does.
    """
    joint = JointDistribution(marginals, correlation)
    joint.require_slopes()
    if not math.isfinite(threshold):
        raise ValueError(f"the threshold must be finite, got {threshold}")
    check_differences(step, difference)
    u = np.zeros(len(joint)) if start is None else np.array(start, dtype=float)
    if u.shape != (len(joint),):
        raise ValueError(f"the start must have shape ({len(joint)},), got {u.shape}")
    return search(PointLedger(function, budget), joint, threshold, u, step, difference, tolerance)


def search(
    ledger: PointLedger,
    joint: JointDistribution,
    threshold: float,
    start: Array,
    step: float,
    difference: Difference,
    tolerance: float,
    on_limit: float | None = None,
    known: Callable[[Array], bool] = lambda u: False,
) -> FormResult:
    """The iteration of `form` from `start` (d,) on a ledger that may know points already.

    on_limit  share of the gradient that the limit state may be missed by, 1e-4·tolerance by default
    known     of a point u near the limit state: whether it leads where another search has been, which ends this one
    """
    on_limit = 1e-4 * tolerance if on_limit is None else on_limit
    u = start.copy()
    state: tuple[float, Array] | None = None
    complaint: str | None = f"no design point was found in {_FORM_ITERATIONS} iterations"
    iterations, origin_value = 0, math.nan
    try:
        if np.any(u):
            origin_value = ledger.at(joint.from_standard(np.zeros(len(joint)))) - threshold
        for iterations in range(1, _FORM_ITERATIONS + 1):
            slopes = differences(ledger, joint, joint.from_standard(u), step, difference)
            g, gradient = slopes.value - threshold, standard_gradient(joint, slopes.gradient, u)
            state = g, gradient
            if math.isnan(origin_value):
                origin_value = g
            if not np.any(gradient):
                if iterations == 1 and not np.any(u):  # a symmetric response: step aside and look again
                    u[joint.active] = 0.1
                    continue
                complaint = f"the gradient vanishes at x = {joint.from_standard(u).tolist()}"
                break
            if _is_settled(u, g, gradient, on_limit, tolerance):
                complaint = None
                break
            if known(u):
                complaint = "the search came to a design point found before"
                break
            moved = _hlrf_step(ledger, joint, threshold, u, g, gradient)
            if moved is None:
                near = _is_settled(u, g, gradient, max(1e-6, on_limit, 1e-2 * tolerance), max(1e-4, tolerance))
                complaint = None if near else "the line search found no better point: noise or a kink"
                break
            u = moved
    except BudgetSpent:
        complaint = f"the budget of {ledger.budget} evaluations was spent before the search settled"
    if state is None:
        raise BudgetTooSmall(f"a budget of {ledger.budget} evaluations does not even allow one gradient")
    beta = math.copysign(float(np.linalg.norm(u)), origin_value)
    alpha = -unit_vector(state[1])
    return FormResult(
        beta=beta,
        probability=float(ndtr(-beta)),
        alpha=alpha,
        importance=alpha**2,
        design_point=joint.from_standard(u),
        standard_point=u,
        iterations=iterations,
        evaluations=ledger.evaluations(),
        status="suspect" if complaint else "ok",
        reasons=(complaint,) if complaint else (),
    )


def _is_settled(u: Array, g: float, gradient: Array, on_limit: float, along: float) -> bool:
    """Whether u lies on the limit state and along its gradient, within shares of max(1, ‖u‖)."""
    norm, scale = float(np.linalg.norm(gradient)), max(1.0, float(np.linalg.norm(u)))
    normal = gradient / norm
    across = float(np.linalg.norm(u - (normal @ u) * normal))
    return abs(g) <= on_limit * norm * scale and across <= along * scale


def form_exceedance(
    function: Function,
    marginals: Sequence[Marginal],
    threshold: float | Marginal,
    correlation: ArrayLike | None = None,
    **options: Any,
) -> FormResult:
    """FORM for the event `function > threshold`; `options` as in `form`.

    An uncertain threshold (a marginal, independent of the inputs) is one more input, the last of alpha and of
    the design point: the limit state is threshold − function(x) <= 0.
    """
    if isinstance(threshold, Marginal) and threshold.is_fixed:
        threshold = threshold.mean
    if not isinstance(threshold, Marginal):
        return form(lambda x: -np.asarray(function(x), dtype=float), marginals, -threshold, correlation, **options)
    state = LimitState(PointLedger(function), JointDistribution(marginals, correlation), Event(threshold, above=True))
    return form(state, state.joint.marginals, 0.0, state.joint.correlation, **options)


def _hlrf_step(
    ledger: PointLedger, joint: JointDistribution, threshold: float, u: Array, g: float, gradient: Array
) -> Array | None:
    """One step of iHL-RF: its direction, shortened until ½‖u‖² + c·|g| falls; None if it never does."""
    norm2 = float(gradient @ gradient)
    target = (float(gradient @ u) - g) / norm2 * gradient
    direction = target - u
    penalty = 2.0 * float(np.linalg.norm(u)) / math.sqrt(norm2) + abs(g) / norm2
    merit = 0.5 * float(u @ u) + penalty * abs(g)
    slope = float(u @ direction) - penalty * abs(g)  # the gradient along HL-RF's direction is −g
    best: tuple[float, Array] | None = None
    for halving in range(_STEP_HALVINGS):
        moved = u + 0.5**halving * direction
        value = ledger.at(joint.from_standard(moved)) - threshold
        reached = 0.5 * float(moved @ moved) + penalty * abs(value)
        if best is not None and reached >= best[0]:
            break
        # Past a step that will do, half of it is tried too: full steps swing about a curved limit state.
        if reached <= merit + 0.1 * 0.5**halving * slope:
            best = reached, moved
    return None if best is None else best[1]
