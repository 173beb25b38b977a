"""Stiffness and damping of the devices by finite differences: what a device does not declare, and whether what it
declares is true.

One input of a device is moved at a time, and the slope of its torques is read off, in one of three ways:
    direct    outputs follow inputs at once: no step is taken
    step      over one step, repeated from a saved state
    start     over the first step of a second instance; only once, so held over the run
A stiffness is the secant over the angle that the plant is about to turn by, a damping the tangent. The step is that of
the device: the communication step, or its own period. A sampled device hands nothing over: its stiffness and damping
are found once, for the stability of what it does itself. A device that shows nothing in any of these ways is asked
whether it answers one step late.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property, lru_cache
from operator import mul
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..contract import MOTION, impedance_input, inertia_output, motion_output
from ..errors import SimulationError
from .assembly import Assembly, Member
from .layout import Layout, Place, Slots
from .spare import spare_in_initialization

ANGLE, VELOCITY = 1e-4, 0.05  # rad, rad/s: least movements
DRIFT = 1e-3  # of a change of torque that the slopes may miss before they are found anew
ROUNDING = 1e-9
FAR = {"stiffness": 0.35, "damping": 5.0}  # rad, rad/s: movements that reach beyond a slack
KINDS = tuple(MOTION)  # the first index of Slopes
STIFFNESS = KINDS.index("stiffness")

DIRECT, STEP, START = "direct", "step", "start"

Matrix = NDArray[np.float64]
Slopes = NDArray[np.float64]  # (2, d, d): stiffness and damping
Recent = tuple[list[list[float]], list[float]]  # torques by inputs; inputs and torques, all in the units of the bus


@dataclass(frozen=True, eq=False)
class Linearisation:
    """The devices at the start, SI. Two are equal where every number is, to the bit, so that what follows from them
    alone may be kept.

    axes                    about which they give torques (d)
    stiffness, damping      (d, d) that their torques show where they can be found, else as declared
    handed_stiffness, handed_damping  (d, d) that a scheme can hand over: declared or identified
    inertia                 (d,) effective inertia of the plant; None where the plant has no such outputs
    period                  (d,) [s] of devices that are sampled and held in between; 0 for others
    declared                the outputs that declare
    identified              what was found by finite differences, and how, in words
    doubt                   a sentence about what is declared but not true, or cannot be found
    """

    axes: tuple[str, ...]
    stiffness: Matrix
    damping: Matrix
    handed_stiffness: Matrix
    handed_damping: Matrix
    inertia: Matrix | None
    period: Matrix
    declared: tuple[str, ...] = ()
    identified: tuple[str, ...] = ()
    doubt: str = ""

    @cached_property
    def _content(self) -> tuple[Any, ...]:
        values = (getattr(self, f.name) for f in fields(self))
        return tuple(value.tobytes() if isinstance(value, np.ndarray) else value for value in values)

    def __hash__(self) -> int:
        return hash(self._content)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Linearisation) and self._content == other._content

    @property
    def stiffest(self) -> int:
        """The axis with the greatest stiffness over inertia, or damping where there is no stiffness."""
        inertia = np.ones(len(self.axes)) if self.inertia is None else self.inertia
        for matrix in (self.stiffness, self.damping):
            if np.diag(matrix).any():
                return int(np.argmax(np.abs(np.diag(matrix)) / inertia))
        return 0

    def size(self) -> str:
        """Stiffness and damping about the stiffest axis, in words."""
        k = self.stiffest
        text = f"stiffness {self.stiffness[k, k] + 0.0:.4g} N.m/rad, damping {self.damping[k, k] + 0.0:.3g} N.m.s/rad"
        return f"{text} about {self.axes[k]}"


class Identification:
    """Of an assembly that has started: `linearisation` once at the start (None without a device), `update` along the
    run."""

    def __init__(self, assembly: Assembly, step: float) -> None:
        self.assembly, self._sites = assembly, _sites(assembly.layout)
        self.axes = self._sites.axes
        self._devices = [_Device(assembly, assembly.members[k], self.axes, own) for k, own in self._sites.devices]
        self.linearisation = self._at_start(step) if self._devices else None
        repeated = [device for device in self._devices if device.targets and device.constant is None]
        self._repeated = [device for device in repeated if device.member.name not in assembly.own_rate]
        self._called = {device.member.name: device for device in repeated if device.member.name in assembly.own_rate}

    @property
    def repeats(self) -> bool:
        """Whether `update` has something to do."""
        return bool(self._repeated)

    def update(self, time: float, step: float) -> bool:
        """Finds what is not declared anew, at the present values of the bus and over a step of that size, for devices
        that take every step and whose torques have changed otherwise than the last numbers predict. The plant's inputs
        are left to be transferred; False where nothing was found."""
        return sum(self._renew(device, time, step) for device in self._repeated) > 0

    def update_called(self, names: Sequence[str], time: float) -> bool:
        """The same for devices with a rate of their own, after their call at `time`."""
        own = self.assembly.own_rate
        due = [n for n in names if n in self._called and time + own[n].rate.period * (1.0 - 1e-6) <= self.assembly.stop]
        return sum(self._renew(self._called[n], time, own[n].rate.period) for n in due) > 0

    @staticmethod
    def _renew(device: _Device, time: float, span: float) -> bool:
        if not device.has_drifted():
            return False
        slopes = device.repeat(time, span)
        if not np.isfinite(slopes).all():  # the coming step will fail and say where
            return False
        device.write(slopes)
        return True

    @property
    def recent(self) -> list[Recent]:
        """What `update` judges by; to be put back when a step is taken back."""
        return [device.recent for device in self._repeated]

    @recent.setter
    def recent(self, recent: list[Recent]) -> None:
        for device, own in zip(self._repeated, recent, strict=True):
            device.recent = own

    def _at_start(self, step: float) -> Linearisation:
        assembly, axes, d = self.assembly, self.axes, len(self.axes)
        found, period = _Findings(np.zeros((2, d, d)), np.zeros((2, d, d))), np.zeros(d)
        for device in self._devices:
            span = device.period or step
            slopes = device.linearise(assembly.time, span)
            if not np.isfinite(slopes).all():
                slopes = np.nan_to_num(slopes, nan=0.0, posinf=0.0, neginf=0.0)
            device.write(slopes)
            if device.sampled:
                period[device.rows] = span
            for kind in range(len(KINDS)):
                for row in device.rows:
                    self._compare(device, kind, row, slopes, found)
            for t in device.targets:
                found.handed[t.kind, t.row, t.column] = slopes[t.kind, t.row, t.column]
            if device.targets:
                self._name_targets(device, found)
            if not (device.answers or slopes.any()) and device.answers_late(assembly.time, span):
                device.member.lag = 1
                found.doubts.append(
                    f"{device.member.name} answers one step late, {1e3 * span:g} ms, which no scheme makes good; a "
                    "smaller --step lessens it"
                )
        inertia = self._sites.inertia
        return Linearisation(
            axes=axes,
            stiffness=found.shown[0],
            damping=found.shown[1],
            handed_stiffness=found.handed[0],
            handed_damping=found.handed[1],
            inertia=None if inertia is None else np.array([assembly.si(slot) for slot in inertia]),
            period=period,
            declared=tuple(found.declared),
            identified=tuple(found.identified),
            doubt="; ".join(found.doubts),
        )

    def _compare(self, device: _Device, kind: int, row: int, slopes: Slopes, found: _Findings) -> None:
        """What a device declares about one axis against what its torques show."""
        found.shown[kind, row] = slopes[kind, row]
        stating = device.site.stating[kind, row]
        if stating is None:
            return
        source, places = stating
        if not device.sampled:
            found.declared.append(source)
        stated = np.array([0.0 if slot is None else self.assembly.si(slot) for slot in places])
        if not device.sampled:
            found.handed[kind, row] = stated
        if not device.answers:
            found.shown[kind, row] = stated
            return
        declared, shown = stated[row], found.shown[kind, row, row]
        tolerance = max(0.5 * abs(shown), 0.02 * np.abs(found.shown[kind]).max(), 1e-3)
        if any(c.axis == row and c.kind == kind for c in device.columns) and abs(declared - shown) > tolerance:
            found.doubts.append(f"{source} says {declared:.4g} where the torque answers with {shown:.4g} (SI)")

    def _name_targets(self, device: _Device, found: _Findings) -> None:
        missing = " and ".join(n for kind, n in enumerate(KINDS) if any(t.kind == kind for t in device.targets))
        about = ", ".join(self.axes[row] for row in device.rows if any(t.row == row for t in device.targets))
        if not device.inaccessible:
            found.identified.append(f"{missing} of {device.member.name} about {about} {device.how}")
        if device.constant is not None:
            consequence = (
                "and allows one instance only: they stay unknown"
                if device.inaccessible
                else "so they are held as found at the start"
            )
            found.doubts.append(
                f"{device.member.name} declares no {missing}, answers only in a step, cannot save its state "
                f"{consequence}"
            )


@dataclass
class _Findings:
    """What the start adds up over all devices: the (2, d, d) slopes shown and handed over, and words."""

    shown: Slopes
    handed: Slopes
    declared: list[str] = field(default_factory=list)
    identified: list[str] = field(default_factory=list)
    doubts: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class _Target:
    """A slot on the bus for one identified number."""

    slot: int
    kind: int
    row: int
    column: int


@dataclass(frozen=True)
class _Column:
    """One output of the plant that the device reads: its slot, the slot of its rate (angles only), the kind of slope
    and axis that it belongs to, and its unit's factor."""

    slot: int
    rate: int
    kind: int
    axis: int
    factor: float


