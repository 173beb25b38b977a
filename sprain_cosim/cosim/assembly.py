"""A system that is open: its components' instances on one bus of values, and the moves that coupling schemes are made
of."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from fnmatch import fnmatchcase
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..contract import PLANT
from ..errors import InputError, SimulationError, nearest
from ..fmu.element import Element
from ..fmu.instance import Instance
from ..units import Unit
from .hand_over import HandOver
from .layout import Place, Slots
from .loops import make_consistent
from .native_members import NativeMembers
from .own_rate import OwnRate
from .rest import outputs_at_rest
from .schedule import Rate, Schedule, schedule

if TYPE_CHECKING:
    from .recorder import Recorder
    from .system import System

Values = NDArray[np.floating]


class Member:
    """One instance and its place on the bus, whose arrays are never written.

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

    def __init__(self, component: Element, instance: Instance, bus: Values, place: Place) -> None:
        self.name, self.component, self.instance, self.place = component.name, component, instance, place
        self.inputs, self.outputs = place.inputs, place.outputs
        self.input_values, self.output_values = bus[place.inputs], bus[place.outputs]
        self.sources, self.connected, self.unconnected = place.unconnected, place.connected, place.unconnected
        self.factor, self.offset, self.scaled = place.factor, place.offset, place.scaled
        self.feedthrough = place.feedthrough > 0
        self.fed_back = self.inputs_set = False
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
    native      the members for loops in C; None where one of them needs Python
    recorder    what is to be recorded while the plant passes; None where nothing is

    Order of the calls: start - (transfer, advance by the scheme, call)* - start again, or close. After a
    SimulationError only `close` may be called."""

    def __init__(self, system: System) -> None:
        self.system = system
        layout = self.layout = system.layout
        self.names, self.units, self.index, self.zero = layout.names, layout.units, layout.index, layout.zero
        self.bus = np.zeros(layout.size)
        self.record = self.bus[: self.zero]
        self.identified = layout.identified
        self.members: list[Member] = []
        self.stepping: list[Member] = []
        self.own_rate: dict[str, OwnRate] = {}
        self.recorder: Recorder | None = None
        self.native: NativeMembers | None = None
        self.parameters: Mapping[str, float] = {}
        self.time, self.stop = 0.0, math.inf
        self._started = False
        self._watched: list[tuple[Member, Values]] = []
        try:
            for component, place in zip(system.components, layout.places, strict=True):
                self._open(component, place)
        except BaseException:
            self.close()
            raise
        self._set_rates({})

    def _open(self, component: Element, place: Place) -> None:
        """Adds the component behind the members that are there."""
        member = Member(component, component.open(), self.bus, place)
        self.members.append(member)
        first, split, n = place.inputs.start, place.inputs.stop, place.inputs.stop - place.inputs.start
        inputs, outputs = place.own_names[:n], place.own_names[n:]
        member.instance.bind(self.bus, inputs, first, outputs, split, place.feedthrough)

    @cached_property
    def _hand_over(self) -> HandOver | None:
        return HandOver(self) if self.system.torques else None

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
            sources = member.connected if on else member.unconnected
            for outputs in held if on else ():
                from_held = (sources >= outputs.start) & (sources < outputs.stop)
                sources = np.where(from_held & (member.unconnected == self.zero), self.zero, sources)
            member.sources = sources
            if sources is member.unconnected:
                member.fed_back = member.place.fed_back_unconnected
            else:
                member.fed_back = member.place.fed_back_connected if not held else member.place.fed_back(sources)
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
        """From the slot's unit to SI, see Layout."""
        return self.layout.factor(slot)

    def si(self, slot: int) -> float:
        """The present value of a connector in SI."""
        unit = self.units[slot]
        return float(self.bus[slot]) if unit is None else unit.to_base(float(self.bus[slot]))

    def transfer(self, member: Member) -> None:
        """Sources to the member's inputs, on the bus only."""
        member.inputs_set = False
        self.bus.take(member.sources, None, member.input_values, "clip")
        if member.scaled:
            member.input_values *= member.factor
            member.input_values += member.offset

    def schedule(self, start: float, step: float, steps: int) -> Schedule:
        """Raises InputError."""
        return schedule(self.system.components, start, step, steps)

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
        self.native = NativeMembers.of(self)
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
        at_rest = self.layout.at_rest
        fed = {target: self.index[self.system.connections[target]] for target in at_rest}
        for member in self.members:
            if any(member.outputs.start <= slot < member.outputs.stop for slot in fed.values()):
                self.bus[member.outputs] = outputs_at_rest(self, member)
            if member.place.resting is not None:
                member.sources = member.place.resting
        for target, slot in fed.items():
            self.bus[at_rest[target]] = self.bus[slot]

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


def _is_of(name: str, pattern: str) -> bool:
    """A name may have brackets, which a pattern reads as a choice of letters."""
    return name == pattern or fnmatchcase(name, pattern)
