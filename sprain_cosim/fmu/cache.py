"""Where FMUs are kept on this machine: unpacked once per content and verified whenever one is opened, and whole, so
that a study runs on with the files it began with.

    unpacked/<SHA-256>/content  the unpacked archive
    unpacked/<SHA-256>/manifest.json  of every file: size, SHA-256, and the times and number by which a change is
                                noticed
    files/<SHA-256>/<name>      files as they were when somebody asked to keep them

The folder is the user's own. One that others made is read and not written; one that others may write to is not used.
What cannot be written there goes to a folder of the user's own among the temporary ones, with one warning."""

from __future__ import annotations

import contextlib
import hashlib
import logging
import os
import stat
import tempfile
import zipfile
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import IO, Any

from ..errors import EnvironmentProblem, InputError
from ..files import read_json, write, write_json
from ..machine.face import PARENTS_TEMPORARY
from ..machine.here import SYSTEM
from . import archive
from .archive import Archive

CONTENT, MANIFEST, FORMAT = "content", "manifest.json", 1
UNPACKED = "unpacked"  # version 0.1 has a folder `fmus` of another layout in the same place
LENGTH = 32  # digits of the SHA-256 in names
LARGEST_MANIFEST = 16 << 20  # B
NAME = "sprain-cosim"
log = logging.getLogger("sprain_cosim")


def cache_folder() -> Path:
    """$SPRAIN_COSIM_CACHE, else sprain-cosim below $XDG_CACHE_HOME or the user's folder of caches (~/.cache; Windows:
    %LOCALAPPDATA%), else among the temporary folders."""
    own = os.environ.get("SPRAIN_COSIM_CACHE")
    if own:
        return Path(own)
    above = os.environ.get("XDG_CACHE_HOME")
    try:
        return _below(above) if above else _usual(os.environ.get("HOME"), os.environ.get("LOCALAPPDATA"))
    except RuntimeError:  # no HOME, and no account to take it from
        return temporary_folder()


@lru_cache(maxsize=8)
def _below(above: str) -> Path:
    return Path(above) / NAME


@lru_cache(maxsize=8)
def _usual(*_: str | None) -> Path:
    """Where these variables are as they are."""
    return SYSTEM.caches() / NAME


def temporary_folder() -> Path:
    """Of this user among the temporary folders; a child's temporary folder is its scratch, so its parent's counts."""
    return (
        Path(os.environ.get(PARENTS_TEMPORARY) or tempfile.gettempdir())
        / f"{NAME}-{os.getuid() if hasattr(os, 'getuid') else 'user'}"
    )


def unpacked(fmu: Path, sha256: str) -> Path:
    """The folder with the content of the FMU whose archive has this SHA-256: as it was made before, where that is
    undamaged, else from the file `fmu`.

    Raises InputError when the file has another content meanwhile or damaged entries, EnvironmentProblem when there is
    no place for it."""
    entry = f"{UNPACKED}/{sha256[:LENGTH]}"
    for root in _readable():
        if _sound(place := f"{root}/{entry}", sha256):
            return Path(place, CONTENT)
    checked = archive.read(fmu)
    if checked.sha256 != sha256:
        raise InputError(
            f"{fmu}: has changed since it was read (SHA-256 {sha256[:12]} then, {checked.sha256[:12]} now); run again"
        )
    return _unpack(checked, writable() / entry) / CONTENT


def kept(path: Path) -> tuple[Path, str]:
    """A copy of a file that stays as the file is now, and its SHA-256. Raises InputError when it cannot be read,
    EnvironmentProblem when there is no place for it."""
    try:
        content = path.read_bytes()
    except OSError as problem:
        raise InputError(f"{path}: cannot be read: {problem.strerror or problem}") from None
    sha256 = hashlib.sha256(content).hexdigest()
    return keep(path.name, content, sha256), sha256


def keep(name: str, content: bytes, sha256: str) -> Path:
    """A copy of a content under a name. Raises EnvironmentProblem when there is no place for it."""
    copy = found(name, sha256)
    if copy is None:
        copy = writable() / "files" / sha256[:LENGTH] / name
        with contextlib.suppress(OSError):
            SYSTEM.remove(copy)  # a damaged one may be protected from writing
        write(copy, content, "; set SPRAIN_COSIM_CACHE to a folder that can", parents=True)
        with contextlib.suppress(OSError):
            copy.chmod(0o444)
    return copy


def found(name: str, sha256: str) -> Path | None:
    """The copy of a content under a name, if there is an undamaged one."""
    for root in _readable():
        copy = root / "files" / sha256[:LENGTH] / name
        with contextlib.suppress(OSError):
            if copy.is_file() and file_sha256(copy) == sha256:
                return copy
    return None


def forget(sha256: str) -> None:
    """Removes what `unpacked` made."""
    for root in _readable():
        _remove(root / UNPACKED / sha256[:LENGTH])


