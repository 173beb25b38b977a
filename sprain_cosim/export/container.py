"""A landing as one FMU of FMI 2.0 co-simulation, for tools that read no systems: its FMUs lie in the resources, and a
library in C (cosim/container.c) steps them there as the master does. What that library cannot do is refused by name."""

from __future__ import annotations

import math
import re
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as ET

from ..contract import is_excitation, is_impedance
from ..cosim.layout import conversion
from ..cosim.native_libraries import PLATFORMS_OF_CONTAINER, library_content
from ..cosim.result import PEAK, Result
from ..cosim.schedule import RECORD, own_rates, schedule
from ..cosim.system import System
from ..errors import EnvironmentProblem, InputError, SimulationError, problems_to_error
from ..files import write
from ..fmu.build.link import FOLDERS_3, PLATFORMS
from ..fmu.build.packing import digest, pack
from ..fmu.component import Component
from ..fmu.description import OWN_TOOL
from ..fmu.element import Connector
from ..fmu.foreign import is_foreign
from ..scenario import Scenario
from ..units import BASE, Unit
from .package import Exported, exported

PLAN, FORMAT = "resources/plan.txt", 1
SCHEMES = ("gauss-seidel", "jacobi", "impedance")
TYPES = {  # what can be set, by FMI's types in both versions: as the plan names it
    **dict.fromkeys(("Real", "Float64"), "real"),
    **dict.fromkeys(("Integer", "Enumeration", "Int32", "Int64"), "integer"),
    "Boolean": "boolean",
}
LARGEST = 2**31 - 1  # of an integer of FMI 2.0


@dataclass(frozen=True)
class _Slots:
    """Where a component's connected inputs and its outputs stand on the bus."""

    inputs: Sequence[str]
    outputs: Sequence[str]
    direct: int
    first: int

    @property
    def next(self) -> int:
        return self.first + len(self.inputs) + len(self.outputs)


@dataclass(frozen=True)
class _Variable:
    """Of the container.

    name       "component.variable", the variable as its FMU calls it
    connector  of the FMU
    line       of the plan
    value      of a parameter; None for an output
    """

    name: str
    connector: Connector
    line: str
    value: float | None = None


def export_container(scenario: Scenario, out: Path) -> list[str]:
    """Writes a scenario as one FMU; returns what its users must know, one line each. Raises InputError for what a
    container cannot carry, SimulationError where the landing itself does not run, EnvironmentProblem."""
    system = scenario.system()
    parts = {name: exported(scenario, name, path) for name, path in scenario.fmus.items()}
    problems_to_error(f"{scenario.source}: cannot be written as a container", _problems(scenario, system, parts))
    result = scenario.run()
    if result.status != "completed":
        raise SimulationError(f"{scenario.source}: {result.message}")
    problems_to_error(f"{scenario.source}: cannot be written as a container", _wrong_scheme(result, system))
    plan = _Plan(scenario, system, parts, result.scheme)
    libraries = {p: content for p in plan.platforms() if (content := library_content("container", p)) is not None}
    if not libraries:
        raise EnvironmentProblem(
            "the library of containers is not built for this source; `sprain-cosim build` in a clone builds it"
        )
    write(out, pack(plan.members(libraries)))
    return _notes(scenario, plan, result, list(libraries))


def _problems(scenario: Scenario, system: System, parts: Mapping[str, Exported]) -> Iterator[str]:
    """What a container cannot carry, one line each."""
    if scenario.master.adaptive:
        yield "adaptive: communication steps that are divided take a state back; leave adaptive out"
    step, rates = scenario.master.communication_step, own_rates(system.components, scenario.master.communication_step)
    if not rates and not schedule(system.components, scenario.master.start, step, scenario.master.steps).regular:
        yield (
            f"communication step {1e3 * step:g} ms: the master stops the plant within it to record; leave it at "
            f"{1e3 * RECORD:g} ms, of which the host's step may be a multiple"
        )
    for name, rate in rates.items():
        yield f"{name}: is called at a rate of its own, every {1e3 * rate.period:g} ms; a container has one rate"
    ends = {end for pair in system.connections.items() for end in pair}
    for component in system.components:
        yield from _of_component(component.name, parts[component.name].component)
        for name, connector in component.connectors.items():
            full = f"{component.name}.{name}"
            if full in ends and connector.parts:
                yield f"{full}: is the sum of several outputs; let the FMU give the sum as one"
            elif full in ends and not _is_plain(connector):
                yield f"{full}: is connected and no double-precision scalar; only those are exchanged in a container"
            elif full in system.parameters and (connector.fmi_type not in TYPES or connector.array):
                yield f"{full}: is set and of type {connector.fmi_type}{' (array)' * bool(connector.array)}"
    for target, source in system.connections.items():
        owner = parts[source.partition(".")[0]].component
        if is_excitation(target) and owner.capabilities.tool != OWN_TOOL:
            yield f"{source}: what it gives at rest is found by an experiment, which a container does not make"


