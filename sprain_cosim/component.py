"""One FMU: described without running its code, opened, driven.

`Component` is the description, frozen and picklable. `Component.open()` gives an `Instance`: the handful of methods that the rest of the
package drives a simulator with. Anything that has these methods can take part, FMU or not.
"""

from __future__ import annotations

import atexit
import contextlib
import ctypes
import io
import itertools
import math
import zipfile
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from . import archive
from .errors import EnvironmentProblem, InputError, SimulationError, nearest
from .units import Unit, quantity

OWN_TOOL = "sprain-cosim"


@dataclass(frozen=True)
class Connector:
    """One scalar variable. `unit` is None where the FMU declares none; `items` are the values of an enumeration by name; `start` is None
    where the FMU gives none or it is not a number; `depends_on` names the inputs that act on an output directly (None: not declared)."""

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

    def value(self, given: float | str | bool, what: str) -> float:
        """A value from a file or the command line in the connector's own unit. Raises InputError: unit, kind or range."""
        if self.items:
            if isinstance(given, str) and given in self.items:
                return float(self.items[given])
            raise InputError(f"{what} = {given!r}: must be one of {', '.join(self.items)}{nearest(str(given), self.items) if len(self.items) > 12 else ''}")
        if self.kind == "boolean":
            if isinstance(given, bool) or given in (0, 1, "true", "false"):
                return float(given in (True, 1, "true"))
            raise InputError(f"{what} = {given!r}: must be true or false")
        if self.kind == "string":
            raise InputError(f"{what}: text parameters cannot be set")
        number = quantity(given, self.unit, what)
        if self.kind != "real" and number != int(number):
            raise InputError(f"{what} = {given!r}: must be a whole number")
        if not self.minimum <= number <= self.maximum:
            unit = f" {self.unit.name}" if self.unit and not self.unit.dimensionless else ""
            raise InputError(f"{what} = {given}: outside its range {self.minimum:.6g} ... {self.maximum:.6g}{unit}")
        return number


@dataclass(frozen=True)
class Capabilities:
    """What the FMU declares. `fixed_step` [s] is its own step where it cannot take another one."""

    fmi_version: str
    fixed_step: float | None = None
    state: bool = False
    reusable: bool = False
    tool: str = ""


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

    def open(self) -> Instance:
        """Loads the FMU's code and instantiates it. Raises SimulationError or EnvironmentProblem."""
        return Fmi2Instance(self)


class Instance(Protocol):
    """A running component. Order of the calls: bind - set - start - (push, pull)* - finish_start - (push, step, pull)* - reset or close.

    `bind` lays `inputs` and `outputs` on the bus, the last `echoing` outputs being those that follow inputs directly. `push` sends the inputs
    from the bus, `pull` fetches all outputs onto it, `pull_states` and `pull_echoes` fetch those before and those after that
    boundary. After a SimulationError only `close` may be called."""

    def bind(self, bus: np.ndarray, inputs: Sequence[str], first_input: int, outputs: Sequence[str], first_output: int, echoing: int) -> None: ...
    def set(self, values: Mapping[str, float]) -> None: ...
    def start(self, time: float, stop: float) -> None: ...
    def finish_start(self) -> None: ...
    def push(self) -> None: ...
    def pull(self) -> None: ...
    def pull_states(self) -> None: ...
    def pull_echoes(self) -> None: ...
    def step(self, time: float, step: float) -> None: ...
    def save(self) -> Any: ...
    def restore(self, state: Any) -> None: ...
    def release(self, state: Any) -> None: ...
    def reset(self) -> None: ...
    def close(self) -> None: ...


# ---- description