def file_sha256(path: Path) -> str:
    """Raises OSError."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def writable() -> Path:
    """The folder that things are put into. Raises EnvironmentProblem when there is none."""
    own = cache_folder()
    why = _made(own)
    if not why:
        return own
    if not own.exists() and os.environ.get("SPRAIN_COSIM_CACHE"):
        raise EnvironmentProblem(f"{own}: {why}; set SPRAIN_COSIM_CACHE to a folder that can")
    other = temporary_folder()
    trouble = "" if other == own else _made(other)
    if trouble or other == own:
        raise EnvironmentProblem(
            f"{own}: {why}, {other}: {trouble or why}; set SPRAIN_COSIM_CACHE to a folder that can"
        )
    _warn(f"{own}: {why}; FMUs are unpacked to {other} instead (SPRAIN_COSIM_CACHE names another folder)")
    return other


# ---- places


def _readable() -> Iterator[Path]:
    """Folders to look in, the user's own choice first."""
    own = cache_folder()
    if _trusted(own):
        yield own
    other = temporary_folder()
    if other != own and other.is_dir() and _mine(other):
        yield other


def _made(root: Path) -> str:
    """Makes the folder and its parts; why it cannot be used, or ''."""
    default = "SPRAIN_COSIM_CACHE" not in os.environ or root == temporary_folder()
    try:
        root.mkdir(mode=0o700 if default else 0o755, parents=True, exist_ok=True)
        if default and _mine(root):
            root.chmod(0o700)
        for part in (UNPACKED, "files"):
            (root / part).mkdir(mode=0o755, exist_ok=True)
            if not os.access(root / part, os.W_OK | os.X_OK):
                return "cannot be written (Permission denied)"
    except OSError as problem:
        return f"cannot be written ({problem.strerror or problem})"
    if not _trusted(root) or (root == temporary_folder() and not _mine(root)):
        return "belongs to others, or can be written by others"
    return ""


def _trusted(root: Path) -> bool:
    """Whether nobody but its owner can change what is in it; the owner must be this user, root, or, of a folder that
    was named, whoever."""
    if not hasattr(os, "getuid"):
        return root.is_dir()
    for folder in (str(root), f"{root}/{UNPACKED}", f"{root}/files"):
        try:
            status = os.stat(folder, follow_symlinks=folder == str(root))
        except OSError:
            if folder == str(root):
                return False
            continue
        own_group = status.st_mode & stat.S_IWGRP and not (status.st_gid == status.st_uid == os.getuid())
        if not stat.S_ISDIR(status.st_mode) or status.st_mode & stat.S_IWOTH or own_group:
            return False
        if status.st_uid not in (os.getuid(), 0) and not os.environ.get("SPRAIN_COSIM_CACHE"):
            return False
    return True


def _mine(folder: Path) -> bool:
    try:
        status = folder.lstat()
    except OSError:
        return False
    return stat.S_ISDIR(status.st_mode) and (not hasattr(os, "getuid") or status.st_uid == os.getuid())


@lru_cache(maxsize=8)
def _warn(text: str) -> None:
    """Once for each process."""
    log.warning(text)


# ---- unpacked FMUs


def _unpack(checked: Archive, target: Path) -> Path:
    try:
        fresh = Path(tempfile.mkdtemp(dir=target.parent, prefix=".new-"))
        fresh.chmod(0o755)
    except OSError as problem:
        raise EnvironmentProblem(
            f"{target.parent}: cannot be written ({problem.strerror}); set SPRAIN_COSIM_CACHE to a folder that can"
        ) from None
    try:
        sums: dict[str, str] = {}
        with checked.path.open("rb") as file, zipfile.ZipFile(file) as content:
            for entry in content.infolist():
                destination = fresh / CONTENT / entry.filename
                if entry.is_dir():
                    destination.mkdir(parents=True, exist_ok=True)
                    continue
                destination.parent.mkdir(parents=True, exist_ok=True)
                with content.open(entry) as source, destination.open("xb") as sink:
                    sums[entry.filename] = _copy(source, sink, entry, checked.path)
                destination.chmod(0o444)
            file.seek(0)
            if hashlib.file_digest(file, "sha256").hexdigest() != checked.sha256:
                raise InputError(f"{checked.path}: was changed while it was read; run again")
        _note(fresh, checked.sha256, sums)
        _put(fresh, target, checked.sha256)
    except OSError as problem:
        raise EnvironmentProblem(
            f"{target.parent}: cannot be written ({problem.strerror}); free some space or set SPRAIN_COSIM_CACHE"
        ) from None
    except (InputError, EnvironmentProblem, MemoryError, ImportError):
        raise
    except Exception as problem:
        raise InputError(
            f"{checked.path}: damaged archive ({archive.one_line(problem)}); export the FMU again"
        ) from None
    finally:
        _remove(fresh)
    return target


