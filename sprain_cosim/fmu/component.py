"""One FMU: described without running its code, opened, driven.

`Component` is the description, frozen and picklable. `Component.open()` gives an `Instance`: the handful of methods
that the rest of the package drives a simulator with. Anything that has these methods can take part, FMU or not."""

from __future__ import annotations

import contextlib
import io
import math
import re
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from ..errors import InputError, nearest
from ..units import Unit, quantity
from . import archive, library

OWN_TOOL = "sprain-cosim"
PYTHON_SLAVE = "resources/slavemodule.txt"  # what PythonFMU and PythonFMU3 put into their FMUs


@dataclass(frozen=True)
class Connector:
    """One scalar variable. `unit` is None where the FMU declares none; `items` are the values of an enumeration by
    name; `start` is None where the FMU gives none or it is not a number; `depends_on` names the inputs that act on an
    output directly (None: not declared)."""

    name: str
    reference: int
    causality: str
    kind: str
    unit: Unit | None = None
    start: float | None = None
    minimum: float = -math.inf
    maximum: float = math.inf
    items: Mapping[str, int] = field(default_factory=dict)
    description: str = ""
    depends_on: tuple[str, ...] | None = None
    fmi_type: str = "Real"

    @property
    def scalar_number(self) -> bool:
        """Whether it can be connected or set: not text, not an array, not a clock."""
        return self.kind in ("real", "integer", "enumeration", "boolean")

    def value(self, given: float | str | bool, what: str) -> float:
        """A value from a file or the command line in the connector's own unit. Raises InputError: unit, kind or
        range."""
        if self.items:
            if isinstance(given, str) and given in self.items:
                return float(self.items[given])
            raise InputError(
                f"{what} = {given!r}: must be one of "
                f"{', '.join(self.items)}{nearest(str(given), self.items) if len(self.items) > 12 else ''}"
            )
        if self.kind == "boolean":
            if isinstance(given, bool) or given in (0, 1, "true", "false"):
                return float(given in (True, 1, "true"))
            raise InputError(f"{what} = {given!r}: must be true or false")
        if not self.scalar_number:
            raise InputError(f"{what}: {self.kind} parameters cannot be set")
        number = quantity(given, self.unit, what)
        if self.kind != "real" and number != int(number):
            raise InputError(f"{what} = {given!r}: must be a whole number")
        if not self.minimum <= number <= self.maximum:
            unit = f" {self.unit.name}" if self.unit and not self.unit.dimensionless else ""
            raise InputError(f"{what} = {given}: outside its range {self.minimum:.6g} ... {self.maximum:.6g}{unit}")
        return number


@dataclass(frozen=True)
class Capabilities:
    """What the FMU declares. `fixed_step` [s] is its own step where it cannot take another one; `states` and
    `event_indicators` count those of an FMI 2 model exchange FMU; `reusable`: its reset is known to work;
    `shared_modules`: its Python modules have names that another FMU's may have as well, so it needs a process of its
    own; `single`: one instance per process; `variable_step`: its communication step may change during a run;
    `event_mode`, `early_return`: an FMI 3 FMU uses event mode, may return before the end of a step."""

    fmi_version: str
    fixed_step: float | None = None
    state: bool = False
    reusable: bool = False
    tool: str = ""
    model_exchange: bool = False
    states: int = 0
    event_indicators: int = 0
    shared_modules: bool = False
    single: bool = False
    variable_step: bool = True
    event_mode: bool = False
    early_return: bool = False

    @property
    def interface(self) -> str:
        return f"FMI {self.fmi_version} {'model exchange' if self.model_exchange else 'co-simulation'}"


