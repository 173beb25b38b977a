"""FMI 2.0 co-simulation."""

from __future__ import annotations

import atexit
import ctypes
from functools import lru_cache
from pathlib import Path
from typing import Any, ClassVar

from .fmi_instance import LAST_SUCCESSFUL_TIME, PENDING, FmiInstance, NativeCalls
from .messages import WARNING, loggers

TERMINATED = 3  # fmi2StatusKind


class Fmi2Instance(FmiInstance):
    """Common to co-simulation and model exchange."""

    types: ClassVar = {
        "Real": ("Real", ctypes.c_double),
        "Integer": ("Integer", ctypes.c_int),
        "Enumeration": ("Integer", ctypes.c_int),
        "Boolean": ("Boolean", ctypes.c_int),
    }

    def function(self, name: str) -> Any:
        return getattr(self.fmu.dll, f"fmi2{name}")

    def instantiate(self) -> None:
        """Not by fmpy's own method, which spells the folder of resources anew each time."""
        self.fmu.callbacks = loggers()[1]
        self.fmu.component = self.fmu.fmi2Instantiate(
            self.log.label.encode(),
            int(not self.component.capabilities.model_exchange),
            self.component.guid.encode(),
            _resources(self.fmu.unzipDirectory),
            ctypes.byref(self.fmu.callbacks),
            False,
            True,
        )
        if self.fmu.component is None:
            raise RuntimeError("null")

    def free_instance(self) -> None:
        self.fmu.fmi2FreeInstance(self.fmu.component)

    def call_enter_initialization(self, time: float, stop: float) -> None:
        self.fmu.setupExperiment(startTime=time, stopTime=stop)
        self.fmu.enterInitializationMode()

    def call_exit_initialization(self) -> None:
        self.fmu.exitInitializationMode()

    def save_state(self) -> Any:
        return self.call("saving its state", self.fmu.getFMUstate)

    def restore_state(self, state: Any) -> None:
        self.call("restoring its state", self.fmu.setFMUstate, state)

    def free_state(self, state: Any) -> None:
        self.call("releasing a state", self.fmu.freeFMUstate, state)


@lru_cache(maxsize=64)
def _resources(folder: str) -> bytes:
    return Path(folder, "resources").as_uri().encode()


class Fmi2CoSimulation(Fmi2Instance):
    def load_library(self, **arguments: Any) -> Any:
        from fmpy.fmi2 import FMU2Slave

        fmu = self.made(FMU2Slave, **arguments)
        if hasattr(fmu.dll, "finalizePythonInterpreter"):
            # PythonFMU's library frees its interpreter state twice at the end of the process, unless it did so
            # before
            atexit.register(fmu.dll.finalizePythonInterpreter)
        self._step = fmu.dll.fmi2DoStep
        self._final = int(
            not self.component.capabilities.state
        )  # no state will be set that lies before the present point
        return fmu

    def call_do_step(self, time: float, step: float) -> int:
        status: int = self._step(self.instance, ctypes.c_double(time), ctypes.c_double(step), self._final)
        return self.finished_step() if status == PENDING else status

    def native_calls(self) -> NativeCalls | None:
        return self.plain_calls(2, self._step, bool(self._final))

    def discard_status(self) -> tuple[float | None, bool]:
        reached, ended = ctypes.c_double(), ctypes.c_int()
        status = self.function("GetRealStatus")(self.instance, LAST_SUCCESSFUL_TIME, ctypes.byref(reached))
        end_status = self.function("GetBooleanStatus")(self.instance, TERMINATED, ctypes.byref(ended))
        return reached.value if status <= WARNING else None, end_status <= WARNING and bool(ended.value)
