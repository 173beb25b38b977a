"""A child process that runs trials, so that a crash, a hang or a leak of an FMU costs one trial.

    parent                                child
    Worker.run(values)   -- request -->   session.run(values)    the session is opened once
    Outcome              <-- reply --     status, message, metrics, wall time, memory

A child that crashes or overruns its time is killed with its whole process group and the trial repeated once on a fresh
child; not so a hang while the worker has not finished any trial yet, unless its limit is stated. A child is replaced
after `recycle` trials or when its memory has grown; the fresh one repeats the last trial and must agree to the bit.

Short trials go to the child several at a time: when a landing has passed through the processor's caches, whatever else
is done for a trial costs many times what it costs in a loop. Where the child ends among several, each of them runs by
itself."""

from __future__ import annotations

import base64
import contextlib
import json
import struct
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import takewhile
from pathlib import Path
from time import monotonic, perf_counter
from typing import Any, Protocol

from .. import processor
from ..cosim.record import record_bytes
from ..cosim.result import HALVED_WITHIN, PEAK, Result, unconverged
from ..cosim.system import System
from ..errors import SimulationError, SprainError
from ..fmu import archive
from ..fmu.cache import cache_folder
from ..fmu.messages import Messages
from ..fmu.opener import import_libraries as _prepare  # noqa: F401 - before the process is copied
from ..fmu.surroundings import Surroundings
from ..process import (
    ENOUGH,
    Child,
    Handlers,
    Limits,
    Overrun,
    ProcessEnded,
    allow_processor_time,
    resident,
    serve,
)
from ..sandbox.confinement import Confinement
from ..scenario import Scenario

AGAIN = 16  # of so many trials one is made again at half its step
EXCHANGE = 0.1  # s of landings that are asked for at once
ALONE = 100  # trials that run one by one after a child has ended among several
LENGTH = struct.Struct("<I")
Trial = tuple[Sequence[float], bool]  # its values (d,), and whether its trajectory is asked for


@dataclass(frozen=True)
class Outcome:
    """How a trial ended: completed, failed (FMI error or a value that is not finite), crashed, timeout or lost (with
    the machine that ran it, several times); `message` says why, and of a completed trial that its coupling has not
    converged or that a device went outside what its FMU is declared for. `wall` [s] that it took; of a timeout the
    limit that ended it. `log` the last lines printed. Where a record was asked for, and of a failed trial, `trajectory`
    is the record (cosim/record.py) and `about` its scheme, scheme_reason, warning, coupling_error and status.
    `messages` {component: what its FMU said}, of those that said anything."""

    status: str
    message: str
    metrics: Mapping[str, float] = field(default_factory=dict)
    wall: float = 0.0
    attempts: int = 1
    log: str = ""
    messages: Mapping[str, Messages] = field(default_factory=dict)
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


class Stopped(Exception):
    """`kill` was called while a trial ran."""


