"""Stability before the run: does a scheme, at its step, let an oscillation of the device on the foot grow?

The device is taken as linear, torque = -K angle - C velocity, as it is at the start (identification.py), on the plant's
effective inertia I about the device's axes and without any damping of the plant's own. One communication step is then a
matrix, written down for each scheme; its spectral radius to the power of the number of steps is the growth over the
run. The foot's own damping makes the truth better, not worse."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .identification import Linearisation

WARNING, REFUSAL = 10.0, 1000.0

Matrix = NDArray[np.floating]


def growth(scheme: str, device: Linearisation, step: float, steps: int) -> float:
    """Factor by which the fastest growing oscillation grows in `steps` steps of `step` [s]; at most 1 where none
    grows."""
    d = len(device.axes)
    unit, zero = np.eye(d), np.zeros((d, d))
    free: Matrix = np.block([[unit, step * unit], [zero, unit]])
    inertia = np.ones(d) if device.inertia is None else device.inertia
    push: Matrix = np.vstack([0.5 * step**2 * unit, step * unit]) / inertia
    law = np.hstack([device.stiffness, device.damping])
    matrix: Matrix
    if scheme == "gauss-seidel":
        matrix = free - push @ law
    elif scheme in ("jacobi", "gauss-seidel-extrapolated"):
        now, before = (0.0, 1.0) if scheme == "jacobi" else (1.5, -0.5)
        matrix = np.block([[free - now * push @ law, -before * push @ law], [np.eye(2 * d), np.zeros((2 * d, 2 * d))]])
    elif scheme == "iterative":
        half = 0.5 * push @ law
        matrix = np.linalg.solve(np.eye(2 * d) + half, free - half)
    else:  # impedance: what is handed over acts within the step, exactly; the rest is held
        handed = np.hstack([device.handed_stiffness, device.handed_damping])
        motion = np.zeros((3 * d, 3 * d))
        motion[:d, d : 2 * d] = unit
        motion[d : 2 * d, : 2 * d], motion[d : 2 * d, 2 * d :] = -handed / inertia[:, None], unit / inertia[:, None]
        exact = _exponential(step * motion)
        matrix = exact[: 2 * d, : 2 * d] + exact[: 2 * d, 2 * d :] @ (handed - law)
    radius = float(np.abs(np.linalg.eigvals(matrix)).max())
    return float(np.exp(min(700.0, steps * np.log(max(radius, 1e-300)))))


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


def largest_step(scheme: str, device: Linearisation, step: float, span: float) -> float:
    """The largest step [s] of the form `step`/n whose growth over `span` [s] stays below the warning."""
    for n in (2, 4, 5, 8, 10, 20, 25, 40, 50, 100, 200, 500, 1000):
        if growth(scheme, device, step / n, round(span * n / step)) <= WARNING:
            return step / n
    return step / 1000


def verdict(
    scheme: str, device: Linearisation | None, step: float, steps: int, others: Sequence[str] = ()
) -> tuple[str, str]:
    """("stable" | "warning" | "refusal", what to say); `others` are the schemes that could run instead."""
    if device is None or device.inertia is None:
        return "stable", ""
    factor = growth(scheme, device, step, steps)
    if factor <= WARNING:
        return "stable", ""
    k = device.stiffest
    cures = [f"--scheme {name}" for name in others if name != scheme and growth(name, device, step, steps) <= WARNING]
    cures.append(f"--step '{1e3 * largest_step(scheme, device, step, step * steps):g} ms'")
    grows = f"{factor:.0f}-fold" if factor < 1e6 else "without bound"
    text = f"an oscillation about {device.axes[k]} may grow {grows} over the run under {scheme} at {1e3 * step:g} ms"
    return (
        "refusal" if factor > REFUSAL else "warning"
    ), f"{text} ({device.size()}, inertia {device.inertia[k]:.3g} kg.m2); use {' or '.join(cures)}"
