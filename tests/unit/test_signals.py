"""Requests to stop: they interrupt, they wait where they must, they come once."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator

import pytest

from sprain_cosim import signals


@pytest.fixture
def received() -> Iterator[list[int]]:
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGALRM)
    before = {number: signal.getsignal(number) for number in numbers}
    try:
        yield signals.interrupt()
    finally:
        signals.settle()
        for number, handler in before.items():
            signal.signal(number, handler)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_request_to_stop_interrupts_until_it_is_settled(number: int, received: list[int]) -> None:
    with pytest.raises(signals.Interrupted):
        signal.raise_signal(number)
    assert received == [number]
    assert signal.getitimer(signal.ITIMER_REAL)[0] > 0.0, "it comes again"
    signals.settle()
    assert signal.getitimer(signal.ITIMER_REAL)[0] == 0.0


def test_a_held_request_waits_and_comes_once(received: list[int]) -> None:
    done = []

    def save() -> None:
        with signals.held():
            signal.raise_signal(signal.SIGTERM)
            signal.raise_signal(signal.SIGTERM)
            done.append("all of it")

    with pytest.raises(signals.Interrupted):
        save()
    assert done == ["all of it"]
    assert received == [signal.SIGTERM]


def test_another_thread_holds_nothing() -> None:
    before, seen = signal.getsignal(signal.SIGTERM), []

    def hold() -> None:
        with signals.held():
            seen.append(signal.getsignal(signal.SIGTERM))

    thread = threading.Thread(target=hold)
    thread.start()
    thread.join()
    assert seen == [before]
