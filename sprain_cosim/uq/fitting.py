"""Distributions fitted to measured samples: normal, lognormal, Weibull, chosen by AICc, doubted by Anderson-Darling.

Each family is one of location and scale after its own map (x itself; ln x; ln x, whose law is that of smallest
extremes), so that the law of the Anderson-Darling statistic under a fitted member depends on family and n alone; its
p-value comes from 2000 simulated samples of that size, refitted like the data.

Sources: N. Sugiura, Commun. Stat. A 7 (1978) 13-26 (AICc); T. W. Anderson, D. A. Darling, J. Am. Stat. Assoc. 49 (1954)
765-769; M. A. Stephens, in R. B. D'Agostino, M. A. Stephens, Goodness-of-fit techniques (1986), chapter 4.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import log_ndtr

from .distributions import Array, LogNormal, Marginal, Normal, Weibull
from .distributions.marginal import as_array
from .sampling import Stream, generator

__all__ = [
    "FAMILIES",
    "MIN_SPECIMENS",
    "FamilyFit",
    "SampleFit",
    "extreme_estimates",
    "fit_family",
    "fit_sample",
    "require_specimens",
]

Family = Literal["normal", "lognormal", "weibull"]
FAMILIES: tuple[Family, ...] = ("normal", "lognormal", "weibull")
SMALLEST = 1e-100  # of a value; the largest is its inverse
MIN_SPECIMENS = 3

_SIMULATED = 2000
_CLOSE = 2.0  # families within this many units of AICc cannot be told apart (Burnham and Anderson's rule)


@dataclass(frozen=True)
class FamilyFit:
    """One family fitted to a sample.

    marginal          the fitted member. Normal and lognormal: mean and n − 1 standard deviation, of x or of ln x;
                      Weibull: maximum likelihood
    aicc              Akaike's criterion with the correction for small samples, at maximum likelihood (in nats × 2);
                      +inf for fewer than four values, where the correction does not exist
    anderson_darling  the statistic A² of the fitted member
    p_value           share of simulated samples of the fitted family that lie as far from their own fit, or farther
    """

    family: Family
    marginal: Marginal
    aicc: float
    anderson_darling: float
    p_value: float


@dataclass(frozen=True)
class SampleFit:
    """A sample's fit: the family of least AICc, and the others beside it.

    n         number of values
    best      the family taken
    families  all that could be fitted, by name
    warnings  what speaks against the fit, as sentences; empty where nothing does
    """

    n: int
    best: FamilyFit
    families: Mapping[Family, FamilyFit]
    warnings: tuple[str, ...]

    @property
    def marginal(self) -> Marginal:
        return self.best.marginal

    @property
    def alternatives(self) -> tuple[Family, ...]:
        """Families that the sample cannot tell from the best one (AICc within 2)."""
        return tuple(
            name
            for name, fit in self.families.items()
            if name != self.best.family and fit.aicc - self.best.aicc < _CLOSE
        )


def require_specimens(sample: ArrayLike) -> Array:
    """(n,) the values, checked. Raises ValueError: empty, fewer than three, not finite, all alike."""
    values = np.asarray(sample, dtype=float)
    if values.ndim != 1 or not len(values):
        raise ValueError("the sample is empty")
    if len(values) < MIN_SPECIMENS:
        raise ValueError(f"{len(values)} values are too few to fit a distribution; at least {MIN_SPECIMENS} are needed")
    if not np.all(np.isfinite(values)):
        raise ValueError("the sample holds values that are not finite")
    sizes = np.abs(values[values != 0.0])
    if len(sizes) and not (sizes.min() > SMALLEST and sizes.max() < 1.0 / SMALLEST):
        raise ValueError(f"the sample holds values of {sizes.min():g} to {sizes.max():g}: what is their unit?")
    if np.ptp(values) == 0.0:
        raise ValueError(f"all {len(values)} values of the sample are {values[0]:g}: nothing varies; use a fixed value")
    return values


def fit_sample(sample: ArrayLike, families: tuple[Family, ...] = FAMILIES) -> SampleFit:
    """Fit the families and take the one of least AICc.

    Lognormal and Weibull need positive values and are left out where there are others. With three values AICc does not
    exist: the first of `families` that can be fitted is taken, with a warning.

    Raises ValueError: a sample that is empty, too small, constant or not finite; no family that could be fitted.
    """
    values = require_specimens(sample)
    fits = {name: fit_family(values, name) for name in families if name == "normal" or values.min() > 0}
    if not fits:
        raise ValueError(f"{' and '.join(families)} need positive values; the smallest is {values.min():g}")
    best = min(fits.values(), key=lambda fit: fit.aicc)
    found = SampleFit(len(values), best, fits, ())
    warnings = []
    if not math.isfinite(best.aicc):
        warnings.append(f"{len(values)} values cannot choose between {' and '.join(fits)}; {best.family} is taken")
    elif found.alternatives:
        warnings.append(
            f"{len(values)} values cannot tell {best.family} from {' or '.join(found.alternatives)} "
            "(AICc within 2); probabilities in the tails depend on that choice"
        )
    if best.p_value < 0.05:
        warnings.append(
            f"{best.family} fits badly: Anderson-Darling A² = {best.anderson_darling:.3g}, p = {best.p_value:.2g}"
        )
    return SampleFit(len(values), best, fits, tuple(warnings))


def fit_family(sample: ArrayLike, family: Family) -> FamilyFit:
    """One family fitted to a sample. Raises ValueError as `fit_sample`, and for values that are not positive."""
    values = require_specimens(sample)
    if family != "normal" and values.min() <= 0:
        raise ValueError(f"{family} needs positive values; the smallest is {values.min():g}")
    n = len(values)
    mapped = values if family == "normal" else np.log(values)
    jacobian = 0.0 if family == "normal" else -float(mapped.sum())
    if family == "weibull":
        location, scale = (float(v[0]) for v in extreme_estimates(mapped[np.newaxis]))
        standard = (mapped - location) / scale
        likelihood = float(np.sum(standard - np.exp(standard))) - n * math.log(scale)
        marginal: Marginal = Weibull.of_shape(1.0 / scale, math.exp(location))
    else:
        location, scale = float(mapped.mean()), float(mapped.std(ddof=1))
        variance = float(mapped.var())
        likelihood = -0.5 * n * (math.log(2.0 * math.pi * variance) + 1.0)
        marginal = Normal(location, scale) if family == "normal" else _lognormal(location, scale)
        standard = (mapped - location) / scale
    aicc = 4.0 - 2.0 * (likelihood + jacobian) + 12.0 / (n - 3) if n > 3 else math.inf
    statistic = float(_anderson_darling(np.sort(standard)[np.newaxis], family == "weibull")[0])
    simulated = _simulated_statistics(n, family == "weibull")
    p_value = (1.0 + float(np.sum(simulated >= statistic))) / (len(simulated) + 1.0)
    return FamilyFit(family, marginal, aicc, statistic, p_value)


def _lognormal(location: float, scale: float) -> LogNormal:
    """The lognormal whose logarithm has this mean and standard deviation."""
    mean = math.exp(location + 0.5 * scale**2)
    return LogNormal(mean, mean * math.sqrt(math.expm1(scale**2)))


def extreme_estimates(samples: ArrayLike) -> tuple[Array, Array]:
    """Maximum-likelihood location and scale (b,) of the law of smallest extremes, for b samples (b, n) at once.

    If x is Weibull, ln x follows that law with location ln(scale) and scale 1/shape. Newton's method on the profile
    equation Σ y·e^(y/s)/Σ e^(y/s) − s − mean(y) = 0, which falls in s and has one root.
    """
    y = as_array(samples)
    centred = y - y.max(axis=1, keepdims=True)
    mean = centred.mean(axis=1)
    scale = np.maximum(centred.std(axis=1) * math.sqrt(6.0) / math.pi, 1e-300)
    for _ in range(100):
        weights = np.exp(centred / scale[:, np.newaxis])
        total = weights.sum(axis=1)
        first = (weights * centred).sum(axis=1) / total
        second = (weights * centred**2).sum(axis=1) / total
        value = first - scale - mean
        slope = -(second - first**2) / scale**2 - 1.0
        moved = np.maximum(scale - value / slope, 0.2 * scale)
        settled = np.max(np.abs(moved - scale) / scale) < 1e-13
        scale = moved
        if settled:
            break
    weights = np.exp(centred / scale[:, np.newaxis])
    return as_array(y.max(axis=1) + scale * np.log(weights.mean(axis=1))), as_array(scale)


def _anderson_darling(standard: Array, extreme: bool) -> Array:
    """A² (b,) of ordered standardised samples (b, n) against the standard normal or smallest-extreme law."""
    n = standard.shape[1]
    if extreme:
        above = -np.exp(standard)
        below = np.log(-np.expm1(np.maximum(above, -700.0)))
    else:
        below, above = log_ndtr(standard), log_ndtr(-standard)
    odd = 2.0 * np.arange(1, n + 1) - 1.0
    return as_array(-n - np.mean(odd * (below + above[:, ::-1]), axis=1))


@lru_cache(maxsize=32)
def _simulated_statistics(n: int, extreme: bool) -> Array:
    rng = generator(n, Stream.FIT, int(extreme))
    count = max(200, min(_SIMULATED, 20_000_000 // n))
    if extreme:
        samples = np.log(rng.standard_exponential((count, n)))
        location, scale = extreme_estimates(samples)
    else:
        samples = rng.standard_normal((count, n))
        location, scale = samples.mean(axis=1), samples.std(axis=1, ddof=1)
    return _anderson_darling((np.sort(samples, axis=1) - location[:, np.newaxis]) / scale[:, np.newaxis], extreme)