@lru_cache(maxsize=64)
def _describe(sha256: str, description: bytes, names: tuple[str, ...]) -> tuple[Mapping[str, Connector], Capabilities, str, str, tuple[str, ...]]:
    import fmpy
    from fmpy.model_description import read_model_description

    container = io.BytesIO()  # fmpy wants an archive; this one holds nothing but the description that was checked
    with zipfile.ZipFile(container, "w") as packed:
        packed.writestr("modelDescription.xml", description)
    container.seek(0)
    try:
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            md = read_model_description(container)
    except Exception as problem:
        raise InputError(f"modelDescription.xml is not valid: {_first_line(problem)}") from None
    if md.fmiVersion != "2.0" or md.coSimulation is None:
        kind = "co-simulation" if md.coSimulation is not None else "model exchange"
        raise InputError(f"an FMI {md.fmiVersion} {kind} FMU; only FMI 2.0 co-simulation is supported; export it as such")
    cs = md.coSimulation
    if cs.needsExecutionTool:
        raise InputError(f"needs its authoring tool ({md.generationTool or 'unnamed'}) at run time; export it with the tool's stand-alone option")
    binary = f"binaries/{fmpy.platform}/{cs.modelIdentifier}{fmpy.sharedLibraryExtension}"
    if binary not in names:
        there = sorted({n.split("/")[1] for n in names if n.startswith("binaries/") and n.count("/") >= 2})
        raise InputError(f"no binary for this platform ({binary}); it has {', '.join(there) or 'none'}; export it for {fmpy.platform}")
    warnings: list[str] = []
    units = {u.name: u for u in md.unitDefinitions}
    dependencies = {u.variable.name: u for u in md.outputs}
    connectors: dict[str, Connector] = {}
    for v in md.modelVariables:
        unit_name = v.unit or (v.declaredType.unit if v.declaredType is not None and getattr(v.declaredType, "unit", None) else None)
        unit = None
        if unit_name and unit_name in units and units[unit_name].baseUnit is not None:
            b = units[unit_name].baseUnit
            unit = Unit(unit_name, (b.kg, b.m, b.s, b.A, b.K, b.mol, b.cd, b.rad), float(b.factor), float(b.offset))
        elif unit_name:
            unit = _unit_by_name(unit_name)
            if unit is None:
                warnings.append(f"{v.name}: unit {unit_name!r} is not defined; SI is assumed")
        elif v.type == "Real" and v.causality in ("input", "output"):
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
            v.causality or "local",
            v.type.lower(),
            unit,
            _number(v.start),
            _number(v.min, -math.inf),
            _number(v.max, math.inf),
            items,
            v.description or "",
            depends,
        )
    fixed = None
    if not cs.canHandleVariableCommunicationStepSize and md.defaultExperiment is not None and md.defaultExperiment.stepSize:
        fixed = float(md.defaultExperiment.stepSize)
    tool = md.generationTool or ""
    capabilities = Capabilities("2.0", fixed, bool(cs.canGetAndSetFMUstate), tool == OWN_TOOL, tool)
    return connectors, capabilities, cs.modelIdentifier, md.guid, tuple(warnings)


def _unit_by_name(name: str) -> Unit | None:
    from .units import unit

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


def _first_line(problem: BaseException) -> str:
    lines = [line.strip(" -") for line in str(problem).splitlines() if line.strip()]
    return "; ".join(lines[:3]) or type(problem).__name__


# ---- FMI 2.0 co-simulation

_OK, _WARNING, _DISCARD = 0, 1, 2
_STATUS = {2: "discarded the call", 3: "reported an error", 4: "reported a fatal error"}
_TYPES: dict[str, tuple[str, Any]] = {
    "real": ("Real", ctypes.c_double),
    "integer": ("Integer", ctypes.c_int),
    "enumeration": ("Integer", ctypes.c_int),
    "boolean": ("Boolean", ctypes.c_int),
}


_Calls = tuple[list[tuple[Any, tuple[Any, ...]]], list[tuple[np.ndarray, slice]]]  # library calls, and values that are not real
_counter = itertools.count(1)
_messages: dict[str, deque[str]] = {}  # by instance name: all instances share one logger
MAX_MESSAGES = 100


