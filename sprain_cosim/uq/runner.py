"""Runs a study: the rows of its sample, or the points its search asks for, on worker processes; every finished trial goes to the ledger.

Failure policy: a trial that fails, crashes or overruns its time is a row with its status, never dropped. A study with more failures than
allowed stops and says so. An interrupt ends the workers, commits what is finished and leaves a folder that `resume` continues; trials that
are in the ledger are not run again. The tables do not depend on the number of workers, nor on the order in which trials end.
"""

from __future__ import annotations

import json
import os
import platform
import queue
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import monotonic, perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import __version__
from ..component import Component
from ..errors import EnvironmentProblem, InputError, SimulationError, nearest
from ..isolation import Limits, Outcome, Stopped, Worker
from . import reliability
from .distributions import Array
from .ledger import FILE, Ledger, Row
from .study import SEARCHES, Study
from .summary import summarise

if TYPE_CHECKING:
    import pandas as pd

COMMIT = 0.25  # s between commits
Progress = Callable[[int, int, int, float], None]  # finished, of, failed, seconds


@dataclass(frozen=True)
class Campaign:
    """A finished study: `trials` one row each, `timing` what depends on the machine, `summary` as in summary.json; `out` its folder or None."""

    study: Study
    trials: pd.DataFrame
    timing: pd.DataFrame
    summary: dict[str, Any]
    out: Path | None


def run(
    study: Study,
    *,
    out: Path | str | None = None,
    workers: int | None = None,
    resume: bool = False,
    max_failed: float = 0.01,
    limits: Limits | None = None,
    progress: Progress | None = None,
) -> Campaign:
    """Runs what the ledger in `out` lacks (out None: nothing is kept). `max_failed` share of failed trials that is accepted.

    Raises InputError before any trial, SimulationError when too many failed or a search met a failed trial."""
    study.checked()
    folder = None if out is None else Path(out)
    if folder is not None:
        _check(folder, resume)
    began = perf_counter()
    with Ledger(folder, study.digest, study.identity) as ledger:
        if folder is not None:
            _write(folder / "study.toml", study.text)
            _write(folder / "manifest.json", json.dumps(manifest(study), indent=2) + "\n")
        pool = _Pool(study, ledger, workers or os.cpu_count() or 1, limits or Limits(), max_failed, progress)
        found = None
        try:
            if study.method in SEARCHES:
                found = _search(study, pool)
            else:
                x = study.sample()
                pool.finish(x, study.numbers or range(len(x)))
        finally:
            pool.close()
            ledger.commit()
        rows = [row for row in ledger.rows() if found is not None or row.trial in pool.wanted]
    trials, timing = _tables(study, rows)
    summary = summarise(study, trials, found)
    summary["wall_s"] = round(perf_counter() - began, 3)
    if folder is not None:
        _write(folder / "trials.csv", trials.to_csv(index=False, lineterminator="\n"))
        _write(folder / "timing.csv", timing.to_csv(index=False, lineterminator="\n"))
        _write(folder / "summary.json", json.dumps(summary, indent=2, allow_nan=False) + "\n")
    return Campaign(study, trials, timing, summary, folder)


def manifest(study: Study) -> dict[str, Any]:
    """With what the study was run: versions, FMU hashes, seed, platform, identity."""
    import scipy

    return {
        "sprain_cosim": __version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "platform": platform.platform(),
        "seed": study.seed,
        "trials": study.trials,
        "fmus": {n: {"file": p.name, "sha256": Component.read(n, p).sha256} for n, p in study.scenario.fmus.items()},
        "digest": study.digest,
        "identity": study.identity,
    }


def _check(folder: Path, resume: bool) -> None:
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: is a file; name a folder with --out")
    if (folder / FILE).exists() and not resume:
        raise InputError(f"{folder}: holds a study already; continue it with --resume, or name a new folder with --out")
    if folder.is_dir() and not (folder / FILE).exists() and any(p.name != ".lock" for p in folder.iterdir()):
        raise InputError(f"{folder}: holds other files; name a new folder with --out")


