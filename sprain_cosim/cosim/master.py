"""The master algorithm: drives a system through time.

    start all components until their values agree
    for every point of exchange but the last:  the communication points, start + k * communication_step, and the times
                                               at which a component with a rate of its own is due (schedule.py)
        the scheme takes every other component to the next point
        the components that are due there take their step

The record lies on a grid of its own, min(communication step, 0.5 ms), which the plant passes through.

Failure policy: a scheme that would be unstable with this device is refused before the first step (InputError). An FMI
error or a value that is not finite ends the run with status `failed` and a message that names component, call or
variable, and time; an FMU that asks to end the run ends it with status `stopped`. What was recorded until then stays in
the result; a short record is never `completed`. When an FMU refuses a step and can save its state, the run begins again
with a state saved before each step, and refused steps are taken in parts."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from time import perf_counter

import numpy as np

from ..errors import InputError, SimulationError, SimulationStopped, StepDiscarded
from ..units import seconds
from .assembly import Assembly
from .coupling import Coupling, begin
from .native_steps import NativeSteps
from .recorder import Recorder
from .result import Held, Result
from .schedule import Schedule


@dataclass(frozen=True)
class Master:
    """How a system is driven through time.

    communication_step, stop, start  [s]; a text such as "0.5 ms" is read
    scheme    of schemes/, or auto
    guard     refuse a run whose coupling would be unstable, before it starts
    record    patterns of local variables to record besides the connectors, such as "plant.*"; they cost nothing when
              left out
    identify  number of steps after which stiffness and damping that a device does not declare are found anew; 0: at the
              start only
    adaptive  the communication steps are divided where the residual energy exceeds this share of the energy exchanged;
              0: never. The record stays on the regular grid

    >>> import sprain_cosim as sc
    >>> assembly = sc.load_scenario("incline30").system().open()
    >>> result = sc.Master(stop="20 ms").run(assembly, {"plant.platform_incline": "20 deg"})
    >>> result.status, len(result.time)
    ('completed', 41)
    >>> assembly.close()
    """

    communication_step: float = 5e-4
    stop: float = 0.150
    start: float = 0.0
    scheme: str = "auto"
    guard: bool = True
    record: tuple[str, ...] = ()
    identify: int = 1
    adaptive: float = 0.0

    def __post_init__(self) -> None:
        for name in ("communication_step", "stop", "start"):
            if isinstance(value := getattr(self, name), str):
                object.__setattr__(self, name, seconds(value, name))

    @property
    def steps(self) -> int:
        """Number of communication steps. Raises InputError when the stop time is not a whole number of them."""
        if not (self.communication_step > 0 and math.isfinite(self.communication_step)):
            raise InputError(f"communication step {1e3 * self.communication_step:g} ms: must be positive")
        if not self.stop > self.start:
            raise InputError(f"stop {1e3 * self.stop:g} ms: must lie after the start at {1e3 * self.start:g} ms")
        span = self.stop - self.start
        if (steps := span / self.communication_step) > 1e7:
            raise InputError(
                f"communication step {1e3 * self.communication_step:g} ms: {steps:.9g} steps until the stop at "
                f"{1e3 * self.stop:g} ms; at most 10 000 000"
            )
        n = max(1, round(steps))
        if abs(n * self.communication_step - span) > 1e-9 * span:
            near = " and ".join(f"{1e3 * step:.12g} ms" for step in _accepted(span, self.communication_step))
            raise InputError(
                f"communication step {1e3 * self.communication_step:g} ms: the stop at {1e3 * self.stop:g} ms is not "
                f"a whole number of steps; near it are {near}"
            )
        return n

    def run(self, assembly: Assembly, parameters: Mapping[str, float | str], judged: bool = True) -> Result:
        """One run of an open system from its initial state; `parameters` {"component.parameter": a number in its own
        unit, or a text such as "0.35 m"}. Unless it is `judged`, its course is not looked at: no coupling error, no
        warning but those of the start. Raises InputError for a parameter that there is not, or that does not fit."""
        return self.land(assembly, assembly.system.in_own_units(parameters), judged)

    def land(self, assembly: Assembly, parameters: Mapping[str, float], judged: bool = True) -> Result:
        """The same with numbers that have been looked at, as System.in_own_units gives them."""
        with np.errstate(over="ignore"):  # squares of large numbers; what is not finite is found and named
            try:
                return self._run(assembly, parameters, judged)
            except StepDiscarded:
                assembly.save_before_steps()
                return self._run(assembly, parameters, judged)

    def _run(self, assembly: Assembly, parameters: Mapping[str, float], judged: bool) -> Result:
        began = perf_counter()
        steps = self.steps
        plan = assembly.schedule(self.start, self.communication_step, steps)
        coupling, points, status, message = None, 0, "completed", ""
        recorder: Recorder | None = None
        try:
            assembly.start(parameters, self.start, self.stop, plan.rates)
            recorder = Recorder(assembly, plan, self.record)
            coupling = begin(
                self.scheme, assembly, self.communication_step, steps, self.identify, self.guard, self.adaptive
            )
            recorder.write(0)
            native = NativeSteps.of(coupling, assembly, recorder, plan)
            for reached in native.points() if native else _points(coupling, assembly, recorder, plan):
                points = reached
        except StepDiscarded:
            raise
        except SimulationStopped as end:
            status, message = "stopped", str(end)
        except SimulationError as problem:
            status, message = "failed", str(problem)
        values = recorder.values() if recorder else np.empty((0, len(assembly.names)))
        exchanges, smallest = coupling.effort(plan, points) if coupling else (0, self.communication_step)
        error, warning = None, coupling.warning if coupling else ""
        if judged and coupling and recorder and not message:
            error, warning = coupling.judgement(assembly, recorder.passed, plan)
        return Result(
            time=plan.record[: len(values)].copy(),
            values=values,
            names=recorder.names if recorder else assembly.names,
            units=recorder.units if recorder else assembly.units,
            status=status,
            message=message,
            scheme=coupling.scheme.name if coupling else self.scheme,
            scheme_reason=coupling.reason if coupling else "",
            warning=warning,
            coupling_error=error,
            held=_held(assembly),
            messages={m.name: said for m in assembly.members if (said := m.instance.messages()) is not None},
            exchanges=exchanges,
            smallest_step=smallest,
            parameters=dict(parameters),
            wall=perf_counter() - began,
        )


def _accepted(span: float, step: float) -> list[float]:
    """The nearest larger and smaller step [s] of which `span` is a whole number, such as people write: with at most
    three digits after the point of the milliseconds, where there is one within half and twice the step."""
    fewer = max(1, math.floor(span / step))
    several = (range(fewer, fewer // 2, -1), range(fewer + 1, 2 * fewer + 2))
    return [next((span / n for n in each if _short(span / n)), span / each[0]) for each in several]


def _short(step: float) -> bool:
    return abs(1e3 * step - round(1e3 * step, 3)) < 1e-9


def _points(coupling: Coupling, assembly: Assembly, recorder: Recorder, plan: Schedule) -> Iterator[int]:
    """Takes the steps; gives the number of every point, once it is on record."""
    for k, (time, step) in enumerate(zip(plan.time.tolist(), plan.step.tolist(), strict=False)):
        coupling.step(assembly, time, step, plan.due.get(k + 1, ()))
        recorder.write(k + 1)
        yield k + 1


def _held(assembly: Assembly) -> dict[str, Held]:
    return {name: held for name, own in assembly.own_rate.items() if (held := own.held()) is not None}
