"""FMI 1.0, 2.0 and 3.0 model exchange: the FMU gives derivatives and event indicators, CVode (through fmpy) integrates
from one communication point to the next. Inputs are held over the step, as in co-simulation; since they jump between
steps, so does the solver start anew at every step in which they changed."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..errors import SimulationError, SimulationStopped
from .fmi1 import Fmi1Instance
from .fmi2 import Fmi2Instance
from .fmi3 import Fmi3Instance
from .fmi_instance import FmiInstance
from .messages import ERROR, logger3

TOLERANCE = 1e-8  # relative; the absolute one is this times the nominal of the state
MAX_EVENTS = 1000  # per communication step
MAX_ITERATIONS = 100  # of discrete states at one event
MAX_SOLVER_STEPS = 100_000


class _Held:
    """fmpy's solver asks for the inputs at its trial times; they do not change."""

    def apply(self, time: float) -> None:
        pass


class _Integrated(FmiInstance):
    """Mixed in before the instance of a version of FMI. Modes: initialisation - event (iterate) - continuous time -
    event ..."""

    _solver: Any = None
    _failure: BaseException | None = None
    _sent_inputs: np.ndarray

    def call_exit_initialization(self) -> None:
        super().call_exit_initialization()
        self._begin()

    def _begin(self) -> None:
        """From the end of the initialisation to continuous time."""
        self._time = self._times[0]
        self._failure = None
        self._iterate()
        self._enter_continuous()

    def call_enter_initialization(self, time: float, stop: float) -> None:
        self._times = time, stop
        super().call_enter_initialization(time, stop)

    def set_inputs(self) -> None:
        """Inputs that jump are an event of the model."""
        continuous = self._solver is not None
        if continuous:
            if np.array_equal(self._sent_inputs, self.input_values):
                return
            self.call("entering event mode", self.fmu.enterEventMode)
        super().set_inputs()
        self._sent_inputs = self.input_values.copy()
        if continuous:
            self.call("updating its discrete states", self._iterate)
            self._enter_continuous()

    def call_reset(self) -> None:
        self._solver = None
        super().call_reset()

    def instantiate(self) -> None:
        self._solver = None
        self._sent_inputs = np.zeros(0)
        super().instantiate()

    def call_do_step(self, time: float, step: float) -> int:
        try:
            return self._advance(time + step)
        except SimulationError:
            raise
        except Exception as problem:
            return int(getattr(problem, "status", ERROR))

    def _advance(self, end: float) -> int:
        for _ in range(MAX_EVENTS):
            target = min(end, self._next_event)
            now = target
            event = False
            if target > self._time:
                if self._sizes != (0, 0):
                    event, now = self._integrate(target)
                self.fmu.setTime(now)
            self._time = now
            asked, terminate = self.fmu.completedIntegratorStep()
            if terminate:
                raise SimulationStopped(f"{self.component.name}: asked to end the simulation at {now:.6g} s")
            if event or asked or now >= self._next_event:
                self.fmu.enterEventMode()
                self._iterate()
                self._enter_continuous()
            if now >= end:
                return 0
        self.log.add(f"more than {MAX_EVENTS} events in one communication step")
        return ERROR

    def _integrate(self, target: float) -> tuple[bool, float]:
        try:
            event, _, now = self._solver.step(self._time, target)
        except RuntimeError as problem:
            raise SimulationError(
                f"{self.component.name}: cannot be integrated at {self._time:.6g} s: {problem}"
            ) from None
        if self._failure is not None:
            raise self._failure
        return event, now

    def _iterate(self) -> None:
        for _ in range(MAX_ITERATIONS):
            again, terminate, _, _, defined, when = self._update()
            if terminate:
                raise SimulationStopped(f"{self.component.name}: asked to end the simulation at {self._time:.6g} s")
            if not again:
                self._next_event = when if defined else float("inf")
                return
        raise SimulationError(f"{self.component.name}: its discrete states do not settle at {self._time:.6g} s")

    def _enter_continuous(self) -> None:
        self.fmu.enterContinuousTimeMode()
        if self._solver is not None:
            self._solver.reset(self._time)
            return
        from fmpy.sundials import CVodeSolver

        nx, nz = self._sizes = self._count()
        self._solver = CVodeSolver(
            nx=nx,
            nz=nz,
            get_x=self.fmu.getContinuousStates,
            set_x=self._guarded(self.fmu.setContinuousStates),
            get_dx=self._guarded(self._derivatives),
            get_z=self._guarded(self.fmu.getEventIndicators),
            get_nominals=self.fmu.getNominalsOfContinuousStates,
            set_time=self._guarded(self.fmu.setTime),
            input=_Held(),
            startTime=self._time,
            relativeTolerance=TOLERANCE,
            maxNumSteps=MAX_SOLVER_STEPS,
        )

    def _guarded(self, function: Any) -> Any:
        """What is raised inside the solver would be lost in C: kept for after the step."""

        def call(*arguments: Any) -> None:
            if self._failure is None:
                try:
                    function(*arguments)
                except Exception as problem:
                    self._failure = problem

        return call

    def restore_state(self, state: Any) -> None:
        super().restore_state(state[0])
        self._time, self._next_event = state[1:]
        self._solver.reset(self._time)

    def save_state(self) -> Any:
        return super().save_state(), self._time, self._next_event

    def free_state(self, state: Any) -> None:
        super().free_state(state[0])

    def _update(self) -> tuple[Any, ...]:
        raise NotImplementedError

    def _count(self) -> tuple[int, int]:
        raise NotImplementedError

    def _derivatives(self, dx: Any, nx: int) -> None:
        raise NotImplementedError


