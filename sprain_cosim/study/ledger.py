"""The ledger of a study: every finished trial, durable and atomic. The tables in the folder are exports of it.

SQLite in WAL mode with full synchronisation and one writer; what `commit` returned from survives a power cut. A lock on
the folder keeps a second writer out; it is the operating system's, so that it goes with the process that held it.

Every row carries a checksum of itself, of the names of its metrics and of the study it belongs to. A reader refuses a
row that does not fit its own; a writer drops such rows when it opens the ledger and names them, so that they run
again."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import sqlite3
import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Any, Self
from urllib.parse import quote

import numpy as np

from ..errors import EnvironmentProblem, InputError
from ..files import check_folder, is_missing, whole_file
from ..fmu.messages import Messages
from ..machine.here import SYSTEM
from ..uq.distributions import Array
from .identity import changes
from .previous import facts_today
from .worker import Outcome

FILE = "ledger.sqlite"
LOCK = ".lock"
RESUME = "; the ledger is valid, continue with --resume"
FORMAT = 4
SCHEMA = """
CREATE TABLE IF NOT EXISTS study (key TEXT PRIMARY KEY, value TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS metrics (id INTEGER PRIMARY KEY, names TEXT NOT NULL UNIQUE);
CREATE TABLE IF NOT EXISTS trials (
    trial INTEGER PRIMARY KEY, inputs BLOB NOT NULL, status TEXT NOT NULL, message TEXT NOT NULL,
    names INTEGER NOT NULL, metrics BLOB NOT NULL, wall REAL NOT NULL, worker TEXT NOT NULL,
    attempts INTEGER NOT NULL, log TEXT NOT NULL, messages TEXT NOT NULL, checksum BLOB NOT NULL);
"""
COLUMNS = "trial, inputs, status, message, names, metrics, wall, worker, attempts, log, messages, checksum"
CHECKSUM = 11  # its place among them
CHUNK = 4096  # rows fetched at a time
BEFORE_CHECKSUMS = 2  # the last format without them; its ledgers are read
RETRIES = 2000  # readings of parts of a damaged ledger, after which the rest counts as lost
OTHER_VERSION = "the ledger was written by another version; name a new folder with --out"
CHECK, EXPORTS = "checksum", "exports"  # keys beside the facts: their checksum; what was written from the rows


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
    the study, for those who come with the folder alone. `dropped`: numbers of the rows that were found damaged when it
    was opened, as far as they can be known, and are not in it any more; `mended` whether anything was.

    Raises InputError when the folder is in use, holds another study or what cannot be read at all, EnvironmentProblem
    when it cannot be written."""

    def __init__(
        self, folder: Path | None, digest: str, identity: Mapping[str, Any], description: str = "null"
    ) -> None:
        self.folder = folder
        self._lock: int | None = None
        self._place: tuple[int, int] | None = None
        self._checked = True
        self._names: dict[str, int] = {}
        self.dropped: list[int] = []
        self.mended = False
        facts = {"digest": digest, "identity": json.dumps(identity, sort_keys=True), "study": description}
        self.facts: Mapping[str, str] = facts
        try:
            if folder is not None:
                check_folder(folder)
                folder.mkdir(parents=True, exist_ok=True)
                self._hold(folder)
            self._connect(":memory:" if folder is None else folder / FILE)
            known = self._known(folder)
            if known and known["digest"] != digest:
                changed = changes(json.loads(known["identity"]), json.loads(facts["identity"]))
                raise InputError(f"{folder}: holds another study ({'; '.join(changed)}); name a new folder with --out")
            if not self._checked:
                raise InputError(f"{folder}: {OTHER_VERSION}")
            if folder is not None and not self._sound():
                self._mend(folder)
            elif known != facts:
                self._describe(facts)
            self._place = None if folder is None else _place_of(folder / FILE)
            self._names = {text: number for number, text in self._database.execute("SELECT id, names FROM metrics")}
        except sqlite3.DatabaseError as problem:
            self.close()
            raise self._unreadable(problem) if _damaged(problem) else _trouble(folder, problem) from None
        except OSError as problem:
            self.close()
            raise _trouble(folder, problem) from None
        except BaseException:
            self.close()
            raise

    def _connect(self, place: Path | str) -> None:
        self._database = sqlite3.connect(place, isolation_level=None, check_same_thread=False)
        self._database.execute("PRAGMA journal_mode=WAL")
        self._database.execute("PRAGMA synchronous=FULL")

    def _known(self, folder: Path | None) -> dict[str, str]:
        """The facts that stand in it; none for a new ledger and for facts that are damaged."""
        version = self._database.execute("PRAGMA user_version").fetchone()[0]
        if version == BEFORE_CHECKSUMS:
            self._checked = False
            return facts_today(dict(self._database.execute("SELECT key, value FROM study")))
        if version != FORMAT:
            if self._database.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]:
                raise InputError(f"{folder}: {OTHER_VERSION}")
            self._database.executescript(f"BEGIN;{SCHEMA}PRAGMA user_version={FORMAT};COMMIT;")
        try:
            facts = dict(self._database.execute("SELECT key, value FROM study"))
        except sqlite3.DatabaseError:
            return {}
        facts.pop(EXPORTS, None)
        return facts if facts.pop(CHECK, None) == _sum_of_facts(facts) else {}

    def _describe(self, facts: Mapping[str, str]) -> None:
        rows = {**facts, CHECK: _sum_of_facts(facts)}
        self._database.executemany("INSERT OR REPLACE INTO study VALUES (?, ?)", rows.items())

    def _sound(self) -> bool:
        """Whether all rows can be read and fit their checksums, and the file its own structure."""
        try:
            sound = bool(self._database.execute("PRAGMA quick_check(1)").fetchone()[0] == "ok")
            last = -1
            for record, names in self._records(""):
                sound = sound and last < record[0] and self._fits(record, names)
                last = record[0]
        except sqlite3.DatabaseError:
            return False
        return sound

    def _mend(self, folder: Path) -> None:
        """A new file with the rows that are as they were written takes the place of the damaged one. Raises InputError
        when there are none, since nothing then says that the ledger belonged to this study."""
        good: dict[int, Sequence[Any]] = {}
        bad: set[int] = set()
        for record, names in self._salvaged():
            if self._fits(record, names):
                good[record[0]] = (*record, names)
            else:
                bad.add(record[0])
        if not good:
            raise self._unreadable("no row in it is as it was written")
        fresh = Ledger(None, "", {})
        fresh.facts = self.facts
        fresh._describe(self.facts)
        fresh._database.execute("BEGIN")
        for _, (*record, names) in sorted(good.items()):
            record[4] = fresh._numbered(names)
            fresh._database.execute(f"INSERT INTO trials ({COLUMNS}) VALUES ({','.join('?' * 12)})", record)
        fresh._database.execute("COMMIT")
        self._database.close()
        with whole_file(folder / FILE) as partial, contextlib.closing(sqlite3.connect(partial)) as target:
            fresh._database.backup(target)
        fresh.close()
        for left in (f"{FILE}-wal", f"{FILE}-shm"):
            SYSTEM.remove(folder / left)
        self._connect(folder / FILE)
        self.dropped, self.mended = sorted(number for number in bad - good.keys() if number >= 0), True

    def _salvaged(self) -> Iterator[tuple[Sequence[Any], str]]:
        """What can be read, around what cannot."""
        self._database.text_factory = _text
        tries = RETRIES
        spans = [(0, (1 << 63) - 1)]
        while spans and tries:
            low, high = spans.pop()
            found: list[tuple[Sequence[Any], str]] = []
            try:
                for pair in self._records("WHERE trial BETWEEN ? AND ? ORDER BY trial", low, high):
                    found.append(pair)
            except sqlite3.DatabaseError:
                tries -= 1
                last = found[-1][0][0] if found else low
                if low < high:
                    middle = last + (high - last) // 2
                    spans += [(middle + 1, high), (last + bool(found), middle)] if last < high else []
            yield from found

    @classmethod
    def read(cls, folder: Path) -> Self:
        """For looking only, also while another process writes. Raises InputError when there is no ledger, or what it
        says of its study is damaged."""
        path = folder / FILE
        if missing := is_missing(folder):
            raise InputError(f"{folder}: {missing}")
        if not path.is_file() and (folder / "summary.json").is_file():
            raise InputError(
                f"{folder}: has no {FILE}, without which none of its landings can be run again; run the study again "
                "with this version, which leaves one"
            )
        if not path.is_file():
            out = SYSTEM.quoted(str(folder))
            raise InputError(f"{folder}: no study in it; `sprain-cosim study STUDY --out {out}` makes one")
        ledger = cls.__new__(cls)
        ledger.folder, ledger._lock, ledger._names = folder, None, {}
        ledger.dropped, ledger.mended = [], False
        # the last connection that could write removes what SQLite laid beside the file, one that only reads leaves it;
        # where somebody writes, or was killed at that, all stays as it is. A folder that cannot be written holds no
        # writer either
        tidy = ("mode=rw",) if not path.with_name(f"{FILE}-wal").exists() else ()
        for mode in (*tidy, "mode=ro", "immutable=1"):
            try:
                ledger._database = sqlite3.connect(
                    f"{_address(path.absolute())}?{mode}", uri=True, isolation_level=None
                )
                ledger._database.execute("PRAGMA query_only=ON")
                version = ledger._database.execute("PRAGMA user_version").fetchone()[0]
                facts = dict(ledger._database.execute("SELECT key, value FROM study"))
            except sqlite3.Error as problem:
                trouble: Exception = problem
                continue
            facts.pop(EXPORTS, None)
            if version > BEFORE_CHECKSUMS and facts.pop(CHECK, None) != _sum_of_facts(facts):
                raise ledger._unreadable("what it says of its study does not fit its checksum")
            ledger._checked = version > BEFORE_CHECKSUMS
            try:
                ledger.facts = facts if ledger._checked else facts_today(facts)
            except (ValueError, TypeError, AttributeError, KeyError, RecursionError):
                raise ledger._unreadable("what it says of its study cannot be read") from None
            return ledger
        raise InputError(f"{path}: cannot be read as a ledger: {trouble}")

    @classmethod
    def rewrite(cls, folder: Path, digest: str, identity: Mapping[str, Any], description: str) -> None:
        """The rows of a folder's ledger under another identity, in today's format: a new file takes the place of the
        old one. Raises InputError when it is in use or a row is damaged, EnvironmentProblem when it cannot be
        written."""
        with cls(None, digest, identity, description) as fresh:
            fresh._hold(folder)
            try:
                with contextlib.closing(sqlite3.connect(folder / FILE, isolation_level=None)) as old:
                    old.execute("PRAGMA journal_mode=DELETE")  # all that it has stands in the one file
                with cls.read(folder) as written:
                    for row in written.rows():
                        fresh.add(row)
                fresh.commit()
                with whole_file(folder / FILE) as partial, contextlib.closing(sqlite3.connect(partial)) as target:
                    fresh._database.backup(target)
            except sqlite3.Error as problem:
                raise _trouble(folder, problem) from None

    def said(self, fact: str) -> Any:
        """What it says of its study, None for nothing; `identity` is always an object. Raises InputError."""
        try:
            content = json.loads(self.facts.get(fact, "null"))
        except (TypeError, ValueError, RecursionError):
            content = ...
        if content is ... or (fact == "identity" and not isinstance(content, dict)):
            raise self._unreadable(f"what it says of its study ({fact}) cannot be read")
        return content

    def add(self, row: Row) -> None:
        """Within the open transaction, see `commit`."""
        o = row.outcome
        try:
            if not self._database.in_transaction:
                self._database.execute("BEGIN")
            names = json.dumps(list(o.metrics))
            record = (
                row.trial,
                row.inputs.tobytes(),
                o.status,
                o.message,
                self._numbered(names),
                np.array(list(o.metrics.values()), float).tobytes(),
                float(o.wall),
                row.worker,
                o.attempts,
                o.log,
                json.dumps({name: said.to_json() for name, said in o.messages.items()}) if o.messages else "",
            )
            self._database.execute(
                f"INSERT INTO trials ({COLUMNS}) VALUES ({','.join('?' * 12)})",
                (*record, _sum(self.facts["digest"], record, names)),
            )
        except sqlite3.Error as problem:
            raise _trouble(self.folder, problem) from None

    def forget_timeouts(self, limit: float) -> list[int]:
        """Removes the trials that a shorter limit of wall time than `limit` [s] ended: their numbers."""
        found = self._asked(f"SELECT trial FROM trials WHERE status = 'timeout' AND wall < {limit!r} ORDER BY trial")
        numbers = [int(number) for (number,) in found]
        try:
            self._database.executemany("DELETE FROM trials WHERE trial = ?", [(number,) for number in numbers])
        except sqlite3.Error as problem:
            raise _trouble(self.folder, problem) from None
        return numbers

    def commit(self) -> None:
        """Returns when all rows added are on the disk. Raises EnvironmentProblem when they cannot be, or the ledger is
        no longer where it was."""
        self._check_place()
        if self._database.in_transaction:
            try:
                self._database.execute("COMMIT")
            except sqlite3.Error as problem:
                raise _trouble(self.folder, problem) from None

    def _check_place(self) -> None:
        """What goes into a file that was removed is lost, though the system takes it."""
        if self.folder is not None and _place_of(self.folder / FILE) != self._place:
            raise EnvironmentProblem(
                f"{self.folder}: its ledger was removed or moved while the study ran, so what finishes now would "
                "be lost; run the study again, or continue with --resume where the folder is now"
            )

    def count(self) -> int:
        """How many rows there are."""
        return int(self._asked("SELECT count(*) FROM trials")[0][0])

    def note_exports(self, content: Mapping[str, Any]) -> None:
        """What was written from the rows, for `noted_exports`; it is forgotten when the ledger is mended. Raises
        EnvironmentProblem as `commit` does."""
        self._check_place()
        try:
            self._database.execute("INSERT OR REPLACE INTO study VALUES (?, ?)", (EXPORTS, json.dumps(content)))
        except sqlite3.Error as problem:
            raise _trouble(self.folder, problem) from None

    def noted_exports(self) -> dict[str, Any]:
        """{} for none."""
        found = self._asked(f"SELECT value FROM study WHERE key = '{EXPORTS}'")
        try:
            content = json.loads(found[0][0]) if found else {}
        except (TypeError, ValueError, RecursionError):
            return {}
        return content if isinstance(content, dict) else {}

    def finished(self) -> tuple[np.ndarray, np.ndarray]:
        """(n,) numbers of all rows, ascending; (n,) whether each failed."""
        found = self._asked("SELECT trial, status != 'completed' FROM trials ORDER BY trial")
        try:
            pairs = np.array(found, np.int64).reshape(-1, 2)
        except (TypeError, ValueError, OverflowError):
            raise self._unreadable("a trial's number or status is none") from None
        return pairs[:, 0].copy(), pairs[:, 1].astype(bool)

    def rows(self) -> Iterator[Row]:
        """In the order of their numbers. Raises InputError at a row that is damaged."""
        return self._select("ORDER BY trial")

    def with_messages(self) -> Iterator[Row]:
        """Those in which an FMU said something."""
        return self._select("WHERE messages != '' ORDER BY trial") if self._checked else iter(())

    def failed(self) -> Iterator[Row]:
        return self._select("WHERE status != 'completed' ORDER BY trial")

    def row(self, trial: int) -> Row | None:
        return next(self._select("WHERE trial = ?", trial), None)

    def _select(self, which: str, *values: Any) -> Iterator[Row]:
        parsed: dict[str, list[str]] = {}
        try:
            for record, text in self._records(which, *values):
                if not self._fits(record, text):
                    raise self._unreadable(f"trial {record[0]} does not fit its checksum")
                trial, inputs, status, message, _, metrics, wall, worker, attempts, log, said, _ = record
                if text not in parsed:
                    parsed[text] = json.loads(text)
                named = dict(zip(parsed[text], np.frombuffer(metrics).tolist(), strict=True))
                messages = {n: Messages.from_json(m, n) for n, m in json.loads(said).items()} if said else {}
                outcome = Outcome(status, message, named, wall, attempts, log, messages)
                yield Row(trial, np.frombuffer(inputs), outcome, worker)
        except (sqlite3.DatabaseError, TypeError, ValueError) as problem:
            raise self._unreadable(problem) from None

    def _records(self, which: str, *values: Any) -> Iterator[tuple[Sequence[Any], str]]:
        """Rows as they lie in the table, each with the text of its metrics' names."""
        names = dict(self._database.execute("SELECT id, names FROM metrics"))
        columns = COLUMNS if self._checked else COLUMNS.replace("messages, checksum", "NULL, NULL")
        found = self._database.execute(f"SELECT {columns} FROM trials {which}", values)
        while chunk := found.fetchmany(CHUNK):
            for record in chunk:
                yield record, names.get(record[4], "")

    def _fits(self, record: Sequence[Any], names: str) -> bool:
        if not self._checked:
            return True
        try:
            return bool(_sum(self.facts["digest"], record, names) == record[CHECKSUM])
        except (TypeError, ValueError, AttributeError, struct.error):  # a value of another type than was written
            return False

    def _numbered(self, names: str) -> int:
        """The number under which the metrics' names stand; a row then holds their values only."""
        if names not in self._names:
            added = self._database.execute("INSERT INTO metrics (names) VALUES (?)", (names,))
            self._names[names] = int(added.lastrowid or 0)
        return self._names[names]

    def _asked(self, query: str) -> list[Any]:
        try:
            return self._database.execute(query).fetchall()
        except sqlite3.DatabaseError as problem:
            raise self._unreadable(problem) from None

    def _unreadable(self, why: object) -> InputError:
        return InputError(
            f"{self.folder}: its ledger is damaged: {why}; continue the study with --resume, which runs again what is "
            "lost, or put back a copy"
        )

    def close(self) -> None:
        with contextlib.suppress(sqlite3.Error, AttributeError):  # it may not have come to a connection
            if self._database.in_transaction:
                self._database.execute("COMMIT")
        with contextlib.suppress(sqlite3.Error, AttributeError):
            self._database.close()
        self._release()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _hold(self, folder: Path) -> None:
        lock = os.open(folder / LOCK, os.O_RDWR | os.O_CREAT, 0o644)  # Python keeps it from children
        if not SYSTEM.lock(lock):
            holder = os.read(lock, 64).decode("ascii", "replace").strip()
            os.close(lock)
            raise InputError(
                f"{folder}: in use by process {holder or 'unknown'}; wait for it, or name another folder with --out"
            )
        os.ftruncate(lock, 0)
        os.write(lock, f"{os.getpid()}\n".encode())
        self._lock = lock

    def _release(self) -> None:
        if self._lock is not None:
            with contextlib.suppress(OSError):
                os.ftruncate(self._lock, 0)
            os.close(self._lock)
            self._lock = None


