"""Processes: started, limited, asked, ended. Whatever runs apart from this process goes through here.

    parent                                     child: own session and group, ends with its parent
    Child(module, limits)     -- starts -->    serve(handlers): its limits first
    child.open(subject)       -- pickle -->    handlers(subject) opens it, gives functions by name
    child.call(name, ...)     -- JSON   -->    handlers[name](...)
                              <-- JSON --      {"value": ...} or {"error": message, "kind": class}
    child.close()             -- ends it with all that it has started

An error travels by class: a SprainError that a handler raises is raised by `call` as the same class with the same
message. What a child prints goes elsewhere than its replies: the last lines are kept for the record.

Every frame carries the trial that it belongs to, a number of its own, the process that wrote it and a checksum. A reply
of another process (a copy that foreign code made of itself), to another request or of other bytes than were written
is none: the child counts as crashed.

A child that is to run foreign code works in a scratch folder of its own, which is gone after it, and enters a sandbox
before the code is loaded. No child imports from the current folder."""

from __future__ import annotations

import contextlib
import json
import math
import os
import pickle
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import zlib
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from pathlib import Path
from time import monotonic
from typing import IO, Any, NoReturn, cast

from .errors import EnvironmentProblem, InputError, SprainError, visible
from .fork_server import Copy, ForkServer, ServerGone, copy_now, copy_of_this, drop_server, server_for
from .machine.face import PARENTS_TEMPORARY
from .machine.here import SYSTEM
from .sandbox.confinement import Confinement, enter
from .sandbox.watch import Watch

HEADER = struct.Struct("<IqQI")  # length, trial, number, process; a checksum of these and the content follows
CHECKSUM = struct.Struct("<I")
FRAME_LIMIT = 1 << 26  # B, longer replies are not ours
AT_ONCE = 1 << 16  # B, read of a line
TAIL = 1 << 14  # B, of what a child printed: kept by size, for a child may print in many small pieces
NO_TRIAL = -1
FACTOR, LEAST = 20.0, 10.0  # a learned limit of wall time: times the median, s
ENOUGH, KEPT = 5, 101  # trials that it is learned from, at least and at most
FIRST_TRIAL, FIRST_START = 60.0, 60.0  # s, before anything is known
FIRST_RUN = 600.0  # s, of a run that is none of a study
LONGEST = 1e7  # s, a limit of wall time: what systems count to
CORES = 4.0  # s of processor time per s of wall time
ROOT = Path(__file__).parent.parent  # of the package
STRANGE = "something else than the process wrote into the line to its parent"
START = (  # packages that lie beside this one, in a clone that is not installed, come last
    "import runpy, sys; from importlib import machinery, util; root, module = sys.argv.pop(1), sys.argv.pop(1); "
    "spec = machinery.PathFinder.find_spec('sprain_cosim', [root]); own = util.module_from_spec(spec); "
    "sys.modules['sprain_cosim'] = own; spec.loader.exec_module(own); "  # this package, whichever else is installed
    "root in sys.path or sys.path.append(root); runpy.run_module(module, run_name='__main__', alter_sys=True)"
)
BINARY = b"\0"  # begins a reply that is bytes, as JSON never does
SINGLE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "PYTHONFAULTHANDLER": ""}

Handlers = Mapping[str, Callable[..., Any]]
_serving = False  # whether this process is a child


@dataclass(frozen=True)
class Limits:
    """What a child may use.

    trial    s of wall time of one trial; None: learned from those before it, see Allowance
    start    [s] of wall time of opening the FMUs; None: learned likewise
    cpu      s of processor time of one trial, all threads; None: CORES times its wall time
    memory   B of address space
    recycle  trials per child
    growth   B of resident memory after which a child is replaced
    """

    trial: float | None = None
    start: float | None = None
    cpu: float | None = None
    memory: int = 16 << 30
    recycle: int = 10_000
    growth: int = 512 << 20

    def __post_init__(self) -> None:
        for limit in (self.trial, self.start):
            if limit is not None and not limit <= LONGEST:
                raise InputError(f"a limit of wall time of {limit:g} s: at most {LONGEST:g} s, which is 116 days")

    def of_trials(self, first: float | None = None) -> Allowance:
        """`first` [s] until some have finished; None: FIRST_TRIAL."""
        return Allowance(self.trial, FIRST_TRIAL if first is None else first)

    def of_starts(self) -> Allowance:
        """Opening may take as long as a trial at least, where that is stated."""
        return Allowance(self.start, max(FIRST_START, self.trial or 0.0), max(LEAST, self.trial or 0.0), enough=1)

    def processor_time(self, trial: float) -> float:
        """[s] that a trial of at most `trial` [s] of wall time may take."""
        return CORES * trial if self.cpu is None else self.cpu


