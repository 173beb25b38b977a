"""The folder of a study: trials.csv, timing.csv, summary.json, study.toml, manifest.json, failures.json where trials
failed, ledger.sqlite, trajectories/. All but the ledger and the trajectories are made from the ledger."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import EnvironmentProblem, InputError
from ..files import check_folder, read_frame, sweep, whole_file, write, write_json
from ..fmu.messages import Messages
from ..machine.here import SYSTEM
from .arrays import name_and_unit
from .codec import decode
from .identity import changes
from .ledger import FILE, LOCK, RESUME, Ledger
from .manifest import FILE as MANIFEST
from .manifest import Manifest, read_manifest
from .originals import restored
from .plan import Plan
from .summary import FILE as SUMMARY
from .summary import MessagesOfTrials, StudySummary

if TYPE_CHECKING:
    import pandas as pd

FAILURES = "failures.json"
TRIALS = "trials.csv"
WORDS = ("status", "message")  # its columns that hold no numbers


def check_study_folder(folder: Path, resume: bool, resumable: bool = True) -> None:
    """Raises InputError unless the folder may take the study. `resumable`: the command has --resume."""
    check_folder(folder)
    try:
        held = {p.name for p in folder.iterdir()} if folder.is_dir() else set[str]()
    except OSError as problem:
        raise EnvironmentProblem(f"{folder}: cannot be read: {problem.strerror or problem}") from None
    if FILE in held and not resume:
        if not resumable:
            raise InputError(f"{folder}: holds a study already; name a new folder with --out")
        raise InputError(f"{folder}: holds a study already; continue it with --resume, or name a new folder with --out")
    if FILE not in held and held - {LOCK}:
        raise InputError(f"{folder}: holds other files; name a new folder with --out")


def recorded_plan(folder: Path, ledger: Ledger) -> Plan:
    """The study that a ledger was made with, whatever has become of its files. Raises InputError when the ledger does
    not say."""
    study = decode(ledger.said("study"))
    if not isinstance(study, Plan):
        raise InputError(f"{folder}: the ledger does not say what study it belongs to")
    return study


def load_study_plan(folder: Path, ledger: Ledger) -> Plan:
    """The study that a ledger was made with, from the copies of its files where those have changed. Raises InputError
    when there is no copy of a file that is gone or has changed."""
    study = recorded_plan(folder, ledger)
    study = replace(study, scenario=restored(study.scenario, ledger.said("identity")))
    for name, path in (*study.scenario.fmus.items(), *study.scenario.maps.items()):
        if not path.is_file():
            raise InputError(f"{folder}: was made with {name} = {path}, which is gone; put it back")
    different = changes(ledger.said("identity"), json.loads(json.dumps(study.identity)), ("version",))
    if different:
        raise InputError(
            f"{folder}: its study is another now ({'; '.join(different)}); put back what has changed since"
        )
    return study


def begin_folder(
    folder: Path,
    study: Plan,
    command: str,
    identity: Mapping[str, Any],
    levels: Sequence[str],
    parts: Sequence[Manifest] = (),
) -> None:
    """study.toml and manifest.json, which says what `identity` the study has and with code for which `levels` of
    processors its trials ran; `parts` are the manifests of what it is merged from."""
    sweep(folder)
    try:
        before = read_manifest(folder)
    except InputError:
        before = None
    write(folder / "study.toml", study.text, RESUME)
    write_json(folder / MANIFEST, Manifest.of(study, identity, command, before, levels, parts).to_json(), RESUME)


def trial_tables(study: Plan, ledger: Ledger, chosen: np.ndarray | None) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Trials and timing of the ledger's rows whose numbers are `chosen` (None: all), in the order of their numbers."""
    import pandas as pd

    numbers, _ = ledger.finished()
    if chosen is not None:
        numbers = numbers[np.isin(numbers, chosen)]
    kept = None if chosen is None else set(numbers.tolist())
    n, metrics = len(numbers), dict[str, np.ndarray]()
    inputs = np.empty((n, len(study.names)))
    wall, attempts = np.empty(n), np.empty(n, np.int64)
    status, message, worker = [], [], []
    k = 0
    for row in ledger.rows():
        if kept is not None and row.trial not in kept:
            continue
        o = row.outcome
        for name, value in o.metrics.items():
            if name not in metrics:
                metrics[name] = np.full(n, np.nan)
            metrics[name][k] = value
        inputs[k], wall[k], attempts[k] = row.inputs, o.wall, o.attempts
        status.append(o.status)
        message.append(o.message)
        worker.append(row.worker)
        k += 1
    columns = (
        {"trial": numbers, "status": status, "message": message}
        | dict(zip(study.headings, inputs.T, strict=True))
        | metrics
    )
    return with_units(pd.DataFrame(columns)), pd.DataFrame(
        {"trial": numbers, "wall_s": wall, "worker": worker, "attempts": attempts}
    )


