"""FMI 1.0 co-simulation: no initialisation mode, so outputs are first read after the initialisation; no saved
states."""

from __future__ import annotations

import ctypes
from typing import Any, ClassVar

from .instance import LAST_SUCCESSFUL_TIME, PENDING, FmiInstance


class Fmi1CoSimulation(FmiInstance):
    types: ClassVar = {
        "Real": ("Real", ctypes.c_double),
        "Integer": ("Integer", ctypes.c_int),
        "Enumeration": ("Integer", ctypes.c_int),
        "Boolean": ("Boolean", ctypes.c_char),
    }

    def load(self, **arguments: Any) -> Any:
        from fmpy import calloc, fmi1, free
        from fmpy.fmi1 import FMU1Slave

        def log(instance: Any, name: bytes, status: int, category: bytes, message: bytes) -> None:
            self.log(message)

        self._callbacks = fmi1.fmi1CallbackFunctions()
        self._callbacks.logger = fmi1.fmi1CallbackLoggerTYPE(log)
        self._callbacks.allocateMemory = fmi1.fmi1CallbackAllocateMemoryTYPE(calloc)
        self._callbacks.freeMemory = fmi1.fmi1CallbackFreeMemoryTYPE(free)
        return FMU1Slave(**arguments)

    def function(self, name: str) -> Any:
        return self.fmu.dll[f"{self.component.identifier}_fmi{name}"]

    def create(self) -> None:
        self.readable = False
        self.fmu.instantiate(functions=self._callbacks, loggingOn=True)
        if not self.fmu.component:
            raise RuntimeError("null")

    def free(self) -> None:
        self.fmu.fmi1FreeSlaveInstance(self.fmu.component)

    def recycle(self) -> None:
        self.readable = False
        self.fmu.reset()

    def enter(self, time: float, stop: float) -> None:
        self._times = time, stop

    def leave(self) -> None:
        self.fmu.initialize(*self._times)
        self.readable = True
        self._step = self.function("DoStep")

    def call_do_step(self, time: float, step: float) -> int:
        status: int = self._step(self.instance, ctypes.c_double(time), ctypes.c_double(step), ctypes.c_char(b"\x01"))
        return self.waited() if status == PENDING else status

    def progress(self) -> tuple[float | None, bool]:
        reached = ctypes.c_double()
        told = self.function("GetRealStatus")(self.instance, LAST_SUCCESSFUL_TIME, ctypes.byref(reached)) <= 1
        return reached.value if told else None, False
