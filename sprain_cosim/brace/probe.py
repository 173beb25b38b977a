"""The experiments of `check`, run in a child process: they drive the device and report numbers; what they mean is
decided in check.py.

Angles [rad], velocities [rad/s], torques [N.m] (n axes each) in the contract's names and signs, whatever the device's
own units."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..contract import MAX_VELOCITY_DEG_S, RANGE_DEG, plain
from ..errors import SimulationError
from ..fmu.component import Component
from ..fmu.element import Element
from ..fmu.instance import Instance
from ..process import Handlers, serve
from ..units import Unit

STEP = 0.5e-3
STEPS = (0.1e-3, 0.2e-3, 0.5e-3, 1e-3, 2e-3, 5e-3)
HOLD = 20e-3  # s, after which a held angle counts as static
STATIC_DEG = (2.0, 5.0, 10.0, 20.0, 30.0)
SWEEP_DEG_S = 200.0
CYCLE = 0.2  # s
CYCLE_SPEED = 2 * math.pi / CYCLE  # rad/s
SI = Unit("1")


class Bench:
    """One instance of the device with its contract signals on a small bus."""

    def __init__(self, component: Component, axes: tuple[str, ...]) -> None:
        self.component, self.axes = component, axes
        inputs = {plain(n): n for n in component.inputs}
        outputs = {plain(n): n for n in component.outputs}
        self.given = [
            (kind, k, inputs[plain(f"{a}_{kind}")])
            for kind in ("angle", "velocity")
            for k, a in enumerate(axes)
            if plain(f"{a}_{kind}") in inputs
        ]
        wanted = [f"{a}_{kind}" for kind in ("torque", "stiffness", "damping") for a in axes]
        self.found = {name: outputs[plain(name)] for name in wanted if plain(name) in outputs}
        self.read = [n for n, c in component.outputs.items() if c.scalar_number]
        n = len(self.given)
        self.bus = np.zeros(n + len(self.read))
        self.instance: Instance = component.open()
        self.instance.bind(self.bus, [name for _, _, name in self.given], 0, self.read, n, 0)
        self.time, self.used = 0.0, False

    def begin(self, angles: np.ndarray | None = None) -> None:
        """A new run that starts at `angles` at rest."""
        if self.used:
            self.instance.reset()
        self.used, self.time = True, 0.0
        self._place(np.zeros(len(self.axes)) if angles is None else angles, np.zeros(len(self.axes)))
        self.instance.enter_initialization(0.0, 10.0)
        self.instance.set_inputs()
        self.instance.get_outputs()
        self.instance.exit_initialization()
        self.instance.get_outputs()

    def step(self, angles: np.ndarray, velocities: np.ndarray, h: float) -> np.ndarray:
        self._place(angles, velocities)
        self.instance.set_inputs()
        self.instance.do_step(self.time, h)
        self.time += h
        self.instance.get_outputs()
        return self.torques()

    def _place(self, angles: np.ndarray, velocities: np.ndarray) -> None:
        for slot, (kind, k, name) in enumerate(self.given):
            self.bus[slot] = self._unit(name).from_base((angles if kind == "angle" else velocities)[k])

    def _unit(self, name: str) -> Unit:
        return self.component.connectors[name].unit or SI

    def outputs(self) -> dict[str, float]:
        values = dict(zip(self.read, self.bus[len(self.given) :].tolist(), strict=True))
        return {name: self._unit(own).to_base(values[own]) for name, own in self.found.items()}

    def torques(self) -> np.ndarray:
        """Raises SimulationError when an output, of the contract or not, is not finite."""
        if not np.isfinite(self.bus[len(self.given) :]).all():
            name, value = next(
                (n, v) for n, v in zip(self.read, self.bus[len(self.given) :], strict=True) if not math.isfinite(v)
            )
            place = ", ".join(
                f"{own} = {self._unit(own).to_base(v):.4g} {'rad' if kind == 'angle' else 'rad/s'}"
                for (kind, _, own), v in zip(self.given, self.bus, strict=False)
            )
            raise SimulationError(f"{name} is {value} at {place}")
        values = self.outputs()
        return np.array([values[f"{a}_torque"] for a in self.axes])

    def along(self, axis: int, value: float) -> np.ndarray:
        out = np.zeros(len(self.axes))
        out[axis] = value
        return out

    def hold(self, angles: np.ndarray, h: float = STEP) -> np.ndarray:
        """Static torque at `angles`, reached in one jump."""
        self.begin()
        still = np.zeros(len(self.axes))
        torque = self.torques()
        for _ in range(max(1, round(HOLD / h))):
            torque = self.step(angles, still, h)
        return torque

    def close(self) -> None:
        self.instance.close()


def own_step(component: Element) -> float:
    """A step that the device takes: STEP, or the multiple of its own that is next above."""
    own = component.capabilities.fixed_step
    return STEP if own is None else own * max(1, math.ceil(STEP / own - 1e-9))


def landing(axes: tuple[str, ...], h: float) -> tuple[np.ndarray, np.ndarray]:
    """Angles and velocities (n, axes) every h over 150 ms: the landing on the 30 degree slope of this project's plant,
    without a brace."""
    from scipy.interpolate import PchipInterpolator  # costs every child 0.9 s

    with (Path(__file__).parent / "landing.csv").open() as file:
        rows = list(csv.DictReader(file))
    time = np.array([float(r["time_s"]) for r in rows])
    curves = [PchipInterpolator(time, np.deg2rad([float(r[f"{a}_deg"]) for r in rows])) for a in axes]
    at = np.arange(0.0, time[-1], h)
    return np.stack([c(at) for c in curves], 1), np.stack([c.derivative()(at) for c in curves], 1)


# ---- the experiments: each gets a fresh bench and returns numbers


def start(bench: Bench, h: float) -> dict[str, Any]:
    """Instantiated twice; outputs at the start values."""
    second = None if bench.component.capabilities.single else Bench(bench.component, bench.axes)
    bench.begin()
    torques = bench.torques()
    if second is not None:
        second.begin()
        second.close()
    return {"torque": torques.tolist()}


def reset(bench: Bench, h: float) -> dict[str, Any]:
    """The device's own reset against a fresh instance, to the bit."""
    angles, velocities = landing(bench.axes, h)
    runs = []
    bench.close()
    other = Bench(
        replace(bench.component, capabilities=replace(bench.component.capabilities, reusable=True)), bench.axes
    )
    for _ in range(2):
        other.begin()
        runs.append(np.array([other.step(a, v, h) for a, v in zip(angles, velocities, strict=True)]))
    other.close()
    return {"equal": bool(np.array_equal(runs[0], runs[1])), "difference": float(np.abs(runs[0] - runs[1]).max())}


