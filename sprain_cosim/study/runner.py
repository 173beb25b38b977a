"""Runs a study: the rows of its sample, or the points its search asks for, on worker processes; every finished trial
goes to the ledger.

Failure policy: a trial that fails, crashes or overruns its time is a row with its status, never dropped. A study with
more failures than allowed stops and says so. An interrupt ends the workers, commits what is finished and leaves a
folder that `resume` continues; trials that are in the ledger are not run again. The tables do not depend on the number
of workers, the backend, nor on the order in which trials end."""

from __future__ import annotations

import gzip
import hashlib
import io
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from importlib.util import find_spec
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np

from ..cosim.result import Result
from ..errors import EnvironmentProblem, InputError, SimulationError, nearest
from ..process import Limits
from ..uq.distributions import Array
from . import originals
from .adoption import adopt, version_before
from .backends.backend import Task
from .backends.choice import open_backend
from .codec import encode
from .dispatch import Dispatch, Progress
from .evaluation import summarise
from .folder import (
    begin_folder,
    check_study_folder,
    finish_folder,
    load_study_plan,
    missing,
    trial_tables,
    write_failures,
)
from .identity import changes
from .ledger import FILE as LEDGER
from .ledger import Ledger, Row
from .plan import SEARCHES, Plan
from .seal import seal, sealed
from .summary import Kept, StudySummary, read_summary
from .trajectories import FIRST, Trajectories, roles
from .worker import Outcome, Worker

if TYPE_CHECKING:
    import pandas as pd

ALL = 1 << 62  # trajectories
Tables = tuple["pd.DataFrame", "pd.DataFrame"]  # trials, timing


@dataclass(frozen=True)
class Campaign:
    """A finished study.

    study     what was run
    summary   as in summary.json
    out       its folder, or None
    load      gives both tables, when they are first asked for
    warnings  one line each, about this run of it
    """

    study: Plan
    summary: StudySummary
    out: Path | None
    load: Callable[[], Tables]
    warnings: tuple[str, ...] = ()

    @cached_property
    def _tables(self) -> Tables:
        return self.load()

    @property
    def trials(self) -> pd.DataFrame:
        """One row for each trial, the columns of trials.csv."""
        return self._tables[0]

    @property
    def timing(self) -> pd.DataFrame:
        """One row for each trial: what depends on the machine, the columns of timing.csv."""
        return self._tables[1]


def run(
    study: Plan,
    *,
    out: Path | str | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    shard: tuple[int, int] | None = None,
    resume: bool = False,
    max_failed: float = 0.01,
    limits: Limits | None = None,
    progress: Progress | None = None,
    trajectories: int = FIRST,
    parquet: bool = False,
    command: str = "",
) -> Campaign:
    """Runs what the ledger in `out` lacks (out None: nothing is kept). `max_failed` share of failed trials that is
    accepted; `scheduler` the address of a Dask scheduler or local-cluster; `shard` (k, n) the k-th of n parts, from 1;
    `trajectories` how many trials from the first on are recorded besides the percentile, extreme, failed and search
    trials; `command` what the manifest says was typed.

    Raises InputError before any trial, SimulationError when too many failed or a search met a failed trial."""
    study.checked()
    folder = None if out is None else Path(out)
    _check_options(study, folder, resume, shard, parquet)
    began = perf_counter()
    held = replace(study, scenario=originals.kept(study.scenario))
    first = ALL if study.method in SEARCHES and study.method != "sobol-indices" else trajectories
    wanted = None if study.method in SEARCHES else _numbers(study, shard)
    ledger: Ledger | None = None
    adopted = ""
    try:
        request = _request(study, wanted, shard, first, parquet)
        if folder is not None and (folder / LEDGER).exists():
            ledger, adopted = _reopened(study, held, folder, request, wanted, limits)
            if ledger is None and (done := _done(study, folder, wanted, max_failed, progress)) is not None:
                return done
        backend = open_backend(
            Task(held.scenario, study.names, limits or Limits()), workers, scheduler
        )  # before the folder: a wrong address leaves none
        try:
            ledger = ledger or _ledger(study, held, folder)
            dispatch = Dispatch(ledger, backend, max_failed, progress, Trajectories(folder, first))
        except BaseException:
            backend.close()
            raise
        tables, summary, recorded = _finished(study, held, dispatch, folder, wanted, shard, command)
        summary = replace(summary, wall_s=round(perf_counter() - began, 3))
        if folder is not None:
            finish_folder(folder, *tables, summary, parquet)
            seal(folder, ledger, request, recorded)
        notes = (adopted,) if adopted else ()
        warnings = (*notes, *_mended(ledger), *originals.changes(study.scenario, held.scenario))
        return Campaign(study, summary, folder, partial(_given, tables), warnings)
    finally:
        if ledger is not None:
            ledger.close()


