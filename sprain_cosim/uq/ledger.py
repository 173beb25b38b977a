"""The ledger of a study: every finished trial, durable and atomic. The tables in the folder are exports of it.

SQLite in WAL mode with full synchronisation and one writer; what `commit` returned from survives a power cut. A lock on the folder keeps a
second writer out; it is the operating system's, so that it goes with the process that held it."""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import sqlite3
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np

from ..errors import EnvironmentProblem, InputError
from ..isolation import Outcome
from .distributions import Array

FILE = "ledger.sqlite"
LOCK = ".lock"
SCHEMA = """
CREATE TABLE IF NOT EXISTS study (key TEXT PRIMARY KEY, value TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS trials (trial INTEGER PRIMARY KEY, inputs BLOB NOT NULL, status TEXT NOT NULL, message TEXT NOT NULL,
                                   metrics TEXT NOT NULL, wall REAL NOT NULL, worker TEXT NOT NULL, attempts INTEGER NOT NULL, log TEXT NOT NULL);
"""


@dataclass(frozen=True)
class Row:
    """A finished trial. `inputs` (d,) in the parameters' own units; `wall` [s]."""

    trial: int
    inputs: Array
    outcome: Outcome
    worker: str


class Ledger:
    """Open with `Ledger(folder, digest, identity)`; folder None keeps it in memory. Use as a context manager.

    Raises InputError when the folder is in use or holds another study, EnvironmentProblem when it cannot be written."""

    def __init__(self, folder: Path | None, digest: str, identity: Mapping[str, Any]) -> None:
        self.folder = folder
        self._lock: int | None = None
        try:
            if folder is not None:
                folder.mkdir(parents=True, exist_ok=True)
                self._hold(folder)
            self._database = sqlite3.connect(":memory:" if folder is None else folder / FILE, isolation_level=None, check_same_thread=False)
            self._database.execute("PRAGMA journal_mode=WAL")
            self._database.execute("PRAGMA synchronous=FULL")
            self._database.executescript(SCHEMA)
            known = dict(self._database.execute("SELECT key, value FROM study"))
            if not known:
                self._database.executemany("INSERT INTO study VALUES (?, ?)", [("digest", digest), ("identity", json.dumps(identity, sort_keys=True))])
        except (OSError, sqlite3.Error) as problem:
            self._release()
            raise _trouble(folder, problem) from None
        if known and known["digest"] != digest:
            self.close()
            before = json.loads(known["identity"])
            changed = [key for key in identity if json.loads(json.dumps(identity[key])) != before.get(key)]
            raise InputError(f"{folder}: holds another study ({', '.join(changed)} differ); name a new folder with --out")

    def add(self, row: Row) -> None:
        """Within the open transaction, see `commit`."""
        if not self._database.in_transaction:
            self._database.execute("BEGIN")
        o = row.outcome
        values = (row.trial, row.inputs.tobytes(), o.status, o.message, json.dumps(o.metrics), o.wall, row.worker, o.attempts, o.log)
        try:
            self._database.execute("INSERT INTO trials VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)", values)
        except sqlite3.Error as problem:
            raise _trouble(self.folder, problem) from None

    def commit(self) -> None:
        """Returns when all rows added are on the disk."""
        if self._database.in_transaction:
            try:
                self._database.execute("COMMIT")
            except sqlite3.Error as problem:
                raise _trouble(self.folder, problem) from None

    def finished(self) -> dict[int, str]:
        """{trial: status} of all rows."""
        return dict(self._database.execute("SELECT trial, status FROM trials"))

    def rows(self) -> Iterator[Row]:
        """In the order of their numbers."""
        for trial, inputs, status, message, metrics, wall, worker, attempts, log in self._database.execute("SELECT * FROM trials ORDER BY trial"):
            yield Row(trial, np.frombuffer(inputs), Outcome(status, message, json.loads(metrics), wall, attempts, log), worker)

    def row(self, trial: int) -> Row | None:
        found = self._database.execute("SELECT * FROM trials WHERE trial = ?", (trial,)).fetchone()
        if found is None:
            return None
        return Row(trial, np.frombuffer(found[1]), Outcome(found[2], found[3], json.loads(found[4]), found[5], found[7], found[8]), found[6])

    def close(self) -> None:
        with contextlib.suppress(sqlite3.Error):
            if self._database.in_transaction:
                self._database.execute("COMMIT")
        self._database.close()
        self._release()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _hold(self, folder: Path) -> None:
        lock = os.open(folder / LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            holder = os.pread(lock, 64, 0).decode("ascii", "replace").strip()
            os.close(lock)
            raise InputError(f"{folder}: in use by process {holder or 'unknown'}; wait for it, or name another folder with --out") from None
        os.ftruncate(lock, 0)
        os.pwrite(lock, f"{os.getpid()}\n".encode(), 0)
        self._lock = lock

    def _release(self) -> None:
        if self._lock is not None:
            with contextlib.suppress(OSError):
                os.ftruncate(self._lock, 0)
            os.close(self._lock)
            self._lock = None


def _trouble(folder: Path | None, problem: Exception) -> EnvironmentProblem:
    if isinstance(problem, OSError):
        return EnvironmentProblem(f"{folder}: cannot be written: {problem.strerror or problem}")
    return EnvironmentProblem(f"{folder}: the ledger cannot be written ({problem}); what was committed before is kept")
