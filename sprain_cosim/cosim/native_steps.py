"""Communication steps taken in C (native_steps.c), over the library functions of the FMUs themselves: the common case
without Python between two calls. Everything else, and whatever goes wrong, is done by the schemes in Python, whose
record this one equals to the bit.

The common case: Gauss-Seidel, Jacobi, or impedance hand-over with nothing to be found anew along the run; every
component an FMU of FMI 2 or 3 co-simulation in this process that exchanges double-precision numbers and takes every
step at once; the record at the points of exchange, without local variables."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from functools import lru_cache
from typing import Any

import numpy as np

from ..fmu import fmi_instance
from ..fmu.fmi_instance import FmiInstance, NativeCalls
from ..shipped import library
from .assembly import Assembly, Member
from .coupling import Coupling
from .native_libraries import source_digest
from .recorder import Recorder
from .schedule import Schedule
from .schemes.gauss_seidel import GaussSeidel
from .schemes.impedance import Impedance
from .schemes.jacobi import Jacobi

NAME = "native_steps"
SLICE = 0.02  # s of wall time, after which Python looks for signals
FINISHED, PAUSED, SETTING, STEPPING, READING, NOT_FINITE = range(6)

_POINTER, _COUNT, _FLAG = ctypes.c_void_p, ctypes.c_int64, ctypes.c_int32


class _Member(ctypes.Structure):
    _fields_ = (
        *((name, _POINTER) for name in ("instance", "set", "get", "step", "input_references", "output_references")),
        *((name, _POINTER) for name in ("sources", "factor", "offset", "environment")),
        *((name, _POINTER) for name in ("event", "terminate", "early", "reached")),
        *((name, _COUNT) for name in ("first_input", "inputs", "first_output", "outputs", "direct")),
        *((name, _FLAG) for name in ("fmi", "scaled", "fed_back", "final", "inputs_set", "warnings")),
    )


class _Run(ctypes.Structure):
    _fields_ = (
        *((name, _POINTER) for name in ("bus", "rows", "time", "step", "members")),
        *((name, _COUNT) for name in ("slots", "count", "points", "point", "member")),
        *((name, _FLAG) for name in ("stepped", "status", "jacobi")),
    )


@lru_cache(maxsize=1)
def _take_steps() -> Any:
    """The function of the library; None where it is not built for this platform, or from another source."""
    path = library(NAME)
    try:
        found = ctypes.CDLL(str(path)) if path is not None else None
        if found is None or ctypes.c_char_p.in_dll(found, "source").value != source_digest(NAME).encode():
            return None
    except (OSError, ValueError):
        return None
    return found.take_steps


class NativeSteps:
    """The steps of one run, whose coupling has started."""

    def __init__(
        self,
        assembly: Assembly,
        recorder: Recorder,
        plan: Schedule,
        members: list[tuple[Member, NativeCalls]],
        jacobi: bool,
    ) -> None:
        self._assembly, self._recorder, self._plan = assembly, recorder, plan
        self._members = members
        self._time = np.ascontiguousarray(plan.time, dtype=float)
        self._step = np.ascontiguousarray(plan.step, dtype=float)
        self._table = (_Member * len(members))()
        self._kept: list[Any] = [self._time, self._step]
        for row, (member, calls) in zip(self._table, members, strict=True):
            self._fill(row, member, calls)
        self._run = _Run(
            bus=assembly.bus.ctypes.data,
            rows=recorder.passed.ctypes.data,
            time=self._time.ctypes.data,
            step=self._step.ctypes.data,
            members=ctypes.addressof(self._table),
            slots=len(assembly.record),
            count=len(members),
            points=len(plan.step),
            jacobi=jacobi,
        )

    @classmethod
    def of(cls, coupling: Coupling, assembly: Assembly, recorder: Recorder, plan: Schedule) -> NativeSteps | None:
        """None where steps need Python."""
        scheme = coupling.scheme
        plain = type(scheme) in (GaussSeidel, Jacobi) or (type(scheme) is Impedance and not scheme.identifies)
        if not plain or assembly.own_rate or not (plan.regular and recorder.plain) or _take_steps() is None:
            return None
        members = []
        for member in assembly.members:
            calls = member.instance.native_calls() if isinstance(member.instance, FmiInstance) else None
            if calls is None:
                return None
            members.append((member, calls))
        return cls(assembly, recorder, plan, members, type(scheme) is Jacobi)

    def points(self) -> Iterator[int]:
        """Takes the steps; gives the number of the point that was reached, now and then and at the end. Raises
        SimulationError as the schemes do; the last number given is then that of the last point on record."""
        run, take = self._run, _take_steps()
        outcome = PAUSED
        try:
            while outcome != FINISHED:
                outcome = take(ctypes.byref(run), ctypes.c_double(SLICE))
                yield self._recorder.reached(run.point)
                if outcome in (SETTING, STEPPING, READING, NOT_FINITE):
                    self._resolve(outcome)
        finally:
            for row, (member, _) in zip(self._table, self._members, strict=True):
                instance: Any = member.instance
                instance.log.warned(row.warnings)
                row.warnings = 0

    def _resolve(self, outcome: int) -> None:
        """A call that was not answered by ok: raises what the schemes raise, or returns when the step goes on."""
        run = self._run
        member, _ = self._members[run.member]
        instance: Any = member.instance
        time, step = float(self._time[run.point]), float(self._step[run.point])
        if outcome == NOT_FINITE:
            self._assembly.check_outputs(member, time + step)
        elif outcome == STEPPING:
            instance.check_step(run.status, time, step)
            run.stepped = 1
        else:
            instance.check(run.status, fmi_instance.SETTING if outcome == SETTING else fmi_instance.READING)

    def _fill(self, row: _Member, member: Member, calls: NativeCalls) -> None:
        sources = np.ascontiguousarray(member.sources, dtype=np.int64)
        factor, offset = (np.ascontiguousarray(a, dtype=float) for a in (member.factor, member.offset))
        self._kept += [sources, factor, offset, calls]
        row.instance, row.set, row.get, row.step = calls.instance, calls.set, calls.get, calls.step
        row.input_references, row.output_references = map(ctypes.addressof, (calls.inputs, calls.outputs))
        row.sources, row.factor, row.offset = sources.ctypes.data, factor.ctypes.data, offset.ctypes.data
        row.environment = calls.environment
        row.event, row.terminate, row.early, row.reached = calls.answers
        row.first_input, row.inputs = member.inputs.start, len(member.input_values)
        row.first_output, row.outputs, row.direct = member.outputs.start, len(member.output_values), calls.direct
        row.fmi, row.final = calls.fmi, calls.final
        row.scaled, row.fed_back, row.inputs_set = member.scaled, member.fed_back, member.inputs_set
