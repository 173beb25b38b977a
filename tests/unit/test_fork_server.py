"""Children are copies of a server that has loaded what they need: they know nothing of the process that asks for them,
and where there can be no copy they start by themselves."""

from __future__ import annotations

import os
import select
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from sprain_cosim import fork_server
from sprain_cosim.process import Child, Handlers, Limits, ProcessEnded, serve

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="a copy is made on Linux alone")
ENOUGH = 60.0  # s


@contextmanager
def _handlers(subject: object) -> Iterator[Handlers]:
    """The child that these tests start: this module."""

    def describe() -> dict[str, object]:
        own = [f"/proc/self/fd/{name}" for name in os.listdir("/proc/self/fd") if int(name) > 2]
        return {
            "subject": repr(subject),
            "parent": os.getppid(),
            "session": os.getsid(0) == os.getpid(),
            "folder": os.getcwd(),
            "variable": os.environ.get("SPRAIN_COSIM_OF_A_TEST"),
            "path": sys.path,
            "descriptors": [os.readlink(place) for place in own if os.path.lexists(place)],
            "draw": __import__("numpy").random.random(),
            "threads": len(os.listdir("/proc/self/task")),
        }

    yield {"describe": describe, "sleep": lambda: time.sleep(ENOUGH)}


@pytest.fixture
def start() -> Iterator[object]:
    opened: list[Child] = []

    def begin() -> Child:
        opened.append(Child(__name__, Limits()))
        opened[-1].open(None, ENOUGH)
        return opened[-1]

    try:
        yield begin
    finally:
        for child in opened:
            child.close()


def server() -> fork_server.ForkServer:
    assert fork_server._server is not None
    return fork_server._server


