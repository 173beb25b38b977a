"""First-order reliability: the point of an event nearest to the origin of the standard space.

Source: Y. Zhang, A. Der Kiureghian, Two improved algorithms for reliability analysis, in Reliability and Optimization
of Structural Systems (1995) 297-304 (iHL-RF).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtr

from ..distributions import JointDistribution, Marginal
from ..distributions.marginal import as_array
from .differences import Difference, check_differences, differences, standard_gradient, unit
from .points import DEFAULT_BUDGET, Array, BudgetSpent, Evaluations, Function, PointLedger, Status

__all__ = ["FormResult", "form", "form_exceedance"]

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
    step: float = 1e-4,
    difference: Difference = "central",
    tolerance: float = 1e-6,
    budget: int = DEFAULT_BUDGET,
) -> FormResult:
    """First-order reliability method for the event `function <= threshold`, by the improved HL-RF algorithm.

    The default step suits a limit state given as a formula; for a simulator choose it above the noise of the
    response, as for `amv`. Stops when the limit state is met and u is parallel to its gradient within
    `tolerance` (and the finite differences allow it). A search that ends for another reason, or a design
    point that is a second-best one, cannot be told from inside; the former is reported as suspect. Raises
    ValueError as `amv` does.
    """
    joint = JointDistribution(marginals, correlation)
    joint.require_slopes()
    if not math.isfinite(threshold):
        raise ValueError(f"the threshold must be finite, got {threshold}")
    check_differences(step, difference)
    ledger = PointLedger(function, budget)
    u = np.zeros(len(joint))
    state: tuple[float, Array] | None = None
    origin_value = math.nan
    complaint: str | None = f"no design point was found in {_FORM_ITERATIONS} iterations"
    iterations = 0
    try:
        for iterations in range(1, _FORM_ITERATIONS + 1):
            slopes = differences(ledger, joint, joint.from_standard(u), step, difference)
            g, gradient = slopes.value - threshold, standard_gradient(joint, slopes.gradient, u)
            state = g, gradient
            if iterations == 1:
                origin_value = g
            norm = float(np.linalg.norm(gradient))
            if norm == 0.0:
                if iterations == 1:  # a symmetric response: step aside and look again
                    u[joint.active] = 0.1
                    continue
                complaint = f"the gradient vanishes at x = {joint.from_standard(u).tolist()}"
                break
            normal = gradient / norm
            across = float(np.linalg.norm(u - (normal @ u) * normal))
            scale = max(1.0, float(np.linalg.norm(u)))
            if abs(g) <= 1e-4 * tolerance * norm * scale and across <= tolerance * scale:
                complaint = None
                break
            moved = _hlrf_step(ledger, joint, threshold, u, g, gradient)
            if moved is None:
                settled = (
                    abs(g) <= max(1e-6, 1e-2 * tolerance) * norm * scale and across <= max(1e-4, tolerance) * scale
                )
                complaint = None if settled else "the line search found no better point: noise or a kink"
                break
            u = moved
    except BudgetSpent:
        complaint = f"the budget of {budget} evaluations was spent before the search settled"
    if state is None:
        raise ValueError(f"a budget of {budget} evaluations does not even allow one gradient")
    g, gradient = state
    alpha = -unit(gradient)
    beta = math.copysign(float(np.linalg.norm(u)), origin_value)
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
    if not isinstance(threshold, Marginal):
        return form(lambda x: -np.asarray(function(x), dtype=float), marginals, -threshold, correlation, **options)
    joined = None
    if correlation is not None:
        joined = np.eye(len(marginals) + 1)
        joined[:-1, :-1] = correlation
    known: dict[bytes, float] = {}

    def margin(x: Array) -> Array:
        """A step of the threshold alone costs no evaluation."""
        inputs = np.ascontiguousarray(x[:, :-1])
        keys = [row.tobytes() for row in inputs]
        fresh = {key: row for key, row in zip(keys, inputs, strict=True) if key not in known}
        if fresh:
            values = np.asarray(function(np.array(list(fresh.values()))), dtype=float)
            known.update(zip(fresh, values.tolist(), strict=True))
        return as_array(x[:, -1] - np.array([known[key] for key in keys]))

    return form(margin, [*marginals, threshold], 0.0, joined, **options)


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
