"""FMI 3.0 co-simulation. Event mode where the FMU has it: events are handled at its early returns and at the times it
names."""

from __future__ import annotations

import ctypes
import math
import os
from dataclasses import replace
from typing import Any, ClassVar

from ..errors import SimulationError, SimulationStopped
from .fmi_instance import DISCARD, FmiInstance, NativeCalls
from .messages import ERROR, WARNING, logger3

ROUNDING = 1e-9  # of a step or an interval: times that differ by less are the same
MAX_RETURNS = 10_000  # in one step
MAX_ITERATIONS = 100  # of discrete states at one event
INTEGERS = {
    f"{sign}Int{bits}": getattr(ctypes, f"c_{sign.lower()}int{bits}") for sign in ("", "U") for bits in (8, 16, 32, 64)
}


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
        return getattr(self.fmu.dll, f"fmi3{name}")

    def arguments(self, references: Any, n: int, buffer: Any) -> tuple[Any, ...]:
        return self.instance, references, ctypes.c_size_t(n), buffer, ctypes.c_size_t(len(buffer))

    def instantiate(self) -> None:
        """Not by fmpy's own method, which makes another logger each time, frees the one before, and hands no
        environment through."""
        resources = os.path.join(self.fmu.unzipDirectory, "resources", "")
        self.fmu.component = self.make(
            self.log.label.encode(),
            self.component.guid.encode(),
            resources.encode(),
            ctypes.c_bool(),
            ctypes.c_bool(True),
        )
        if not self.fmu.component:
            raise RuntimeError("null")

    def make(self, *common: Any) -> Any:
        """The FMU's function that instantiates; `common`: name, token, resources, visible, logging."""
        raise NotImplementedError

    def free_instance(self) -> None:
        self.fmu.fmi3FreeInstance(self.fmu.component)

    def call_enter_initialization(self, time: float, stop: float) -> None:
        self.fmu.enterInitializationMode(startTime=time, stopTime=stop)

    def call_exit_initialization(self) -> None:
        self.fmu.exitInitializationMode()

    def save_state(self) -> Any:
        return self.call("saving its state", self.fmu.getFMUState)

    def restore_state(self, state: Any) -> None:
        self.call("restoring its state", self.fmu.setFMUState, state)

    def free_state(self, state: Any) -> None:
        self.call("releasing a state", self.fmu.freeFMUState, state)


