"""Components and the connections between them: a description, checked before anything runs, opened by `System.open`.

Connections are keyed by their target, so an input cannot be fed twice. Devices connect themselves to the plant by name:
an input takes the plant's output of the same name, an output feeds the plant's input of the same name or of its name
behind `brace_`; `.`, `_` and letter case do not count. Stiffness and damping connections are made as well, but carry
values only under a scheme that hands them over."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache

from ..contract import PLANT, PROFILES, plain
from ..errors import InputError, nearest
from ..fmu.element import Connector, Element, Same
from ..metrics import Signals
from ..notebook import Card, Rows
from ..units import shown_unit
from .assembly import Assembly
from .layout import Layout, layout
from .schedule import is_multiple

LEFT = "outside what its FMU is declared for"


@dataclass(frozen=True, repr=False)
class System(Card):
    """What is coupled, as a description.

    components   in the order in which they take their steps
    connections  {target: source}, both as "component.connector"
    parameters   {"component.parameter": value in the parameter's own unit}
    derived      {"owner.name": what may be set besides} of no component: its owner makes parameters of it
    links        {target: (factor, offset)} from the number at the source to that at the target, where the units of the
                 two do not say it

    >>> import sprain_cosim as sc
    >>> system = sc.load_scenario("incline30_brace").system()
    >>> system.connections["brace.rotation_x_angle"]
    'plant.rotation_x_angle'
    >>> system.find("plant.drop_height").unit.name
    'm'
    """

    components: tuple[Element, ...]
    connections: Mapping[str, str]
    parameters: Mapping[str, float] = field(default_factory=dict)
    derived: Mapping[str, Connector] = field(default_factory=dict)
    links: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    @cached_property
    def _by_name(self) -> dict[str, Element]:
        """The first of a name counts."""
        return {c.name: c for c in reversed(self.components)}

    @cached_property
    def _owners(self) -> frozenset[str]:
        return frozenset(other.partition(".")[0] for other in self.derived)

    def left_ranges(self, run: Signals) -> list[str]:
        """The inputs that left the range which their FMU declares: what it was made or measured for. A line each."""
        found = []
        for name, connector in self.layout.bounded:
            if name not in run.index:
                continue
            values = run[name]
            low, high = float(values.min()), float(values.max())
            if low < connector.minimum or high > connector.maximum:
                factor, unit = shown_unit(connector.unit)
                reached, declared = (
                    f"{factor * a:.4g} ... {factor * b:.4g}"
                    for a, b in ((low, high), (connector.minimum, connector.maximum))
                )
                found.append(f"{name} goes over {reached} {unit}".rstrip() + f", {LEFT}, {declared} {unit}".rstrip())
        return found

    def card(self) -> tuple[str, Rows]:
        wired = [f"{target} = {source}" for target, source in self.connections.items()]
        rows = [("connections", f"{len(wired)}: {', '.join(wired)}"), ("parameters set", str(len(self.parameters)))]
        return ", ".join(c.name for c in self.components), rows

    def component(self, name: str) -> Element | None:
        return self._by_name.get(name)

    def find(self, full: str) -> Connector:
        """The connector of "component.connector". Raises InputError with the nearest name."""
        if full in self.derived:
            return self.derived[full]
        name, _, rest = full.partition(".")
        if rest and name in self._owners:
            raise InputError(f"{full}: no such name{nearest(full, self.derived)}")
        component = self.component(name)
        if component is None or not rest:
            raise InputError(f"{full}: no component {name!r}{nearest(name, [c.name for c in self.components])}")
        connector = component.connectors.get(rest)
        if connector is None:
            raise InputError(f"{full}: {name} has no variable {rest!r}{nearest(rest, component.connectors)}")
        return connector

    def settable(self, full: str) -> Connector:
        """The connector of a parameter, or of an input that nothing feeds. Raises InputError for any other."""
        connector = self.find(full)
        if connector.causality not in ("parameter", "input"):
            raise InputError(f"{full}: is {_a(connector.causality)}, not a parameter")
        if connector.causality == "input" and (full in self.connections or full in self.undeclared):
            source = self.connections.get(full) or "what is measured of the device"
            raise InputError(
                f"{full}: is an input, not a parameter; {source} feeds it, and a value holds only where nothing does"
            )
        return connector

    def in_own_units(self, values: Mapping[str, float | str]) -> dict[str, float]:
        """{"component.parameter": number}: numbers are in the parameter's own unit already and stay as they are, a text
        such as "0.35 m" or a choice is read. Raises InputError for a name that cannot be set, a number or a text that
        does not fit, and anything else."""
        return {full: self.settable(full).number(value, full) for full, value in values.items()}

    def check(self, communication_step: float | None = None, span: float = 0.0) -> list[str]:
        """All problems, one line each; empty when the system can run for `span` [s] at `communication_step` [s]."""
        connections, components = self._wrong
        problems = [*connections, *(p for full in self.parameters for p in self._check_parameter(full)), *components]
        if communication_step is not None:
            problems += self.check_step(communication_step, span)
        return problems

    @cached_property
    def _wrong(self) -> tuple[list[str], list[str]]:
        """Problems of the connections, and of the components."""
        return (
            [p for target, source in self.connections.items() for p in self._check_connection(target, source)],
            [p for component in self.components for p in self._check_component(component)],
        )

    def check_step(self, h: float, span: float = 0.0) -> list[str]:
        """What keeps the plant from taking a communication step of `h` [s]; other components are called at their own
        rate. Steps that it proposes are parts of `span` [s]."""
        plant = self.component(PLANT)
        own = plant.capabilities.fixed_step if plant else None
        if own is None or is_multiple(h, own):
            return []
        most = max(1, round(span / own)) if span else int(h / own) + 1
        steps = [k * own for k in range(1, min(most, 10_000) + 1) if not span or is_multiple(span, k * own)]
        near = [*[s for s in steps if s < h][-1:], *[s for s in steps if s > h][:1]]
        return [
            f"communication step {1e3 * h:g} ms: {PLANT} takes only whole multiples of its own {1e3 * own:g} ms; "
            f"use {' or '.join(f'{1e3 * s:.12g} ms' for s in near) or 'another stop'}"
        ]

    def _check_connection(self, target: str, source: str) -> list[str]:
        place = f"connection {target} = {source}"
        try:
            into, out_of = self.find(target), self.find(source)
        except InputError as problem:
            return [f"{place}: {problem}"]
        problems = []
        if into.causality != "input":
            problems.append(f"{place}: {target} is {_a(into.causality)}; only an input can be fed")
        if out_of.causality != "output":
            problems.append(f"{place}: {source} is {_a(out_of.causality)}; only an output can feed an input")
        for end in (into, out_of):
            if not end.scalar_number:
                problems.append(f"{place}: {end.name} is of type {end.kind}; only scalar numbers can be connected")
        if target not in self.links and into.unit and out_of.unit and not into.unit.same_dimension(out_of.unit):
            ends = ((target, into.unit), (source, out_of.unit))
            units = ", ".join(f"{name} in {unit.name} ({unit.dimension()})" for name, unit in ends)
            problems.append(f"{place}: the units do not match: {units}")
        return problems

    def _check_parameter(self, full: str) -> list[str]:
        try:
            self.settable(full)
        except InputError as problem:
            return [f"parameter {problem}"]
        return []

    def _check_component(self, component: Element) -> list[str]:
        ends = {end.partition(".")[0] for pair in self.connections.items() for end in pair}
        if component.name not in ends and len(self.components) > 1 and component.name != PLANT:
            return [
                f"{component.name}: connects to nothing; its variables match none of the plant's, so name the "
                "connections in [connections]"
            ]
        if component.name == "brace" and not any(s.startswith("brace.") for s in self.connections.values()):
            return [
                "brace: is moved by the plant but gives nothing back: none of its outputs "
                f"({', '.join(component.outputs) or 'it has none'}) is named"
                " A_torque for an axis A; give a mapping file (`sprain-cosim check` proposes one) or name it in "
                "[connections]"
            ]
        return []

    @cached_property
    def layout(self) -> Layout:
        return layout(self.components, self.connections, self.links)

    @property
    def torques(self) -> Mapping[str, str]:
        """{axis: the output that gives the torque about it} for all torques of devices on the plant."""
        return self.layout.torques

    @property
    def undeclared(self) -> Mapping[str, tuple[str, str]]:
        """{input of the plant: (torque, the plant's output it may depend on)} for stiffness and damping that the plant
        could use and the device does not declare."""
        return self.layout.undeclared

    def open(self) -> Assembly:
        """All components opened on one bus. Raises SimulationError or EnvironmentProblem."""
        return Assembly(self)


def coupled(
    components: Iterable[Element], explicit: Mapping[str, str], complete: Iterable[str] = ()
) -> tuple[System, tuple[str, ...]]:
    """The system of the components as `connect` connects them, with the problems met: the same object for the very same
    components and connections."""
    return _coupled(tuple(map(Same, components)), tuple(explicit.items()), tuple(complete))


@lru_cache(maxsize=16)
def _coupled(
    components: tuple[Same, ...], explicit: tuple[tuple[str, str], ...], complete: tuple[str, ...]
) -> tuple[System, tuple[str, ...]]:
    elements = tuple(same.element for same in components)
    connections, problems = connect(elements, dict(explicit), complete)
    return System(elements, connections), tuple(problems)


def connect(
    components: Sequence[Element], explicit: Mapping[str, str], complete: Collection[str] = ()
) -> tuple[dict[str, str], list[str]]:
    """The explicit connections and those that devices make themselves, but for those whose connections are `complete`,
    with the problems met."""
    connections, problems = dict(explicit), list[str]()
    plant = next((c for c in components if c.name == PLANT), None)
    if plant is None:
        return connections, problems
    for device in components:
        if device is not plant and device.name not in complete:
            problems += _connect_device(device, plant, explicit, connections)
    return connections, problems


def _connect_device(
    device: Element, plant: Element, explicit: Mapping[str, str], connections: dict[str, str]
) -> list[str]:
    """Adds the device's connections to `connections`; returns the problems met."""
    outputs = {plain(n): n for n in plant.outputs}
    inputs = {plain(n): n for n in plant.inputs}
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
        return [
            f"{device.name}: gives torques of several profiles ({', '.join(spanned)}); name the ones to use in "
            "[connections]"
        ]
    for name in device.inputs:
        source = outputs.get(plain(name))
        if source:
            connections.setdefault(f"{device.name}.{name}", f"{PLANT}.{source}")
    problems = []
    for name, target in feeds.items():
        if f"{device.name}.{name}" in own:
            continue
        full = f"{PLANT}.{target}"
        other = connections.get(full)
        if other and full not in explicit:
            problems.append(f"{full}: fed by {other} and by {device.name}.{name}; keep one of the two devices")
        connections.setdefault(full, f"{device.name}.{name}")
    return problems


def _a(word: str) -> str:
    return f"{'an' if word[:1] in 'aeiou' else 'a'} {word}"
