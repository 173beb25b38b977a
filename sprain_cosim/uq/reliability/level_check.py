"""Levels of the mean value family tested on random evaluations: by how many percentage points is each of them off?

A method says z_p: a share p of the responses lies below. Of n random rows k lie below; that alone is known to ±10
percentage points for n = 100. The method's own surrogate narrows it: by its importance vector α it says *which* rows
lie below, those with α·u ≤ β, and a share p of all rows is known to be among them. So only the disagreement has to be
estimated, a share a of those said to lie below and b of those said to lie above:

    off = P(z ≤ z_p) − p = (1 − p)·b − p·a

Where the surrogate is right nothing disagrees and 100 rows decide; where it is not they expose it. Its interval joins
those of a and b (Wilson; MOVER: G. Y. Zou, A. Donner, Stat. Med. 27 (2008) 1693-1702).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtr, ndtri

from ..distributions import JointDistribution, Marginal
from ..distributions.marginal import as_array
from ..sampling import Stream, generator
from ..statistics import Estimate, between_levels, clopper_pearson, exceedance_of_levels, skewed_interval, unmet_tail
from .mean_value_family import LevelResult
from .points import Array, Evaluations, Function, PointLedger, Status

__all__ = ["LevelCheck", "check_levels", "level_exceedance"]

Verdict = Literal["ok", "suspect", "undecided"]

_TRIFLE = 0.015  # an error that needs no word
_MATERIAL = 0.05  # an error that does
_FEW, _HANDFUL = 5, 10  # rows that a share goes by, rows it is a share of, of which no normal law is to be expected
_SHARE = 0.8  # of the smaller of p and 1 − p that a level in order must be within


@dataclass(frozen=True)
class LevelCheck:
    """What random rows say about the levels of a method.

    n        rows evaluated
    off      {p: P(z ≤ z_p) − p with its interval}; 0.04 at p = 0.05 means that 9 % lie below, not 5 %
    verdict  {p: "ok", "suspect" or "undecided", which the most rows could not settle}
    """

    n: int
    off: Mapping[float, Estimate]
    verdict: Mapping[float, Verdict]
    evaluations: Evaluations
    status: Status
    reasons: tuple[str, ...]


def check_levels(
    function: Function,
    marginals: Sequence[Marginal],
    found: LevelResult,
    correlation: ArrayLike | None = None,
    *,
    n: int = 100,
    most: int = 400,
    seed: int = 0,
    confidence: float = 0.95,
) -> LevelCheck:
    """Test the levels of `mean_value`, `amv`, `amv_plus` or `hmv` on random rows of the same inputs.

    n rows, then twice as many while a level is undecided, `most` at last. A level is suspect when its error is shown to
    be above 1.5 percentage points, or at the end estimated at five or more; it is ok when its interval lies within ±5
    percentage points and ±0.8 of the smaller of p and 1 − p.

    Raises ValueError for fewer than 20 rows.
    """
    if n < 20 or most < n:
        raise ValueError(f"the check needs at least 20 rows and at most no fewer than that, got {n} and {most}")
    joint, ledger = JointDistribution(marginals, correlation), PointLedger(function)
    rng, u, y = generator(seed, Stream.CHECK), np.empty((0, len(joint))), np.empty(0)
    size, off, verdict = n, dict[float, Estimate](), dict[float, Verdict]()
    while True:
        more = np.zeros((size - len(u), len(joint)))
        more[:, joint.active] = rng.standard_normal((len(more), len(joint.active)))
        u, y = np.concatenate([u, more]), np.concatenate([y, ledger(joint.from_standard(more))])
        off = {p: _off(u, y, p, z, found.importance[p], confidence) for p, z in found.value.items()}
        verdict = {p: _verdict(p, e) for p, e in off.items()}
        if size >= most or "undecided" not in verdict.values():
            break
        size = min(2 * size, most)
    for p, e in off.items():
        if verdict[p] == "undecided" and abs(e.value) >= _MATERIAL:
            verdict[p] = "suspect"
    reasons = tuple(
        f"level {p:g}: {len(y)} random rows put {100 * (p + e.value):.3g} % below {found.value[p]:.6g}, not "
        f"{100 * p:g} % (off by {100 * e.value:+.2g}, {100 * e.low:+.2g} ... {100 * e.high:+.2g} percentage points)"
        for p, e in sorted(off.items())
        if verdict[p] == "suspect"
    )
    return LevelCheck(len(y), off, verdict, ledger.evaluations(), "suspect" if reasons else "ok", reasons)


def level_exceedance(
    marginals: Sequence[Marginal],
    found: LevelResult,
    check: LevelCheck,
    threshold: float | Marginal,
    correlation: ArrayLike | None = None,
    confidence: float = 0.95,
) -> Estimate:
    """P(z > threshold) between and beyond the levels, corrected by the random rows that tested them.

    The levels and the importance of the highest say what each row should give; what it gives differs. Where the
    threshold is a number only the rows on the wrong side of it count (`_off`); else the mean difference of P(T < z), by
    an interval that allows for its skewness.

    Raises ValueError for fewer than two levels or percentiles that do not increase.
    """
    highest = max(found.value)
    joint, alpha = JointDistribution(marginals, correlation), found.importance[highest]
    u, y = joint.to_standard(check.evaluations.x), check.evaluations.y
    if not isinstance(threshold, Marginal):
        p = 1.0 - exceedance_of_levels(found.value, threshold)
        inside = min(max(p, 1e-9), 1.0 - 1e-9)
        off = _off(u, y, inside, threshold, alpha, confidence)
        return _share_of(1.0 - p - off.value, 1.0 - p - off.high, 1.0 - p - off.low)
    said = exceedance_of_levels(found.value, threshold)
    control = as_array(threshold.cdf(between_levels(found.value, u @ alpha))) - said if np.any(alpha) else 0.0
    remainder = as_array(threshold.cdf(y)) - control
    value = float(np.mean(remainder))
    low, high = skewed_interval(remainder, confidence) if np.ptp(remainder) > 0 else (value, value)
    return _share_of(value, low, max(high, unmet_tail(y, threshold, confidence)))


def _share_of(value: float, low: float, high: float) -> Estimate:
    """Kept within 0 and 1."""
    return Estimate(*(min(max(end, 0.0), 1.0) for end in (value, low, high)))


def _verdict(p: float, off: Estimate) -> Verdict:
    if off.low > _TRIFLE or off.high < -_TRIFLE:
        return "suspect"
    bound = min(_MATERIAL, _SHARE * min(p, 1.0 - p))
    return "ok" if -bound <= off.low and off.high <= bound else "undecided"


def _off(u: Array, y: Array, p: float, z: float, alpha: Array, confidence: float) -> Estimate:
    """P(z ≤ z_p) − p and its interval, from rows u (n, d) and responses y (n,)."""
    predicted, below = u @ alpha <= float(ndtri(p)), y <= z
    quantile = float(ndtri(0.5 * (1.0 + confidence)))
    if not np.any(alpha):  # no surrogate to speak of
        share = _wilson(int(below.sum()), len(y), quantile)
        return Estimate(share.value - p, share.low - p, share.high - p)
    a = _wilson(int(np.sum(predicted & ~below)), int(np.sum(predicted)), quantile)
    b = _wilson(int(np.sum(~predicted & below)), int(np.sum(~predicted)), quantile)
    value = (1.0 - p) * b.value - p * a.value
    # Errors of two shares add by their squares, unless one is that of a handful of rows.
    few = min(int(np.sum(predicted)), int(np.sum(~predicted))) < _HANDFUL
    downwards, upwards = (
        sum(errors) if few else math.hypot(*errors)
        for errors in (
            ((1.0 - p) * (b.value - b.low), p * (a.high - a.value)),
            ((1.0 - p) * (b.high - b.value), p * (a.value - a.low)),
        )
    )
    return Estimate(value, value - downwards, value + upwards)


def _wilson(k: int, n: int, quantile: float) -> Estimate:
    """A share with its score interval, and at least Clopper and Pearson's where it goes by few rows; of no rows nothing
    is known."""
    if n == 0:
        return Estimate(0.0, 0.0, 1.0)
    share, q = k / n, quantile**2
    middle = (k + 0.5 * q) / (n + q)
    half = quantile * math.sqrt(share * (1.0 - share) * n + 0.25 * q) / (n + q)
    low, high = max(middle - half, 0.0), min(middle + half, 1.0)
    if min(k, n - k) < _FEW:
        exact = clopper_pearson(k, n, 2.0 * float(ndtr(quantile)) - 1.0)
        low, high = min(low, float(exact[0])), max(high, float(exact[1]))
    return Estimate(share, low, high)
