"""Communication steps taken in C (native_steps.c), over the library functions of the FMUs themselves: the common case
without Python between two calls. Everything else, and whatever goes wrong, is done by the schemes in Python, whose
record this one equals to the bit.

The common case: Gauss-Seidel, Jacobi, or impedance hand-over with nothing to be found anew along the run; every
component an FMU of FMI 2 or 3 co-simulation in this process that exchanges double-precision numbers and takes every
step at once; the record at the points of exchange, without local variables."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from typing import Any

from .assembly import Assembly
from .coupling import Coupling
from .native_members import FINISHED, NOT_FINITE, PAUSED, STEPPING, NativeMembers, loaded
from .recorder import Recorder
from .schedule import Schedule
from .schemes.gauss_seidel import GaussSeidel
from .schemes.impedance import Impedance
from .schemes.jacobi import Jacobi

SLICE = 0.02  # s of wall time, after which Python looks for signals


class NativeSteps:
    """The steps of one run, whose coupling has started."""

    def __init__(
        self, assembly: Assembly, members: NativeMembers, recorder: Recorder, plan: Schedule, jacobi: bool
    ) -> None:
        self._assembly, self._members, self._recorder, self._plan = assembly, members, recorder, plan
        members.refresh()
        run = self._run = members.run
        run.rows = recorder.passed.ctypes.data
        run.time, run.step, run.points = plan.time.ctypes.data, plan.step.ctypes.data, len(plan.step)
        run.jacobi = jacobi

    @classmethod
    def of(cls, coupling: Coupling, assembly: Assembly, recorder: Recorder, plan: Schedule) -> NativeSteps | None:
        """None where steps need Python."""
        scheme, members = coupling.scheme, assembly.native
        plain = type(scheme) in (GaussSeidel, Jacobi) or (type(scheme) is Impedance and not scheme.identifies)
        if members is None or not plain or assembly.own_rate or not (plan.regular and recorder.plain):
            return None
        return cls(assembly, members, recorder, plan, type(scheme) is Jacobi)

    def points(self) -> Iterator[int]:
        """Takes the steps; gives the number of the point that was reached, now and then and at the end. Raises
        SimulationError as the schemes do; the last number given is then that of the last point on record."""
        run, take = self._run, loaded().take_steps
        outcome = PAUSED
        try:
            while outcome != FINISHED:
                outcome = take(ctypes.byref(run), ctypes.c_double(SLICE))
                yield self._recorder.reached(run.point)
                if outcome not in (FINISHED, PAUSED):
                    self._resolve(outcome)
        finally:
            self._members.count_warnings()

    def _resolve(self, outcome: int) -> None:
        """A call that was not answered by ok: raises what the schemes raise, or returns when the step goes on."""
        run, member = self._run, self._members.here
        time, step = float(self._plan.time[run.point]), float(self._plan.step[run.point])
        if outcome == NOT_FINITE:
            self._assembly.check_outputs(member, time + step)
        elif outcome == STEPPING:
            instance: Any = member.instance
            instance.check_step(run.status, time, step)
            run.stepped = 1
        else:
            self._members.check(outcome)
