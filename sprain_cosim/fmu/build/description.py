"""modelDescription.xml of the FMUs that are built here, from the plain data of `interface.py`."""

from __future__ import annotations

import contextlib
import importlib
import math
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any
from xml.etree import ElementTree as ET

from ...errors import InputError

BASE_UNITS: dict[str, dict[str, int]] = {
    "1": {},
    "rad": {"rad": 1},
    "rad/s": {"rad": 1, "s": -1},
    "m": {"m": 1},
    "m/s": {"m": 1, "s": -1},
    "s": {"s": 1},
    "s/m": {"s": 1, "m": -1},
    "Pa/m": {"kg": 1, "m": -2, "s": -2},
    "N": {"kg": 1, "m": 1, "s": -2},
    "N.m": {"kg": 1, "m": 2, "s": -2},
    "N.m/rad": {"kg": 1, "m": 2, "s": -2, "rad": -1},
    "N.m/rad2": {"kg": 1, "m": 2, "s": -2, "rad": -2},
    "N.m/rad3": {"kg": 1, "m": 2, "s": -2, "rad": -3},
    "N.m.s/rad": {"kg": 1, "m": 2, "s": -1, "rad": -1},
    "kg": {"kg": 1},
    "kg.m2": {"kg": 1, "m": 2},
    "J": {"kg": 1, "m": 2, "s": -2},
}
GUID_PLACE = "@GUID@"
PACKAGE = "_device"  # the name under which a model is imported; what is compiled must not depend on where it lies
STEP = 0.0005  # s, of the default experiment

Variables = list[dict[str, Any]]


TABLES = {  # of interface.py: the columns of its rows
    "PARAMETERS": ("name", "unit", "start", "least", "greatest", "description"),
    "INPUTS": ("name", "unit", "description"),
    "OUTPUTS": ("name", "unit", "description", "inputs that change it at once"),
}


@contextlib.contextmanager
def package(folder: Path) -> Iterator[str]:
    """While it lasts, the modules of a model's folder can be imported below the prefix given: as members of the package
    that the folder lies in, freshly run and not left in sys.modules."""
    folder = folder.resolve()
    inside = (folder.parent / "__init__.py").is_file()
    top = ModuleType(PACKAGE)
    top.__path__ = [str(folder.parent if inside else folder)]
    prefix = f"{PACKAGE}.{folder.name}" if inside else PACKAGE
    before = sys.dont_write_bytecode
    _forget()
    sys.modules[PACKAGE], sys.dont_write_bytecode = top, True
    try:
        if inside:
            middle = ModuleType(prefix)
            middle.__path__ = [str(folder)]
            sys.modules[prefix] = middle
        yield prefix
    finally:
        sys.dont_write_bytecode = before
        _forget()


def _forget() -> None:
    for name in [n for n in sys.modules if n == PACKAGE or n.startswith(f"{PACKAGE}.")]:
        del sys.modules[name]


def load_interface(path: Path) -> ModuleType:
    """`interface.py`, run. Raises InputError for what is at fault in it."""
    try:
        with package(path.parent) as prefix:
            module = importlib.import_module(f"{prefix}.{path.stem}")
    except SyntaxError as problem:
        raise InputError(f"{path}: {problem.msg} in line {problem.lineno}") from None
    except Exception as problem:
        raise InputError(f"{path}: {type(problem).__name__}: {problem}") from None
    missing = [name for name in ("MODEL", "DESCRIPTION") if not isinstance(getattr(module, name, None), str)]
    if not hasattr(module, "variables"):
        missing += [name for name in TABLES if not hasattr(module, name)]
    if missing:
        raise InputError(f"{path}: no {', '.join(missing)}")
    return module


def variables_of(interface: ModuleType, path: Path) -> Variables:
    """The scalar variables in the order of their value references: `variables()` where the module has it, else the
    rows of its tables. Raises InputError that names all that is at fault in `path`.

    Keys: name, causality, variability, unit, start (absent for outputs), min, max, description, depends (inputs that
    act on an output at once), and for enumerations items."""
    try:
        variables = interface.variables() if hasattr(interface, "variables") else _rows(interface)
    except InputError as problem:
        raise InputError(f"{path}: {problem}") from None
    except Exception as problem:
        raise InputError(f"{path}: {type(problem).__name__}: {problem}") from None
    problems = _problems(variables)
    if problems:
        raise InputError(f"{path}: {'; '.join(problems)}")
    return list(variables)