@dataclass(frozen=True)
class Component:
    """An FMU given a name. Reading it runs no native code."""

    name: str
    fmu: Path
    sha256: str
    connectors: Mapping[str, Connector]
    capabilities: Capabilities
    identifier: str
    guid: str
    library: str
    warnings: tuple[str, ...] = ()

    @classmethod
    def read(cls, name: str, fmu: Path | str) -> Component:
        """Raises InputError when the file is not an FMU that can be run here."""
        path = Path(fmu)
        checked = archive.read(path)
        try:
            return cls(name, path, checked.sha256, *_describe(checked.sha256, checked.description, checked.names))
        except InputError as problem:
            raise InputError(f"{path}: {problem}") from None
        except Exception as problem:  # what the checks of fmpy let through
            raise InputError(f"{path}: modelDescription.xml is not valid: {first_line(problem)}") from None

    def select(self, causality: str) -> dict[str, Connector]:
        return {n: c for n, c in self.connectors.items() if c.causality == causality}

    @property
    def inputs(self) -> dict[str, Connector]:
        return self.select("input")

    @property
    def outputs(self) -> dict[str, Connector]:
        return self.select("output")

    @property
    def parameters(self) -> dict[str, Connector]:
        """What may be set before a run."""
        return {n: c for n, c in self.connectors.items() if c.causality == "parameter"}

    def library_problem(self) -> str:
        """What keeps the library from being used, by its file alone: not of this machine, cut off, functions of FMI
        that it does not name. Empty when nothing does. Raises InputError for a damaged archive."""
        from fmpy import fmi1, fmi2, fmi3

        kinds: dict[tuple[str, bool], Any] = {
            ("1.0", False): fmi1.FMU1Slave,
            ("2.0", False): fmi2.FMU2Slave,
            ("2.0", True): fmi2.FMU2Model,
            ("3.0", False): fmi3.FMU3Slave,
            ("3.0", True): fmi3.FMU3Model,
        }
        prefix = f"fmi{self.capabilities.fmi_version[0]}"
        wanted = [
            n
            for n in dir(kinds[self.capabilities.fmi_version, self.capabilities.model_exchange])
            if n.startswith(prefix)
        ]
        if prefix == "fmi1":
            wanted = [f"{self.identifier}_{n.replace('fmi1', 'fmi')}" for n in wanted]
        data = archive.member(self.fmu, self.library)
        damage = library.problem(data)
        if damage:
            return f"{self.library} {damage}"
        missing = [n for n in wanted if n.encode() not in data]
        few = ", ".join(missing[:3]) + (f" and {len(missing) - 3} more" if len(missing) > 3 else "")
        return (
            f"its library lacks the FMI functions {few}; export it with all functions of {self.capabilities.interface}"
            if missing
            else ""
        )

    def complaints(self) -> list[str]:
        """What fmpy's validation finds wrong with the description; nothing is loaded."""
        from fmpy.validation import validate_fmu

        return [str(problem) for problem in validate_fmu(str(self.fmu))]

    def open(self) -> Instance:
        """Loads the FMU's code and instantiates it. Raises SimulationError or EnvironmentProblem."""
        kind = self.capabilities.fmi_version, self.capabilities.model_exchange
        if kind == ("2.0", False):
            from .fmi2 import Fmi2CoSimulation

            return Fmi2CoSimulation(self)
        if kind == ("3.0", False):
            from .fmi3 import Fmi3CoSimulation

            return Fmi3CoSimulation(self)
        if kind == ("1.0", False):
            from .fmi1 import Fmi1CoSimulation

            return Fmi1CoSimulation(self)
        from .model_exchange import Fmi2ModelExchange, Fmi3ModelExchange

        return (Fmi2ModelExchange if kind[0] == "2.0" else Fmi3ModelExchange)(self)