class Fmi3CoSimulation(Fmi3Instance):
    def load_library(self, **arguments: Any) -> Any:
        from fmpy.fmi3 import FMU3Slave

        fmu = self.made(FMU3Slave, **arguments)
        self._step = fmu.dll["fmi3DoStep"]
        self._event, self._end, self._early = ctypes.c_bool(), ctypes.c_bool(), ctypes.c_bool()
        self._reached = ctypes.c_double()
        self._answers = tuple(ctypes.byref(v) for v in (self._event, self._end, self._early, self._reached))
        return fmu

    def instantiate(self) -> None:
        self._next_event = math.inf
        self._ticks: tuple[float, ...] = ()  # the next time of each clock
        self._final = ctypes.c_bool(
            not self.component.capabilities.state
        )  # no state will be set that lies before the present point
        super().instantiate()

    def make(self, *common: Any) -> Any:
        from fmpy.fmi3 import fmi3IntermediateUpdateCallback, fmi3ValueReference

        capabilities = self.component.capabilities
        modes = ctypes.c_bool(capabilities.event_mode), ctypes.c_bool(capabilities.early_return)
        intermediate = (fmi3ValueReference * 0)(), 0, self.log.environment, logger3(), fmi3IntermediateUpdateCallback()
        return self.fmu.fmi3InstantiateCoSimulation(*common, *modes, *intermediate)

    def call_enter_initialization(self, time: float, stop: float) -> None:
        self._start = time
        super().call_enter_initialization(time, stop)

    def call_exit_initialization(self) -> None:
        super().call_exit_initialization()
        if self.component.capabilities.event_mode:  # initialisation leads into it
            self._clocks = [c for c in self.component.inputs.values() if c.interval is not None]
            self._ticks = tuple(self._start + c.shift for c in self._clocks)
            self._handle_events(self._start)

    def call_do_step(self, time: float, step: float) -> int:
        capabilities, end, now = self.component.capabilities, time + step, time
        for _ in range(MAX_RETURNS):
            if abs(self._next_event - end) <= ROUNDING * step:
                self._next_event = end
            target = min(end, max(now, self._next_event))
            self._event.value = self._end.value = self._early.value = False
            self._reached.value = now
            if target > now:
                size = step if (now, target) == (time, end) else target - now
                status: int = self._step(
                    self.instance, ctypes.c_double(now), ctypes.c_double(size), self._final, *self._answers
                )
                if status not in (0, WARNING):
                    return status
                if self._end.value:
                    return DISCARD
                if status:
                    self.log.warned()
                if self._early.value and not capabilities.early_return:
                    return self._early_return()
            now = self._reached.value if self._early.value else target
            if capabilities.event_mode and (self._event.value or now >= self._next_event):
                self.call("handling its events", self.fmu.enterEventMode)
                self._handle_events(now)
            if now >= end - 1e-9 * step:
                return 0
        self.log.add(f"it returned early more than {MAX_RETURNS} times in one step")
        return ERROR

    def _early_return(self) -> int:
        self.log.add(f"it returned at {self._reached.value:g} s though early return was not allowed")
        return ERROR

    def native_calls(self) -> NativeCalls | None:
        if self.component.capabilities.event_mode or self.component.capabilities.early_return:
            return None
        calls = self.plain_calls(3, self._step, self._final.value)
        at = ctypes.addressof
        answers = at(self._event), at(self._end), at(self._early), at(self._reached)
        return calls and replace(calls, answers=answers)

    def check_step(self, status: int, time: float, step: float) -> None:
        if status in (0, WARNING) and (self._end.value or self._early.value):
            status = DISCARD if self._end.value else self._early_return()
        super().check_step(status, time, step)

    def discard_status(self) -> tuple[float | None, bool]:
        return self._reached.value, bool(self._end.value)

    def save_state(self) -> Any:
        return super().save_state(), self._next_event, self._ticks

    def restore_state(self, state: Any) -> None:
        super().restore_state(state[0])
        self._next_event, self._ticks = state[1:]

    def free_state(self, state: Any) -> None:
        super().free_state(state[0])

    def _tick(self, now: float) -> None:
        """In event mode: ticks the clocks that are due. Their times are counted from the start, without a sum."""
        clocks = [(c.reference, self._start + c.shift, c.interval) for c in self._clocks if c.interval]
        passed = [math.floor((now - first) / interval + ROUNDING) for _, first, interval in clocks]
        due = [
            reference
            for (reference, _, interval), tick in zip(clocks, self._ticks, strict=True)
            if tick <= now + ROUNDING * interval
        ]
        if due:
            self.call("ticking its clocks", self.fmu.setClock, due, [True] * len(due))
        self._ticks = tuple(
            first + max(0, n + 1) * interval for (_, first, interval), n in zip(clocks, passed, strict=True)
        )

    def _handle_events(self, now: float) -> None:
        """In event mode; leads to step mode."""
        self._tick(now)
        for _ in range(MAX_ITERATIONS):
            again, terminate, _, _, defined, when = self.call("handling its events", self.fmu.updateDiscreteStates)
            if terminate:
                raise SimulationStopped(
                    f"{self.component.name}: asked to end the simulation at {now:.6g} s{self.last_message()}"
                )
            if not again:
                self._next_event = min(when if defined and when > now else math.inf, *self._ticks, math.inf)
                self.call("handling its events", self.fmu.enterStepMode)
                return
        raise SimulationError(f"{self.component.name}: its discrete states do not settle at {now:.6g} s")
