"""What FMUs say: through the logger that FMI gives them, and with the status warning of their calls.

One logger serves all instances of a process for as long as it lives, so that an FMU may speak from any thread and after
it was freed; the number of its instance leads to its `Log`, and what nobody listens to any more is dropped.
Text of an FMU is made visible here, before anybody prints it."""

from __future__ import annotations

import ctypes
import itertools
import re
import weakref
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from ..errors import visible
from ..records import Record

WARNING, ERROR = 1, 3  # of FMI's statuses
KEPT = 100  # messages that are at hand to be quoted
LONGEST = 500  # characters of a message
WORDS = re.compile(r"error|exception|fail|cannot|could not|invalid|assert", re.IGNORECASE)
TRACEBACK = "Traceback (most recent call last)"

_logs: weakref.WeakValueDictionary[int, Log] = weakref.WeakValueDictionary()  # by the number of the instance
_counter = itertools.count(1)


@dataclass(frozen=True)
class Messages(Record):
    """What one FMU said in a run.

    count     messages to its logger
    warnings  calls that it answered with the status warning
    first     the first message of status warning or worse; else the first; "" where there is none
    grave     whether there was a warning, or a message of that status or a worse one
    """

    count: int
    warnings: int
    first: str
    grave: bool

    @property
    def text(self) -> str:
        """One line."""
        return f"its FMU {spoke(self.count, self.warnings)}" + (f"; the first: {self.first}" if self.first else "")

    @classmethod
    def sum(cls, several: Iterable[Messages]) -> Messages | None:
        """Of all together, in their order; None for none."""
        found = list(several)
        first = next((m.first for m in found if m.grave and m.first), next((m.first for m in found if m.first), ""))
        if not found:
            return None
        return cls(sum(m.count for m in found), sum(m.warnings for m in found), first, any(m.grave for m in found))


def spoke(count: int, warnings: int) -> str:
    """How often an FMU did, as the rest of a sentence."""
    logged = f"logged {count} message{'s' if count > 1 else ''}"
    warned = f"answered {warnings} call{'s' if warnings > 1 else ''} with a warning"
    return " and ".join([logged] * bool(count) + [warned] * bool(warnings))


class Log:
    """Collects what one instance says, from its instantiation on or from `clear`.

    label        the name that the FMU is instantiated with
    environment  what an FMI 3.0 instance hands to its logger: the number in it, never followed as an address
    """

    def __init__(self, component: str) -> None:
        number = next(_counter)
        self.label, self.environment = f"{component}_{number}", ctypes.c_void_p(number)
        self._recent: deque[tuple[int, str]] = deque(maxlen=KEPT)
        self._count = self._warnings = 0
        self._first = self._first_grave = ""
        self._grave = False
        _logs[number] = self

    def clear(self) -> None:
        self._recent.clear()
        self._count = self._warnings = 0
        self._first = self._first_grave = ""
        self._grave = False

    def add(self, message: bytes | str | None, status: int = ERROR) -> None:
        """May be called from any thread. A child tells its parent of errors at once: it may not live to answer."""
        text = message.decode("utf-8", "replace") if isinstance(message, bytes) else message or ""
        self._recent.append((status, text[: 20 * LONGEST]))
        self._count += 1
        if status >= WARNING and not self._grave:
            self._grave, self._first_grave = True, line(text)
        self._first = self._first or line(text)
        if status >= ERROR:
            from ..process import tell_parent

            tell_parent(line(text))

    def warned(self, calls: int = 1) -> None:
        """So many calls were answered with the status warning."""
        self._warnings += calls

    def found(self) -> Messages | None:
        """None for an FMU that said nothing."""
        if not self._count and not self._warnings:
            return None
        grave = self._grave or self._warnings > 0
        return Messages(self._count, self._warnings, self._first_grave or self._first, grave)

    def quote(self) -> str:
        """What the FMU said of a failure, behind ": ": its last message of status error, else the last that has
        the words of one, else the last; of that the lines that name an error. Empty where there is none."""
        said = [(status, text) for status, text in list(self._recent) if text.strip()]
        errors = [t for status, t in said if status >= ERROR] or [t for _, t in said if WORDS.search(t)]
        text = errors[-1] if errors else said[-1][1] if said else ""
        named = [part for part in text.splitlines() if WORDS.search(part)]
        found = line(named[-1] if named else text)
        return f": {found}" if found else ""


def line(text: str) -> str:
    """A message as one line with its control characters shown; of a traceback the last line, the exception itself."""
    lines = [part.strip() for part in text.splitlines() if part.strip()]
    if any(part.startswith(TRACEBACK) for part in lines):
        lines = lines[-1:]
    found = visible(" ".join(lines)).replace("\t", " ")
    return found if len(found) <= LONGEST else f"{found[: LONGEST - 3]}..."


def receive(environment: Any, instance: bytes | None, status: int, category: bytes, message: bytes) -> None:
    """The logger of FMI 1.0 and 2.0."""
    number = (instance or b"").rpartition(b"_")[2]
    _deliver(int(number) if number.isdigit() else 0, status, message)


def _deliver(number: int, status: int, message: bytes) -> None:
    log = _logs.get(number)
    if log is not None:
        log.add(message, status)


@lru_cache(maxsize=1)
def loggers() -> tuple[Any, Any]:
    """The callbacks of FMI 1.0 and of 2.0 for the whole process: the proxy that formats the variable arguments of
    messages remembers a single logger, whichever version it is for."""
    import fmpy
    from fmpy import fmi1, fmi2

    first, second = fmi1.fmi1CallbackFunctions(), fmi2.fmi2CallbackFunctions()
    first.logger, second.logger = fmi1.fmi1CallbackLoggerTYPE(receive), fmi2.fmi2CallbackLoggerTYPE(receive)
    first.allocateMemory = fmi1.fmi1CallbackAllocateMemoryTYPE(fmpy.calloc)
    first.freeMemory = fmi1.fmi1CallbackFreeMemoryTYPE(fmpy.free)
    second.allocateMemory = fmi2.fmi2CallbackAllocateMemoryTYPE(fmpy.calloc)
    second.freeMemory = fmi2.fmi2CallbackFreeMemoryTYPE(fmpy.free)
    try:
        from fmpy.logging import addLoggerProxy
    except (ImportError, OSError):  # no proxy for this platform: messages arrive unformatted
        return first, second
    for callbacks in (first, second):
        addLoggerProxy(ctypes.byref(callbacks))
    return first, second


@lru_cache(maxsize=1)
def logger3() -> Any:
    """The logger of FMI 3.0 for the whole process."""
    from fmpy.fmi3 import fmi3LogMessageCallback

    def received(environment: int | None, status: int, category: bytes, message: bytes) -> None:
        _deliver(environment or 0, status, message)

    return fmi3LogMessageCallback(received)