def _rows(interface: ModuleType) -> Variables:
    for table, columns in TABLES.items():
        for k, row in enumerate(getattr(interface, table)):
            if len(row) != len(columns):
                raise InputError(f"{table}, row {k + 1}: {len(row)} entries; its columns are {', '.join(columns)}")
    out: Variables = []
    for name, unit, start, least, greatest, text in interface.PARAMETERS:
        row = dict(name=name, causality="parameter", variability="fixed", unit=unit, description=text)
        out.append(row | dict(start=start, min=least, max=greatest))
    for name, unit, text in interface.INPUTS:
        row = dict(name=name, causality="input", variability="continuous", unit=unit, description=text)
        out.append(row | dict(start=0.0))
    for name, unit, text, depends in interface.OUTPUTS:
        row = dict(name=name, causality="output", variability="continuous", unit=unit, description=text)
        out.append(row | dict(depends=list(depends)))
    return out


def _problems(variables: Variables) -> list[str]:
    problems = []
    names = [v.get("name") for v in variables]
    inputs = {v.get("name") for v in variables if v.get("causality") in ("input", "parameter")}
    for k, v in enumerate(variables):
        name = v.get("name")
        lacking = [
            key for key in ("name", "causality", "variability", "description") if not isinstance(v.get(key), str)
        ]
        if "items" not in v and "unit" not in v:
            lacking.append("unit")
        if lacking:
            problems.append(f"variable {name or k + 1} has no {', '.join(lacking)}")
            continue
        if names.index(name) != k:
            problems.append(f"two variables named {name}")
        unit = v.get("unit")
        if "items" not in v and unit not in BASE_UNITS:
            problems.append(f"{name}: unit {unit!r} is not one of {', '.join(BASE_UNITS)}")
        least, greatest = v.get("min", -math.inf), v.get("max", math.inf)
        if not least <= v.get("start", max(least, min(0.0, greatest))) <= greatest:
            problems.append(f"{name}: start {v['start']:g} is outside its range {least:g} ... {greatest:g}")
        unknown = [n for n in v.get("depends", ()) if n not in inputs]
        if unknown:
            problems.append(f"{name}: depends on {', '.join(unknown)}, which is no input")
    return problems


def model_description(
    name: str,
    description: str,
    variables: Variables,
    fixed_step: float | None = None,
    differentiates: bool = False,
) -> str:
    """modelDescription.xml of FMI 2.0 with GUID_PLACE for the GUID; value references are positions in `variables`.
    `fixed_step` [s] is the model's own step where it cannot take another one; `differentiates`: it gives directional
    derivatives of its outputs over its inputs."""
    root = _root("2.0", "guid", name, description)
    capabilities = {
        "modelIdentifier": name,
        "needsExecutionTool": "false",
        "canHandleVariableCommunicationStepSize": "false" if fixed_step else "true",
        "canBeInstantiatedOnlyOncePerProcess": "false",
        "canNotUseMemoryManagementFunctions": "true",
        "canGetAndSetFMUstate": "true",
        "canSerializeFMUstate": "true",
    }
    if differentiates:
        capabilities["providesDirectionalDerivative"] = "true"
    ET.SubElement(root, "CoSimulation", capabilities)
    _units(root, variables)
    enumerations = [v for v in variables if "items" in v]
    if enumerations:
        types = ET.SubElement(root, "TypeDefinitions")
        for variable in enumerations:
            _items(ET.SubElement(ET.SubElement(types, "SimpleType", name=variable["name"]), "Enumeration"), variable)
    _experiment(root, fixed_step)
    listed = ET.SubElement(root, "ModelVariables")
    position = {v["name"]: k + 1 for k, v in enumerate(variables)}
    for k, variable in enumerate(variables):
        scalar = ET.SubElement(listed, "ScalarVariable", _common(variable), valueReference=str(k))
        ET.SubElement(scalar, "Enumeration" if "items" in variable else "Real", _values(variable))
    structure = ET.SubElement(root, "ModelStructure")
    outputs = [v for v in variables if v["causality"] == "output"]
    for section in ("Outputs", "InitialUnknowns"):
        group = ET.SubElement(structure, section)
        for variable in outputs:
            unknown = ET.SubElement(group, "Unknown", index=str(position[variable["name"]]))
            if section == "Outputs" and "depends" in variable:
                unknown.set("dependencies", " ".join(str(position[n]) for n in variable["depends"]))
    return _text(root)


