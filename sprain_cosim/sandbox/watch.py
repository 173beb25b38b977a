"""What a sandboxed process tries, seen from outside: the kernel asks a supervisor about each refused and each notable
system call (seccomp user notification). The supervisor only notes and answers: refused calls stay refused, the others
go on and meet Landlock. No decision rests on what it reads from the process's memory, which may change meanwhile.

For `check`; a study's processes run under the same filter without a supervisor."""

from __future__ import annotations

import contextlib
import ctypes
import ipaddress
import os
import platform
import select
import socket
import struct
import threading
from dataclasses import dataclass, field
from pathlib import Path

from .confinement import Confinement
from .kernel import libc, offered
from .syscalls import COLUMNS, EPERM, OPENING, Refusal

RECEIVE, SEND = 0xC0502100, 0xC0182101  # SECCOMP_IOCTL_NOTIF_RECV, _SEND
CONTINUE = 1
NOTICE = struct.Struct("<QIIiIQ6Q")  # id, process, flags, call, architecture, instruction pointer, arguments
LONGEST = 4096  # B of a path
WRITING, CREATING = 0o3, 0o100  # of open's flags
MOST = 200  # attempts kept


@dataclass(frozen=True)
class Attempt:
    """A call that was made: its `topic` (as in `syscalls`, or files, folder, umask, threads), its `name`, the path or
    address in it where there is one; `refused` by the sandbox or not; `writes` of a file that is opened so."""

    topic: str
    name: str
    detail: str = ""
    refused: bool = False
    writes: bool = False


@dataclass
class Watch:
    """Open before the process starts, pass `far` to it, and it to `enter`. Use as a context manager. When a file of the
    name `mark` is opened, what was seen before it is forgotten."""

    confinement: Confinement
    attempts: dict[Attempt, None] = field(default_factory=dict)
    mark: str = ""

    def __enter__(self) -> Watch:
        self.far: socket.socket | None = None
        self._over = threading.Event()
        if not offered().seccomp:  # nothing can be seen
            return self
        self._near, self.far = socket.socketpair(socket.AF_UNIX, socket.SOCK_STREAM)
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self.far is None:
            return
        self._over.set()
        self._thread.join(2.0)
        self._near.close()
        self.far.close()

    def _serve(self) -> None:
        listener = self._listener()
        if listener is None:
            return
        names = {number: name for name, number in COLUMNS[platform.machine()].items()}
        poll = select.poll()
        poll.register(listener, select.POLLIN)
        try:
            while not self._over.is_set():
                if any(event & select.POLLIN for _, event in poll.poll(100)):
                    self._answer(listener, names)
        finally:
            os.close(listener)  # what still asks is told that there is no such call

    def _listener(self) -> int | None:
        poll = select.poll()
        poll.register(self._near, select.POLLIN)
        while not self._over.is_set():
            if poll.poll(100):
                _, descriptors, _, _ = socket.recv_fds(self._near, 1, 1)
                return descriptors[0] if descriptors else None
        return None

    def _answer(self, listener: int, names: dict[int, str]) -> None:
        notice = ctypes.create_string_buffer(NOTICE.size)
        if libc().ioctl(listener, ctypes.c_ulong(RECEIVE), notice) != 0:
            return  # the process is gone meanwhile
        key, process, _, number, _, _, *arguments = NOTICE.unpack(notice.raw)
        error, flags = EPERM, 0
        try:
            name = names.get(number, str(number))
            refusal = self._refusals(process).get(name)
            refused = refusal is not None and refusal.refuses(tuple(arguments))
            if refused and refusal is not None:
                error = refusal.error
            else:
                error, flags = 0, CONTINUE
            self._note(name, process, tuple(arguments), refusal if refused else None)
        finally:
            answer = ctypes.create_string_buffer(struct.pack("<QqiI", key, 0, -error, flags), 24)
            libc().ioctl(listener, ctypes.c_ulong(SEND), answer)

    def _refusals(self, process: int) -> dict[str, Refusal]:
        return self.confinement.refusals(process, offered())

    def _note(self, name: str, process: int, arguments: tuple[int, ...], refusal: Refusal | None) -> None:
        if len(self.attempts) >= MOST:
            return
        attempt: Attempt | None
        if name in OPENING or name == "truncate":
            attempt = self._opening(name, process, arguments)
        elif refusal is not None or name in ("execve", "connect", "bind"):
            detail = ""
            if name == "execve":
                detail = _text(process, arguments[0])
            elif name in ("connect", "bind"):
                detail = _address(process, arguments[1], arguments[2])
            topic = refusal.topic if refusal else {"execve": "programs"}.get(name, "sockets")
            attempt = Attempt(topic, name, detail, refusal is not None)
        elif name in ("clone", "fork", "vfork"):
            attempt = Attempt("threads" if name == "clone" and arguments[0] & 0x10000 else "processes", name)
        elif name in ("chdir", "fchdir"):
            attempt = Attempt("folder", name, _text(process, arguments[0]) if name == "chdir" else "")
        else:
            attempt = Attempt(name, name)
        if attempt is not None:
            if self.mark and Path(attempt.detail).name == self.mark:
                self.attempts.clear()
            self.attempts.setdefault(attempt)

    def _opening(self, name: str, process: int, arguments: tuple[int, ...]) -> Attempt | None:
        """None for what it reads by right, and for what is not there."""
        at = name in ("openat", "openat2")
        path = _resolved(process, _text(process, arguments[1 if at else 0]), arguments[0] if at else None)
        if name == "creat" or name == "truncate":
            flags = WRITING | CREATING
        elif name == "openat2":
            flags = struct.unpack("<Q", _memory(process, arguments[2], 8) or bytes(8))[0]
        else:
            flags = arguments[2 if at else 1]
        writes = bool(flags & (WRITING | CREATING))
        if writes:
            free = _inside(path, (self.confinement.scratch,)) or path == "/dev/null"
            return Attempt("files", name, path, not free, True) if path != "/dev/null" else None
        if _inside(path, (self.confinement.scratch, "/dev/null", f"/proc/{process}", *self.confinement.paths())):
            return None
        return Attempt("files", name, path, True) if os.path.exists(path) else None