def repeat(bench: Bench, h: float) -> dict[str, Any]:
    """A fresh instance against the first, to the bit."""
    angles, velocities = landing(bench.axes, h)
    runs = []
    for _ in range(2):
        bench.begin()
        runs.append(np.array([bench.step(a, v, h) for a, v in zip(angles, velocities, strict=True)]))
    return {"equal": bool(np.array_equal(runs[0], runs[1])), "difference": float(np.abs(runs[0] - runs[1]).max())}


def steps(bench: Bench, h: float) -> dict[str, Any]:
    """Which communication steps it takes, its own alone where it has one; its torques call by call for 10 ms of each
    size, the angle held."""
    own = bench.component.capabilities.fixed_step
    sizes = STEPS if own is None else (own,)
    taken: dict[str, list[float] | str] = {}
    angles = np.deg2rad([10.0 if k == 0 else 0.0 for k in range(len(bench.axes))])
    still = np.zeros(len(bench.axes))
    span = 10e-3 if own is None else 10 * own
    for size in sizes:
        try:
            bench.begin()
            taken[f"{size:.9g}"] = [float(bench.step(angles, still, size)[0]) for _ in range(round(span / size))]
        except SimulationError as problem:
            taken[f"{size:.9g}"] = str(problem)
            bench.close()
            bench = Bench(bench.component, bench.axes)
    bench.close()
    return {"taken": taken}


def state(bench: Bench, h: float) -> dict[str, Any]:
    """Saved in the middle of a landing, restored, replayed: to the bit."""
    angles, velocities = landing(bench.axes, h)
    middle = len(angles) // 2
    bench.begin()
    for a, v in zip(angles[:middle], velocities[:middle], strict=True):
        bench.step(a, v, h)
    saved, time = bench.instance.save_state(), bench.time
    first = np.array([bench.step(a, v, h) for a, v in zip(angles[middle:], velocities[middle:], strict=True)])
    bench.instance.restore_state(saved)
    bench.time = time
    second = np.array([bench.step(a, v, h) for a, v in zip(angles[middle:], velocities[middle:], strict=True)])
    bench.instance.free_state(saved)
    return {"equal": bool(np.array_equal(first, second)), "difference": float(np.abs(first - second).max())}


def finite(bench: Bench, h: float) -> dict[str, Any]:
    """Outputs over the physiological range of every axis, at every velocity up to the fastest; the largest torque
    met."""
    most = 0.0
    for k, axis in enumerate(bench.axes):
        low, high = RANGE_DEG[axis]
        bench.begin()
        for velocity in (0.0, MAX_VELOCITY_DEG_S, -MAX_VELOCITY_DEG_S):
            for angle in np.linspace(low, high, 23):
                torque = bench.step(bench.along(k, math.radians(angle)), bench.along(k, math.radians(velocity)), h)
                most = max(most, float(np.abs(torque).max()))
    return {"largest_torque": most}