def _of_component(name: str, component: Component) -> Iterator[str]:
    able = component.capabilities
    if able.fmi_version not in ("2.0", "3.0") or able.model_exchange:
        yield f"{name}: is {able.interface}; a container holds co-simulation of FMI 2.0 and 3.0"
    if able.event_mode or able.early_return:
        yield f"{name}: uses event mode or early return of FMI 3"
    if able.fixed_step is not None:
        yield f"{name}: has a step of its own, {1e3 * able.fixed_step:g} ms"
    if component.needs_tool:
        yield f"{name}: needs its authoring tool ({component.needs_tool})"


def _wrong_scheme(result: Result, system: System) -> Iterator[str]:
    known = f"a container steps by {', '.join(SCHEMES)}; choose one with --scheme"
    if result.scheme not in SCHEMES:
        yield f"scheme {result.scheme}: {known}"
    elif result.scheme == "impedance" and system.undeclared:
        unsaid = ", ".join(dict.fromkeys(torque for torque, _ in system.undeclared.values()))
        yield (
            f"scheme impedance: {unsaid} declares no stiffness or damping, which the master finds by experiments and a "
            "container cannot; --scheme gauss-seidel steps without them"
        )


class _Plan:
    """What the library follows, and the archive around it."""

    def __init__(self, scenario: Scenario, system: System, parts: Mapping[str, Exported], scheme: str) -> None:
        self.scenario, self.system, self.parts, self.scheme = scenario, system, parts, scheme
        self.slots: dict[str, _Slots] = {}
        first = 0
        for element in system.components:
            inputs, outputs, direct = system.layout.of(element)
            plain = [n for n in outputs if _is_plain(element.connectors[n])]
            late = [n for n in outputs[len(outputs) - direct :] if n in plain]
            self.slots[element.name] = _Slots(inputs, plain, len(late), first)
            first = self.slots[element.name].next
        self.zero = first
        self.place = {
            f"{name}.{variable}": slots.first + k
            for name, slots in self.slots.items()
            for k, variable in enumerate((*slots.inputs, *slots.outputs))
        }
        excited = [target for target in system.connections if is_excitation(target) and target in self.place]
        self.rest = {target: self.zero + 1 + k for k, target in enumerate(excited)}
        self.variables = [*self._outputs(), *self._parameters()]
        name = re.sub(r"\W", "_", Path(scenario.source).stem, flags=re.ASCII)
        self.name = name if name[:1].isalpha() else f"landing_{name}"  # an identifier of C

    # ---- the plan

    def lines(self, guid: str) -> Iterator[str]:
        step = self.scenario.master.communication_step
        jacobi = "jacobi" if self.scheme == "jacobi" else "sequential"
        numbers = len(self.slots), self.zero + 1 + len(self.rest), len(self.rest), len(self.variables)
        yield _line("container", FORMAT, guid, step, jacobi, *numbers)
        for name, slots in self.slots.items():
            yield from self._member(name, slots)
        owners = list(self.slots)
        of_sources = {target: self.system.connections[target] for target in self.rest}
        for target, source in sorted(of_sources.items(), key=lambda pair: owners.index(pair[1].partition(".")[0])):
            yield _line("rest", self.rest[target], self.place[source], owners.index(source.partition(".")[0]))
        yield from (variable.line for variable in self.variables)

    def _member(self, name: str, slots: _Slots) -> Iterator[str]:
        component, element = self.parts[name].component, self.system.component(name)
        assert element is not None
        version = component.capabilities.fmi_version[0]
        libraries = [_library(component, platform) for platform in PLATFORMS_OF_CONTAINER]
        owned = "foreign" if is_foreign(component.fmu, component.sha256) else "ours"
        counts = len(slots.inputs), len(slots.outputs), slots.direct
        yield _line("member", name, version, component.guid, *libraries, *counts, owned)
        for variable in slots.inputs:
            full = f"{name}.{variable}"
            source = self.system.connections.get(full)
            running = self.zero if source is None else self.place[source]
            start = self.zero if is_impedance(full) else running
            if self.scheme != "impedance":
                running = start
            own = element.connectors[variable].unit
            link = self.system.links.get(full) or conversion(self.system.find(source).unit if source else None, own)
            yield _line(
                "input", element.connectors[variable].reference, self.rest.get(full, start), start, running, *link
            )
        for variable in slots.outputs:
            yield _line("output", element.connectors[variable].reference)

    def _outputs(self) -> Iterator[_Variable]:
        for name, slots in self.slots.items():
            element, own = self.system.component(name), self.parts[name].component.outputs
            assert element is not None
            by_reference = {c.reference: c for c in own.values()}
            for variable in slots.outputs:
                raw = by_reference[element.connectors[variable].reference]
                yield _Variable(f"{name}.{raw.name}", raw, _line("slot", self.place[f"{name}.{variable}"]))

    def _parameters(self) -> Iterator[_Variable]:
        """All parameters of the FMUs with a start value; of their inputs those that nothing feeds and the landing
        sets."""
        for k, (name, part) in enumerate(self.parts.items()):
            values = {
                part.variable(full.removeprefix(f"{name}.")).name: value
                for full, value in self.system.parameters.items()
                if full.startswith(f"{name}.")
            }
            for raw in part.component.connectors.values():
                value = values.get(raw.name, raw.start)
                kind = TYPES.get(raw.fmi_type)
                settable = raw.causality == "parameter" or (raw.causality == "input" and raw.name in values)
                if (
                    not settable
                    or kind is None
                    or raw.array
                    or value is None
                    or (kind != "real" and abs(value) > LARGEST)
                ):
                    continue
                held, given = ("input", "parameter")[raw.causality == "parameter"], ("start", "set")[raw.name in values]
                line = _line("value", kind, k, raw.reference, raw.fmi_type, held, given, float(value))
                yield _Variable(f"{name}.{raw.name}", raw, line, float(value))

    # ---- the archive

    def platforms(self) -> list[str]:
        """For which every FMU has a library."""
        return [p for p in PLATFORMS_OF_CONTAINER if all(_library(part.component, p) for part in self.parts.values())]

    def members(self, libraries: Mapping[str, bytes]) -> dict[str, bytes]:
        """{path: content} of the archive."""
        inside: dict[str, bytes] = {}
        for name, part in self.parts.items():
            with zipfile.ZipFile(part.component.fmu) as archive:
                inside |= {f"resources/{name}/{n}": archive.read(n) for n in archive.namelist() if not n.endswith("/")}
        for platform, content in libraries.items():
            place = PLATFORMS[platform]
            inside[f"binaries/{place.folder}/{self.name}{place.ending}"] = content
        described = self._description("")
        guid = digest({**inside, "plan": "\n".join(self.lines("")).encode(), "description": described})
        plan = "".join(f"{line}\n" for line in self.lines(guid))
        return {**inside, PLAN: plan.encode(), "modelDescription.xml": self._description(guid)}

    def _description(self, guid: str) -> bytes:
        master = self.scenario.master
        step = master.communication_step
        fmus = ", ".join(f"{name} ({part.component.fmu.name})" for name, part in self.parts.items())
        root = ET.Element(
            "fmiModelDescription",
            fmiVersion="2.0",
            modelName=self.name,
            guid=guid,
            description=f"{self.scenario.heading}; {self.scheme}, {1e3 * step:g} ms; {fmus}",
            generationTool="sprain-cosim",
            variableNamingConvention=_naming([v.name for v in self.variables]),
        )
        single = any(part.component.capabilities.single for part in self.parts.values())
        ET.SubElement(
            root,
            "CoSimulation",
            modelIdentifier=self.name,
            canHandleVariableCommunicationStepSize="false",
            canBeInstantiatedOnlyOncePerProcess="true" if single else "false",
            canNotUseMemoryManagementFunctions="true",
        )
        _units(root, [v.connector.unit for v in self.variables])
        _types(root, self.variables)
        ET.SubElement(ET.SubElement(root, "LogCategories"), "Category", name="logAll")
        ET.SubElement(root, "DefaultExperiment", startTime="0.0", stopTime=repr(master.stop), stepSize=repr(step))
        listed = ET.SubElement(root, "ModelVariables")
        for k, variable in enumerate(self.variables):
            _scalar(listed, k, variable)
        structure = ET.SubElement(root, "ModelStructure")
        for section in ("Outputs", "InitialUnknowns"):
            group = ET.SubElement(structure, section)
            for k, variable in enumerate(self.variables, 1):
                if variable.value is None:
                    ET.SubElement(group, "Unknown", index=str(k))
        ET.indent(root)
        text = ET.tostring(root, encoding="unicode")
        return f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n'.encode()


