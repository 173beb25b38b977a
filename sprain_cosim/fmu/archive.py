"""The FMU as an archive: checked before anything of it is used."""

from __future__ import annotations

import hashlib
import os
import re
import stat
import time
import unicodedata
import zipfile
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from ..errors import InputError

MAX_ENTRIES = 10_000
MAX_SIZE = 512 * 2**20
MAX_RATIO = 200
MAX_DESCRIPTION = 64 * 2**20
SETTLED = 2_000_000_000  # ns after its last change from which a file's times tell whether it changed again
RESOURCES = "resources"  # where names may end in a dot
DESCRIPTION = "modelDescription.xml"  # at the top of an FMU
STRUCTURE = "SystemStructure.ssd"  # at the top of an SSP package
FMU = "an FMU"
MAX_NAME = 255  # B of UTF-8, one part of a path
MAX_PATH = 1000
ENCODINGS = (
    "utf-8",
    "utf8",
    "us-ascii",
    "ascii",
    "iso-8859-1",
    "windows-1252",
)  # what holds a DOCTYPE in no other bytes than UTF-8
DEVICES = {"con", "prn", "aux", "nul", *(f"{d}{k}" for d in ("com", "lpt") for k in range(1, 10))}


@dataclass(frozen=True)
class Archive:
    """A file that passed the checks. `description` is the raw modelDescription.xml, `names` all files inside, `quirks`
    what is unusual about them, one line each."""

    path: Path
    sha256: str
    description: bytes
    names: tuple[str, ...]
    quirks: tuple[str, ...] = ()


def read(path: Path) -> Archive:
    """Checks the archive without unpacking it. Raises InputError in one line."""
    status = _status(path)
    marks = (status.st_dev, status.st_ino, status.st_size, status.st_mtime_ns, status.st_ctime_ns)
    if time.time_ns() - max(status.st_mtime_ns, status.st_ctime_ns) < SETTLED:
        return _read(path)
    return _remembered(path, marks)


def _status(path: Path, kind: str = FMU) -> os.stat_result:
    """Of a file that is one, and not too large; `kind`: what it should be. Raises InputError."""
    try:
        status = path.stat()
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except (OSError, ValueError) as problem:
        raise InputError(f"{path}: cannot be read: {getattr(problem, 'strerror', None) or problem}") from None
    if not stat.S_ISREG(status.st_mode):
        raise InputError(f"{path}: {f'is a folder, not {kind}' if path.is_dir() else 'no such file'}")
    if status.st_size > MAX_SIZE:
        raise InputError(f"{path}: {status.st_size / 2**20:.0f} MB; at most {MAX_SIZE // 2**20} MB are accepted")
    return status


@lru_cache(maxsize=64)
def _remembered(path: Path, _: tuple[int, ...]) -> Archive:
    return _read(path)


def _read(path: Path) -> Archive:
    try:
        file = path.open("rb")
    except OSError as problem:
        raise InputError(f"{path}: cannot be read: {problem.strerror or problem}") from None
    with file:
        try:
            sha256 = hashlib.file_digest(file, "sha256").hexdigest()
            with zipfile.ZipFile(file) as archive:
                entries = archive.infolist()
                _check(path, entries)
                if DESCRIPTION not in archive.namelist():
                    raise InputError(_no_fmu(path, archive.namelist()))
                size = archive.getinfo(DESCRIPTION).file_size
                if size > MAX_DESCRIPTION:
                    raise InputError(
                        f"{path}: modelDescription.xml has {size / 2**20:.0f} MB; at most "
                        f"{MAX_DESCRIPTION // 2**20} MB are accepted"
                    )
                description = archive.read(DESCRIPTION)
        except InputError:
            raise
        except MemoryError:
            raise
        except Exception as problem:  # zipfile raises many kinds for damaged files
            why = "its directory is damaged" if isinstance(problem, OSError) else one_line(problem)
            raise InputError(f"{path}: not a readable zip archive ({why}); export the FMU again") from None
    names = tuple(e.filename for e in entries if not e.is_dir())
    dots = [name for name in names if any(part.endswith(".") for part in name.split("/"))]
    quirks = (f"{dots[0]!r} ends in a dot, which Windows does not keep",) if dots else ()
    return Archive(path, sha256, _described(path, description), names, quirks)


def _no_fmu(path: Path, names: list[str]) -> str:
    if STRUCTURE in names:
        rename = "" if path.suffix.lower() == ".ssp" else ", under a name that ends in .ssp"
        return f"{path}: is an SSP package, not {FMU}; `sprain-cosim ssp check` takes it{rename}"
    return f"{path}: no {DESCRIPTION} at the top of the archive, so it is not {FMU}"


def _described(path: Path, description: bytes) -> bytes:
    """Raises InputError for a description that is not plain XML in UTF-8."""
    try:
        text = description.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(f"{path}: modelDescription.xml is not UTF-8") from None
    encoding = re.match(r"""<\?xml[^>]*\sencoding\s*=\s*["']([^"']*)""", text)
    if encoding and encoding[1].lower() not in ENCODINGS:
        raise InputError(f"{path}: modelDescription.xml says it is {encoding[1]!r}; FMI wants UTF-8")
    if "<!DOCTYPE" in text or "<!ENTITY" in text or "\0" in text:
        raise InputError(f"{path}: modelDescription.xml has a DOCTYPE or entities, which FMI does not use; refused")
    return description


