"""A system that is open: its components' instances on one bus of values, and the moves that coupling schemes are made
of."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..contract import PLANT, is_excitation, is_impedance
from ..errors import InputError, SimulationError, nearest
from ..fmu.element import Element
from ..fmu.instance import Instance
from ..units import Unit
from .hand_over import HandOver
from .loops import make_consistent
from .own_rate import OwnRate
from .rest import outputs_at_rest
from .schedule import Rate, Schedule, schedule

if TYPE_CHECKING:
    from .recorder import Recorder
    from .system import System

Values = NDArray[np.floating]
Slots = NDArray[np.intp]
NO_SLOTS: Slots = np.zeros(0, dtype=np.intp)


class Member:
    """One instance and its place on the bus.

    inputs, outputs    its slots on the bus
    input_values, output_values  views of them
    sources            the slots that its inputs are fed from; `connected` with stiffness and damping handed over,
                       `unconnected` with zeros in their place
    factor, offset     from the sources' units to those of the inputs; `scaled`: one of them matters
    feedthrough        some outputs follow the inputs directly
    fed_back           fed by a member that steps after it, so its inputs change once more when all have stepped
    inputs_set         the instance has the inputs that stand on the bus
    lag                by how many of its steps its torques are behind its inputs
    spare, spare_bus   a second instance for experiments, on a bus of its own
    """

    def __init__(self, component: Element, instance: Instance, bus: Values, inputs: slice, outputs: slice) -> None:
        self.name, self.component, self.instance = component.name, component, instance
        self.inputs, self.outputs = inputs, outputs
        self.input_values, self.output_values = bus[inputs], bus[outputs]
        self.sources = self.connected = self.unconnected = NO_SLOTS
        self.scaled = False
        self.factor = self.offset = np.zeros(0)
        self.feedthrough = self.fed_back = self.inputs_set = False
        self.lag = 0
        self.spare: Instance | None = None
        self.spare_bus = np.zeros(0)

    def close_spare(self) -> None:
        if self.spare is not None:
            self.spare.close()
            self.spare = None


class Assembly:
    """All instances of a system read and write one array.

    bus         (n,) the values, each in its connector's own unit
    names       of the slots of connectors, "component.connector"; after them the bus has slots of its own
    units       of the slots of connectors; None where none is declared
    index       {name: slot}
    record      the part of the bus that belongs to connectors
    identified  {input of the plant: slot of the identified stiffness or damping that may feed it}
    members     in the order in which they take their steps
    stepping    those of them that take every step
    own_rate    the others: called at a rate of their own
    parameters, time, stop  of the present run
    recorder    what is to be recorded while the plant passes; None where nothing is

    Order of the calls: start - (transfer, advance by the scheme, call)* - start again, or close. After a
    SimulationError only `close` may be called."""

    def __init__(self, system: System) -> None:
        self.system = system
        self.names: list[str] = []
        self.units: list[Unit | None] = []
        layouts = [member_layout(component, system) for component in system.components]
        for component, (inputs, outputs, _) in zip(system.components, layouts, strict=True):
            for name in (*inputs, *outputs):
                self.names.append(f"{component.name}.{name}")
                self.units.append(component.connectors[name].unit)
        # this slot stays 0, the source of what is not handed over; after it stand the values found by identification
        self.zero = len(self.names)
        rest = [target for target in system.connections if is_excitation(target) and target in self.names]
        self.bus = np.zeros(self.zero + 1 + len(system.undeclared) + len(rest))
        self.record = self.bus[: self.zero]
        self.index = {name: k for k, name in enumerate(self.names)}
        self.identified = {name: k for k, name in enumerate(system.undeclared, self.zero + 1)}
        self._at_rest = {name: k for k, name in enumerate(rest, self.zero + 1 + len(self.identified))}
        self.members: list[Member] = []
        self.stepping: list[Member] = []
        self.own_rate: dict[str, OwnRate] = {}
        self.recorder: Recorder | None = None
        self.parameters: Mapping[str, float] = {}
        self.time, self.stop = 0.0, math.inf
        self._started = False
        self._schedules: dict[tuple[float, float, int], Schedule] = {}
        self._watched: list[tuple[Member, Values]] = []
        try:
            for component, layout in zip(system.components, layouts, strict=True):
                self._open(component, *layout)
        except BaseException:
            self.close()
            raise
        for member in self.members:
            self._connect(member)
        self._hand_over = HandOver(self) if system.torques else None
        self._set_rates({})

    def _open(self, component: Element, inputs: Sequence[str], outputs: Sequence[str], feedthrough: int) -> None:
        """Adds the component behind the members that are there; its last `feedthrough` outputs follow its inputs."""
        first = self.members[-1].outputs.stop if self.members else 0
        split = first + len(inputs)
        places = slice(first, split), slice(split, split + len(outputs))
        member = Member(component, component.open(), self.bus, *places)
        self.members.append(member)
        member.instance.bind(self.bus, inputs, first, outputs, split, feedthrough)
        member.feedthrough = feedthrough > 0

    def _connect(self, member: Member) -> None:
        system, names = self.system, self.names[member.inputs]
        sources = [system.connections.get(name) for name in names]
        ends = list(zip(names, sources, strict=True))
        member.connected = np.array([self.index[s] if s else self.identified[n] for n, s in ends], dtype=np.intp)
        member.unconnected = np.where([is_impedance(n) for n in names], self.zero, member.connected).astype(np.intp)
        links = [
            system.links.get(n) or conversion(system.find(s).unit if s else None, system.find(n).unit) for n, s in ends
        ]
        member.factor, member.offset = np.array([f for f, _ in links]), np.array([b for _, b in links])
        member.scaled = any(link != (1.0, 0.0) for link in links)

    def _set_rates(self, rates: Mapping[str, Rate]) -> None:
        self.own_rate = {
            m.name: OwnRate(self, m, rates[m.name], self._hand_over) for m in self.members if m.name in rates
        }
        self.stepping = [m for m in self.members if m.name not in rates]
        self._carried = [own for own in self.own_rate.values() if not own.rate.sampled]
        self.hand_over(False)

    def hand_over(self, on: bool) -> None:
        """Connects stiffness and damping, those of sampled members excepted, or feeds zeros in their place."""
        held = [own.member.outputs for own in self.own_rate.values() if own.rate.sampled]
        for member in self.members:
            member.sources = member.connected.copy() if on else member.unconnected
            for outputs in held if on else ():
                from_held = (member.sources >= outputs.start) & (member.sources < outputs.stop)
                member.sources[from_held & (member.unconnected == self.zero)] = self.zero
            member.fed_back = bool((member.sources[member.sources < self.zero] >= member.outputs.stop).any())
            member.inputs_set = False

    def watch_locals(self, patterns: Sequence[str]) -> tuple[list[str], list[Unit | None]]:
        """Chooses local variables for `local_values`, by patterns such as "plant.*_force": their names and units.
        Raises InputError for a pattern that fits none of them and no connector; connectors are recorded anyway."""
        names: list[str] = []
        units: list[Unit | None] = []
        known = list(self.names)
        self._watched = []
        for member in self.members:
            found = {f"{member.name}.{n}": c for n, c in member.component.select("local").items() if c.scalar_number}
            known += found
            chosen = [n for n in found if any(_is_of(n, pattern) for pattern in patterns)]
            if chosen:
                values = np.zeros(len(chosen))
                member.instance.watch_locals([n.partition(".")[2] for n in chosen], values)
                self._watched.append((member, values))
                names += chosen
                units += [found[n].unit for n in chosen]
        for pattern in patterns:
            if not any(_is_of(n, pattern) for n in known):
                close = "" if "*" in pattern else nearest(pattern, known)
                raise InputError(f"recording {pattern!r}: no output, input or local number has such a name{close}")
        return names, units

    def local_values(self) -> Values:
        """The present values of the local variables that were chosen."""
        for member, _ in self._watched:
            member.instance.get_locals()
        return np.concatenate([values for _, values in self._watched])

    def feedback_slots(self, chosen: Callable[[str], bool]) -> Slots:
        """Slots of the inputs that `chosen` accepts by name, of members that are fed back, where what feeds them takes
        every step."""
        held = [own.member.outputs for own in self.own_rate.values()]
        slots = [
            k
            for m in self.stepping
            if m.fed_back
            for k, source in zip(range(m.inputs.start, m.inputs.stop), m.sources.tolist(), strict=True)
            if chosen(self.names[k]) and not any(outputs.start <= source < outputs.stop for outputs in held)
        ]
        return np.array(slots, dtype=np.intp)

    def factor(self, slot: int) -> float:
        """From the slot's unit to SI, offsets apart; 1 for slots of the bus itself and for undeclared units."""
        unit = self.units[slot] if slot < self.zero else None
        return unit.factor if unit else 1.0

    def si(self, name: str) -> float:
        """The present value of a connector in SI."""
        at = self.index[name]
        unit = self.units[at]
        return float(self.bus[at]) if unit is None else unit.to_base(float(self.bus[at]))

    def transfer(self, member: Member) -> None:
        """Sources to the member's inputs, on the bus only."""
        member.inputs_set = False
        self.bus.take(member.sources, None, member.input_values, "clip")
        if member.scaled:
            member.input_values *= member.factor
            member.input_values += member.offset

    def schedule(self, start: float, step: float, steps: int) -> Schedule:
        """Made once for all runs with these times. Raises InputError."""
        times = start, step, steps
        if times not in self._schedules:
            self._schedules[times] = schedule(self.system.components, *times)
        return self._schedules[times]

    def start(
        self, parameters: Mapping[str, float], time: float, stop: float, rates: Mapping[str, Rate] | None = None
    ) -> None:
        """Initialises all components; inputs and outputs are consistent afterwards. `rates` are those of the members
        that are called at a rate of their own. Raises SimulationError."""
        if self._started:
            for member in self.members:
                member.instance.reset()
        self._started = True
        self.parameters, self.time, self.stop = parameters, time, stop
        self.recorder = None
        self._set_rates(rates or {})
        self.bus[:] = 0.0
        for member in self.members:
            member.lag = 0
            member.instance.set_parameters(self.parameters_of(member))
        for member in self.members:
            member.instance.enter_initialization(time, stop)
        self._excite_at_rest()
        make_consistent(self)
        for member in self.members:
            member.instance.exit_initialization()
        self.hand_over(False)
        for member in self.members:
            member.instance.get_outputs()
        make_consistent(self)
        for own in self.own_rate.values():
            own.start()

    def _excite_at_rest(self) -> None:
        """Feeds excitations, while the components initialise, with what their sources give at rest: before the first
        stretch reaches a controller, its muscles have the activation that belongs to this. The first step has the
        excitations that answer to the stretch."""
        fed = {target: self.index[self.system.connections[target]] for target in self._at_rest}
        for member in self.members:
            if any(member.outputs.start <= slot < member.outputs.stop for slot in fed.values()):
                self.bus[member.outputs] = outputs_at_rest(self, member)
        for member in self.members:
            names = self.names[member.inputs]
            if any(name in fed for name in names):
                member.sources = np.array(
                    [self._at_rest.get(n, s) for n, s in zip(names, member.sources.tolist(), strict=True)],
                    dtype=np.intp,
                )
        for target, slot in fed.items():
            self.bus[self._at_rest[target]] = self.bus[slot]

    def parameters_of(self, member: Member) -> dict[str, float]:
        prefix = f"{member.name}."
        return {n.removeprefix(prefix): v for n, v in self.parameters.items() if n.startswith(prefix)}

    def advance(self, member: Member, time: float, step: float, all_outputs: bool = False) -> None:
        """One member takes its step with the inputs that stand on the bus. Outputs that `refresh_feedback` will fetch
        again are left out unless `all_outputs`.

        Raises SimulationError, also when an output is not finite."""
        instance = member.instance
        if not member.inputs_set:
            instance.set_inputs()
        if self.recorder is not None and member.name == PLANT:
            time, step = self._pass_records(self.recorder, member, time, step)
        instance.do_step(time, step)
        if member.fed_back and member.feedthrough and not all_outputs:
            instance.get_outputs_without_feedthrough()
        else:
            instance.get_outputs()
        member.inputs_set = False
        # the square of a large finite number may overflow: then every value is tested by itself
        if not math.isfinite(member.output_values @ member.output_values):
            self.check_outputs(member, time + step)

    def _pass_records(self, recorder: Recorder, plant: Member, time: float, step: float) -> tuple[float, float]:
        """Stops the plant where something is to be recorded within its step; its torques are carried on, so that the
        step is the same as in one piece. Returns what remains of the step: time and size [s]."""
        end = time + step
        rows = recorder.between(time, end)
        for row, at in rows:
            since = self._hand_over.motion() if self._hand_over else None
            plant.instance.do_step(time, at - time)
            plant.instance.get_outputs()
            self.check_outputs(plant, at)
            if self._hand_over and since is not None:
                self._hand_over.carry_on(since)
                plant.instance.set_inputs()
                if plant.feedthrough:
                    plant.instance.get_feedthrough_outputs()
            recorder.write_row(row)
            time = at
        return (time, end - time) if rows else (time, step)

    def check_outputs(self, member: Member, time: float) -> None:
        """Raises SimulationError where an output is not finite."""
        for name, value in zip(self.names[member.outputs], member.output_values.tolist(), strict=True):
            if not math.isfinite(value):
                raise SimulationError(f"{member.name}: {name.partition('.')[2]} = {value:g} at {time:.6g} s")

    def call(self, names: Sequence[str]) -> None:
        """Members with a rate of their own take their next step, up to the present point; members that are fed back
        take their new inputs. Raises SimulationError."""
        for name in names:
            self.own_rate[name].call()
        self.refresh_feedback(carry_on=False)

    def carry_on(self) -> None:
        """Moves the torques of members that are not called here on with the plant's motion."""
        for own in self._carried:
            own.carry_on()

    def refresh_feedback(self, carry_on: bool = True) -> None:
        """After all have stepped: members that are fed back take their new inputs, and their outputs with direct
        feed-through are fetched again."""
        if carry_on:
            self.carry_on()
        for member in self.stepping:
            if member.fed_back:
                self.transfer(member)
                member.instance.set_inputs()
                member.inputs_set = True
                if member.feedthrough:
                    member.instance.get_feedthrough_outputs()

    def save_before_steps(self) -> None:
        """From the next start on, every member that can saves its state before each of its steps."""
        for member in self.members:
            member.instance.save_before_steps()

    def close(self) -> None:
        for member in self.members:
            member.instance.close()
            member.close_spare()
        self.members = []


def member_layout(component: Element, system: System) -> tuple[list[str], list[str], int]:
    """The inputs and outputs that stand on the bus; the last so many outputs follow the inputs directly."""
    fed = [f"{component.name}.{n}" for n in component.inputs]
    inputs = [n.partition(".")[2] for n in fed if n in system.connections or n in system.undeclared]
    direct = {
        name: connector.depends_on is None or not set(inputs).isdisjoint(connector.depends_on)
        for name, connector in component.outputs.items()
        if connector.scalar_number
    }
    return inputs, sorted(direct, key=direct.__getitem__), sum(direct.values()) if inputs else 0


def conversion(source: Unit | None, target: Unit | None) -> tuple[float, float]:
    """Factor and offset from the source's unit to the target's; an undeclared unit is SI."""
    if source == target or (
        source is not None and target is not None and (source.factor, source.offset) == (target.factor, target.offset)
    ):
        return 1.0, 0.0
    source, target = source or Unit("1"), target or Unit("1")
    return source.factor / target.factor, (source.offset - target.offset) / target.factor


def _is_of(name: str, pattern: str) -> bool:
    """A name may have brackets, which a pattern reads as a choice of letters."""
    return name == pattern or fnmatchcase(name, pattern)
