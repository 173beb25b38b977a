"""Stability before the run: does a scheme, at its step, let an oscillation of the device on the foot grow?

The device is taken as linear, torque = -K angle - C velocity, with K and C declared by it or found by finite differences, on the plant's effective inertia
I about the device's axes and without any damping of the plant's own. One communication step is then a matrix, written down for each scheme; its
spectral radius to the power of the number of steps is the growth over the run. The foot's own damping makes the truth better, not worse.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..system import Assembly
from .energy import TORQUE

WARNING, REFUSAL = 10.0, 1000.0
DELTA = {"angle": 1e-4, "velocity": 1e-3}  # rad, rad/s

Matrix = NDArray[np.floating]


@dataclass(frozen=True)
class Impedance:
    """Of the device at the start: `stiffness`, `damping` (d, d) over `axes`, and the plant's `inertia` (d,) about them; SI."""

    axes: tuple[str, ...]
    stiffness: Matrix
    damping: Matrix
    inertia: Matrix


def growth(scheme: str, device: Impedance, step: float, steps: int) -> float:
    """Factor by which the fastest growing oscillation grows in `steps` steps of `step` [s]; at most 1 where none grows."""
    d = len(device.axes)
    unit, zero = np.eye(d), np.zeros((d, d))
    free: Matrix = np.block([[unit, step * unit], [zero, unit]])
    push: Matrix = np.vstack([0.5 * step**2 * unit, step * unit]) / device.inertia
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
    else:  # impedance: exact for a linear device
        return 1.0
    radius = float(np.abs(np.linalg.eigvals(matrix)).max())
    return float(np.exp(min(700.0, steps * np.log(max(radius, 1e-300)))))


def largest_step(scheme: str, device: Impedance, step: float, span: float) -> float:
    """The largest step [s] of the form `step`/n whose growth over `span` [s] stays below the warning."""
    for n in (2, 4, 5, 8, 10, 20, 25, 40, 50, 100, 200, 500, 1000):
        if growth(scheme, device, step / n, round(span * n / step)) <= WARNING:
            return step / n
    return step / 1000


def impedance(assembly: Assembly) -> Impedance | None:
    """Of the one device that gives torques to the plant, at the present values of an assembly that has started; None without one.

    Declared stiffness and damping are taken; what is not declared is found by moving one input of the device at a time."""
    axes: list[tuple[str, str]] = []
    stiffness: list[list[float]] = []
    damping: list[list[float]] = []
    inertia: list[float] = []
    connections, index = assembly.system.connections, assembly.index
    for target, source in connections.items():
        axis = target.removeprefix("plant.brace_").removesuffix(TORQUE)
        if target == f"plant.brace_{axis}{TORQUE}" and f"plant.{axis}_effective_inertia" in index:
            axes.append((axis, source))
            inertia.append(assembly.bus[index[f"plant.{axis}_effective_inertia"]])
    if not axes:
        return None
    for kind, rows in (("stiffness", stiffness), ("damping", damping)):
        for axis, source in axes:
            row = []
            for other, _ in axes:
                name = f"plant.brace_{axis}_{kind}" if axis == other else f"plant.brace_{axis}_{other}_{kind}"
                if name in connections:
                    row.append(assembly.si(connections[name]))
                elif f"plant.brace_{axis}_{kind}" in connections:
                    row.append(0.0)
                else:
                    row.append(-_slope(assembly, source, f"plant.{other}_{'angle' if kind == 'stiffness' else 'velocity'}"))
            rows.append(row)
    return Impedance(tuple(a for a, _ in axes), np.array(stiffness), np.array(damping), np.array(inertia))


def _slope(assembly: Assembly, torque: str, moved: str) -> float:
    """d(torque)/d(plant's output), both in SI, by direct feed-through; 0 where the device does not read that output or answers only in a step."""
    member = next(m for m in assembly.members if torque.startswith(f"{m.name}."))
    inputs = [n for n in assembly.names[member.inputs] if assembly.system.connections[n] == moved]
    if not inputs:
        return 0.0
    delta = DELTA["velocity" if moved.endswith("_velocity") else "angle"]
    at = assembly.index[moved]
    unit = assembly.units[at]
    ends, kept = [], assembly.bus.copy()
    for sign in (1.0, -1.0):
        assembly.bus[at] = kept[at] + sign * delta / (unit.factor if unit else 1.0)
        assembly.transfer(member)
        member.instance.push()
        member.instance.pull()
        ends.append(assembly.si(torque))
    assembly.bus[:] = kept
    member.instance.push()
    member.instance.pull()
    return (ends[0] - ends[1]) / (2 * delta)


def verdict(scheme: str, assembly: Assembly, step: float, steps: int) -> tuple[str, str]:
    """("stable" | "warning" | "refusal", what to say)."""
    device = impedance(assembly)
    if device is None:
        return "stable", ""
    factor = growth(scheme, device, step, steps)
    if factor <= WARNING:
        return "stable", ""
    worst = int(np.argmax(np.diag(device.stiffness) / device.inertia))
    cure = largest_step(scheme, device, step, step * steps)
    k, c = device.stiffness[worst, worst], device.damping[worst, worst] + 0.0
    size = f"stiffness {k:.4g} N.m/rad, damping {c:.3g} N.m.s/rad, inertia {device.inertia[worst]:.3g} kg.m2"
    grows = f"{factor:.0f}-fold" if factor < 1e6 else "without bound"
    text = f"an oscillation about {device.axes[worst]} may grow {grows} over the run under {scheme} at {1e3 * step:g} ms ({size}); use --scheme impedance"
    return ("refusal" if factor > REFUSAL else "warning"), f"{text} or iterative, or --step '{1e3 * cure:g} ms'"
