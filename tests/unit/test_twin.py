"""A copy of this process takes a share of the tasks; whatever becomes of it, the results are those of one process."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from sprain_cosim import fork_server, twin
from sprain_cosim.machine.here import SYSTEM
from sprain_cosim.twin import shared

linux = pytest.mark.skipif(sys.platform != "linux", reason="a copy is made on Linux alone")


@pytest.fixture
def two_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    """As in a command: of one thread, with nothing foreign in it, on a machine of two cores. No native thread of this
    process holds a lock that the tasks below take."""
    monkeypatch.setattr(type(SYSTEM), "cores", lambda _: 2)
    monkeypatch.setattr(twin, "can_be_copied", lambda: True)


def children() -> list[str]:
    return Path(f"/proc/self/task/{os.getpid()}/children").read_text().split()


@linux
def test_both_take_their_share_and_the_order_is_that_of_the_tasks(two_cores: None) -> None:
    """The copy has done the first task when this process goes on; the last one waits until this process has done one of
    those between them, or the copy would do them all."""
    before = children()
    (begun, begins), (ours, does_ours) = os.pipe(), os.pipe()
    parent = os.getpid()

    def first() -> tuple[int, int]:
        os.write(begins, b"x")
        os.read(ours, 1)
        return 0, os.getpid()

    def other(n: int) -> tuple[int, int]:
        if os.getpid() == parent:
            os.write(does_ours, b"x")
        return n, os.getpid()

    tasks: list[Callable[[], tuple[int, int]]] = [first, *((lambda n=n: other(n)) for n in range(1, 6))]
    with shared(tasks) as results:
        os.read(begun, 1)
        found = results()
    assert [n for n, _ in found] == list(range(6))
    assert found[0][1] != parent, "the copy began"
    assert parent in {process for _, process in found}
    assert children() == before


@linux
def test_what_the_copy_cannot_do_is_done_here(two_cores: None) -> None:
    parent = os.getpid()

    def here_alone() -> str:
        if os.getpid() != parent:
            raise ValueError("only in the copy")
        return "done"

    with shared([here_alone] * 3) as results:
        assert results() == ["done"] * 3


@linux
def test_an_error_is_raised_as_by_one_process(two_cores: None) -> None:
    before = children()

    def fails() -> int:
        raise ZeroDivisionError("of a task")

    with pytest.raises(ZeroDivisionError, match="of a task"), shared([fails, lambda: 1]) as results:
        results()
    assert children() == before


@linux
def test_a_copy_that_is_killed_costs_nothing_but_time(two_cores: None) -> None:
    before = children()
    parent = os.getpid()

    def ends_the_copy() -> int:
        if os.getpid() != parent:
            os.kill(os.getpid(), signal.SIGKILL)
        return 7

    with shared([ends_the_copy, ends_the_copy]) as results:
        assert results() == [7, 7]
    assert children() == before


@linux
def test_it_is_gone_when_this_process_does_not_ask_for_results(two_cores: None) -> None:
    before = children()
    started, starts = os.pipe()

    def waits() -> None:
        os.write(starts, b"x")
        signal.pause()

    with contextlib.suppress(KeyError), shared([waits, waits]):
        os.read(started, 1)
        assert children() != before
        raise KeyError
    assert children() == before


@pytest.mark.parametrize("why", ["one core", "foreign code", "one task"])
def test_where_there_is_no_copy_this_process_does_it_all(why: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(type(SYSTEM), "cores", lambda _: 1 if why == "one core" else 2)
    monkeypatch.setattr(twin, "can_be_copied", lambda: why != "foreign code")
    tasks = [os.getpid] * (1 if why == "one task" else 3)
    with shared(tasks) as results:
        assert results() == [os.getpid()] * len(tasks)


@linux
def test_foreign_code_forbids_a_copy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fork_server, "_foreign", True)
    assert not fork_server.can_be_copied()


@linux
def test_the_command_line_is_of_one_thread_with_all_that_a_report_imports() -> None:
    """NumPy's and pyarrow's would be in the way."""
    code = (
        "import sys, os\n"
        "from sprain_cosim import cli, fork_server\n"
        "sys.argv = ['sprain-cosim', '--version']\n"
        "try:\n    cli.main()\nexcept SystemExit:\n    pass\n"
        "import sprain_cosim.report.page\n"
        "print(fork_server.can_be_copied(), file=sys.stderr)\n"
    )
    own = {k: v for k, v in os.environ.items() if k not in ("OPENBLAS_NUM_THREADS", "JE_ARROW_MALLOC_CONF")}
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=own, check=True)
    assert ran.stderr.split()[-1] == "True", ran.stderr
