"""Child processes: started, limited, asked, ended. Everything that runs foreign code apart from this process goes
through here.

Frames are a length and JSON (the first request a pickle, which the parent made) on two pipes of their own; what a child
prints goes elsewhere: its last lines are kept for the record. A child ends with its parent; it is ended with its whole
process group."""

from __future__ import annotations

import contextlib
import json
import math
import os
import pickle
import select
import signal
import struct
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from time import monotonic
from typing import IO, Any

LENGTH = struct.Struct("<I")


FRAME_LIMIT = 1 << 26  # B, longer replies are not ours


@dataclass(frozen=True)
class Limits:
    """`trial` and `start` [s] wall time of one trial and of opening the FMUs; `cpu` [s] processor time of one trial,
    all threads; `memory` [B] address space; `recycle` trials per child; `growth` [B] of resident memory after which a
    child is replaced."""

    trial: float = 60.0
    start: float = 300.0
    cpu: float = 240.0
    memory: int = 16 << 30
    recycle: int = 10_000
    growth: int = 512 << 20


class Gone(Exception):
    """The child ended or was killed; says how."""

    def __init__(self, status: str, message: str) -> None:
        super().__init__(message)
        self.status = status


class Child:
    """The process itself: runs `module` with the ends of its two lines, the limit of memory and our process number as
    arguments."""

    def __init__(self, limits: Limits, module: str) -> None:
        self.trials, self.memory, self.grown = 0, 0, 0
        requests, self._to = os.pipe()
        self._from, replies = os.pipe()
        environment = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "PYTHONFAULTHANDLER": ""}
        self._process = subprocess.Popen(
            [sys.executable, "-m", module, str(requests), str(replies), str(limits.memory), str(os.getpid())],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            pass_fds=(requests, replies),
            start_new_session=True,
            env=environment,
        )
        os.close(requests)
        os.close(replies)
        self._poll = select.poll()
        self._poll.register(self._from, select.POLLIN)
        self._tail: deque[bytes] = deque(maxlen=4)
        assert self._process.stdout is not None
        self._reader = threading.Thread(target=self._drain, args=(self._process.stdout,), daemon=True)
        self._reader.start()
        self._closing = threading.Lock()
        self._closed = False

    def open(self, what: Any, limit: float) -> dict[str, Any]:
        """The first request; picklable. Raises Gone."""
        return self._exchange(pickle.dumps(what), limit)

    def ask(self, request: dict[str, Any], limit: float) -> dict[str, Any]:
        return self._exchange(json.dumps(request).encode(), limit)

    def note(self, memory: int) -> None:
        """Counts a trial; `memory` [B] resident after it. Growth is counted from the tenth trial on, when caches are
        warm."""
        self.trials += 1
        self.grown = memory - self.memory if self.memory else 0
        if self.trials == 10 or not self.memory:
            self.memory = memory

    def log(self) -> str:
        self._reader.join(0.2)
        text = b"".join(self._tail).decode("utf-8", "replace")
        return "\n".join(text.splitlines()[-20:])[-4000:]

    def close(self) -> None:
        with self._closing:
            if self._closed:
                return
            self._closed = True
            self._end()
            os.close(self._to)
            os.close(self._from)

    def _end(self) -> int:
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(self._process.pid, signal.SIGKILL)
        return self._process.wait()

    def _exchange(self, request: bytes, limit: float) -> dict[str, Any]:
        deadline = monotonic() + limit
        try:
            _write(self._to, request)
            length = LENGTH.unpack(self._read(LENGTH.size, deadline))[0]
            if length > FRAME_LIMIT:
                raise Gone("crashed", "the process wrote into the line to its parent")
            reply = json.loads(self._read(length, deadline))
        except (OSError, ValueError):
            raise self._how() from None
        assert isinstance(reply, dict)
        return reply

    def _read(self, count: int, deadline: float) -> bytes:
        data = b""
        while len(data) < count:
            left = deadline - monotonic()
            if left <= 0 or not self._poll.poll(1e3 * left):
                raise Gone("timeout", "overran its limit of wall time and was ended")
            piece = os.read(self._from, count - len(data))
            if not piece:
                raise self._how()
            data += piece
        return data

    def _how(self) -> Gone:
        try:
            code = self._process.wait(1.0)
        except subprocess.TimeoutExpired:
            return Gone("crashed", "closed the line to its parent")
        if code == -signal.SIGXCPU:
            return Gone("timeout", "overran its limit of processor time and was ended")
        if code < 0:
            return Gone("crashed", f"ended by signal {signal.Signals(-code).name}")
        return Gone("crashed", f"ended its process with exit code {code}")

    def _drain(self, stream: IO[bytes]) -> None:
        with stream, contextlib.suppress(OSError, ValueError):
            while piece := stream.read1(1 << 16):  # type: ignore[attr-defined]
                self._tail.append(piece[-4096:])


def _write(descriptor: int, data: bytes) -> None:
    view = memoryview(LENGTH.pack(len(data)) + data)
    while view:
        view = view[os.write(descriptor, view) :]


def _take(descriptor: int) -> bytes | None:
    def exactly(count: int) -> bytes | None:
        data = b""
        while len(data) < count:
            piece = os.read(descriptor, count - len(data))
            if not piece:
                return None
            data += piece
        return data

    head = exactly(LENGTH.size)
    return None if head is None else exactly(LENGTH.unpack(head)[0])


def _die_with_parent(parent: int) -> None:
    if sys.platform == "linux":
        import ctypes

        ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG
    if os.getppid() != parent:
        os._exit(1)


def resident() -> int:
    try:
        with open("/proc/self/statm", "rb") as file:
            return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        return 0


Answer = Callable[[dict[str, Any]], None]


def listen(requests: int, replies: int, memory: int, parent: int) -> tuple[Any, Iterator[Any], Answer]:
    """The child's side: what it was opened with (None if the parent is gone already), its requests, and the way to
    answer."""
    import resource

    _die_with_parent(parent)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    with contextlib.suppress(ValueError, OSError):
        resource.setrlimit(resource.RLIMIT_AS, (memory, memory))

    def answer(content: dict[str, Any]) -> None:
        _write(replies, json.dumps(content).encode())

    def asked() -> Iterator[Any]:
        while (request := _take(requests)) is not None:
            yield json.loads(request)

    first = _take(requests)
    return (None if first is None else pickle.loads(first)), asked(), answer


def allow_processor_time(seconds: float) -> None:
    """Processor time from here on, after which the kernel ends this process."""
    import resource

    used = sum(os.times()[:2])
    with contextlib.suppress(ValueError, OSError):
        resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(used + seconds), resource.getrlimit(resource.RLIMIT_CPU)[1]))
