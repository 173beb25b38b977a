"""A marginal cut off at one or both ends."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtr, ndtri

from .marginal import Array, Marginal, as_array, between, density, mass_between

__all__ = ["Truncated"]


@dataclass(frozen=True)
class Truncated(Marginal):
    """A `parent` given that low ≤ x ≤ high.

    `mean` and `sd` are those of x, the truncated variable; `score` and `standard_shift` are taken with
    respect to the parent's mean and sd at held ends, since those are the parameters a study states.
    """

    parent: Marginal
    low: float = -math.inf
    high: float = math.inf

    def __post_init__(self) -> None:
        if self.parent.is_fixed or self.parent.is_discrete or isinstance(self.parent, Truncated):
            raise ValueError(f"Truncated: {type(self.parent).__name__} cannot be truncated")
        if math.isnan(self.low) or math.isnan(self.high) or self.low >= self.high:
            raise ValueError(f"Truncated: low must be below high, got {self.low} and {self.high}")
        if not mass_between(*self._ends) > 1e-12:
            raise ValueError(
                f"Truncated: {self.parent} has no probability to speak of between {self.low} and {self.high}"
            )

    @cached_property
    def _ends(self) -> tuple[float, float]:
        """The ends of the support in the parent's standard space."""
        a, b = self.parent.to_standard(np.array([self.low, self.high]))
        return float(a), float(b)

    @cached_property
    def _mass(self) -> float:
        return mass_between(*self._ends)

    @cached_property
    def _moments(self) -> tuple[float, float]:
        return self.parent.truncated_moments(*self._ends)

    @property
    def mean(self) -> float:
        return self._moments[0]

    @property
    def sd(self) -> float:
        return self._moments[1]

    @property
    def support(self) -> tuple[float, float]:
        low, high = self.parent.support
        return max(low, self.low), min(high, self.high)

    @property
    def has_kinks(self) -> bool:
        return self.parent.has_kinks

    def _parent_standard(self, u: Array) -> Array:
        return between(u, *self._ends, self._mass)

    def from_standard(self, u: ArrayLike) -> Array:
        return self.parent.from_standard(self._parent_standard(np.asarray(u, dtype=float)))

    def to_standard(self, x: ArrayLike) -> Array:
        a, b = self._ends
        v = np.clip(self.parent.to_standard(x), a, b)
        below = np.where(v < 0, ndtr(v) - ndtr(a), ndtr(-a) - ndtr(-v)) / self._mass
        above = np.where(v < 0, ndtr(b) - ndtr(v), ndtr(-v) - ndtr(-b)) / self._mass
        return as_array(np.where(below < 0.5, ndtri(np.clip(below, 0, 1)), -ndtri(np.clip(above, 0, 1))))

    def slope(self, u: ArrayLike) -> Array:
        u = np.asarray(u, dtype=float)
        v = self._parent_standard(u)
        dv_du = self._mass * np.exp(0.5 * (v * v - u * u))
        return as_array(self.parent.slope(v) * dv_du)

    def _mass_moved(self, x: Array) -> tuple[Array, Array]:
        """Derivatives of the parent's P(low ≤ x' ≤ x) with respect to the parent's mean and sd."""
        moved = []
        for at_x, at_low in zip(self.parent.standard_shift(x), self._shift_at(self.low), strict=True):
            moved.append(density(self.parent.to_standard(x)) * at_x - at_low)
        return moved[0], moved[1]

    def _shift_at(self, end: float) -> tuple[float, float]:
        v = float(self.parent.to_standard(end))
        if not math.isfinite(v):
            return 0.0, 0.0
        by_mean, by_sd = self.parent.standard_shift(end)
        return float(density(v) * by_mean), float(density(v) * by_sd)

    def _whole_mass_moved(self) -> list[float]:
        pairs = zip(self._shift_at(self.high), self._shift_at(self.low), strict=True)
        return [at_high - at_low for at_high, at_low in pairs]

    def score(self, x: ArrayLike) -> tuple[Array, Array]:
        by_mean, by_sd = self.parent.score(x)
        whole_mean, whole_sd = self._whole_mass_moved()
        return by_mean - whole_mean / self._mass, by_sd - whole_sd / self._mass

    def standard_shift(self, x: ArrayLike) -> tuple[Array, Array]:
        x = np.asarray(x, dtype=float)
        u = self.to_standard(x)
        shifts = []
        for moved, whole in zip(self._mass_moved(x), self._whole_mass_moved(), strict=True):
            shifts.append((moved - ndtr(u) * whole) / (self._mass * density(u)))
        return shifts[0], shifts[1]
