"""A structure without its levels: the FMUs of all systems under one name each, who feeds whom through which linear
transformation, and what is set."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from ..cosim.layout import conversion
from ..errors import InputError, nearest, problems_to_error
from ..fmu.component import Component
from ..fmu.element import Connector
from ..units import Unit
from .elements import NUMERALS, REALS
from .package import Package
from .structure import Handed, Part, Port, Structure, Wire, structure
from .values import Assigned

Node = tuple[tuple[str, ...], str]  # names of the systems and the element, from the outermost; connector
Affine = tuple[float, float]  # factor * value + offset arrives
SETTABLE = ("parameter", "structuralParameter")
JOINED = ("input", "output", *SETTABLE)  # kinds of connectors that connections join
KINDS = {  # of a connector of an FMU, by the type that a document states
    **dict.fromkeys(REALS, ("real",)),
    **dict.fromkeys(NUMERALS, ("integer", "enumeration")),
    "Boolean": ("boolean",),
    "Enumeration": ("enumeration", "integer"),
    "String": ("string",),
    "Binary": ("binary",),
}


@dataclass(frozen=True)
class Feed:
    """What feeds an input.

    source  "component.output", or the name of an input of the outermost system
    link    from the number at the source to that at the target; None: as their units say
    outer   whether the source is an input of the outermost system
    unit    of the number at a connector of the outermost system; None: nothing says it, or none is an end
    unclear  what keeps that unit from being known, in a line; empty for nothing
    """

    source: str
    link: Affine | None = None
    outer: bool = False
    unit: Unit | None = None
    unclear: str = ""


@dataclass(frozen=True)
class Flat:
    """A structure without its levels.

    path        of the package
    components  {name: the FMU as it describes itself}, in the order of the document
    feeds       {"component.input": its source}
    inputs      {input of the outermost system: {"component.input": its feed}}
    outputs     {output of the outermost system: its feed}
    units       {"component.variable": what the document states and the FMU does not}
    parameters  {"component.variable": value as a scenario file has it}
    devices     {component: what our annotation says of it}
    hand_over   connections that our master alone makes
    structure   of which it comes
    notes       what was renamed or left out, one line each
    """

    path: Path
    components: Mapping[str, Component]
    feeds: Mapping[str, Feed]
    inputs: Mapping[str, Mapping[str, Feed]]
    outputs: Mapping[str, Feed]
    units: Mapping[str, Unit]
    parameters: Mapping[str, float | str | bool]
    devices: Mapping[str, Mapping[str, str]]
    hand_over: Sequence[Handed]
    structure: Structure
    notes: Sequence[str] = field(default=())


def flattened(path: Path) -> Flat:
    """The system of a package. Raises InputError with all problems in one line."""
    package = Package.read(path)
    return _Flattening(package, structure(package)).result()


@dataclass
class _Number:
    """A number on its way along a chain of connections.

    unit            of it; None: nothing says it
    factor, offset  factor * number at the source + offset is the number here
    plain           whether nothing but conversions of units changed it
    unsaid          why its unit is not known for sure, in a line; empty where it is
    """

    unit: Unit | None
    factor: float = 1.0
    offset: float = 0.0
    plain: bool = True
    unsaid: str = ""

    def arrive(self, node: Node, wire: Wire, own: Unit | None) -> None:
        """At a connector in the unit `own`; None where it states none. Raises InputError."""
        change, both = wire.transformation, own is not None and self.unit is not None
        alike = own is None or self.unit is None or own.equivalent(self.unit)
        if own is not None and not alike and not wire.suppressed:
            self._convert(own)
        self.plain &= change is None and (not wire.suppressed or (both and alike))
        if change is not None:
            self.factor, self.offset = change.factor * self.factor, change.factor * self.offset + change.offset
        if own is not None:
            self.unit, self.unsaid = own, ""
        elif wire.suppressed:
            self.unit = None
        elif change is not None and self.unit is not None:
            self.unsaid = _unsaid(node, self.unit)

    def _convert(self, own: Unit) -> None:
        assert self.unit is not None
        wrong = self.unsaid or unlike(self.unit, own)
        if wrong:
            raise InputError(wrong)
        scale = self.unit.factor / own.factor
        self.factor *= scale
        self.offset = scale * self.offset + (self.unit.offset - own.offset) / own.factor


class _Flattening:
    def __init__(self, package: Package, described: Structure) -> None:
        self.package, self.described = package, described
        self.problems, self.notes = list[str](), list(described.notes)
        self.parts = dict(_walk(described.system, ()))
        self.fmus = {path: part for path, part in self.parts.items() if part.source is not None}
        self.names = self._named()
        self.components: dict[tuple[str, ...], Component] = {}
        for path, part in self.fmus.items():
            try:
                self.components[path] = _component(part, self.names[path])
            except InputError as problem:
                self.problems.append(f"component {'.'.join(path)}: {problem}")
        problems_to_error(str(package.path), self.problems)  # nothing below makes sense without them
        self.origin: dict[Node, tuple[Node, Wire]] = {}

    def result(self) -> Flat:
        units = self._units()
        for path, part in self.parts.items():
            for wire in part.wires:
                self._connect(path, wire)
        feeds, inputs = self._feeds()
        own = self.described.system.ports
        outputs = {n: f for n, p in own.items() if p.kind == "output" and (f := self._feed(((), n))) is not None}
        for kind, used, what in (("input", inputs, "leads nowhere"), ("output", outputs, "is fed by nothing")):
            self.notes += [
                f"{kind} {n} of the system {what}" for n, p in own.items() if p.kind == kind and n not in used
            ]
        parameters, hand_over = self._parameters(feeds), self._handed(feeds)
        self._say_what_is_silent([*feeds, *(t for fed in inputs.values() for t in fed), *parameters], hand_over)
        problems_to_error(str(self.package.path), self.problems)
        return Flat(
            self.package.path,
            {c.name: c for c in self.components.values()},
            feeds,
            inputs,
            outputs,
            units,
            parameters,
            {self.names[path]: part.device for path, part in self.fmus.items() if part.device},
            hand_over,
            self.described,
            tuple(self.notes),
        )

    # ---- names and units

    def _named(self) -> dict[tuple[str, ...], str]:
        """One name for each FMU, of letters, digits and _."""
        names: dict[tuple[str, ...], str] = {}
        for path in self.fmus:
            plain = re.sub(r"\W", "_", "_".join(path), flags=re.ASCII)
            plain = plain if plain[:1].isalpha() else f"c{plain}"
            if plain in names.values():
                self.problems.append(
                    f"component {'.'.join(path)}: another one is called {plain} here as well; rename it"
                )
            if plain != ".".join(path):
                self.notes.append(f"component {'.'.join(path)} is called {plain} here")
            names[path] = plain
        return names

    def _units(self) -> dict[str, Unit]:
        """What the document states and the FMU does not; a contradiction is a problem."""
        found: dict[str, Unit] = {}
        for path, part in self.fmus.items():
            component = self.components[path]
            for port in part.ports.values():
                connector = component.connectors.get(port.name)
                wrong = _contradiction(port, connector, component.fmu.name)
                if wrong:
                    self.problems.append(f"connector {'.'.join(path)}.{port.name}: {wrong}")
                elif connector is not None and port.unit is not None and connector.unit is None:
                    found[f"{self.names[path]}.{port.name}"] = port.unit
        self.units = found
        return found

    def _unit(self, node: Node) -> Unit | None:
        path, name = node
        if path not in self.components:
            port = self.parts[path].ports.get(name)
            return None if port is None else port.unit
        connector = self.components[path].connectors.get(name)
        own = None if connector is None else connector.unit
        return own or self.units.get(f"{self.names[path]}.{name}")

    # ---- connections

    def _connect(self, path: tuple[str, ...], wire: Wire) -> None:
        """Notes where the target of a connection of the system at `path` comes from."""
        nodes, gives = list[Node](), list[bool]()
        for element, name in wire.ends:
            at = (*path, element) if element else path
            if at not in self.parts:
                self.problems.append(f"{wire.words}: there is no element {element}")
                return
            kind = self._kind((at, name))
            if not kind:
                self.problems.append(f"{wire.words}: {element or 'the system'} has no connector {name}")
                return
            if kind not in JOINED:
                self.problems.append(f"{wire.words}: {name} is of kind {kind}, whose connections are not supported")
                return
            nodes.append((at, name))
            gives.append((kind == "output") == bool(element))
        if gives[0] == gives[1]:
            self.problems.append(f"{wire.words}: joins two that {'give' if gives[0] else 'take'}")
            return
        source, target = nodes if gives[0] else reversed(nodes)
        if self._kind(target) in SETTABLE and self._kind(source) not in SETTABLE:
            self.problems.append(f"{wire.words}: a parameter can be fed by a parameter of the system around it only")
            return
        if target in self.origin:
            self.problems.append(f"{wire.words}: {'.'.join((*target[0], target[1]))} is fed twice")
        self.origin[target] = source, wire

    def _kind(self, node: Node) -> str:
        """input, output, parameter ... of a connector; "" where there is none. What the FMU says goes before what the
        document says."""
        path, name = node
        if path in self.components:
            connector = self.components[path].connectors.get(name)
            return "" if connector is None else connector.causality
        port: Port | None = self.parts[path].ports.get(name)
        return "" if port is None else port.kind

    def _feeds(self) -> tuple[dict[str, Feed], dict[str, dict[str, Feed]]]:
        feeds, inputs = dict[str, Feed](), dict[str, dict[str, Feed]]()
        for path, component in self.components.items():
            for name in component.inputs:
                feed = self._feed((path, name))
                if feed is None:
                    continue
                target = f"{component.name}.{name}"
                if feed.outer:
                    inputs.setdefault(feed.source, {})[target] = feed
                else:
                    feeds[target] = feed
        return feeds, inputs

    def _feed(self, target: Node) -> Feed | None:
        """Where a connector's value comes from, through all systems; None where nothing feeds it."""
        chain, node = list[tuple[Node, Wire]](), target
        while node in self.origin:
            source, wire = self.origin[node]
            if len(chain) > len(self.origin):
                self.problems.append(f"{wire.words}: the connections of systems form a circle")
                return None
            chain.append((node, wire))
            node = source
        path, name = node
        if not chain or (path and path not in self.components) or self._kind(node) in SETTABLE:
            return None  # an input of a system that nothing feeds, or a parameter, whose value is set
        full = f"{self.names[path]}.{name}" if path else name
        return self._linked(Feed(full, outer=not path), node, chain[::-1])

    def _linked(self, feed: Feed, source: Node, chain: Sequence[tuple[Node, Wire]]) -> Feed:
        """The feed with the linear transformation along a chain of connections from its source."""
        ends = self._unit(source), self._unit(chain[-1][0])
        unit = ends[0]
        if feed.outer:
            unit, unclear = (unit, "") if unit is not None else self._deduced(source, chain)
            feed = replace(feed, unit=unit, unclear=unclear)
        number = _Number(unit)
        for node, wire in chain:
            try:
                number.arrive(node, wire, self._unit(node))
            except InputError as problem:
                self.problems.append(f"{wire.words}: {problem}")
                return feed
        if not chain[-1][0][0]:  # at an output of the outermost system
            coherent = number.unit is None or _coherent(number.unit)
            feed = replace(feed, unit=number.unit, unclear="" if coherent else number.unsaid)
        link = number.factor, number.offset
        as_units_say = number.plain and (None not in ends or link == conversion(*ends))
        return feed if as_units_say else replace(feed, link=link)

    def _deduced(self, source: Node, chain: Sequence[tuple[Node, Wire]]) -> tuple[Unit | None, str]:
        """The unit of a connector that states none: the first that is stated along the chain, as the standard proposes;
        and why it cannot be known where a transformation stands between."""
        for k, (node, wire) in enumerate(chain):
            own = self._unit(node)
            if wire.suppressed:
                break
            if own is not None:
                changed = any(w.transformation is not None for _, w in chain[: k + 1])
                return own, _unsaid(source, own) if changed and not _coherent(own) else ""
        return None, ""

    def _handed(self, feeds: Mapping[str, Feed]) -> list[Handed]:
        """Under the components' names here."""
        found = list[Handed]()
        for path, part in self.parts.items():
            for handed in part.hand_over:
                ends = list[str]()
                for end in (handed.source, handed.target):
                    component, _, name = end.partition(".")
                    at = (*path, component)
                    if at not in self.components or name not in self.components[at].connectors:
                        self.problems.append(f"annotation HandOver: {end}: there is no such connector")
                        continue
                    ends.append(f"{self.names[at]}.{name}")
                if len(ends) == 2:
                    if ends[1] in feeds or ends[1] in [other.target for other in found]:
                        self.problems.append(f"annotation HandOver: {handed.target} is fed twice")
                    found.append(Handed(ends[0], ends[1], handed.link))
        return found

    def _say_what_is_silent(self, reached: Collection[str], hand_over: Sequence[Handed]) -> None:
        """Notes inputs that the document states and nothing feeds or sets, and connectors that it uses without stating
        them: a connection that was forgotten looks like these."""
        reached = {*reached, *(handed.target for handed in hand_over)}
        used = {end: None for target, (source, _) in self.origin.items() for end in (source, target)}
        for path, part in self.fmus.items():
            own = [n for n, port in part.ports.items() if self._kind((path, n)) == "input"]
            unfed = [n for n in own if f"{self.names[path]}.{n}" not in reached]
            unstated = [n for at, n in used if at == path and n not in part.ports]
            for names, what in (
                (unfed, "stated as inputs and fed by nothing; their start values hold"),
                (unstated, "connected and not stated among the connectors; the FMU's own count"),
            ):
                if names:
                    more = f" and {len(names) - 3} more" if len(names) > 3 else ""
                    self.notes.append(f"{self.names[path]}: {', '.join(names[:3])}{more}: {what}")

    # ---- values

    def _parameters(self, feeds: Mapping[str, Feed]) -> dict[str, float | str | bool]:
        """Values of the deepest element first: what a system around it assigns goes before them."""
        assigned: dict[Node, Assigned] = {}
        for path in sorted(self.parts, key=len, reverse=True):
            for value in self.parts[path].values:
                found = self._targets(path, value.name, value)
                if not found:
                    hint = nearest(value.name, self.components[path].parameters) if path in self.components else ""
                    self.notes.append(f"{value.place}: {value.name}: there is no such parameter{hint}; left out")
                assigned |= found
        return self._written(assigned, feeds)

    def _written(self, assigned: Mapping[Node, Assigned], feeds: Mapping[str, Feed]) -> dict[str, float | str | bool]:
        found: dict[str, float | str | bool] = {}
        for (path, name), value in assigned.items():
            full, connector = f"{self.names[path]}.{name}", self._connector(path, name)
            if full in feeds:
                self.notes.append(f"{full}: is fed by {feeds[full].source}; its start value is left out")
            elif connector.causality not in ("parameter", "input"):
                self.problems.append(
                    f"{value.place}: {name}: is of causality {connector.causality}; only parameters, and inputs that "
                    "nothing feeds, can be set"
                )
            else:
                try:
                    found[full] = value.value(connector)
                except InputError as problem:
                    self.problems.append(str(problem))
        return found

    def _connector(self, path: tuple[str, ...], name: str) -> Connector:
        connector = self.components[path].connectors[name]
        unit = self.units.get(f"{self.names[path]}.{name}")
        return connector if unit is None else replace(connector, unit=unit)

    def _targets(self, path: tuple[str, ...], name: str, value: Assigned) -> dict[Node, Assigned]:
        """The FMUs' variables that a name means at `path`, all of them where it means several, and the value there."""
        if path in self.components:
            return {(path, name): value} if name in self.components[path].connectors else {}
        found = dict[Node, Assigned]()
        if name in self.parts[path].ports:
            found |= self._fed_by((path, name), value)
        for part in self.parts[path].parts:
            if name.startswith(f"{part.name}."):
                found |= self._targets((*path, part.name), name.removeprefix(f"{part.name}."), value)
        return found

    def _fed_by(self, node: Node, value: Assigned) -> dict[Node, Assigned]:
        """The FMUs' variables that take the value of a connector of a system, and the value in the unit that this
        states."""
        unit = self._unit(node)
        if unit is not None:
            try:
                value = value.at(unit)
            except InputError as problem:
                self.problems.append(str(problem))
                return {}
        found = dict[Node, Assigned]()
        for target, (source, wire) in self.origin.items():
            if source != node:
                continue
            if wire.transformation is not None or wire.suppressed:
                self.problems.append(
                    f"{wire.words}: a value that is set at {node[1]} would go through its transformation, which is not "
                    "supported; set it at the component"
                )
            found |= {target: value} if target[0] in self.components else self._fed_by(target, value)
        return found


