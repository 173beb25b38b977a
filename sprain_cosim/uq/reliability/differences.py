"""Slopes of a response by finite differences, and the noise that limits them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ..distributions import JointDistribution, Marginal
from .points import Array, Function, PointLedger

__all__ = ["Difference", "Slopes", "check_differences", "differences", "standard_gradient", "step_noise", "unit_vector"]

Difference = Literal["forward", "backward", "central"]


@dataclass(frozen=True)
class Slopes:
    """Value and derivatives of the function at one point.

    gradient (d,) ∂z/∂x; curvature (d,) ∂²z/∂x² by axis, or None from one-sided differences; moved: the
    largest change of z over the steps of each input (d,); resolution: the power of ten that every value met is
    a multiple of (to 0.0001), or None.
    """

    value: float
    gradient: Array
    curvature: Array | None
    moved: Array
    resolution: float | None


def _resolution(values: Array) -> float | None:
    for digits in range(5):
        scaled = values * 10.0**digits
        if np.all(np.abs(scaled - np.round(scaled)) < 1e-9 * np.maximum(np.abs(scaled), 1.0)):
            return 10.0**-digits
    return None


def differences(ledger: PointLedger, joint: JointDistribution, x: Array, step: float, how: Difference) -> Slopes:
    """Differences of step·σᵢ about x in one batch: 1 + n points, or 1 + 2n central; fixed inputs skipped. A step that
    would leave what a marginal can be is taken inwards, twice as long beside another one there."""
    active, h = joint.active, step * joint.sds
    offsets = {"forward": (1.0,), "backward": (-1.0,), "central": (1.0, -1.0)}[how]
    points = [x]
    for sign in offsets:
        for i in active:
            shifted = x.copy()
            shifted[i] += sign * h[i]
            low, high = joint.marginals[i].support
            if not low <= shifted[i] <= high:
                shifted[i] = x[i] - sign * len(offsets) * h[i]
            if shifted[i] == x[i]:
                raise ValueError(
                    f"input {i}: a step of {step:g} of its standard deviation {joint.sds[i]:g} does not move {x[i]:g}; "
                    "use Fixed for a constant, or a larger step"
                )
            points.append(shifted)
    values = ledger(np.array(points))
    centre, sides = values[0], values[1:].reshape(len(offsets), len(active))
    gradient, moved = np.zeros(len(joint)), np.zeros(len(joint))
    curvature = None
    # The step that was taken, which rounding made a little different from the one asked for.
    taken = np.array([points[1 + k][i] - x[i] for k, i in enumerate(active)])
    if how == "central":
        back = np.array([x[i] - points[1 + len(active) + k][i] for k, i in enumerate(active)])
        gradient[active] = (sides[0] - sides[1]) / (taken + back)
        curvature = np.zeros(len(joint))
        curvature[active] = (sides[0] - 2.0 * centre + sides[1]) / (taken * back)
        for k in np.flatnonzero(taken * back < 0.0):  # both on one side: the parabola through the three
            one, other, a, b = sides[0, k] - centre, sides[1, k] - centre, taken[k], -back[k]
            gradient[active[k]] = (one * b**2 - other * a**2) / (a * b * (b - a))
            curvature[active[k]] = 2.0 * (one * b - other * a) / (a * b * (a - b))
    else:
        gradient[active] = (sides[0] - centre) / taken
    moved[active] = np.max(np.abs(sides - centre), axis=0)
    return Slopes(float(centre), gradient, curvature, moved, _resolution(values))


def unit_vector(vector: Array) -> Array:
    """The vector divided by its norm; zeros stay zeros."""
    norm = float(np.linalg.norm(vector))
    return vector / norm if norm > 0 else np.zeros_like(vector)


def standard_gradient(joint: JointDistribution, gradient: Array, u: Array) -> Array:
    """(d,) ∂z/∂u at u from ∂z/∂x."""
    return joint.jacobian(u).T @ gradient


def check_differences(step: float, difference: str) -> None:
    if not (math.isfinite(step) and step > 0):
        raise ValueError(f"step must be positive (in standard deviations), got {step}")
    if difference not in ("forward", "backward", "central"):
        raise ValueError(f"difference must be 'forward', 'backward' or 'central', got {difference!r}")


def step_noise(function: Function, marginals: Sequence[Marginal], spacing: float = 1e-3, points: int = 9) -> float:
    """Standard deviation of the response's own noise near the mean inputs.

    A table of differences along the diagonal of the inputs (J. J. Moré, S. M. Wild, Estimating computational
    noise, SIAM J. Sci. Comput. 33 (2011) 1292-1314): differences of order k of a smooth function vanish,
    those of independent noise of standard deviation ε have standard deviation ε·√((2k)!/(k!)²). `points`
    evaluations, `spacing` standard deviations apart. Returns 0 where the response is smooth to rounding.
    """
    if points < 5:
        raise ValueError(f"the noise needs at least 5 points, got {points}")
    joint = JointDistribution(marginals)
    offsets = spacing * (np.arange(points) - points // 2)
    column = np.asarray(function(joint.means + offsets[:, np.newaxis] * joint.sds), dtype=float)
    if not np.all(np.isfinite(column)):
        raise ValueError("the function returned a value that is not finite")
    rounding = 4.0 * np.finfo(float).eps * float(np.max(np.abs(column)))
    estimates = []
    for order in range(1, points - 1):
        column = np.diff(column)
        if order >= 3:
            estimates.append(math.sqrt(float(np.mean(column**2)) / math.comb(2 * order, order)))
    level = float(np.median(estimates))
    return 0.0 if level <= rounding else level
