"""What a process has one of, and foreign code may change: working folder, umask, environment, locale, timers, handlers
of signals. A child that runs one trial after the other puts it back after each.

What can be found once is found once: after a landing this code has left the processor's caches, and each step of it
costs many times what it costs in a loop."""

from __future__ import annotations

import contextlib
import ctypes
import locale
import os
import signal
import sys
from collections.abc import Callable
from functools import lru_cache
from typing import Any

HANDLED = ("SIGHUP", "SIGINT", "SIGTERM", "SIGALRM", "SIGCHLD", "SIGFPE", "SIGSEGV", "SIGABRT", "SIGPIPE", "SIGXCPU")
NUMBERS = {name: int(getattr(signal, name)) for name in HANDLED if hasattr(signal, name)}
TIMERS = [getattr(signal, name) for name in ("ITIMER_REAL", "ITIMER_VIRTUAL", "ITIMER_PROF") if hasattr(signal, name)]
ACTION = 256  # B, more than struct sigaction


@lru_cache(maxsize=1)
def _libc() -> Any:
    return ctypes.CDLL(None)


class Surroundings:
    """As they are when this is made. For a process of one thread."""

    def __init__(self) -> None:
        self._process = _Linux() if sys.platform == "linux" else None
        self._folder = os.getcwd()
        self._umask = os.umask(0o022)
        os.umask(self._umask)
        self._locale = locale.setlocale(locale.LC_ALL)
        self._variables, self._handlers = self._now()
        self._actions = self._process.last_actions() if self._process is not None else b""

    def restore(self) -> list[str]:
        """Puts back what has changed; what that was."""
        changed = []
        if _folder() != self._folder:
            changed.append("working folder")
            os.chdir(self._folder)
        if os.umask(self._umask) != self._umask:
            changed.append("umask")
        if locale.setlocale(locale.LC_ALL) != self._locale:
            changed.append("locale")
            locale.setlocale(locale.LC_ALL, self._locale)
        variables, handlers = self._now()
        if variables != self._variables:
            changed.append("environment")
            self._put_back(variables)
        if self._stop_timers():
            changed.append("timers")
        if handlers != self._handlers:
            changed += self._handle_as_before(handlers)
        return changed

    def after(self, function: Callable[..., Any]) -> Callable[..., Any]:
        """The function, with `restore` after each call."""

        def called(*arguments: Any) -> Any:
            try:
                return function(*arguments)
            finally:
                self.restore()

        return called

    def _now(self) -> tuple[list[bytes], list[list[int]]]:
        """The variables and the handlers of signals; Python's own view of both does not know what foreign code does."""
        return (self._process.variables(), self._process.handlers()) if self._process is not None else ([], [])

    def _put_back(self, now: list[bytes]) -> None:
        before, after = (dict(line.partition(b"=")[::2] for line in lines) for lines in (self._variables, now))
        for name in after.keys() - before.keys():
            _libc().unsetenv(name)
        for name, value in before.items():
            if after.get(name) != value:
                _libc().setenv(name, value, 1)
        self._variables = self._now()[0]  # their order may be another one

    def _handle_as_before(self, now: list[list[int]]) -> list[str]:
        changed = []
        for k, (name, number) in enumerate(NUMBERS.items()):
            if [part[k] for part in now] != [part[k] for part in self._handlers]:
                changed.append(f"handler of {name}")
                _libc().sigaction(number, self._actions[ACTION * k : ACTION * (k + 1)], None)
        self._handlers = self._now()[1]  # the C library sets a flag of its own
        return changed

    def _stop_timers(self) -> bool:
        running = [timer for timer in TIMERS if signal.getitimer(timer) != (0.0, 0.0)]
        for timer in running:
            signal.setitimer(timer, 0.0)
        return bool(running)


class _Linux:
    """What C knows of this process."""

    def __init__(self) -> None:
        self._lines = ctypes.POINTER(ctypes.c_char_p).in_dll(_libc(), "environ")
        self._actions = ctypes.create_string_buffer(ACTION * len(NUMBERS))
        view = memoryview(self._actions).cast("B")
        self._words, self._halves = view.cast("Q"), view.cast("I")
        start = ctypes.addressof(self._actions)
        self._places = [(number, ctypes.c_void_p(start + ACTION * k)) for k, number in enumerate(NUMBERS.values())]
        self._sigaction = _libc().sigaction

    def variables(self) -> list[bytes]:
        lines, found, k = self._lines, [], 0
        while lines and (line := lines[k]) is not None:
            found.append(line)
            k += 1
        return found

    def handlers(self) -> list[list[int]]:
        """Functions, the first signals of the masks, flags of all; the rest of a struct sigaction is not always
        written."""
        for number, place in self._places:
            self._sigaction(number, None, place)
        size = ACTION // 8
        return [self._words[0::size].tolist(), self._words[1::size].tolist(), self._halves[34 :: 2 * size].tolist()]

    def last_actions(self) -> bytes:
        """As C has them, from the last `handlers`."""
        return self._actions.raw


def _folder() -> str:
    with contextlib.suppress(OSError):
        return os.getcwd()
    return ""