class _Pool:
    """Worker processes, one thread each to drive them; this thread alone writes the ledger."""

    def __init__(self, study: Study, ledger: Ledger, count: int, limits: Limits, max_failed: float, progress: Progress | None) -> None:
        self.study, self.ledger, self.limits, self.max_failed, self.progress = study, ledger, limits, max_failed, progress
        self.count = count
        self.wanted: set[int] = set()
        self.workers: list[Worker] = []
        self._jobs: queue.SimpleQueue[tuple[int, Array] | None] = queue.SimpleQueue()
        self._done: queue.SimpleQueue[tuple[Row | None, BaseException | None]] = queue.SimpleQueue()
        self._threads: list[threading.Thread] = []

    def finish(self, x: Array, numbers: Sequence[int]) -> None:
        """Runs the rows of `x` (n, d) that the ledger lacks. Raises SimulationError when too many failed."""
        self.wanted |= set(numbers)
        known = self.ledger.finished()
        todo = [(n, x[i]) for i, n in enumerate(numbers) if n not in known]
        failed = sum(known[n] != "completed" for n in numbers if n in known)
        allowed = max(self.max_failed * len(numbers), 0.0)
        finished, began, committed = len(numbers) - len(todo), monotonic(), monotonic()
        for job in todo:
            self._jobs.put(job)
        while len(self.workers) < min(self.count, len(todo)):
            self._hire()
        if self.progress:
            self.progress(finished, len(numbers), failed, 0.0)
        left = len(todo)
        while left:
            row, problem = self._done.get()
            if problem is not None:
                raise problem
            assert row is not None
            left -= 1
            self.ledger.add(row)
            finished, failed = finished + 1, failed + (row.outcome.status != "completed")
            if monotonic() - committed > COMMIT or not left:
                self.ledger.commit()
                committed = monotonic()
                if self.progress:
                    self.progress(finished, len(numbers), failed, monotonic() - began)
            if failed > allowed and failed > 1:
                raise self._too_many(failed, finished, row)
        if failed > allowed:
            raise self._too_many(failed, finished, None)

    def values(self, x: Array, first: int) -> list[Row]:
        """Rows number first, first + 1, ... for the points of a search."""
        self.finish(x, range(first, first + len(x)))
        rows = [self.ledger.row(first + i) for i in range(len(x))]
        return [row for row in rows if row is not None]

    def close(self) -> None:
        for worker in self.workers:
            worker.kill()
        for _ in self._threads:
            self._jobs.put(None)
        for thread in self._threads:
            thread.join(5.0)
        while not self._done.empty():  # what ended meanwhile is finished work
            row, _ = self._done.get()
            if row is not None:
                self.ledger.add(row)

    def _too_many(self, failed: int, finished: int, row: Row | None) -> SimulationError:
        self.ledger.commit()
        last = row or next((r for r in self.ledger.rows() if r.outcome.status != "completed"), None)
        example = f"; trial {last.trial} {last.outcome.status}: {last.outcome.message}" if last and last.outcome.status != "completed" else ""
        return SimulationError(f"{failed} of {finished} trials failed, more than --max-failed {100 * self.max_failed:g} % allows{example}")

    def _hire(self) -> None:
        worker = Worker(self.study.scenario, self.study.names, self.limits)
        label = str(len(self.workers))
        self.workers.append(worker)
        thread = threading.Thread(target=self._work, args=(worker, label), daemon=True)
        self._threads.append(thread)
        thread.start()

    def _work(self, worker: Worker, label: str) -> None:
        try:
            while (job := self._jobs.get()) is not None:
                number, values = job
                self._done.put((Row(number, np.asarray(values, float), worker.run(list(values)), label), None))
        except Stopped:
            pass
        except BaseException as problem:  # the writer's thread raises it
            self._done.put((None, problem))


def _search(study: Study, pool: _Pool) -> Any:
    response, count = study.responses[0], 0

    def function(x: Array) -> Array:
        nonlocal count
        rows = pool.values(np.atleast_2d(x), count)
        count += len(rows)
        for row, point in zip(rows, np.atleast_2d(x), strict=True):
            if not np.array_equal(row.inputs, point):
                raise InputError("the ledger holds other points than this search asks for; name a new folder with --out")
        return np.array([_response(row.outcome, response, row.trial) for row in rows])

    marginals, correlation = tuple(study.marginals.values()), study.correlation
    if study.method == "form":
        assert study.threshold is not None
        return reliability.form(lambda x: -function(x), marginals, -study.threshold, correlation=correlation)  # the event is exceedance
    if study.method == "mean-value":
        return reliability.mean_value(function, marginals, levels=study.levels, step=study.step, difference=study.difference, correlation=correlation)
    method = {"amv": reliability.amv, "amv+": reliability.amv_plus, "hmv": reliability.hmv}[study.method]
    return method(
        function, marginals, levels=study.levels, space=study.space, step=study.step, difference=study.difference, correlation=correlation
    )  # fmt: skip


def _response(outcome: Outcome, name: str, trial: int) -> float:
    if outcome.status != "completed":
        raise SimulationError(f"trial {trial} of the search {outcome.status}: {outcome.message}; a search needs all its points")
    if name not in outcome.metrics:
        raise InputError(f"response {name!r}: no such metric{nearest(name, outcome.metrics)}")
    return outcome.metrics[name]


def _tables(study: Study, rows: Sequence[Row]) -> tuple[pd.DataFrame, pd.DataFrame]:
    import pandas as pd

    keys: dict[str, None] = {}
    for row in rows:
        keys.update(dict.fromkeys(row.outcome.metrics))
    columns: dict[str, Any] = {
        "trial": [r.trial for r in rows],
        "status": [r.outcome.status for r in rows],
        "message": [r.outcome.message for r in rows],
    }
    for k, heading in enumerate(study.headings):
        columns[heading] = [float(r.inputs[k]) for r in rows]
    for key in keys:
        columns[key] = [r.outcome.metrics.get(key, np.nan) for r in rows]
    timing = {
        "trial": columns["trial"],
        "wall_s": [r.outcome.wall for r in rows],
        "worker": [r.worker for r in rows],
        "attempts": [r.outcome.attempts for r in rows],
    }
    return pd.DataFrame(columns), pd.DataFrame(timing)


def _write(path: Path, text: str) -> None:
    try:
        partial = path.with_name(f".{path.name}")
        partial.write_text(text, "utf-8")
        os.replace(partial, path)
    except OSError as problem:
        raise EnvironmentProblem(f"{path}: cannot be written: {problem.strerror or problem}; the ledger is valid, continue with --resume") from None


def replay(folder: Path, study: Study, trial: int) -> tuple[Row, Mapping[str, float]]:
    """A trial of a finished study once more, in this process: its row and the values it ran with."""
    with Ledger(folder, study.digest, study.identity) as ledger:
        row = ledger.row(trial)
    if row is None:
        raise InputError(f"{folder}: has no trial {trial}")
    return row, dict(zip(study.names, row.inputs.tolist(), strict=True))
