"""Signals that ask this process to stop: how they interrupt it, and how they wait."""

from __future__ import annotations

import contextlib
import queue
import signal
import threading
from collections.abc import Iterator
from typing import Any

from .machine.here import SYSTEM

REPEAT = 0.2  # s after which an interruption comes again, should native code swallow the exception


class Interrupted(BaseException):
    """A signal that asks to stop. Not a KeyboardInterrupt, which click reports in its own way."""


class NobodyReads(BaseException):
    """Who read what is printed has gone. Not a BrokenPipeError, of which click makes a failure of the command."""


@contextlib.contextmanager
def nobody_reads() -> Iterator[None]:
    try:
        yield
    except BrokenPipeError:
        raise NobodyReads from None


def interrupt() -> list[int]:
    """From here on the signals that ask to stop raise Interrupted in the main thread, again and again until `settle`.
    The numbers of the signals that arrived, in a list that grows."""
    received: list[int] = []

    def stop(number: int, _: Any) -> None:
        received.append(number)
        if hasattr(signal, "setitimer"):
            signal.setitimer(signal.ITIMER_REAL, REPEAT)
        raise Interrupted

    for name in (*SYSTEM.stops, "SIGALRM"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), stop)
    return received


def exit_code(number: int) -> int:
    """Of a command that a signal has ended; that of Ctrl-Break on Windows is that of Ctrl-C."""
    return 128 + (number if number == signal.SIGTERM else signal.SIGINT)


def settle() -> None:
    """An interruption that has arrived does not come again."""
    if hasattr(signal, "setitimer"):
        signal.setitimer(signal.ITIMER_REAL, 0.0)


def taken(waiting: queue.SimpleQueue[Any]) -> Any:
    """The next of a queue, for the main thread, which signals interrupt meanwhile."""
    while SYSTEM.patience is not None:
        with contextlib.suppress(queue.Empty):
            return waiting.get(timeout=SYSTEM.patience)
    return waiting.get()


@contextlib.contextmanager
def held() -> Iterator[None]:
    """Signals that ask to stop wait until this is done. Only the main thread gets signals."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    waiting: list[int] = []
    settle()
    numbers = [getattr(signal, name) for name in SYSTEM.stops]
    before = {number: signal.signal(number, lambda n, _: waiting.append(n)) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    if waiting:
        signal.raise_signal(waiting[0])
