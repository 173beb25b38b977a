"""Distributions between two ends: uniform, triangular, beta."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import betainc, betaincc, betainccinv, betaincinv, betaln, digamma, ndtr, ndtri

from .marginal import Array, Marginal, as_array, density, require_finite

__all__ = ["Beta", "Triangular", "Uniform"]

_SQRT3 = math.sqrt(3.0)


def _ordered(owner: object, low: float, high: float) -> None:
    if low >= high:
        raise ValueError(f"{type(owner).__name__}: low must be below high, got {low} and {high}")


def _normal_of(below: Array, above: Array) -> Array:
    """u of the probabilities on either side, from the smaller one."""
    return as_array(np.where(below < above, ndtri(np.clip(below, 0, 1)), -ndtri(np.clip(above, 0, 1))))


@dataclass(frozen=True)
class Uniform(Marginal):
    """x between low and high, every value equally likely."""

    low: float
    high: float

    def __post_init__(self) -> None:
        require_finite(self, low=self.low, high=self.high)
        _ordered(self, self.low, self.high)

    @property
    def mean(self) -> float:
        return 0.5 * (self.low + self.high)

    @property
    def sd(self) -> float:
        return (self.high - self.low) / (2.0 * _SQRT3)

    @property
    def support(self) -> tuple[float, float]:
        return self.low, self.high

    def from_standard(self, u: ArrayLike) -> Array:
        u = np.asarray(u, dtype=float)
        width = self.high - self.low
        return as_array(np.where(u < 0, self.low + width * ndtr(u), self.high - width * ndtr(-u)))

    def to_standard(self, x: ArrayLike) -> Array:
        x = np.asarray(x, dtype=float)
        width = self.high - self.low
        from_low, from_high = np.clip((x - self.low) / width, 0, 1), np.clip((self.high - x) / width, 0, 1)
        return as_array(np.where(from_low < 0.5, ndtri(from_low), -ndtri(from_high)))

    def slope(self, u: ArrayLike) -> Array:
        return as_array((self.high - self.low) * density(u))

    def cdf(self, x: ArrayLike) -> Array:
        return np.clip((as_array(x) - self.low) / (self.high - self.low), 0.0, 1.0)


@dataclass(frozen=True)
class Triangular(Marginal):
    """x between low and high with a density that rises to `mode` and falls from there in straight lines."""

    low: float
    mode: float
    high: float

    def __post_init__(self) -> None:
        require_finite(self, low=self.low, mode=self.mode, high=self.high)
        _ordered(self, self.low, self.high)
        if not self.low <= self.mode <= self.high:
            raise ValueError(f"Triangular: mode must lie between low and high, got {self.mode}")

    @property
    def mean(self) -> float:
        return (self.low + self.mode + self.high) / 3.0

    @property
    def sd(self) -> float:
        a, b, c = self.low, self.high, self.mode
        return math.sqrt(((b - a) ** 2 + (b - c) ** 2 + (c - a) ** 2) / 36.0)

    @property
    def support(self) -> tuple[float, float]:
        return self.low, self.high

    @property
    def has_kinks(self) -> bool:
        return True

    @property
    def _share(self) -> float:
        """P(x < mode)."""
        return (self.mode - self.low) / (self.high - self.low)

    def from_standard(self, u: ArrayLike) -> Array:
        below, above = ndtr(as_array(u)), ndtr(-as_array(u))
        width = self.high - self.low
        rising = self.low + np.sqrt(below * width * (self.mode - self.low))
        falling = self.high - np.sqrt(above * width * (self.high - self.mode))
        return as_array(np.where(below < self._share, rising, falling))

    def to_standard(self, x: ArrayLike) -> Array:
        width = self.high - self.low
        from_low = np.clip((as_array(x) - self.low) / width, 0.0, 1.0)
        from_high = np.clip((self.high - as_array(x)) / width, 0.0, 1.0)
        share = self._share
        below = from_low**2 / share if share > 0 else np.zeros_like(from_low)
        above = from_high**2 / (1.0 - share) if share < 1 else np.zeros_like(from_high)
        rising = from_low < share
        return _normal_of(np.where(rising, below, 1.0 - above), np.where(rising, 1.0 - below, above))

    def slope(self, u: ArrayLike) -> Array:
        below, above = ndtr(as_array(u)), ndtr(-as_array(u))
        width, share = self.high - self.low, self._share
        with np.errstate(divide="ignore", invalid="ignore"):
            rising = 0.5 * density(u) * width * np.sqrt(share / below)
            falling = 0.5 * density(u) * width * np.sqrt((1.0 - share) / above)
        return as_array(np.nan_to_num(np.where(below < share, rising, falling)))


@dataclass(frozen=True)
class Beta(Marginal):
    """x = low + (high − low)·y with the density of y proportional to y^(alpha − 1)·(1 − y)^(beta − 1).

    `Beta.of_moments(mean, sd, low, high)` finds alpha and beta. `score` and `standard_shift` are with respect to mean
    and sd at held ends.
    """

    alpha: float
    beta: float
    low: float = 0.0
    high: float = 1.0

    def __post_init__(self) -> None:
        require_finite(self, alpha=self.alpha, beta=self.beta, low=self.low, high=self.high)
        _ordered(self, self.low, self.high)
        if self.alpha <= 0 or self.beta <= 0:
            raise ValueError(f"Beta: alpha and beta must be positive, got {self.alpha} and {self.beta}")

    @classmethod
    def of_moments(cls, mean: float, sd: float, low: float = 0.0, high: float = 1.0) -> Self:
        """The beta distribution of this mean and standard deviation between these ends.

        Raises ValueError: no beta distribution has them (sd² must be below (mean − low)(high − mean)).
        """
        if not (math.isfinite(low) and math.isfinite(high) and low < mean < high):
            raise ValueError(f"Beta: the mean must lie between low and high, got {mean}, {low} and {high}")
        m, v = (mean - low) / (high - low), (sd / (high - low)) ** 2
        if not (sd > 0 and v < m * (1.0 - m)):
            most = math.sqrt(m * (1.0 - m)) * (high - low)
            raise ValueError(f"Beta: sd must lie between 0 and {most:.6g} for this mean and these ends, got {sd}")
        size = m * (1.0 - m) / v - 1.0
        return cls(m * size, (1.0 - m) * size, low, high)

    @property
    def _width(self) -> float:
        return self.high - self.low

    @property
    def mean(self) -> float:
        return self.low + self._width * self.alpha / (self.alpha + self.beta)

    @property
    def sd(self) -> float:
        size = self.alpha + self.beta
        return self._width * math.sqrt(self.alpha * self.beta / (size + 1.0)) / size

    @property
    def support(self) -> tuple[float, float]:
        return self.low, self.high

    def from_standard(self, u: ArrayLike) -> Array:
        u = as_array(u)
        lower = betaincinv(self.alpha, self.beta, ndtr(u))
        upper = betainccinv(self.alpha, self.beta, ndtr(-u))
        return as_array(self.low + self._width * np.where(u < 0, lower, upper))

    def _inside(self, x: ArrayLike) -> Array:
        return np.clip((as_array(x) - self.low) / self._width, 0.0, 1.0)

    def to_standard(self, x: ArrayLike) -> Array:
        y = self._inside(x)
        return _normal_of(betainc(self.alpha, self.beta, y), betaincc(self.alpha, self.beta, y))

    def slope(self, u: ArrayLike) -> Array:
        y = self._inside(self.from_standard(u))
        with np.errstate(divide="ignore", invalid="ignore"):
            log_density = (self.alpha - 1.0) * np.log(y) + (self.beta - 1.0) * np.log1p(-y)
            log_density -= betaln(self.alpha, self.beta)
            return np.nan_to_num(self._width * density(u) * np.exp(-log_density), posinf=0.0)

    @cached_property
    def _parameter_slopes(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """(∂alpha/∂mean, ∂alpha/∂sd) and (∂beta/∂mean, ∂beta/∂sd) at held ends."""
        m, s = (self.mean - self.low) / self._width, self.sd / self._width
        size = self.alpha + self.beta
        by_mean, by_sd = (1.0 - 2.0 * m) / s**2, -2.0 * m * (1.0 - m) / s**3
        return (
            ((size + m * by_mean) / self._width, m * by_sd / self._width),
            ((-size + (1.0 - m) * by_mean) / self._width, (1.0 - m) * by_sd / self._width),
        )

    def score(self, x: ArrayLike) -> tuple[Array, Array]:
        y = self._inside(x)
        with np.errstate(divide="ignore"):
            by_alpha = np.log(y) - digamma(self.alpha) + digamma(self.alpha + self.beta)
            by_beta = np.log1p(-y) - digamma(self.beta) + digamma(self.alpha + self.beta)
        (alpha_mean, alpha_sd), (beta_mean, beta_sd) = self._parameter_slopes
        return by_alpha * alpha_mean + by_beta * beta_mean, by_alpha * alpha_sd + by_beta * beta_sd

    def standard_shift(self, x: ArrayLike) -> tuple[Array, Array]:
        y = self._inside(x)
        (alpha_mean, alpha_sd), (beta_mean, beta_sd) = self._parameter_slopes
        by_alpha, by_beta = self._shift(y, 1.0, 0.0), self._shift(y, 0.0, 1.0)
        return by_alpha * alpha_mean + by_beta * beta_mean, by_alpha * alpha_sd + by_beta * beta_sd

    def _shift(self, y: Array, on_alpha: float, on_beta: float) -> Array:
        """∂u/∂alpha or ∂u/∂beta at y; the incomplete beta function has no closed derivative: central differences."""
        step = 1e-5 * (on_alpha * self.alpha + on_beta * self.beta)
        up = self.alpha + on_alpha * step, self.beta + on_beta * step
        down = self.alpha - on_alpha * step, self.beta - on_beta * step
        lower = betainc(*up, y) - betainc(*down, y)
        upper = betaincc(*down, y) - betaincc(*up, y)
        rising = betainc(self.alpha, self.beta, y) < 0.5
        u = self.to_standard(self.low + self._width * y)
        return as_array(np.where(rising, lower, upper) / (2.0 * step * density(u)))
