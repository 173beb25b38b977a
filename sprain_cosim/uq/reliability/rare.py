"""The probability of a rare event from a few hundred evaluations, by the best of what first order, second order and
sampling say.

First order finds the design points, from several starts and with a test of the sphere; second order corrects the
nearest for its curvature; importance sampling about all of them gives the estimate, the only one of the three that has
an interval. FORM and SORM stand beside it: where they disagree with it they are wrong.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtr

from ..distributions import JointDistribution, Marginal
from ..statistics import Estimate
from .differences import Difference, check_differences
from .first_order import FormResult
from .importance import ImportanceSampling, sample_event
from .limit_state import Event, LimitState
from .multistart import SPHERE_POINTS, DesignPoints, find_design_points
from .points import DEFAULT_BUDGET, Evaluations, Function, PointLedger, Status
from .second_order import SormResult, second_order

__all__ = ["RareEvent", "rare_event"]


@dataclass(frozen=True)
class RareEvent:
    """P(event) with its interval, and what the other methods say.

    probability    the best estimate: importance sampling's
    cov            its coefficient of variation
    form           of the nearest design point alone
    design_points  all found
    sorm           of the nearest design point, or None where it was not asked for
    sampling       importance sampling
    evaluations    of the function, all methods together
    status         suspect where the estimate may be wrong beyond its interval, or the interval is wide; FORM and SORM
                   being wrong does not make it so, `remarks` say that
    """

    probability: Estimate
    cov: float
    form: FormResult
    design_points: DesignPoints
    sorm: SormResult | None
    sampling: ImportanceSampling
    evaluations: Evaluations
    status: Status
    reasons: tuple[str, ...]
    remarks: tuple[str, ...]


def rare_event(
    function: Function,
    marginals: Sequence[Marginal],
    threshold: float | Marginal,
    correlation: ArrayLike | None = None,
    *,
    above: bool = False,
    curvature: bool = False,
    n: int = 400,
    cov: float | None = None,
    sphere: int = SPHERE_POINTS,
    step: float = 1e-3,
    difference: Difference = "central",
    tolerance: float = 0.03,
    budget: int = DEFAULT_BUDGET,
    seed: int = 0,
    confidence: float = 0.95,
) -> RareEvent:
    """P(function <= threshold), or with `above` P(function > threshold).

    curvature  add SORM, d(d + 1) evaluations for d inputs (an uncertain threshold among them)
    n          rows of importance sampling at most, `cov` the coefficient of variation at which to stop earlier
    sphere     points of the sphere test
    step, difference, tolerance  of the searches, as in `form`; a loose tolerance is enough to sample about
    budget     evaluations of the searches at most

    Raises ValueError for arguments out of range.
    """
    inputs = JointDistribution(marginals, correlation)
    inputs.require_slopes()
    check_differences(step, difference)
    ledger = PointLedger(function, budget)
    state = LimitState(ledger, inputs, Event(threshold, above))
    found = find_design_points(state, sphere, step, difference, tolerance, seed)
    ledger.budget = None
    curved = second_order(state, state.joint, found.nearest, step) if curvature else None
    sampled = sample_event(state, found.points, n, cov, seed, confidence)
    reasons = (*found.reasons, *sampled.reasons)
    return RareEvent(
        sampled.probability,
        sampled.cov,
        found.nearest,
        found,
        curved,
        sampled,
        ledger.evaluations(),
        "suspect" if reasons else "ok",
        reasons,
        _remarks(found, curved, sampled.probability),
    )


def _remarks(found: DesignPoints, curved: SormResult | None, estimate: Estimate) -> tuple[str, ...]:
    remarks = []
    named = {"FORM": found.nearest.probability}
    if curved is not None:
        named |= {"SORM (Breitung)": curved.breitung, "SORM (Tvedt)": curved.tvedt}
        remarks += [f"SORM: {r}" for r in curved.reasons]
    for name, value in named.items():
        if math.isfinite(value) and not estimate.low <= value <= estimate.high and estimate.value > 0:
            remarks.append(
                f"{name} says {value:.3g}, {value / estimate.value:.2g} times the estimate: outside its interval"
            )
    if len(found.points) > 1:
        together = float(np.sum([ndtr(-abs(p.beta)) for p in found.points]))
        remarks.append(f"{len(found.points)} design points; FORM of all together at most {together:.3g}")
    return tuple(remarks)
