"""Normal and lognormal."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from .marginal import Array, Marginal, as_array, density, mass_between, require_finite, times_density

__all__ = ["LogNormal", "Normal"]


@dataclass(frozen=True)
class Normal(Marginal):
    """x = mean + sd·u."""

    mean: float
    sd: float

    def __post_init__(self) -> None:
        require_finite(self, mean=self.mean, sd=self.sd)
        if self.sd <= 0:
            raise ValueError(f"Normal: sd must be positive, got {self.sd}; use Fixed for a constant")

    @property
    def support(self) -> tuple[float, float]:
        return -math.inf, math.inf

    def from_standard(self, u: ArrayLike) -> Array:
        return self.mean + self.sd * np.asarray(u, dtype=float)

    def to_standard(self, x: ArrayLike) -> Array:
        return (np.asarray(x, dtype=float) - self.mean) / self.sd

    def slope(self, u: ArrayLike) -> Array:
        return np.full(np.shape(u), self.sd)

    def score(self, x: ArrayLike) -> tuple[Array, Array]:
        u = self.to_standard(x)
        return u / self.sd, (u * u - 1.0) / self.sd

    def standard_shift(self, x: ArrayLike) -> tuple[Array, Array]:
        u = self.to_standard(x)
        return np.full(u.shape, -1.0 / self.sd), -u / self.sd

    def truncated_moments(self, a: float, b: float) -> tuple[float, float]:
        """Mean and standard deviation of x given a ≤ u ≤ b."""
        mass = mass_between(a, b)
        first = (density(a) - density(b)) / mass
        second = 1.0 + (times_density(a) - times_density(b)) / mass
        return float(self.mean + self.sd * first), self.sd * math.sqrt(max(float(second - first * first), 0.0))


@dataclass(frozen=True)
class LogNormal(Marginal):
    """x = exp(λ + ζ·u), given by the mean and standard deviation of x itself.

    With δ = sd/mean: ζ² = ln(1 + δ²), λ = ln(mean) − ζ²/2. The mean lies at u = ζ/2, the median exp(λ) at u =
    0.
    """

    mean: float
    sd: float

    def __post_init__(self) -> None:
        require_finite(self, mean=self.mean, sd=self.sd)
        if self.mean <= 0 or self.sd <= 0:
            raise ValueError(
                f"LogNormal: mean and sd must be positive, got mean {self.mean}, sd {self.sd}; use Fixed for a "
                "constant, zero included"
            )

    @cached_property
    def zeta(self) -> float:
        """Standard deviation of ln x."""
        return math.sqrt(math.log1p((self.sd / self.mean) ** 2))

    @cached_property
    def lam(self) -> float:
        """Mean of ln x."""
        return math.log(self.mean) - 0.5 * self.zeta**2

    @property
    def support(self) -> tuple[float, float]:
        return 0.0, math.inf

    def from_standard(self, u: ArrayLike) -> Array:
        return np.exp(self.lam + self.zeta * np.asarray(u, dtype=float))

    def to_standard(self, x: ArrayLike) -> Array:
        values = np.asarray(x, dtype=float)
        with np.errstate(divide="ignore"):
            return as_array((np.log(np.maximum(values, 0.0)) - self.lam) / self.zeta)

    def slope(self, u: ArrayLike) -> Array:
        return self.zeta * self.from_standard(u)

    def _parameter_slopes(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """(∂λ/∂mean, ∂λ/∂sd) and (∂ζ/∂mean, ∂ζ/∂sd)."""
        delta = self.sd / self.mean
        scale = 1.0 / (self.mean * (1.0 + delta**2))
        return (
            ((1.0 + 2.0 * delta**2) * scale, -delta * scale),
            (-(delta**2) * scale / self.zeta, delta * scale / self.zeta),
        )

    def score(self, x: ArrayLike) -> tuple[Array, Array]:
        u = self.to_standard(x)
        (lam_mean, lam_sd), (zeta_mean, zeta_sd) = self._parameter_slopes()
        by_lam, by_zeta = u / self.zeta, (u * u - 1.0) / self.zeta
        return by_lam * lam_mean + by_zeta * zeta_mean, by_lam * lam_sd + by_zeta * zeta_sd

    def standard_shift(self, x: ArrayLike) -> tuple[Array, Array]:
        u = self.to_standard(x)
        (lam_mean, lam_sd), (zeta_mean, zeta_sd) = self._parameter_slopes()
        return -(lam_mean + u * zeta_mean) / self.zeta, -(lam_sd + u * zeta_sd) / self.zeta

    def truncated_moments(self, a: float, b: float) -> tuple[float, float]:
        """Mean and standard deviation of x given a ≤ u ≤ b."""
        mass, zeta = mass_between(a, b), self.zeta
        ratio = mass_between(a - zeta, b - zeta) / mass
        second = mass_between(a - 2 * zeta, b - 2 * zeta) / mass * math.exp(zeta**2)
        return self.mean * ratio, self.mean * math.sqrt(max(second - ratio**2, 0.0))
