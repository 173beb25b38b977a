"""The members of an assembly as the library in C (native_steps.c) has them: over the library functions of the FMUs
themselves. Every one is an FMU of FMI 2 or 3 co-simulation in this process that exchanges double-precision numbers and
takes every step at once."""

from __future__ import annotations

import ctypes
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Self

from ..fmu.fmi_instance import READING, SETTING, FmiInstance, NativeCalls
from ..shipped import library
from .layout import Place
from .native_libraries import source_digest

if TYPE_CHECKING:
    from .assembly import Assembly, Member

NAME = "native_steps"
FINISHED, PAUSED, SETTING_INPUTS, STEPPING, READING_OUTPUTS, NOT_FINITE = range(6)  # what its functions return

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
def loaded() -> Any:
    """The library; None where it is not built for this platform, or from another source."""
    path = library(NAME)
    try:
        found = ctypes.CDLL(str(path)) if path is not None else None
        if found is None or ctypes.c_char_p.in_dll(found, "source").value != source_digest(NAME).encode():
            return None
    except (OSError, ValueError):
        return None
    return found


class NativeMembers:
    """Valid until an instance is reset.

    run  what the functions of the library take; its bus and members are set
    """

    def __init__(self, assembly: Assembly, calls: list[NativeCalls]) -> None:
        self._members, self._calls = assembly.members, calls
        self._table = (_Member * len(calls))(*map(_row, assembly.members, calls))
        self.run = _Run(
            bus=assembly.bus.ctypes.data,
            members=ctypes.addressof(self._table),
            slots=assembly.zero,
            count=len(calls),
        )

    @classmethod
    def of(cls, assembly: Assembly) -> Self | None:
        """Of an assembly whose instances have been reset; None where a member needs Python."""
        if loaded() is None:
            return None
        found = []
        for member in assembly.members:
            calls = member.instance.native_calls() if isinstance(member.instance, FmiInstance) else None
            if calls is None:
                return None
            found.append(calls)
        return cls(assembly, found)

    def exchange(self) -> None:
        """All take their inputs and give their outputs, in their order; then inputs stand on the bus as the outputs now
        feed them. Raises SimulationError."""
        self.refresh()
        try:
            outcome = loaded().exchange_values(ctypes.byref(self.run))
        finally:
            self.count_warnings()
        if outcome != FINISHED:
            self.check(outcome)

    def refresh(self) -> None:
        """Takes over what changed of the members: which slots feed them, and what they need at a step."""
        for row, member in zip(self._table, self._members, strict=True):
            row.sources = _addresses(member.place)[0][id(member.sources)]
            row.fed_back, row.inputs_set = member.fed_back, member.inputs_set

    def count_warnings(self) -> None:
        for row, member in zip(self._table, self._members, strict=True):
            if row.warnings:
                instance: Any = member.instance
                instance.log.warned(row.warnings)
                row.warnings = 0

    @property
    def here(self) -> Member:
        """Where the library stands."""
        found: Member = self._members[self.run.member]
        return found

    def check(self, outcome: int) -> None:
        """A call for values that was not answered by ok or warning: raises SimulationError as the instance does."""
        instance: Any = self.here.instance
        instance.check(self.run.status, SETTING if outcome == SETTING_INPUTS else READING)


@lru_cache(maxsize=64)
def _addresses(place: Place) -> tuple[dict[int, int], int, int]:
    """Of the slots that may feed a member by their `id`, of `factor` and of `offset`."""
    several = (place.connected, place.unconnected, place.resting)
    slots = {id(array): array.ctypes.data for array in several if array is not None}
    return slots, place.factor.ctypes.data, place.offset.ctypes.data


def _row(member: Member, calls: NativeCalls) -> _Member:
    _, factor, offset = _addresses(member.place)
    inputs, outputs = member.inputs, member.outputs
    return _Member(
        *(calls.instance, calls.set, calls.get, calls.step),
        *(ctypes.addressof(calls.inputs), ctypes.addressof(calls.outputs)),
        *(None, factor, offset, calls.environment),
        *calls.answers,
        *(inputs.start, inputs.stop - inputs.start, outputs.start, outputs.stop - outputs.start, calls.direct),
        *(calls.fmi, member.scaled, False, calls.final),
    )
