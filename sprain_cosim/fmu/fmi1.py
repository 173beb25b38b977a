"""FMI 1.0: no initialisation mode, so outputs are first read after the initialisation; no saved states."""

from __future__ import annotations

import ctypes
from typing import Any, ClassVar

from .fmi_instance import LAST_SUCCESSFUL_TIME, PENDING, FmiInstance
from .messages import WARNING, loggers


class Fmi1Instance(FmiInstance):
    """Common to co-simulation and model exchange."""

    types: ClassVar = {
        "Real": ("Real", ctypes.c_double),
        "Integer": ("Integer", ctypes.c_int),
        "Enumeration": ("Integer", ctypes.c_int),
        "Boolean": ("Boolean", ctypes.c_char),
    }

    def function(self, name: str) -> Any:
        return self.fmu.dll[f"{self.component.identifier}_fmi{name}"]

    def instantiate(self) -> None:
        self.readable = False
        self.fmu.instantiate(functions=loggers()[0], loggingOn=True)
        if not self.fmu.component:
            raise RuntimeError("null")

    def call_enter_initialization(self, time: float, stop: float) -> None:
        self._times = time, stop


class Fmi1CoSimulation(Fmi1Instance):
    def load_library(self, **arguments: Any) -> Any:
        from fmpy.fmi1 import FMU1Slave

        return self.made(FMU1Slave, **arguments)

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