def _place_of(path: Path) -> tuple[int, int] | None:
    """Which file it is; None for none."""
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_dev, status.st_ino


def _address(path: PurePath) -> str:
    """The URI by which SQLite opens a file; it knows no servers, so that of a Windows share stands in the path."""
    place = path.as_posix()
    return f"file://{'' if place.startswith('/') else '/'}{quote(place, safe='/:')}"


def _trouble(folder: Path | None, problem: Exception) -> EnvironmentProblem:
    if isinstance(problem, OSError):
        return EnvironmentProblem(f"{folder}: cannot be written: {problem.strerror or problem}")
    return EnvironmentProblem(f"{folder}: the ledger cannot be written ({problem}); what was committed before is kept")


def _sum(digest: str, record: Sequence[Any], names: str) -> bytes:
    trial, inputs, status, message, _, metrics, wall, worker, attempts, log, said = record[:CHECKSUM]
    head = struct.pack("<qdqqq", trial, wall, attempts, len(inputs), len(metrics))
    texts = "\0".join((digest, names, status, message, worker, log, said)).encode("utf-8", "surrogatepass")
    return hashlib.blake2b(b"".join((head, inputs, metrics, texts)), digest_size=8).digest()


def _sum_of_facts(facts: Mapping[str, str]) -> str:
    try:
        text = json.dumps(sorted((key, value) for key, value in facts.items() if key != CHECK))
    except TypeError:  # of other types than were written
        return ""
    return hashlib.blake2b(text.encode(), digest_size=8).hexdigest()


def _text(data: bytes) -> str:
    """Damaged text must reach the checksum, not stop the reading."""
    return data.decode("utf-8", "replace")


def _damaged(problem: sqlite3.Error) -> bool:
    return getattr(problem, "sqlite_errorname", "") in ("SQLITE_CORRUPT", "SQLITE_NOTADB", "SQLITE_FORMAT") or any(
        word in str(problem) for word in ("malformed", "not a database")
    )
