"""The response as a linear model: about the mean inputs, and its extreme points on spheres of the standard space."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtri

from ..distributions import JointDistribution, Marginal
from .differences import Difference, Slopes, check_differences, differences, standard_gradient, unit_vector
from .points import Array, PointLedger

__all__ = ["DEFAULT_LEVELS", "Linearisation", "Setting", "Space", "linear_extreme"]

Space = Literal["x", "u"]

DEFAULT_LEVELS = (0.05, 0.5, 0.95)


def linear_extreme(joint: JointDistribution, gradient: Array, radius: float, sign: float) -> Array:
    """(d,) u on the sphere ‖u‖ = radius where sign·Σ gradientᵢ·xᵢ(u) is largest.

    Ascent by the fixed point u ← radius·∇/‖∇‖ from several starts, shifted towards the present point wherever
    it would descend (as in the shifted power method), so that it cannot cycle.
    """
    weights = sign * gradient
    lower = joint.cholesky

    def value_and_slope(u: Array) -> tuple[Array, Array]:
        z = u @ lower.T
        value, slope = np.zeros(len(u)), np.zeros_like(u)
        for i in np.flatnonzero(weights):
            value += weights[i] * (joint.marginals[i].from_standard(z[:, i]) - joint.marginals[i].mean)
            slope[:, i] = weights[i] * joint.marginals[i].slope(z[:, i])
        return value, slope @ lower

    centre = unit_vector(value_and_slope(np.zeros((1, len(joint))))[1][0])
    axes = np.eye(len(joint))[joint.active]
    starts = np.array([centre, *axes, *-axes])
    directions = starts[np.linalg.norm(starts, axis=1) > 0]
    value, slope = value_and_slope(radius * directions)
    shift = np.zeros((len(directions), 1))
    for _ in range(2000):
        norms = np.linalg.norm(slope, axis=1, keepdims=True)
        target = slope / np.where(norms > 0, norms, 1.0) + shift * directions
        moved = target / np.linalg.norm(target, axis=1, keepdims=True)
        new_value, new_slope = value_and_slope(radius * moved)
        falls = new_value < value - 1e-14 * np.abs(value)
        shift[falls] = 2.0 * shift[falls] + 0.5
        change = np.linalg.norm(moved - directions, axis=1)
        keep = ~falls
        directions[keep], value[keep], slope[keep] = moved[keep], new_value[keep], new_slope[keep]
        if not falls.any() and np.max(change) < 1e-14:
            break
    best: Array = radius * directions[int(np.argmax(value))]
    return best


@dataclass(frozen=True)
class Setting:
    """The checked arguments that the mean value family shares."""

    joint: JointDistribution
    levels: tuple[float, ...]
    space: Space
    step: float
    difference: Difference

    @classmethod
    def checked(
        cls,
        marginals: Sequence[Marginal],
        correlation: ArrayLike | None,
        levels: Sequence[float],
        space: Space,
        step: float,
        difference: Difference,
    ) -> Setting:
        joint = JointDistribution(marginals, correlation)
        joint.require_slopes()
        if not levels or any(not 0 < p < 1 for p in levels):
            raise ValueError(f"levels must lie between 0 and 1, got {list(levels)}")
        if space not in ("x", "u"):
            raise ValueError(f"space must be 'x' or 'u', got {space!r}")
        check_differences(step, difference)
        return cls(joint, tuple(float(p) for p in levels), space, step, difference)

    @property
    def outermost(self) -> float:
        """max |β| over the levels."""
        return float(np.max(np.abs(ndtri(np.array(self.levels)))))

    def extreme(self, gradient: Array, level: float, at: Array) -> Array:
        """(d,) u* of the linear model with slopes `gradient` (∂z/∂x), in x or, about the point `at`, in u."""
        beta = float(ndtri(level))
        if beta == 0.0 or not np.any(gradient):
            return np.zeros(len(self.joint))
        if self.space == "x":
            return linear_extreme(self.joint, gradient, abs(beta), math.copysign(1.0, beta))
        return beta * unit_vector(standard_gradient(self.joint, gradient, at))

    def importance(self, gradient: Array, level: float, u: Array) -> Array:
        beta = float(ndtri(level))
        return u / beta if beta else unit_vector(standard_gradient(self.joint, gradient, u))


@dataclass(frozen=True)
class Linearisation:
    """The response linearised at the mean inputs, where every method of the family starts."""

    slopes: Slopes
    mean_point: Array
    standard_point: Array
    sd: float
    importance: Array

    @classmethod
    def at_mean(cls, ledger: PointLedger, setting: Setting) -> Linearisation:
        joint = setting.joint
        slopes = differences(ledger, joint, joint.means, setting.step, setting.difference)
        u = joint.to_standard(joint.means)
        sd = math.sqrt(float(slopes.gradient @ joint.covariance @ slopes.gradient))
        importance = unit_vector(standard_gradient(joint, slopes.gradient, u))
        return cls(slopes, joint.means, u, sd, importance)

    def value(self, level: float) -> float:
        """MV: the percentile of a normal variable with the linearisation's mean and standard deviation."""
        return self.slopes.value + float(ndtri(level)) * self.sd
