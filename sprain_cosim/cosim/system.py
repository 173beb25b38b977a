"""Components and the connections between them: checked as a description, opened onto one bus of values.

Connections are keyed by their target, so an input cannot be fed twice. Devices connect themselves to the plant by name:
an input takes the plant's output of the same name, an output feeds the plant's input of the same name or of its name
behind `brace_`; `.`, `_` and letter case do not count. Stiffness and damping connections are made as well, but carry
values only under a scheme that hands them over."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from functools import cached_property

import numpy as np

from ..contract import PROFILES, plain
from ..errors import InputError, SimulationError, nearest
from ..fmu.component import Component, Connector, Instance
from ..units import Unit

HANDED_OVER = ("_stiffness", "_damping")
MAX_ROUNDS = 20
SETTLED = 1e-12  # relative to the larger of 1 and the value
FAR = 1e9


@dataclass(frozen=True)
class System:
    """`components` in the order in which they take their steps, `connections` {target: source} of "component.connector"
    names, `parameters` {"component.parameter": value in the parameter's own unit}."""

    components: tuple[Component, ...]
    connections: Mapping[str, str]
    parameters: Mapping[str, float] = field(default_factory=dict)

    def component(self, name: str) -> Component | None:
        return next((c for c in self.components if c.name == name), None)

    def find(self, full: str) -> Connector:
        """The connector of "component.connector". Raises InputError with the nearest name."""
        name, _, rest = full.partition(".")
        component = self.component(name)
        if component is None or not rest:
            raise InputError(f"{full}: no component {name!r}{nearest(name, [c.name for c in self.components])}")
        connector = component.connectors.get(rest)
        if connector is None:
            raise InputError(f"{full}: {name} has no variable {rest!r}{nearest(rest, component.connectors)}")
        return connector

    def check(self, communication_step: float | None = None) -> list[str]:
        """All problems, one line each; empty when the system can run."""
        problems: list[str] = []
        for target, source in self.connections.items():
            try:
                into, out_of = self.find(target), self.find(source)
            except InputError as problem:
                problems.append(f"connection {target} = {source}: {problem}")
                continue
            place = f"connection {target} = {source}"
            if into.causality != "input":
                problems.append(f"{place}: {target} is {_a(into.causality)}; only an input can be fed")
            if out_of.causality != "output":
                problems.append(f"{place}: {source} is {_a(out_of.causality)}; only an output can feed an input")
            for end in (into, out_of):
                if not end.scalar_number:
                    problems.append(f"{place}: {end.name} is of type {end.kind}; only scalar numbers can be connected")
            if into.unit and out_of.unit and not into.unit.same_dimension(out_of.unit):
                ends = [
                    f"{end} in {c.unit.name} ({c.unit.dimension()})"
                    for end, c in ((target, into), (source, out_of))
                    if c.unit
                ]
                problems.append(f"{place}: the units do not match: {', '.join(ends)}")
        for full in self.parameters:
            try:
                connector = self.find(full)
            except InputError as problem:
                problems.append(f"parameter {problem}")
                continue
            if connector.causality != "parameter":
                problems.append(f"parameter {full}: is {_a(connector.causality)}, not a parameter")
        for component in self.components:
            touched = any(end.split(".")[0] == component.name for pair in self.connections.items() for end in pair)
            if not touched and len(self.components) > 1 and component.name != "plant":
                problems.append(
                    f"{component.name}: connects to nothing; its variables match none of the plant's, so name the "
                    "connections in [connections]"
                )
            elif component.name == "brace" and not any(
                source.startswith("brace.") for source in self.connections.values()
            ):
                problems.append(
                    "brace: is moved by the plant but gives nothing back: none of its outputs "
                    f"({', '.join(component.outputs) or 'it has none'}) is named"
                    " A_torque for an axis A; give a mapping file (`sprain-cosim check` proposes one) or name it in "
                    "[connections]"
                )
        if communication_step is not None:
            problems += self.check_step(communication_step)
        return problems

    def check_step(self, h: float) -> list[str]:
        """Components that cannot take a communication step of `h` [s], one line each."""
        problems = []
        for component in self.components:
            own = component.capabilities.fixed_step
            if own is None:
                continue
            ratio = h / own
            if ratio < 0.999 or abs(ratio - round(ratio)) > 1e-6 * ratio:
                low = max(1, int(ratio))
                multiples = f"use {1e3 * low * own:g} ms or {1e3 * (low + 1) * own:g} ms"
                problems.append(
                    f"communication step {1e3 * h:g} ms: {component.name} takes only whole multiples of its own "
                    f"{1e3 * own:g} ms; {multiples}"
                )
        return problems

    @cached_property
    def torques(self) -> dict[str, str]:
        """{axis: the output that gives the torque about it} for all torques of devices on the plant."""
        plant = self.component("plant")
        outputs = plant.outputs if plant else {}
        axes = {
            target.removeprefix("plant.brace_").removesuffix("_torque"): source
            for target, source in self.connections.items()
        }
        return {
            a: s
            for a, s in axes.items()
            if f"plant.brace_{a}_torque" in self.connections and {f"{a}_angle", f"{a}_velocity"} <= set(outputs)
        }

    @cached_property
    def undeclared(self) -> dict[str, tuple[str, str]]:
        """{input of the plant: (torque, the plant's output it may depend on)} for stiffness and damping that the plant
        could use and the device does not declare. Declared about an axis without cross terms means that there are
        none."""
        plant = self.component("plant")
        found: dict[str, tuple[str, str]] = {}
        for kind, moved in (("stiffness", "angle"), ("damping", "velocity")):
            for axis, torque in self.torques.items():
                device = torque.partition(".")[0]
                for other in self.torques:
                    reads = any(
                        s == f"plant.{other}_{moved}" and t.startswith(f"{device}.")
                        for t, s in self.connections.items()
                    )
                    name = impedance_input(axis, other, kind)
                    if (
                        impedance_input(axis, axis, kind) not in self.connections
                        and reads
                        and plant
                        and name.partition(".")[2] in plant.inputs
                    ):
                        found[name] = torque, f"plant.{other}_{moved}"
        return found

    def open(self) -> Assembly:
        return Assembly(self)


def impedance_input(axis: str, other: str, kind: str) -> str:
    """The plant's input for -d(torque about `axis`)/d(angle or velocity of `other`); `kind` is stiffness or damping."""
    return f"plant.brace_{axis}_{kind}" if axis == other else f"plant.brace_{axis}_{other}_{kind}"


def connect(components: Sequence[Component], explicit: Mapping[str, str]) -> tuple[dict[str, str], list[str]]:
    """The explicit connections and those that devices make themselves, with the problems met."""
    connections, problems = dict(explicit), list[str]()
    plant = next((c for c in components if c.name == "plant"), None)
    if plant is None:
        return connections, problems
    outputs = {plain(n): n for n in plant.outputs}
    inputs = {plain(n): n for n in plant.inputs}
    for device in components:
        if device is plant:
            continue
        feeds = {}
        for name in device.outputs:
            target = inputs.get(plain(name)) or inputs.get("brace" + plain(name))
            if target:
                feeds[name] = target
        own = {source for source in explicit.values() if source.startswith(f"{device.name}.")}
        torques = {
            plain(n).removesuffix("torque")
            for n in feeds
            if f"{device.name}.{n}" not in own and plain(n).endswith("torque")
        }
        spanned = [p for p, axes in PROFILES.items() if p != "subtalar" and torques & {plain(a) for a in axes}]
        if len(spanned) > 1:
            problems.append(
                f"{device.name}: gives torques of several profiles ({', '.join(spanned)}); name the ones to use in "
                "[connections]"
            )
            continue
        for name in device.inputs:
            source = outputs.get(plain(name))
            if source:
                connections.setdefault(f"{device.name}.{name}", f"plant.{source}")
        for name, target in feeds.items():
            if f"{device.name}.{name}" in own:
                continue
            full = f"plant.{target}"
            other = connections.get(full)
            if other and full not in explicit:
                problems.append(f"{full}: fed by {other} and by {device.name}.{name}; keep one of the two devices")
            connections.setdefault(full, f"{device.name}.{name}")
    return connections, problems


def _a(word: str) -> str:
    return f"{'an' if word[:1] in 'aeiou' else 'a'} {word}"


class Member:
    """One instance and its place on the bus: inputs at `inputs`, outputs at `outputs`.

    `late`: fed by a member that steps after it, so its inputs change once more when all have stepped. `echoes`: some
    outputs follow the inputs at once. `sent`: it has the inputs that stand on the bus."""

    def __init__(
        self, component: Component, instance: Instance, bus: np.ndarray, inputs: slice, outputs: slice
    ) -> None:
        self.name, self.component, self.instance = component.name, component, instance
        self.inputs, self.outputs = inputs, outputs
        self.given, self.gives = bus[inputs], bus[outputs]
        self.sources = self.connected = self.unconnected = np.zeros(0, dtype=np.intp)
        self.scaled = False
        self.factor = self.offset = np.zeros(0)
        self.echoes = self.late = self.sent = False
        self.spare: Instance | None = None  # a second instance, for experiments
        self.spare_bus = np.zeros(0)


class Assembly:
    """A system that is open: every instance reads and writes one array, `bus`, whose slots are named by `names`.

    Order of the calls: start - (transfer, push, step, pull by the scheme)* - start again, or close."""

    def __init__(self, system: System) -> None:
        self.system = system
        self.names: list[str] = []
        self.units: list[Unit | None] = []
        lists = []
        for c in system.components:
            inputs = [
                n for n in c.inputs if f"{c.name}.{n}" in system.connections or f"{c.name}.{n}" in system.undeclared
            ]
            echo = {
                n: o.depends_on is None or not set(inputs).isdisjoint(o.depends_on)
                for n, o in c.outputs.items()
                if o.scalar_number
            }
            outputs = sorted(echo, key=echo.__getitem__)
            lists.append((c, inputs, outputs, sum(echo.values()) if inputs else 0))
        for component, inputs, outputs, _ in lists:
            for n in [*inputs, *outputs]:
                self.names.append(f"{component.name}.{n}")
                self.units.append(component.connectors[n].unit)
        # this slot stays 0, the source of what is not handed over; after it stand the values found by identification
        zero = len(self.names)
        self.bus = np.zeros(zero + 1 + len(system.undeclared))
        self.record = self.bus[:zero]
        self.index = {name: k for k, name in enumerate(self.names)}
        self.identified = {name: k for k, name in enumerate(system.undeclared, zero + 1)}
        self.members: list[Member] = []
        self.parameters: Mapping[str, float] = {}
        self.time, self.stop = 0.0, math.inf
        self._started = False
        try:
            at = 0
            for component, inputs, outputs, echoing in lists:
                first_output = at + len(inputs)
                member = Member(
                    component,
                    component.open(),
                    self.bus,
                    slice(at, first_output),
                    slice(first_output, first_output + len(outputs)),
                )
                self.members.append(member)
                member.instance.bind(self.bus, inputs, at, outputs, first_output, echoing)
                member.echoes = echoing > 0
                at = member.outputs.stop
        except BaseException:
            self.close()
            raise
        for member in self.members:
            names = self.names[member.inputs]
            sources = [system.connections.get(name) for name in names]
            member.connected = np.array(
                [self.index[s] if s else self.identified[n] for n, s in zip(names, sources, strict=True)], dtype=np.intp
            )
            member.unconnected = np.where([n.endswith(HANDED_OVER) for n in names], zero, member.connected).astype(
                np.intp
            )
            links = [
                _link(system.find(s).unit if s else None, system.find(n).unit)
                for n, s in zip(names, sources, strict=True)
            ]
            member.factor, member.offset = np.array([f for f, _ in links]), np.array([b for _, b in links])
            member.scaled = any(link != (1.0, 0.0) for link in links)
        self.hand_over(False)

    def hand_over(self, on: bool) -> None:
        """Connects stiffness and damping, or feeds zeros in their place."""
        for member in self.members:
            member.sources = member.connected if on else member.unconnected
            member.late = bool((member.sources[member.sources < len(self.names)] >= member.outputs.stop).any())
            member.sent = False

    def watch(self, patterns: Sequence[str]) -> tuple[list[str], list[Unit | None]]:
        """Local variables to fetch with `look`, by patterns such as "plant.*_force": their names and units."""
        names: list[str] = []
        units: list[Unit | None] = []
        self._watched: list[tuple[Member, np.ndarray]] = []
        for member in self.members:
            found = {f"{member.name}.{n}": c for n, c in member.component.select("local").items() if c.scalar_number}
            chosen = [n for n in found if any(fnmatchcase(n, pattern) for pattern in patterns)]
            if chosen:
                seen = np.zeros(len(chosen))
                member.instance.watch_locals([n.partition(".")[2] for n in chosen], seen)
                self._watched.append((member, seen))
                names += chosen
                units += [found[n].unit for n in chosen]
        return names, units

    def look(self) -> np.ndarray:
        """The present values of what is watched."""
        for member, _ in self._watched:
            member.instance.get_locals()
        return np.concatenate([seen for _, seen in self._watched])

    def slots(self, chosen: Callable[[str], bool]) -> np.ndarray:
        """Places on the bus of the inputs of late members that `chosen` accepts by name."""
        return np.array(
            [k for m in self.members if m.late for k in range(m.inputs.start, m.inputs.stop) if chosen(self.names[k])],
            dtype=np.intp,
        )

    def si(self, name: str) -> float:
        """The present value of a slot in SI."""
        at = self.index[name]
        unit = self.units[at]
        return float(self.bus[at]) if unit is None else unit.to_base(float(self.bus[at]))

    def transfer(self, member: Member) -> None:
        """Sources to the member's inputs, on the bus only."""
        member.sent = False
        self.bus.take(member.sources, None, member.given, "clip")
        if member.scaled:
            member.given *= member.factor
            member.given += member.offset

    def start(self, parameters: Mapping[str, float], time: float, stop: float) -> None:
        """Initialises all components; inputs and outputs agree afterwards. Raises SimulationError."""
        if self._started:
            for member in self.members:
                member.instance.reset()
        self._started = True
        self.parameters, self.time, self.stop = parameters, time, stop
        self.hand_over(False)
        self.bus[:] = 0.0
        for member in self.members:
            member.instance.set_parameters(self.parameters_of(member))
        for member in self.members:
            member.instance.enter_initialization(time, stop)
        self.agree()
        for member in self.members:
            member.instance.exit_initialization()
        for member in self.members:
            member.instance.get_outputs()
        self.agree()

    def parameters_of(self, member: Member) -> dict[str, float]:
        prefix = f"{member.name}."
        return {n.removeprefix(prefix): v for n, v in self.parameters.items() if n.startswith(prefix)}

    def agree(self) -> None:
        """Exchanges until nothing changes: direct feed-through between components is solved by substitution and, where
        it runs in a loop that this does not settle, by Newton's method. Raises SimulationError, naming the connections
        of the loop."""
        start, before = self.bus.copy(), self.bus.copy()
        ever = np.zeros(len(self.bus), dtype=bool)
        largest, growing = math.inf, 0
        for _ in range(MAX_ROUNDS):
            for member in self.members:
                self.transfer(member)
                member.instance.set_inputs()
                member.instance.get_outputs()
            for member in self.members:
                self.transfer(member)
            change = np.abs(self.bus - before) / np.maximum(1.0, np.abs(before))
            moving = ~(change <= SETTLED)
            if not moving.any():
                return
            if not growing:
                self._check_finite()
            ever |= moving
            growing = growing + 1 if not change.max() < largest else 0
            if growing == 3:
                break
            largest = change.max()
            before[:] = self.bus
        self._solve(
            start,
            np.array([k for m in self.members for k in range(m.inputs.start, m.inputs.stop) if ever[k]], dtype=np.intp),
        )

    def _solve(self, start: np.ndarray, loop: np.ndarray) -> None:
        """Newton's method with damped steps for the inputs at `loop` that equal the outputs which follow from them."""
        owners = [next(m for m in self.members if m.inputs.start <= k < m.inputs.stop) for k in loop]
        self.bus[:] = start
        z = self.bus[loop].copy()
        gap = self._gap(z, loop, self.members)
        for _ in range(MAX_ROUNDS):
            self._check_finite()
            scale = np.maximum(1.0, np.abs(z))
            if scale.max() > FAR:  # a solution at infinity is none
                break
            if np.abs(gap / scale).max(initial=0.0) <= SETTLED:
                return
            slope = np.empty((len(loop), len(loop)))
            for k, owner in enumerate(owners):
                moved = z.copy()
                moved[k] += 1e-6 * scale[k]
                slope[:, k] = (self._gap(moved, loop, [owner]) - gap) / (1e-6 * scale[k])
                self._gap(z, loop, [owner])
            step = np.linalg.lstsq(slope, gap, rcond=None)[0]
            for share in 0.5 ** np.arange(12):
                tried = self._gap(z - share * step, loop, self.members)
                if np.isfinite(tried).all() and np.abs(tried / scale).max() < np.abs(gap / scale).max():
                    break
            else:
                if np.abs(gap / scale).max() <= 1e3 * SETTLED:  # as near as the rounding of the components allows
                    self._gap(z, loop, self.members)
                    return
                break
            z, gap = z - share * step, tried
        names = [
            self.names[k]
            for k, open_ in zip(loop, np.abs(gap) > SETTLED * np.maximum(1.0, np.abs(z)), strict=True)
            if open_
        ]
        ends = ", ".join(f"{name} = {self.system.connections.get(name, 'what was identified')}" for name in names)
        raise SimulationError(f"the values at the start do not settle; no solution found for the loop through {ends}")

    def _gap(self, inputs: np.ndarray, loop: np.ndarray, changed: Iterable[Member]) -> np.ndarray:
        """`inputs` minus what the outputs that follow from them give; only `changed` members are asked again. The
        inputs stay on the bus."""
        self.bus[loop] = inputs
        for member in changed:
            member.instance.set_inputs()
            member.instance.get_outputs()
        for member in self.members:
            self.transfer(member)
        gap = inputs - self.bus[loop]
        self.bus[loop] = inputs
        return gap

    def _check_finite(self) -> None:
        if not np.isfinite(self.bus).all():
            bad = [n for n, v in zip(self.names, self.record, strict=True) if not math.isfinite(v)]
            first = next((n for n in bad if n not in self.system.connections), bad[0])
            raise SimulationError(f"{first} is not finite at the start")

    def advance(self, member: Member, time: float, step: float, whole: bool = False) -> None:
        """One member takes its step with the inputs that stand on the bus. Outputs that settle() fetches again are left
        out unless `whole`.

        Raises SimulationError, also when an output is not finite."""
        instance = member.instance
        if not member.sent:
            instance.set_inputs()
        instance.do_step(time, step)
        if member.late and member.echoes and not whole:
            instance.get_outputs_without_feedthrough()
        else:
            instance.get_outputs()
        member.sent = False
        if not math.isfinite(
            member.gives @ member.gives
        ):  # the square of a large finite number may overflow: look closer
            for name, value in zip(self.names[member.outputs], member.gives.tolist(), strict=True):
                if not math.isfinite(value):
                    raise SimulationError(f"{member.name}: {name.partition('.')[2]} = {value:g} at {time + step:.6g} s")

    def settle(self) -> None:
        """After all have stepped: inputs that are fed by later members take the new outputs, and outputs that follow
        them are read again."""
        for member in self.members:
            if member.late:
                self.transfer(member)
                member.instance.set_inputs()
                member.sent = True
                if member.echoes:
                    member.instance.get_feedthrough_outputs()

    def careful(self) -> None:
        """From the next start on, every member that can saves its state before each of its steps."""
        for member in self.members:
            member.instance.save_before_steps()

    def close(self) -> None:
        for member in self.members:
            member.instance.close()
            if member.spare is not None:
                member.spare.close()
        self.members = []


def _link(source: Unit | None, target: Unit | None) -> tuple[float, float]:
    """Factor and offset from the source's unit to the target's; an undeclared unit is SI."""
    if source == target or (
        source is not None and target is not None and (source.factor, source.offset) == (target.factor, target.offset)
    ):
        return 1.0, 0.0
    source, target = source or Unit("1"), target or Unit("1")
    return source.factor / target.factor, (source.offset - target.offset) / target.factor


def problems_to_error(place: str, problems: Iterable[str]) -> None:
    """Raises one InputError in one line for all problems; nothing for none."""
    found = list(dict.fromkeys(problems))
    if len(found) == 1:
        raise InputError(f"{place}: {found[0]}")
    if found:
        raise InputError(f"{place}: {len(found)} problems: " + "; ".join(f"({k}) {p}" for k, p in enumerate(found, 1)))