@dataclass(frozen=True, eq=False)
class _Site:
    """Where on the bus one device is probed.

    rows     the axes about which it gives torques
    torques  slots of these
    factors  from their units to SI
    columns  the outputs of the plant that it reads
    targets  the slots for what it does not declare
    law      slots of the columns and the torques
    stating  {kind and row: the output that declares this, and the slots of what is declared by axis, None for none}
    """

    rows: list[int]
    torques: list[int]
    factors: Matrix
    columns: list[_Column]
    targets: list[_Target]
    law: Slots
    stating: Mapping[tuple[int, int], tuple[str, list[int | None]] | None]


@dataclass(frozen=True, eq=False)
class _Sites:
    """Of all devices, by their places in the system; `inertia`: slots of the plant's effective inertia about the axes,
    None where it gives none."""

    axes: tuple[str, ...]
    devices: list[tuple[int, _Site]]
    inertia: list[int] | None


@lru_cache(maxsize=16)
def _sites(layout: Layout) -> _Sites:
    axes, devices = tuple(layout.torques), []
    for k, component in enumerate(layout.components):
        rows = [row for row, torque in enumerate(layout.torques.values()) if torque.startswith(f"{component.name}.")]
        if rows:
            devices.append((k, _site(layout, layout.places[k], axes, rows)))
    inertia = [layout.index.get(inertia_output(axis)) for axis in axes]
    return _Sites(axes, devices, [k for k in inertia if k is not None] if None not in inertia else None)


