"""A system structure description (SSD) as a tree of systems, components and connections."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from ..errors import InputError, problems_to_error
from ..units import Unit
from .elements import NUMERALS, OWN, REALS, SSC, SSD, SSM, SSV, children, document, fitting, local, own_annotations
from .package import DEFINITION_TYPE, FMU_TYPE, PACKAGE_TYPE, STRUCTURE, Package, PackageFile
from .values import (
    Assigned,
    Transformation,
    finite_number,
    mapped_values,
    parameter_mapping,
    parameter_set,
    transformation_of,
    truth,
    unit_named,
    units_of,
    values_of,
)

SET_TYPE, MAPPING_TYPE = "application/x-ssp-parameter-set", "application/x-ssp-parameter-mapping"
TYPES = (*REALS, *NUMERALS, "Boolean", "String", "Enumeration", "Binary")
DEEPEST = 8  # documents in each other
MOST = 1000  # elements of all systems together


@dataclass(frozen=True)
class Port:
    """A connector of a system or a component.

    kind  input, output, parameter or another of the standard
    unit  as the document defines it; None where it states none
    type  element of SSP, such as Real; "" where it states none
    """

    name: str
    kind: str
    unit: Unit | None = None
    type: str = ""


@dataclass(frozen=True)
class Wire:
    """A connection of two connectors, each (element, connector); the element is "" for the system itself.

    transformation  of the value, after any conversion of units
    suppressed      whether the conversion of units is left out
    """

    ends: tuple[tuple[str, str], tuple[str, str]]
    transformation: Transformation | None = None
    suppressed: bool = False

    @property
    def words(self) -> str:
        """For messages."""
        one, other = (".".join(part for part in end if part) for end in self.ends)
        return f"connection {one} - {other}"


@dataclass(frozen=True)
class Handed:
    """A connection of stiffness or damping, both ends as "component.connector" within their system; `link` (factor,
    offset) where units do not say it."""

    source: str
    target: str
    link: tuple[float, float] | None = None


@dataclass(frozen=True)
class Part:
    """An element of a system: an FMU, or a system of its own.

    name      within the system around it
    ports     {name: connector} that the document states
    values    what it assigns, the last of a name counts
    source    the FMU's file; None for a system
    implementation  of the FMU that is asked for: any, CoSimulation or ModelExchange
    device    what our own annotation says of an FMU
    parts, wires  of a system
    hand_over  connections in a system that our master alone makes
    """

    name: str
    ports: Mapping[str, Port] = field(default_factory=dict)
    values: Sequence[Assigned] = ()
    source: PackageFile | None = None
    implementation: str = "any"
    device: Mapping[str, str] = field(default_factory=dict)
    parts: Sequence[Part] = ()
    wires: Sequence[Wire] = ()
    hand_over: Sequence[Handed] = ()


@dataclass(frozen=True)
class Structure:
    """What an SSD says.

    name    of the whole
    system  its tree
    start, stop  [s] of the default experiment; None where it states none
    master  what our own annotation says of the master
    notes   what was left out, one line each
    """

    name: str
    system: Part
    start: float | None = None
    stop: float | None = None
    master: Mapping[str, str] = field(default_factory=dict)
    notes: Sequence[str] = ()


def structure(package: Package) -> Structure:
    """The structure of a package. Raises InputError in one line, with all that is refused."""
    reader = _Reader(PackageFile(package, STRUCTURE), _Gathered())
    tree, system = reader.read()
    experiment = next(iter(children(tree, "DefaultExperiment")), None)
    times: dict[str, float | None] = {"startTime": None, "stopTime": None}
    if experiment is not None:
        times = {
            key: finite_number(experiment.get(key), reader.place) if experiment.get(key) else None for key in times
        }
    problems_to_error(reader.place, reader.found.problems)
    reader.found.notes += reader.found.idle(package)
    return Structure(
        str(tree.get("name")),
        system,
        times["startTime"],
        times["stopTime"],
        next(iter(own_annotations(tree, "Master")), {}),
        tuple(reader.found.notes),
    )


@dataclass
class _Gathered:
    """While a tree is read, over all its documents."""

    problems: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    elements: int = 0
    used: set[PackageFile] = field(default_factory=set)

    def idle(self, package: Package) -> Iterator[str]:
        """The files of a package that nothing names."""
        for name in package.names:
            kind = name.lower().rpartition(".")[2]
            if kind == "ssd" and "/" not in name and name != STRUCTURE:
                yield f"{name} is another variant; {STRUCTURE} is read"
            elif kind in ("fmu", "ssv", "ssm", "ssp") and PackageFile(package, name) not in self.used:
                yield f"{name} is in the package, and nothing in {STRUCTURE} uses it"


class _Reader:
    """Of one document; `around`: the documents that it lies in, from the outermost."""

    def __init__(self, document: PackageFile, found: _Gathered, around: tuple[PackageFile, ...] = ()) -> None:
        self.document, self.found, self.around = document, found, around
        self.package, self.place = document.package, document.label
        self.units = dict[str, Unit]()

    def read(self) -> tuple[Any, Part]:
        """The document and its system."""
        tree = document(self.document.content(), self.place, f"{{{SSD}}}SystemStructureDescription")
        self.units = units_of(tree, self.place)
        theirs = dict.fromkeys(str(a.get("type")) for a in tree.iter(f"{{{SSC}}}Annotation") if not _is_own(a))
        if theirs and not own_annotations(tree, "Master"):  # which says the same
            self.found.notes.append(f"annotations of {', '.join(theirs)} are for other tools and left out")
        system = self.part(next(iter(children(tree, "System"))))
        handed = [_handed(attributes, self.place) for attributes in own_annotations(tree, "HandOver")]
        devices = own_annotations(tree, "Device")
        said = {attributes.pop("component"): attributes for attributes in devices}
        if len(said) < len(devices):
            self.found.problems.append("annotation Device: there are two of one component; keep one")
        parts = [replace(p, device=said.pop(p.name, {})) if p.source else p for p in system.parts]
        self.found.problems += [
            f"annotation Device: there is no component {name} in the outermost system" for name in said
        ]
        return tree, replace(system, parts=parts, hand_over=handed)

    def part(self, element: Any) -> Part:
        self.found.elements += 1
        if self.found.elements > MOST:
            raise InputError(f"{self.place}: more than {MOST} elements in all systems together")
        name = str(element.get("name"))
        ports = {port.name: port for port in self.ports(element)}
        if local(element) == "Component":
            return self.component(element, name, ports)
        parts = [
            self.part(child) for child in next(iter(children(element, "Elements")), ()) if isinstance(child.tag, str)
        ]
        names = [part.name for part in parts]
        self.found.problems += [f"two elements are named {n}" for n in dict.fromkeys(names) if names.count(n) > 1]
        wires = [self.wire(wire) for wire in children(element, "Connections", "Connection")]
        return Part(name, ports, self.values(element, name), parts=parts, wires=wires)

    def component(self, element: Any, name: str, ports: Mapping[str, Port]) -> Part:
        kind, implementation = element.get("type", FMU_TYPE), element.get("implementation", "any")
        try:
            if kind not in (FMU_TYPE, PACKAGE_TYPE, DEFINITION_TYPE):
                raise InputError(f"component {name}: is of type {kind}; FMUs, packages and structures are supported")
            file = self.resolved(str(element.get("source")), f"component {name}")
            if kind != FMU_TYPE:
                return self.nested(element, ports, self.inside(file, kind, name))
        except InputError as problem:
            self.found.problems.append(str(problem))
            return Part(name)
        if implementation == "ScheduledExecution":
            self.found.problems.append(f"component {name}: scheduled execution of FMI 3 is not supported")
        return Part(name, ports, self.values(element, name, file), file, implementation)

    def inside(self, file: PackageFile, kind: str, name: str) -> PackageFile:
        """The document of a component that is a system of its own. Raises InputError where that does not end."""
        found = PackageFile(file.package_in_it(), STRUCTURE) if kind == PACKAGE_TYPE else file
        chain = (*self.around, self.document)
        same = [k for k, other in enumerate(chain) if other.key == found.key]
        if same:
            circle = " -> ".join(other.name for other in (*chain[same[0] :], found))
            raise InputError(f"component {name}: {file.name} contains itself ({circle})")
        if len(chain) >= DEEPEST:
            raise InputError(f"component {name}: more than {DEEPEST} packages in each other")
        return found

    def nested(self, element: Any, ports: Mapping[str, Port], document: PackageFile) -> Part:
        """A component that is a system of its own: as if that stood in its place. What the component says of a
        connector must be what the system says."""
        name = str(element.get("name"))
        if element.get("implementation"):
            raise InputError(f"component {name}: implementation belongs to an FMU, and this is a system")
        reader = _Reader(document, self.found, (*self.around, self.document))
        tree, system = reader.read()
        self.found.problems += [f"component {name}: {problem}" for problem in _contradictions(ports, system.ports)]
        if own_annotations(tree, "Master") or children(tree, "DefaultExperiment"):
            self.found.notes.append(f"component {name}: its own default experiment and master's settings are left out")
        stated = {
            n: replace(p, unit=p.unit or (ports[n].unit if n in ports else None)) for n, p in system.ports.items()
        }
        values = [*system.values, *self.values(element, name, document)]
        return replace(system, name=name, ports=stated, values=values)

    def resolved(self, source: str, place: str) -> PackageFile:
        """The file that a path in this document names. Raises InputError."""
        found = PackageFile(self.package, self.package.resolved(source, place, self.document.name))
        self.found.used.add(found)
        return found

    def ports(self, element: Any) -> list[Port]:
        found = []
        for connector in children(element, "Connectors", "Connector"):
            name, kind = str(connector.get("name")), str(connector.get("kind"))
            typed = next((c for c in connector if isinstance(c.tag, str) and local(c) in TYPES), None)
            if kind == "inout":
                self.found.problems.append(f"connector {element.get('name')}.{name}: kind inout is not supported")
            try:
                unit = unit_named(None if typed is None else typed.get("unit"), self.units, f"connector {name}")
            except InputError as problem:
                self.found.problems.append(str(problem))
                unit = None
            found.append(Port(name, kind, unit, "" if typed is None else local(typed)))
        for name in {port.name: None for k, port in enumerate(found) if port.name in [p.name for p in found[:k]]}:
            self.found.problems.append(f"{element.get('name')}: two connectors are named {name}; keep one")
        return found

    def wire(self, element: Any) -> Wire:
        ends = tuple(
            (element.get(f"{end}Element", ""), str(element.get(f"{end}Connector"))) for end in ("start", "end")
        )
        wire = Wire((ends[0], ends[1]))
        for index in ("startIndices", "endIndices"):
            if element.get(index):
                self.found.problems.append(f"{wire.words}: {index} of arrays are not supported")
        change = transformation_of(element, wire.words)
        if change is not None and change.kind != "LinearTransformation":
            self.found.problems.append(
                f"{wire.words}: {change.kind} is supported for parameters only; not for connections"
            )
        elif change is not None and change.factor == 0:
            self.found.problems.append(f"{wire.words}: its factor is 0, so nothing would arrive")
        return Wire(wire.ends, change, truth(element.get("suppressUnitConversion", "false")) == "true")

    def values(self, element: Any, name: str, file: PackageFile | None = None) -> list[Assigned]:
        """The values of all parameter bindings of an element, in their order; `file`: a component's."""
        found: list[Assigned] = []
        for number, binding in enumerate(children(element, "ParameterBindings", "ParameterBinding"), 1):
            place = f"{name}: parameter binding {number}"
            try:
                found += self.binding(binding, place, file)
            except InputError as problem:
                self.found.problems.append(str(problem))
        return found

    def binding(self, binding: Any, place: str, file: PackageFile | None) -> list[Assigned]:
        kind = binding.get("type", SET_TYPE)
        if kind != SET_TYPE:
            raise InputError(f"{place}: parameters of type {kind} are not supported")
        inside = [c for c in next(iter(children(binding, "ParameterValues")), ()) if isinstance(c.tag, str)]
        source = binding.get("source")
        if bool(source) == bool(inside) or len(inside) > 1:
            raise InputError(f"{place}: needs a source, or one ParameterSet in it, and not both")
        if source:
            where = self.located(binding, place, file)
            values = parameter_set(where.content(), where.label)
        elif inside[0].tag == f"{{{SSV}}}ParameterSet":
            values = values_of(fitting(inside[0], place), place)
        else:
            raise InputError(f"{place}: holds {local(inside[0])}, expected ParameterSet of SSV")
        prefix = binding.get("prefix", "")
        values = [value if not prefix else _renamed(value, prefix + value.name) for value in values]
        mapping = next(iter(children(binding, "ParameterMapping")), None)
        if mapping is None:
            return values
        values, dropped = mapped_values(values, self.mapping(mapping, place, file), place)
        if dropped:
            self.found.notes.append(f"{place}: its mapping leaves out {', '.join(dropped)}, as SSP wants it")
        return values

    def mapping(self, element: Any, place: str, file: PackageFile | None) -> Any:
        inside = [child for child in element if isinstance(child.tag, str)]
        if bool(element.get("source")) == bool(inside) or len(inside) > 1:
            raise InputError(f"{place}: ParameterMapping needs a source, or one mapping in it, and not both")
        kind = element.get("type", MAPPING_TYPE)
        if kind != MAPPING_TYPE:
            raise InputError(f"{place}: mappings of type {kind} are not supported")
        if inside:
            return parameter_mapping(inside[0], place)
        where = self.located(element, place, file)
        return document(where.content(), where.label, f"{{{SSM}}}ParameterMapping")

    def located(self, element: Any, place: str, file: PackageFile | None) -> PackageFile:
        """The file that a binding or a mapping names, in the package or in the component."""
        source = str(element.get("source"))
        if element.get("sourceBase", "SSD") != "component":
            return self.resolved(source, place)
        if file is None:
            raise InputError(f"{place}: sourceBase component belongs to a component that has a file")
        if file.name.lower().endswith(".ssd"):
            return PackageFile(file.package, file.package.resolved(source, place, file.name))
        inside = Package.within(file.kept(), file.label)
        return PackageFile(inside, inside.resolved(source, place))


