"""The slave base class: one array of values and five methods to override, and what the FMU's binary calls. That is
`python_slave.c`, or on platforms that it was not compiled for the binary of PythonFMU, which asks through get_real
and set_real.

Call order: construct - set parameters and inputs - enter/exit initialisation mode - (set inputs, do_step, read outputs)
... - terminate. `initialise` runs whenever an output is read in initialisation mode after something was set, and once
more when that mode ends. After an exception the instance may only be reset or freed. The file is copied into every FMU,
so it imports nothing of the project."""

from __future__ import annotations

import contextlib
import math
import traceback
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

PARAMETER, LOCAL = 1, 2  # known to python_slave.c


class FmuError(Exception):
    """Carries a traceback into the FMU's log: the binary logs the repr of what is raised."""

    def __repr__(self) -> str:
        return str(self.args[0])


class Log:
    """One entry of the log queue, with the fields that the binary reads."""

    def __init__(self, status: int, message: str) -> None:
        self.status, self.category, self.msg, self.debug = status, "logAll", message, False


class Fmi2Slave:
    """Subclasses set `variables` (the list of interface.py) and override initialise, step and, as needed, refresh,
    save, restore, close.

    `values` (n,) holds every variable by value reference (position in the list), enumerations as whole numbers; `index`
    maps names to positions; `resources` is the folder of the FMU's resources."""

    variables: ClassVar[list[dict]] = []

    def __init__(self, instance_name: str = "", resources: str = "", **_: Any) -> None:
        self.instance_name, self.resources = instance_name, Path(resources)
        self.index = {v["name"]: k for k, v in enumerate(self.variables)}
        self.values = np.array([v.get("start", 0.0) for v in self.variables], dtype=float)
        self._starts = self.values.copy()
        self._kinds = np.array(
            [{"parameter": PARAMETER, "local": LOCAL}.get(v["causality"], 0) for v in self.variables], dtype=np.uint8
        )
        self._fixed = set(np.flatnonzero(self._kinds == PARAMETER).tolist())
        self._log: list[Log] = []
        self._running, self._stale = False, True
        self._locals = set(np.flatnonzero(self._kinds == LOCAL).tolist())
        self._known: dict[
            tuple[int, int], tuple[list[int], Any, bool]
        ] = {}  # selections by length and first reference; has it locals?
        self._put: list[int] = []

    # ---- to override

    def initialise(self) -> None:
        """From parameters and inputs to consistent outputs."""

    def step(self, time: float, step: float) -> None:
        """Advances from `time` to `time + step` [s] with the inputs held, and writes the outputs."""

    def refresh(self) -> None:
        """Writes the outputs that depend on inputs directly."""

    def reveal(self) -> None:
        """Writes the local variables; called when one of them is read, so that they cost nothing otherwise."""

    def save(self) -> bytes:
        """The model's own state; the values are saved by the base class."""
        return b""

    def restore(self, state: bytes) -> None:
        """Undoes everything since the `save` that gave `state`."""

    def close(self) -> None:
        """Releases what initialise acquired."""

    # ---- helpers for subclasses

    def __getitem__(self, name: str) -> float:
        return float(self.values[self.index[name]])

    def __setitem__(self, name: str, value: float) -> None:
        self.values[self.index[name]] = value

    def slots(self, *names: str) -> slice:
        """The values of variables that stand next to each other in the list."""
        first = self.index[names[0]]
        if [self.index[n] for n in names] != list(range(first, first + len(names))):
            raise ValueError(f"{names[0]} ... {names[-1]} do not stand next to each other")
        return slice(first, first + len(names))

    def log(self, message: str, status: int = 0) -> None:
        self._log.append(Log(status, message))

    # ---- called by the binary

    def memory(self) -> tuple[int, int, int]:
        """Address of the values, their number, and the address of a byte for each: PARAMETER, LOCAL or 0. They stay
        where they are."""
        return self.values.ctypes.data, len(self.values), self._kinds.ctypes.data

    def settle(self) -> None:
        """Outputs agree with what was set."""
        self._guard(self.refresh if self._running else self._initialise)
        self._stale = False

    def reset(self) -> None:
        """As after the instantiation."""
        self.close()
        self.values[:] = self._starts
        self._running, self._stale = False, True

    def setup_experiment(self, *_: Any) -> None:
        pass

    def enter_initialization_mode(self) -> None:
        pass

    def exit_initialization_mode(self) -> None:
        self._guard(self._initialise)
        self._running = True

    def do_step(self, time: float, step: float) -> bool:
        try:
            self.step(time, step)
        except Exception:
            raise FmuError(traceback.format_exc()) from None
        self._stale = False
        return True

    def terminate(self) -> None:
        self.close()

    def __del__(self) -> None:
        with contextlib.suppress(Exception):  # the interpreter may be going down
            self.close()

    def get_real(self, references: list[int]) -> list[float]:
        if self._stale:
            self.settle()
        selection, has_locals = self._selection(references)
        if has_locals:
            self._guard(self.reveal)
        return self.values[selection].tolist()

    def set_real(self, references: list[int], values: list[float]) -> None:
        if references != self._put:
            if self._running and not self._fixed.isdisjoint(references):
                name = next(v["name"] for k, v in enumerate(self.variables) if k in self._fixed and k in references)
                raise FmuError(f"parameter {name} can only be set before initialisation")
            self._put = list(references)
        self.values[self._selection(references)[0]] = values
        self._stale = True

    def get_integer(self, references: list[int]) -> list[int]:
        return [int(value) for value in self.get_real(references)]

    set_integer = set_real

    def _get_fmu_state(self) -> bytes:
        flags = np.array([self._running, self._stale], dtype=float)
        return np.concatenate([flags, self.values]).tobytes() + self.save()

    def _set_fmu_state(self, state: bytes) -> None:
        size = 8 * (2 + len(self.values))
        numbers = np.frombuffer(state[:size])
        self._running, self._stale = bool(numbers[0]), bool(numbers[1])
        self.values[:] = numbers[2:]
        self._guard(lambda: self.restore(state[size:]))

    @staticmethod
    def _fmu_state_to_bytes(state: bytes) -> bytes:
        return state

    @staticmethod
    def _fmu_state_from_bytes(state: bytes) -> bytes:
        return bytes(state)

    def _get_log_queue(self) -> list[Log]:
        return self._log

    # ---- private

    def _selection(self, references: list[int]) -> tuple[Any, bool]:
        """A slice where the references are consecutive, else an index array, and whether local variables are among
        them; a master asks for the same ones at every step."""
        key = (len(references), references[0] if references else 0)
        known = self._known.get(key)
        if known is None or known[0] != references:
            first = key[1]
            consecutive = references == list(range(first, first + key[0]))
            selection = slice(first, first + key[0]) if consecutive else np.array(references, dtype=int)
            known = self._known[key] = (list(references), selection, not self._locals.isdisjoint(references))
        return known[1], known[2]

    def _initialise(self) -> None:
        for k in self._fixed:
            variable, value = self.variables[k], self.values[k]
            low, high = variable.get("min", -math.inf), variable.get("max", math.inf)
            if not low <= value <= high:
                unit = f" {variable['unit']}" if variable.get("unit", "1") != "1" else ""
                raise ValueError(f"{variable['name']} = {value:g}{unit}: must lie between {low:g} and {high:g}")
        self.initialise()
        self._stale = False

    @staticmethod
    def _guard(call: Any) -> None:
        try:
            call()
        except Exception:
            raise FmuError(traceback.format_exc()) from None
