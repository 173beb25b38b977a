"""The same FMU pair under libcosim's fixed-step algorithm and under scheme jacobi: equal to 1e-12. libcosim needs an
environment of its own: python -m venv DIR; DIR/bin/pip install libcosimpy; SPRAIN_LIBCOSIM=DIR/bin/python (found
without it where `make bench` has made one)."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path

import numpy as np
import pytest

from sprain_cosim.cosim.master import Master
from sprain_cosim.cosim.system import System, connect
from sprain_cosim.fmu.component import Component
from tests.native import device

ROOT = Path(__file__).parent.parent.parent
PYTHON = Path(os.environ.get("SPRAIN_LIBCOSIM", ROOT / "build" / "peers" / "libcosim" / "bin" / "python"))
STEPS, STEP_NS = 300, 500_000


def pair(folder: Path) -> tuple[Component, Component]:
    """A foot and a viscoelastic, stiffening brace, both in C; neither answers in its own step to what the other one
    does in it."""
    foot = device(
        folder / "foot.fmu",
        names=("brace_subtalar_torque", "subtalar_angle"),
        angle="N.m",
        torque="rad",
        behaviour={"FOOT": 1, "TORQUE_UNIT": 1.0, "ANGLE_UNIT": 1.0},
    )
    return Component.read("plant", foot), Component.read("brace", device(folder / "brace.fmu"))


@pytest.mark.skipif(
    not PYTHON.exists(),
    reason=f"no environment with libcosimpy ({PYTHON}); make one and set SPRAIN_LIBCOSIM to its Python",
)
def test_jacobi_is_libcosim_s_fixed_step_algorithm(tmp_path: Path) -> None:
    parts = pair(tmp_path)
    system = System(parts, connect(parts, {})[0])
    assembly = system.open()
    ours = Master(1e-9 * STEP_NS, 1e-9 * STEP_NS * STEPS, scheme="jacobi", guard=False).run(assembly, {})
    assembly.close()
    assert ours.status == "completed", ours.message
    assert np.ptp(ours["plant.subtalar_angle"]) > 0.1
    watch = ["plant.subtalar_angle", "brace.subtalar_torque"]

    def end(name: str) -> tuple[str, int]:
        return name.partition(".")[0], system.find(name).reference

    task = {
        "step_ns": STEP_NS,
        "steps": STEPS,
        "fmus": {c.name: str(c.fmu) for c in parts},
        "connections": [(end(source), end(target)) for target, source in system.connections.items()],
        "watch": [end(name) for name in watch],
    }
    outcome = subprocess.run(
        [PYTHON, Path(__file__).with_name("libcosim_run.py")],
        input=json.dumps(task),
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert outcome.returncode == 0, outcome.stderr
    theirs = np.array(json.loads(outcome.stdout))
    for k, name in enumerate(watch):
        difference = np.abs(ours[name][1:] - theirs[:, k])
        print(f"{name}: largest difference {difference.max():.3g}, in the first step {difference[0]:.3g}")
        assert difference.max() <= 1e-12 * max(1.0, np.abs(theirs[:, k]).max())
