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

import contextlib
import json
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
from time import monotonic, perf_counter
from typing import IO, Any

from .errors import SimulationError, SprainError
from .scenario import Scenario

LENGTH = struct.Struct("<I")
FRAME_LIMIT = 1 << 26  # B, longer replies are not ours


@dataclass(frozen=True)
class Limits:
    """`trial` and `start` [s] wall time of one trial and of opening the FMUs; `memory` [B] address space; `recycle` trials per child;
    `growth` [B] of resident memory after which a child is replaced."""

    trial: float = 60.0
    start: float = 300.0
    memory: int = 16 << 30
    recycle: int = 10_000
    growth: int = 512 << 20


@dataclass(frozen=True)
class Outcome:
    """How a trial ended: completed, failed (FMI error or a value that is not finite), crashed or timeout. `log` the last lines printed."""

    status: str
    message: str
    metrics: Mapping[str, float] = field(default_factory=dict)
    wall: float = 0.0
    attempts: int = 1
    log: str = ""


class Gone(Exception):
    """The child ended or was killed; says how."""

    def __init__(self, status: str, message: str) -> None:
        super().__init__(message)
        self.status = status


class Stopped(Exception):
    """`kill` was called while a trial ran."""


class Worker:
    """Drives one child after the other. `run` may be called from one thread, `kill` from any. Use as a context manager."""

    def __init__(self, scenario: Scenario, names: Sequence[str], limits: Limits | None = None) -> None:
        self.scenario, self.names, self.limits = scenario, tuple(names), limits or Limits()
        self._child: Child | None = None
        self._stopped = False
        self._last: tuple[Sequence[float], Mapping[str, float]] | None = None

    def run(self, values: Sequence[float]) -> Outcome:
        """One trial with `values` (d,) of the names. Raises Stopped after `kill`, SimulationError when the system cannot be opened at all or a
        fresh child disagrees with the one it replaces."""
        first: Gone | None = None
        for attempt in (1, 2):
            child = self._ready()
            try:
                reply = child.ask({"values": [float(v) for v in values]}, self.limits.trial)
            except Gone as gone:
                log = child.log()
                self._drop()
                if self._stopped:
                    raise Stopped from None
                if attempt == 2:
                    assert first is not None
                    return Outcome(gone.status, str(gone), attempts=2, log=log)
                first = gone
                continue
            if "error" in reply:
                raise SimulationError(reply["error"])
            child.trials += 1
            child.grown = reply["memory"] - child.memory if child.memory else 0
            if child.trials == 10 or not child.memory:
                child.memory = reply["memory"]
            outcome = Outcome(
                reply["status"], reply["message"], reply["metrics"], reply["wall"], attempt, "" if reply["status"] == "completed" else child.log()
            )
            if outcome.status == "completed":
                self._last = (values, outcome.metrics)
            return outcome
        raise AssertionError("unreachable")

    def kill(self) -> None:
        """Ends the child at once, grandchildren included."""
        self._stopped = True
        self._drop()

    def _ready(self) -> Child:
        if self._stopped:
            raise Stopped
        child = self._child
        if child is not None and (child.trials >= self.limits.recycle or child.grown > self.limits.growth):
            self._drop()
            child = self._child = self._fresh()
            if self._last is not None:
                values, before = self._last
                again = child.ask({"values": [float(v) for v in values]}, self.limits.trial)
                if again.get("metrics") != dict(before):
                    raise SimulationError("a fresh process gives other numbers for the same trial: a component keeps something between runs; --isolate it")
        if child is None:
            child = self._child = self._fresh()
        return child

    def _fresh(self) -> Child:
        child = Child(self.limits)
        try:
            reply = child.open((self.scenario, self.names), self.limits.start)
        except Gone as gone:
            log = child.log()
            child.close()
            if self._stopped:
                raise Stopped from None
            raise SimulationError(f"the system cannot be opened: {gone}{f'; last words: {log.splitlines()[-1]}' if log else ''}") from None
        if "error" in reply:
            child.close()
            raise SimulationError(reply["error"])
        if self._stopped:
            child.close()
            raise Stopped
        return child

    def _drop(self) -> None:
        child, self._child = self._child, None
        if child is not None:
            child.close()

    def __enter__(self) -> Worker:
        return self

    def __exit__(self, *_: object) -> None:
        self.kill()


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
    scenario, names = first
    try:
        session = scenario.open()
    except SprainError as problem:
        answer({"error": str(problem)})
        return
    answer({"memory": _resident()})
    with session:
        for request in requests:
            began = perf_counter()
            try:
                result = session.run(dict(zip(names, request["values"], strict=True)))
                status, message, metrics = result.status, result.message, result.metrics
            except SprainError as problem:
                status, message, metrics = "failed", str(problem), {}
            answer({"status": status, "message": message, "metrics": metrics, "wall": perf_counter() - began, "memory": _resident()})


if __name__ == "__main__":
    serve(*(int(argument) for argument in sys.argv[1:5]))
    os._exit(0)  # what a foreign library does at the end of a process is not our matter
