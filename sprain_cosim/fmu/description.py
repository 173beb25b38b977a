"""An FMU described from its archive, without running its code: modelDescription.xml becomes connectors and
capabilities."""

from __future__ import annotations

import io
import math
import re
import zipfile
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache, partial
from pathlib import Path
from typing import Any, NamedTuple, Self

from ..errors import InputError
from ..notebook import Rows
from ..sandbox.allowed import NOTHING, Allowed
from ..units import Unit, unit
from . import archive
from .element import NUMBERS, Array, Capabilities, Connector, Element
from .library import find, load_fmpy
from .repair import read_leniently

OWN_TOOL = "sprain-cosim"
MOST_VARIABLES = 100_000  # 2 s and 300 MB
MAX_ELEMENTS = 1000  # of an array, so that each of them is a connector
PYTHON_SLAVE = "resources/slavemodule.txt"  # what PythonFMU and PythonFMU3 put into their FMUs


@dataclass(frozen=True, repr=False)
class Description(Element):
    """An FMU given a name; reading it runs no code of it.

    fmu         the file
    sha256      of the file's content
    identifier  modelIdentifier, the stem of the library's name
    guid        identity of the model; the library must have the same
    library     path of this platform's library inside the archive
    quirks      what breaks the rules of FMI where nothing here looks, one line each
    needs_tool  the authoring tool that must be there at run time; "" for none
    allowed     what it may do beyond the sandbox
    constants   {parameter, or input that nothing feeds: its value, as it was written}, unless a run sets another
    resources   whether it holds files that an instance may read
    """

    fmu: Path
    sha256: str
    identifier: str
    guid: str
    library: str
    quirks: tuple[str, ...] = ()
    needs_tool: str = ""
    allowed: Allowed = NOTHING
    constants: Mapping[str, float | str | bool] = field(default_factory=dict)
    resources: bool = True

    @cached_property
    def doubles(self) -> dict[str, int]:
        """{name: value reference} of the variables that FMI passes as double-precision numbers, as they are."""
        return {
            n: c.reference
            for n, c in self.connectors.items()
            if c.kind == "real" and c.fmi_type in ("Real", "Float64") and c.array is None and not c.negated
        }

    def card(self) -> tuple[str, Rows]:
        heading, rows = super().card()
        made = f", made by {self.capabilities.tool}" if self.capabilities.tool else ""
        return heading, [("FMU", f"{self.fmu.name}, {self.capabilities.interface}{made}"), *rows]

    @classmethod
    def read(cls, name: str, fmu: Path | str) -> Self:
        """Raises InputError when the file is not an FMU that can be run here."""
        return cls.of(name, archive.read(Path(fmu)))

    @classmethod
    def of(cls, name: str, checked: archive.Archive) -> Self:
        """The same of an archive that has been read."""
        path = checked.path
        try:
            model = _model(checked.sha256, checked.description, checked.names)
            library = find(path, model.identifier, model.capabilities.fmi_version, checked.names, model.sources_listed)
        except InputError as problem:
            raise InputError(f"{path}: {problem}") from None
        except MemoryError:
            raise
        except Exception as problem:  # what the checks of fmpy let through
            raise InputError(f"{path}: modelDescription.xml is not valid: {first_line(problem)}") from None
        return cls(
            name,
            model.connectors,
            model.capabilities,
            path,
            checked.sha256,
            model.identifier,
            model.guid,
            library,
            (*checked.quirks, *model.quirks),
            model.needs_tool,
            resources=any(name.startswith(f"{archive.RESOURCES}/") for name in checked.names),
        )


def first_line(problem: BaseException) -> str:
    """The first three lines of an exception's text, as one."""
    lines = [
        line.strip(" -").removeprefix("ERROR ")
        for line in str(problem).splitlines()
        if line.strip() and not line.startswith("Failed to validate")
    ]
    return "; ".join(lines[:3]) or type(problem).__name__


class _Model(NamedTuple):
    """What the description says, the file's name and place aside."""

    connectors: Mapping[str, Connector]
    capabilities: Capabilities
    identifier: str
    guid: str
    quirks: tuple[str, ...]
    needs_tool: str
    sources_listed: bool


@lru_cache(maxsize=64)
def _model(sha256: str, description: bytes, names: tuple[str, ...]) -> _Model:
    """Once for each content of an archive, whatever its path and however often it is read."""
    md, quirks = _parsed(description)
    version = ".".join(md.fmiVersion.split(".")[:2])
    interface = _interface(md, version)
    wrapper = version == "1.0" and b"<CoSimulation_Tool" in description
    needs_tool = wrapper or (interface.needsExecutionTool and PYTHON_SLAVE not in names)  # PythonFMU: of Python itself
    return _Model(
        _connectors(md, _negated(description) if version == "1.0" else frozenset(), _periods(interface, description)),
        _capabilities(md, version, interface, names),
        interface.modelIdentifier,
        md.guid,
        tuple(quirks),
        (md.generationTool or "unnamed") if needs_tool else "",
        bool(md.buildConfigurations) or "sources/buildDescription.xml" in names,
    )


