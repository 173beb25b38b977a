"""A system structure description (SSD) as a tree of systems, components and connections."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from ..errors import InputError, problems_to_error
from ..units import Unit
from .elements import SSD, SSM, SSV, children, document, fitting, local, own_annotation
from .package import FMU_TYPE, STRUCTURE, Package
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

FLOWS = ("input", "output", "parameter", "calculatedParameter")


@dataclass(frozen=True)
class Port:
    """A connector of a system or a component.

    kind  input, output, parameter or another of the standard; "" where it is left to the FMU
    unit  as the document defines it; None where it states none
    """

    name: str
    kind: str
    unit: Unit | None = None


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
class Part:
    """An element of a system: an FMU, or a system of its own.

    name      within the system around it
    ports     {name: connector} that the document states
    values    what it assigns, the last of a name counts
    source    the file in the package; "" for a system
    implementation  of the FMU that is asked for: any, CoSimulation or ModelExchange
    device    what our own annotation says of an FMU
    parts, wires  of a system
    """

    name: str
    ports: Mapping[str, Port] = field(default_factory=dict)
    values: Sequence[Assigned] = ()
    source: str = ""
    implementation: str = "any"
    device: Mapping[str, str] = field(default_factory=dict)
    parts: Sequence[Part] = ()
    wires: Sequence[Wire] = ()


@dataclass(frozen=True)
class Handed:
    """A connection of stiffness or damping, both ends as "component.connector"; `link` (factor, offset) where units do
    not say it."""

    source: str
    target: str
    link: tuple[float, float] | None = None


@dataclass(frozen=True)
class Structure:
    """What an SSD says.

    name    of the whole
    system  its tree
    start, stop  [s] of the default experiment; None where it states none
    master  what our own annotation says of the master
    hand_over  connections that our master alone makes
    notes   what was left out, one line each
    """

    name: str
    system: Part
    start: float | None = None
    stop: float | None = None
    master: Mapping[str, str] = field(default_factory=dict)
    hand_over: Sequence[Handed] = ()
    notes: Sequence[str] = ()


def structure(package: Package) -> Structure:
    """The structure of a package. Raises InputError in one line, with all that is refused."""
    reader = _Reader(package)
    place = f"{package.path}:{STRUCTURE}"
    tree = document(package.member(STRUCTURE), place, f"{{{SSD}}}SystemStructureDescription")
    reader.units = units_of(tree, place)
    system = reader.part(next(iter(children(tree, "System"))), place)
    experiment = next(iter(children(tree, "DefaultExperiment")), None)
    times: dict[str, float | None] = {"startTime": None, "stopTime": None}
    if experiment is not None:
        times = {key: finite_number(experiment.get(key), place) if experiment.get(key) else None for key in times}
    annotated = own_annotation(tree, "Master")
    handed = [_handed(a, place) for a in children(tree, "Annotations", "Annotation", "HandOver")]
    problems_to_error(place, reader.problems)
    return Structure(
        str(tree.get("name")),
        system,
        times["startTime"],
        times["stopTime"],
        annotated,
        handed,
        tuple(reader.notes),
    )


class _Reader:
    """Problems and notes are gathered while a tree is read."""

    def __init__(self, package: Package) -> None:
        self.package, self.units = package, dict[str, Unit]()
        self.problems, self.notes = list[str](), list[str]()

    def part(self, element: Any, place: str) -> Part:
        name = str(element.get("name"))
        ports = {port.name: port for port in self.ports(element)}
        if local(element) == "Component":
            return self.component(element, name, ports, place)
        parts = [
            self.part(child, f"{place}: {child.get('name')}")
            for child in next(iter(children(element, "Elements")), ())
            if isinstance(child.tag, str)
        ]
        names = [part.name for part in parts]
        self.problems += [f"two elements are named {n}" for n in dict.fromkeys(names) if names.count(n) > 1]
        wires = [self.wire(wire) for wire in children(element, "Connections", "Connection")]
        return Part(name, ports, self.values(element, name), parts=parts, wires=wires)

    def component(self, element: Any, name: str, ports: Mapping[str, Port], place: str) -> Part:
        kind, source = element.get("type", FMU_TYPE), str(element.get("source"))
        if kind != FMU_TYPE:
            self.problems.append(
                f"component {name}: is of type {kind}; only FMUs are supported, and systems that are written in "
                f"{STRUCTURE} itself"
            )
            return Part(name)
        try:
            file = self.package.resolved(source, f"component {name}")
        except InputError as problem:
            self.problems.append(str(problem))
            return Part(name)
        implementation = element.get("implementation", "any")
        if implementation == "ScheduledExecution":
            self.problems.append(f"component {name}: scheduled execution of FMI 3 is not supported")
        device = own_annotation(element, "Device")
        return Part(name, ports, self.values(element, name, file), file, implementation, device)

    def ports(self, element: Any) -> list[Port]:
        found = []
        for connector in children(element, "Connectors", "Connector"):
            name, kind = str(connector.get("name")), connector.get("kind", "")
            typed = next((c for c in connector if isinstance(c.tag, str) and c.get("unit")), None)
            if kind == "inout":
                self.problems.append(f"connector {element.get('name')}.{name}: kind inout is not supported")
            try:
                unit = unit_named(typed.get("unit") if typed is not None else None, self.units, f"connector {name}")
            except InputError as problem:
                self.problems.append(str(problem))
                unit = None
            found.append(Port(name, kind if kind in FLOWS else "", unit))
        return found

    def wire(self, element: Any) -> Wire:
        ends = tuple(
            (element.get(f"{end}Element", ""), str(element.get(f"{end}Connector"))) for end in ("start", "end")
        )
        wire = Wire((ends[0], ends[1]))
        for index in ("startIndices", "endIndices"):
            if element.get(index):
                self.problems.append(f"{wire.words}: {index} of arrays are not supported")
        change = transformation_of(element, wire.words)
        if change is not None and change.kind != "LinearTransformation":
            self.problems.append(f"{wire.words}: {change.kind} is supported for parameters only; not for connections")
        elif change is not None and change.factor == 0:
            self.problems.append(f"{wire.words}: its factor is 0, so nothing would arrive")
        return Wire(wire.ends, change, truth(element.get("suppressUnitConversion", "false")) == "true")

    def values(self, element: Any, name: str, file: str = "") -> list[Assigned]:
        """The values of all parameter bindings of an element, in their order; `file`: the FMU's."""
        found: list[Assigned] = []
        for number, binding in enumerate(children(element, "ParameterBindings", "ParameterBinding"), 1):
            place = f"{name}: parameter binding {number}"
            try:
                found += self.binding(binding, place, file)
            except InputError as problem:
                self.problems.append(str(problem))
        return found

    def binding(self, binding: Any, place: str, file: str) -> list[Assigned]:
        kind = binding.get("type", "application/x-ssp-parameter-set")
        if kind != "application/x-ssp-parameter-set":
            raise InputError(f"{place}: parameters of type {kind} are not supported")
        inline = next(iter(children(binding, "ParameterValues")), None)
        source = binding.get("source")
        if source:
            where = self.located(binding, place, file)
            values = parameter_set(self.read(where, file), f"{self.package.path}:{where[1]}")
        elif inline is not None and len(inline) and inline[0].tag == f"{{{SSV}}}ParameterSet":
            values = values_of(fitting(inline[0], place), place)
        else:
            raise InputError(f"{place}: has neither a source nor a ParameterSet")
        prefix = binding.get("prefix", "")
        values = [value if not prefix else _renamed(value, prefix + value.name) for value in values]
        mapping = next(iter(children(binding, "ParameterMapping")), None)
        if mapping is None:
            return values
        values, dropped = mapped_values(values, self.mapping(mapping, place, file), place)
        if dropped:
            self.notes.append(f"{place}: its mapping leaves out {', '.join(dropped)}, as SSP wants it")
        return values

    def mapping(self, element: Any, place: str, file: str) -> Any:
        if element.get("source"):
            where = self.located(element, place, file)
            return document(self.read(where, file), f"{self.package.path}:{where[1]}", f"{{{SSM}}}ParameterMapping")
        inline = next((child for child in element if isinstance(child.tag, str)), None)
        if inline is None:
            raise InputError(f"{place}: ParameterMapping has neither a source nor a mapping")
        return parameter_mapping(inline, place)

    def located(self, element: Any, place: str, file: str) -> tuple[bool, str]:
        """Whether a source lies in the FMU, and its name there or in the package."""
        source = str(element.get("source"))
        if element.get("sourceBase", "SSD") == "component":
            if not file:
                raise InputError(f"{place}: sourceBase component belongs to a component that is an FMU")
            return True, source
        return False, self.package.resolved(source, place)

    def read(self, where: tuple[bool, str], file: str) -> bytes:
        inside, name = where
        if not inside:
            return self.package.member(name)
        return Package.within(self.package.kept(file)).member(name)


def _handed(element: Any, place: str) -> Handed:
    ends = str(element.get("source")), str(element.get("target"))
    if element.get("factor") is None:
        return Handed(*ends)
    return Handed(
        *ends, (finite_number(element.get("factor"), place), finite_number(element.get("offset", "0"), place))
    )


def _renamed(value: Assigned, name: str) -> Assigned:
    return Assigned(name, value.kind, value.text, value.unit, place=value.place)
