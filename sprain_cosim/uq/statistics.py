"""What a sample says, and how surely: percentiles, distribution function, exceedance, stopping, agreement.

Percentiles are of type 7 (linear between order statistics). Their intervals are order statistics too, so they
hold for any continuous response, but for independent rows only: a Monte Carlo sample. Quasi-Monte Carlo takes
the spread over its replicates instead. Failed trials are never dropped in silence: `percentile_bounds` and
`exceedance` say what they could have changed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import bdtr, betaincinv, gammaincinv, ndtri, stdtrit

from .distributions import Marginal

__all__ = [
    "MIN_REPLICATES",
    "Cdf",
    "Estimate",
    "Stopping",
    "agreement",
    "between_levels",
    "clopper_pearson",
    "difference_of_means",
    "empirical_cdf",
    "exceedance",
    "exceedance_of_levels",
    "levels_as_sample",
    "mean",
    "mean_of_largest",
    "order_statistic_ranks",
    "percentile",
    "percentile_bounds",
    "replicated",
    "replicated_exceedance",
    "replicated_moments",
    "replicated_percentile",
    "skewed_interval",
    "standard_deviation",
    "stopping",
    "stopping_of",
    "unmet_tail",
    "wilks_size",
]

Array = NDArray[np.float64]

MIN_REPLICATES = 8


@dataclass(frozen=True)
class Estimate:
    """A value with its confidence interval; an end is ±inf for too small a sample, NaN if unknown."""

    value: float
    low: float
    high: float

    @property
    def half_width(self) -> float:
        return 0.5 * (self.high - self.low)


def _sample(y: ArrayLike, least: int = 1) -> Array:
    values = np.asarray(y, dtype=float)
    if values.ndim != 1 or len(values) < least:
        raise ValueError(f"expected a sample of at least {least} values, got shape {values.shape}")
    if not np.all(np.isfinite(values)):
        raise ValueError("the sample holds values that are not finite; count failed trials apart")
    return values


def _probability(p: float, name: str = "the level") -> float:
    if not 0 < p < 1:
        raise ValueError(f"{name} must lie between 0 and 1, got {p}")
    return float(p)


def _type7(ordered: Array, p: float) -> float:
    position = (len(ordered) - 1) * p
    j = min(int(position), len(ordered) - 1)
    share = position - j
    if share == 0.0 or ordered[j] == ordered[min(j + 1, len(ordered) - 1)]:
        return float(ordered[j])
    return float(ordered[j] + share * (ordered[j + 1] - ordered[j]))


def _binomial_quantile(q: float, n: int, p: float) -> int:
    """Smallest k with P(B ≤ k) ≥ q for B ~ Binomial(n, p)."""
    k = int(np.clip(n * p + ndtri(q) * math.sqrt(n * p * (1 - p)), 0, n))
    while k > 0 and bdtr(k - 1, n, p) >= q:
        k -= 1
    while bdtr(k, n, p) < q:
        k += 1
    return k


def order_statistic_ranks(n: int, p: float, confidence: float = 0.95) -> tuple[int, int]:
    """Ranks (from 1) of the order statistics that bound the p-quantile of n independent values.

    Rank 0 or n + 1 means that the sample is too small for a bound on that side. The coverage is at least
    `confidence`.
    """
    _probability(p)
    tail = 0.5 * (1.0 - _probability(confidence, "the confidence"))
    return _binomial_quantile(tail, n, p), _binomial_quantile(1.0 - tail, n, p) + 1


def percentile(y: ArrayLike, p: float, confidence: float = 0.95) -> Estimate:
    """The p-quantile (0 < p < 1) of independent values, with an order-statistic interval."""
    ordered = np.sort(_sample(y))
    low, high = order_statistic_ranks(len(ordered), p, confidence)
    return Estimate(
        _type7(ordered, p),
        float(ordered[low - 1]) if low >= 1 else -math.inf,
        float(ordered[high - 1]) if high <= len(ordered) else math.inf,
    )


def replicated(y: ArrayLike, replicates: int, statistic: Callable[[Array], Any], confidence: float = 0.95) -> Estimate:
    """A statistic of a replicated quasi-Monte Carlo sample, row i belonging to replicate i % replicates.

    The value is that of all rows together; the interval is Student's over the replicates' own values, NaN for
    fewer than 8 replicates.
    """
    values = _sample(y)
    value = float(statistic(values))
    if replicates < MIN_REPLICATES or len(values) < replicates:
        return Estimate(value, math.nan, math.nan)
    each = np.array([float(statistic(values[r::replicates])) for r in range(replicates)])
    half = _student(replicates - 1, confidence) * float(np.std(each, ddof=1)) / math.sqrt(replicates)
    return Estimate(value, value - half, value + half)


def replicated_moments(y: ArrayLike, replicates: int, confidence: float = 0.95) -> tuple[Estimate, Estimate]:
    """Mean and standard deviation of a replicated sample. A replicate has seldom met a long tail, and their spread is
    small where none has: of a kurtosis above 6 the upper end of the standard deviation, and the mean's towards the
    tail, are at least those of as many independent rows."""
    values = _sample(y)
    mean_of = replicated(values, replicates, np.mean, confidence)
    sd_of = replicated(values, replicates, lambda v: np.std(v, ddof=1), confidence)
    away = values - mean_of.value
    if math.isfinite(sd_of.high) and np.mean(away**4) > _LONG_TAIL * np.mean(away**2) ** 2:
        alone = mean(values, confidence, skewed=True)
        sd_of = replace(sd_of, high=max(sd_of.high, standard_deviation(values, confidence).high))
        if np.sum(away**3) > 0:
            mean_of = replace(mean_of, high=max(mean_of.high, alone.high))
        else:
            mean_of = replace(mean_of, low=min(mean_of.low, alone.low))
    return mean_of, sd_of


_LONG_TAIL = 6.0  # kurtosis; a normal law has 3


def replicated_percentile(y: ArrayLike, replicates: int, p: float, confidence: float = 0.95) -> Estimate:
    """The p-quantile of a replicated quasi-Monte Carlo sample, row i belonging to replicate i % replicates.

    Percentiles of the replicates themselves would be those of small samples, hence biased. So the spread is that of the
    shares of each replicate below the pooled value, and the interval of the share is read off the pooled sample (R. S.
    Woodruff, J. Am. Stat. Assoc. 47 (1952) 635-646). An end is ±inf where the sample is too small for it; NaN for
    fewer than 8 replicates.
    """
    values = _sample(y)
    ordered, n = np.sort(values), len(values)
    value = _type7(ordered, _probability(p))
    if replicates < MIN_REPLICATES or n < replicates:
        return Estimate(value, math.nan, math.nan)
    below = np.array([float(np.mean(values[r::replicates] <= value)) for r in range(replicates)])
    error = max(float(np.std(below, ddof=1)) / math.sqrt(replicates), 0.5 / n)
    reach = _student(replicates - 1, confidence) * error
    low, high = np.interp(np.array([p - reach, p + reach]) * n + 0.5, np.arange(1, n + 1), ordered)
    return Estimate(
        value,
        float(low) if (p - reach) * n >= 0.5 else -math.inf,
        float(high) if (p + reach) * n <= n - 0.5 else math.inf,
    )


def replicated_exceedance(
    y: ArrayLike, replicates: int, threshold: float | Marginal, confidence: float = 0.95
) -> Estimate:
    """P(Y > T) from a replicated quasi-Monte Carlo sample, kept within 0 and 1; T as in `exceedance`.

    Where all replicates agree their spread says nothing, and the interval is that of as many independent rows. Where
    few rows carry the mean, the upper end allows for what the sample has not met (`unmet_tail`).
    """
    found = replicated(y, replicates, lambda values: np.mean(_threshold_below(threshold, values)), confidence)
    if found.low == found.high:
        return exceedance(y, threshold, confidence)
    if not math.isfinite(found.low):
        return found
    high = found.high if not isinstance(threshold, Marginal) else max(found.high, unmet_tail(y, threshold, confidence))
    return Estimate(found.value, max(found.low, 0.0), min(high, 1.0))


def _student(freedom: float, confidence: float) -> float:
    return float(stdtrit(freedom, 0.5 * (1.0 + _probability(confidence, "the confidence"))))


def mean(y: ArrayLike, confidence: float = 0.95, skewed: bool = False) -> Estimate:
    """Mean of independent values with Student's interval; `skewed`: of 20 values and more it holds also the one that is
    straightened for their skewness (`skewed_interval`), whose long side Student's misses."""
    values = _sample(y, 2)
    half = _student(len(values) - 1, confidence) * float(np.std(values, ddof=1)) / math.sqrt(len(values))
    value = float(np.mean(values))
    low, high = value - half, value + half
    if skewed and len(values) >= _SKEW_KNOWN and half > 0:
        straight = skewed_interval(values, confidence)
        low, high = min(low, straight[0]), max(high, straight[1])
    return Estimate(value, low, high)


