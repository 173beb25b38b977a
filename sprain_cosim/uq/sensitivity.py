"""Which inputs matter: correlations, importance, probabilistic sensitivity factors, Sobol' indices.

Arrays: x (n, d) inputs, y (n,) responses. Every estimate comes with its own uncertainty. Note that for a
normal input the normalised dmean_dmean is Pearson's r up to sampling, so that their agreement is no
independent evidence.

Sources: Y.-T. Wu, Computational methods for efficient structural reliability and reliability sensitivity
analysis, AIAA J. 32 (1994) 1717-1723, and H. Millwater 2009 (sensitivity factors); A. Saltelli et al.,
Comput. Phys. Commun. 181 (2010) 259-270 (first order), M. J. W. Jansen, Comput. Phys. Commun. 117 (1999)
35-43 (total); B. Sudret, Reliab. Eng. Syst. Saf. 93 (2008) 964-979 (indices from polynomial chaos); D. G.
Bonett, T. A. Wright, Psychometrika 65 (2000) 23-28 (Spearman's interval); B. Efron, J. Am. Stat. Assoc. 82
(1987) 171-185 (BCa).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations_with_replacement
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import eval_hermitenorm, eval_legendre, ndtr, ndtri, stdtrit

from .chaos import orthonormal, redrawn
from .distributions import JointDistribution, Marginal, Normal, Uniform
from .sampling import Stream, generator, sobol
from .statistics import clopper_pearson, skewed_interval

__all__ = [
    "FOURTH_ORDER",
    "Correlation",
    "GivenDataIndices",
    "Importance",
    "PhysicalImportance",
    "SensitivityFactors",
    "SobolIndices",
    "given_data_indices",
    "importance",
    "importance_x",
    "pearson",
    "sensitivity_factors",
    "sobol_indices",
    "spearman",
]

Array = NDArray[np.float64]


def _paired(x: ArrayLike, y: ArrayLike, least: int = 4) -> tuple[Array, Array]:
    xs, ys = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    if xs.ndim == 1:
        xs = xs[:, np.newaxis]
    if xs.ndim != 2 or ys.shape != (len(xs),):
        raise ValueError(f"expected x (n, d) and y (n,), got {np.shape(x)} and {np.shape(y)}")
    if len(ys) < least:
        raise ValueError(f"at least {least} rows are needed, got {len(ys)}")
    if not (np.all(np.isfinite(xs)) and np.all(np.isfinite(ys))):
        raise ValueError("x or y holds values that are not finite; leave failed trials out, knowingly")
    return xs, ys


@dataclass(frozen=True)
class Correlation:
    """(d,) coefficients with the ends of their intervals; NaN where input or response does not vary."""

    value: Array
    low: Array
    high: Array


def pearson(x: ArrayLike, y: ArrayLike, confidence: float = 0.95) -> Correlation:
    """Pearson's r of each input with the response. The interval is on Fisher's z; its error is at least that of two
    normal variables, and that of rows left out one by one where a response is bent or has a long tail."""
    xs, ys = _paired(x, y)
    r, n = _pearson(xs, ys), len(ys)
    dx, dy = _standard(xs), _standard(ys[:, np.newaxis])
    more = n / (n - 1)
    norms = np.sqrt(np.maximum(n - more * dx**2, 0.0) * np.maximum(n - more * dy**2, 0.0))
    left = np.where(norms > 1e-9 * n, (n * r - more * dx * dy) / np.maximum(norms, 1e-9 * n), 0.0)
    z = np.arctanh(np.clip(left, -_NEARLY, _NEARLY))
    own = np.sqrt((n - 1) / n * np.sum((z - z.mean(axis=0)) ** 2, axis=0))
    return _fisher(r, np.full(len(r), 1.0 / math.sqrt(n - 3)), np.where(np.abs(r) < _NEARLY, own, 0.0), n, confidence)


_NEARLY = 1.0 - 1e-12  # a correlation that is perfect but for rounding


def spearman(x: ArrayLike, y: ArrayLike, confidence: float = 0.95) -> Correlation:
    """Spearman's rank correlation (mean ranks for ties). The interval is on Fisher's z, with Bonett and Wright's error,
    and that of the ranks as a U-statistic where it is larger."""
    xs, ys = _paired(x, y)
    n, below = len(ys), (_ranks(ys) - 0.5) / len(ys)
    ranks = np.column_stack([(_ranks(column) - 0.5) / n for column in xs.T])
    r = _pearson(ranks, below)
    above = [_mean_above(column, below) + _mean_above(ys, rank) for column, rank in zip(xs.T, ranks.T, strict=True)]
    influence = 12.0 * (ranks * below[:, np.newaxis] + np.column_stack(above))
    own = np.std(influence, axis=0, ddof=1) / math.sqrt(n) / np.where(np.abs(r) < 1.0, 1.0 - r**2, np.inf)
    return _fisher(r, np.sqrt((1.0 + 0.5 * r**2) / (n - 3)), own, n, confidence)


def _standard(xs: Array) -> Array:
    sd = np.std(xs, axis=0)
    return np.asarray((xs - xs.mean(axis=0)) / np.where(sd > 0, sd, 1.0))


def _mean_above(values: Array, of: Array) -> Array:
    """(n,) for each value the sum of `of` at the larger ones, over n; its own, and that of its like, by half."""
    distinct, place = np.unique(values, return_inverse=True)
    sums = np.bincount(place, of, len(distinct))
    return np.asarray((sums[::-1].cumsum()[::-1] - 0.5 * sums)[place] / len(of))


def _pearson(xs: Array, ys: Array) -> Array:
    dx, dy = xs - xs.mean(axis=0), ys - ys.mean()
    constant = (np.ptp(xs, axis=0) == 0.0) | (np.ptp(ys) == 0.0)
    norms = np.sqrt(np.sum(dx**2, axis=0) * np.sum(dy**2))
    r = np.clip(dx.T @ dy / np.where(constant, 1.0, norms), -1.0, 1.0)
    return np.where(constant, np.nan, r)


def _ranks(values: Array) -> Array:
    _, inverse, counts = np.unique(values, return_inverse=True, return_counts=True)
    return (np.cumsum(counts) - 0.5 * (counts - 1))[inverse]


def _fisher(r: Array, of_normal: Array, own: Array, n: int, confidence: float) -> Correlation:
    """`of_normal` (d,) standard error of z for two normal variables, `own` (d,) as the n rows show it."""
    tail = 0.5 * (1.0 + confidence)
    with np.errstate(divide="ignore"):
        z = np.arctanh(r)
    half = np.maximum(float(ndtri(tail)) * of_normal, float(stdtrit(n - 1, tail)) * own)
    return Correlation(r, np.tanh(z - half), np.tanh(z + half))


@dataclass(frozen=True)
class Importance:
    """Direction in the standard space in which the response grows, from a sample.

    alpha (d,) unit vector, 0 for fixed inputs, standard_error (d,), at most 1: such a direction is not known; r2 is the
    share of the variance that a linear response explains, adjusted for the slopes fitted (M. Ezekiel 1930): the
    importance of a response that is not linear is only as good as that.
    """

    alpha: Array
    standard_error: Array
    r2: float


def importance(
    x: ArrayLike, y: ArrayLike, marginals: Sequence[Marginal], correlation: ArrayLike | None = None
) -> Importance:
    """Importance levels from a least-squares fit of y to the independent standard variables u(x)."""
    xs, ys = _paired(x, y)
    joint = JointDistribution(marginals, correlation)
    active = joint.active
    design = np.column_stack([np.ones(len(ys)), joint.to_standard(xs)[:, active]])
    if len(ys) <= design.shape[1]:
        raise ValueError(f"{len(ys)} rows cannot determine the slopes of {len(active)} inputs")
    alpha, error = np.zeros(len(joint)), np.zeros(len(joint))
    _, alpha[active], error[active], r2 = _direction(design, ys)
    return Importance(alpha, error, r2)


def _direction(design: Array, y: Array) -> tuple[Array, Array, Array, float]:
    """Least-squares slopes (k,) of y by the columns of `design` (n, 1 + k), the first of which is 1; their unit vector,
    its standard error and the adjusted r².

    The covariance is White's with each residual over its row's own share (J. G. MacKinnon, H. White, J. Econom. 29
    (1985) 305-325): the residual of a curved response grows with the distance from the centre, and a fit of many
    slopes to few rows hides it. Slopes that are noise are too long in the mean, so that the direction's error is over
    the length that is left without it.
    """
    n, k = design.shape[0], design.shape[1] - 1
    q, r = np.linalg.qr(design)
    slopes = np.linalg.solve(r, q.T @ y)
    residual = y - design @ slopes
    own = residual / np.maximum(1.0 - np.sum(q**2, axis=1), 1e-9)
    moved = np.linalg.solve(r, (q * own[:, np.newaxis]).T)[1:]  # of the slopes by each row
    covariance = moved @ moved.T
    slopes, variance = slopes[1:], float(np.sum((y - y.mean()) ** 2))
    norm, known = float(np.linalg.norm(slopes)), float(slopes @ slopes - np.trace(covariance))
    unit, error = np.zeros(k), np.zeros(k)
    if norm > 0:
        unit = slopes / norm
        across = np.eye(k) - np.outer(unit, unit)
        spread = np.sqrt(np.maximum(np.diag(across @ covariance @ across), 0.0))
        error = np.minimum(spread / math.sqrt(known), 1.0) if known > 0 else np.ones(k)
    explained = 1.0 - float(residual @ residual) / variance * (n - 1) / (n - 1 - k) if variance > 0 else math.nan
    return slopes, unit, error, max(explained, 0.0)


@dataclass(frozen=True)
class SensitivityFactors:
    """Derivatives of the response's mean and standard deviation with respect to each input's, times σx/σy;
    all (d,).

    dmean_dmean ∂μy/∂μx · dmean_dsd ∂μy/∂σx · dsd_dmean ∂σy/∂μx · dsd_dsd ∂σy/∂σx

    NaN for inputs that have no such derivative (fixed; uniform, whose ends would move). `standard_error`
    holds the same four by the jackknife, `low` and `high` the ends of intervals (None without resampling); of dsd_dsd
    they are NaN below 100 rows, which seldom meet what it depends on.
    """

    dmean_dmean: Array
    dmean_dsd: Array
    dsd_dmean: Array
    dsd_dsd: Array
    standard_error: SensitivityFactors | None = None
    low: SensitivityFactors | None = None
    high: SensitivityFactors | None = None


def _scores(xs: Array, joint: JointDistribution) -> tuple[Array, Array]:
    """(n, d) score functions of the joint density for each input's mean and standard deviation."""
    z = joint.to_normal(xs)
    # Through the copula a marginal's parameter also moves its z; with independent inputs that part vanishes.
    pull = z @ (np.linalg.inv(joint.normal_correlation) - np.eye(len(joint)))
    by_mean, by_sd = np.empty_like(xs), np.empty_like(xs)
    for i, marginal in enumerate(joint.marginals):
        score_mean, score_sd = marginal.score(xs[:, i])
        shift_mean, shift_sd = marginal.standard_shift(xs[:, i])
        by_mean[:, i] = score_mean - pull[:, i] * shift_mean
        by_sd[:, i] = score_sd - pull[:, i] * shift_sd
    return by_mean, by_sd