def _check_options(
    study: Plan, folder: Path | None, resume: bool, shard: tuple[int, int] | None, parquet: bool
) -> None:
    """Raises InputError, EnvironmentProblem for what cannot be done, before anything is."""
    if shard is not None and study.method in SEARCHES:
        raise InputError(f"--shard: method {study.method} chooses each trial after those before it, so it has no parts")
    if parquet and find_spec("pyarrow") is None:
        raise EnvironmentProblem("--parquet: needs pyarrow: pip install 'sprain-cosim[parquet]'")
    if folder is not None:
        check_study_folder(folder, resume)


def _finished(
    study: Plan,
    held: Plan,
    dispatch: Dispatch,
    folder: Path | None,
    wanted: np.ndarray | None,
    shard: tuple[int, int] | None,
    command: str,
) -> tuple[Tables, StudySummary, list[int]]:
    """Runs what is missing; the tables, the summary, and the trials that have a trajectory. `held` is the study from
    the copies of its files."""
    ledger, recorder = dispatch.ledger, dispatch.trajectories
    found, recorded = None, list[int]()
    try:
        if folder is not None:
            begin_folder(folder, study, command, held.identity)
        if wanted is None:
            found = _search(study, dispatch)
        else:
            dispatch.finish(_part(study, shard), len(wanted))
        tables = table, _ = trial_tables(study, ledger, wanted)
        summary = summarise(held, table, found)
        if folder is not None:
            kept = _roles(study, table, found)
            recorded = _recorded(table, recorder, kept)
            changed = dispatch.repeat(recorder.lacks(recorded))
            summary = replace(
                summary,
                trajectories=Kept(kept, int((table["trial"] < recorder.first).sum())),
                not_reproduced=tuple(changed) or None,
            )
    finally:
        dispatch.close()
        if folder is not None:
            write_failures(folder, study, ledger)
    if shard is not None:
        summary = replace(summary, shard=shard, n_requested=len(table))
    return tables, summary, sorted({*recorded} - {*recorder.lacks(recorded)})


def _ledger(study: Plan, held: Plan, folder: Path | None) -> Ledger:
    return Ledger(folder, held.digest, held.identity, json.dumps(encode(study)))


def _request(
    study: Plan, wanted: np.ndarray | None, shard: tuple[int, int] | None, first: int, parquet: bool
) -> dict[str, Any]:
    """All that the exports of a folder depend on besides the rows."""
    return {
        "study": hashlib.sha256(json.dumps(encode(study)).encode()).hexdigest(),
        "trials": None if wanted is None else len(wanted),
        "shard": shard,
        "first": first,
        "parquet": parquet,
    }


def _reopened(
    study: Plan,
    held: Plan,
    folder: Path,
    request: Mapping[str, Any],
    wanted: np.ndarray | None,
    limits: Limits | None,
) -> tuple[Ledger | None, str]:
    """The ledger of a folder that is to be continued, and a warning or ""; None for a folder that lacks nothing."""
    version = version_before(study, held, folder)
    if version is not None and _complete(folder, wanted):
        return None, ""
    warning = "" if version is None else adopt(study, held, folder, version, limits)
    ledger = _ledger(study, held, folder)
    if sealed(folder, ledger, request):
        ledger.close()
        return None, ""
    return ledger, warning


def _complete(folder: Path, wanted: np.ndarray | None) -> bool:
    """Whether a folder has its summary, and all trials that are wanted."""
    try:
        read_summary(folder)
    except InputError:
        return False
    with Ledger.read(folder) as ledger:
        return wanted is None or bool(np.isin(wanted, ledger.finished()[0]).all())


def _done(
    study: Plan, folder: Path, wanted: np.ndarray | None, max_failed: float, progress: Progress | None
) -> Campaign | None:
    """The campaign of a folder that lacks nothing; None where too many of its trials failed."""
    summary = read_summary(folder)
    total = summary.n_completed + summary.n_failed
    if summary.n_failed > max_failed * total:
        return None
    if progress:
        progress(total, total, summary.n_failed, 0.0)
    return Campaign(study, summary, folder, partial(_from_ledger, study, folder, wanted))


def _from_ledger(study: Plan, folder: Path, wanted: np.ndarray | None) -> Tables:
    with Ledger.read(folder) as ledger:
        return trial_tables(study, ledger, wanted)


