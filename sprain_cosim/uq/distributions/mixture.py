"""Populations of several groups: a value, or several joined ones, whose law depends on the group."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtr, ndtri

from .discrete import Choices
from .joint import JointDistribution
from .marginal import Array, Marginal, as_array

__all__ = ["JointMixture", "Mixture"]

_HALVINGS = 60  # of the interval between the groups' quantiles


@dataclass(frozen=True)
class Mixture(Marginal):
    """A value that has the law of one of several groups.

    parts    laws of the groups
    weights  shares of the groups, sum 1

    No scores: a mean that moves could be that of a group or a share.
    """

    parts: tuple[Marginal, ...]
    weights: tuple[float, ...]

    @property
    def mean(self) -> float:
        return float(np.dot(self.weights, [p.mean for p in self.parts]))

    @property
    def sd(self) -> float:
        within = np.dot(self.weights, [p.sd**2 + p.mean**2 for p in self.parts])
        return float(np.sqrt(within - self.mean**2))

    @property
    def support(self) -> tuple[float, float]:
        ends = [p.support for p in self.parts]
        return min(low for low, _ in ends), max(high for _, high in ends)

    def cdf(self, x: ArrayLike) -> Array:
        return as_array(sum(w * p.cdf(x) for w, p in zip(self.weights, self.parts, strict=True)))

    def from_standard(self, u: ArrayLike) -> Array:
        """Between the quantiles of the groups, halved until no digit is left."""
        u = as_array(u)
        ends = np.stack([p.from_standard(u) for p in self.parts])
        low, high, target = ends.min(axis=0), ends.max(axis=0), ndtr(u)
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            below = self.cdf(middle) < target
            low, high = np.where(below, middle, low), np.where(below, high, middle)
        return as_array(0.5 * (low + high))

    def to_standard(self, x: ArrayLike) -> Array:
        return as_array(ndtri(self.cdf(x)))

    def slope(self, u: ArrayLike) -> Array:
        x = self.from_standard(u)
        density = sum(
            w * np.exp(-0.5 * p.to_standard(x) ** 2) / p.slope(p.to_standard(x))
            for w, p in zip(self.weights, self.parts, strict=True)
        )
        return as_array(np.exp(-0.5 * as_array(u) ** 2) / density)


class JointMixture(JointDistribution):
    """Inputs whose joint law depends on a choice among them.

    marginals  of all inputs, over the groups
    column     of the choice, whose marginal is a Choices
    parts      of each choice in its order, the joint law of all inputs, the choice itself among them as a fixed one

    The attribute `correlation` is None though inputs depend on each other; what needs their correlation must ask the
    parts.
    """

    def __init__(self, marginals: Sequence[Marginal], column: int, parts: Sequence[JointDistribution]):
        super().__init__(marginals)
        choice = self.marginals[column]
        if not isinstance(choice, Choices) or len(choice.values) != len(parts):
            raise ValueError("a mixture needs a choice with a joint law for each of its values")
        self.column, self.parts = column, tuple(parts)

    def from_standard(self, u: ArrayLike) -> Array:
        u = as_array(u)
        choice = self.marginals[self.column]
        assert isinstance(choice, Choices)
        chosen = choice.from_standard(u[..., self.column])
        x = np.empty_like(u)
        for value, part in zip(choice.values, self.parts, strict=True):
            x[chosen == value] = part.from_standard(u[chosen == value])
        return x