class Allowance:
    """The wall time [s] that something may take which happens again and again.

    A stated limit stays. Else it is `first` until `enough` of them have finished, then FACTOR times the median of the
    first KEPT, but not less than `least`; rounded up to 1, 2 or 5 times a power of ten, so that machines of much the
    same speed have the same one."""

    def __init__(self, stated: float | None, first: float, least: float = LEAST, enough: int = ENOUGH) -> None:
        self.stated, self.finished = stated, 0
        self._least, self._enough = least, enough
        self._taken: list[float] = []
        self.seconds = first if stated is None else stated

    def note(self, seconds: float) -> None:
        """One has finished, after `seconds` [s]."""
        self.finished += 1
        if self.stated is None and self.finished <= KEPT:
            self._taken.append(seconds)
            if self.finished >= self._enough:
                from statistics import median

                self.seconds = max(self._least, round_up(FACTOR * median(self._taken)))

    @property
    def origin(self) -> str:
        """Where the limit comes from, behind it."""
        if self.stated is not None:
            return "as stated"
        if self.finished < self._enough:
            return f"until {self._enough} have finished" if self._enough > 1 else "the first time"
        return f"{FACTOR:g} times the median before it, at least {self._least:g} s"


def round_up(seconds: float) -> float:
    """To 1, 2 or 5 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(max(seconds, 1e-9)))
    return next(step * power for step in (1.0, 2.0, 5.0, 10.0) if seconds <= step * power * (1 + 1e-9))


class ProcessEnded(Exception):
    """The child ended or was ended; the message says how. `status`: crashed or timeout. `killed` whether somebody else
    did it, such as a machine short of memory."""

    def __init__(self, status: str, message: str, killed: bool = False) -> None:
        super().__init__(message)
        self.status, self.killed = status, killed


class Overrun(ProcessEnded):
    """The child did not answer within its limit of wall time."""

    def __init__(self, limit: float, origin: str = "") -> None:
        """`limit` [s], `origin` where it comes from."""
        stated = f"{limit:g} s: {origin}" if origin else f"{limit:g} s"
        super().__init__("timeout", f"overran its limit of wall time ({stated}) and was ended")
        self.limit = limit

    @property
    def cure(self) -> str:
        """What gives it more time."""
        return f'--trial-limit "{round_up(2 * self.limit):g} s" gives it more time'


# ---- the line between the two


@dataclass(frozen=True)
class Frame:
    """What travels: `trial` it belongs to, `number` of the request, `process` that wrote it, `content`."""

    content: bytes
    trial: int = NO_TRIAL
    number: int = 0
    process: int = 0


class Line:
    """Frames over two pipes."""

    def __init__(self, source: int, sink: int) -> None:
        """`source`, `sink`: descriptors to read from and to write to."""
        self._source, self._sink = SYSTEM.pipe(source), sink
        self._ahead = bytearray()  # read already

    def send(self, frame: Frame) -> None:
        """In the name of this process. Raises OSError when the other end is closed."""
        head = HEADER.pack(len(frame.content), frame.trial, frame.number, os.getpid())
        view = memoryview(head + CHECKSUM.pack(_checksum(head, frame.content)) + frame.content)
        while view:
            view = view[os.write(self._sink, view) :]

    def receive(self, deadline: float = math.inf) -> Frame:
        """`deadline` [s] by `monotonic`. Raises TimeoutError after it, EOFError when the other end is closed,
        ValueError for what is no frame."""
        start = self._read(HEADER.size + CHECKSUM.size, deadline)
        head, checksum = start[: HEADER.size], CHECKSUM.unpack(start[HEADER.size :])[0]
        length, trial, number, process = HEADER.unpack(head)
        if length > FRAME_LIMIT:
            raise ValueError(STRANGE)
        content = self._read(length, deadline)
        if checksum != _checksum(head, content):
            raise ValueError(STRANGE)
        return Frame(content, trial, number, process)

    def close(self) -> None:
        os.close(self._sink)
        self._source.close()

    def _read(self, count: int, deadline: float) -> bytes:
        while (lacking := count - len(self._ahead)) > 0:
            left = deadline - monotonic() if deadline < math.inf else math.inf
            piece = self._source.read(max(lacking, AT_ONCE), left)
            if not piece:
                raise EOFError
            self._ahead += piece
        data = bytes(self._ahead[:count])
        del self._ahead[:count]
        return data


def _checksum(head: bytes, content: bytes) -> int:
    return zlib.crc32(content, zlib.crc32(head))


# ---- the parent's side


class Child:
    """One child process that runs `module`, whose end is `serve(...)`. May be closed from any thread."""

    def __init__(self, module: str, limits: Limits, watch: Watch | None = None, subject: Any = None) -> None:
        """A `watch` sees from outside what the child tries in its sandbox. The `subject` of `open`, for the one child
        of this process: where it may, it is a copy of this process, which has the subject already."""
        self.trials, self.memory, self.grown = 0, 0, 0
        self._number = 0
        self._scratch, self._watch = _Scratch(), watch
        requests, sink = os.pipe()
        source, replies = os.pipe()
        self._line = Line(source, sink)
        try:
            report = [] if watch is None or watch.far is None else [watch.far.fileno()]
            descriptors = [requests, replies, *report]
            self._process, self._knows = _started(module, limits.memory, descriptors, str(self._scratch), subject)
            self._end = SYSTEM.group(cast("subprocess.Popen[bytes]", self._process), limits.memory)
        except BaseException:
            self._line.close()
            self._scratch.remove()
            raise
        finally:
            os.close(requests)
            os.close(replies)
        self._tail = b""
        assert self._process.stdout is not None
        self._reader = threading.Thread(target=self._drain, args=(self._process.stdout,), daemon=True)
        self._reader.start()
        self._closing = threading.Lock()
        self._closed = False

    def open(self, subject: Any, limit: float, confinement: Confinement | None = None) -> None:
        """The first request: hands over `subject`, picklable, and waits until the child has opened it, `limit` [s] at
        most; with a `confinement` in that sandbox. Raises ProcessEnded, and the SprainError that the child met."""
        if confinement is not None:
            confinement = replace(confinement, scratch=str(self._scratch))
            if self._watch is not None:
                self._watch.confinement = confinement
        self._exchange(pickle.dumps((confinement, None if self._knows else subject)), limit, NO_TRIAL)

    def call(self, name: str, *arguments: Any, limit: float, trial: int = NO_TRIAL) -> Any:
        """The value of a handler; arguments and value as JSON has them. `limit` [s] of wall time, `trial` that the call
        belongs to. Raises ProcessEnded, and the SprainError that the handler raised."""
        return self._exchange(json.dumps({"call": name, "with": arguments}).encode(), limit, trial)

    def note(self, memory: int) -> None:
        """Counts a trial; `memory` [B] resident after it. Growth is counted from the tenth trial on, when caches are
        warm."""
        self.trials += 1
        self.grown = memory - self.memory if self.memory else 0
        if self.trials == 10 or not self.memory:
            self.memory = memory

    def log(self) -> str:
        """The last lines that the child printed."""
        self._reader.join(0.2)
        text = visible(self._tail.decode("utf-8", "replace"))
        return "\n".join(text.splitlines()[-20:])[-4000:]

    def last_words(self, before: str = "; it said: ") -> str:
        """The last line that the child printed behind `before`; empty when it printed none."""
        lines = self.log().splitlines()
        return f"{before}{lines[-1].strip()}" if lines else ""

    def close(self) -> None:
        """Ends the child with its whole group."""
        with self._closing:
            if self._closed:
                return
            self._closed = True
            self._end()
            self._line.close()
            self._scratch.remove()

    def _exchange(self, request: bytes, limit: float, trial: int) -> Any:
        if self._closed:  # its descriptors may be somebody else's by now
            raise ProcessEnded("crashed", "was ended before")
        deadline = monotonic() + limit
        self._number += 1
        try:
            self._line.send(Frame(request, trial, self._number))
            frame = self._line.receive(deadline)
            if frame.process != self._process.pid:
                raise ProcessEnded("crashed", f"another process ({frame.process}) answered in its place")
            if (frame.trial, frame.number) != (trial, self._number):
                raise ProcessEnded("crashed", f"answered request {frame.number} of trial {frame.trial}")
            if frame.content.startswith(BINARY):
                return frame.content[len(BINARY) :]
            reply = json.loads(frame.content)
        except TimeoutError:
            raise Overrun(limit) from None
        except json.JSONDecodeError:
            raise self._ending() from None
        except ValueError as problem:
            raise ProcessEnded("crashed", str(problem)) from None
        except (OSError, EOFError):
            raise self._ending() from None
        if "error" in reply:
            raise _error(reply["kind"], reply["error"])
        return reply["value"]

    def _ending(self) -> ProcessEnded:
        """How the process ended by itself."""
        try:
            code = self._process.wait(1.0)
        except subprocess.TimeoutExpired:
            return ProcessEnded("crashed", "closed the line to its parent")
        status, words, killed = SYSTEM.ending(code)
        return ProcessEnded(status, words, killed)

    def _drain(self, stream: IO[bytes]) -> None:
        with stream, contextlib.suppress(OSError, ValueError):
            while piece := stream.read1(1 << 16):  # type: ignore[attr-defined]
                self._tail = (self._tail + piece)[-TAIL:]


def _started(
    module: str, memory: int, descriptors: Sequence[int], folder: str, subject: Any
) -> tuple[subprocess.Popen[bytes] | Copy, bool]:
    """A process that runs `module` in `folder`: a copy of this process where there is a `subject`, of this process's
    server, else a Python of its own; and whether it knows the subject."""
    environment = _environment()
    own = SYSTEM.variables(folder) | {"NUMBA_CACHE_DIR": folder, PARENTS_TEMPORARY: tempfile.gettempdir()}

    def arguments(places: Sequence[object], parent: int) -> list[str]:
        requests, replies, *report = places
        return [str(argument) for argument in (requests, replies, memory, parent, *(report or [-1]))]

    places = [f"{{{k}}}" for k in range(len(descriptors))]
    if subject is not None:
        here = arguments(places, os.getpid())
        copy = copy_of_this(module, subject, here, descriptors, folder, environment | own, ROOT)
        if copy is not None:
            return copy, True
    if (server := _server(environment)) is not None:
        there = arguments(places, server.process)
        try:
            return server.start(module, there, descriptors, folder, environment | own), False
        except ServerGone:
            drop_server(server)
    requests, replies, *report = descriptors
    names = [SYSTEM.name_of(requests), SYSTEM.name_of(replies), *report]
    python = subprocess.Popen(
        [*python_command(module), *arguments(names, os.getpid())],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        cwd=folder,
        env=environment | own,
        **SYSTEM.options(descriptors),
    )
    return python, False


def prepare_copies() -> None:
    """Where this process may be copied for its children, it is now: before it has threads and opens files."""
    copy_now(_environment(), ROOT)


def prepare_children() -> ForkServer | None:
    """What children are copies of begins to load what they need; None where they start by themselves."""
    return _server(_environment())


def _server(environment: Mapping[str, str]) -> ForkServer | None:
    return server_for(environment, python_command("sprain_cosim.fork_server"), ROOT)


def _error(kind: str, message: str) -> SprainError:
    """The error of that class; of the base class where no class has that name."""
    classes = [SprainError]
    for known in classes:
        classes += known.__subclasses__()
    return next((c for c in classes if c.__name__ == kind), SprainError)(message)


# ---- the child's side


def serve(handlers: Callable[[Any], AbstractContextManager[Handlers]], known: Any = None) -> NoReturn:
    """The whole life of a child that `Child` started: enters its sandbox where it has one, opens the subject that it is
    sent, or knows, answers calls until the line closes, ends the process.

    `handlers(subject)` opens the subject and gives the functions that can be called, by name. A SprainError, also of
    opening, becomes a reply; any other exception ends the process."""
    global _serving
    _serving = True
    requests, replies, memory, parent, report = (int(argument) for argument in sys.argv[1:6])
    SYSTEM.die_with(parent)
    SYSTEM.confine(memory)
    line = Line(SYSTEM.opened(requests, writes=False), SYSTEM.opened(replies, writes=True))
    with contextlib.suppress(EOFError):
        first = line.receive()
        confinement, sent = pickle.loads(first.content)
        try:
            if confinement is not None:
                enter(confinement, socket.socket(fileno=report) if report >= 0 else None)
            _answer_all(line, first, handlers(sent if known is None else known))
        except SprainError as problem:
            line.send(replace(first, content=_refusal(problem)))
        except OSError as problem:
            SYSTEM.end_by(problem)
            raise
    os._exit(0)  # what a foreign library does at the end of a process is not our matter


def _answer_all(line: Line, first: Frame, opening: AbstractContextManager[Handlers]) -> None:
    """Raises EOFError when the line closes, SprainError when nothing could be opened. A copy of this process that
    foreign code made ends when it comes back here: it has nothing to say to the parent."""
    own = os.getpid()
    with opening as handlers:
        _only(own)
        line.send(replace(first, content=_answer(None)))
        while True:
            frame = line.receive()
            request = json.loads(frame.content)
            try:
                reply = _answer(handlers[request["call"]](*request["with"]))
            except SprainError as problem:
                reply = _refusal(problem)
            _only(own)
            line.send(replace(frame, content=reply))


def _only(process: int) -> None:
    if os.getpid() != process:
        os._exit(0)


def _answer(value: Any) -> bytes:
    return BINARY + value if isinstance(value, bytes) else json.dumps({"value": value}).encode()


def _refusal(problem: SprainError) -> bytes:
    return json.dumps({"error": str(problem), "kind": type(problem).__name__}).encode()


def tell_parent(text: str) -> None:
    """A line among what this child prints, of which its parent keeps the last; nothing in a process that is no
    child."""
    if _serving:
        with contextlib.suppress(OSError):
            os.write(1, f"{text}\n".encode("utf-8", "replace"))


def resident() -> int:
    """The most resident memory that this process has had [B]; 0 where the system does not say."""
    return SYSTEM.resident()


def allow_processor_time(seconds: float) -> None:
    """Processor time from here on, after which this process is ended."""
    SYSTEM.allow_processor_time(seconds)


# ---- other programs


class Program:
    """Another program that runs until it is ended: in a group of its own, silent."""

    def __init__(self, command: Sequence[str], environment: Mapping[str, str]) -> None:
        """`environment`: on top of this process's own."""
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env=os.environ | environment,
            **SYSTEM.options(),
        )
        self._end = SYSTEM.group(self._process)

    def end(self) -> None:
        """At once, with its whole group."""
        self._end()


