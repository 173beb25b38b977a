"""The experiments of `check`, run in a child process: they drive the device and report numbers; what they mean is
decided in check.py.

Angles [rad], velocities [rad/s], torques [N.m] (n axes each) in the contract's names and signs, whatever the device's
own units."""

from __future__ import annotations

import csv
import math
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from time import monotonic
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..contract import MAX_VELOCITY_DEG_S, RANGE_DEG, plain
from ..errors import SimulationError, without_name
from ..fmu.component import Component
from ..fmu.driver import STEP, Driver
from ..fmu.floating_point import FloatingPoint
from ..fmu.messages import Messages
from ..fmu.opener import import_libraries as _prepare  # noqa: F401 - the former before the process is copied
from ..fmu.opener import preload
from ..fmu.surroundings import Surroundings
from ..process import Handlers, serve
from ..units import Unit

STEPS = (0.1e-3, 0.2e-3, 0.5e-3, 1e-3, 2e-3, 5e-3)
HOLD = 20e-3  # s, after which a held angle counts as static
STATIC_DEG = (2.0, 5.0, 10.0, 20.0, 30.0, 45.0)  # the last as far as a landing goes
SWEEP_DEG_S = 200.0
LEAD = 0.1  # s, from zero to the first angles of the landing, and back
CYCLE = 0.2  # s
CYCLE_SPEED = 2 * math.pi / CYCLE  # rad/s
ROUNDING = 1e-12  # relative: torques that differ by less are the same
SI = Unit("1")
Array = NDArray[np.float64]

FREEING, FREED = "the device is freed", "the device was freed"
BEGINS, ENDS = ".device-begins", ".device-ends"  # files that tell a watch what is the device's doing


class Rig:
    """One device on a test rig: moved by the angles and velocities of its axes, under the contract's names and in SI.

    component   the device
    axes        names of the axes, in the order of all arrays
    moved       (angle or velocity, place in `axes`, the device's own input) of each input that the rig feeds
    named       {contract name: the device's own output} of torques, stiffness and damping
    driver      drives the device; reads all its outputs
    """

    def __init__(
        self, component: Component, axes: tuple[str, ...], parameters: Mapping[str, float] | None = None
    ) -> None:
        """`parameters`: other values than the device's own, in its units, beside those that it holds as a component.
        Raises SimulationError or EnvironmentProblem when the device cannot be opened."""
        self.component, self.axes = component, axes
        held = {name: component.connectors[name].value(value, name) for name, value in component.constants.items()}
        self._parameters = {**held, **(parameters or {})}
        inputs = {plain(n): n for n in component.inputs}
        outputs = {plain(n): n for n in component.outputs}
        self.moved = [
            (kind, k, inputs[plain(f"{a}_{kind}")])
            for kind in ("angle", "velocity")
            for k, a in enumerate(axes)
            if plain(f"{a}_{kind}") in inputs
        ]
        names = [f"{a}_{kind}" for kind in ("torque", "stiffness", "damping") for a in axes]
        self.named = {name: outputs[plain(name)] for name in names if plain(name) in outputs}
        self.driver = Driver(component, [name for _, _, name in self.moved])

    def begin(self, angles: Array | None = None) -> None:
        """A new run that starts at `angles` at rest."""
        still = np.zeros(len(self.axes))
        self.driver.start(self._parameters, self._inputs(still if angles is None else angles, still))

    def step(self, angles: Array, velocities: Array, h: float) -> Array:
        """The torques after a step of `h` [s] at these angles and velocities."""
        self.driver.step(h, self._inputs(angles, velocities))
        return self.torques()

    def place(self, angles: Array, velocities: Array) -> Array:
        """The torques at these angles and velocities within the same instant: what follows them directly."""
        self.driver.set_inputs(self._inputs(angles, velocities))
        self.driver.get_outputs()
        return self.torques()

    def _inputs(self, angles: Array, velocities: Array) -> dict[str, float]:
        return {
            name: self._unit(name).from_base(float((angles if kind == "angle" else velocities)[k]))
            for kind, k, name in self.moved
        }

    def _unit(self, name: str) -> Unit:
        return self.component.connectors[name].unit or SI

    def outputs(self) -> dict[str, float]:
        """{contract name: value} of torques, stiffness and damping."""
        return {name: self._unit(own).to_base(self.driver[own]) for name, own in self.named.items()}

    def torques(self) -> Array:
        """Raises SimulationError when an output, of the contract or not, is not finite."""
        for name, value in zip(self.driver.outputs, self.driver.output_values.tolist(), strict=True):
            if not math.isfinite(value):
                place = ", ".join(
                    f"{own} = {self._unit(own).to_base(self.driver[own]):.4g} {'rad' if kind == 'angle' else 'rad/s'}"
                    for kind, _, own in self.moved
                )
                raise SimulationError(f"{name} is {value} at {place}")
        values = self.outputs()
        return np.array([values[f"{a}_torque"] for a in self.axes])

    def along(self, axis: int, value: float) -> Array:
        """`value` about one axis, 0 about the others."""
        out = np.zeros(len(self.axes))
        out[axis] = value
        return out

    def hold(self, angles: Array, h: float = STEP) -> Array:
        """Static torque at `angles`, reached in one jump."""
        self.begin()
        still = np.zeros(len(self.axes))
        torque = self.torques()
        for _ in range(max(1, round(HOLD / h))):
            torque = self.step(angles, still, h)
        return torque

    def close(self) -> None:
        """Frees the device."""
        self.driver.close()