class Worker:
    """Drives one child after the other. `run` may be called from one thread, `kill` from any. Use as a context
    manager."""

    def __init__(self, scenario: Openable, names: Sequence[str], limits: Limits | None = None, level: str = "") -> None:
        """`level`: of the processor, whose code the shipped FMUs take; empty: the processor's own."""
        self.level = level
        self.scenario, self.names, self.limits = scenario, tuple(names), limits or Limits()
        self._trials, self._starts = self.limits.of_trials(), self.limits.of_starts()
        self._child: Child | None = None
        self._stopped = False
        self._alone, self._pace = 0, EXCHANGE
        self._last: tuple[Sequence[float], Mapping[str, float]] | None = None

    def run(self, values: Sequence[float], record: bool = False) -> Outcome:
        """One trial with `values` (d,) of the names, with its trajectory where `record`. Raises Stopped after `kill`,
        SimulationError when the system cannot be opened at all or a fresh child disagrees with the one it replaces."""
        numbers, limit = [float(v) for v in values], self._trials.seconds
        self._alone = max(0, self._alone - 1)
        for attempt in (1, 2):
            try:
                child = self._ready()
                reply = self._asked(child, numbers, record)
                break
            except ProcessEnded as end:
                log = self._child.log() if self._child else ""
                self._drop()
                if self._stopped:
                    raise Stopped from None
                hopeless = isinstance(end, Overrun) and self._trials.stated is None and not self._trials.finished
                if attempt == 2 or hopeless:
                    end = Overrun(limit, self._trials.origin) if isinstance(end, Overrun) else end
                    wall = limit if end.status == "timeout" else 0.0
                    return Outcome(end.status, str(end), wall=wall, attempts=attempt, log=log)
        log = "" if reply["status"] == "completed" else child.log()
        self._note(child, numbers, reply)
        return self._outcome(numbers, reply, attempt, log)

    def run_all(self, trials: Sequence[Trial]) -> Iterator[list[Outcome]]:
        """As `run` for one after the other, in lists as they are finished."""
        finished = 0
        while finished < len(trials):
            rest = trials[finished:]
            outcomes = self._together(rest) or [self.run(*rest[0])]
            finished += len(outcomes)
            yield outcomes

    def _together(self, trials: Sequence[Trial]) -> list[Outcome]:
        """The first of the `trials`, in one exchange, up to one that is not completed; none where they are to run one
        by one."""
        several = [[float(v) for v in values] for values, _ in takewhile(lambda t: not t[1], trials[: self._at_once()])]
        if len(several) < 2:
            return []
        limit = self._trials.seconds
        try:
            child = self._ready()
            most = child.memory + self.limits.growth
            replies = _unpacked(child.call("several", several, self.limits.processor_time(limit), most, limit=limit))
        except (ProcessEnded, ValueError):
            self._drop()
            if self._stopped:
                raise Stopped from None
            self._alone = ALONE
            return []
        log = "" if replies[-1]["status"] == "completed" else child.log()
        found = list(zip(several, replies, strict=False))
        for numbers, reply in found:
            self._note(child, numbers, reply)
        return [self._outcome(n, r, 1, "" if r["status"] == "completed" else log) for n, r in found]

    def _at_once(self) -> int:
        """How many trials of the length of the last one are asked for at once; before a limit is learned none."""
        if self._alone or self._child is None or self._trials.finished < ENOUGH:
            return 0
        return min(int(EXCHANGE / self._pace), self.limits.recycle - self._child.trials)

    def _note(self, child: Child, numbers: list[float], reply: Mapping[str, Any]) -> None:
        child.note(reply["memory"])
        if reply["status"] == "completed":
            self._last = (numbers, reply["metrics"])
            self._pace = max(reply["wall"], 1e-4)
            self._trials.note(reply["wall"])

    def _outcome(self, numbers: Sequence[float], reply: Mapping[str, Any], attempt: int, log: str) -> Outcome:
        doubt = self._doubt(numbers, reply) if reply["status"] == "completed" and made_again(numbers) else ""
        return Outcome(
            reply["status"],
            "; ".join(text for text in (doubt, reply["message"]) if text),
            reply["metrics"],
            reply["wall"],
            attempt,
            log,
            {name: Messages.from_json(found, name) for name, found in reply.get("messages", {}).items()},
            base64.b64decode(reply.get("trajectory", "")),
            reply.get("about", {}),
        )

    def _doubt(self, numbers: Sequence[float], reply: Mapping[str, Any]) -> str:
        """What half the step says of a completed trial; a child that ends meanwhile costs nothing but itself."""
        if not isinstance(self.scenario, Scenario) or reply["wall"] > HALVED_WITHIN or PEAK not in reply["metrics"]:
            return ""
        limit = self._trials.seconds
        try:
            child = self._child or self._ready()
            finer = child.call("halved", numbers, self.limits.processor_time(limit), limit=limit)
        except ProcessEnded:
            self._drop()
            if self._stopped:
                raise Stopped from None
            return ""
        change = finer.get(PEAK, reply["metrics"][PEAK]) - reply["metrics"][PEAK]
        return unconverged(change, self.scenario.master.communication_step)

    def kill(self) -> None:
        """Ends the child at once, grandchildren included."""
        self._stopped = True
        self._drop()

    def _asked(self, child: Child, values: Sequence[float], record: bool) -> Any:
        limit = self._trials.seconds
        return child.call("run", values, record, self.limits.processor_time(limit), limit=limit)

    def _ready(self) -> Child:
        """The child for the next trial. Raises ProcessEnded when one that replaces another ends at the trial that
        it is to repeat."""
        if self._stopped:
            raise Stopped
        spent = self._child is not None and (
            self._child.trials >= self.limits.recycle or self._child.grown > self.limits.growth
        )
        if spent:
            self._drop()
        if self._child is None:
            self._child = self._fresh()
            if spent and self._last is not None:
                values, before = self._last
                if self._asked(self._child, values, False)["metrics"] != before:
                    raise SimulationError(
                        "a fresh process gives other numbers for the same trial: a component keeps something between "
                        "runs"
                    )
        return self._child

    def _fresh(self) -> Child:
        """A child that has opened the system. Without a sandbox, the first on this machine to open an FMU may compile
        for it, and what it compiled may round otherwise than what later ones load; so it runs no trial."""
        marks = _marks(self.scenario)
        if any(not mark.exists() for mark in marks):
            self._open().close()
            for mark in marks:
                with contextlib.suppress(OSError):
                    mark.parent.mkdir(parents=True, exist_ok=True)
                    mark.touch()
        return self._open()

    def _open(self) -> Child:
        for again in (True, False):
            child = Child(__name__, self.limits)
            problem, began = "", monotonic()
            try:
                subject = *self._placed(), self.names, self.level
                child.open(subject, self._starts.seconds, self._confinement())
                if not self._stopped:
                    self._starts.note(monotonic() - began)
                    return child
            except ProcessEnded as end:
                more = f"; {end.cure}" if isinstance(end, Overrun) else ""
                problem = f"the system cannot be opened: {end}{child.last_words('; last words: ')}{more}"
                again = again and (self._starts.finished > 0 or end.killed)  # the machine may be short of something
            except SprainError as refusal:  # what a study cannot open is a failure of its simulations
                problem, again = str(refusal), False
            child.close()
            if self._stopped:
                raise Stopped
            if not again:
                raise SimulationError(problem)
        raise AssertionError("unreachable")

    def _placed(self) -> tuple[Openable, System | None]:
        """What the child opens, with its system where it is a scenario: described once, here."""
        if not isinstance(self.scenario, Scenario):
            return self.scenario, None
        placed = self.scenario.absolute()
        return placed, placed.system()

    def _confinement(self) -> Confinement | None:
        """The sandbox that the system asks for; a stand-in asks for none."""
        return self.scenario.confinement() if isinstance(self.scenario, Scenario) else None

    def _drop(self) -> None:
        child, self._child = self._child, None
        if child is not None:
            child.close()

    def __enter__(self) -> Worker:
        return self

    def __exit__(self, *_: object) -> None:
        self.kill()