def _check(path: Path, entries: list[zipfile.ZipInfo]) -> None:
    if len(entries) > MAX_ENTRIES:
        raise InputError(f"{path}: {len(entries)} entries; at most {MAX_ENTRIES} are accepted")
    size = sum(e.file_size for e in entries)
    packed = max(1, path.stat().st_size)
    if size > MAX_SIZE:
        raise InputError(f"{path}: {size / 2**20:.0f} MB unpacked; at most {MAX_SIZE // 2**20} MB are accepted")
    if size > MAX_RATIO * packed:
        raise InputError(f"{path}: unpacks to {size // packed} times its size; at most {MAX_RATIO} times is accepted")
    keys: set[str] = set()
    folders: dict[str, str] = {}
    for entry in entries:
        name, original = entry.filename, getattr(entry, "orig_filename", entry.filename)
        parts = name.rstrip("/").split("/")
        inside = [part.rstrip(".") or part if parts[0] == RESOURCES else part for part in parts]
        if "\\" in original or "\0" in original or len(name) > MAX_PATH or not all(_plain(part) for part in inside):
            raise InputError(f"{path}: entry {original[:80]!r} is not a plain relative path; refused")
        kind = stat.S_IFMT(entry.external_attr >> 16)
        if kind == stat.S_IFLNK:
            raise InputError(f"{path}: entry {name!r} is a symbolic link; refused")
        if kind not in (0, stat.S_IFREG, stat.S_IFDIR):
            raise InputError(f"{path}: entry {name!r} is neither a file nor a folder; refused")
        if entry.flag_bits & 1:
            raise InputError(f"{path}: entry {name!r} is encrypted; refused")
        key = _key(name.rstrip("/"))
        if key in keys:
            raise InputError(f"{path}: two entries named {name!r} (letter case does not count); refused")
        keys.add(key)
        for k in range(1, len(parts) + entry.is_dir()):
            folder = "/".join(parts[:k])
            if folders.setdefault(_key(folder), folder) != folder:
                raise InputError(
                    f"{path}: folders {folders[_key(folder)]!r} and {folder!r} differ in letter case only; refused"
                )
    for entry in entries:
        if not entry.is_dir() and _key(entry.filename) in folders:
            raise InputError(f"{path}: {entry.filename!r} is both a file and a folder; refused")


def _plain(part: str) -> bool:
    """A name that every file system takes as it is."""
    return (
        part not in ("", ".", "..")
        and part.rstrip(" .") == part
        and not any(c in ':<>"|?*' or ord(c) < 32 for c in part)
        and part.split(".")[0].strip().lower() not in DEVICES
        and len(part.encode("utf-8", "replace")) <= MAX_NAME
    )


def _key(name: str) -> str:
    """What names have in common that one system or another takes for the same."""
    name = "/".join(part.rstrip(".") for part in name.split("/"))
    return unicodedata.normalize("NFC", name).casefold()


def contents(path: Path, kind: str = FMU) -> tuple[str, tuple[str, ...]]:
    """SHA-256 and names of the files of any zip archive, checked without unpacking it; `kind`: what it should be, for
    messages. Raises InputError."""
    if not _status(path, kind).st_size:
        raise InputError(f"{path}: is empty")
    try:
        with path.open("rb") as file:
            sha256 = hashlib.file_digest(file, "sha256").hexdigest()
            with zipfile.ZipFile(file) as archive:
                entries = archive.infolist()
                _check(path, entries)
    except (InputError, MemoryError):
        raise
    except Exception as problem:  # zipfile raises many kinds for damaged files
        raise InputError(f"{path}: no readable zip archive ({one_line(problem)}), which {kind} is") from None
    return sha256, tuple(entry.filename for entry in entries if not entry.is_dir())


def member(path: Path, name: str) -> bytes:
    """The content of one entry. Raises InputError when it is damaged."""
    try:
        with zipfile.ZipFile(path) as content:
            return content.read(name)
    except MemoryError:
        raise
    except Exception as problem:
        raise InputError(f"{path}: damaged archive ({one_line(problem)}); export the FMU again") from None


def same_model(one: Path, other: Path) -> bool:
    """Whether two FMUs differ in nothing but platforms for which only one of them has libraries; False where one cannot
    be read."""
    try:
        with zipfile.ZipFile(one) as first, zipfile.ZipFile(other) as second:
            there, here = ({n for n in a.namelist() if not n.endswith("/")} for a in (first, second))
            both = {_platform(name) for name in there & here}
            if any(_platform(name) is None or _platform(name) in both for name in there ^ here):
                return False
            return both != {None} and all(first.read(name) == second.read(name) for name in there & here)
    except Exception:  # zipfile raises many kinds for damaged files
        return False


def _platform(name: str) -> str | None:
    """Whose library an entry is; None for any other."""
    parts = name.split("/")
    return parts[1] if parts[0] == "binaries" and len(parts) > 2 else None


def verify(archive: Archive) -> None:
    """Reads every entry against its checksum; nothing is written. Raises InputError."""
    try:
        with zipfile.ZipFile(archive.path) as content:
            damaged = content.testzip()
    except MemoryError:
        raise
    except Exception as problem:
        raise InputError(f"{archive.path}: damaged archive ({one_line(problem)}); export the FMU again") from None
    if damaged is not None:
        raise InputError(f"{archive.path}: damaged archive (checksum of {damaged!r}); export the FMU again")


def one_line(problem: BaseException) -> str:
    return " ".join(str(problem).split()) or type(problem).__name__
