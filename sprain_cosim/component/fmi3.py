"""FMI 3.0 co-simulation, without event mode and without early return."""

from __future__ import annotations

import ctypes
from typing import Any, ClassVar

from .common import FmiInstance

DISCARD = 2
INTEGERS = {f"{sign}Int{bits}": getattr(ctypes, f"c_{sign.lower()}int{bits}") for sign in ("", "U") for bits in (8, 16, 32, 64)}


class Fmi3Instance(FmiInstance):
    """Common to co-simulation and model exchange."""

    types: ClassVar = {
        "Float64": ("Float64", ctypes.c_double),
        "Float32": ("Float32", ctypes.c_float),
        "Enumeration": ("Int64", ctypes.c_int64),
        "Boolean": ("Boolean", ctypes.c_bool),
        **{name: (name, ctype) for name, ctype in INTEGERS.items()},
    }

    def function(self, name: str) -> Any:
        return self.fmu.dll[f"fmi3{name}"]

    def arguments(self, references: Any, n: int, buffer: Any) -> tuple[Any, ...]:
        return self.instance, references, ctypes.c_size_t(n), buffer, ctypes.c_size_t(n)

    def create(self) -> None:
        self.fmu.instantiate(loggingOn=True, logMessage=self._heard)

    def _heard(self, environment: Any, status: int, category: bytes, message: bytes) -> None:
        self.log(message)

    def free(self) -> None:
        self.fmu.fmi3FreeInstance(self.fmu.component)

    def enter(self, time: float, stop: float) -> None:
        self.fmu.enterInitializationMode(startTime=time, stopTime=stop)

    def leave(self) -> None:
        self.fmu.exitInitializationMode()

    def save(self) -> Any:
        return self.call("saving its state", self.fmu.getFMUState)

    def restore(self, state: Any) -> None:
        self.call("restoring its state", self.fmu.setFMUState, state)

    def release(self, state: Any) -> None:
        self.call("releasing a state", self.fmu.freeFMUState, state)


class Fmi3CoSimulation(Fmi3Instance):
    def load(self, **arguments: Any) -> Any:
        from fmpy.fmi3 import FMU3Slave

        fmu = FMU3Slave(**arguments)
        self._step = fmu.dll["fmi3DoStep"]
        self._event, self._end, self._early = ctypes.c_bool(), ctypes.c_bool(), ctypes.c_bool()
        self._reached = ctypes.c_double()
        self._answers = tuple(ctypes.byref(v) for v in (self._event, self._end, self._early, self._reached))
        return fmu

    def do_step(self, time: float, step: float) -> int:
        status: int = self._step(self.instance, ctypes.c_double(time), ctypes.c_double(step), ctypes.c_bool(True), *self._answers)
        if self._end.value and status <= 1:
            self.log("it asked to end the simulation")
            return DISCARD
        if self._early.value and status <= 1:
            self.log(f"it returned at {self._reached.value:g} s though early return was not allowed")
            return DISCARD
        return status