def _copy(source: IO[bytes], sink: IO[bytes], entry: zipfile.ZipInfo, path: Path) -> str:
    """The SHA-256 of what was copied."""
    left, sums = entry.file_size, hashlib.sha256()
    while chunk := source.read(1 << 20):
        left -= len(chunk)
        if left < 0:
            raise InputError(f"{path}: entry {entry.filename!r} is larger than it says; refused")
        sums.update(chunk)
        sink.write(chunk)
    return sums.hexdigest()


def _note(entry: Path, sha256: str, sums: dict[str, str]) -> None:
    files = {name: [digest, *_marks((entry / CONTENT / name).lstat())] for name, digest in sums.items()}
    write_json(entry / MANIFEST, {"format": FORMAT, "archive": sha256, "files": files})


def _put(fresh: Path, target: Path, sha256: str) -> None:
    """Takes the place, unless another process has put the same there meanwhile."""
    for _ in range(10):
        try:
            SYSTEM.rename(fresh, target)
            return
        except OSError:
            if not target.exists():
                raise
        if _sound(str(target), sha256):
            return
        aside = Path(tempfile.mkdtemp(dir=target.parent, prefix=".old-"))
        with contextlib.suppress(OSError):
            SYSTEM.rename(target, aside / "entry")
        _remove(aside)
    raise OSError(0, "another process keeps changing it")


def _sound(place: str, sha256: str) -> bool:
    """Whether the entry there is what was unpacked. A file whose size, times and number are as noted is taken for
    unchanged; any other is read. What was added is removed. Once sound, it is looked into again when anything of it has
    changed."""
    try:
        noted = tuple(_marks(os.stat(f"{place}/{MANIFEST}")))
        folders, files = _listed(place, sha256, noted)
        now = tuple([_changed(os.lstat(f"{place}/{CONTENT}/{name}")) for name in folders + files])
        _verify(place, sha256, noted, now)
    except (OSError, InputError, KeyError, TypeError, ValueError, AttributeError):
        return False
    return True


@lru_cache(maxsize=64)
def _listed(place: str, sha256: str, noted: tuple[int, ...]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Folders and files of an entry whose manifest has these marks. Raises what reading it raises."""
    files = tuple(_manifest(Path(place), sha256)["files"])
    return tuple({"": None} | {name[:k]: None for name in files for k, c in enumerate(name) if c == "/"}), files


def _manifest(entry: Path, sha256: str) -> dict[str, Any]:
    if (entry / MANIFEST).stat().st_size > LARGEST_MANIFEST:
        raise ValueError("size")
    manifest: dict[str, Any] = read_json(entry / MANIFEST)
    if manifest["format"] != FORMAT or manifest["archive"] != sha256:
        raise ValueError("another archive")
    return manifest


@lru_cache(maxsize=64)
def _verify(place: str, sha256: str, noted: tuple[int, ...], now: tuple[tuple[int, ...], ...]) -> None:
    """Raises ValueError, or what reading raises, where the entry is not sound. `noted` and `now`, the marks of its
    manifest, folders and files, say when this is to be asked again."""
    entry = Path(place)
    manifest = _manifest(entry, sha256)
    there = dict(_files(entry / CONTENT))
    changed = dict[str, str]()
    for name, (digest, *marks) in manifest["files"].items():
        status = there.pop(name)
        if status.st_size != marks[0] or not stat.S_ISREG(status.st_mode):
            raise ValueError(name)
        if _marks(status) != marks:
            if file_sha256(entry / CONTENT / name) != digest:
                raise ValueError(name)
            changed[name] = digest
    for name in there:
        SYSTEM.remove(entry / CONTENT / name)
    if changed:  # copied or restored: the next opening need not read them again
        with contextlib.suppress(OSError, EnvironmentProblem):
            _note(entry, sha256, {name: values[0] for name, values in manifest["files"].items()})


def _marks(status: os.stat_result) -> list[int]:
    return [status.st_size, status.st_mtime_ns, status.st_ctime_ns, status.st_ino]


def _changed(status: os.stat_result) -> tuple[int, ...]:
    """What tells a change of a file or a folder, also of its kind or rights."""
    return status.st_size, status.st_mtime_ns, status.st_ctime_ns, status.st_ino, status.st_mode


def _files(folder: Path) -> Iterator[tuple[str, os.stat_result]]:
    """(path inside, status) of all that is no folder. Links are not followed."""
    waiting = [""]
    while waiting:
        inside = waiting.pop()
        with os.scandir(f"{folder}/{inside}") as listed:
            for found in listed:
                name = f"{inside}{found.name}"
                if found.is_dir(follow_symlinks=False):
                    waiting.append(f"{name}/")
                else:
                    yield name, os.lstat(found)  # what `found` holds itself lacks the number on Windows


def _remove(folder: Path) -> None:
    SYSTEM.remove_tree(folder)
