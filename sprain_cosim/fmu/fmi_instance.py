"""What the versions of FMI share: values between bus and library, statuses and messages, the FMU's own step, a fresh
start.

fmpy loads the library; the calls of the time loop go to it with buffers made once, because fmpy's own wrappers cost
more per step than the FMU. Double-precision variables live on the bus itself, others in a buffer of their type."""

from __future__ import annotations

import contextlib
import copy
import ctypes
import inspect
import itertools
import os
import threading
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from time import sleep
from types import UnionType
from typing import Any, ClassVar, get_args

import numpy as np

from ..errors import EnvironmentProblem, SimulationError, SimulationStopped, StepDiscarded
from . import cache
from .description import Description, first_line
from .element import Connector
from .floating_point import FloatingPoint
from .foreign import is_foreign
from .messages import ERROR, WARNING, Log, Messages

DISCARD, PENDING = 2, 5
DO_STEP_STATUS, LAST_SUCCESSFUL_TIME = 0, 2  # kinds of GetStatus, GetRealStatus
POLL = 1e-4  # s
STATUS = {2: "discarded the call", 3: "reported an error", 4: "reported a fatal error"}
SETTING, READING = "setting its inputs", "reading its outputs"
MAX_PARTS = 1024  # of a step that is refused

Calls = tuple[
    list[tuple[Any, tuple[Any, ...]]], list[tuple[np.ndarray, slice, int]]
]  # library calls, and values that do not lie on the bus: buffer, place on the bus, sign


class _Os:
    """`os` as fmpy sees it: without the change of the working folder, which is the whole process's, while it loads a
    library."""

    def __getattr__(self, name: str) -> Any:
        return getattr(os, name)

    def chdir(self, path: str) -> None:
        pass


@lru_cache(maxsize=1)
def _ease_loading() -> None:
    """The constructor of all versions stands in fmi1: it keeps the working folder, and asks for the signatures of FMI's
    functions once for each class and not for each FMU."""
    from fmpy import fmi1

    fmi1.os = _Os()
    fmi1.cdll = _Libraries()
    fmi1._FMU._loadFunctions = _load_functions


class _Libraries:
    """`ctypes.cdll` as fmpy sees it: a library that is loaded stays loaded, and is found again by its path, which is
    that of its content."""

    @staticmethod
    @lru_cache(maxsize=64)
    def LoadLibrary(path: str) -> ctypes.CDLL:
        return ctypes.CDLL(path)


def _load_functions(fmu: Any) -> None:
    kind: Any = type(fmu)
    tables = vars(fmu.dll).setdefault("tables", {})
    found = tables.get((kind, fmu.modelIdentifier))
    if found is None:
        found = {}
        for name, of_library, argument_names, argument_types, result in signatures(kind):
            function = fmu.dll[of_library.format(fmu.modelIdentifier)]
            function.argnames, function.argtypes, function.restype = argument_names, argument_types, result
            found[name] = function
        tables[kind, fmu.modelIdentifier] = found
    fmu._functions.update(found)


@lru_cache(maxsize=8)
def signatures(kind: Any) -> list[tuple[str, str, list[str], list[Any], Any]]:
    """The functions of FMI that a class of fmpy calls: its method, the library's name for it ("{}" is the model's
    identifier), names and types of the arguments, type of the result. As fmpy reads them off its own annotations."""
    prefix = kind.__name__[:4].lower().replace("u", "i")
    found = []
    for name, method in inspect.getmembers(kind, inspect.isfunction):
        if not name.startswith(prefix):
            continue
        annotations, code = method.__annotations__, method.__code__  # inspect.signature takes 2 ms for all of them
        arguments = list(code.co_varnames[1 : code.co_argcount])
        types = [get_args(hint)[0] if isinstance(hint, UnionType) else hint for hint in map(annotations.get, arguments)]
        result = annotations.get("return")
        result = ctypes.c_char_p if result is bytes else ctypes.c_int if result is int else result
        of_library = "{}_" + name.replace("fmi1", "fmi") if prefix == "fmi1" else name
        found.append((name, of_library, arguments, types, result))
    return found


@lru_cache(maxsize=64)
def _unpacked_once(fmu: Path, sha256: str, _: Path) -> Path:
    """The folder, by where it lies, of an FMU that ships and of which an instance reads nothing but its library: a
    library that is loaded stays as it was, whatever becomes of its file."""
    return cache.unpacked(fmu, sha256)


@lru_cache(maxsize=64)
def _of_library(kind: Any, **library: Any) -> Any:
    """fmpy's object for a library, to be copied for each of its instances."""
    return kind(**library)


