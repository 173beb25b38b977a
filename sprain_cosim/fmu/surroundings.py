"""What a process has one of, and foreign code may change: working folder, umask, environment, locale, timers, handlers
of signals. A child that runs one trial after the other puts it back after each."""

from __future__ import annotations

import contextlib
import ctypes
import locale
import os
import signal
import sys
from functools import lru_cache
from typing import Any

HANDLED = ("SIGHUP", "SIGINT", "SIGTERM", "SIGALRM", "SIGCHLD", "SIGFPE", "SIGSEGV", "SIGABRT", "SIGPIPE", "SIGXCPU")
ACTION = 256  # B, more than struct sigaction
TIMERS = ("ITIMER_REAL", "ITIMER_VIRTUAL", "ITIMER_PROF")


@lru_cache(maxsize=1)
def _libc() -> Any:
    return ctypes.CDLL(None)


class Surroundings:
    """As they are when this is made. For a process of one thread."""

    def __init__(self) -> None:
        self._folder = os.getcwd()
        self._umask = os.umask(0o022)
        os.umask(self._umask)
        self._locale = locale.setlocale(locale.LC_ALL)
        self._variables = _variables()
        self._handlers = {name: _handler(name) for name in HANDLED if hasattr(signal, name)}

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
        now = _variables()
        if now != self._variables:
            changed.append("environment")
            self._put_back(now)
        if self._stop_timers():
            changed.append("timers")
        for name, handler in self._handlers.items():
            if _identity(_handler(name)) != _identity(handler):
                changed.append(f"handler of {name}")
                _libc().sigaction(int(getattr(signal, name)), handler, None)
        return changed

    def _put_back(self, now: list[bytes]) -> None:
        before, after = (dict(line.partition(b"=")[::2] for line in lines) for lines in (self._variables, now))
        for name in after.keys() - before.keys():
            _libc().unsetenv(name)
        for name, value in before.items():
            if after.get(name) != value:
                _libc().setenv(name, value, 1)

    def _stop_timers(self) -> bool:
        running = False
        for name in TIMERS:
            if hasattr(signal, name):
                running |= signal.setitimer(getattr(signal, name), 0.0) != (0.0, 0.0)
        return running


def _folder() -> str:
    with contextlib.suppress(OSError):
        return os.getcwd()
    return ""


def _variables() -> list[bytes]:
    """As C sees them; Python's own view is a copy."""
    if sys.platform != "linux":
        return []
    lines = ctypes.POINTER(ctypes.c_char_p).in_dll(_libc(), "environ")
    found, k = [], 0
    while lines and (line := lines[k]) is not None:
        found.append(line)
        k += 1
    return found


def _identity(action: bytes) -> bytes:
    """Function, the first signals of the mask, flags; the rest of a struct sigaction is not always written."""
    return action[:16] + action[136:140]


def _handler(name: str) -> bytes:
    """The action of a signal as C has it; Python's own view does not know what foreign code sets."""
    if sys.platform != "linux":
        return b""
    action = ctypes.create_string_buffer(ACTION)
    _libc().sigaction(int(getattr(signal, name)), None, action)
    return action.raw
