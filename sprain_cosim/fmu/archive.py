"""The FMU as an archive: checked before anything is unpacked, unpacked once into a folder named after its content."""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import stat
import tempfile
import unicodedata
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from ..errors import EnvironmentProblem, InputError

MAX_ENTRIES = 10_000
MAX_SIZE = 512 * 2**20
MAX_RATIO = 200
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
    """A file that passed the checks. `description` is the raw modelDescription.xml, `names` all files inside."""

    path: Path
    sha256: str
    description: bytes
    names: tuple[str, ...]


def cache_folder() -> Path:
    """$SPRAIN_COSIM_CACHE, else sprain-cosim below $XDG_CACHE_HOME or ~/.cache."""
    own = os.environ.get("SPRAIN_COSIM_CACHE")
    if own:
        return Path(own)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "sprain-cosim"


def read(path: Path) -> Archive:
    """Checks the archive without unpacking it. Raises InputError in one line."""
    if not path.is_file():
        raise InputError(f"{path}: {'is a folder, not an FMU file' if path.is_dir() else 'no such file'}")
    try:
        data = path.read_bytes()
    except OSError as problem:
        raise InputError(f"{path}: cannot be read: {problem.strerror or problem}") from None
    try:
        with zipfile.ZipFile(path) as archive:
            entries = archive.infolist()
            _check(path, entries)
            if "modelDescription.xml" not in archive.namelist():
                raise InputError(f"{path}: no modelDescription.xml at the top of the archive, so it is not an FMU")
            description = archive.read("modelDescription.xml")
    except InputError:
        raise
    except Exception as problem:  # zipfile raises many kinds for damaged files
        why = "its directory is damaged" if isinstance(problem, OSError) else _one_line(problem)
        raise InputError(f"{path}: not a readable zip archive ({why}); export the FMU again") from None
    try:
        text = description.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(f"{path}: modelDescription.xml is not UTF-8") from None
    encoding = re.match(r"""<\?xml[^>]*\sencoding\s*=\s*["']([^"']*)""", text)
    if encoding and encoding[1].lower() not in ENCODINGS:
        raise InputError(f"{path}: modelDescription.xml says it is {encoding[1]!r}; FMI wants UTF-8")
    if "<!DOCTYPE" in text or "<!ENTITY" in text or "\0" in text:
        raise InputError(f"{path}: modelDescription.xml has a DOCTYPE or entities, which FMI does not use; refused")
    names = tuple(e.filename for e in entries if not e.is_dir())
    return Archive(path, hashlib.sha256(data).hexdigest(), description, names)


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
        if "\\" in original or "\0" in original or len(name) > MAX_PATH or not all(_plain(part) for part in parts):
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
    return unicodedata.normalize("NFC", name).casefold()


def member(path: Path, name: str) -> bytes:
    """The content of one entry. Raises InputError when it is damaged."""
    try:
        with zipfile.ZipFile(path) as content:
            return content.read(name)
    except Exception as problem:
        raise InputError(f"{path}: damaged archive ({_one_line(problem)}); export the FMU again") from None


def verify(archive: Archive) -> None:
    """Reads every entry against its checksum; nothing is written. Raises InputError."""
    try:
        with zipfile.ZipFile(archive.path) as content:
            damaged = content.testzip()
    except Exception as problem:
        raise InputError(f"{archive.path}: damaged archive ({_one_line(problem)}); export the FMU again") from None
    if damaged is not None:
        raise InputError(f"{archive.path}: damaged archive (checksum of {damaged!r}); export the FMU again")


def forget(archive: Archive) -> None:
    """Removes what `unpack` made."""
    shutil.rmtree(cache_folder() / "fmus" / archive.sha256[:32], ignore_errors=True)


def unpack(archive: Archive) -> Path:
    """The folder with the archive's content: made once per content, safe against processes that do the same at the same
    time.

    Raises InputError for damaged entries, EnvironmentProblem when the cache cannot be written."""
    root = cache_folder() / "fmus"
    target = root / archive.sha256[:32]
    if target.is_dir():
        return target
    try:
        root.mkdir(parents=True, exist_ok=True)
        fresh = Path(tempfile.mkdtemp(dir=root, prefix=".new-"))
    except OSError as problem:
        raise EnvironmentProblem(
            f"{root}: cannot be written ({problem.strerror}); set SPRAIN_COSIM_CACHE to a folder that can"
        ) from None
    try:
        with zipfile.ZipFile(archive.path) as content:
            for entry in content.infolist():
                destination = fresh / entry.filename
                if entry.is_dir():
                    destination.mkdir(parents=True, exist_ok=True)
                    continue
                destination.parent.mkdir(parents=True, exist_ok=True)
                with content.open(entry) as source, destination.open("xb") as sink:
                    _copy(source, sink, entry, archive.path)
        try:
            fresh.rename(target)
        except OSError:
            if not target.is_dir():
                raise
    except OSError as problem:
        raise EnvironmentProblem(
            f"{root}: cannot be written ({problem.strerror}); free some space or set SPRAIN_COSIM_CACHE"
        ) from None
    except InputError:
        raise
    except Exception as problem:
        raise InputError(f"{archive.path}: damaged archive ({_one_line(problem)}); export the FMU again") from None
    finally:
        shutil.rmtree(fresh, ignore_errors=True)
    return target


def _copy(source: IO[bytes], sink: IO[bytes], entry: zipfile.ZipInfo, path: Path) -> None:
    left = entry.file_size
    while chunk := source.read(1 << 20):
        left -= len(chunk)
        if left < 0:
            raise InputError(f"{path}: entry {entry.filename!r} is larger than it says; refused")
        sink.write(chunk)


def _one_line(problem: BaseException) -> str:
    return " ".join(str(problem).split()) or type(problem).__name__