def model_description_3(
    name: str,
    description: str,
    variables: Variables,
    fixed_step: float | None = None,
    differentiates: bool = False,
) -> str:
    """The same model in FMI 3.0, with the same value references; the independent variable `time` follows the others."""
    root = _root("3.0", "instantiationToken", name, description)
    capabilities = {
        "modelIdentifier": name,
        "needsExecutionTool": "false",
        "canBeInstantiatedOnlyOncePerProcess": "false",
        "canGetAndSetFMUState": "true",
        "canSerializeFMUState": "true",
        "providesDirectionalDerivatives": "true" if differentiates else "false",
        "canHandleVariableCommunicationStepSize": "false" if fixed_step else "true",
        "hasEventMode": "false",
    }
    if fixed_step:
        capabilities["fixedInternalStepSize"] = repr(fixed_step)
    ET.SubElement(root, "CoSimulation", capabilities)
    _units(root, variables)
    enumerations = [v for v in variables if "items" in v]
    if enumerations:
        types = ET.SubElement(root, "TypeDefinitions")
        for variable in enumerations:
            _items(ET.SubElement(types, "EnumerationType", name=variable["name"]), variable)
    _experiment(root, fixed_step)
    listed = ET.SubElement(root, "ModelVariables")
    reference = {v["name"]: str(k) for k, v in enumerate(variables)}
    for variable in variables:
        tag = "Enumeration" if "items" in variable else "Float64"
        entry = {**_common(variable), **_values(variable), "valueReference": reference[variable["name"]]}
        ET.SubElement(listed, tag, entry)
    ET.SubElement(
        listed,
        "Float64",
        name="time",
        valueReference=str(len(variables)),
        causality="independent",
        variability="continuous",
        unit="s",
        description="Simulation time",
    )
    structure = ET.SubElement(root, "ModelStructure")
    outputs = [v for v in variables if v["causality"] == "output"]
    for variable in outputs:
        unknown = ET.SubElement(structure, "Output", valueReference=reference[variable["name"]])
        if "depends" in variable:
            unknown.set("dependencies", " ".join(reference[n] for n in variable["depends"]))
    for variable in outputs:
        ET.SubElement(structure, "InitialUnknown", valueReference=reference[variable["name"]])
    return _text(root)


def _root(version: str, identity: str, name: str, description: str) -> ET.Element:
    return ET.Element(
        "fmiModelDescription",
        {"fmiVersion": version, "modelName": name, identity: GUID_PLACE},
        description=description,
        generationTool="sprain-cosim",
        variableNamingConvention="flat",
    )


def _units(root: ET.Element, variables: Variables) -> None:
    units = ET.SubElement(root, "UnitDefinitions")
    used = {v["unit"] for v in variables if "unit" in v}
    for unit in sorted(used | ({"s"} if root.get("fmiVersion") == "3.0" else set())):
        base = {key: str(exponent) for key, exponent in BASE_UNITS[unit].items()}
        ET.SubElement(ET.SubElement(units, "Unit", name=unit), "BaseUnit", base)


def _items(enumeration: ET.Element, variable: dict[str, Any]) -> None:
    for item, value in variable["items"].items():
        ET.SubElement(enumeration, "Item", name=item, value=str(value))


def _experiment(root: ET.Element, fixed_step: float | None) -> None:
    ET.SubElement(ET.SubElement(root, "LogCategories"), "Category", name="logAll")
    ET.SubElement(root, "DefaultExperiment", startTime="0", stopTime="0.15", stepSize=repr(fixed_step or STEP))


def _common(variable: dict[str, Any]) -> dict[str, str]:
    """Attributes that every kind of variable has."""
    entry: dict[str, str] = {key: variable[key] for key in ("name", "causality", "variability", "description")}
    if variable["causality"] == "output":
        entry["initial"] = "calculated"
    elif variable["causality"] == "parameter":
        entry["initial"] = "exact"
    if "items" in variable:
        entry["variability"] = "fixed"
    return entry


def _values(variable: dict[str, Any]) -> dict[str, str]:
    if "items" in variable:
        return {"declaredType": variable["name"], "start": str(variable["start"])}
    entry: dict[str, str] = {"unit": variable["unit"]}
    for key in ("min", "max", "start"):
        if key in variable:
            entry[key] = repr(float(variable[key]))
    return entry


def _text(root: ET.Element) -> str:
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"
