"""Second-order reliability: FORM corrected for the curvature of the limit state at the design point.

Sources: K. Breitung, J. Eng. Mech. 110 (1984) 357-366; M. Hohenbichler, R. Rackwitz, J. Eng. Mech. 114 (1988)
2195-2199; L. Tvedt, Two second-order approximations to the failure probability, Veritas report RDIV/20-004-83 (1983).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtr

from ..distributions import JointDistribution, Marginal
from .first_order import FormResult
from .points import Array, Evaluations, Function, PointLedger, Status

__all__ = ["SormResult", "second_order", "sorm"]


@dataclass(frozen=True)
class SormResult:
    """Second-order probabilities of the event of a `FormResult`.

    curvatures (d − 1,) of the limit state at the design point, positive where it bends away from the origin;
    breitung, hohenbichler, tvedt: the probability by K. Breitung (1984), by M. Hohenbichler and
    R. Rackwitz (1988) and by L. Tvedt (1983); NaN where the curvatures leave their range (1 + βκ ≤ 0).

    status is suspect where a formula gives none, or no probability at all (Tvedt's three terms can sum to less than
    zero), or where the formulas differ by more than half: second order is then not enough.
    """

    curvatures: Array
    breitung: float
    hohenbichler: float
    tvedt: float
    evaluations: Evaluations
    status: Status = "ok"
    reasons: tuple[str, ...] = ()


def sorm(
    function: Function,
    marginals: Sequence[Marginal],
    first_order: FormResult,
    correlation: ArrayLike | None = None,
    *,
    step: float = 1e-3,
) -> SormResult:
    """Correct a FORM probability for the curvature of the limit state at its design point.

    Second differences of `step` in the standard space: d(d + 1) + 1 evaluations for d inputs not fixed.
    """
    joint, ledger = JointDistribution(marginals, correlation), PointLedger(function)
    return replace(second_order(ledger, joint, first_order, step), evaluations=ledger.evaluations())


def second_order(function: Function, joint: JointDistribution, first_order: FormResult, step: float) -> SormResult:
    """The same; `evaluations` are those of this call."""
    active, centre = joint.active, first_order.standard_point
    ledger = PointLedger(function)
    d = len(active)
    pairs = [(i, j) for i in range(d) for j in range(i + 1)]
    points = [centre]
    for i, j in pairs:
        for sign in (1.0, -1.0):
            point = centre.copy()
            point[active[i]] += sign * step
            if i != j:
                point[active[j]] += sign * step
            points.append(point)
    values = ledger(joint.from_standard(np.array(points)))
    second = dict(zip(pairs, (values[1::2] - 2.0 * values[0] + values[2::2]) / step**2, strict=True))
    diagonal = np.array([second[i, i] for i in range(d)])
    slopes = np.array([values[1 + 2 * pairs.index((i, i))] - values[2 + 2 * pairs.index((i, i))] for i in range(d)])
    hessian = np.diag(diagonal)
    for i, j in pairs:
        if i != j:
            hessian[i, j] = hessian[j, i] = 0.5 * (second[i, j] - diagonal[i] - diagonal[j])
    # An orthonormal basis whose first vector is alpha; the rest spans the tangent plane.
    tangent = np.linalg.qr(np.column_stack([first_order.alpha[active], np.eye(d)]))[0][:, 1:]
    side = math.copysign(1.0, first_order.beta)
    curved = tangent.T @ hessian @ tangent / float(np.linalg.norm(slopes / (2.0 * step)))
    curvatures: Array = side * np.linalg.eigvalsh(curved)
    distance = abs(first_order.beta)
    tails = _second_order(distance, curvatures)
    breitung, hohenbichler, tvedt = tails if first_order.beta > 0 else tuple(1.0 - tail for tail in tails)
    reasons = _doubts(breitung, hohenbichler, tvedt)
    status: Status = "suspect" if reasons else "ok"
    return SormResult(curvatures, breitung, hohenbichler, tvedt, ledger.evaluations(), status, reasons)


def _doubts(breitung: float, hohenbichler: float, tvedt: float) -> tuple[str, ...]:
    named = {"Breitung": breitung, "Hohenbichler-Rackwitz": hohenbichler, "Tvedt": tvedt}
    reasons = []
    for name, value in named.items():
        if math.isnan(value):
            reasons.append(f"{name}: the limit state bends towards the origin beyond the formula's range")
        elif not 0.0 <= value <= 1.0:
            reasons.append(f"{name}: {value:.3g} is no probability")
    valid = [value for value in named.values() if 0.0 <= value <= 1.0]
    if len(valid) > 1 and max(valid) > 1.5 * min(valid):
        reasons.append(f"the second-order formulas differ: {min(valid):.3g} to {max(valid):.3g}")
    return tuple(reasons)


def _second_order(beta: float, curvatures: Array) -> tuple[float, float, float]:
    """Tail probabilities beyond a design point at distance beta: Breitung, Hohenbichler-Rackwitz, Tvedt."""
    first = float(ndtr(-beta))
    density = math.exp(-0.5 * beta**2) / math.sqrt(2.0 * math.pi)

    def shrink(weight: complex) -> float:
        factors = 1.0 + weight * curvatures
        return math.nan if np.any(factors.real <= 0) else float(np.prod(1.0 / np.sqrt(factors)).real)

    at_beta, excess = shrink(beta), beta * first - density
    tvedt = first * at_beta + excess * (at_beta - shrink(beta + 1.0))
    tvedt += (beta + 1.0) * excess * (at_beta - shrink(beta + 1.0j))
    return first * at_beta, first * shrink(density / first), tvedt
