"""Stability before the run: does the coupling, at its step, let an oscillation of the device on the foot grow that the
device itself would not?

The device is taken as linear, torque = -K angle - C velocity, as it is at the start (identification.py), on the plant's
effective inertia I about the device's axes and without any damping of the plant's own. One communication step is then a
matrix: one for each scheme, and one for the exact coupled system. An eigenvalue of the scheme's matrix that is larger
than the one of the exact matrix next to it is growth that the coupling adds; what the exact system does is the device's
own: a negative stiffness or damping pushes away, a torque held between the calls of a sampled device lags. The foot's
own damping makes the truth better, not worse."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .identification import Linearisation

WARNING, REFUSAL = 10.0, 1000.0
DIVISORS = (2, 4, 5, 8, 10, 20, 25, 40, 50, 100, 200, 500, 1000)
HUGE = 1e300
WRONG_SIGN = "its sign is wrong (factor = -1 in a mapping file)"
FINEST = 1e-6  # s: no smaller step is worth advising

Matrix = NDArray[np.floating]


def growth(scheme: str, device: Linearisation, step: float, steps: int) -> float:
    """Factor by which the coupling lets an oscillation grow in `steps` steps of `step` [s], beyond what the exact
    coupled system does; at most 1 where it adds nothing."""
    device = _part(device, device.period == 0)
    with np.errstate(over="ignore", invalid="ignore"):
        exact, ours = _exact(device, step), _eigenvalues(_matrix(scheme, device, step))
    nearest = exact[np.abs(ours[:, None] - exact[None, :]).argmin(axis=1)]
    return _power(float((np.abs(ours) / np.maximum(1.0, np.abs(nearest))).max(initial=0.0)), steps)


def own_growth(device: Linearisation, period: float, span: float) -> float:
    """Factor by which the exact coupled system itself grows over `span` [s], with the torques of devices of this
    `period` [s] alone: those that take every step (0), or sampled ones, held in between."""
    part = _part(device, device.period == period)
    steps = max(1, round(span / period)) if period else 1000
    with np.errstate(over="ignore", invalid="ignore"):
        own = _eigenvalues(_matrix("gauss-seidel", part, period)) if period else _exact(part, span / steps)
    return _power(float(np.abs(own).max(initial=0.0)), steps)


def _part(device: Linearisation, rows: NDArray[np.bool_]) -> Linearisation:
    """Only the torques about these axes."""
    if rows.all():
        return device
    keep = rows[:, None]
    return replace(
        device,
        stiffness=device.stiffness * keep,
        damping=device.damping * keep,
        handed_stiffness=device.handed_stiffness * keep,
        handed_damping=device.handed_damping * keep,
    )


def _eigenvalues(matrix: Matrix) -> NDArray[Any]:
    """HUGE where the matrix has overflowed."""
    return np.linalg.eigvals(matrix) if np.isfinite(matrix).all() else np.full(len(matrix), HUGE)


def _power(radius: float, steps: int) -> float:
    return float(np.exp(min(700.0, steps * np.log(max(radius, 1e-300)))))


def _matrix(scheme: str, device: Linearisation, step: float) -> Matrix:
    """One communication step of the scheme: angles and velocities, and for some schemes those of the step before."""
    d = len(device.axes)
    law = np.hstack([device.stiffness, device.damping])
    if scheme == "impedance":
        handed = np.hstack([device.handed_stiffness, device.handed_damping])  # acts within the step; the rest is held
        inside = _exponential(step * _motion(device, handed))
        return inside[: 2 * d, : 2 * d] + inside[: 2 * d, 2 * d :] @ (handed - law)
    unit, zero = np.eye(d), np.zeros((d, d))
    free: Matrix = np.block([[unit, step * unit], [zero, unit]])
    push: Matrix = np.vstack([0.5 * step**2 * unit, step * unit]) / _inertia(device)
    if scheme == "gauss-seidel":
        return free - push @ law
    if scheme in ("jacobi", "gauss-seidel-extrapolated"):
        now, before = (0.0, 1.0) if scheme == "jacobi" else (1.5, -0.5)
        return np.block([[free - now * push @ law, -before * push @ law], [np.eye(2 * d), np.zeros((2 * d, 2 * d))]])
    half = 0.5 * push @ law
    return np.linalg.solve(np.eye(2 * d) + half, free - half)


@lru_cache(maxsize=8)
def _rates(device: Linearisation) -> NDArray[Any]:
    """Eigenvalues of the motion of the coupled system itself."""
    n = 2 * len(device.axes)
    return _eigenvalues(_motion(device, np.hstack([device.stiffness, device.damping]))[:n, :n])


def _exact(device: Linearisation, step: float) -> NDArray[Any]:
    """Eigenvalues of the coupled system itself over `step`: the exponentials of those of its motion."""
    values = np.exp(step * _rates(device))
    return np.where(np.isfinite(values), values, HUGE)


def _motion(device: Linearisation, law: Matrix) -> Matrix:
    """Rates of angles, velocities and a constant torque (3 d) under the torque - law (angles, velocities)."""
    d = len(device.axes)
    motion = np.zeros((3 * d, 3 * d))
    motion[:d, d : 2 * d] = np.eye(d)
    motion[d : 2 * d, : 2 * d] = -law / _inertia(device)[:, None]
    motion[d : 2 * d, 2 * d :] = np.eye(d) / _inertia(device)
    return motion


def _inertia(device: Linearisation) -> Matrix:
    return np.ones(len(device.axes)) if device.inertia is None else device.inertia


def _exponential(matrix: Matrix) -> Matrix:
    """Scaling and squaring of the Taylor series. scipy's wakes the threads of its BLAS, which then spin for longer than
    a landing takes."""
    halvings = max(0, int(np.ceil(np.log2(max(np.abs(matrix).sum(axis=1).max(), 1e-300)))) + 1)
    scaled = matrix / 2.0**halvings
    out = term = np.eye(len(matrix))
    for k in range(1, 14):
        term = term @ scaled / k
        out = out + term
    for _ in range(halvings):
        out = out @ out
    return out


def largest_step(scheme: str, device: Linearisation, step: float, span: float) -> float | None:
    """The largest step [s] of the form `step`/n whose growth over `span` [s] stays below the warning; None where none
    does."""
    steps = (step / n for n in DIVISORS if step / n >= FINEST)
    return next((h for h in steps if growth(scheme, device, h, round(span / h)) <= WARNING), None)


@lru_cache(maxsize=64)  # landings differ in much that their devices at the start do not show
def verdict(
    scheme: str, device: Linearisation | None, step: float, steps: int, others: tuple[str, ...] = ()
) -> tuple[str, str]:
    """("stable" | "warning" | "refusal", what to say); `others` are the schemes that could run instead. Only a scheme
    or a step that was found stable here is advised."""
    if device is None or device.inertia is None:
        return "stable", ""
    factor = growth(scheme, device, step, steps)
    if factor <= WARNING:
        return "stable", ""
    k = device.stiffest
    cures = [f"--scheme {name}" for name in others if name != scheme and growth(name, device, step, steps) <= WARNING]
    smaller = largest_step(scheme, device, step, step * steps)
    cures += [f'--step "{1e3 * smaller:g} ms"'] if smaller else []
    text = (
        f"an oscillation about {device.axes[k]} may grow {_times(factor)} over the run under {scheme} at "
        f"{1e3 * step:g} ms ({device.size()}, inertia {device.inertia[k]:.3g} kg.m2)"
    )
    advice = f"use {' or '.join(cures)}" if cures else "no scheme or step was found that would do"
    return "refusal" if factor > REFUSAL else "warning", f"{text}; {advice}"


@lru_cache(maxsize=64)
def own_doubts(device: Linearisation | None, span: float) -> tuple[str, ...]:
    """What grows over `span` [s] by the devices themselves, whatever the coupling: one sentence each."""
    if device is None or device.inertia is None:
        return ()
    found = []
    for period in sorted(set(device.period.tolist())):
        factor = own_growth(device, period, span)
        if factor > WARNING:
            found.append(_cause(_part(device, device.period == period), period, factor))
    return tuple(found)


def _cause(device: Linearisation, period: float, factor: float) -> str:
    """Why the exact coupled system grows, in words."""
    for kind, matrix, unit in (("stiffness", device.stiffness, "N.m/rad"), ("damping", device.damping, "N.m.s/rad")):
        k = int(np.argmin(np.diag(matrix)))
        if matrix[k, k] < 0:
            return (
                f"the device pushes away about {device.axes[k]} ({kind} {matrix[k, k]:.4g} {unit} at the start): what "
                f"grows by that is its own, whatever the coupling; if it should resist, {WRONG_SIGN}"
            )
    cause = f"the device holds its torque for {1e3 * period:g} ms" if period else "the device's axes drive each other"
    return (
        f"{cause} ({device.size()}), which lets an oscillation grow {_times(factor)} over the run by itself, whatever "
        "the coupling"
    )


def _times(factor: float) -> str:
    return f"{factor:.0f}-fold" if factor < 1e6 else "without bound"
