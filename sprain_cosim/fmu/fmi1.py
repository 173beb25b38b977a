"""FMI 1.0: no initialisation mode, so outputs are first read after the initialisation; no saved states."""

from __future__ import annotations

import ctypes
from typing import Any, ClassVar

from .fmi_instance import LAST_SUCCESSFUL_TIME, PENDING, WARNING, FmiInstance


class Fmi1Instance(FmiInstance):
    """Common to co-simulation and model exchange."""

    types: ClassVar = {
        "Real": ("Real", ctypes.c_double),
        "Integer": ("Integer", ctypes.c_int),
        "Enumeration": ("Integer", ctypes.c_int),
        "Boolean": ("Boolean", ctypes.c_char),
    }

    def callbacks(self) -> Any:
        """The functions that an instance may call; they live as long as this."""
        from fmpy import calloc, fmi1, free

        def log_message(instance: Any, name: bytes, status: int, category: bytes, message: bytes) -> None:
            self.log_message(message, status)

        self._callbacks = fmi1.fmi1CallbackFunctions()
        self._callbacks.logger = fmi1.fmi1CallbackLoggerTYPE(log_message)
        self._callbacks.allocateMemory = fmi1.fmi1CallbackAllocateMemoryTYPE(calloc)
        self._callbacks.freeMemory = fmi1.fmi1CallbackFreeMemoryTYPE(free)
        return self._callbacks

    def function(self, name: str) -> Any:
        return self.fmu.dll[f"{self.component.identifier}_fmi{name}"]

    def instantiate(self) -> None:
        self.readable = False
        self.fmu.instantiate(functions=self.callbacks(), loggingOn=True)
        if not self.fmu.component:
            raise RuntimeError("null")

    def call_enter_initialization(self, time: float, stop: float) -> None:
        self._times = time, stop


class Fmi1CoSimulation(Fmi1Instance):
    def load_library(self, **arguments: Any) -> Any:
        from fmpy.fmi1 import FMU1Slave

        return FMU1Slave(**arguments)

    def free_instance(self) -> None:
        self.fmu.fmi1FreeSlaveInstance(self.fmu.component)

    def call_reset(self) -> None:
        self.readable = False
        self.fmu.reset()

    def call_exit_initialization(self) -> None:
        self.fmu.initialize(*self._times)
        self.readable = True
        self._step = self.function("DoStep")

    def call_do_step(self, time: float, step: float) -> int:
        status: int = self._step(self.instance, ctypes.c_double(time), ctypes.c_double(step), ctypes.c_char(b"\x01"))
        return self.finished_step() if status == PENDING else status

    def discard_status(self) -> tuple[float | None, bool]:
        reached = ctypes.c_double()
        status = self.function("GetRealStatus")(self.instance, LAST_SUCCESSFUL_TIME, ctypes.byref(reached))
        return reached.value if status <= WARNING else None, False