def _parsed(description: bytes) -> tuple[Any, list[str]]:
    """fmpy's ModelDescription of a modelDescription.xml, and what is wrong with it where nothing here looks."""
    if not re.search(rb"<fmiModelDescription\s[^>]*fmiVersion\s*=", description):
        raise InputError("modelDescription.xml is not valid: no fmiModelDescription with an fmiVersion in it")
    if re.search(rb"""<Unknown\s[^>]*index\s*=\s*["']0+["']""", description):
        raise InputError("modelDescription.xml is not valid: an index 0 in ModelStructure; they count from 1")
    try:
        return _read(description), []
    except (MemoryError, InputError):
        raise
    except Exception as problem:
        strict = first_line(problem)
    try:
        return read_leniently(description, partial(_read, validate=False))
    except MemoryError:
        raise
    except Exception as problem:
        says = str(problem) if isinstance(problem, InputError) else strict
        raise InputError(f"modelDescription.xml is not valid: {says}") from None


def _read(description: bytes, validate: bool = True) -> Any:
    load_fmpy()
    from fmpy.model_description import read_model_description

    count = description.count(b"valueReference")
    if count > MOST_VARIABLES:
        raise InputError(
            f"modelDescription.xml has some {count} variables; at most {MOST_VARIABLES} are accepted; export the FMU "
            "without the model's inner variables"
        )
    container = io.BytesIO()  # fmpy wants an archive; this one holds nothing but the description that was checked
    with zipfile.ZipFile(container, "w") as packed:
        packed.writestr("modelDescription.xml", description)
    container.seek(0)
    return read_model_description(container, validate=validate)


def _interface(md: Any, version: str) -> Any:
    """Co-simulation where the FMU has both. Raises InputError for what cannot be run."""
    if version not in ("1.0", "2.0", "3.0"):
        raise InputError(f"FMI {md.fmiVersion} is not supported; export it as FMI 2.0 co-simulation")
    chosen = md.coSimulation or md.modelExchange
    if md.coSimulation and md.modelExchange and md.coSimulation.needsExecutionTool:
        chosen = md.coSimulation if md.modelExchange.needsExecutionTool else md.modelExchange
    if chosen is None:
        raise InputError(
            "offers neither co-simulation nor model exchange (scheduled execution only); export it for co-simulation"
        )
    return chosen


def _capabilities(md: Any, version: str, interface: Any, names: Collection[str]) -> Capabilities:
    tool = md.generationTool or ""
    return Capabilities(
        version,
        _fixed_step(md, interface),
        bool(getattr(interface, "canGetAndSetFMUstate", False)),
        tool == OWN_TOOL,
        tool,
        interface is md.modelExchange,
        md.numberOfContinuousStates,
        md.numberOfEventIndicators,
        shared_modules=PYTHON_SLAVE in names and tool != OWN_TOOL,
        single=bool(getattr(interface, "canBeInstantiatedOnlyOncePerProcess", False)),
        variable_step=interface is md.modelExchange or bool(interface.canHandleVariableCommunicationStepSize),
        event_mode=bool(getattr(interface, "hasEventMode", False)),
        early_return=bool(getattr(interface, "mightReturnEarlyFromDoStep", False)),
    )


def _fixed_step(md: Any, cs: Any) -> float | None:
    """The FMU's own step [s]; None where it takes any."""
    if cs is md.modelExchange:
        return None
    internal = getattr(cs, "fixedInternalStepSize", None)
    if internal:
        return float(internal)
    if (
        not cs.canHandleVariableCommunicationStepSize
        and md.defaultExperiment is not None
        and md.defaultExperiment.stepSize
    ):
        return float(md.defaultExperiment.stepSize)
    return None


# ---- variables


def _periods(interface: Any, description: bytes) -> dict[str, tuple[float, float]]:
    """{input clock of constant interval, which the host of event mode has to tick: interval and shift [s]}; fmpy does
    not read them."""
    if b"intervalDecimal" not in description or not getattr(interface, "hasEventMode", False):
        return {}
    from xml.etree import ElementTree

    found = {}
    for clock in ElementTree.fromstring(description).iterfind("ModelVariables/Clock"):
        interval, shift = _number(clock.get("intervalDecimal")), _number(clock.get("shiftDecimal"), 0.0)
        if (clock.get("causality"), clock.get("intervalVariability")) == ("input", "constant") and (interval or 0) > 0:
            found[clock.get("name", "")] = (interval, shift)
    return found


def _negated(description: bytes) -> frozenset[str]:
    """Variables of FMI 1.0 whose values come, and are sent, with the other sign; fmpy does not tell."""
    if b"negatedAlias" not in description:
        return frozenset()
    from xml.etree import ElementTree

    variables = ElementTree.fromstring(description).iterfind("ModelVariables/ScalarVariable")
    return frozenset(v.get("name", "") for v in variables if v.get("alias") == "negatedAlias")