def sensitivity_factors(
    x: ArrayLike,
    y: ArrayLike,
    marginals: Sequence[Marginal],
    correlation: ArrayLike | None = None,
    *,
    resamples: int = 0,
    confidence: float = 0.95,
    seed: int = 0,
) -> SensitivityFactors:
    """The four probabilistic sensitivity factors by score functions, from a Monte Carlo sample of the
    marginals.

    ∂μy/∂θ = E[(y − μy)κ], ∂σy/∂θ = E[((y − μy)² − σy²)κ]/(2σy), κ = ∂ ln f/∂θ. `resamples` > 0 adds BCa
    bootstrap intervals (a thousand for four digits of confidence; memory is resamples × n bytes at a time in
    blocks), widened where those of the jackknife are wider: of few rows BCa's alone hold too seldom.
    """
    xs, ys = _paired(x, y)
    joint = JointDistribution(marginals, correlation)
    if xs.shape[1] != len(joint):
        raise ValueError(f"x has {xs.shape[1]} columns for {len(joint)} marginals")
    n, y0, scale = len(ys), ys - ys.mean(), np.tile(joint.sds, 2)
    if not np.any(y0):
        raise ValueError("the response does not vary: it has no sensitivity factors")
    kappa = np.concatenate(_scores(xs, joint), axis=1)  # (n, 2d): means, then standard deviations
    products = [kappa, y0[:, np.newaxis] * kappa, (y0**2)[:, np.newaxis] * kappa]
    moments = np.column_stack([y0, y0**2, *products])
    estimate = _factors_of(moments.mean(axis=0), scale)
    influence = _influence(moments, scale)
    error = np.std(influence, axis=0, ddof=1) / math.sqrt(n)
    on_sd = slice(3 * len(joint), None)  # of the response by that of the inputs, whose rows are skewed most
    if n < FOURTH_ORDER:
        error[on_sd] = math.nan
    low = high = None
    if resamples:
        ends = _bca(moments, lambda m: _factors_of(m, scale), estimate, influence, resamples, confidence, seed)
        half = float(stdtrit(n - 1, 0.5 * (1.0 + confidence))) * error
        lows, highs = np.minimum(ends[0], estimate - half), np.maximum(ends[1], estimate + half)
        for k in range(len(error))[on_sd]:
            if error[k] > 0:
                straight = skewed_interval(influence[:, k] + estimate[k], confidence)
                lows[k], highs[k] = min(lows[k], straight[0]), max(highs[k], straight[1])
        low, high = _split(lows), _split(highs)
    return replace(_split(estimate), standard_error=_split(error), low=low, high=high)