def _is_own(annotation: Any) -> bool:
    return any(str(child.tag).startswith(f"{{{OWN}}}") for child in annotation)


def _handed(attributes: Mapping[str, str], place: str) -> Handed:
    ends = attributes["source"], attributes["target"]
    if not {"factor", "offset"} & attributes.keys():
        return Handed(*ends)
    factor, offset = (finite_number(attributes.get(k, d), place) for k, d in (("factor", "1"), ("offset", "0")))
    return Handed(*ends, (factor, offset))


def _renamed(value: Assigned, name: str) -> Assigned:
    return Assigned(name, value.kind, value.text, value.unit, place=value.place)


def _contradictions(stated: Mapping[str, Port], inside: Mapping[str, Port]) -> Iterator[str]:
    """What is said of connectors outside and not so inside."""
    for name, port in stated.items():
        own = inside.get(name)
        if own is None:
            yield f"connector {name}: the system inside has none of that name"
        elif "unspecified" not in (port.kind, own.kind) and port.kind != own.kind:
            yield f"connector {name}: is of kind {port.kind}, and {own.kind} in the system inside"
        elif port.unit is not None and own.unit is not None and not port.unit.equivalent(own.unit):
            yield f"connector {name}: its unit is {port.unit.name}, and {own.unit.name} in the system inside"
