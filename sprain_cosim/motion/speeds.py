"""Speeds of a sampled motion: the slope of a smoothing spline, and how far it depends on the smoothing.

A quintic smoothing spline minimises sum (y - f)^2 + l int f'''^2; at its ends it is a parabola, as a fall is. Over rows
h seconds apart it passes the share 1/(1 + l w^6/h) of an oscillation w [rad/s]: with l = h/w0^6 the half of w0, like a
zero-lag filter with that cutoff (Woltring 1986, doi 10.1016/0141-1195(86)90098-7). It is laid through the rows up to
the instant alone: those after it belong to the impact, whose edge a filter would spread into the speeds before it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Curve = Callable[..., Array]
CUTOFF = 15.0  # Hz
OTHERS = (10.0, 20.0)  # Hz, that people use as well
GAIT = 6.0  # Hz, to which many files are filtered, across the impact
LEAST = 8  # rows of a spline
PERIOD = 3  # rows within a period of the cutoff, fewer than which its oscillation is not seen
REACH = 1.0  # s around the instant, beyond which rows say nothing about the speed
DEGREE = 5


@dataclass(frozen=True)
class SplineSpeed:
    """A speed at one instant.

    - value: by the chosen smoothing
    - tried: {name of another smoothing: value}
    - one_sided: the chosen one takes the rows up to the instant alone
    """

    value: float
    tried: dict[str, float]
    one_sided: bool

    @property
    def low(self) -> float:
        return min(self.value, *self.tried.values())

    @property
    def high(self) -> float:
        return max(self.value, *self.tried.values())


def value_at(time: Array, column: Array, at: float) -> float:
    """Of the cubic spline through the rows (linear between fewer than four); at a row the number of that row."""
    k = int(np.argmin(np.abs(time - at)))
    if time[k] == at or len(time) == 1:
        return float(column[k])
    if len(time) < 4:
        return float(np.interp(at, time, column))
    return float(_through(time, column)(at))


def spline_speed(time: Array, column: Array, at: float, cutoff: float = CUTOFF) -> SplineSpeed:
    """Of at least LEAST rows; `cutoff` [Hz] of the chosen smoothing."""
    near = np.abs(time - at) <= REACH
    if near.sum() >= LEAST:
        time, column = time[near], column[near]
    before = time <= at
    one_sided = bool(before.sum() >= LEAST)
    own = (time[before], column[before]) if one_sided else (time, column)
    tried = {f"{c:g} Hz": smoothed(*own, c)(at, 1) for c in (*OTHERS, CUTOFF) if c != cutoff}
    if one_sided:
        tried |= {f"{c:g} Hz, rows after it too": smoothed(time, column, c)(at, 1) for c in (GAIT, cutoff)}
    if coarse(time, cutoff):
        k = max(int(np.searchsorted(time, at, side="right")) - 1, 1)
        tried["the last two rows"] = (column[k] - column[k - 1]) / (time[k] - time[k - 1])
    tried["no smoothing"] = _through(time, column)(at, 1)
    return SplineSpeed(
        float(smoothed(*own, cutoff)(at, 1)), {name: float(value) for name, value in tried.items()}, one_sided
    )


def coarse(time: Array, cutoff: float) -> bool:
    """The rows are too far apart for an oscillation of the `cutoff` [Hz]: no smoothing says what the speed is."""
    return len(time) > 1 and float(time[-1] - time[0]) / (len(time) - 1) * cutoff * PERIOD > 1.0


def smoothed(time: Array, column: Array, cutoff: float) -> Curve:
    """The quintic smoothing spline that passes half of `cutoff` [Hz]."""
    from scipy.interpolate import BSpline
    from scipy.sparse import csr_array, diags_array
    from scipy.sparse.linalg import spsolve

    spacing = float(time[-1] - time[0]) / (len(time) - 1)
    x = (time - time[0]) / spacing
    knots = np.concatenate([np.repeat(x[0], DEGREE), x, np.repeat(x[-1], DEGREE)])
    values = csr_array(BSpline.design_matrix(x, knots, DEGREE))
    third, inner = diags_array([np.ones(len(knots) - DEGREE - 1)], offsets=[0]).tocsr(), knots
    for degree in range(DEGREE, DEGREE - 3, -1):  # coefficients of a spline -> of its derivative
        inner = inner[1:-1]
        width = inner[degree:] - inner[:-degree]
        step = diags_array([-degree / width, degree / width], offsets=[0, 1], shape=(len(width), len(width) + 1))
        third = step.tocsr() @ third
    points, weights = np.polynomial.legendre.leggauss(3)  # exact for the square of a parabola
    half = 0.5 * np.diff(x)
    at = (x[:-1, None] + half[:, None] * (1 + points)).ravel()
    curved = csr_array(BSpline.design_matrix(at, inner, DEGREE - 3)) @ third
    weighed = diags_array([(half[:, None] * weights).ravel()], offsets=[0])
    penalty = 1.0 / (2 * math.pi * cutoff * spacing) ** 6
    system = values.T @ values + penalty * (curved.T @ weighed @ curved)
    spline = BSpline(knots, spsolve(system.tocsc(), values.T @ column), DEGREE)

    def curve(when: float, derivative: int = 0) -> Array:
        out: Array = spline((when - time[0]) / spacing, derivative) / spacing**derivative
        return out

    return curve


def _through(time: Array, column: Array) -> Curve:
    from scipy.interpolate import CubicSpline

    spline: Curve = CubicSpline(time, column)
    return spline