def _site(layout: Layout, place: Place, axes: tuple[str, ...], rows: list[int]) -> _Site:
    index, connections = layout.index, layout.connections
    torques = [index[layout.torques[axes[row]]] for row in rows]
    read = {connections.get(name) for name in layout.names[place.inputs]}
    columns = [
        _Column(index[name], index[motion_output(axis, "damping")], kind, k, layout.factor(index[name]))
        for kind, impedance in enumerate(KINDS)
        for k, axis in enumerate(axes)
        if (name := motion_output(axis, impedance)) in read
    ]
    targets = [
        _Target(slot, kind, row, column)
        for kind, impedance in enumerate(KINDS)
        for row in rows
        for column in range(len(axes))
        if (slot := layout.identified.get(impedance_input(axes[row], axes[column], impedance))) is not None
    ]

    def stating(kind: str, row: int) -> tuple[str, list[int | None]] | None:
        sources = [connections.get(impedance_input(axes[row], other, kind)) for other in axes]
        own = sources[row]
        return None if own is None else (own, [None if source is None else index[source] for source in sources])

    return _Site(
        rows,
        torques,
        np.array([layout.factor(k) for k in torques]),
        columns,
        targets,
        np.array([c.slot for c in columns] + torques, dtype=np.intp),
        {(kind, row): stating(name, row) for kind, name in enumerate(KINDS) for row in rows},
    )