class Fmi1ModelExchange(_Integrated, Fmi1Instance):
    """FMI 1.0 has no modes: its events are updated wherever the later versions enter event mode."""

    def load_library(self, **arguments: Any) -> Any:
        from fmpy.fmi1 import FMU1Model

        fmu = self.made(FMU1Model, **arguments)
        completed = fmu.completedIntegratorStep
        fmu.enterEventMode = fmu.enterContinuousTimeMode = lambda: None
        fmu.completedIntegratorStep = lambda: (completed(), False)
        fmu.getNominalsOfContinuousStates = fmu.getNominalContinuousStates
        return fmu

    def free_instance(self) -> None:
        self.fmu.fmi1FreeModelInstance(self.fmu.component)

    def call_reset(self) -> None:
        raise SimulationError(f"{self.component.name}: FMI 1.0 model exchange has no reset")

    def call_exit_initialization(self) -> None:
        self.fmu.setTime(self._times[0])
        self.fmu.initialize()
        self.readable = True
        self._begin()

    def _update(self) -> tuple[Any, ...]:
        converged, references, values, terminate, defined, when = self.fmu.eventUpdate()
        return not converged, terminate, references, values, defined, when

    def _count(self) -> tuple[int, int]:
        return self.component.capabilities.states, self.component.capabilities.event_indicators

    def _derivatives(self, dx: Any, nx: int) -> None:
        self.fmu.getDerivatives(dx, nx)


class Fmi2ModelExchange(_Integrated, Fmi2Instance):
    def load_library(self, **arguments: Any) -> Any:
        from fmpy.fmi2 import FMU2Model

        return self.made(FMU2Model, **arguments)

    def _update(self) -> tuple[Any, ...]:
        return tuple(self.fmu.newDiscreteStates())

    def _count(self) -> tuple[int, int]:
        return self.component.capabilities.states, self.component.capabilities.event_indicators

    def _derivatives(self, dx: Any, nx: int) -> None:
        self.fmu.getDerivatives(dx, nx)


class Fmi3ModelExchange(_Integrated, Fmi3Instance):
    def load_library(self, **arguments: Any) -> Any:
        from fmpy.fmi3 import FMU3Model

        return self.made(FMU3Model, **arguments)

    def make(self, *common: Any) -> Any:
        return self.fmu.fmi3InstantiateModelExchange(*common, self.log.environment, logger3())

    def _update(self) -> tuple[Any, ...]:
        return tuple(self.fmu.updateDiscreteStates())

    def _count(self) -> tuple[int, int]:
        return int(self.fmu.getNumberOfContinuousStates()), int(self.fmu.getNumberOfEventIndicators())

    def _derivatives(self, dx: Any, nx: int) -> None:
        self.fmu.getContinuousStateDerivatives(dx, nx)