FOURTH_ORDER = 100  # rows that meet moments of fourth order well enough for an interval
_AT_A_TIME = 65_536  # rows


def _influence(moments: Array, scale: Array) -> Array:
    """(n, 4d) of each row on the factors: what they lose when it is left out, times n - 1, less the mean of that."""
    n, total = len(moments), moments.sum(axis=0)
    left = [_factors_of((total - moments[k : k + _AT_A_TIME]) / (n - 1), scale) for k in range(0, n, _AT_A_TIME)]
    influence = np.concatenate(left)
    influence -= influence.mean(axis=0)
    influence *= 1 - n
    return influence


def _factors_of(moments: Array, scale: Array) -> Array:
    """(…, 4d) factors from the (…, 2 + 6d) means of y, y², κ, yκ, y²κ."""
    k = len(scale)
    y1, y2 = moments[..., 0:1], moments[..., 1:2]
    kappa, yk, yyk = (moments[..., 2 + j * k : 2 + (j + 1) * k] for j in range(3))
    variance = np.maximum(y2 - y1**2, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):  # rows alike have no factors: NaN
        on_mean = (yk - y1 * kappa) * scale / np.sqrt(variance)
        on_sd = (yyk - 2.0 * y1 * yk + (2.0 * y1**2 - y2) * kappa) * scale / (2.0 * variance)
    return np.concatenate([on_mean, on_sd], axis=-1)


