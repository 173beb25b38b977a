"""A child process that runs trials, so that a crash, a hang or a leak of an FMU costs one trial.

parent                                   child (own session; ends with its parent)
  Worker.run(trial, values)  --request-->  session.run(values)      the session is opened once
  Outcome                    <--reply---   status, message, metrics, wall time, memory

Frames are a length and JSON (the first request a pickle of the scenario, which the parent made) on two pipes of their own; what the FMU
prints goes elsewhere: its last lines are kept for the record. A child that crashes or overruns its time is killed with its
whole process group and the trial repeated once on a fresh child. A child is replaced after `recycle` trials or when its memory has grown;
the fresh one repeats the last trial and must agree to the bit.
"""

from __future__ import annotations

import base64
import contextlib
import gzip
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
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from time import monotonic, perf_counter
from typing import IO, Any, Protocol

from . import archive
from .archive import cache_folder
from .errors import SimulationError, SprainError
from .result import Result

LENGTH = struct.Struct("<I")
FRAME_LIMIT = 1 << 26  # B, longer replies are not ours


@dataclass(frozen=True)
class Limits:
    """`trial` and `start` [s] wall time of one trial and of opening the FMUs; `cpu` [s] processor time of one trial, all threads; `memory` [B]
    address space; `recycle` trials per child; `growth` [B] of resident memory after which a child is replaced."""

    trial: float = 60.0
    start: float = 300.0
    cpu: float = 240.0
    memory: int = 16 << 30
    recycle: int = 10_000
    growth: int = 512 << 20


@dataclass(frozen=True)
class Outcome:
    """How a trial ended: completed, failed (FMI error or a value that is not finite), crashed, timeout or lost (with the machine that ran it,
    several times). `log` the last lines printed. Where a record was asked for, and of a failed trial, `trajectory` is the record as a gzipped
    signals.csv and `about` its scheme, scheme_reason, warning, coupling_error and status."""

    status: str
    message: str
    metrics: Mapping[str, float] = field(default_factory=dict)
    wall: float = 0.0
    attempts: int = 1
    log: str = ""
    trajectory: bytes = b""
    about: Mapping[str, Any] = field(default_factory=dict)


class Session(Protocol):
    """What a child runs trials with: an open scenario, or a stand-in of known duration."""

    def run(self, parameters: Mapping[str, float]) -> Any: ...
    def __enter__(self) -> Session: ...
    def __exit__(self, *_: object) -> None: ...


class Openable(Protocol):
    """A scenario, as far as a child needs it; picklable."""

    def open(self) -> Any: ...


class Gone(Exception):
    """The child ended or was killed; says how."""

    def __init__(self, status: str, message: str) -> None:
        super().__init__(message)
        self.status = status


class Stopped(Exception):
    """`kill` was called while a trial ran."""


