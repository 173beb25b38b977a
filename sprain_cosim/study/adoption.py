"""Continuing a study that another version of the program began.

A table must not mix numbers of two programs. So trials that are finished run once more, and the folder is continued
only if they come out the same to the bit."""

from __future__ import annotations

import json
from pathlib import Path

from .. import __version__
from ..errors import InputError
from ..process import Limits
from ..shipped import FMUS
from .codec import encode
from .identity import changes
from .ledger import Ledger, Row
from .plan import Plan
from .worker import Worker


def version_before(study: Plan, held: Plan, folder: Path) -> str | None:
    """The version that began the study in a folder, if it is another and nothing else differs but shipped FMUs, which
    belong to the version. `held` is the study from the copies of its files."""
    try:
        with Ledger.read(folder) as ledger:
            before = ledger.said("identity")
    except InputError:  # damaged: who opens it to write mends it
        return None
    now = held.identity
    if before.get("version") in (None, __version__):
        return None
    own = {name for name, path in study.scenario.fmus.items() if path.parent != FMUS}
    foreign = [{k: v for k, v in fmus.items() if k in own} for fmus in (before.get("fmus", {}), now["fmus"])]
    if foreign[0] != foreign[1] or changes(before, now, without=("version", "fmus")):
        return None
    return str(before["version"])


def adopt(study: Plan, held: Plan, folder: Path, version: str, limits: Limits | None = None) -> str:
    """Takes the folder over from the version that began it, when its trials can be repeated; a line that says so.

    Raises InputError naming the trial and the number that differ."""
    with Ledger.read(folder) as ledger:
        rows = _chosen(ledger, study.responses[0])
    if not rows:
        raise InputError(
            f"{folder}: was begun with version {version} and has no completed trial; name a new folder with --out"
        )
    with Worker(held.scenario, held.names, limits) as worker:
        for row in rows:
            _compare(row, worker, folder, version)
    Ledger.rewrite(folder, held.digest, held.identity, json.dumps(encode(study)))
    numbers = " and ".join(", ".join(str(row.trial) for row in rows).rsplit(", ", 1))
    return (
        f"{folder}: was begun with version {version}; trial{'s' if len(rows) > 1 else ''} {numbers}, repeated with "
        f"{__version__}, came out the same to the bit"
    )


def _chosen(ledger: Ledger, response: str) -> list[Row]:
    """The first completed trial, and those of the lowest and the highest response, which go farthest through a device's
    range."""
    first = low = high = None
    for row in ledger.rows():
        if row.outcome.status != "completed":
            continue
        value = row.outcome.metrics.get(response, 0.0)
        first = first or row
        low = row if low is None or value < low.outcome.metrics.get(response, 0.0) else low
        high = row if high is None or value > high.outcome.metrics.get(response, 0.0) else high
    return list({row.trial: row for row in (first, low, high) if row is not None}.values())


def _compare(row: Row, worker: Worker, folder: Path, version: str) -> None:
    before, now = row.outcome, worker.run(row.inputs.tolist())
    if now.status != before.status:
        found = f"is {now.status} ({now.message})"
    else:
        different = next((k for k, v in before.metrics.items() if now.metrics.get(k) != v), None)
        if different is None:
            return
        found = f"gives {different} = {now.metrics.get(different, 'nothing')!r}, not {before.metrics[different]!r}"
    raise InputError(
        f"{folder}: was begun with version {version}; with {__version__} its trial {row.trial} {found}; finish it with "
        "that version, or name a new folder with --out"
    )
