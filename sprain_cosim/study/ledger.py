"""The ledger of a study: every finished trial, durable and atomic. The tables in the folder are exports of it.

SQLite in WAL mode with full synchronisation and one writer; what `commit` returned from survives a power cut. A lock on
the folder keeps a second writer out; it is the operating system's, so that it goes with the process that held it."""

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
from ..uq.distributions import Array
from .worker import Outcome

FILE = "ledger.sqlite"
LOCK = ".lock"
RESUME = "; the ledger is valid, continue with --resume"
FORMAT = 2
SCHEMA = """
CREATE TABLE IF NOT EXISTS study (key TEXT PRIMARY KEY, value TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS metrics (id INTEGER PRIMARY KEY, names TEXT NOT NULL UNIQUE);
CREATE TABLE IF NOT EXISTS trials (
    trial INTEGER PRIMARY KEY, inputs BLOB NOT NULL, status TEXT NOT NULL, message TEXT NOT NULL,
    names INTEGER NOT NULL, metrics BLOB NOT NULL, wall REAL NOT NULL, worker TEXT NOT NULL,
    attempts INTEGER NOT NULL, log TEXT NOT NULL);
"""
CHUNK = 4096  # rows fetched at a time


@dataclass(frozen=True)
class Row:
    """A finished trial. `inputs` (d,) in the parameters' own units; `wall` [s]."""

    trial: int
    inputs: Array
    outcome: Outcome
    worker: str


class Ledger:
    """Open with `Ledger(folder, digest, identity, description)`; folder None keeps it in memory. `Ledger.read(folder)`
    only looks. Use as a context manager. `digest` and `identity` say what the rows belong to; `description` is all of
    the study, for those who come with the folder alone.

    Raises InputError when the folder is in use or holds another study, EnvironmentProblem when it cannot be written."""

    def __init__(
        self, folder: Path | None, digest: str, identity: Mapping[str, Any], description: str = "null"
    ) -> None:
        self.folder = folder
        self._lock: int | None = None
        self._names: dict[str, int] = {}
        try:
            if folder is not None:
                folder.mkdir(parents=True, exist_ok=True)
                self._hold(folder)
            self._database = sqlite3.connect(
                ":memory:" if folder is None else folder / FILE, isolation_level=None, check_same_thread=False
            )
            self._database.execute("PRAGMA journal_mode=WAL")
            self._database.execute("PRAGMA synchronous=FULL")
            known = self._facts() if self._database.execute("PRAGMA user_version").fetchone()[0] == FORMAT else None
            if known is None:
                if self._database.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]:
                    self.close()
                    raise InputError(
                        f"{folder}: the ledger was written by another version; name a new folder with --out"
                    )
                self._database.executescript(f"BEGIN;{SCHEMA}PRAGMA user_version={FORMAT};COMMIT;")
                known = {}
        except (OSError, sqlite3.Error) as problem:
            self._release()
            raise _trouble(folder, problem) from None
        if known and known["digest"] != digest:
            self.close()
            before = json.loads(known["identity"])
            changed = [key for key in identity if json.loads(json.dumps(identity[key])) != before.get(key)]
            raise InputError(
                f"{folder}: holds another study ({', '.join(changed)} differ); name a new folder with --out"
            )
        try:
            facts = {"digest": digest, "identity": json.dumps(identity, sort_keys=True), "study": description}
            self._database.executemany(
                "INSERT OR REPLACE INTO study VALUES (?, ?)", facts.items() if facts != known else ()
            )
        except sqlite3.Error as problem:
            self.close()
            raise _trouble(folder, problem) from None
        self.facts: Mapping[str, str] = facts

    @classmethod
    def read(cls, folder: Path) -> Self:
        """For looking only, also while another process writes. Raises InputError when there is no ledger."""
        path = folder / FILE
        if not path.is_file():
            raise InputError(f"{folder}: no study in it; `sprain-cosim study STUDY --out {folder}` makes one")
        ledger = cls.__new__(cls)
        ledger.folder, ledger._lock, ledger._names = folder, None, {}
        for mode in ("mode=ro", "immutable=1"):  # a folder that cannot be written holds no writer either
            try:
                ledger._database = sqlite3.connect(f"{path.absolute().as_uri()}?{mode}", uri=True, isolation_level=None)
                ledger.facts = ledger._facts()
                return ledger
            except sqlite3.Error as problem:
                trouble = problem
        raise InputError(f"{path}: cannot be read as a ledger: {trouble}")

    def add(self, row: Row) -> None:
        """Within the open transaction, see `commit`."""
        o = row.outcome
        try:
            if not self._database.in_transaction:
                self._database.execute("BEGIN")
            values = np.array(list(o.metrics.values()), float).tobytes()
            self._database.execute(
                "INSERT INTO trials VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
                (
                    row.trial,
                    row.inputs.tobytes(),
                    o.status,
                    o.message,
                    self._named(o.metrics),
                    values,
                    o.wall,
                    row.worker,
                    o.attempts,
                    o.log,
                ),
            )
        except sqlite3.Error as problem:
            raise _trouble(self.folder, problem) from None

    def commit(self) -> None:
        """Returns when all rows added are on the disk."""
        if self._database.in_transaction:
            try:
                self._database.execute("COMMIT")
            except sqlite3.Error as problem:
                raise _trouble(self.folder, problem) from None

    def finished(self) -> tuple[np.ndarray, np.ndarray]:
        """(n,) numbers of all rows, ascending; (n,) whether each failed."""
        count = self._database.execute("SELECT count(*) FROM trials").fetchone()[0]
        numbers, failed = np.empty(count, np.int64), np.empty(count, bool)
        for k, (trial, bad) in enumerate(
            self._database.execute("SELECT trial, status != 'completed' FROM trials ORDER BY trial")
        ):
            numbers[k], failed[k] = trial, bad
        return numbers, failed

    def rows(self) -> Iterator[Row]:
        """In the order of their numbers."""
        return self._select("ORDER BY trial")

    def failed(self) -> Iterator[Row]:
        return self._select("WHERE status != 'completed' ORDER BY trial")

    def row(self, trial: int) -> Row | None:
        return next(self._select("WHERE trial = ?", trial), None)

    def _select(self, which: str, *values: Any) -> Iterator[Row]:
        names = {k: tuple(json.loads(text)) for k, text in self._database.execute("SELECT id, names FROM metrics")}
        found = self._database.execute(f"SELECT * FROM trials {which}", values)
        while chunk := found.fetchmany(CHUNK):
            for trial, inputs, status, message, kind, metrics, wall, worker, attempts, log in chunk:
                outcome = Outcome(
                    status,
                    message,
                    dict(zip(names[kind], np.frombuffer(metrics).tolist(), strict=True)),
                    wall,
                    attempts,
                    log,
                )
                yield Row(trial, np.frombuffer(inputs), outcome, worker)

    def _named(self, metrics: Mapping[str, float]) -> int:
        """The number under which the metrics' names stand; a row then holds their values only."""
        names = json.dumps(list(metrics))
        if names not in self._names:
            self._database.execute("INSERT OR IGNORE INTO metrics (names) VALUES (?)", (names,))
            self._names[names] = self._database.execute("SELECT id FROM metrics WHERE names = ?", (names,)).fetchone()[
                0
            ]
        return self._names[names]

    def _facts(self) -> dict[str, str]:
        return dict(self._database.execute("SELECT key, value FROM study"))

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
            raise InputError(
                f"{folder}: in use by process {holder or 'unknown'}; wait for it, or name another folder with --out"
            ) from None
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