def landing(axes: tuple[str, ...], h: float) -> tuple[Array, Array]:
    """Angles and velocities (n, axes) every h over 150 ms: the landing on the 30 degree slope of this project's plant,
    without a brace."""
    from scipy.interpolate import PchipInterpolator  # costs every child 0.9 s

    with (Path(__file__).parent / "landing.csv").open() as file:
        rows = list(csv.DictReader(file))
    time = np.array([float(r["time_s"]) for r in rows])
    curves = [PchipInterpolator(time, np.deg2rad([float(r[f"{a}_deg"]) for r in rows])) for a in axes]
    at = np.arange(0.0, time[-1], h)
    return np.stack([c(at) for c in curves], 1), np.stack([c.derivative()(at) for c in curves], 1)


# ---- the experiments: each gets a fresh rig and returns numbers


def pace(rig: Rig, h: float) -> dict[str, Any]:
    """Wall time [s] of a start and of a call; 0 where the device refuses the step, which the next probe looks into."""
    still = np.zeros(len(rig.axes))
    clock = [monotonic()]
    with suppress(SimulationError):
        rig.begin()
        clock.append(monotonic())
        for _ in range(5):
            rig.step(still, still, h)
            clock.append(monotonic())
    first, *calls = [*np.diff(clock).tolist(), 0.0]
    return {"start": first, "call": float(np.median(calls)) if calls else 0.0}


def start(rig: Rig, h: float) -> dict[str, Any]:
    """Instantiated twice; outputs at the start values."""
    second = None if rig.component.capabilities.single else Rig(rig.component, rig.axes)
    rig.begin()
    torques = rig.torques()
    if second is not None:
        second.begin()
        second.close()
    return {"torque": torques.tolist()}


def reset(rig: Rig, h: float) -> dict[str, Any]:
    """The device's own reset against a fresh instance, to the bit."""
    angles, velocities = landing(rig.axes, h)
    runs = []
    rig.close()
    other = Rig(replace(rig.component, capabilities=replace(rig.component.capabilities, reusable=True)), rig.axes)
    for _ in range(2):
        other.begin()
        runs.append(np.array([other.step(a, v, h) for a, v in zip(angles, velocities, strict=True)]))
    other.close()
    return {"equal": bool(np.array_equal(runs[0], runs[1])), "difference": float(np.abs(runs[0] - runs[1]).max())}


