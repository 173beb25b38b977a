"""Means over landings, and the probability that they exceed the injury threshold with the interval that a study of the
same landings states."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..folders.comparison import INVERSION, MeanEstimate
from ..records import finite
from ..study.questions import QUESTIONS
from ..uq import statistics
from ..uq.exceedance import of_shapes

THRESHOLD = QUESTIONS[INVERSION][1]


def mean_estimate(values: NDArray[np.float64], random: bool, error: float = 0.05) -> MeanEstimate:
    """Of finite values; an interval that misses with probability `error` where they are `random` draws: Student's, and
    of 20 values and more what their skewness asks for."""
    y = values[np.isfinite(values)]
    if len(y) < 2 or not random:
        return MeanEstimate(float(np.mean(y)) if len(y) else None, n=len(y))
    return estimate(statistics.mean(y, 1.0 - error, skewed=True), len(y))


def injury_estimate(inversion: NDArray[np.float64], random: bool, error: float = 0.05, failed: int = 0) -> MeanEstimate:
    """The probability that the inversion from neutral (landings,) [deg] exceeds the injury threshold, as
    `statistics.exceedance` finds it."""
    y = inversion[np.isfinite(inversion)]
    if len(y) < 2 or not random:
        return MeanEstimate(float(np.mean(THRESHOLD.cdf(y))) if len(y) else None, n=len(y))
    return estimate(statistics.exceedance(y, THRESHOLD, 1.0 - error, failed), len(y))


def injury_change(
    one: NDArray[np.float64], other: NDArray[np.float64], random: bool, error: float = 0.05
) -> MeanEstimate:
    """The probability at the inversions `one` (landings,) [deg] minus that at `other`, of the same landings. Its ends
    allow for the tail that either has not met, of which the spread of the differences knows nothing."""
    found = mean_estimate(THRESHOLD.cdf(one) - THRESHOLD.cdf(other), random, error)
    if found.value is None or found.ci_low is None or found.ci_high is None:
        return found
    more, less = (
        max(statistics.unmet_tail(y, THRESHOLD, 1.0 - error) - float(np.mean(THRESHOLD.cdf(y))), 0.0)
        for y in (one[np.isfinite(one)], other[np.isfinite(other)])
    )
    low, high = min(found.ci_low, found.value - less), max(found.ci_high, found.value + more)
    return MeanEstimate(found.value, low, high, found.n)


def injury_of_other_shapes(inversion: NDArray[np.float64]) -> dict[str, float] | None:
    """That probability for thresholds of the same mean and SD in other laws: {law: ...}; None without landings."""
    y = inversion[np.isfinite(inversion)]
    return of_shapes(y, THRESHOLD) if len(y) else None


def estimate(found: statistics.Estimate, n: int, random: bool = True) -> MeanEstimate:
    """As it is written; the interval of `random` draws alone."""
    ends = (finite(found.low), finite(found.high)) if random else (None, None)
    return MeanEstimate(finite(found.value), *ends, n)