def _coherent(unit: Unit) -> bool:
    return (unit.factor, unit.offset) == (1.0, 0.0)


def unlike(one: Unit, other: Unit) -> str:
    """Why there is no conversion between two units; empty where there is one."""
    if one.same_dimension(other):
        return ""
    return f"the units do not match: {one.name} ({one.dimension()}) and {other.name} ({other.dimension()})"


def _unsaid(node: Node, unit: Unit) -> str:
    return (
        f"{'.'.join((*node[0], node[1]))} states no unit, and a transformation stands between it and {unit.name}; "
        "state its unit, or suppress the conversion"
    )


def _contradiction(port: Port, connector: Connector | None, fmu: str) -> str:
    """How a connector of the document is not that of the FMU; empty where it is."""
    if connector is None:
        return f"{fmu} has no such variable"
    alike = {"constant": ("output", "local"), "unspecified": (connector.causality,)}.get(port.kind, (port.kind,))
    if connector.causality not in alike:
        return f"is of kind {port.kind} in the document and {connector.causality} in the FMU"
    if port.type and connector.kind not in (*KINDS[port.type], "array", "clock"):
        return f"is of type {port.type} in the document and {connector.kind} in the FMU"
    if port.unit is not None and connector.unit is not None and not port.unit.equivalent(connector.unit):
        return f"its unit is {port.unit.name} in the document and {connector.unit.name} in the FMU"
    return ""


def _component(part: Part, name: str) -> Component:
    """The FMU of a part. Raises InputError, also where the document asks for another of its interfaces than the one
    that is driven here."""
    assert part.source is not None
    file = part.source.kept()
    try:
        component = Component.read(name, file)
    except InputError as problem:
        raise InputError(str(problem).replace(str(file), part.source.label)) from None
    driven = "ModelExchange" if component.capabilities.model_exchange else "CoSimulation"
    if part.implementation not in ("any", driven):
        raise InputError(
            f"implementation {part.implementation} is asked for, and the FMU runs here by "
            f"{component.capabilities.interface}"
        )
    return component


def _walk(part: Part, path: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], Part]]:
    yield path, part
    for inner in part.parts:
        yield from _walk(inner, (*path, inner.name))