def repeat(rig: Rig, h: float) -> dict[str, Any]:
    """A fresh instance against the first, to the bit."""
    angles, velocities = landing(rig.axes, h)
    runs = []
    for _ in range(2):
        rig.begin()
        runs.append(np.array([rig.step(a, v, h) for a, v in zip(angles, velocities, strict=True)]))
    return {"equal": bool(np.array_equal(runs[0], runs[1])), "difference": float(np.abs(runs[0] - runs[1]).max())}


def steps(rig: Rig, h: float) -> dict[str, Any]:
    """Which communication steps it takes, its own alone where it has one; its torques call by call for 10 ms of each
    size, the angle held."""
    own = rig.component.capabilities.fixed_step
    sizes = STEPS if own is None else (own,)
    taken: dict[str, list[float] | str] = {}
    angles = np.deg2rad([10.0 if k == 0 else 0.0 for k in range(len(rig.axes))])
    still = np.zeros(len(rig.axes))
    span = 10e-3 if own is None else 10 * own
    for size in sizes:
        try:
            rig.begin()
            taken[f"{size:.9g}"] = [float(rig.step(angles, still, size)[0]) for _ in range(round(span / size))]
        except SimulationError as problem:
            taken[f"{size:.9g}"] = without_name(rig.component.name, problem)
            rig.close()
            rig = Rig(rig.component, rig.axes)
    rig.close()
    return {"taken": taken}


def state(rig: Rig, h: float) -> dict[str, Any]:
    """Saved in the middle of a landing, restored, replayed: to the bit."""
    angles, velocities = landing(rig.axes, h)
    middle = len(angles) // 2
    rig.begin()
    for a, v in zip(angles[:middle], velocities[:middle], strict=True):
        rig.step(a, v, h)
    saved = rig.driver.save_state()
    first = np.array([rig.step(a, v, h) for a, v in zip(angles[middle:], velocities[middle:], strict=True)])
    rig.driver.restore_state(saved)
    second = np.array([rig.step(a, v, h) for a, v in zip(angles[middle:], velocities[middle:], strict=True)])
    rig.driver.free_state(saved)
    return {
        "equal": bool(np.array_equal(first, second)),
        "difference": float(np.abs(first - second).max()),
        "largest": float(np.abs(first).max()),
    }


def finite(rig: Rig, h: float) -> dict[str, Any]:
    """Outputs over the physiological range of every axis, at every velocity up to the fastest; the largest torque
    met."""
    most = 0.0
    for k, axis in enumerate(rig.axes):
        low, high = RANGE_DEG[axis]
        rig.begin()
        for velocity in (0.0, MAX_VELOCITY_DEG_S, -MAX_VELOCITY_DEG_S):
            for angle in np.linspace(low, high, 23):
                torque = rig.step(rig.along(k, math.radians(angle)), rig.along(k, math.radians(velocity)), h)
                most = max(most, float(np.abs(torque).max()))
    return {"largest_torque": most}


def recorded(rig: Rig, h: float) -> dict[str, Any]:
    """The landing: peak torque per axis, the work the device takes from the foot, and how far apart [s] the calls lie
    at which its torque changes, where that is regular and not every call."""
    angles, velocities = landing(rig.axes, h)
    rig.begin()
    torques = np.array([rig.step(a, v, h) for a, v in zip(angles, velocities, strict=True)])
    return {
        "peak_torque": np.abs(torques).max(0).tolist(),
        "work_taken": float(-(torques * velocities).sum() * h),
        "changes_every": _regular(torques, h),
    }


def _regular(torques: Array, h: float) -> float | None:
    """The time [s] between changes of torques (n, axes) that lie `h` [s] apart; None where they change at every call,
    or irregularly, or hardly at all."""
    rounding = ROUNDING * np.abs(torques).max()
    changes = np.flatnonzero((np.abs(np.diff(torques, axis=0)) > rounding).any(axis=1))
    gaps = np.diff(changes)
    if len(gaps) < 4 or gaps.min() < 2 or gaps.max() - gaps.min() > 1:
        return None
    return float(h * round(float(gaps.mean()), 2))