def _is_plain(connector: Connector) -> bool:
    """A double-precision scalar."""
    odd = connector.array or connector.negated or connector.parts
    return TYPES.get(connector.fmi_type) == "real" and not odd


def _line(*fields: object) -> str:
    """A line of the plan. Raises InputError for a name that breaks it."""
    texts = [repr(f) if isinstance(f, float) else str(f) for f in fields]
    broken = next((text for text in texts if re.search(r"[\t\r\n]", text)), None)
    if broken is not None:
        raise InputError(f"{broken!r}: has a tab or a line break in it, which no plan can hold")
    return "\t".join(texts)


def _library(component: Component, platform: str) -> str:
    """The component's library for a platform, in its archive; "" for none."""
    version3 = component.capabilities.fmi_version.startswith("3")
    folder = FOLDERS_3[platform] if version3 else PLATFORMS[platform].folder
    name = f"binaries/{folder}/{component.identifier}{PLATFORMS[platform].ending}"
    with zipfile.ZipFile(component.fmu) as archive:
        return name if name in archive.namelist() else ""


def _naming(names: Sequence[str]) -> str:
    """By FMI's rules; a component's variables stand below its name in a tree where all names allow it."""
    part = r"[A-Za-z_]\w*(\[\d+(,\d+)*\])?"
    allowed = re.compile(rf"{part}(\.{part})*", re.ASCII)
    return "structured" if all(allowed.fullmatch(name) for name in names) else "flat"