def recorded(bench: Bench, h: float) -> dict[str, Any]:
    """The landing: peak torque per axis, the work the device takes from the foot, and how far apart [s] the calls lie
    at which its torque changes, where that is regular and not every call."""
    angles, velocities = landing(bench.axes, h)
    bench.begin()
    torques = np.array([bench.step(a, v, h) for a, v in zip(angles, velocities, strict=True)])
    return {
        "peak_torque": np.abs(torques).max(0).tolist(),
        "work_taken": float(-(torques * velocities).sum() * h),
        "changes_every": _regular(torques, h),
    }


def _regular(torques: np.ndarray, h: float) -> float | None:
    """The time [s] between changes of torques (n, axes) that lie `h` [s] apart; None where they change at every call,
    or irregularly, or hardly at all."""
    changes = np.flatnonzero((np.diff(torques, axis=0) != 0.0).any(axis=1))
    gaps = np.diff(changes)
    if len(gaps) < 4 or gaps.min() < 2 or gaps.max() - gaps.min() > 1:
        return None
    return float(h * round(float(gaps.mean()), 2))


def static(bench: Bench, h: float) -> dict[str, Any]:
    """Torque of each axis at held angles, the others at zero; declared stiffness at zero beside the difference
    quotient."""
    bench.begin()
    out: dict[str, Any] = {"rest": bench.torques().tolist(), "torque": {}, "declared": {}}
    for k, axis in enumerate(bench.axes):
        low, high = RANGE_DEG[axis]
        pairs = []
        for d in (d for d in STATIC_DEG if low <= -d and d <= high):
            pairs.append(
                [
                    d,
                    float(bench.hold(bench.along(k, math.radians(d)), h)[k]),
                    float(bench.hold(bench.along(k, -math.radians(d)), h)[k]),
                ]
            )
        out["torque"][axis] = pairs
        if f"{axis}_stiffness" in bench.found:
            middle = math.radians(5.0)
            bench.hold(bench.along(k, middle), h)
            said = bench.outputs()[f"{axis}_stiffness"]
            near = [bench.hold(bench.along(k, middle + e), h)[k] for e in (-1e-4, 1e-4)]
            out["declared"][axis] = [said, float(-(near[1] - near[0]) / 2e-4)]
    return out


def moving(bench: Bench, h: float) -> dict[str, Any]:
    """Damping of each axis: torque at zero angle when passing it fast in either direction [N.m.s/rad]."""
    out = {}
    speed = math.radians(SWEEP_DEG_S)
    count = max(2, round(5e-3 / h))
    for k, axis in enumerate(bench.axes):
        at_zero = []
        for sign in (1.0, -1.0):
            bench.begin(bench.along(k, -sign * speed * count * h))
            for i in range(count + 1):
                torque = bench.step(bench.along(k, sign * speed * h * (i - count)), bench.along(k, sign * speed), h)
            at_zero.append(float(torque[k]))
        out[axis] = -(at_zero[0] - at_zero[1]) / (2 * speed)
    return {"damping": out}


def cycle(bench: Bench, h: float) -> dict[str, Any]:
    """Energy taken from the foot in one closed cycle of +-15 degrees in 200 ms [J], after one to settle; and the most
    that is stored meanwhile."""
    amplitude = math.radians(15.0)
    n = max(8, round(CYCLE / h))
    out = {}
    for k, axis in enumerate(bench.axes):
        bench.begin()
        taken, stored, most = 0.0, 0.0, 0.0
        before, torque_before = 0.0, 0.0
        for i in range(1, 2 * n + 1):
            phase = 2 * math.pi * i / n
            angle = amplitude * math.sin(phase)
            torque = float(
                bench.step(bench.along(k, angle), bench.along(k, amplitude * CYCLE_SPEED * math.cos(phase)), h)[k]
            )
            if i > n:
                work = -0.5 * (torque + torque_before) * (angle - before)
                taken += work
                stored += work
                most = max(most, abs(stored))
            before, torque_before = angle, torque
        out[axis] = [taken, most]
    return {"cycle": out}


PROBES: dict[str, Callable[[Bench, float], dict[str, Any]]] = {
    f.__name__: f for f in (start, steps, repeat, reset, state, finite, recorded, static, moving, cycle)
}


@contextmanager
def handlers(subject: tuple[Component, tuple[str, ...]]) -> Iterator[Handlers]:
    """The child: opens the device once, then runs the experiments."""
    component, axes = subject
    Bench(component, axes).close()

    def run(name: str, h: float) -> dict[str, Any]:
        bench = Bench(component, axes)
        found = PROBES[name](bench, h)
        bench.close()
        return found

    yield {"run": run}


if __name__ == "__main__":
    serve(handlers)