@lru_cache(maxsize=1)
def _callbacks() -> Any:
    """One set for the process: the proxy that formats the messages' variable arguments remembers a single logger."""
    import fmpy
    from fmpy import fmi2

    def log(environment: Any, instance: bytes, status: int, category: bytes, message: bytes) -> None:
        said = _messages.get((instance or b"").decode("utf-8", "replace"))
        if said is not None:
            said.append((message or b"").decode("utf-8", "replace"))

    callbacks = fmi2.fmi2CallbackFunctions()
    callbacks.logger = fmi2.fmi2CallbackLoggerTYPE(log)
    callbacks.allocateMemory = fmi2.fmi2CallbackAllocateMemoryTYPE(fmpy.calloc)
    callbacks.freeMemory = fmi2.fmi2CallbackFreeMemoryTYPE(fmpy.free)
    try:
        from fmpy.logging import addLoggerProxy
    except (ImportError, OSError):  # no proxy for this platform: messages arrive unformatted
        return callbacks
    addLoggerProxy(ctypes.byref(callbacks))
    return callbacks


class Fmi2Instance:
    """fmpy loads the library; the calls of the time loop go to it with buffers made once, because fmpy's own wrappers cost more per step
    than the FMU. Real variables live on the bus itself, others in a buffer of their type."""

    def __init__(self, component: Component) -> None:
        from fmpy.fmi2 import FMU2Slave

        self.component = component
        folder = archive.unpack(archive.read(component.fmu))
        self._label = f"{component.name}_{next(_counter)}"
        self.messages = _messages[self._label] = deque(maxlen=MAX_MESSAGES)
        try:
            self._fmu = FMU2Slave(guid=component.guid, modelIdentifier=component.identifier, unzipDirectory=str(folder), instanceName=self._label)
        except Exception as problem:
            raise EnvironmentProblem(f"{component.fmu}: its library cannot be loaded: {_first_line(problem)}") from None
        if hasattr(self._fmu.dll, "finalizePythonInterpreter"):
            # PythonFMU's library frees its interpreter state twice at the end of the process, unless it was told to before
            atexit.register(self._fmu.dll.finalizePythonInterpreter)
        dll = self._fmu.dll
        self._functions = {
            name: dll[f"fmi2{name}"] for name in ("DoStep", *(f"{verb}{kind}" for verb in ("Get", "Set") for kind in ("Real", "Integer", "Boolean")))
        }
        self._broken = False
        self._instance = ctypes.c_void_p()  # one object for all prepared calls, also after a fresh instantiation
        self._instantiate()

    def _instantiate(self) -> None:
        try:
            self._fmu.instantiate(callbacks=_callbacks(), loggingOn=True)
        except Exception:
            self._broken = True
            raise SimulationError(f"{self.component.name}: cannot be instantiated{self._said()}") from None
        self._instance.value = self._fmu.component

    def bind(self, bus: np.ndarray, inputs: Sequence[str], first_input: int, outputs: Sequence[str], first_output: int, echoing: int) -> None:
        self._bus = bus
        self._sends = self._buffers("Set", inputs, first_input)
        self._fetches = self._buffers("Get", outputs, first_output)
        boundary = len(outputs) - echoing
        self._states = self._buffers("Get", outputs[:boundary], first_output)
        self._echoes = self._buffers("Get", outputs[boundary:], first_output + boundary)

    def _buffers(self, verb: str, names: Sequence[str], first: int) -> _Calls:
        calls: list[tuple[Any, tuple[Any, ...]]] = []
        conversions: list[tuple[np.ndarray, slice]] = []
        connectors = [self.component.connectors[n] for n in names]
        groups: list[tuple[str, list[int]]] = []  # runs of equal type, so that reals stay contiguous on the bus
        for k, c in enumerate(connectors):
            kind = _TYPES[c.kind][0]
            if not groups or groups[-1][0] != kind:
                groups.append((kind, []))
            groups[-1][1].append(k)
        for kind, members in groups:
            n = len(members)
            references = (ctypes.c_uint * n)(*(connectors[k].reference for k in members))
            at = first + members[0]
            if kind == "Real":
                buffer: Any = (ctypes.c_double * n).from_buffer(self._bus.data, 8 * at)
            else:
                buffer = (ctypes.c_int * n)()
                conversions.append((np.frombuffer(buffer, np.int32), slice(at, at + n)))
            calls.append((self._functions[f"{verb}{kind}"], (self._instance, references, ctypes.c_size_t(n), buffer)))
        return calls, conversions

    def set(self, values: Mapping[str, float]) -> None:
        for name, value in values.items():
            connector = self.component.connectors[name]
            kind, ctype = _TYPES[connector.kind]
            number = value if kind == "Real" else int(value)
            status = self._functions[f"Set{kind}"](self._instance, (ctypes.c_uint * 1)(connector.reference), ctypes.c_size_t(1), (ctype * 1)(number))
            self._check(status, f"setting {name} = {value:g}")

    def start(self, time: float, stop: float) -> None:
        self._call("setting up", self._fmu.setupExperiment, startTime=time, stopTime=stop)
        self._call("entering initialisation", self._fmu.enterInitializationMode)

    def finish_start(self) -> None:
        self._call("initialising", self._fmu.exitInitializationMode)

    def push(self) -> None:
        calls, conversions = self._sends
        for buffer, place in conversions:
            buffer[:] = np.rint(self._bus[place])
        for function, arguments in calls:
            status = function(*arguments)
            if status > _WARNING:
                self._check(status, "setting its inputs")

    def pull(self) -> None:
        self._fetch(self._fetches)

    def pull_states(self) -> None:
        self._fetch(self._states)

    def pull_echoes(self) -> None:
        self._fetch(self._echoes)

    def _fetch(self, prepared: _Calls) -> None:
        calls, conversions = prepared
        for function, arguments in calls:
            status = function(*arguments)
            if status > _WARNING:
                self._check(status, "reading its outputs")
        for buffer, place in conversions:
            self._bus[place] = buffer

    def step(self, time: float, step: float) -> None:
        own = self.component.capabilities.fixed_step
        count = 1 if own is None else max(1, round(step / own))
        size = step / count
        for k in range(count):
            status = self._functions["DoStep"](self._instance, ctypes.c_double(time + k * size), ctypes.c_double(size), 1)
            if status > _WARNING:
                self._check(status, f"in the step from {time + k * size:.6g} s to {time + (k + 1) * size:.6g} s")

    def save(self) -> Any:
        return self._call("saving its state", self._fmu.getFMUstate)

    def restore(self, state: Any) -> None:
        self._call("restoring its state", self._fmu.setFMUstate, state)

    def release(self, state: Any) -> None:
        self._call("releasing a state", self._fmu.freeFMUstate, state)

    def reset(self) -> None:
        """Back to the state after instantiation: by the FMU's own reset where that is known to work, else by a fresh instance."""
        self.messages.clear()
        if self.component.capabilities.reusable:
            self._call("resetting", self._fmu.reset)
        else:
            self._fmu.fmi2FreeInstance(self._fmu.component)
            self._instantiate()

    def close(self) -> None:
        """Frees the instance; the library stays loaded, since not every library survives being loaded twice."""
        if not self._broken and self._fmu.component is not None:
            self._fmu.fmi2FreeInstance(self._fmu.component)
            self._fmu.component = None
        self._broken = True
        _messages.pop(self._label, None)

    def _call(self, doing: str, function: Any, *arguments: Any, **keywords: Any) -> Any:
        try:
            return function(*arguments, **keywords)
        except Exception as problem:
            self._check(getattr(problem, "status", 3), doing)

    def _check(self, status: int, doing: str) -> None:
        if status > _WARNING:
            self._broken = status >= 4
            raise SimulationError(f"{self.component.name}: {_STATUS.get(status, f'gave status {status}')} {doing}{self._said()}")

    def _said(self) -> str:
        """The last line of the last message: for a Python FMU the exception itself."""
        lines = [line.strip() for line in (self.messages[-1] if self.messages else "").splitlines() if line.strip()]
        return f": {lines[-1]}" if lines else ""