class Instance(Protocol):
    """A running component. Order of the calls: bind - set_parameters - enter_initialization - (set_inputs,
    get_outputs)* - exit_initialization - (set_inputs, do_step, get_outputs)* - reset or close.

    `bind` lays `inputs` and `outputs` on the bus; the last `feedthrough` outputs follow inputs directly. `set_inputs`
    sends the inputs from the bus, `get_outputs` fetches all outputs onto it, `get_outputs_without_feedthrough` and
    `get_feedthrough_outputs` fetch those before and those after that boundary. `watch_locals` chooses further
    variables, `get_locals` fetches them into `seen`. `save_before_steps`: from the next start on, the state is saved
    before each step, so that a step that is refused can be taken in parts. After a SimulationError only `close` may be
    called."""

    def bind(
        self,
        bus: np.ndarray,
        inputs: Sequence[str],
        first_input: int,
        outputs: Sequence[str],
        first_output: int,
        feedthrough: int,
    ) -> None: ...
    def set_parameters(self, values: Mapping[str, float]) -> None: ...
    def enter_initialization(self, time: float, stop: float) -> None: ...
    def exit_initialization(self) -> None: ...
    def set_inputs(self) -> None: ...
    def get_outputs(self) -> None: ...
    def get_outputs_without_feedthrough(self) -> None: ...
    def get_feedthrough_outputs(self) -> None: ...
    def watch_locals(self, names: Sequence[str], seen: np.ndarray) -> None: ...
    def get_locals(self) -> None: ...
    def do_step(self, time: float, step: float) -> None: ...
    def save_before_steps(self) -> None: ...
    def save_state(self) -> Any: ...
    def restore_state(self, state: Any) -> None: ...
    def free_state(self, state: Any) -> None: ...
    def reset(self) -> None: ...
    def close(self) -> None: ...


# ---- description


@lru_cache(maxsize=64)
def _describe(
    sha256: str, description: bytes, names: tuple[str, ...]
) -> tuple[Mapping[str, Connector], Capabilities, str, str, str, tuple[str, ...]]:
    import fmpy
    from fmpy.model_description import read_model_description

    container = io.BytesIO()  # fmpy wants an archive; this one holds nothing but the description that was checked
    with zipfile.ZipFile(container, "w") as packed:
        packed.writestr("modelDescription.xml", description)
    container.seek(0)
    if not re.search(rb"<fmiModelDescription\s[^>]*fmiVersion\s*=", description):
        raise InputError("modelDescription.xml is not valid: no fmiModelDescription with an fmiVersion in it")
    if re.search(rb"""<Unknown\s[^>]*index\s*=\s*["']0+["']""", description):
        raise InputError("modelDescription.xml is not valid: an index 0 in ModelStructure; they count from 1")
    try:
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            md = read_model_description(container)
    except Exception as problem:
        raise InputError(f"modelDescription.xml is not valid: {first_line(problem)}") from None
    version = ".".join(md.fmiVersion.split(".")[:2])
    chosen = _interface(md, version)
    if chosen.needsExecutionTool and PYTHON_SLAVE not in names:  # PythonFMU says so of Python itself
        raise InputError(
            f"needs its authoring tool ({md.generationTool or 'unnamed'}) at run time; export it with the tool's "
            "stand-alone option"
        )
    platform = fmpy.platform_tuple if version == "3.0" else fmpy.platform
    binary = f"binaries/{platform}/{chosen.modelIdentifier}{fmpy.sharedLibraryExtension}"
    if binary not in names:
        there = sorted({n.split("/")[1] for n in names if n.startswith("binaries/") and n.count("/") >= 2})
        raise InputError(
            f"no binary for this platform ({binary}); it has {', '.join(there) or 'none'}; export it for {platform}"
        )
    warnings: list[str] = []
    units = {u.name: u for u in md.unitDefinitions}
    dependencies = {u.variable.name: u for u in md.outputs}
    wrong = next((u.variable.name for u in md.outputs if u.variable.causality != "output"), None)
    if wrong is not None:
        raise InputError(f"modelDescription.xml is not valid: {wrong} is listed among the outputs, but is none")
    connectors: dict[str, Connector] = {}
    for v in md.modelVariables:
        kind = _kind(v)
        causality = _causality(v)
        if not v.name:
            raise InputError("modelDescription.xml is not valid: a variable without a name")
        if kind == "binary" and causality in ("input", "output", "parameter"):
            raise InputError(f"{v.name}: a binary variable, which cannot be coupled; export the FMU without it")
        unit_name = v.unit or (
            v.declaredType.unit if v.declaredType is not None and getattr(v.declaredType, "unit", None) else None
        )
        unit = None
        if unit_name and unit_name in units and units[unit_name].baseUnit is not None:
            b = units[unit_name].baseUnit
            unit = Unit(unit_name, (b.kg, b.m, b.s, b.A, b.K, b.mol, b.cd, b.rad), float(b.factor), float(b.offset))
        elif unit_name:
            unit = _unit_by_name(unit_name)
            if unit is None:
                warnings.append(f"{v.name}: unit {unit_name!r} is not defined; SI is assumed")
        elif kind == "real" and causality in ("input", "output"):
            warnings.append(f"{v.name}: no unit declared; SI is assumed")
        items: dict[str, int] = {}
        declared = v.declaredType
        if declared is not None and getattr(declared, "items", None):
            items = {item.name: int(item.value) for item in declared.items}
        unknown = dependencies.get(v.name)
        depends = None
        if unknown is not None and unknown.dependencies is not None:
            depends = tuple(d.name for d in unknown.dependencies)
        connectors[v.name] = Connector(
            v.name,
            int(v.valueReference),
            causality,
            kind,
            unit,
            _number(v.start),
            _number(v.min, -math.inf),
            _number(v.max, math.inf),
            items,
            v.description or "",
            depends,
            v.type,
        )
    tool = md.generationTool or ""
    capabilities = Capabilities(
        version,
        _fixed_step(md),
        bool(getattr(chosen, "canGetAndSetFMUstate", False)),
        tool == OWN_TOOL,
        tool,
        md.coSimulation is None,
        md.numberOfContinuousStates,
        md.numberOfEventIndicators,
        shared_modules=PYTHON_SLAVE in names and tool != OWN_TOOL,
        single=bool(getattr(chosen, "canBeInstantiatedOnlyOncePerProcess", False)),
        variable_step=md.coSimulation is None or bool(md.coSimulation.canHandleVariableCommunicationStepSize),
        event_mode=bool(getattr(chosen, "hasEventMode", False)),
        early_return=bool(getattr(chosen, "mightReturnEarlyFromDoStep", False)),
    )
    return connectors, capabilities, chosen.modelIdentifier, md.guid, binary, tuple(warnings)


