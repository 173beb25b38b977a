"""Weibull and exponential."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import digamma, gammaln, log_ndtr, ndtri_exp

from .marginal import Array, Marginal, as_array, density, require_finite

__all__ = ["Exponential", "Weibull"]

_LN2 = math.log(2.0)
_SHAPES = (0.05, 1e4)  # beyond these the variation coefficient is above 1e7 or below 2e-4


def _log_exceedance(u: ArrayLike) -> Array:
    """t = −ln(1 − Φ(u)), exact in both tails."""
    return as_array(-log_ndtr(-as_array(u)))


def _normal_of_log_exceedance(t: Array) -> Array:
    """u with 1 − Φ(u) = exp(−t), from whichever side has the digits."""
    with np.errstate(divide="ignore"):
        lower = ndtri_exp(np.log(-np.expm1(-np.minimum(t, _LN2))))
    return as_array(np.where(t < _LN2, lower, -ndtri_exp(-t)))


@dataclass(frozen=True)
class Weibull(Marginal):
    """P(X > x) = exp(−(x/scale)^shape) for x > 0, given by the mean and standard deviation of x itself.

    `Weibull.of_shape(shape, scale)` takes the parameters of the formula.
    """

    mean: float
    sd: float

    def __post_init__(self) -> None:
        require_finite(self, mean=self.mean, sd=self.sd)
        if self.mean <= 0 or self.sd <= 0:
            raise ValueError(f"Weibull: mean and sd must be positive, got mean {self.mean}, sd {self.sd}")
        spread = math.log(self.sd / self.mean)
        if not _log_variation(_SHAPES[1]) < spread < _log_variation(_SHAPES[0]):
            raise ValueError(f"Weibull: sd {self.sd} is out of range for mean {self.mean}; use Fixed for a constant")

    @classmethod
    def of_shape(cls, shape: float, scale: float) -> Self:
        if not (math.isfinite(shape) and math.isfinite(scale) and shape > 0 and scale > 0):
            raise ValueError(f"Weibull: shape and scale must be positive, got {shape} and {scale}")
        mean = scale * math.exp(gammaln(1.0 + 1.0 / shape))
        return cls(mean, mean * math.exp(_log_variation(shape)))

    @cached_property
    def shape(self) -> float:
        from scipy.optimize import brentq  # slow to import

        spread = math.log(self.sd / self.mean)
        ends = [math.log(end) for end in _SHAPES]
        return math.exp(brentq(lambda k: _log_variation(math.exp(k)) - spread, *ends, xtol=1e-15, rtol=1e-15))

    @cached_property
    def scale(self) -> float:
        return self.mean * math.exp(-gammaln(1.0 + 1.0 / self.shape))

    @property
    def support(self) -> tuple[float, float]:
        return 0.0, math.inf

    def from_standard(self, u: ArrayLike) -> Array:
        return as_array(self.scale * _log_exceedance(u) ** (1.0 / self.shape))

    def to_standard(self, x: ArrayLike) -> Array:
        return _normal_of_log_exceedance((np.maximum(as_array(x), 0.0) / self.scale) ** self.shape)

    def slope(self, u: ArrayLike) -> Array:
        t = _log_exceedance(u)
        with np.errstate(divide="ignore", invalid="ignore"):
            by_t = self.scale / self.shape * t ** (1.0 / self.shape - 1.0)
            return np.nan_to_num(by_t * density(u) * np.exp(t), posinf=0.0)

    @cached_property
    def _parameter_slopes(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """(∂scale/∂mean, ∂scale/∂sd) and (∂shape/∂mean, ∂shape/∂sd)."""
        k, delta = self.shape, self.sd / self.mean
        by_shape = (digamma(1.0 + 1.0 / k) - digamma(1.0 + 2.0 / k)) * (1.0 + delta**2) / (k**2 * delta)
        shape_mean, shape_sd = -delta / (self.mean * by_shape), 1.0 / (self.mean * by_shape)
        along = self.scale * digamma(1.0 + 1.0 / k) / k**2  # ∂scale/∂shape at a held mean
        return (self.scale / self.mean + along * shape_mean, along * shape_sd), (shape_mean, shape_sd)

    def _logs(self, x: ArrayLike) -> tuple[Array, Array]:
        """ln(x/scale) and (x/scale)^shape."""
        with np.errstate(divide="ignore"):
            log = np.log(np.maximum(as_array(x), 0.0) / self.scale)
        return log, np.exp(self.shape * log)

    def score(self, x: ArrayLike) -> tuple[Array, Array]:
        log, t = self._logs(x)
        by_scale = self.shape / self.scale * (t - 1.0)
        with np.errstate(invalid="ignore"):
            by_shape = 1.0 / self.shape + log * (1.0 - t)
        return self._along(by_scale, by_shape)

    def standard_shift(self, x: ArrayLike) -> tuple[Array, Array]:
        log, t = self._logs(x)
        ratio = np.exp(-t) / density(_normal_of_log_exceedance(t))
        return self._along(-ratio * self.shape * t / self.scale, ratio * t * log)

    def _along(self, by_scale: Array, by_shape: Array) -> tuple[Array, Array]:
        (scale_mean, scale_sd), (shape_mean, shape_sd) = self._parameter_slopes
        return by_scale * scale_mean + by_shape * shape_mean, by_scale * scale_sd + by_shape * shape_sd


def _log_variation(shape: float) -> float:
    """ln(sd/mean) of a Weibull variable."""
    excess = gammaln(1.0 + 2.0 / shape) - 2.0 * gammaln(1.0 + 1.0 / shape)
    return 0.5 * math.log(math.expm1(excess))


@dataclass(frozen=True)
class Exponential(Marginal):
    """P(X > x) = exp(−x/mean) for x > 0; its standard deviation is its mean.

    It has no `score`: mean and standard deviation cannot move apart.
    """

    mean: float

    def __post_init__(self) -> None:
        require_finite(self, mean=self.mean)
        if self.mean <= 0:
            raise ValueError(f"Exponential: mean must be positive, got {self.mean}")

    @property
    def sd(self) -> float:
        return self.mean

    @property
    def support(self) -> tuple[float, float]:
        return 0.0, math.inf

    def from_standard(self, u: ArrayLike) -> Array:
        return self.mean * _log_exceedance(u)

    def to_standard(self, x: ArrayLike) -> Array:
        return _normal_of_log_exceedance(np.maximum(as_array(x), 0.0) / self.mean)

    def slope(self, u: ArrayLike) -> Array:
        return as_array(self.mean * density(u) * np.exp(_log_exceedance(u)))
