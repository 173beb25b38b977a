"""Ctrl-C at any moment: exit 130, one line, nothing half-written."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

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