def _units(root: ET.Element, units: Sequence[Unit | None]) -> None:
    used = {u.name: u for u in units if u is not None}
    if not used:
        return
    listed = ET.SubElement(root, "UnitDefinitions")
    for name, own in sorted(used.items()):
        exponents = {symbol: str(e) for symbol, e in zip(BASE, own.exponents, strict=True) if e}
        scale = {"factor": repr(own.factor)} if own.factor != 1.0 else {}
        scale |= {"offset": repr(own.offset)} if own.offset else {}
        ET.SubElement(ET.SubElement(listed, "Unit", name=name), "BaseUnit", {**exponents, **scale})


def _types(root: ET.Element, variables: Sequence[_Variable]) -> None:
    choices = [v for v in variables if v.connector.items]
    if not choices:
        return
    listed = ET.SubElement(root, "TypeDefinitions")
    for variable in choices:
        items = ET.SubElement(ET.SubElement(listed, "SimpleType", name=variable.name), "Enumeration")
        for item, number in variable.connector.items.items():
            ET.SubElement(items, "Item", name=item, value=str(number))


def _scalar(listed: ET.Element, reference: int, variable: _Variable) -> None:
    raw, value = variable.connector, variable.value
    role = {"causality": "output", "variability": "continuous", "initial": "calculated"}
    if value is not None:
        role = {"causality": "parameter", "variability": "fixed", "initial": "exact"}
    said = {"description": raw.description} if raw.description else {}
    named = {"name": variable.name, "valueReference": str(reference)}
    scalar = ET.SubElement(listed, "ScalarVariable", named | role | said)
    if value is None or TYPES[raw.fmi_type] == "real":
        limits = {"min": raw.minimum, "max": raw.maximum, "start": math.inf if value is None else value}
        numbers = {key: repr(number) for key, number in limits.items() if math.isfinite(number)}
        ET.SubElement(scalar, "Real", ({} if raw.unit is None else {"unit": raw.unit.name}) | numbers)
    elif raw.items:
        ET.SubElement(scalar, "Enumeration", declaredType=variable.name, start=str(int(value)))
    elif raw.kind == "boolean":
        ET.SubElement(scalar, "Boolean", start="true" if value else "false")
    else:
        ET.SubElement(scalar, "Integer", start=str(int(value)))


def _notes(scenario: Scenario, plan: _Plan, result: Result, platforms: Sequence[str]) -> list[str]:
    step, peak = scenario.master.communication_step, result.metrics.get(PEAK)
    notes = [
        f"it steps by {plan.scheme}; the host's communication step must be {1e3 * step:g} ms or a whole multiple of it",
        f"libraries for {' and '.join(platforms)}; what it cannot do is what the master does besides: no guard of the "
        "coupling, no doubt of the step",
    ]
    if peak is not None:
        notes.append(f"to compare: {PEAK} is {peak:.6g} in the same landing here")
    foreign = [n for n, p in plan.parts.items() if is_foreign(p.component.fmu, p.component.sha256)]
    if foreign:
        notes.append(f"{', '.join(foreign)}: runs in the host's own process, without a sandbox")
    return notes