def _interface(md: Any, version: str) -> Any:
    """Co-simulation where the FMU has both. Raises InputError for what cannot be run."""
    if version == "1.0" and md.coSimulation is None:
        raise InputError(
            "an FMI 1.0 model exchange FMU, which is not supported; export it as FMI 2.0 or 3.0, best for co-simulation"
        )
    if version not in ("1.0", "2.0", "3.0"):
        raise InputError(f"FMI {md.fmiVersion} is not supported; export it as FMI 2.0 co-simulation")
    chosen = md.coSimulation or md.modelExchange
    if chosen is None:
        raise InputError(
            "offers neither co-simulation nor model exchange (scheduled execution only); export it for co-simulation"
        )
    return chosen


def _kind(v: Any) -> str:
    if getattr(v, "dimensions", None):
        return "array"
    name = v.type.lower()
    return "real" if name.startswith("float") else "integer" if name.strip("u").startswith("int") else name


def _causality(v: Any) -> str:
    """FMI 1.0 has parameters by variability, and outputs and locals under other names."""
    if v.causality in ("input", "output", "parameter", "calculatedParameter", "structuralParameter", "independent"):
        return str(v.causality)
    return "parameter" if v.variability == "parameter" and v.causality in (None, "internal", "none") else "local"


def _fixed_step(md: Any) -> float | None:
    cs = md.coSimulation
    if cs is None:
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


def _unit_by_name(name: str) -> Unit | None:
    from ..units import unit

    try:
        return unit(name)
    except InputError:
        return None


def _number(text: Any, default: float | None = None) -> Any:
    if text is None:
        return default
    if str(text) in ("true", "false"):
        return float(str(text) == "true")
    try:
        return float(text)
    except ValueError:
        return default


def first_line(problem: BaseException) -> str:
    lines = [
        line.strip(" -").removeprefix("ERROR ")
        for line in str(problem).splitlines()
        if line.strip() and not line.startswith("Failed to validate")
    ]
    return "; ".join(lines[:3]) or type(problem).__name__