_one_at_a_time = threading.Lock()


@contextlib.contextmanager
def _loading(folder: Path) -> Iterator[None]:
    """A foreign library may look for others beside it. It has a process of its own, unless its user wants otherwise."""
    with _one_at_a_time:
        before = os.getcwd()
        os.chdir(folder)
        try:
            yield
        finally:
            os.chdir(before)


@dataclass(frozen=True)
class NativeCalls:
    """What a loop in another language needs to drive an instance that is bound: addresses, valid until the instance is
    reset.

    fmi             2 or 3
    instance        of the library
    set, get, step  functions for double-precision numbers, and the FMU's step
    inputs, outputs arrays of value references, in the order of the bus
    direct          the last so many outputs follow inputs directly
    final           no state will be set that lies before the present point
    environment     fenv_t of a foreign library, put back after each call; None for others
    answers         FMI 3: event needed, terminate, early return, time reached; else None
    """

    fmi: int
    instance: int
    set: int
    get: int
    step: int
    inputs: Any
    outputs: Any
    direct: int
    final: bool
    environment: int | None
    answers: tuple[int | None, int | None, int | None, int | None] = (None, None, None, None)


class FmiInstance:
    """Implements Instance. Its subclasses add what depends on the version: `types`, `load_library`, `instantiate`,
    `free_instance`, `call_enter_initialization`, `call_exit_initialization`, `call_do_step`, `discard_status`,
    `function` and, where the FMU can, `save_state`, `restore_state`, `free_state` and `call_reset`."""

    types: ClassVar[Mapping[str, tuple[str, Any]]] = {}
    """{type in the description: (its name in function names, C type)}"""

    def __init__(self, component: Description) -> None:
        self.component = component
        self.log = Log(component.name)
        self._floating = FloatingPoint() if is_foreign(component.fmu, component.sha256) else None
        if self._floating is not None:
            from ..fork_server import foreign_code_loads

            foreign_code_loads()
        if self._floating is None and not component.resources:
            folder = _unpacked_once(component.fmu, component.sha256, cache.cache_folder())
        else:
            folder = cache.unpacked(component.fmu, component.sha256)
        _ease_loading()
        beside = contextlib.nullcontext() if self._floating is None else _loading((folder / component.library).parent)
        try:
            with beside:
                self.fmu = self.load_library(
                    guid=component.guid,
                    modelIdentifier=component.identifier,
                    unzipDirectory=str(folder),
                    instanceName=self.log.label,
                )
        except Exception as problem:
            raise EnvironmentProblem(f"{component.fmu}: its library cannot be loaded: {first_line(problem)}") from None
        finally:
            self._restore()
        self._watch()
        self.broken = False
        self.readable = True
        self._arrays: dict[tuple[str, int], tuple[Connector, Any]] = {}  # by verb and reference
        self._held: dict[str, float] = {}  # inputs that keep a value over a run
        self.saves_before_steps = False
        self.instance = ctypes.c_void_p()  # one object for all prepared calls, also after a fresh instantiation
        self._new_instance()

    # ---- by version

    def load_library(self, **arguments: Any) -> Any:
        """By `made`."""
        raise NotImplementedError

    def made(self, kind: Any, *, instanceName: str, **library: Any) -> Any:
        """fmpy's object of a class, for this instance."""
        fmu = copy.copy(_of_library(kind, **library))
        fmu.instanceName = instanceName
        return fmu

    def instantiate(self) -> None:
        """Instantiates; sets `self.fmu.component`."""
        raise NotImplementedError

    def free_instance(self) -> None:
        raise NotImplementedError

    def call_enter_initialization(self, time: float, stop: float) -> None:
        """Initialisation mode."""
        raise NotImplementedError

    def call_exit_initialization(self) -> None:
        raise NotImplementedError

    def call_do_step(self, time: float, step: float) -> int:
        """One call; returns the FMI status."""
        raise NotImplementedError

    def discard_status(self) -> tuple[float | None, bool]:
        """After a discarded step: the last time that it reached successfully (None: unknown), and whether the FMU asks
        to end the run."""
        return None, False

    def call_reset(self) -> None:
        """The FMU's own reset."""
        self.fmu.reset()

    def function(self, name: str) -> Any:
        """The library's function such as GetReal."""
        raise NotImplementedError

    def arguments(self, references: Any, n: int, buffer: Any) -> tuple[Any, ...]:
        return self.instance, references, ctypes.c_size_t(n), buffer

    # ---- Instance

    def bind(
        self,
        bus: np.ndarray,
        inputs: Sequence[str],
        first_input: int,
        outputs: Sequence[str],
        first_output: int,
        feedthrough: int,
    ) -> None:
        self._bus = bus
        self.input_values = bus[first_input : first_input + len(inputs)]
        self._set_calls = self._calls("Set", inputs, bus, first_input)
        self._get_calls = self._calls("Get", outputs, bus, first_output)
        self._outputs, self._first_output, self._feedthrough = outputs, first_output, feedthrough

    @cached_property
    def _get_calls_without_feedthrough(self) -> Calls:
        boundary = len(self._outputs) - self._feedthrough
        return self._calls("Get", self._outputs[:boundary], self._bus, self._first_output)

    @cached_property
    def _get_calls_of_feedthrough(self) -> Calls:
        boundary = len(self._outputs) - self._feedthrough
        return self._calls("Get", self._outputs[boundary:], self._bus, self._first_output + boundary)

    def watch_locals(self, names: Sequence[str], values: np.ndarray) -> None:
        self._local_values = values
        self._local_calls = self._calls("Get", names, values, 0)

    def _calls(self, verb: str, names: Sequence[str], values: np.ndarray, first: int) -> Calls:
        calls: list[tuple[Any, tuple[Any, ...]]] = []
        conversions: list[tuple[np.ndarray, slice, int]] = []
        doubles = self.component.doubles
        plain = [doubles[n] for n in names if n in doubles]
        if plain and len(plain) == len(names):  # the usual case in one call, and quickly
            function, n = self.types[self.component.connectors[names[0]].fmi_type][0], len(plain)
            numbers = (ctypes.c_double * n).from_buffer(values.data, 8 * first)
            return [self._call(f"{verb}{function}", (ctypes.c_uint * n)(*plain), n, numbers)], conversions
        connectors = [self.component.connectors[n] for n in names]
        arrays: set[int] = set()  # whose call is there already
        for (function, ctype, array, negated), run in itertools.groupby(
            range(len(names)),
            lambda k: (*self.types[connectors[k].fmi_type], connectors[k].array, connectors[k].negated),
        ):
            members = list(run)
            n, at = len(members), first + members[0]
            if array is not None:
                reference = connectors[members[0]].reference
                buffer: Any = self._array(connectors[members[0]], verb)
                view = np.frombuffer(buffer, np.dtype(ctype))
                conversions += [
                    (view[(e := connectors[k].element) : e + 1], slice(first + k, first + k + 1), 1) for k in members
                ]
                if reference not in arrays:
                    arrays.add(reference)
                    calls.append(self._call(f"{verb}{function}", (ctypes.c_uint * 1)(reference), 1, buffer))
                continue
            references = (ctypes.c_uint * n)(*(connectors[k].reference for k in members))
            if ctype is ctypes.c_double and not negated:
                buffer = (ctypes.c_double * n).from_buffer(values.data, 8 * at)
            else:
                buffer = (ctype * n)()
                view = np.frombuffer(buffer, np.dtype(ctype) if ctype is not ctypes.c_char else np.int8)
                conversions.append((view, slice(at, at + n), -1 if negated else 1))
            calls.append(self._call(f"{verb}{function}", references, n, buffer))
        return calls, conversions

    def _call(self, function: str, references: Any, n: int, buffer: Any) -> tuple[Any, tuple[Any, ...]]:
        try:
            return self.function(function), self.arguments(references, n, buffer)
        except AttributeError as problem:
            raise EnvironmentProblem(
                f"{self.component.fmu}: {problem}; build its library with all functions of FMI"
            ) from None

    def _array(self, element: Connector, verb: str) -> Any:
        """The values of its whole array, which FMI passes at once. What is set is kept for all calls of a run, so that
        elements that nothing feeds hold their values."""
        assert element.array is not None
        known = self._arrays.get((verb, element.reference))
        if known is None:
            _, ctype = self.types[element.fmi_type]
            known = (element, (ctype * element.array.size)())
            self._arrays[verb, element.reference] = known
            _fill(*known)
        return known[1]

    def set_parameters(self, values: Mapping[str, float]) -> None:
        inputs = self.component.inputs
        self._held = {name: value for name, value in values.items() if name in inputs}
        self._set({name: value for name, value in values.items() if name not in inputs})

    def _set(self, values: Mapping[str, float]) -> None:
        for name, value in values.items():
            connector = self.component.connectors[name]
            function, ctype = self.types[connector.fmi_type]
            sent = -value if connector.negated else value
            number: Any = sent if connector.kind == "real" else int(sent)
            if connector.array is not None:
                buffer = self._array(connector, "Set")
                buffer[connector.element] = number
                set_array, arguments = self._call(f"Set{function}", (ctypes.c_uint * 1)(connector.reference), 1, buffer)
                self.check(set_array(*arguments), f"setting {name} = {value:g}")
                continue
            buffer = (ctype * 1)(bytes([number]) if ctype is ctypes.c_char else number)
            status = self.function(f"Set{function}")(
                *self.arguments((ctypes.c_uint * 1)(connector.reference), 1, buffer)
            )
            self.check(status, f"setting {name} = {value:g}")

    def enter_initialization(self, time: float, stop: float) -> None:
        self.call("entering initialisation", self.call_enter_initialization, time, stop)
        self._set(self._held)

    def exit_initialization(self) -> None:
        self.call("initialising", self.call_exit_initialization)

    def native_calls(self) -> NativeCalls | None:
        """None where the instance needs more than the library's functions at a step. Before: it has started."""
        return None

    def plain_calls(self, fmi: int, step: Any, final: bool) -> NativeCalls | None:
        """What the versions share of `native_calls`."""
        (setting, set_conversions), (getting, get_conversions) = self._set_calls, self._get_calls
        own = self.component.capabilities.fixed_step
        watched = self._floating is not None and self._floating.watched
        if set_conversions or get_conversions or len(setting) > 1 or len(getting) > 1:
            return None  # numbers of another type
        if not self.readable or self.saves_before_steps or own is not None or watched or self.instance.value is None:
            return None
        none = (ctypes.c_uint * 0)()
        return NativeCalls(
            fmi=fmi,
            instance=self.instance.value,
            set=_address(setting[0][0]) if setting else 0,
            get=_address(getting[0][0]) if getting else 0,
            step=_address(step),
            inputs=setting[0][1][1] if setting else none,
            outputs=getting[0][1][1] if getting else none,
            direct=self._feedthrough,
            final=final,
            environment=None if self._floating is None else self._floating.address,
        )

    def set_inputs(self) -> None:
        calls, conversions = self._set_calls
        for buffer, place, sign in conversions:
            sent = sign * self._bus[place]
            buffer[:] = sent if buffer.dtype.kind == "f" else np.rint(sent)
        for function, arguments in calls:
            status = function(*arguments)
            if status:
                self.check(status, SETTING)
        if self._floating is not None:
            self._floating.restore_if_changed()

    def get_outputs(self) -> None:
        self._fetch(self._get_calls, self._bus)

    def get_outputs_without_feedthrough(self) -> None:
        self._fetch(self._get_calls_without_feedthrough, self._bus)

    def get_feedthrough_outputs(self) -> None:
        self._fetch(self._get_calls_of_feedthrough, self._bus)

    def get_locals(self) -> None:
        self._fetch(self._local_calls, self._local_values)

    def _fetch(self, prepared: Calls, values: np.ndarray) -> None:
        if not self.readable:
            return
        calls, conversions = prepared
        for function, arguments in calls:
            status = function(*arguments)
            if status:
                self.check(status, READING)
        if self._floating is not None:
            self._floating.restore_if_changed()
        for buffer, place, sign in conversions:
            values[place] = sign * buffer

    def do_step(self, time: float, step: float) -> None:
        own = self.component.capabilities.fixed_step
        count = 1 if own is None else max(1, round(step / own))
        size = step / count
        for k in range(count):
            self._one_step(time + k * size, size, size / MAX_PARTS)

    def _one_step(self, time: float, step: float, least: float) -> None:
        state = self.save_state() if self.saves_before_steps else None
        try:
            status = self.call_do_step(time, step)
            self._restore()
            if status == WARNING:
                self.log.warned()
            elif status:
                self._not_done(status, time, step, least, state)
        finally:
            if state is not None and not self.broken:
                self.free_state(state)

    def check_step(self, status: int, time: float, step: float) -> None:
        """What follows from the status of a step that was taken by `native_calls`: returns when it is done, raises as
        `do_step` does."""
        if status == PENDING:
            status = self.finished_step()
        if status == WARNING:
            self.log.warned()
        elif status:
            self._not_done(status, time, step, step, None)

    def _not_done(self, status: int, time: float, step: float, least: float, state: Any) -> None:
        """A refused step is taken in parts, with the inputs held, where the state before it was saved. Raises
        SimulationError otherwise."""
        doing = f"in the step from {time:.6g} s to {time + step:.6g} s"
        if status != DISCARD:
            self.check(status, doing)
        reached, ended = self.discard_status()
        if ended:
            raise SimulationStopped(
                f"{self.component.name}: asked to end the simulation at {time if reached is None else reached:.6g} "
                f"s{self.last_message()}"
            )
        got = f"; it got to {reached:.9g} s" if reached is not None and reached > time else ""
        if state is None:
            if self.component.capabilities.state:
                raise StepDiscarded(f"{self.component.name}: {STATUS[DISCARD]} {doing}{got}{self.last_message()}")
            cure = "it cannot save its state, so the step cannot be taken in parts; take a smaller communication step"
            raise SimulationError(f"{self.component.name}: {STATUS[DISCARD]} {doing}{got}{self.last_message()}; {cure}")
        part = reached - time if reached is not None and time < reached < time + step else 0.5 * step
        if part < least:
            raise SimulationError(
                f"{self.component.name}: {STATUS[DISCARD]} {doing}, however small the parts{got}{self.last_message()}"
            )
        self.restore_state(state)
        self.set_inputs()
        self._one_step(time, part, least)
        if step - part > least * 1e-3:
            self._one_step(time + part, step - part, least)

    def finished_step(self) -> int:
        """The status of a step that the FMU computes in the background, once it is done."""
        status = ctypes.c_int(PENDING)
        while status.value == PENDING:
            sleep(POLL)
            answer = int(self.function("GetStatus")(self.instance, DO_STEP_STATUS, ctypes.byref(status)))
            if answer > WARNING:
                return answer
        return status.value

    def save_before_steps(self) -> None:
        self.saves_before_steps = self.component.capabilities.state

    def save_state(self) -> Any:
        raise SimulationError(
            f"{self.component.name}: FMI {self.component.capabilities.fmi_version} cannot save a state"
        )

    def restore_state(self, state: Any) -> None:
        raise NotImplementedError

    def free_state(self, state: Any) -> None:
        raise NotImplementedError

    def reset(self) -> None:
        """Back to the state after instantiation: by the FMU's own reset where that is known to work, else by a fresh
        instance."""
        for element, buffer in self._arrays.values():
            _fill(element, buffer)
        if self.component.capabilities.reusable:
            self.call("resetting", self.call_reset)
            self.log.clear()
        else:
            self.free_instance()
            self.log.clear()
            self._new_instance()

    def close(self) -> None:
        """Frees the instance; the library stays loaded, since not every library survives being loaded twice."""
        if not self.broken and self.fmu.component is not None:
            self.free_instance()
            self._restore()
            self.fmu.component = None
        self.broken = True

    # ---- shared

    def _new_instance(self) -> None:
        try:
            self.instantiate()
        except Exception:
            self.broken = True
            raise SimulationError(f"{self.component.name}: cannot be instantiated{self.last_message()}") from None
        finally:
            self._restore()
        self.instance.value = getattr(self.fmu.component, "value", self.fmu.component)

    def _restore(self) -> None:
        """Rounding mode, traps and the like as they were before the FMU was loaded; those that ship change none."""
        if self._floating is not None:
            self._floating.restore()

    def _watch(self) -> None:
        """Takes the place of what all of fmpy's methods call the library through: counts warnings, refuses statuses
        that FMI does not know, and costs no more."""
        from fmpy.fmi1 import FMICallException

        functions, log = self.fmu._functions, self.log

        def call(name: str, *arguments: Any) -> Any:
            function = functions[name]
            result = function(*arguments)
            if result and function.restype is ctypes.c_int:
                if result != WARNING:
                    raise FMICallException(function=name, status=result)
                log.warned()
            return result

        self.fmu._call = call

    def call(self, doing: str, function: Any, *arguments: Any) -> Any:
        try:
            try:
                return function(*arguments)
            finally:
                self._restore()
        except SimulationError:
            raise
        except Exception as problem:
            self.check(getattr(problem, "status", 3), doing)

    def check(self, status: int, doing: str) -> None:
        if status == WARNING:
            self.log.warned()
        elif status:
            self.broken = status not in (DISCARD, ERROR)
            raise SimulationError(
                f"{self.component.name}: {STATUS.get(status, f'gave status {status}')} {doing}{self.last_message()}"
            )

    def last_message(self) -> str:
        """What it said about an error, see `Log.quote`."""
        return self.log.quote()

    def messages(self) -> Messages | None:
        return self.log.found()


def _address(function: Any) -> int:
    known: int | None = getattr(function, "address", None)
    if known is None:
        known = function.address = ctypes.cast(function, ctypes.c_void_p).value or 0
    return known


def _fill(element: Connector, buffer: Any) -> None:
    """Start values into the buffer of the element's array."""
    if element.array is not None:
        for k, value in enumerate(element.array.start):
            buffer[k] = value if element.kind == "real" else int(value)