_SKEW_KNOWN = 20  # values whose skewness says something


def difference_of_means(one: ArrayLike, other: ArrayLike, confidence: float = 0.95) -> Estimate:
    """The mean of one sample minus that of another one of its own spread, with Welch's interval (B. L. Welch,
    Biometrika 34 (1947) 28-35)."""
    samples = _sample(one, 2), _sample(other, 2)
    value = float(np.mean(samples[0]) - np.mean(samples[1]))
    spread = [float(np.var(y, ddof=1)) / len(y) for y in samples]
    if not sum(spread) > 0:
        return Estimate(value, value, value)
    freedom = sum(spread) ** 2 / sum(v**2 / (len(y) - 1) for v, y in zip(spread, samples, strict=True))
    half = _student(freedom, confidence) * math.sqrt(sum(spread))
    return Estimate(value, value - half, value + half)


def mean_of_largest(values: ArrayLike, by: ArrayLike, count: int, confidence: float = 0.95) -> Estimate:
    """The mean of `values` over the `count` rows whose `by` is largest, as an estimate of that over the same share of
    all rows there may be. Where the border lies is estimated as well, so that the variance of the mean is that of
    the values beyond it plus (1 - share) times the square of their mean's distance from the border, over `count`
    (S. X. Chen, J. Financ. Econom. 6 (2008) 87-107, of the shortfall, whose values are `by` itself)."""
    ordered = _sample(values, 4)[np.argsort(-np.asarray(by, dtype=float), kind="stable")]
    if not 2 <= count < len(ordered):
        raise ValueError(f"expected between 2 and {len(ordered) - 1} rows, got {count}")
    largest, around = ordered[:count], max(1, count // 4)
    value, share = float(np.mean(largest)), count / len(ordered)
    distance = value - float(np.mean(ordered[count - around : count + around]))
    variance = (float(np.var(largest, ddof=1)) + (1.0 - share) * distance**2) / count
    half = _student(count - 1, confidence) * math.sqrt(variance)
    return Estimate(value, value - half, value + half)


def standard_deviation(y: ArrayLike, confidence: float = 0.95) -> Estimate:
    """Standard deviation (n − 1) of independent values.

    The interval holds that by the kurtosis in logs, right for light tails, and that of the mean of the squared
    deviations straightened by Hall's transformation, which the large ones among them need (`skewed_interval`). A long
    tail is seldom met by few values, so that of up to 1000 values the upper end is also at least that of the shifted
    lognormal law that looks most like them (`_as_lognormal`).
    """
    values = _sample(y, 4)
    n, value = len(values), float(np.std(values, ddof=1))
    if value == 0.0:
        return Estimate(0.0, 0.0, 0.0)
    squares = (values - np.mean(values)) ** 2
    kurtosis = float(np.mean(squares**2)) / float(np.var(values)) ** 2
    log_half = _student(n - 1, confidence) * 0.5 * math.sqrt(max(kurtosis - (n - 3) / (n - 1), 0.0) / n)
    low, high = value * math.exp(-log_half), value * math.exp(log_half)
    if np.ptp(squares) > 0:
        straight = skewed_interval(squares * (n / (n - 1)), confidence)
        low, high = min(low, math.sqrt(max(straight[0], 0.0))), max(high, math.sqrt(max(straight[1], 0.0)))
        if _TAIL_MET >= n >= _SHAPE_KNOWN:
            _, _, means, sds = _as_lognormal(values)
            found = np.exp(means + 0.5 * sds**2) * np.sqrt(np.expm1(sds**2))
            high = max(high, float(np.quantile(found, 0.5 * (1.0 + confidence))))
    return Estimate(value, low, high)


_SHAPE_KNOWN, _TAIL_MET = 8, 1000  # values
_SHIFTS = np.geomspace(0.02, 100.0, 24)  # of the law's end beyond the outermost value, in standard deviations
_MIDDLES = (np.arange(32) + 0.5) / 32


def _as_lognormal(values: Array) -> tuple[float, float, Array, Array]:
    """What is known of a sample if it were shifted lognormal, to either side: `side` 1 or -1, `origin`, and draws (32,
    32) of mean and SD of the logs, for y = side (origin + exp(log)).

    The shift is the one by which logs lie straightest on normal paper (J. J. Filliben, Technometrics 17 (1975)
    111-117); what the logs leave open of their mean and spread is carried on as a generalised pivot (K. Krishnamoorthy,
    T. Mathew, J. Stat. Plan. Inference 115 (2003) 103-121).
    """
    ordered, n = np.sort(values), len(values)
    normal = ndtri((np.arange(1, n + 1) - 0.375) / (n + 0.25))
    best, side, origin, mean, spread = -1.0, 1.0, 0.0, 0.0, 0.0
    for sign, y in ((1.0, ordered), (-1.0, -ordered[::-1])):
        shifts = _SHIFTS * float(np.std(y))
        logs = np.log(y - y[0] + shifts[:, np.newaxis])
        centred = logs - logs.mean(axis=1, keepdims=True)
        straight = (centred @ normal) / np.linalg.norm(centred, axis=1)
        k = int(np.argmax(straight))
        if straight[k] > best:
            best, side, origin = float(straight[k]), sign, float(y[0] - shifts[k])
            mean, spread = float(logs[k].mean()), float(np.std(logs[k], ddof=1))
    half = 0.5 * (n - 1)
    variances = spread**2 * half / gammaincinv(half, _MIDDLES)[:, np.newaxis]
    means = mean + np.sqrt(variances / n) * ndtri(_MIDDLES)
    return side, origin, means, np.sqrt(np.minimum(variances, 50.0)) + np.zeros_like(means)


@dataclass(frozen=True)
class Cdf:
    """Empirical distribution function: P(Y ≤ value[k]) = probability[k], bounds `low` and `high`."""

    value: Array
    probability: Array
    low: Array
    high: Array


def empirical_cdf(y: ArrayLike, confidence: float = 0.95) -> Cdf:
    """Distribution function of independent values, with Clopper-Pearson bounds at each value."""
    values = _sample(y)
    value, counts = np.unique(values, return_counts=True)
    below = np.cumsum(counts)
    low, high = clopper_pearson(below, len(values), confidence)
    return Cdf(value, below / len(values), low, high)


def clopper_pearson(k: ArrayLike, n: float, confidence: float = 0.95) -> tuple[Array, Array]:
    """Ends of the interval of a probability of which k of n independent trials had the event."""
    k = np.asarray(k, dtype=float)
    tail = 0.5 * (1.0 - _probability(confidence, "the confidence"))
    low = np.where(k > 0, betaincinv(np.maximum(k, 1.0), n - k + 1.0, tail), 0.0)
    high = np.where(k < n, betaincinv(k + 1.0, np.maximum(n - k, 1.0), 1.0 - tail), 1.0)
    return low, high


def percentile_bounds(y: ArrayLike, failed: int, p: float) -> tuple[float, float]:
    """Lowest and highest p-quantile of the sample and its `failed` missing values; ±inf where open."""
    ordered = np.sort(_sample(y))
    missing, p = np.full(failed, np.inf), _probability(p)
    return _type7(np.concatenate([-missing, ordered]), p), _type7(np.concatenate([ordered, missing]), p)


def exceedance(y: ArrayLike, threshold: float | Marginal, confidence: float = 0.95, failed: int = 0) -> Estimate:
    """P(Y > T) for independent values of Y and a threshold T that is a number or itself uncertain
    (independent of Y).

    For a number: share of the values above, Clopper-Pearson interval. For a marginal: mean of P(T < yᵢ), of which a
    few large terms carry most; interval by P. Hall's transformation, which straightens their skewness (J. R. Stat. Soc.
    B 54 (1992) 221-228), kept within 0 and 1. Where few values carry the mean, the upper end allows for what the sample
    has not met (`unmet_tail`). `failed` trials widen the interval by all they could have been: none or all of them
    above.
    """
    values = _sample(y, 2)
    n = len(values)
    if isinstance(threshold, Marginal):
        above = _threshold_below(threshold, values)
        value = float(np.mean(above))
        # Where no value differs in the least the spread says nothing; the count of rows still does.
        low, high = (float(end[0]) for end in clopper_pearson([round(value * n)], n, confidence))
        if np.ptp(above) > 0:
            low, high = skewed_interval(above, confidence)
            low, high = max(low, 0.0), min(max(high, unmet_tail(values, threshold, confidence)), 1.0)
    else:
        k = int(np.sum(values > threshold))
        value = k / n
        low, high = (float(end[0]) for end in clopper_pearson([k], n, confidence))
    whole = n + failed
    return Estimate(value, low * n / whole, (high * n + failed) / whole)


_CARRIERS = 100  # values that must carry a mean, (Σf)²/Σf², for its spread to be believed


def skewed_interval(values: Array, confidence: float) -> tuple[float, float]:
    """Ends of the interval of a mean of skewed values, by Hall's monotone cubic transformation of Student's t."""
    size = float(np.max(np.abs(values)))  # terms of 1e-120 have no third power
    n, mean, deviation = len(values), float(np.mean(values)), float(np.std(values / size))
    skewness = 0.0  # of values that are equal but for rounding
    if deviation > 1e-12:
        skewness = float(np.mean(((values - mean) / size / deviation) ** 3)) / math.sqrt(n)
    error, t = size * deviation / math.sqrt(n - 1), _student(n - 1, confidence)
    if abs(skewness) < 1e-9:
        return mean - t * error, mean + t * error

    def turned(q: float) -> float:
        """The t at which the transformed t is q."""
        return float(np.cbrt(1.0 + skewness * (q - skewness / 6.0)) - 1.0) * 3.0 / skewness

    return mean - turned(t) * error, mean - turned(-t) * error


_NORMAL = np.linspace(-6.0, 6.0, 97)
_NORMAL_WEIGHTS = np.exp(-0.5 * _NORMAL**2) / np.sum(np.exp(-0.5 * _NORMAL**2))
_LAGUERRE, _LAGUERRE_WEIGHTS = np.polynomial.laguerre.laggauss(24)


def unmet_tail(y: ArrayLike, threshold: Marginal, confidence: float = 0.95) -> float:
    """What the upper end of an interval of P(Y > T) must at least be, by n independent values of Y: that of an
    exponential or lognormal tail of them where fewer than 100 carry the mean of P(T < yᵢ), that of the count of rows
    where none differs in it, else 0. The spread of a mean says nothing of large terms that the sample has not met."""
    values = _sample(y, 2)
    above, n = threshold.cdf(values), len(values)
    if not np.ptp(above) > 0:
        return float(clopper_pearson([round(float(np.sum(above)))], n, confidence)[1][0])
    above = above / above.max()  # whose squares may be too small for a number
    few = np.sum(above) ** 2 < _CARRIERS * np.sum(above**2)
    return _tail_bound(values, threshold, confidence) if few else 0.0


def _tail_bound(values: Array, threshold: Marginal, confidence: float) -> float:
    """Upper bound of the mean of P(T < y) if y goes on beyond the sample with an exponential tail, or is the shifted
    lognormal law that looks most like it, whichever is larger.

    The tail begins at one of the largest 2√n values; its weight and its mean excess are taken at their upper limits.
    """
    n, ordered = len(values), np.sort(values)
    k = min(max(8, round(2.0 * math.sqrt(n))), n // 2)
    start = ordered[n - k - 1]
    excess = float(np.mean(ordered[n - k :] - start)) * k / float(gammaincinv(k, 1.0 - confidence))
    share = float(betaincinv(k + 1.0, n - k, confidence))
    beyond = float(_LAGUERRE_WEIGHTS @ threshold.cdf(start + excess * _LAGUERRE))
    bound = float(np.sum(threshold.cdf(ordered[: n - k]))) / n + share * beyond
    if n < _SHAPE_KNOWN:
        return bound
    side, origin, means, sds = _as_lognormal(values)
    logs = np.minimum(means[..., np.newaxis] + sds[..., np.newaxis] * _NORMAL, 700.0)
    found = threshold.cdf(side * (origin + np.exp(logs))) @ _NORMAL_WEIGHTS
    return max(bound, float(np.quantile(found, 0.5 * (1.0 + confidence))))


def exceedance_of_levels(levels: Mapping[float, float], threshold: float | Marginal) -> float:
    """P(Y > T) from percentiles {p: z_p}, such as those of AMV: z linear in β = Φ⁻¹(p) between the levels and
    beyond the outermost. No interval: a search has no sampling error, and its own is not known from inside.

    Raises ValueError for fewer than two levels or percentiles that do not increase.
    """
    return float(np.mean(_threshold_below(threshold, levels_as_sample(levels))))


def levels_as_sample(levels: Mapping[float, float], n: int = 20_000) -> Array:
    """(n,) responses at n equal steps of probability: z linear in β = Φ⁻¹(p) between the levels and beyond. Raises
    ValueError as `exceedance_of_levels`."""
    return between_levels(levels, ndtri((np.arange(n) + 0.5) / n))


def between_levels(levels: Mapping[float, float], at: Array) -> Array:
    """(n,) responses at β = `at` (n,). Raises ValueError as `exceedance_of_levels`."""
    p = np.array(sorted(levels))
    z = np.array([levels[level] for level in p])
    if len(p) < 2 or np.any(np.diff(z) <= 0):
        raise ValueError("at least two levels with increasing percentiles are needed")
    beta = ndtri(p)
    value = np.interp(at, beta, z)
    for outer, inner, beyond in ((0, 1, at < beta[0]), (-1, -2, at > beta[-1])):
        slope = (z[outer] - z[inner]) / (beta[outer] - beta[inner])
        value[beyond] = z[outer] + slope * (at[beyond] - beta[outer])
    return np.asarray(value, dtype=float)


def _threshold_below(threshold: float | Marginal, values: Array) -> Array:
    """P(T < y) for each y."""
    if not isinstance(threshold, Marginal):
        return (values > threshold).astype(float)
    if threshold.is_fixed:
        raise ValueError("give a fixed threshold as a number")
    return threshold.cdf(values)


@dataclass(frozen=True)
class Stopping:
    """Whether a sample is large enough: the half-width of each level's interval against the one wanted.

    `needed` is the number of rows at which the widest level should meet it, half-widths shrinking as 1/√n
    (None while a level has no interval yet).
    """

    met: bool
    half_width: dict[float, float]
    wanted: float
    needed: int | None


def stopping(
    y: ArrayLike, wanted: float, levels: Sequence[float] = (0.05, 0.5, 0.95), confidence: float = 0.95
) -> Stopping:
    """Compare the half-widths of the percentiles' intervals with the one wanted (in the response's unit)."""
    values = _sample(y)
    return stopping_of({float(p): percentile(values, p, confidence) for p in levels}, len(values), wanted)


def stopping_of(estimates: Mapping[float, Estimate], n: int, wanted: float) -> Stopping:
    """The same from percentiles {level: estimate} of n rows at hand."""
    if not wanted > 0:
        raise ValueError(f"the half-width wanted must be positive, got {wanted}")
    half = {float(p): estimate.half_width for p, estimate in estimates.items()}
    widest = max(half.values())
    if math.isfinite(widest) and widest <= wanted:
        return Stopping(True, half, float(wanted), n)
    return Stopping(
        False, half, float(wanted), math.ceil(n * (widest / wanted) ** 2) if math.isfinite(widest) else None
    )


def agreement(value: float, estimate: Estimate) -> str:
    """A value against a sample's interval: 'inside', 'below by …', 'above by …' or 'no interval'."""
    if math.isnan(estimate.low) or math.isnan(estimate.high):
        return "no interval"
    if value < estimate.low:
        return f"below by {estimate.low - value:.3g}"
    if value > estimate.high:
        return f"above by {value - estimate.high:.3g}"
    return "inside"


def wilks_size(p: float, confidence: float = 0.95) -> int:
    """Rows whose largest value is an upper bound of the p-quantile with `confidence` (S. S. Wilks, 1941)."""
    _probability(p)
    _probability(confidence, "the confidence")
    return math.ceil(math.log(1.0 - confidence) / math.log(p) - 1e-12)
