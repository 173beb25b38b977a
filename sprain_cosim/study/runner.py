"""Runs a study: the rows of its sample, or the points its search asks for, on worker processes; every finished trial
goes to the ledger.

Failure policy: a trial that fails, crashes or overruns its time is a row with its status, never dropped. A study with
more failures than allowed stops and says so. An interrupt ends the workers, commits what is finished and leaves a
folder that `resume` continues; trials that are in the ledger are not run again. The tables do not depend on the number
of workers, the backend, nor on the order in which trials end."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import EnvironmentProblem, InputError
from ..process import Limits, prepare_copies
from ..scenario import Scenario
from . import originals
from .adoption import adopt, version_before
from .backends.backend import Task
from .backends.choice import open_backend
from .campaign import Campaign, Tables, at_hand
from .codec import encode
from .dispatch import Dispatch
from .evaluation import summarise
from .folder import (
    begin_folder,
    check_study_folder,
    finish_folder,
    missing,
    trial_messages,
    trial_tables,
    write_failures,
)
from .ledger import FILE as LEDGER
from .ledger import Ledger
from .looks import land_until_known
from .manifest import Manifest, level_then, read_manifest, software
from .methods import SEARCHES
from .plan import Plan
from .progress import Progress
from .seal import seal, sealed
from .search import run_search
from .shards import Shard, trial_blocks, trial_numbers
from .summary import Kept, StudySummary, read_summary
from .trajectories import ALL, FIRST, Trajectories, roles_of

if TYPE_CHECKING:
    import pandas as pd

Numbers = NDArray[np.int64] | None  # of the trials that are asked for; None: a search finds them


def run(
    study: Plan,
    *,
    out: Path | str | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    shard: Shard | None = None,
    rows: int | None = None,
    resume: bool = False,
    max_failed: float = 0.01,
    limits: Limits | None = None,
    progress: Progress | None = None,
    trajectories: int = FIRST,
    parquet: bool = False,
    command: str = "",
    level: str = "",
) -> Campaign:
    """Runs what the ledger in `out` lacks of `study`; the options are those of `Study.run`.

    limits  of a trial and of its process; a limit of wall time that they leave open is the study's own
    level   of the processor, whose code the FMUs of the project run (processor.py); empty: that with which the folder
            was begun, where it runs here, else the lowest of the workers

    Raises InputError before any trial, SimulationError when too many failed or a search met a failed trial."""
    prepare_copies()
    study.checked()
    limits = _stated(study, limits)
    folder = None if out is None else Path(out)
    _check_options(study, folder, resume, shard, parquet)
    study, kept = _never_smaller(study, folder, resume)
    began = perf_counter()
    held = replace(study, scenario=originals.with_kept_files(_begun(study.scenario, folder if resume else None)))
    first = ALL if study.method in SEARCHES and study.method not in ("sobol-indices", "design") else trajectories
    numbers = None if study.method in SEARCHES else trial_numbers(study, shard, rows)
    ledger: Ledger | None = None
    notes: tuple[str, ...] = ()
    try:
        request = _request(study, numbers, shard, first, parquet)
        if folder is not None and (folder / LEDGER).exists():
            ledger, notes = _reopened(study, held, folder, request, numbers, limits)
            if ledger is None and (done := _done(study, folder, numbers, max_failed, progress)) is not None:
                return replace(done, warnings=(*kept, *done.warnings))
        backend = open_backend(
            Task(held.scenario, study.names, limits, level or level_then(folder)), workers, scheduler
        )  # before the folder: a wrong address leaves none
        try:
            ledger = ledger or _ledger(study, held, folder)
            notes = (*kept, *notes, *_other_machine(folder, backend.level))
            suspects = study.scenario.foreign()
            dispatch = Dispatch(ledger, backend, max_failed, progress, Trajectories(folder, first), suspects)
        except BaseException:
            backend.close()
            raise
        tables, summary, recorded = _finished(study, held, dispatch, folder, numbers, shard, rows, command)
        summary = replace(summary, wall_s=round(perf_counter() - began, 3))
        if folder is not None:
            finish_folder(folder, *tables, summary, parquet)
            seal(folder, ledger, request, recorded)
        warnings = (*notes, *_mended(ledger), *originals.changed_files(study.scenario, held.scenario))
        return Campaign(study, summary, folder, at_hand(tables), warnings)
    except KeyboardInterrupt as stop:
        if folder is not None:
            stop.add_note(f"what is finished is kept in {folder}; the same call with resume=True continues")
        raise
    finally:
        if ledger is not None:
            ledger.close()


def _stated(study: Plan, limits: Limits | None) -> Limits:
    limits = limits or Limits()
    return replace(limits, trial=study.trial_limit) if limits.trial is None else limits


def _never_smaller(study: Plan, folder: Path | None, resume: bool) -> tuple[Plan, tuple[str, ...]]:
    """The study with as many trials as its folder holds, and the warning that says so: a smaller number would leave
    finished trials out of the tables. Only methods whose rows do not depend on the number of trials."""
    if folder is None or not resume or study.method not in ("monte-carlo", "sobol") or not (folder / LEDGER).exists():
        return study, ()
    with Ledger.read(folder) as ledger:
        numbers, _ = ledger.finished()
    held = int(numbers.max()) + 1 if len(numbers) else 0
    if study.method == "sobol":
        held = -(-held // study.sequences) * study.sequences
    if held <= study.trials:
        return study, ()
    warning = f"{folder}: holds trials up to number {held - 1}, which are kept; {study.trials} would leave some out"
    return replace(study, trials=held), (warning,)


def _check_options(study: Plan, folder: Path | None, resume: bool, shard: Shard | None, parquet: bool) -> None:
    """Raises InputError, EnvironmentProblem for what cannot be done, before anything is."""
    if shard is not None and study.method in SEARCHES:
        raise InputError(f"--shard: method {study.method} chooses each trial after those before it, so it has no parts")
    if shard is not None and study.watched:
        raise InputError("--shard: a study that stops when it knows enough has no parts; leave until out")
    if parquet and find_spec("pyarrow") is None:
        raise EnvironmentProblem('--parquet: needs pyarrow: pip install "sprain-cosim[parquet]"')
    if folder is not None:
        check_study_folder(folder, resume)


def _finished(
    study: Plan,
    held: Plan,
    dispatch: Dispatch,
    folder: Path | None,
    numbers: Numbers,
    shard: Shard | None,
    rows: int | None,
    command: str,
) -> tuple[Tables, StudySummary, list[int]]:
    """Runs what is missing; the tables, the summary, and the trials that have a trajectory. `held` is the study from
    the copies of its files."""
    ledger, recorder = dispatch.ledger, dispatch.trajectories
    found, recorded = None, list[int]()
    try:
        if folder is not None:
            begin_folder(folder, study, command, held.identity, [dispatch.backend.level])
        if numbers is None:
            found = run_search(study, dispatch)
        elif study.watched and rows is None:
            numbers = land_until_known(study, dispatch, numbers)
        else:
            dispatch.finish(trial_blocks(study, shard, rows), len(numbers))
        tables = table, _ = trial_tables(study, ledger, numbers)
        summary = replace(summarise(held, table, found), fmu_messages=trial_messages(ledger, numbers))
        if folder is not None:
            kept = roles_of(study, table, found)
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
    if shard is not None or rows is not None:
        summary = replace(summary, shard=shard, n_requested=len(table))
    return tables, summary, sorted({*recorded} - {*recorder.lacks(recorded)})


def _other_machine(folder: Path | None, level: str) -> Iterator[str]:
    """The warnings that a study goes on with code for another level of processors than it was begun with, or with other
    software."""
    try:
        before = read_manifest(folder) if folder is not None else Manifest()
    except InputError:
        return
    if before.processor and level and level not in before.processor:
        yield (
            f"{folder}: its trials so far ran code for {', '.join(before.processor)} processors, those that follow "
            f"code for {level}: they may differ in the last digits"
        )
    here, own = Manifest.here(), "sprain-cosim"  # of which another version is told when its trials are adopted
    if before.versions.get(own) == here.versions[own] and (lines := software(before, here)):
        yield (
            f"{folder}: its trials so far ran with other software than those that follow, so they may differ in the "
            f"last digits: {'; '.join(lines)}"
        )


def _begun(scenario: Scenario, folder: Path | None) -> Scenario:
    """The scenario that a folder is to be continued with."""
    if folder is None or not (folder / LEDGER).exists():
        return scenario
    try:
        with Ledger.read(folder) as ledger:
            return originals.as_begun(scenario, ledger.said("identity"))
    except InputError:  # damaged: who opens it to write mends it
        return scenario


def _ledger(study: Plan, held: Plan, folder: Path | None) -> Ledger:
    return Ledger(folder, held.digest, held.identity, json.dumps(encode(study)))


def _request(study: Plan, numbers: Numbers, shard: Shard | None, first: int, parquet: bool) -> dict[str, Any]:
    """All that the exports of a folder depend on besides the rows."""
    return {
        "study": hashlib.sha256(json.dumps(encode(study)).encode()).hexdigest(),
        "trials": None if numbers is None else len(numbers),
        "shard": shard,
        "first": first,
        "parquet": parquet,
    }


def _reopened(
    study: Plan,
    held: Plan,
    folder: Path,
    request: Mapping[str, Any],
    numbers: Numbers,
    limits: Limits,
) -> tuple[Ledger | None, tuple[str, ...]]:
    """The ledger of a folder that is to be continued, and warnings; None for a folder that lacks nothing. Trials that a
    shorter limit than the one that is stated has ended are to run again."""
    version = version_before(study, held, folder)
    if version is not None and _complete(folder, numbers):
        return None, ()
    notes = () if version is None else (adopt(study, held, folder, version, limits),)
    ledger = _ledger(study, held, folder)
    if limits.trial is not None and (late := ledger.forget_timeouts(limits.trial)):
        shorter = f"{folder}: trials {missing(late)} had been ended by a shorter limit of wall time; they run again"
        return ledger, (*notes, shorter)
    if sealed(folder, ledger, request):
        ledger.close()
        return None, ()
    return ledger, notes


def _complete(folder: Path, numbers: Numbers) -> bool:
    """Whether a folder has its summary, and all trials that are numbers."""
    try:
        read_summary(folder)
    except InputError:
        return False
    with Ledger.read(folder) as ledger:
        return numbers is None or bool(np.isin(numbers, ledger.finished()[0]).all())


def _done(study: Plan, folder: Path, numbers: Numbers, max_failed: float, progress: Progress | None) -> Campaign | None:
    """The campaign of a folder that lacks nothing; None where too many of its trials failed."""
    summary = read_summary(folder)
    total = summary.n_completed + summary.n_failed
    if summary.n_failed > max_failed * total:
        return None
    if progress:
        progress(total, total, summary.n_failed, 0.0)
    return Campaign(study, summary, folder, partial(_from_ledger, study, folder, numbers))


def _from_ledger(study: Plan, folder: Path, numbers: Numbers) -> Tables:
    with Ledger.read(folder) as ledger:
        return trial_tables(study, ledger, numbers)


def _mended(ledger: Ledger) -> tuple[str, ...]:
    if not ledger.mended:
        return ()
    rows = f"trials {missing(ledger.dropped)}" if ledger.dropped else "rows that cannot be named"
    return (f"{ledger.folder}: its ledger was damaged; {rows} were dropped and run again",)


def _recorded(table: pd.DataFrame, recorder: Trajectories, kept: Mapping[str, int]) -> list[int]:
    """Trials that have a record: the first, those with a role, and the failed, which have one unless their process was
    lost."""
    first = table["trial"][(table["trial"] < recorder.first) & table["status"].isin(("completed", "failed"))]
    return [*first, *kept.values(), *table["trial"][table["status"] == "failed"]]
