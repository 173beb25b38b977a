"""Child processes speak one dialect: values come back as they are, errors by class, endings by name."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from sprain_cosim import errors, process
from sprain_cosim.errors import EnvironmentProblem, InputError, SprainError, StepDiscarded
from sprain_cosim.process import Child, Handlers, Limits, ProcessEnded, Program, run_program, serve
from tests.processes import alive_in

ENOUGH = 60.0  # s


@contextmanager
def _handlers(subject: Any) -> Iterator[Handlers]:
    """The child that these tests start: this module."""

    def fail(kind: str, message: str) -> None:
        raise getattr(errors, kind)(message)

    def overflow() -> None:
        os.write(int(sys.argv[2]), b"\xff" * 8)

    if isinstance(subject, SprainError):
        raise subject
    yield {
        "subject": lambda: subject,
        "same": lambda *values: list(values),
        "bytes": lambda count: count * bytes(range(256)),
        "fail": fail,
        "bug": lambda: 1 / 0,
        "exit": os._exit,
        "print": lambda text: print(text, flush=True),
        "hang": lambda: time.sleep(ENOUGH),
        "memory": lambda size: len(bytearray(size)),
        "spin": lambda: [process.allow_processor_time(0.0), sum(k * k for k in range(10**9))],
        "overflow": overflow,
    }


def test_a_limit_is_learned_from_what_has_finished() -> None:
    learned = Limits().of_trials()
    assert (learned.seconds, learned.origin) == (60.0, "until 5 have finished")
    for _ in range(5):
        learned.note(0.03)
    assert (learned.seconds, learned.origin) == (10.0, "20 times the median before it, at least 10 s")
    for _ in range(5):
        learned.note(4.0)
    assert learned.seconds == 50.0  # 20 times the median of 0.03 and 4 s is 40.3 s
    for _ in range(1000):
        learned.note(0.03)
    assert learned.seconds == 10.0
    assert Limits().processor_time(learned.seconds) == 40.0
    stated = Limits(trial=2.0).of_trials()
    for _ in range(9):
        stated.note(4.0)
    assert (stated.seconds, stated.origin) == (2.0, "as stated")


def test_opening_may_take_as_long_as_a_trial() -> None:
    opening = Limits(trial=120.0).of_starts()
    assert opening.seconds == 120.0
    opening.note(0.4)
    assert opening.seconds == 120.0
    learned = Limits().of_starts()
    assert (learned.seconds, learned.origin) == (60.0, "the first time")
    learned.note(0.4)
    assert learned.seconds == 10.0


@pytest.mark.parametrize(("seconds", "up"), [(0.011, 0.02), (1.0, 1.0), (2.1, 5.0), (50.0, 50.0), (50.1, 100.0)])
def test_limits_are_round(seconds: float, up: float) -> None:
    assert process.round_up(seconds) == pytest.approx(up, rel=1e-12)


@pytest.fixture
def child() -> Iterator[Child]:
    opened = Child(__name__, Limits(memory=1 << 30))
    try:
        opened.open({"plant": 0.3}, ENOUGH)
        yield opened
    finally:
        opened.close()


def test_values_come_back_as_they_are(child: Child) -> None:
    """Doubles to the bit, one call after the other."""
    assert child.call("subject", limit=ENOUGH) == {"plant": 0.3}
    for values in ([0.1 + 0.2, 5e-324, -1.7976931348623157e308], [float("inf")], ["a", None, {"b": [1]}], []):
        assert child.call("same", *values, limit=ENOUGH) == values
    for count in (0, 1, 4000):
        assert child.call("bytes", count, limit=ENOUGH) == count * bytes(range(256))


@pytest.mark.parametrize("kind", ["InputError", "SimulationError", "SimulationStopped", "StepDiscarded"])
def test_errors_travel_by_class(kind: str, child: Child) -> None:
    """With message and exit code; the child lives on."""
    with pytest.raises(getattr(errors, kind)) as caught:
        child.call("fail", kind, "brace: 12 °: too far", limit=ENOUGH)
    assert type(caught.value) is getattr(errors, kind)
    assert str(caught.value) == "brace: 12 °: too far"
    assert child.call("same", 1, limit=ENOUGH) == [1]


def test_an_error_of_opening_travels_by_class() -> None:
    opened = Child(__name__, Limits())
    try:
        with pytest.raises(EnvironmentProblem, match="no library"):
            opened.open(EnvironmentProblem("no library"), ENOUGH)
    finally:
        opened.close()


def test_every_error_of_the_package_finds_its_class() -> None:
    kinds = [k for k in vars(errors).values() if isinstance(k, type) and issubclass(k, SprainError)]
    assert StepDiscarded in kinds
    for kind in kinds:
        found = process._error(kind.__name__, "why")
        assert (type(found), str(found), found.exit_code) == (kind, "why", kind.exit_code)
    assert type(process._error("Unknown", "why")) is SprainError


@pytest.mark.parametrize(
    ("call", "status", "message"),
    [
        (("exit", 7), "crashed", "exit code 7"),
        (("bug",), "crashed", "exit code 1"),
        (("spin",), "timeout", "processor time"),
        (("overflow",), "crashed", "wrote into the line"),
    ],
)
def test_endings_are_named(call: tuple[Any, ...], status: str, message: str, child: Child) -> None:
    with pytest.raises(ProcessEnded, match=message) as caught:
        child.call(*call, limit=ENOUGH)
    assert caught.value.status == status


def test_the_last_words_are_kept(child: Child) -> None:
    assert child.last_words() == ""
    child.call("print", "first\nlast", limit=ENOUGH)
    with pytest.raises(ProcessEnded):
        child.call("bug", limit=ENOUGH)
    assert child.log().startswith("first\nlast\nTraceback")  # a traceback comes in many small pieces
    assert child.last_words() == "; it said: ZeroDivisionError: division by zero"


def test_what_is_printed_in_many_pieces_is_kept_by_size(child: Child) -> None:
    for number in range(12):
        child.call("print", f"piece {number}", limit=ENOUGH)
    with pytest.raises(ProcessEnded):
        child.call("exit", 3, limit=ENOUGH)
    assert child.log().splitlines() == [f"piece {number}" for number in range(12)]


def test_a_call_that_hangs_ends_at_its_limit_with_the_group(child: Child) -> None:
    began = time.monotonic()
    with pytest.raises(ProcessEnded, match="wall time") as caught:
        child.call("hang", limit=0.3)
    assert caught.value.status == "timeout"
    child.close()
    assert time.monotonic() - began < 0.5 * ENOUGH
    assert not alive_in(child._process.pid)


def test_memory_is_limited(child: Child) -> None:
    with pytest.raises(ProcessEnded, match="exit code 1"):
        child.call("memory", 2 << 30, limit=ENOUGH)
    assert "MemoryError" in child.last_words()


def test_a_tool_is_run_to_its_end(tmp_path: Path) -> None:
    done = run_program([sys.executable, "-c", "import os; print(os.getcwd()); raise SystemExit(3)"], tmp_path)
    assert (done.returncode, done.stdout.strip()) == (3, str(tmp_path.resolve()))
    with pytest.raises(EnvironmentProblem, match=r"did not end within 0\.2 s"):
        run_program([sys.executable, "-c", "import time; time.sleep(60)"], limit=0.2)


def test_a_program_ends_with_its_group() -> None:
    program = Program([sys.executable, "-c", "import time; time.sleep(60)"], {"A": "b"})
    group = program._process.pid
    assert alive_in(group)
    program.end()
    assert not alive_in(group)


def test_a_limit_that_no_system_counts_to_is_refused() -> None:
    with pytest.raises(InputError, match=r"wall time of 1e\+300 s: at most 1e\+07 s"):
        Limits(trial=1e300)


if __name__ == "__main__":
    serve(_handlers)
