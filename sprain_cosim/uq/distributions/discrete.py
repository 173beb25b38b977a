"""Distributions given by their values: constants, choices, a sample as it is."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtr, ndtri

from .marginal import Array, Marginal, as_array, require_finite

__all__ = ["Choices", "Empirical", "Fixed"]


@dataclass(frozen=True)
class Fixed(Marginal):
    """A constant, zero allowed. It has no place in the standard space: its u is 0 and moves nothing."""

    value: float

    def __post_init__(self) -> None:
        require_finite(self, value=self.value)

    @property
    def mean(self) -> float:
        return self.value

    @property
    def sd(self) -> float:
        return 0.0

    @property
    def support(self) -> tuple[float, float]:
        return self.value, self.value

    def from_standard(self, u: ArrayLike) -> Array:
        return np.full(np.shape(u), self.value)

    def to_standard(self, x: ArrayLike) -> Array:
        return np.zeros(np.shape(x))

    def slope(self, u: ArrayLike) -> Array:
        return np.zeros(np.shape(u))

    @property
    def is_fixed(self) -> bool:
        return True

    def probability_outside(self, low: float, high: float) -> float:
        return 0.0 if low <= self.value <= high else 1.0


@dataclass(frozen=True)
class Choices(Marginal):
    """One of several values, such as the items of an enumeration, with given weights.

    values   in ascending order, at least two
    weights  positive, one a value; scaled to sum 1. Empty: all alike

    x(u) is a staircase: it has no slope, so searches that follow slopes refuse it, and no correlation.
    `to_standard` gives the middle of a value's step (NaN for what is no value).
    """

    values: tuple[float, ...]
    weights: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if len(self.values) < 2 or not np.all(np.isfinite(self.values)) or np.any(np.diff(self.values) <= 0):
            raise ValueError(f"Choices: at least two different values in ascending order are needed, got {self.values}")
        if self.weights and len(self.weights) != len(self.values):
            raise ValueError(f"Choices: {len(self.weights)} weights for {len(self.values)} values")
        if not all(math.isfinite(w) and w > 0 for w in self.weights):
            raise ValueError(f"Choices: weights must be positive, got {self.weights}")

    @cached_property
    def probabilities(self) -> Array:
        """(k,) probabilities of the values."""
        weights = as_array(self.weights or (1.0,) * len(self.values))
        return as_array(weights / weights.sum())

    @cached_property
    def _below(self) -> Array:
        """(k + 1,) probability below each value, and 1."""
        below = np.concatenate([[0.0], np.cumsum(self.probabilities)])
        below[-1] = 1.0
        return below

    @property
    def mean(self) -> float:
        return float(self.probabilities @ as_array(self.values))

    @property
    def sd(self) -> float:
        return math.sqrt(float(self.probabilities @ (as_array(self.values) - self.mean) ** 2))

    @property
    def support(self) -> tuple[float, float]:
        return self.values[0], self.values[-1]

    def from_standard(self, u: ArrayLike) -> Array:
        step = np.searchsorted(self._below[1:-1], ndtr(as_array(u)), side="left")
        return as_array(as_array(self.values)[step])

    def to_standard(self, x: ArrayLike) -> Array:
        middle = ndtri(0.5 * (self._below[:-1] + self._below[1:]))
        values, x = as_array(self.values), as_array(x)
        nearest = np.clip(np.searchsorted(values, x), 0, len(values) - 1)
        return as_array(np.where(values[nearest] == x, middle[nearest], np.nan))

    def slope(self, u: ArrayLike) -> Array:
        return np.zeros(np.shape(u))

    def cdf(self, x: ArrayLike) -> Array:
        return as_array(self._below[np.searchsorted(as_array(self.values), as_array(x), side="right")])

    @property
    def is_discrete(self) -> bool:
        return True

    def probability_outside(self, low: float, high: float) -> float:
        values = as_array(self.values)
        return float(self.probabilities[(values < low) | (values > high)].sum())


@dataclass(frozen=True)
class Empirical(Marginal):
    """A measured sample as it is: the p-quantile of x is the sample's type-7 percentile, linear between neighbours.

    It cannot leave the sample: what 30 specimens did not show does not occur, so tails and rare events are beyond it
    (fit a distribution for those). Its standard deviation is a little below the sample's. `values` in any order, at
    least three and not all alike; values met several times are steps of x(u).
    """

    values: tuple[float, ...]

    def __post_init__(self) -> None:
        if len(self.values) < 3 or not np.all(np.isfinite(self.values)):
            raise ValueError(f"Empirical: at least three finite values are needed, got {len(self.values)}")
        if min(self.values) == max(self.values):
            raise ValueError(f"Empirical: all {len(self.values)} values are {self.values[0]}; use Fixed for a constant")

    @cached_property
    def _ordered(self) -> Array:
        return np.sort(as_array(self.values))

    @cached_property
    def mean(self) -> float:
        low, high = self._ordered[:-1], self._ordered[1:]
        return float(np.mean(0.5 * (low + high)))

    @cached_property
    def sd(self) -> float:
        low, high = self._ordered[:-1] - self.mean, self._ordered[1:] - self.mean
        return math.sqrt(float(np.mean(low**2 + low * high + high**2)) / 3.0)

    @property
    def support(self) -> tuple[float, float]:
        return float(self._ordered[0]), float(self._ordered[-1])

    def from_standard(self, u: ArrayLike) -> Array:
        last = len(self.values) - 1
        rank = np.arange(last + 1)
        lower = np.interp(last * ndtr(as_array(u)), rank, self._ordered)
        upper = np.interp(last * ndtr(-as_array(u)), rank, self._ordered[::-1])
        return as_array(np.where(as_array(u) < 0, lower, upper))

    def to_standard(self, x: ArrayLike) -> Array:
        values, counts = np.unique(self._ordered, return_counts=True)
        ranks = np.cumsum(counts) - 0.5 * (counts + 1)  # the middle of a step
        ends = np.where(values == values[0], 0.0, np.where(values == values[-1], len(self.values) - 1.0, ranks))
        return as_array(ndtri(np.interp(as_array(x), values, ends) / (len(self.values) - 1)))

    def truncated_moments(self, a: float, b: float) -> tuple[float, float]:
        last = len(self.values) - 1
        low, high = last * float(ndtr(a)), last * float(ndtr(b))
        inner = np.arange(math.floor(low) + 1, math.ceil(high))
        knots = np.concatenate([[low], inner, [high]])
        x, weight = np.interp(knots, np.arange(last + 1), self._ordered), np.diff(knots) / (high - low)
        mean = float(weight @ (x[:-1] + x[1:])) / 2.0
        left, right = x[:-1] - mean, x[1:] - mean
        return mean, math.sqrt(float(weight @ (left**2 + left * right + right**2)) / 3.0)

    @property
    def has_kinks(self) -> bool:
        return True

    def slope(self, u: ArrayLike) -> Array:
        u, last = as_array(u), len(self.values) - 1
        cell = np.clip((last * ndtr(u)).astype(int), 0, last - 1)
        return as_array(last * np.diff(self._ordered)[cell] * np.exp(-0.5 * u * u) / math.sqrt(2.0 * math.pi))
