"""A system as an SSP package, byte-stable: the structure, a parameter set for each component, the FMUs."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from lxml import etree

from ..fmu.element import Connector
from ..units import BASE, Unit
from .elements import OWN, SSC, SSD, SSV
from .package import STRUCTURE

OMS = "https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd"
SPACES = {"ssc": SSC, "ssd": SSD, "ssv": SSV, "oms": OMS, "sprain": OWN}
ANNOTATION = "org.sprain-cosim"
NAME = "landing"  # of the structure and its system: OMSimulator opens no structure whose name is no identifier
SET = "landing"  # the name of all parameter sets, so that a tool that chooses one by its name sets all components
EPOCH = (1980, 1, 1, 0, 0, 0)


@dataclass(frozen=True)
class Written:
    """A component as it is written.

    name        in the system
    fmu         its content
    connectors  those that connections need
    values      {parameter, or input that nothing feeds: (connector, value in its own unit)}
    device      what a mapping file says of the device itself
    """

    name: str
    fmu: bytes
    connectors: Sequence[Connector]
    values: Mapping[str, tuple[Connector, float]]
    device: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Joint:
    """A connection, both ends as "component.connector"; `link` (factor, offset) where units do not say it."""

    source: str
    target: str
    link: tuple[float, float] | None = None


def package_bytes(
    title: str,
    version: str,
    components: Sequence[Written],
    joints: Sequence[Joint],
    stop: float,
    master: Mapping[str, str],
    hand_over: Sequence[Joint],
) -> bytes:
    """The package as an archive; `version` of SSP, 1.0 or 2.0; `stop` [s]."""
    root = etree.Element(
        f"{{{SSD}}}SystemStructureDescription",
        {"version": version, "name": NAME, "description": title, "generationTool": "sprain-cosim"},
        nsmap=SPACES,
    )
    system = _below(root, SSD, "System", name=NAME)
    elements = _below(system, SSD, "Elements")
    for component in components:
        _component(elements, component)
    connections = _below(system, SSD, "Connections")
    for joint in joints:
        _connection(connections, joint)
    annotations = _below(system, SSD, "Annotations")  # those of OMSimulator first, where alone it looks
    theirs = _below(annotations, SSC, "Annotation", type="org.openmodelica")
    step = master["communicationStep"]  # for its command line in an element, for its Python in attributes
    named = {"name": "oms_ma_default", "method": "oms_ma", "fixedStepSize": step, "relativeTolerance": "0.0001"}
    theirs = _below(_below(theirs, OMS, "Annotations"), OMS, "SimulationInformation", **named)
    _below(theirs, OMS, "FixedStepMaster", description="oms-ma", stepSize=step, relativeTolerance="0.0001")
    _own(annotations, "Master", master)
    for joint in hand_over:
        factor, offset = joint.link or (None, None)
        scale = {} if joint.link is None else {"factor": repr(factor), "offset": repr(offset)}
        _own(annotations, "HandOver", {"source": joint.source, "target": joint.target, **scale})
    for component in components:
        if component.device:
            _own(annotations, "Device", {"component": component.name, **component.device})
    used = {u.name: u for c in components for x in c.connectors if (u := x.unit) is not None}
    _units(root, SSD, used)
    _below(root, SSD, "DefaultExperiment", startTime="0.0", stopTime=repr(stop))
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
        _put(archive, STRUCTURE, _bytes(root))
        for component in components:
            _put(archive, f"resources/{component.name}.fmu", component.fmu)
            if component.values:
                _put(archive, f"resources/{component.name}.ssv", _parameter_set(component, version))
    return content.getvalue()


def _component(elements: Any, component: Written) -> None:
    element = _below(
        elements,
        SSD,
        "Component",
        name=component.name,
        source=f"resources/{component.name}.fmu",
        type="application/x-fmu-sharedlibrary",
    )
    connectors = _below(element, SSD, "Connectors")
    for connector in component.connectors:
        own = _below(connectors, SSD, "Connector", name=connector.name, kind=connector.causality)
        unit = {} if connector.unit is None else {"unit": connector.unit.name}
        _below(own, SSC, _type(connector), **(unit if connector.kind == "real" else {}))
    if component.values:
        bindings = _below(element, SSD, "ParameterBindings")
        _below(bindings, SSD, "ParameterBinding", source=f"resources/{component.name}.ssv")


def _connection(connections: Any, joint: Joint) -> None:
    (one, start), (other, end) = joint.source.split(".", 1), joint.target.split(".", 1)
    ends = {"startElement": one, "startConnector": start, "endElement": other, "endConnector": end}
    if joint.link is None:
        _below(connections, SSD, "Connection", **ends)
        return
    element = _below(connections, SSD, "Connection", **ends, suppressUnitConversion="true")
    factor, offset = joint.link
    _below(element, SSC, "LinearTransformation", factor=repr(factor), offset=repr(offset))


def _parameter_set(component: Written, version: str) -> bytes:
    root = etree.Element(f"{{{SSV}}}ParameterSet", {"version": version, "name": SET}, nsmap=SPACES)
    parameters = _below(root, SSV, "Parameters")
    units: dict[str, Unit] = {}
    for name, (connector, value) in component.values.items():
        element = _below(parameters, SSV, "Parameter", name=name)
        if connector.items:
            item = next(n for n, v in connector.items.items() if v == int(value))
            _below(element, SSV, "Enumeration", value=item)
        elif connector.kind == "boolean":
            _below(element, SSV, "Boolean", value="true" if value else "false")
        elif connector.kind == "integer":
            _below(element, SSV, "Integer", value=str(int(value)))
        elif connector.unit is None or connector.unit.dimensionless:
            _below(element, SSV, "Real", value=repr(value))
        else:
            units[connector.unit.name] = connector.unit
            _below(element, SSV, "Real", value=repr(value), unit=connector.unit.name)
    _units(root, SSV, units)
    return _bytes(root)


def _units(root: Any, space: str, units: Mapping[str, Unit]) -> None:
    if not units:
        return
    listed = _below(root, space, "Units")
    for name, unit in sorted(units.items()):
        exponents = {symbol: str(e) for symbol, e in zip(BASE, unit.exponents, strict=True) if e}
        scale = {"factor": repr(unit.factor)} if unit.factor != 1.0 else {}
        scale |= {"offset": repr(unit.offset)} if unit.offset else {}
        _below(_below(listed, SSC, "Unit", name=name), SSC, "BaseUnit", **exponents, **scale)


def _own(annotations: Any, name: str, attributes: Mapping[str, str]) -> None:
    annotation = _below(annotations, SSC, "Annotation", type=ANNOTATION)
    _below(annotation, OWN, name, **attributes)


def _below(parent: Any, space: str, tag: str, **attributes: str) -> Any:
    return etree.SubElement(parent, f"{{{space}}}{tag}", attributes)


def _type(connector: Connector) -> str:
    return {"real": "Real", "integer": "Integer", "boolean": "Boolean", "enumeration": "Integer"}[connector.kind]


def _bytes(root: Any) -> bytes:
    return bytes(etree.tostring(root, xml_declaration=True, encoding="UTF-8", pretty_print=True))


def _put(archive: zipfile.ZipFile, name: str, content: bytes) -> None:
    entry = zipfile.ZipInfo(name, EPOCH)
    entry.compress_type = zipfile.ZIP_STORED if name.endswith(".fmu") else zipfile.ZIP_DEFLATED
    entry.external_attr = 0o644 << 16
    archive.writestr(entry, content)