def static(rig: Rig, h: float) -> dict[str, Any]:
    """Torque of each axis at held angles, the others at zero: pairs of opposite angles, and those angles whose opposite
    lies beyond the range; rest is held at zero as long. Declared stiffness at 5 degrees beside the difference
    quotient."""
    still = np.zeros(len(rig.axes))
    out: dict[str, Any] = {"rest": rig.hold(still, h).tolist(), "torque": {}, "one_sided": {}, "declared": {}}
    for k, axis in enumerate(rig.axes):
        low, high = RANGE_DEG[axis]
        pairs = []
        for d in (d for d in STATIC_DEG if low <= -d and d <= high):
            pairs.append(
                [
                    d,
                    float(rig.hold(rig.along(k, math.radians(d)), h)[k]),
                    float(rig.hold(rig.along(k, -math.radians(d)), h)[k]),
                ]
            )
        out["torque"][axis] = pairs
        out["one_sided"][axis] = [
            [at, float(rig.hold(rig.along(k, math.radians(at)), h)[k])]
            for d in STATIC_DEG
            for at in (d, -d)
            if low <= at <= high and not low <= -at <= high
        ]
        if f"{axis}_stiffness" in rig.named:
            middle = math.radians(5.0)
            rig.hold(rig.along(k, middle), h)
            declared = rig.outputs()[f"{axis}_stiffness"]
            near = [rig.hold(rig.along(k, middle + e), h)[k] for e in (-1e-4, 1e-4)]
            out["declared"][axis] = [declared, float(-(near[1] - near[0]) / 2e-4)]
    return out


def moving(rig: Rig, h: float) -> dict[str, Any]:
    """Damping of each axis [N.m.s/rad]: torque at zero angle when passing it in either direction, at 200 deg/s and as
    fast as a landing."""
    slow, fast = math.radians(SWEEP_DEG_S), math.radians(MAX_VELOCITY_DEG_S)
    return {"damping": _damping(rig, slow, h), "fast_damping": _damping(rig, fast, h)}


def _damping(rig: Rig, speed: float, h: float) -> dict[str, float]:
    out = {}
    count = max(2, round(5e-3 / h))
    for k, axis in enumerate(rig.axes):
        at_zero = []
        for sign in (1.0, -1.0):
            rig.begin(rig.along(k, -sign * speed * count * h))
            for i in range(count + 1):
                torque = rig.step(rig.along(k, sign * speed * h * (i - count)), rig.along(k, sign * speed), h)
            at_zero.append(float(torque[k]))
        out[axis] = -(at_zero[0] - at_zero[1]) / (2 * speed)
    return out


@dataclass
class Work:
    """What a device does on a path: a sum over its calls, by the trapezoidal rule.

    taken    energy taken from the foot so far [J]
    stored   the most that was taken or given meanwhile [J]
    turning  sum of |change of torque| times |speed| [W]; times an age in s: the energy that torques so old may give
    """

    taken: float = 0.0
    stored: float = 0.0
    turning: float = 0.0

    def add(self, torques: Array, before: Array, moved: Array, h: float) -> None:
        """A call of `h` [s]: torques [N.m] at its end and before, the angles moved [rad] (n axes each)."""
        self.taken -= float((0.5 * (torques + before) * moved).sum())
        self.stored = max(self.stored, abs(self.taken))
        self.turning += float((np.abs(torques - before) * np.abs(moved)).sum()) / h

    def as_list(self) -> list[float]:
        return [self.taken, self.stored, self.turning]


def cycle(rig: Rig, h: float) -> dict[str, Any]:
    """Work of each axis in one closed cycle, after one to settle: +-15 degrees in 200 ms, and as far and as fast as a
    landing goes (45 degrees where the range allows, 1000 deg/s)."""
    far = {}
    for k, axis in enumerate(rig.axes):
        low, high = (max(RANGE_DEG[axis][0], -STATIC_DEG[-1]), min(RANGE_DEG[axis][1], STATIC_DEG[-1]))
        amplitude, middle = math.radians(high - low) / 2, math.radians(high + low) / 2
        far[axis] = _cycle(rig, k, middle, amplitude, math.radians(MAX_VELOCITY_DEG_S) / amplitude, h)
    near = {a: _cycle(rig, k, 0.0, math.radians(15.0), CYCLE_SPEED, h) for k, a in enumerate(rig.axes)}
    return {"cycle": near, "far_cycle": far}


