"""A run opens each FMU's archive once and parses its description once, however often the scenario is described."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parent.parent.parent
COUNTED = """
import json, sys
from collections import Counter

opened = Counter()
sys.addaudithook(
    lambda event, given: opened.update([str(given[0])]) if event == "open" and str(given[0]).endswith(".fmu") else None
)
from fmpy import model_description
from sprain_cosim.cli import _run

parse, parsed = model_description.read_model_description, []
model_description.read_model_description = lambda *given, **more: parsed.append(1) or parse(*given, **more)
code = _run(sys.argv[1:], [])
print(json.dumps([code, opened, len(parsed)]))
"""


def test_a_run_of_three_fmus_reads_each_once(tmp_path: Path) -> None:
    options = ["--set", "plant.drop_height=0.3 m", "--set", "brace.angle_scale=1.5", "--out", str(tmp_path / "out")]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    for _ in range(2):  # the first may unpack the archives
        done = subprocess.run(
            [sys.executable, "-c", COUNTED, "run", "incline30_mixed", *options],
            capture_output=True,
            text=True,
            env=environment,
            check=True,
        )
    code, opened, parsed = json.loads(done.stdout.splitlines()[-1])
    assert code == 0, done.stderr
    assert {Path(name).stem: count for name, count in opened.items()} == {
        "plant": 1,
        "reflex_controller": 1,
        "brace_bushing": 1,
    }
    assert parsed == 3