class Worker:
    """Drives one child after the other. `run` may be called from one thread, `kill` from any. Use as a context manager."""

    def __init__(self, scenario: Openable, names: Sequence[str], limits: Limits | None = None) -> None:
        self.scenario, self.names, self.limits = scenario, tuple(names), limits or Limits()
        self._child: Child | None = None
        self._stopped = self._opened = False
        self._last: tuple[Sequence[float], Mapping[str, float]] | None = None

    def run(self, values: Sequence[float], record: bool = False) -> Outcome:
        """One trial with `values` (d,) of the names, with its trajectory where `record`. Raises Stopped after `kill`, SimulationError when the
        system cannot be opened at all or a fresh child disagrees with the one it replaces."""
        numbers = [float(v) for v in values]
        request = {"values": numbers, "record": record}
        for attempt in (1, 2):
            try:
                child = self._ready()
                reply = child.ask(request, self.limits.trial)
                break
            except Gone as gone:
                log = self._child.log() if self._child else ""
                self._drop()
                if self._stopped:
                    raise Stopped from None
                if attempt == 2:
                    return Outcome(gone.status, str(gone), attempts=2, log=log)
        if "error" in reply:
            raise SimulationError(reply["error"])
        child.note(reply["memory"])
        completed = reply["status"] == "completed"
        if completed:
            self._last = (numbers, reply["metrics"])
        trajectory, about = base64.b64decode(reply.get("trajectory", "")), reply.get("about", {})
        log = "" if completed else child.log()
        return Outcome(reply["status"], reply["message"], reply["metrics"], reply["wall"], attempt, log, trajectory, about)

    def kill(self) -> None:
        """Ends the child at once, grandchildren included."""
        self._stopped = True
        self._drop()

    def _ready(self) -> Child:
        """The child for the next trial. Raises Gone when one that replaces another ends at the trial that it is to repeat."""
        if self._stopped:
            raise Stopped
        spent = self._child is not None and (self._child.trials >= self.limits.recycle or self._child.grown > self.limits.growth)
        if spent:
            self._drop()
        if self._child is None:
            self._child = self._fresh()
            if spent and self._last is not None:
                values, before = self._last
                if self._child.ask({"values": values}, self.limits.trial).get("metrics") != before:
                    raise SimulationError("a fresh process gives other numbers for the same trial: a component keeps something between runs")
        return self._child

    def _fresh(self) -> Child:
        """A child that has opened the system. The first on this machine to open an FMU may compile for it, and what it compiled may round otherwise
        than what later ones load; so it runs no trial."""
        marks = _marks(self.scenario)
        if any(not mark.exists() for mark in marks):
            self._open().close()
            for mark in marks:
                with contextlib.suppress(OSError):
                    mark.parent.mkdir(parents=True, exist_ok=True)
                    mark.touch()
        return self._open()

    def _open(self) -> Child:
        for again in (self._opened, False):  # what has opened before gets a second chance: the machine may have been short of something
            child = Child(self.limits)
            try:
                reply = child.open((self.scenario, self.names, self.limits), self.limits.start)
            except Gone as gone:
                log = child.log()
                child.close()
                if self._stopped:
                    raise Stopped from None
                if again:
                    continue
                raise SimulationError(f"the system cannot be opened: {gone}{f'; last words: {log.splitlines()[-1]}' if log else ''}") from None
            if "error" in reply or self._stopped:
                child.close()
                if self._stopped:
                    raise Stopped
                raise SimulationError(reply["error"])
            self._opened = True
            return child
        raise AssertionError("unreachable")

    def _drop(self) -> None:
        child, self._child = self._child, None
        if child is not None:
            child.close()

    def __enter__(self) -> Worker:
        return self

    def __exit__(self, *_: object) -> None:
        self.kill()


def _marks(scenario: Openable) -> list[Path]:
    """Files whose being there says that an FMU has been opened on this machine before."""
    fmus: Mapping[str, Path] = getattr(scenario, "fmus", {})
    return [cache_folder() / "opened" / archive.read(path).sha256[:32] for path in fmus.values()]


class Child:
    """The process itself: runs `module` with the ends of its two lines, the limit of memory and our process number as arguments."""

    def __init__(self, limits: Limits, module: str = "sprain_cosim.isolation") -> None:
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
        """Counts a trial; `memory` [B] resident after it. Growth is counted from the tenth trial on, when caches are warm."""
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


def _resident() -> int:
    try:
        with open("/proc/self/statm", "rb") as file:
            return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        return 0


Answer = Callable[[dict[str, Any]], None]


def listen(requests: int, replies: int, memory: int, parent: int) -> tuple[Any, Iterator[Any], Answer]:
    """The child's side: what it was opened with (None if the parent is gone already), its requests, and the way to answer."""
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


def serve(*arguments: int) -> None:
    """The child: opens the scenario it is sent, then answers one request per trial until the line closes."""
    first, requests, answer = listen(*arguments)
    if first is None:
        return
    scenario, names, limits = first
    try:
        session = scenario.open()
    except SprainError as problem:
        answer({"error": str(problem)})
        return
    answer({"memory": _resident()})
    with session:
        for request in requests:
            began = perf_counter()
            _allow(limits.cpu)
            try:
                result = session.run(dict(zip(names, request["values"], strict=True)))
                wall = perf_counter() - began
                reply = {"status": result.status, "message": result.message, "metrics": result.metrics}
                if (request.get("record") or result.status != "completed") and isinstance(result, Result):
                    reply |= _record(result)
            except SprainError as problem:
                wall, reply = perf_counter() - began, {"status": "failed", "message": str(problem), "metrics": {}}
            answer(reply | {"wall": wall, "memory": _resident()})


def _record(result: Result) -> dict[str, Any]:
    about = {key: getattr(result, key) for key in ("status", "scheme", "scheme_reason", "warning", "coupling_error")}
    return {"trajectory": base64.b64encode(gzip.compress(result.csv().encode(), 1, mtime=0)).decode(), "about": about}


def _allow(seconds: float) -> None:
    """Processor time from here on, after which the kernel ends this process."""
    import resource

    used = sum(os.times()[:2])
    with contextlib.suppress(ValueError, OSError):
        resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(used + seconds), resource.getrlimit(resource.RLIMIT_CPU)[1]))


if __name__ == "__main__":
    serve(*(int(argument) for argument in sys.argv[1:5]))
    os._exit(0)  # what a foreign library does at the end of a process is not our matter