def _cycle(rig: Rig, k: int, middle: float, amplitude: float, speed: float, h: float) -> list[float]:
    """Work about axis `k` in a sine of `amplitude` [rad] about `middle` [rad], of about `speed` [rad/s]."""
    n = 4 * max(2, round(2 * math.pi / speed / h / 4))  # up and down through the same angles
    speed = 2 * math.pi / (n * h)
    rig.begin()
    work = Work()
    before, torques_before = np.zeros(len(rig.axes)), np.zeros(len(rig.axes))
    for i in range(1, 2 * n + 1):
        phase = 2 * math.pi * i / n
        angles = rig.along(k, middle + amplitude * math.sin(phase))
        torques = rig.step(angles, rig.along(k, amplitude * speed * math.cos(phase)), h)
        if i > n:
            work.add(torques, torques_before, angles - before, h)
        before, torques_before = angles, torques
    return work.as_list()


def closed_landing(rig: Rig, h: float) -> dict[str, Any]:
    """Work of all axes in the landing, led to its first angles from zero and from its last ones back to zero: what an
    elastic device stores it has given back by then."""
    angles, velocities = landing(rig.axes, h)
    lead = np.arange(h, LEAD, h)[:, None] / LEAD
    blend, rate = 0.5 - 0.5 * np.cos(np.pi * lead), 0.5 * np.pi / LEAD * np.sin(np.pi * lead)
    first, last, rest = angles[0], angles[-1], 0 * angles[:1]
    angles = np.concatenate([first * blend, angles, last * (1 - blend), rest])
    velocities = np.concatenate([first * rate, velocities, -last * rate, rest])
    rig.begin()
    work = Work()
    before = np.zeros(len(rig.axes))
    torques_before = rig.step(before, before, h)
    for a, v in zip(angles, velocities, strict=True):
        torques = rig.step(a, v, h)
        work.add(torques, torques_before, a - before, h)
        before, torques_before = a, torques
    return {"work": work.as_list()}


EXPERIMENTS = (pace, start, steps, repeat, reset, state, finite, recorded, closed_landing, static, moving, cycle)
PROBES: dict[str, Callable[[Rig, float], dict[str, Any]]] = {f.__name__: f for f in EXPERIMENTS}


@contextmanager
def _handlers(subject: tuple[Component, tuple[str, ...]]) -> Iterator[Handlers]:
    """The child: opens the device once, then runs the experiments."""
    component, axes = subject
    preload()
    surroundings = Surroundings()
    FloatingPoint.watched = True
    landing(axes, STEP)  # what it imports
    Path(BEGINS).write_bytes(b"")
    free(Rig(component, axes))

    said: list[Messages] = []

    def run(name: str, h: float) -> dict[str, Any]:
        rig = Rig(component, axes)
        try:
            return PROBES[name](rig, h)
        finally:
            said.extend(m for m in [rig.driver.instance.messages()] if m is not None)
            free(rig)

    def messages() -> dict[str, Any] | None:
        found = Messages.sum(said)
        return found.to_json() if found is not None else None

    def conduct() -> list[str]:
        with suppress(OSError):
            (Path(folder) / ENDS).write_bytes(b"")
        return [*surroundings.restore(), *sorted(FloatingPoint.noticed)]

    folder = os.getcwd()
    yield {"run": run, "conduct": conduct, "messages": messages}


def free(rig: Rig) -> None:
    """Closes it, and says so before: what crashes then crashes while it is freed."""
    print(FREEING, flush=True)
    rig.close()
    print(FREED, flush=True)


if __name__ == "__main__":
    serve(_handlers)