def test_a_child_knows_nothing_of_this_process(start, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:  # type: ignore[no-untyped-def]
    """Its own session, scratch folder and environment; of descriptors the two pipes; no current folder in its path;
    random numbers of its own."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SPRAIN_COSIM_OF_A_TEST", "set late")
    with (tmp_path / "open").open("w") as file, socket.socket() as line:
        assert file.fileno() and line.fileno()
        found = [start().call("describe", limit=ENOUGH) for _ in range(2)]
    for told in found:
        assert told["parent"] == server().process != os.getpid()
        assert told["session"]
        assert told["folder"] != str(tmp_path)
        assert told["variable"] == "set late"
        assert str(tmp_path) not in told["path"]
        assert "" not in told["path"]
        assert len(told["descriptors"]) == 2
        assert all(place.startswith("pipe:") for place in told["descriptors"])
        assert told["threads"] == 1
    assert found[0]["draw"] != found[1]["draw"]


def test_what_is_read_at_the_start_of_a_process_starts_one(start, monkeypatch: pytest.MonkeyPatch) -> None:  # type: ignore[no-untyped-def]
    start()
    monkeypatch.setenv("LD_LIBRARY_PATH", "/opt/vendor/lib")
    assert start().call("describe", limit=ENOUGH)["parent"] == os.getpid()


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_a_server_that_is_killed_or_stopped_costs_its_children_alone(number: int, start) -> None:  # type: ignore[no-untyped-def]
    child = start()
    before = server()
    process = before.process
    before._wire.settimeout(0.2)
    os.kill(process, number)
    if number == signal.SIGKILL:
        with pytest.raises(ProcessEnded, match="SIGKILL") as caught:
            child.call("sleep", limit=ENOUGH)
        assert caught.value.status == "crashed"
    assert start().call("describe", limit=ENOUGH)["parent"] == os.getpid()
    with pytest.raises(ProcessLookupError):
        os.kill(process, 0)
    assert start().call("describe", limit=ENOUGH)["parent"] == server().process != process


def test_the_answer_to_an_interrupted_question_is_passed_over(start) -> None:  # type: ignore[no-untyped-def]
    start()
    socket.send_fds(server()._wire, [b'{"number": 0, "ended": 1}'], [])
    assert start().call("describe", limit=ENOUGH)["parent"] == server().process


def test_a_copied_process_has_a_server_of_its_own(start, monkeypatch: pytest.MonkeyPatch) -> None:  # type: ignore[no-untyped-def]
    start()
    before = server()
    monkeypatch.setattr(before, "_owner", os.getpid() + 1)
    assert not before.serves_this_process
    start()
    assert server() is not before
    monkeypatch.undo()
    before.end()


def test_the_command_line_is_copied_itself(tmp_path: Path) -> None:
    """It has one thread and no foreign code: its child costs no start of Python. The copy imports nothing from the
    current folder, says nothing of what was on its way to stdout, and is gone with the program."""
    for name in ("lxml", "fmpy", "numpy"):
        (tmp_path / f"{name}.py").write_text("import pathlib; pathlib.Path(__file__).with_suffix('.ran').touch()\n")
    code = (
        "import sys\n"
        "here = sys.path.pop(0)\n"
        "from sprain_cosim import fork_server, process\n"
        "from sprain_cosim.cli import main\n"
        "import os, numpy\n"
        "sys.path.insert(0, here)\n"
        "print('on its way', end=' ')\n"
        "child = process.Child('tests.unit.test_fork_server', process.Limits())\n"
        "child.open(None, 60.0)\n"
        "told = child.call('describe', limit=60.0)\n"
        "mine = open(f'/proc/{fork_server._server.process}/cmdline').read() == open('/proc/self/cmdline').read()\n"
        "print(mine, told['parent'] == fork_server._server.process, here in told['path'], child.log() == '')\n"
        "print(fork_server._server.process)\n"
    )
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(p for p in sys.path if p), "OPENBLAS_NUM_THREADS": "1"}
    ran = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=environment, cwd=tmp_path, check=False
    )
    assert ran.stdout.splitlines()[0] == "on its way True True False True", ran.stderr
    with pytest.raises(ProcessLookupError):
        os.kill(int(ran.stdout.splitlines()[1]), 0)
    assert not list(tmp_path.glob("*.ran"))


def test_the_one_child_of_the_command_line_is_a_copy_with_its_subject(tmp_path: Path) -> None:
    """No server is made for it and nothing is sent; while it lives, and where foreign code is loaded, the next has a
    server or a Python of its own. It ends with this process."""
    code = (
        "import os, sys\n"
        "here = sys.path.pop(0)\n"
        "from sprain_cosim import fork_server, process\n"
        "from sprain_cosim.cli import main\n"
        "sys.path.insert(0, here)\n"
        "def child(subject):\n"
        "    made = process.Child('tests.unit.test_fork_server', process.Limits(), subject=subject)\n"
        "    made.open(subject, 60.0)\n"
        "    return made, made.call('describe', limit=60.0)\n"
        "unpicklable = lambda: 7\n"
        "one, told = child(unpicklable)\n"
        "print(told['subject'] == repr(unpicklable), told['parent'] == os.getpid(), fork_server._server is None)\n"
        "print(told['session'], told['folder'] != os.getcwd(), here in told['path'], len(told['descriptors']))\n"
        "other, told = child('sent')\n"
        "print(told['subject'], fork_server._server is not None, told['parent'] == fork_server._server.process)\n"
        "print(one._process.pid, flush=True)\n"
        "sys.stdin.read()\n"
    )
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(p for p in sys.path if p), "OPENBLAS_NUM_THREADS": "1"}
    ran = subprocess.Popen(
        [sys.executable, "-c", code],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=environment,
        cwd=tmp_path,
    )
    with ran:
        assert ran.stdout is not None
        said = [ran.stdout.readline().strip() for _ in range(4)]
        child = os.pidfd_open(int(said.pop()))
        ran.kill()
    assert said == ["True True True", "True True False 2", "'sent' True True"]
    ended = select.poll()
    ended.register(child, select.POLLIN)
    assert ended.poll(1e3 * ENOUGH), "the copy outlives the program"
    os.close(child)


if __name__ == "__main__":
    serve(_handlers)