def trial_messages(ledger: Ledger, chosen: np.ndarray | None) -> dict[str, MessagesOfTrials]:
    """{component: what its FMU said in the trials that are `chosen` (None: all)}."""
    found: dict[str, list[tuple[int, Messages]]] = {}
    kept = None if chosen is None else set(chosen.tolist())
    for row in ledger.with_messages():
        if kept is None or row.trial in kept:
            for name, said in row.outcome.messages.items():
                found.setdefault(name, []).append((row.trial, said))
    summed = {}
    for name, trials in found.items():
        total = Messages.sum(said for _, said in trials)
        assert total is not None
        first = next((trial for trial, said in trials if said.first == total.first and said.grave == total.grave), 0)
        summed[name] = MessagesOfTrials(len(trials), total.count, total.warnings, total.first, first, total.grave)
    return summed


def write_failures(folder: Path, study: Plan, ledger: Ledger) -> None:
    """failures.json: of each failed trial its inputs, how it ended, the last lines printed and the command that runs it
    again."""
    listed = [
        {
            "trial": row.trial,
            "status": row.outcome.status,
            "message": row.outcome.message,
            "attempts": row.outcome.attempts,
            "inputs": dict(zip(study.headings, row.inputs.tolist(), strict=True)),
            "log": row.outcome.log,
            "replay": f"sprain-cosim trial {SYSTEM.quoted(str(folder))} {row.trial}",
        }
        for row in ledger.failed()
    ]
    if listed or (folder / FAILURES).exists():
        write(folder / FAILURES, json.dumps(listed, indent=2) + "\n", RESUME)


def finish_folder(
    folder: Path, trials: pd.DataFrame, timing: pd.DataFrame, summary: StudySummary, parquet: bool
) -> None:
    """The exports; the summary is the last, so that it stands for a complete folder."""
    for table, name in ((trials, TRIALS), (timing, "timing.csv")):
        with whole_file(folder / name, RESUME) as partial:
            table.to_csv(partial, index=False, lineterminator="\n")
    if parquet:
        with whole_file(folder / "trials.parquet", RESUME) as partial:
            trials.to_parquet(partial, index=False, compression="zstd")
    write_json(folder / SUMMARY, summary.to_json(), RESUME)


def missing(numbers: Sequence[int], limit: int = 5) -> str:
    """ "3, 7, 8 and 12 more"."""
    shown = ", ".join(str(n) for n in numbers[:limit])
    return shown + (f" and {len(numbers) - limit} more" if len(numbers) > limit else "")


def read_trials(folder: Path, as_text: bool = False) -> pd.DataFrame:
    """trials.csv, one row a trial; `as_text` every cell as it is written. Raises InputError."""
    path = folder / TRIALS
    try:
        if as_text:
            return read_frame(path, dtype=str, keep_default_na=False)
        table = read_frame(path, keep_default_na=True, dtype={"status": str, "message": str})
    except FileNotFoundError:
        raise InputError(f"{folder}: no trials.csv in it; the study is not finished") from None
    for column in table.columns:
        wrong = "" if column in WORDS else _no_numbers(table[column], column == "trial")
        if wrong:
            raise InputError(f"{path}: column {column}: {wrong}")
    return with_units(table)


def with_units(trials: pd.DataFrame) -> pd.DataFrame:
    """The same table, whose `attrs["units"]` has the unit of each column that has one."""
    found = {str(column): name_and_unit(str(column))[1] for column in trials.columns}
    trials.attrs["units"] = {column: unit for column, unit in found.items() if unit}
    return trials


def _no_numbers(column: pd.Series, whole: bool) -> str:
    """What is wrong with a column of numbers; a cell of them may be empty, one of `whole` numbers not."""
    if column.dtype.kind not in "iuf" and column.notna().any():
        return "holds a cell that is no number"
    if whole and (column.dtype.kind not in "iu" or not column.is_unique or (column < 0).any()):
        return "must hold different whole numbers, not negative"
    return "holds a number that is not finite" if np.isinf(column.to_numpy(float)).any() else ""
