"""Hands the trials of a study to a backend and takes what comes back to the ledger. This thread alone writes there.

A window of batches slides over the trials, so that the memory needed does not grow with their number. The first batches
are single trials; when the time of one is known, a batch holds as many as the backend likes."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from itertools import islice
from time import monotonic

import numpy as np

from .. import signals
from ..errors import SimulationError
from ..process import round_up
from ..uq.distributions import Array
from .backends.backend import Backend, Job
from .ledger import Ledger, Row
from .progress import Progress
from .trajectories import Trajectories

COMMIT = 0.25  # s between commits
WINDOW = 3  # batches per worker under way or waiting for it
LARGEST = 2000  # trials in a batch
HANGS = 3  # trials in a row, after which a study ends
Blocks = Iterable[tuple[np.ndarray, Array]]  # numbers (n,) and inputs (n, d)


class Dispatch:
    """`close` may be called at any moment, from the thread that made it. `max_failed` is the share of failed trials
    that is accepted."""

    def __init__(
        self,
        ledger: Ledger,
        backend: Backend,
        max_failed: float = 1.0,
        progress: Progress | None = None,
        trajectories: Trajectories | None = None,
        suspects: Sequence[str] = (),
    ) -> None:
        """`suspects`: the components that are not this program's own."""
        self.ledger, self.backend, self.max_failed, self.progress = ledger, backend, max_failed, progress
        self.trajectories = trajectories or Trajectories(None)
        self._suspect = suspects[0] if len(suspects) == 1 else "an FMU"

    def finish(self, blocks: Blocks, total: int, most: int | None = None) -> None:
        """Runs those of `total` trials that the ledger lacks; `most` that may follow in all, of which the share of
        failed trials counts. Raises SimulationError when too many failed, or HANGS of them that are neighbours overran
        their limit."""
        known, bad = self.ledger.finished()
        finished, failed, allowed = 0, 0, max(self.max_failed * (most or total), 0.0)
        hangs = _Hangs()

        def todo() -> Iterator[Job]:
            nonlocal finished, failed
            for numbers, x in blocks:
                old = np.isin(numbers, known)
                finished, failed = finished + int(old.sum()), failed + int(np.isin(numbers[old], known[bad]).sum())
                for k in np.flatnonzero(~old):
                    hangs.begins(int(numbers[k]))
                    yield Job(int(numbers[k]), x[k], self.trajectories.wants(int(numbers[k])))

        said: tuple[int, int] | None = None

        def say(finished: int, failed: int, seconds: float) -> None:
            nonlocal said
            if self.progress and said != (finished, failed):
                said = finished, failed
                self.progress(finished, total, failed, seconds)

        began = committed = monotonic()
        at_once = len(known) if len(known) <= total else 0
        say(at_once, int(bad.sum()) if at_once else 0, 0.0)
        for row in self._rows(todo(), total):
            self.trajectories.keep(row.trial, row.outcome)
            self.ledger.add(row)
            finished, failed = finished + 1, failed + (row.outcome.status != "completed")
            if monotonic() - committed > COMMIT:
                self.ledger.commit()
                committed = monotonic()
                say(finished, failed, committed - began)
            if hung := hangs.ended(row):
                raise self._hung(hung, row)
            if failed > allowed and failed > 1:
                raise self._too_many(failed, finished, row)
        self.ledger.commit()
        say(finished, failed, monotonic() - began)
        if failed > allowed:
            raise self._too_many(failed, finished, None)

    def repeat(self, numbers: Iterable[int]) -> list[int]:
        """Runs finished trials once more for their trajectories; the numbers of those that gave other metrics than the
        ledger has."""
        rows = [row for row in map(self.ledger.row, numbers) if row is not None]
        jobs = (Job(row.trial, row.inputs, True) for row in rows)
        before, changed = {row.trial: row.outcome for row in rows}, []
        for row in self._rows(jobs, len(rows)):
            self.trajectories.keep(row.trial, row.outcome)
            if row.outcome.metrics != before[row.trial].metrics:
                changed.append(row.trial)
        return sorted(changed)

    def close(self) -> None:
        """Ends what runs, keeps what is finished; signals wait meanwhile."""
        with signals.held():
            for row in self.backend.close():
                if self.ledger.row(row.trial) is None:
                    self.ledger.add(row)
            self.ledger.commit()

    def _rows(self, jobs: Iterator[Job], total: int) -> Iterator[Row]:
        backend, under_way, finished, seconds, size = self.backend, 0, 0, 0.0, 1
        while True:
            while under_way < WINDOW * size * backend.workers() and (batch := list(islice(jobs, size))):
                backend.send(batch)
                under_way += len(batch)
            if not under_way:
                return
            for row in backend.receive():
                under_way -= 1
                finished, seconds = finished + 1, seconds + row.outcome.wall
                yield row
            if backend.batch and finished:
                share = max(
                    1, (total - finished - under_way) // (2 * backend.workers())
                )  # towards the end all finish at the same time
                size = min(max(1, math.floor(backend.batch / max(seconds / finished, 1e-6))), share, LARGEST)

    def _hung(self, trials: Sequence[int], row: Row) -> SimulationError:
        self.ledger.commit()
        numbers = ", ".join(map(str, trials[:-1]))
        return SimulationError(
            f"{self._suspect} hung three times in a row: trials {numbers} and {trials[-1]} each came to no end within "
            f"{row.outcome.wall:g} s; what was finished is kept; if it is slow and not stuck, continue with --resume "
            f'--trial-limit "{round_up(5 * row.outcome.wall):g} s"'
        )

    def _too_many(self, failed: int, finished: int, row: Row | None) -> SimulationError:
        self.ledger.commit()
        last = row if row and row.outcome.status != "completed" else next(self.ledger.failed(), None)
        example = f"; trial {last.trial} {last.outcome.status}: {last.outcome.message}" if last else ""
        return SimulationError(
            f"{failed} of {finished} trials failed, more than --max-failed {100 * self.max_failed:g} % allows{example}"
        )


class _Hangs:
    """Trials that overran their limit, by their places in the order in which trials begin: whether some in a row did
    depends on that order, not on the one in which they end."""

    def __init__(self) -> None:
        self._next = 0
        self._place: dict[int, int] = {}  # of the trials under way
        self._hung: dict[int, int] = {}  # {place: trial}

    def begins(self, trial: int) -> None:
        self._place[trial] = self._next
        self._next += 1

    def ended(self, row: Row) -> list[int]:
        """The HANGS neighbours that overran, this one among them; none as long as there are fewer."""
        place = self._place.pop(row.trial)
        if row.outcome.status != "timeout":
            return []
        self._hung[place] = row.trial
        for first in range(place - HANGS + 1, place + 1):
            if all(k in self._hung for k in range(first, first + HANGS)):
                return [self._hung[k] for k in range(first, first + HANGS)]
        return []