def made_again(values: Sequence[float]) -> bool:
    """Whether a trial with these input values is made once more at half its step: one in AGAIN, by its inputs alone."""
    return zlib.crc32(struct.pack(f"<{len(values)}d", *values)) % AGAIN == 0


def _marks(scenario: Openable) -> list[Path]:
    """Files whose being there says that an FMU has been opened on this machine before; in a sandbox it leaves nothing
    that matters."""
    if not isinstance(scenario, Scenario) or not scenario.in_process:
        return []
    fmus: Mapping[str, Path] = scenario.fmus
    return [cache_folder() / "opened" / archive.read(path).sha256[:32] for path in fmus.values()]


@contextlib.contextmanager
def _handlers(subject: tuple[Openable, System | None, tuple[str, ...], str]) -> Iterator[Handlers]:
    """The child: opens the scenario, then runs trials with values of `names`."""
    scenario, system, names, level = subject
    processor.take(level)

    def run(values: Sequence[float], record: bool, cpu: float) -> dict[str, Any]:
        allow_processor_time(cpu)
        return landed(values, record)

    def landed(values: Sequence[float], record: bool) -> dict[str, Any]:
        began = perf_counter()
        try:
            about_course = {"judged": record} if isinstance(scenario, Scenario) else {}  # no row holds it
            result = session.run(dict(zip(names, values, strict=True)), **about_course)
            wall = perf_counter() - began
            reply = {"status": result.status, "message": result.message, "metrics": result.metrics}
            if isinstance(result, Result) and result.messages:
                reply["messages"] = {name: said.to_json() for name, said in result.messages.items()}
            if system is not None and result.status == "completed":
                reply["message"] = "; ".join(system.left_ranges(result))
            if (record or result.status != "completed") and isinstance(result, Result):
                reply |= _record(result)
        except SprainError as problem:
            wall, reply = perf_counter() - began, {"status": "failed", "message": str(problem), "metrics": {}}
        surroundings.restore()
        return reply | {"wall": wall, "memory": resident()}

    def several(trials: Sequence[Sequence[float]], cpu: float, memory: int) -> bytes:
        """Until one is not completed, or has used more `memory` [B]; all of them may take the time of one."""
        replies: list[dict[str, Any]] = []
        allow_processor_time(cpu)
        for values in trials:
            replies.append(landed(values, False))
            if replies[-1]["status"] != "completed" or replies[-1]["memory"] > memory:
                break
        return _packed(replies)

    def halved(values: Sequence[float], cpu: float) -> dict[str, float]:
        allow_processor_time(cpu)
        finer = session.at_half_the_step(dict(zip(names, values, strict=True)))
        surroundings.restore()
        return dict(finer)

    with (
        scenario.open(in_process=True, system=system) if isinstance(scenario, Scenario) else scenario.open()
    ) as session:
        surroundings = Surroundings()
        yield {"run": run, "several": several, "halved": halved}


def _packed(replies: list[dict[str, Any]]) -> bytes:
    """Their metrics as doubles, for a float as text takes 0.5 us to write and to read."""
    names = list(replies[0]["metrics"])
    alike = bool(names) and all(list(reply["metrics"]) == names for reply in replies)
    numbers = [tuple(reply.pop("metrics").values()) for reply in replies] if alike else []
    about = json.dumps([names if alike else None, replies]).encode()
    return b"".join([LENGTH.pack(len(about)), about, *(struct.pack(f"<{len(names)}d", *row) for row in numbers)])


def _unpacked(content: bytes) -> list[dict[str, Any]]:
    """Raises ValueError for what is nothing that was packed."""
    try:
        begin = LENGTH.size + LENGTH.unpack_from(content)[0]
        names, replies = json.loads(content[LENGTH.size : begin])
        if names is not None:
            rows = struct.iter_unpack(f"<{len(names)}d", content[begin:])
            for reply, row in zip(replies, rows, strict=True):
                reply["metrics"] = dict(zip(names, row, strict=True))
        return list(replies)
    except (struct.error, TypeError, KeyError) as problem:
        raise ValueError(str(problem)) from None


def _record(result: Result) -> dict[str, Any]:
    about = {key: getattr(result, key) for key in ("status", "scheme", "scheme_reason", "warning", "coupling_error")}
    return {"trajectory": base64.b64encode(record_bytes(result)).decode(), "about": about}


if __name__ == "__main__":
    serve(_handlers)