def run_program(
    command: Sequence[str],
    folder: Path | None = None,
    limit: float | None = None,
    environment: Mapping[str, str] | None = None,
) -> subprocess.CompletedProcess[str]:
    """Runs a compiler or another tool to its end, in `folder`, for at most `limit` [s] of wall time: exit code, text.
    `environment` is added to that of this process.

    Raises EnvironmentProblem when it overruns the limit; a code other than 0 is the caller's matter."""
    try:
        return subprocess.run(
            command,
            cwd=folder,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=limit,
            check=False,
            env=os.environ | environment if environment else None,
        )
    except subprocess.TimeoutExpired:
        raise EnvironmentProblem(f"{command[0]} did not end within {limit:g} s") from None


def python_command(module: str) -> list[str]:
    """Runs a module with this Python; nothing is imported from the current folder."""
    return [sys.executable, "-P", "-c", START, str(ROOT), module]


def _environment() -> dict[str, str]:
    """Of a child: one thread for each library that counts cores, no folder in the search path that depends on where the
    child stands."""
    places = [str(Path(p).absolute()) for p in os.environ.get("PYTHONPATH", "").split(os.pathsep) if p]
    path = {"PYTHONPATH": os.pathsep.join(places)} if places else {}
    return {k: v for k, v in os.environ.items() if k != "PYTHONPATH"} | SINGLE_THREAD | path


class _Scratch(os.PathLike[str]):
    """A temporary folder, removed by hand: after the process that works in it."""

    def __init__(self) -> None:
        try:
            self._path = os.path.realpath(tempfile.mkdtemp(prefix="sprain-cosim-scratch-"))
        except OSError as problem:
            raise EnvironmentProblem(f"{tempfile.gettempdir()}: cannot be written: {problem.strerror}") from None

    def __fspath__(self) -> str:
        return self._path

    def __str__(self) -> str:
        return self._path

    def remove(self) -> None:
        SYSTEM.remove_tree(self._path)
