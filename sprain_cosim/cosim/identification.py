"""Stiffness and damping of the devices by finite differences: what a device does not declare, and whether what it
declares is true.

One input of a device is moved at a time, and the slope of its torques is read off, in one of three ways:
    direct    outputs follow inputs at once: no step is taken
    step      over one step, repeated from a saved state
    start     over the first step of a second instance; only once, so held over the run
A stiffness is the secant over the angle that the plant is about to turn by, a damping the tangent.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from operator import mul
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .system import Assembly, Member, impedance_input

ANGLE, VELOCITY = 1e-4, 0.05  # rad, rad/s: least movements
DRIFT = 1e-3  # of a change of torque that the slopes may miss before they are found anew
ROUNDING = 1e-9
KINDS = (("stiffness", "angle"), ("damping", "velocity"))

DIRECT, STEP, START = "direct", "step", "start"

Matrix = NDArray[np.float64]
Slopes = NDArray[np.float64]  # (2, d, d): stiffness and damping
Recent = tuple[list[list[float]], list[float]]


@dataclass(frozen=True)
class Found:
    """About `axes` at the start, SI: `stiffness` and `damping` (d, d) of the devices, `given_stiffness` and
    `given_damping` (d, d) that a scheme can hand over (declared or identified), the plant's `inertia` (d,) or None
    where it does not tell. `declared` and `identified` name the outputs and how; `doubt` is a sentence about what is
    declared but not true, or cannot be found."""

    axes: tuple[str, ...]
    stiffness: Matrix
    damping: Matrix
    given_stiffness: Matrix
    given_damping: Matrix
    inertia: Matrix | None
    declared: tuple[str, ...] = ()
    identified: tuple[str, ...] = ()
    doubt: str = ""

    @property
    def stiffest(self) -> int:
        """The axis with the greatest stiffness over inertia, or damping where there is no stiffness."""
        inertia = np.ones(len(self.axes)) if self.inertia is None else self.inertia
        for matrix in (self.stiffness, self.damping):
            if np.diag(matrix).any():
                return int(np.argmax(np.abs(np.diag(matrix)) / inertia))
        return 0

    def size(self) -> str:
        k = self.stiffest
        text = f"stiffness {self.stiffness[k, k] + 0.0:.4g} N.m/rad, damping {self.damping[k, k] + 0.0:.3g} N.m.s/rad"
        return f"{text} about {self.axes[k]}"


class Identification:
    """Of an assembly that has started. `found` once at the start (None without a device), `update` along the run."""

    def __init__(self, assembly: Assembly, step: float) -> None:
        self.assembly = assembly
        torques = assembly.system.torques
        self.axes = tuple(torques)
        self._devices: list[_Device] = []
        for member in assembly.members:
            rows = [k for k, torque in enumerate(torques.values()) if torque.startswith(f"{member.name}.")]
            if rows:
                self._devices.append(_Device(assembly, member, self.axes, rows))
        self.found = self._at_start(step) if self._devices else None
        self._open = [device for device in self._devices if device.targets and device.held is None]

    def update(self, time: float, step: float) -> bool:
        """Finds what is not declared anew, at the present values of the bus and over a step of that size, for devices
        whose torques have changed otherwise than the last numbers say. The plant's inputs are left to be transferred;
        False where nothing was found."""
        found = False
        for device in self._open:
            if device.due():
                slopes = device.again(time, step)
                if np.isfinite(slopes).all():  # else the coming step will fail and say where
                    device.write(slopes)
                    found = True
        return found

    @property
    def memory(self) -> list[Recent]:
        """What `update` judges by; to be put back when a step is taken back."""
        return [device.recent for device in self._open]

    @memory.setter
    def memory(self, memory: list[Recent]) -> None:
        for device, recent in zip(self._open, memory, strict=True):
            device.recent = recent

    def _at_start(self, step: float) -> Found:
        assembly, axes = self.assembly, self.axes
        connections, d = assembly.system.connections, len(self.axes)
        probed, given = np.zeros((2, d, d)), np.zeros((2, d, d))
        declared, identified, doubts = list[str](), list[str](), list[str]()
        for device in self._devices:
            slopes = np.nan_to_num(device.choose(assembly.time, step), nan=0.0, posinf=0.0, neginf=0.0)
            device.write(slopes)
            for kind, (name, _) in enumerate(KINDS):
                for row in device.rows:
                    own = impedance_input(axes[row], axes[row], name)
                    probed[kind, row] = slopes[kind, row]
                    if own not in connections:
                        continue
                    declared.append(connections[own])
                    names = [impedance_input(axes[row], other, name) for other in axes]
                    given[kind, row] = [assembly.si(connections[n]) if n in connections else 0.0 for n in names]
                    if not device.answers:
                        probed[kind, row] = given[kind, row]
                        continue
                    says, does = given[kind, row, row], probed[kind, row, row]
                    if any(c.axis == row and c.kind == kind for c in device.columns) and abs(says - does) > max(
                        0.5 * abs(does), 0.02 * np.abs(probed[kind]).max(), 1e-3
                    ):
                        doubts.append(
                            f"{connections[own]} says {says:.4g} where the torque answers with {does:.4g} (SI)"
                        )
            for t in device.targets:
                given[t.kind, t.row, t.column] = slopes[t.kind, t.row, t.column]
            if device.targets:
                missing = " and ".join(
                    name for kind, (name, _) in enumerate(KINDS) if any(t.kind == kind for t in device.targets)
                )
                about = ", ".join(axes[row] for row in device.rows if any(t.row == row for t in device.targets))
                if not device.hidden:
                    identified.append(f"{missing} of {device.member.name} about {about} {device.how}")
                if device.held is not None:
                    what = (
                        "and allows one instance only: they stay unknown"
                        if device.hidden
                        else "so they are held as found at the start"
                    )
                    doubts.append(
                        f"{device.member.name} declares no {missing}, answers only in a step, cannot save its state "
                        f"{what}"
                    )
        inertia = [f"plant.{axis}_effective_inertia" for axis in axes]
        told = (
            np.array([assembly.si(name) for name in inertia])
            if all(name in assembly.index for name in inertia)
            else None
        )
        return Found(
            axes, probed[0], probed[1], given[0], given[1], told, tuple(declared), tuple(identified), "; ".join(doubts)
        )


@dataclass(frozen=True)
class _Target:
    """A slot on the bus for one identified number."""

    slot: int
    kind: int
    row: int
    column: int


@dataclass(frozen=True)
class _Column:
    """One output of the plant that the device reads: its slot, the slot of its rate (angles only) and its unit's
    factor."""

    slot: int
    rate: int
    kind: int
    axis: int
    factor: float


class _Device:
    """The probes of one device. `ways` by column; `held` what was found once and for all, None where it is found again
    along the run."""

    def __init__(self, assembly: Assembly, member: Member, axes: tuple[str, ...], rows: list[int]) -> None:
        self.assembly, self.member, self.axes, self.rows = assembly, member, axes, rows
        system, index = assembly.system, assembly.index
        self._torques = [index[system.torques[axes[row]]] for row in rows]
        self._factors = np.array([_factor(assembly, k) for k in self._torques])
        read = {system.connections.get(name) for name in assembly.names[member.inputs]}
        self.columns = [
            _Column(index[name], index[f"plant.{axis}_velocity"], kind, k, _factor(assembly, index[name]))
            for kind, (_, moved) in enumerate(KINDS)
            for k, axis in enumerate(axes)
            if (name := f"plant.{axis}_{moved}") in read
        ]
        self.targets = [
            _Target(slot, kind, row, column)
            for kind, (name, _) in enumerate(KINDS)
            for row in rows
            for column in range(len(axes))
            if (slot := assembly.identified.get(impedance_input(axes[row], axes[column], name))) is not None
        ]
        self._looked_at = np.array([c.slot for c in self.columns] + self._torques, dtype=np.intp)
        self.recent: Recent = ([], [])  # of `write` and `due`: torques by inputs, and both
        self.ways = [DIRECT] * len(self.columns)
        self.answers, self.hidden = False, False
        self.held: Slopes | None = None

    @property
    def how(self) -> str:
        if self.held is not None:
            return "over its first step"
        return "from its direct answer" if STEP not in self.ways else "over a repeated step"

    def choose(self, time: float, span: float) -> Slopes:
        """Direct where the device answers at once; for inputs it does not answer to, over a step where that shows more.
        Returns what was found."""
        found = self._probe(DIRECT, self.columns, time, span)
        moves = [bool(found[c.kind][self.rows, c.axis].any()) for c in self.columns]
        self.answers = any(moves)
        if not self.targets or all(moves):
            return found
        still = [c for c, moved in zip(self.columns, moves, strict=True) if not moved]
        if self.member.component.capabilities.state:
            late = self._probe(STEP, still, time, span)
            if late.any() or not self.answers:
                self.ways = [STEP if c in still else DIRECT for c in self.columns]
            return found + late
        if not self.answers:
            self.hidden = self.member.component.capabilities.single
            first = found if self.hidden else self._probe(START, self.columns, time, span)
            if self.hidden or first.any():
                self.held = first
            return first
        return found

    def again(self, time: float, span: float) -> Slopes:
        found = np.zeros((2, len(self.axes), len(self.axes)))
        for way in dict.fromkeys(self.ways):
            found += self._probe(
                way, [c for c, own in zip(self.columns, self.ways, strict=True) if own == way], time, span
            )
        return found

    def due(self) -> bool:
        """Whether the torques have changed since the last call otherwise than by the slopes at hand. Plain lists: it
        runs at every step."""
        law, before = self.recent
        now = self.assembly.bus.take(self._looked_at).tolist()
        self.recent = law, now
        moved = [x - y for x, y in zip(now, before, strict=True)]
        n = len(self.columns)
        told = [sum(map(mul, row, moved)) for row in law]
        missed = max(abs(change - t) for change, t in zip(moved[n:], told, strict=True))
        return not missed <= DRIFT * max(map(abs, told)) + ROUNDING * max(map(abs, now[n:]))

    def write(self, slopes: Slopes) -> None:
        law = [
            [-float(slopes[c.kind, row, c.axis]) * c.factor / f for c in self.columns]
            for row, f in zip(self.rows, self._factors, strict=True)
        ]
        self.recent = law, self.assembly.bus.take(self._looked_at).tolist()
        for t in self.targets:
            self.assembly.bus[t.slot] = slopes[t.kind, t.row, t.column]

    def _probe(self, way: str, columns: list[_Column], time: float, span: float) -> Slopes:
        """Stiffness and damping (2, d, d) for these columns. The bus and the device are left as they were."""
        assembly, member, bus = self.assembly, self.member, self.assembly.bus
        out = np.zeros((2, len(self.axes), len(self.axes)))
        if not columns:
            return out
        kept = bus.copy()
        able = member.component.capabilities
        saved = way == STEP or (
            way == DIRECT and able.model_exchange and able.state
        )  # an input that moves is an event of a model exchange FMU
        state = member.instance.save_state() if saved else None
        try:
            base = self._present() if way == DIRECT else self._answer(way, time, span, state)
            for c in columns:
                bus[:] = kept
                delta = VELOCITY
                if c.kind == 0:
                    turn = assembly.bus[c.rate] * _factor(assembly, c.rate) * span
                    delta = math.copysign(max(abs(turn), ANGLE), turn)
                bus[c.slot] += delta / c.factor
                assembly.transfer(member)
                out[c.kind, self.rows, c.axis] = (base - self._answer(way, time, span, state)) / delta
        finally:
            bus[:] = kept
            if saved:
                if way == DIRECT:
                    member.instance.restore_state(state)
                member.instance.free_state(state)
        if way == DIRECT:
            member.instance.set_inputs()
        return out

    def _present(self) -> Matrix:
        return self.assembly.bus[self._torques] * self._factors

    def _answer(self, way: str, time: float, span: float, state: Any) -> Matrix:
        """The torques [SI] for the inputs on the bus."""
        instance = self.member.instance
        if way == START:
            return self._of_a_second_instance(time, span)
        instance.set_inputs()
        if way == STEP:
            instance.do_step(time, span)
        instance.get_outputs()
        if way == STEP:
            instance.restore_state(state)
        return self._present()

    def _of_a_second_instance(self, time: float, span: float) -> Matrix:
        member, assembly = self.member, self.assembly
        n = len(member.given)
        if member.spare is None:
            member.spare = member.component.open()
            member.spare_bus = np.zeros(n + len(member.gives))
            names = [
                name.partition(".")[2] for name in (*assembly.names[member.inputs], *assembly.names[member.outputs])
            ]
            member.spare.bind(member.spare_bus, names[:n], 0, names[n:], n, 0)
        else:
            member.spare.reset()
        spare, bus = member.spare, member.spare_bus
        spare.set_parameters(assembly.parameters_of(member))
        spare.enter_initialization(assembly.time, assembly.stop)
        bus[:n] = member.given
        spare.set_inputs()
        spare.exit_initialization()
        spare.set_inputs()
        spare.do_step(time, span)
        spare.get_outputs()
        return bus[[n + k - member.outputs.start for k in self._torques]] * self._factors


def _factor(assembly: Assembly, slot: int) -> float:
    unit = assembly.units[slot]
    return unit.factor if unit else 1.0