def _inside(path: str, folders: tuple[str, ...]) -> bool:
    real = os.path.realpath(path)
    return any(real == (f := os.path.realpath(folder)) or real.startswith(f.rstrip("/") + "/") for folder in folders)


def _memory(process: int, place: int, size: int) -> bytes:
    try:
        with Path(f"/proc/{process}/mem").open("rb", buffering=0) as memory:
            memory.seek(place)
            return memory.read(size)
    except (OSError, ValueError, OverflowError):
        return b""


def _text(process: int, place: int) -> str:
    """A string; read by pages, since the next one may not be there."""
    found = b""
    while len(found) < LONGEST and b"\0" not in found:
        piece = _memory(process, place + len(found), 256 - (place + len(found)) % 256)
        if not piece:
            break
        found += piece
    return found.partition(b"\0")[0].decode("utf-8", "replace")


def _resolved(process: int, path: str, folder: int | None) -> str:
    if not path.startswith("/"):
        number = None if folder is None else ctypes.c_int(folder & 0xFFFFFFFF).value
        link = f"/proc/{process}/cwd" if number is None or number == -100 else f"/proc/{process}/fd/{number}"
        with contextlib.suppress(OSError):
            path = os.path.join(os.readlink(link), path)
    return os.path.normpath(path).replace("/proc/self", f"/proc/{process}", 1)


def _address(process: int, place: int, size: int) -> str:
    data = _memory(process, place, min(size, 128))
    if len(data) >= 8 and data[:2] == b"\x02\x00":
        return f"{ipaddress.IPv4Address(data[4:8])} port {int.from_bytes(data[2:4], 'big')}"
    if len(data) >= 24 and data[:2] == b"\x0a\x00":
        return f"{ipaddress.IPv6Address(data[8:24])} port {int.from_bytes(data[2:4], 'big')}"
    if data[:2] == b"\x01\x00":
        return data[2:].partition(b"\0")[0].decode("utf-8", "replace") if data[2:3] != b"\0" else "an abstract address"
    return ""