def _split(values: Array) -> SensitivityFactors:
    mean_mean, mean_sd, sd_mean, sd_sd = np.split(values, 4)
    return SensitivityFactors(mean_mean, mean_sd, sd_mean, sd_sd)


def _bca(
    moments: Array,
    statistic: Callable[[Array], Array],
    estimate: Array,
    influence: Array,
    resamples: int,
    confidence: float,
    seed: int,
) -> tuple[Array, Array]:
    """Ends of the bias-corrected and accelerated bootstrap interval of a statistic of column means."""
    n = len(moments)
    rng = generator(seed, Stream.BOOTSTRAP)
    block = max(1, 4_000_000 // n)
    draws = []
    for first in range(0, resamples, block):
        rows = min(block, resamples - first)
        picked = rng.integers(n, size=(rows, n)) + n * np.arange(rows)[:, np.newaxis]
        counts = np.bincount(picked.ravel(), minlength=rows * n).reshape(rows, n)
        draws.append(statistic(counts @ moments / n))
    replicates = np.sort(np.concatenate(draws), axis=0)
    edge = 1.0 / (resamples + 1)
    bias = ndtri(np.clip(np.mean(replicates < estimate, axis=0), edge, 1.0 - edge))
    squares = np.sum(influence**2, axis=0)
    skew = np.sum(influence**3, axis=0) / (6.0 * np.where(squares > 0, squares, 1.0) ** 1.5)
    ends = []
    for tail in (0.5 * (1.0 - confidence), 0.5 * (1.0 + confidence)):
        z = bias + ndtri(tail)
        level = ndtr(bias + z / (1.0 - skew * z))
        row = np.clip(np.nan_to_num(level) * (resamples + 1) - 1.0, 0, resamples - 1).astype(int)
        end = np.take_along_axis(replicates, row[np.newaxis], axis=0)[0]
        ends.append(np.where(np.isnan(estimate), np.nan, end))
    return ends[0], ends[1]


@dataclass(frozen=True)
class SobolIndices:
    """Shares of the response's variance: `first` (d,) by an input alone, `total` (d,) with all its
    interactions.

    Ends of intervals are NaN where one sequence has fewer than 32 points; small indices may come out slightly negative.
    Fixed inputs have 0. `evaluations` counts the rows asked for.
    """

    first: Array
    first_low: Array
    first_high: Array
    total: Array
    total_low: Array
    total_high: Array
    mean: float
    variance: float
    evaluations: int


def sobol_indices(
    function: Callable[[Array], ArrayLike],
    marginals: Sequence[Marginal],
    n: int = 1024,
    seed: int = 0,
    *,
    replicates: int = 1,
    confidence: float = 0.95,
) -> SobolIndices:
    """First-order (Saltelli 2010) and total (Jansen) indices of independent inputs, by n·(d + 2) evaluations
    in one call.

    n base points in `replicates` scrambled Sobol' sequences (n / replicates should be a power of two). One sequence has
    the least error; its intervals, from resampled points as if they were independent, are too wide rather than too
    narrow; below 32 points, where they are not, it has none. Several have intervals of their own, from the jackknife
    over them. Where an input moves the response at fewer than ten points, as it may move one that counts or switches,
    the upper ends allow for the points that would have. Raises ValueError when any response is missing (not finite): an
    incomplete design says nothing, so it is refused.
    """
    joint = JointDistribution(marginals)
    active = joint.active
    if not len(active):
        raise ValueError("every input is fixed: there is nothing to vary")
    twice = JointDistribution([Normal(0.0, 1.0)] * (2 * len(active)))
    u = sobol(twice, n, seed, replicates)
    a, b = np.zeros((n, len(joint))), np.zeros((n, len(joint)))
    a[:, active], b[:, active] = u[:, : len(active)], u[:, len(active) :]
    designs = [a, b]
    for i in active:
        mixed = a.copy()
        mixed[:, i] = b[:, i]
        designs.append(mixed)
    values = np.asarray(function(joint.from_standard(np.concatenate(designs))), dtype=float)
    if values.shape != (n * len(designs),):
        raise ValueError(f"the function must return shape ({n * len(designs)},), it returned {values.shape}")
    missing = int(np.sum(~np.isfinite(values)))
    if missing:
        raise ValueError(f"{missing} of {len(values)} evaluations failed: Sobol' indices need every one")
    f = values.reshape(len(designs), n)
    centre = float(f[:2].mean())
    if np.ptp(f[:2]) == 0.0:
        raise ValueError("the response does not vary: it has no Sobol' indices")
    f = f - centre
    # Sums by replicate, (replicates,) or (replicates, d): pooled for the value, left out one at a time for
    # the error. Of one sequence the points stand in place of replicates.
    alone = replicates == 1
    by = f.reshape(len(designs), 1, n) if alone else f.reshape(len(designs), n // replicates, replicates)
    s1, s2 = by[:2].mean(axis=(0, 1)), (by[:2] ** 2).mean(axis=(0, 1))
    top_first = (by[1] * (by[2:] - by[0])).mean(axis=1).T
    top_total = 0.5 * ((by[0] - by[2:]) ** 2).mean(axis=1).T
    variance, result = float(s2.mean() - s1.mean() ** 2), dict[str, Array]()
    rarely = _seldom_moved((f[0] - f[2:]) ** 2, float(np.ptp(f)), confidence) / (2.0 * variance)
    for name, top in (("first", top_first), ("total", top_total)):
        value, low, high = (_ratio_over_points if alone else _ratio_over_replicates)(top, s1, s2, confidence, seed)
        high = np.maximum(high, rarely)
        for suffix, part in (("", value), ("_low", low), ("_high", high)):
            column = np.zeros(len(joint))
            column[active] = part
            result[name + suffix] = column
    return SobolIndices(**result, mean=centre, variance=variance, evaluations=len(values))


_RESAMPLES, _RESAMPLED = 400, 4_000_000  # numbers drawn at a time
_TOLD = 32  # points whose resampling says something
_SELDOM = 10  # points that an input must move


def _seldom_moved(squares: Array, most: float, confidence: float) -> Array:
    """(d,) upper end of the mean of squared changes (d, n) where few of them are not zero, by the interval of their
    number; of none each could be as large as `most`, the range of the response. -inf where there are enough."""
    n, moved = squares.shape[1], np.sum(squares > 0.0, axis=1)
    size = np.where(moved > 0, squares.sum(axis=1) / np.maximum(moved, 1), most**2)
    return np.where(moved < min(_SELDOM, n), size * clopper_pearson(moved, n, confidence)[1], -np.inf)


def _ratio_over_points(top: Array, s1: Array, s2: Array, confidence: float, seed: int) -> tuple[Array, Array, Array]:
    """Pooled numerator over pooled variance with the ends of its bootstrap interval, by normal approximation."""
    n, rng = len(s1), generator(seed, Stream.BOOTSTRAP, 1)
    value = top.mean(axis=0) / (s2.mean() - s1.mean() ** 2)
    if n < _TOLD:
        return value, np.full_like(value, np.nan), np.full_like(value, np.nan)
    columns, found = np.column_stack([top, s1, s2]), list[Array]()
    block = max(1, _RESAMPLED // n)
    for k in range(0, _RESAMPLES, block):
        counts = rng.multinomial(n, np.full(n, 1.0 / n), size=min(block, _RESAMPLES - k))
        means = counts @ columns / n
        spread = means[:, -1] - means[:, -2] ** 2
        varied = spread > 0.0  # a draw of points alike says nothing
        found.append(means[varied, :-2] / spread[varied, np.newaxis])
    half = float(ndtri(0.5 * (1.0 + confidence))) * np.std(np.concatenate(found), axis=0, ddof=1)
    return value, value - half, value + half


def _ratio_over_replicates(top: Array, s1: Array, s2: Array, confidence: float, _: int) -> tuple[Array, Array, Array]:
    """The same with the ends of its jackknife interval over replicates."""
    r = len(s1)
    value = top.mean(axis=0) / (s2.mean() - s1.mean() ** 2)
    left = np.empty_like(top)
    for k in range(r):
        keep = np.arange(r) != k
        left[k] = top[keep].mean(axis=0) / (s2[keep].mean() - s1[keep].mean() ** 2)
    error = np.sqrt((r - 1) / r * np.sum((left - left.mean(axis=0)) ** 2, axis=0))
    half = float(stdtrit(r - 1, 0.5 * (1.0 + confidence))) * error
    return value, value - half, value + half


@dataclass(frozen=True)
class GivenDataIndices:
    """Sobol' indices and Shapley shares read off a polynomial chaos fitted to a sample at hand: no further evaluation.

    first, total, shapley  (d,) shares of the expansion's variance, with the ends of their intervals: how far the rows
                           leave its coefficients open. Shapley shares add up to 1
    degree, terms          of the expansion kept
    q2                     share of the sample's variance that it predicts at rows left out (leave-one-out), which is
                           the quality of these indices: what it does not predict (1 − q2) may belong to any of them
    """

    first: Array
    first_low: Array
    first_high: Array
    total: Array
    total_low: Array
    total_high: Array
    shapley: Array
    shapley_low: Array
    shapley_high: Array
    degree: int
    terms: int
    q2: float

    @classmethod
    def of(
        cls,
        shares: Mapping[str, Array],
        joint: JointDistribution,
        expansion: tuple[int, int, float],
        confidence: float,
    ) -> Self:
        """`shares` {first, total, shapley: (1 + b, inputs that vary)}: the estimate, then b draws of it; `expansion`
        its degree, terms and q2. The intervals are those of a normal law of the draws' spread, kept within 0 and 1."""
        quantile, ends = float(ndtri(0.5 * (1.0 + confidence))), dict[str, Array]()
        for name, values in shares.items():
            half = quantile * np.std(values[1:], axis=0, ddof=1)
            for suffix, end in (("", values[0]), ("_low", values[0] - half), ("_high", values[0] + half)):
                ends[name + suffix] = np.zeros(len(joint))
                ends[name + suffix][joint.active] = np.clip(end, 0.0, 1.0)
        return cls(**ends, degree=expansion[0], terms=expansion[1], q2=expansion[2])


_REDRAWN = 200  # draws of the coefficients, for the intervals
_TERMS_PER_ROW = 0.4  # an expansion with more terms than this share of the rows overfits


def given_data_indices(
    x: ArrayLike,
    y: ArrayLike,
    marginals: Sequence[Marginal],
    max_degree: int = 4,
    *,
    confidence: float = 0.95,
    seed: int = 0,
) -> GivenDataIndices:
    """First-order and total Sobol' indices and Shapley shares of independent inputs from the rows of any sample of
    them; of dependent ones `dependent_shares`.

    Polynomial chaos (Legendre for uniform inputs, Hermite in the standard space for the others) of the total
    degree ≤ max_degree that predicts left-out rows best.
    """
    xs, ys = _paired(x, y)
    joint = JointDistribution(marginals)
    active = joint.active
    table = _orthonormal(xs, [joint.marginals[i] for i in active], active, max_degree)
    n, variance = len(ys), float(np.var(ys))
    if variance == 0.0:
        raise ValueError("the response does not vary: it has no Sobol' indices")
    best: tuple[float, int, list[tuple[int, ...]], Array, Array, Array] | None = None
    for degree in range(1, max_degree + 1):
        powers = _multi_indices(len(active), degree)
        if len(powers) > _TERMS_PER_ROW * n:
            break
        basis = _products(table, powers)
        q, r = orthonormal(basis)
        coefficients = np.asarray(np.linalg.solve(r, q.T @ ys), dtype=float)
        leverage = np.sum(q**2, axis=1)
        loo = (ys - basis @ coefficients) / np.maximum(1.0 - leverage, 1e-9)
        q2 = 1.0 - float(np.mean(loo**2)) / variance
        if best is None or q2 > best[0]:
            best = q2, degree, powers, coefficients, basis, loo
    if best is None:
        raise ValueError(f"{n} rows are too few for an expansion in {len(active)} inputs")
    q2, degree, powers, coefficients, basis, loo = best
    squares = redrawn(basis, coefficients, loo, _REDRAWN, generator(seed, Stream.BOOTSTRAP, 2))[:, 1:] ** 2
    shares = squares / squares.sum(axis=1, keepdims=True)
    involved = np.array(powers)[1:] > 0
    together = involved.sum(axis=1, keepdims=True)
    found = {"first": shares @ (involved & (together == 1)), "total": shares @ involved}
    return GivenDataIndices.of(
        found | {"shapley": shares @ (involved / together)}, joint, (degree, len(powers), q2), confidence
    )


def _multi_indices(d: int, degree: int) -> list[tuple[int, ...]]:
    """Exponents of all monomials in d variables up to a total degree."""
    rows = []
    for total in range(degree + 1):
        for chosen in combinations_with_replacement(range(d), total):
            rows.append(tuple(chosen.count(k) for k in range(d)))
    return rows


def _orthonormal(xs: Array, marginals: Sequence[Marginal], columns: NDArray[np.intp], degree: int) -> Array:
    """(degree + 1, n, d) polynomials of each input, orthonormal under its distribution."""
    table = np.ones((degree + 1, len(xs), len(columns)))
    for k, (marginal, column) in enumerate(zip(marginals, columns, strict=True)):
        if isinstance(marginal, Uniform):
            t = (xs[:, column] - marginal.mean) / (0.5 * (marginal.high - marginal.low))
            for order in range(degree + 1):
                table[order, :, k] = math.sqrt(2 * order + 1) * eval_legendre(order, t)
        else:
            u = marginal.to_standard(xs[:, column])
            for order in range(degree + 1):
                table[order, :, k] = eval_hermitenorm(order, u) / math.sqrt(math.factorial(order))
    return table


def _products(table: Array, powers: list[tuple[int, ...]]) -> Array:
    """(n, terms) products of the inputs' polynomials."""
    basis = np.ones((table.shape[1], len(powers)))
    for term, row in enumerate(powers):
        for variable, power in enumerate(row):
            if power:
                basis[:, term] *= table[power, :, variable]
    return basis


@dataclass(frozen=True)
class PhysicalImportance:
    """Importance of dependent inputs in physical space, from a sample; all (d,), 0 for fixed inputs.

    alone           unit vector of the response's slopes along each input's own z (its standard score through its own
                    marginal), all other inputs held: what an input does by itself
    alone_error     its standard error, at most 1
    with_companions correlation of each z with the linear response: what goes along when an input is seen to be large,
                    its correlated companions included; not a unit vector
    r2              share of the variance that a linear response explains, adjusted for the slopes fitted
    """

    alone: Array
    alone_error: Array
    with_companions: Array
    r2: float


def importance_x(
    x: ArrayLike, y: ArrayLike, marginals: Sequence[Marginal], correlation: ArrayLike | None = None
) -> PhysicalImportance:
    """Importance of inputs that depend on each other, the same whatever the order in which they are listed.

    `importance` refers to independent variables u = L⁻¹z, in which the first of two correlated inputs takes what they
    share; here the least-squares slopes are along z itself. For independent inputs `alone` is `importance`. Definition:
    the importance vector γ of A. Der Kiureghian (Engineering Design Reliability Handbook, CRC Press 2005, ch. 14), with
    the slopes of the sample in place of those at a design point. Raises ValueError for a choice among the inputs.
    """
    xs, ys = _paired(x, y)
    joint = JointDistribution(marginals, correlation)
    joint.require_slopes()
    active = joint.active
    if len(ys) <= len(active) + 1:
        raise ValueError(f"{len(ys)} rows cannot determine the slopes of {len(active)} inputs")
    alone, error, companions = np.zeros(len(joint)), np.zeros(len(joint)), np.zeros(len(joint))
    design = np.column_stack([np.ones(len(ys)), joint.to_normal(xs)[:, active]])
    slopes, alone[active], error[active], r2 = _direction(design, ys)
    if np.any(slopes):
        normal = joint.normal_correlation[np.ix_(active, active)]
        companions[active] = normal @ slopes / math.sqrt(float(slopes @ normal @ slopes))
    return PhysicalImportance(alone, error, companions, r2)
