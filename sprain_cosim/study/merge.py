"""One folder of the shards of a study."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError
from ..processor import within_rounding
from .backends.backend import Backend, Task
from .backends.choice import open_backend
from .campaign import Campaign, at_hand
from .dispatch import Dispatch
from .evaluation import summarise
from .folder import (
    begin_folder,
    check_study_folder,
    finish_folder,
    load_study_plan,
    missing,
    trial_messages,
    trial_tables,
    write_failures,
)
from .identity import changes
from .ledger import Ledger, Row
from .manifest import Manifest, level_then, read_manifest, software
from .plan import Plan
from .shards import trial_numbers
from .summary import Kept, read_summary
from .trajectories import Trajectories, roles_of


def merge(folders: Sequence[Path], out: Path | None = None, parquet: bool = False) -> Campaign:
    """One folder of the shards of a study, as if it had run in one piece; `out` None: runs/STUDY. Their trajectories
    come along.

    Raises InputError when they belong to different studies, differ in a trial, or a trial is in none of them."""
    parts = [Ledger.read(folder) for folder in folders]
    try:
        study = load_study_plan(folders[0], parts[0])
        for folder, part in zip(folders, parts, strict=True):
            if part.facts["digest"] != parts[0].facts["digest"]:
                one, other = (ledger.said("identity") for ledger in (parts[0], part))
                different = "; ".join(changes(one, other, words=("there", "here")))
                raise InputError(f"{folder}: belongs to another study than {folders[0]} ({different})")
        study = max((load_study_plan(f, p) for f, p in zip(folders, parts, strict=True)), key=lambda s: s.trials)
        numbers = trial_numbers(study)
        lost = np.setdiff1d(numbers, np.concatenate([part.finished()[0] for part in parts]))
        if len(lost):
            raise InputError(
                f"trials {missing(lost.tolist())} are in none of the folders; run their shard with "
                "--resume, or name its folder"
            )
        manifests = [read_manifest(source) for source in folders]
        levels = [manifest.processor for manifest in manifests]
        mixed = len({level for several in levels for level in several}) > 1
        folder = out or Path("runs") / Path(study.source or "study").stem
        check_study_folder(folder, resume=False, resumable=False)
        recorder = Trajectories(folder, 0)
        facts = parts[0].facts
        with Ledger(folder, facts["digest"], json.loads(facts["identity"]), facts["study"]) as ledger:
            begin_folder(folder, study, "", json.loads(facts["identity"]), list(chain.from_iterable(levels)), manifests)
            for source, part in zip(folders, parts, strict=True):
                _take(source, part, ledger, recorder, mixed)
            ledger.commit()
            table, timing = trial_tables(study, ledger, numbers)
            kept = roles_of(study, table, None)
            dispatch = Dispatch(ledger, _backend(study, folder), trajectories=recorder)
            try:
                changed = dispatch.repeat(recorder.lacks(kept.values()))
            finally:
                dispatch.close()
            said = trial_messages(ledger, numbers)
            write_failures(folder, study, ledger)
    finally:
        for part in parts:
            part.close()
    summary = replace(
        summarise(study, table, None),
        trajectories=Kept(kept, sum(_first_kept(f) for f in folders)),
        not_reproduced=tuple(changed) or None,
        fmu_messages=said,
        wall_s=round(float(timing["wall_s"].sum()), 3),
        merged=tuple(str(f) for f in folders),
    )
    finish_folder(folder, table, timing, summary, parquet)
    return Campaign(study, summary, folder, at_hand((table, timing)), _other_machines(folders, manifests))


def _take(source: Path, part: Ledger, ledger: Ledger, recorder: Trajectories, mixed: bool) -> None:
    """The rows of a part that are new; others must be the same, but for rounding where processors are `mixed`. Raises
    InputError."""
    for row in part.rows():
        known = ledger.row(row.trial)
        if known is None:
            ledger.add(row)
            recorder.take(source, row.trial)
        elif _content(known) != _content(row) and not (mixed and same_but_rounding(known, row)):
            raise InputError(f"{source}: its trial {row.trial} differs from that of another folder")


def _backend(study: Plan, folder: Path) -> Backend:
    return open_backend(Task(study.scenario, study.names, level=level_then(folder)), 1, None)


def _other_machines(folders: Sequence[Path], manifests: Sequence[Manifest]) -> tuple[str, ...]:
    """The warnings that parts ran code for different levels of processors, or with different software."""
    known = {folder: ", ".join(m.processor) for folder, m in zip(folders, manifests, strict=True) if m.processor}
    warnings = []
    if len(set(known.values())) > 1:
        where = "; ".join(f"{folder}: {level}" for folder, level in known.items())
        warnings.append(
            f"the parts ran code for different processors, so their rows may differ in the last digits: {where}"
        )
    for folder, manifest in zip(folders, manifests, strict=True):
        if lines := software(manifests[0], manifest, ("there", "here")):
            warnings.append(
                f"{folder}: ran with other software than {folders[0]}, so rows may differ in the last digits: "
                f"{'; '.join(lines)}"
            )
    return tuple(warnings)


def _first_kept(folder: Path) -> int:
    """How many first trials of a shard have their signals; 0 for one that is not complete."""
    try:
        return read_summary(folder).first_kept
    except InputError:
        return 0


def same_but_rounding(one: Row, other: Row) -> bool:
    """Whether two rows of a trial are those of two levels of processors."""
    first, second = one.outcome, other.outcome
    if (one.inputs.tobytes(), first.status) != (other.inputs.tobytes(), second.status):
        return False
    if first.metrics.keys() != second.metrics.keys():
        return False
    return all(within_rounding(value, second.metrics[name]) for name, value in first.metrics.items())


def _content(row: Row) -> tuple[Any, ...]:
    return row.inputs.tobytes(), row.outcome.status, row.outcome.message, row.outcome.metrics