def _connectors(md: Any, negated: frozenset[str], periods: Mapping[str, tuple[float, float]]) -> dict[str, Connector]:
    """{name: connector}; `negated`: with the other sign, `periods` as `_periods` gives them. Raises InputError for
    variables that cannot be coupled."""
    wrong = next((u.variable.name for u in md.outputs if u.variable.causality != "output"), None)
    if wrong is not None:
        raise InputError(f"modelDescription.xml is not valid: {wrong} is listed among the outputs, but is none")
    units = {u.name: u.baseUnit for u in md.unitDefinitions}
    unknowns = {u.variable.name: u for u in md.outputs}
    arrays = {v.name: array for v in md.modelVariables if (array := _array(v)) is not None}
    ticks = {v.name for v in md.modelVariables if _kind(v) == "clock" and v.causality == "input"}
    connectors: dict[str, Connector] = {}
    for v in md.modelVariables:
        kind, causality = _kind(v), _causality(v)
        if not v.name:
            raise InputError("modelDescription.xml is not valid: a variable without a name")
        whole = Connector(
            v.name,
            int(v.valueReference),
            causality,
            kind,
            _unit(v, units),
            None if kind == "array" else _number(v.start),
            _number(_declared(v, "min"), -math.inf),
            _number(_declared(v, "max"), math.inf),
            {item.name: int(item.value) for item in getattr(v.declaredType, "items", None) or ()},
            v.description or "",
            _dependencies(unknowns.get(v.name), arrays),
            v.type,
            tuple(c.name for c in getattr(v, "clocks", None) or () if c.name in ticks),
            interval=periods.get(v.name, (None, 0.0))[0],
            shift=periods.get(v.name, (None, 0.0))[1],
            negated=v.name in negated,
        )
        connectors[v.name] = whole
        array = arrays.get(v.name)
        for k, name in enumerate(array.names() if array is not None else ()):
            start = array.start[k] if array is not None else None
            one = replace(whole, name=name, kind=_scalar_kind(v), start=start, array=array, element=k)
            connectors.setdefault(name, one)
    return connectors


def _array(v: Any) -> Array | None:
    """The array whose elements can be coupled; None for a scalar, for texts, for one that is too large or whose start
    values are not as many as its elements."""
    shape = tuple(int(n) for n in getattr(v, "shape", None) or ())
    if not shape or not 1 <= math.prod(shape) <= MAX_ELEMENTS or _scalar_kind(v) not in NUMBERS:
        return None
    start = tuple(_number(text) for text in str("0" if v.start is None else v.start).split())
    start = start * math.prod(shape) if len(start) == 1 else start
    return None if len(start) != math.prod(shape) or None in start else Array(v.name, shape, start)


def _kind(v: Any) -> str:
    return "array" if getattr(v, "dimensions", None) else _scalar_kind(v)


def _scalar_kind(v: Any) -> str:
    name = v.type.lower()
    return "real" if name.startswith("float") else "integer" if name.strip("u").startswith("int") else name


def _causality(v: Any) -> str:
    """FMI 1.0 has parameters by variability, and outputs and locals under other names."""
    if v.causality in ("input", "output", "parameter", "calculatedParameter", "structuralParameter", "independent"):
        return str(v.causality)
    return "parameter" if v.variability == "parameter" and v.causality in (None, "internal", "none") else "local"


def _unit_name(v: Any) -> str | None:
    return _declared(v, "unit")


def _declared(v: Any, attribute: str) -> str | None:
    """As the variable or its type says."""
    return getattr(v, attribute) or getattr(v.declaredType, attribute, None)


def _unit(v: Any, units: Mapping[str, Any]) -> Unit | None:
    """By the FMU's own definition {name: base unit or None}, else by its name; None for no unit. A name that says
    nothing stays without dimension: nobody knows what it is, so it is not taken for SI."""
    name = _unit_name(v)
    if not name:
        return None
    base = units.get(name)
    if base is not None:
        exponents = (base.kg, base.m, base.s, base.A, base.K, base.mol, base.cd, base.rad)
        return Unit(name, exponents, float(base.factor), float(base.offset))
    try:
        return unit(name)
    except InputError:
        return Unit(str(name))


def _dependencies(unknown: Any, arrays: Mapping[str, Array]) -> tuple[str, ...] | None:
    """Of an array all elements."""
    if unknown is None or unknown.dependencies is None:
        return None
    names = [arrays[d.name].names() if d.name in arrays else [d.name] for d in unknown.dependencies]
    return tuple(name for several in names for name in several)


def _number(text: Any, default: Any = None) -> Any:
    if text is None:
        return default
    if str(text) in ("true", "false"):
        return float(str(text) == "true")
    try:
        return float(text)
    except ValueError:
        return default
