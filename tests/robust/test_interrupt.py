"""Ctrl-C at any moment: exit 130, one line, nothing half-written."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parent.parent.parent


@pytest.mark.parametrize("wait", ["Loading", "steps"])
def test_interrupt(wait: str, tmp_path: Path) -> None:
    """Interrupted while the FMUs are loaded, and in the middle of 150 000 steps: the child says itself when it is
    there."""
    code = f"""if True:
        import sys
        from sprain_cosim import cli
        from sprain_cosim.cosim.assembly import Assembly
        from sprain_cosim.fmu.fmi_instance import FmiInstance
        def tell(function):
            def told(*arguments, **keywords):
                print("here", flush=True)
                return function(*arguments, **keywords)
            return told
        if {wait!r} == "Loading":
            FmiInstance._new_instance = tell(FmiInstance._new_instance)
        else:
            Assembly.start = tell(Assembly.start)
        cli.main(["run", "incline30", "--step", "0.001 ms", "--out", {str(tmp_path / "out")!r}])
    """
    child = subprocess.Popen(
        [sys.executable, "-c", code],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    assert child.stdout is not None
    assert child.stdout.readline() == "here\n"
    child.send_signal(signal.SIGINT)
    _, said = child.communicate(timeout=30)
    assert child.returncode == 130, said
    assert said.splitlines() == ["error: interrupted"]
    assert not (tmp_path / "out").exists()


def test_an_interrupt_while_the_command_line_loads_is_one_line(tmp_path: Path) -> None:
    """It was a traceback of Python's. The wheel's script goes through the same module."""
    (tmp_path / "click.py").write_text("raise KeyboardInterrupt")
    ended = call("list", PYTHONPATH=os.pathsep.join((str(tmp_path), str(ROOT))))
    assert (ended.returncode, ended.stderr) == (130, "error: interrupted\n")
    scripts = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["scripts"]
    assert scripts == {"sprain-cosim": "sprain_cosim.__main__:main"}


@pytest.mark.skipif(os.name != "posix", reason="pipes of POSIX")
@pytest.mark.parametrize("arguments", [("subject",), ("--help",), ("run", "--help")], ids=" ".join)
def test_a_reader_that_goes_away_is_no_failure(arguments: tuple[str, ...]) -> None:
    """It had the exit code of a device that does not fit."""
    reader, writer = os.pipe()
    os.close(reader)
    ended = call(*arguments, stdout=writer)
    os.close(writer)
    assert (ended.returncode, ended.stderr) == (141, "")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no such device here")
def test_a_full_disk_behind_the_output_is_one_line() -> None:
    with open("/dev/full", "w") as full:
        ended = call("subject", stdout=full)
    assert ended.returncode == 4
    assert ended.stderr.startswith("error: ") and ended.stderr.endswith("No space left on device\n")
    assert len(ended.stderr.splitlines()) == 1


def call(*arguments: str, stdout: Any = subprocess.PIPE, **environment: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "sprain_cosim", *arguments]
    kept = {"cwd": ROOT, "env": os.environ | environment, "timeout": 120}
    return subprocess.run(command, stdout=stdout, stderr=subprocess.PIPE, text=True, **kept)  # type: ignore[call-overload,no-any-return]
