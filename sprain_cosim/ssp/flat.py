"""A structure without its levels: the FMUs of all systems under one name each, who feeds whom through which linear
transformation, and what is set."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

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
    """

    source: str
    link: Affine | None = None
    outer: bool = False


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
        outputs = {
            port.name: feed
            for port in self.described.system.ports.values()
            if port.kind == "output" and (feed := self._feed(((), port.name))) is not None
        }
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
            if kind == "calculatedParameter":
                self.problems.append(f"{wire.words}: connections of calculated parameters are not supported")
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
        link = self._linked(node, chain[::-1])
        return Feed(f"{self.names[path]}.{name}" if path else name, link, not path)

    def _linked(self, source: Node, chain: Sequence[tuple[Node, Wire]]) -> Affine | None:
        """The linear transformation along a chain of connections; None where the units of its two ends say all."""
        factor, offset, unit, plain = 1.0, 0.0, self._unit(source), True
        for node, wire in chain:
            own = self._unit(node)
            if own is not None and unit is not None and not wire.suppressed and not own.equivalent(unit):
                if not own.same_dimension(unit):
                    self.problems.append(
                        f"{wire.words}: the units do not match: {unit.name} ({unit.dimension()}) and {own.name} "
                        f"({own.dimension()})"
                    )
                    return None
                scale = unit.factor / own.factor
                factor, offset = scale * factor, scale * offset + (unit.offset - own.offset) / own.factor
            if wire.suppressed and not (own is not None and unit is not None and own.equivalent(unit)):
                plain = False
            change = wire.transformation
            if change is not None:
                factor, offset, plain = change.factor * factor, change.factor * offset + change.offset, False
            unit = own if own is not None else unit
        return None if plain else (factor, offset)

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
                nodes = self._targets(path, value.name)
                if not nodes:
                    hint = nearest(value.name, self.components[path].parameters) if path in self.components else ""
                    self.notes.append(f"{value.place}: {value.name}: there is no such parameter{hint}; left out")
                assigned |= dict.fromkeys(nodes, value)
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

    def _targets(self, path: tuple[str, ...], name: str) -> list[Node]:
        """The FMUs' variables that a name means at `path`, all of them where it means several."""
        if path in self.components:
            return [(path, name)] if name in self.components[path].connectors else []
        found = list[Node]()
        if name in self.parts[path].ports:
            found += self._fed_by((path, name))
        for part in self.parts[path].parts:
            if name.startswith(f"{part.name}."):
                found += self._targets((*path, part.name), name.removeprefix(f"{part.name}."))
        return found

    def _fed_by(self, node: Node) -> list[Node]:
        """The FMUs' variables that take the value of a connector of a system."""
        found = list[Node]()
        for target, (source, wire) in self.origin.items():
            if source != node:
                continue
            if wire.transformation is not None or wire.suppressed:
                self.problems.append(
                    f"{wire.words}: a value that is set at {node[1]} would go through its transformation, which is not "
                    "supported; set it at the component"
                )
            found += [target] if target[0] in self.components else self._fed_by(target)
        return found


def _contradiction(port: Port, connector: Connector | None, fmu: str) -> str:
    """How a connector of the document is not that of the FMU; empty where it is."""
    if connector is None:
        return f"{fmu} has no such variable"
    if port.kind not in ("", connector.causality):
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