class _Device:
    """The probes of one device, with what its site says.

    ways          by column, how its slopes are found
    targets       those of its site that are written
    incomplete    it does not declare all stiffness and damping about its axes
    period        [s] of its own; None where it takes every step
    sampled       its torques are held between its calls, so it hands nothing over
    answers       its torques follow its inputs directly
    inaccessible  no probe can reach its law
    constant      the slopes that were found once and for all; None where they are found again along the run
    recent        what `has_drifted` judges by
    """

    def __init__(self, assembly: Assembly, member: Member, axes: tuple[str, ...], site: _Site) -> None:
        self.assembly, self.member, self.axes, self.site = assembly, member, axes, site
        own = assembly.own_rate.get(member.name)
        self.period = own.rate.period if own else None
        self.sampled = own is not None and own.rate.sampled
        self.rows, self.columns = site.rows, site.columns
        self._torques, self._factors, self._law = site.torques, site.factors, site.law
        self.incomplete, self.targets = bool(site.targets), [] if self.sampled else site.targets
        self.recent: Recent = ([], [])
        self.ways = [DIRECT] * len(self.columns)
        self.answers, self.inaccessible = False, False
        self.constant: Slopes | None = None

    @property
    def how(self) -> str:
        if self.constant is not None:
            return "over its first step"
        return "from its direct answer" if STEP not in self.ways else "over a repeated step"

    def linearise(self, time: float, span: float) -> Slopes:
        """Directly where the device answers at once; for inputs it does not answer to, over a step where that shows
        more."""
        slopes = self._probe(DIRECT, self.columns, time, span)
        moves = [bool(slopes[c.kind][self.rows, c.axis].any()) for c in self.columns]
        self.answers = any(moves)
        if not self.incomplete or all(moves):
            return slopes
        still = [c for c, moved in zip(self.columns, moves, strict=True) if not moved]
        if self.member.component.capabilities.state:
            over_a_step = self._probe(STEP, still, time, span)
            if over_a_step.any() or not self.answers:
                self.ways = [STEP if c in still else DIRECT for c in self.columns]
            return slopes + over_a_step
        if not self.answers:
            self.inaccessible = self.member.component.capabilities.single
            first = slopes if self.inaccessible else self._probe(START, self.columns, time, span)
            if self.inaccessible or first.any():
                self.constant = first
            return first
        return slopes

    def answers_late(self, time: float, span: float) -> bool:
        """Whether a movement of its inputs shows in the torques after the second step only, in a second instance."""
        if self.sampled or self.member.component.capabilities.single or not self.columns:
            return False
        kept = self.assembly.bus.copy()
        found = []
        try:
            for direction in (0.0, 1.0, -1.0):
                self.assembly.bus[:] = kept
                for c in self.columns:
                    self.assembly.bus[c.slot] += direction * FAR[KINDS[c.kind]] / c.factor
                self.assembly.transfer(self.member)
                found.append(self._responses_of_a_second_instance(time, span, 2))
        except SimulationError:  # a device that cannot take such a movement
            self.member.close_spare()
            return False
        finally:
            self.assembly.bus[:] = kept
        (first, second), *moved = found
        return any(np.array_equal(one, first) and not np.array_equal(two, second) for one, two in moved)

    def repeat(self, time: float, span: float) -> Slopes:
        """The slopes at the present values, each in the way that was chosen at the start."""
        slopes = np.zeros((2, len(self.axes), len(self.axes)))
        for way in dict.fromkeys(self.ways):
            columns = [c for c, own in zip(self.columns, self.ways, strict=True) if own == way]
            slopes += self._probe(way, columns, time, span)
        return slopes

    def has_drifted(self) -> bool:
        """Whether the torques have changed since the last call otherwise than by the slopes at hand. Plain lists: it
        runs at every step."""
        law, before = self.recent
        now = self.assembly.bus.take(self._law).tolist()
        self.recent = law, now
        moved = [x - y for x, y in zip(now, before, strict=True)]
        n = len(self.columns)
        predicted = [sum(map(mul, row, moved)) for row in law]
        missed = max(abs(change - p) for change, p in zip(moved[n:], predicted, strict=True))
        return not missed <= DRIFT * max(map(abs, predicted)) + ROUNDING * max(map(abs, now[n:]))

    def write(self, slopes: Slopes) -> None:
        """Puts the slopes onto the bus."""
        law = [
            [-float(slopes[c.kind, row, c.axis]) * c.factor / f for c in self.columns]
            for row, f in zip(self.rows, self._factors, strict=True)
        ]
        self.recent = law, self.assembly.bus.take(self._law).tolist()
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
            base = self._torques_on_bus() if way == DIRECT else self._response(way, time, span, state)
            for c in columns:
                bus[:] = kept
                delta = VELOCITY
                if c.kind == STIFFNESS:
                    turn = assembly.bus[c.rate] * assembly.factor(c.rate) * span
                    delta = math.copysign(max(abs(turn), ANGLE), turn)
                bus[c.slot] += delta / c.factor
                assembly.transfer(member)
                out[c.kind, self.rows, c.axis] = (base - self._response(way, time, span, state)) / delta
        finally:
            bus[:] = kept
            if saved:
                if way == DIRECT:
                    member.instance.restore_state(state)
                member.instance.free_state(state)
        if way == DIRECT:
            member.instance.set_inputs()
        return out

    def _torques_on_bus(self) -> Matrix:
        torques: Matrix = self.assembly.bus[self._torques] * self._factors
        return torques

    def _response(self, way: str, time: float, span: float, state: Any) -> Matrix:
        """The torques [SI] for the inputs on the bus."""
        instance = self.member.instance
        if way == START:
            return self._responses_of_a_second_instance(time, span)[0]
        instance.set_inputs()
        if way == STEP:
            instance.do_step(time, span)
        instance.get_outputs()
        if way == STEP:
            instance.restore_state(state)
        return self._torques_on_bus()

    def _responses_of_a_second_instance(self, time: float, span: float, steps: int = 1) -> list[Matrix]:
        """The torques [SI] after each of its first steps, for the inputs on the bus."""
        member, n = self.member, len(self.member.input_values)
        spare = spare_in_initialization(self.assembly, member)
        member.spare_bus[:n] = member.input_values
        spare.set_inputs()
        spare.exit_initialization()
        spare.set_inputs()
        slots = [n + k - member.outputs.start for k in self._torques]
        found = []
        for k in range(steps):
            spare.do_step(time + k * span, span)
            spare.get_outputs()
            found.append(member.spare_bus[slots] * self._factors)
        return found
