"""What a run writes down: one row for each point of the record, also where the plant passes it between two
exchanges."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..units import Unit
from .schedule import Schedule

if TYPE_CHECKING:
    from .assembly import Assembly

Values = NDArray[np.floating]


class Recorder:
    """Of one run of an assembly. A row is written again when a step is taken again.

    time    (m + 1,) [s] of the record
    names   of its columns: all connectors, then the local variables that were chosen
    units   of its columns
    passed  (n + 1, slots) the connectors at the points of exchange
    """

    def __init__(self, assembly: Assembly, schedule: Schedule, patterns: Sequence[str]) -> None:
        self._assembly, self._schedule = assembly, schedule
        self.time = schedule.record
        names, units = assembly.watch_locals(patterns) if patterns else ([], [])
        self.names: tuple[str, ...] = (*assembly.names, *names) if names else assembly.names
        self.units: tuple[Unit | None, ...] = (*assembly.units, *units) if names else assembly.units
        self._values = np.empty((len(self.time), len(assembly.names)))
        self._locals = np.empty((len(self.time), len(names)))
        self.passed = self._values if schedule.regular else np.empty((len(schedule.time), len(assembly.names)))
        self._between, self._rows = schedule.between
        self._near = schedule.near
        self._points = 0
        assembly.recorder = self if len(self._between) else None

    def write(self, point: int) -> None:
        """The values at this point of exchange; the points come in their order."""
        self._points = point + 1
        if self.passed is not self._values:
            self.passed[point] = self._assembly.record
        row = self._schedule.row[point]
        if row >= 0:
            self.write_row(row)

    @property
    def plain(self) -> bool:
        """Its rows are the connectors at the points of exchange, and nothing else."""
        return self.passed is self._values and not self._locals.shape[1] and not len(self._between)

    def reached(self, point: int) -> int:
        """The rows of `passed` have been written elsewhere up to this point."""
        self._points = point + 1
        return point

    def write_row(self, row: int) -> None:
        """The present values."""
        self._values[row] = self._assembly.record
        if self._locals.shape[1]:
            self._locals[row] = self._assembly.local_values()

    def write_at(self, time: float) -> None:
        """The present values where `time` [s] is a point of the record but not of the schedule: a divided step can end
        there."""
        k = int(np.searchsorted(self._between, time - self._near))
        if k < len(self._between) and self._between[k] <= time + self._near:
            self.write_row(int(self._rows[k]))

    def between(self, time: float, end: float) -> list[tuple[int, float]]:
        """Rows and times [s] of the record that lie between `time` and `end` and are no points of exchange."""
        low, high = np.searchsorted(self._between, (time + self._near, end - self._near))
        return list(zip(self._rows[low:high].tolist(), self._between[low:high].tolist(), strict=True))

    def values(self) -> Values:
        """(k, columns) what was recorded up to the last point that was written."""
        if not self._points:
            return np.empty((0, len(self.names)))
        last = self._schedule.time[self._points - 1]
        done = int(np.searchsorted(self.time, last + self._near))
        return np.hstack([self._values[:done], self._locals[:done]]) if self._locals.shape[1] else self._values[:done]