def _given(tables: Tables) -> Tables:
    return tables


def _mended(ledger: Ledger) -> tuple[str, ...]:
    if not ledger.mended:
        return ()
    rows = f"trials {missing(ledger.dropped)}" if ledger.dropped else "rows that cannot be named"
    return (f"{ledger.folder}: its ledger was damaged; {rows} were dropped and run again",)


def merge(folders: Sequence[Path], out: Path | None = None, parquet: bool = False) -> Campaign:
    """One folder of the shards of a study, as if it had run in one piece; `out` None: runs/STUDY. Their trajectories
    come along.

    Raises InputError when they belong to different studies, differ in a trial, or a trial is in none of them."""
    parts = [Ledger.read(folder) for folder in folders]
    try:
        study = load_study_plan(folders[0], parts[0])
        for folder, part in zip(folders, parts, strict=True):
            if part.facts["digest"] != parts[0].facts["digest"]:
                one, other = (json.loads(ledger.facts["identity"]) for ledger in (parts[0], part))
                different = "; ".join(changes(one, other, words=("there", "here")))
                raise InputError(f"{folder}: belongs to another study than {folders[0]} ({different})")
        study = max((load_study_plan(f, p) for f, p in zip(folders, parts, strict=True)), key=lambda s: s.trials)
        wanted = _numbers(study, None)
        lost = np.setdiff1d(wanted, np.concatenate([part.finished()[0] for part in parts]))
        if len(lost):
            raise InputError(
                f"trials {missing(lost.tolist())} are in none of the folders; run their shard with "
                "--resume, or name its folder"
            )
        folder = out or Path("runs") / Path(study.source or "study").stem
        check_study_folder(folder, resume=False)
        recorder = Trajectories(folder, 0)
        facts = parts[0].facts
        with Ledger(folder, facts["digest"], json.loads(facts["identity"]), facts["study"]) as ledger:
            begin_folder(folder, study, "", json.loads(facts["identity"]))
            for source, part in zip(folders, parts, strict=True):
                for row in part.rows():
                    known = ledger.row(row.trial)
                    if known is None:
                        ledger.add(row)
                        recorder.take(source, row.trial)
                    elif _content(known) != _content(row):
                        raise InputError(f"{source}: its trial {row.trial} differs from that of another folder")
            ledger.commit()
            table, timing = trial_tables(study, ledger, wanted)
            kept = _roles(study, table, None)
            dispatch = Dispatch(ledger, open_backend(Task(study.scenario, study.names), 1, None), trajectories=recorder)
            try:
                changed = dispatch.repeat(recorder.lacks(kept.values()))
            finally:
                dispatch.close()
            write_failures(folder, study, ledger)
    finally:
        for part in parts:
            part.close()
    summary = replace(
        summarise(study, table, None),
        trajectories=Kept(kept, sum(_first_kept(f) for f in folders)),
        not_reproduced=tuple(changed) or None,
        wall_s=round(float(timing["wall_s"].sum()), 3),
        merged=tuple(str(f) for f in folders),
    )
    finish_folder(folder, table, timing, summary, parquet)
    return Campaign(study, summary, folder, partial(_given, (table, timing)))


@dataclass(frozen=True)
class Replay:
    """A trial of a study once more: what the ledger has of it, how it ended now, `same` to the bit or not."""

    study: Plan
    row: Row
    outcome: Outcome

    @property
    def same(self) -> bool:
        return (self.outcome.status, self.outcome.metrics) == (self.row.outcome.status, self.row.outcome.metrics)

    @property
    def result(self) -> Result | None:
        """The record of the repetition, with the ten digits of signals.csv; None when its process did not live to give
        one."""
        if not self.outcome.trajectory:
            return None
        record = Result.read_csv(io.BytesIO(gzip.decompress(self.outcome.trajectory)))
        return replace(record, message=self.outcome.message, wall=self.outcome.wall, **self.outcome.about)

    @property
    def settings(self) -> dict[str, str | float]:
        """{"component.parameter": value with its unit} of the inputs."""
        return {
            name: f"{value!r} {self.study.units[name]}" if self.study.units[name] else value
            for name, value in zip(self.study.names, self.row.inputs.tolist(), strict=True)
        }


def replay(folder: Path, trial: int, limits: Limits | None = None) -> Replay:
    """Runs a trial of a study's folder again, from the folder alone, in a child process. Raises InputError when there
    is no such trial, or an FMU has changed since."""
    with Ledger.read(folder) as ledger:
        study = load_study_plan(folder, ledger)
        row = ledger.row(trial)
        if row is None:
            numbers, _ = ledger.finished()
            have = f"it has {len(numbers)}, number {numbers[0]} to {numbers[-1]}" if len(numbers) else "it has none yet"
            raise InputError(f"{folder}: no trial {trial}; {have}")
    with Worker(study.scenario, study.names, limits) as worker:
        outcome = worker.run(row.inputs.tolist(), record=True)
    scenario = study.scenario
    result = Replay(study, row, outcome)
    return replace(
        result, study=replace(study, scenario=replace(scenario, parameters={**scenario.parameters, **result.settings}))
    )


def part(text: str) -> tuple[int, int]:
    """ "2/10" as (2, 10). Raises InputError."""
    k, slash, n = text.partition("/")
    if not (slash and k.isdecimal() and n.isdecimal() and 1 <= int(k) <= int(n)):
        raise InputError(f"--shard {text}: must be K/N with K from 1 to N, such as 2/10")
    return int(k), int(n)


def first_trajectories(text: str) -> int:
    """How many trials "100", "all" or "none" ask to record. Raises InputError."""
    if text not in ("all", "none") and not text.isdecimal():
        raise InputError(f"--trajectories {text}: must be a number, all or none")
    return ALL if text == "all" else 0 if text == "none" else int(text)


def _numbers(study: Plan, shard: tuple[int, int] | None) -> np.ndarray:
    """(n,) numbers of the trials, ascending as far as the study numbers them so."""
    count = int(np.prod([len(levels) for levels in study.grid.values()])) if study.method == "grid" else study.trials
    numbers = np.array(study.numbers or range(count), np.int64)
    return numbers if shard is None else numbers[numbers % shard[1] == shard[0] - 1]


def _part(study: Plan, shard: tuple[int, int] | None) -> Iterator[tuple[np.ndarray, Array]]:
    for numbers, x in study.blocks():
        mine = slice(None) if shard is None else numbers % shard[1] == shard[0] - 1
        yield numbers[mine], x[mine]


def _search(study: Plan, dispatch: Dispatch) -> Any:
    response, count = study.responses[0], 0

    def function(x: Array) -> Array:
        nonlocal count
        points = np.atleast_2d(x)
        numbers = np.arange(count, count + len(points))
        dispatch.finish([(numbers, points)], len(points))
        rows = [row for row in map(dispatch.ledger.row, numbers.tolist()) if row is not None]
        count += len(rows)
        for row, point in zip(rows, points, strict=True):
            if not np.array_equal(row.inputs, point):
                raise InputError(
                    "the ledger holds other points than this search asks for; name a new folder with --out"
                )
        return np.array([_response(row.outcome, response, row.trial) for row in rows])

    return study.search(function)


def _response(outcome: Outcome, name: str, trial: int) -> float:
    if outcome.status != "completed":
        raise SimulationError(
            f"trial {trial} of the search {outcome.status}: {outcome.message}; a search needs all its points"
        )
    if name not in outcome.metrics:
        raise InputError(f"response {name!r}: no such metric{nearest(name, outcome.metrics)}")
    return outcome.metrics[name]


def _roles(study: Plan, table: pd.DataFrame, found: Any) -> dict[str, int]:
    """{role: trial} of the first response: the percentiles and extremes of a sample, the trials of a search that gave
    its levels' values."""
    done = table[table["status"] == "completed"]
    response = study.responses[0]
    if response not in done:
        return {}
    values: Mapping[str, float] | None = None
    if found is not None:
        values = {f"p{100 * p:g}": v for p, v in getattr(found, "value", {}).items()}
    return roles(done["trial"].to_numpy(), done[response].to_numpy(float), values)


def _recorded(table: pd.DataFrame, recorder: Trajectories, kept: Mapping[str, int]) -> list[int]:
    """Trials that have a record: the first, those with a role, and the failed, which have one unless their process was
    lost."""
    first = table["trial"][(table["trial"] < recorder.first) & table["status"].isin(("completed", "failed"))]
    return [*first, *kept.values(), *table["trial"][table["status"] == "failed"]]


def _first_kept(folder: Path) -> int:
    """How many first trials of a shard have their signals; 0 for one that is not complete."""
    try:
        return read_summary(folder).first_kept
    except InputError:
        return 0


def _content(row: Row) -> tuple[Any, ...]:
    return row.inputs.tobytes(), row.outcome.status, row.outcome.message, row.outcome.metrics
