"""The recipe for a brace repository: its files as the page shows them, run as a CI job runs them."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

from sprain_cosim.validation.checks.user_files import read_checks
from tests.docs_commands import ROOT, blocks, play

PAGE = ROOT / "docs" / "ci.md"
FILES = {b.mark.removeprefix("file: "): b.text for b in blocks(PAGE) if b.mark.startswith("file: ")}


def test_the_jobs_run_the_script_and_keep_what_it_writes() -> None:
    yaml = pytest.importorskip("yaml", reason="the extra [docs] is not installed")
    github = yaml.safe_load(FILES[".github/workflows/brace.yml"])["jobs"]["land"]["steps"]
    gitlab = yaml.safe_load(FILES[".gitlab-ci.yml"])["land"]
    assert "sh ci.sh" in [step.get("run") for step in github]
    assert "sh ci.sh" in gitlab["script"]
    kept = [step["with"]["path"].split() for step in github if "path" in step.get("with", {})]
    assert kept == [gitlab["artifacts"]["paths"]]
    assert gitlab["artifacts"]["reports"]["junit"] in FILES["ci.sh"]


def test_the_checks_are_read(tmp_path: Path) -> None:
    (tmp_path / "strap.toml").write_text(FILES["checks/strap.toml"].replace("../strap.fmu", "brace_bushing"), "utf-8")
    assert [check.id for check in read_checks(tmp_path)] == ["custom-reference-landing", "custom-level-95"]


@pytest.mark.long
def test_a_weaker_brace_fails(tmp_path: Path) -> None:
    """As committed everything passes; with a weaker strap the checks and the comparison say so."""
    assert play(PAGE, tmp_path) == 1  # writes the files and makes the release
    assert _step(tmp_path, "sh", "ci.sh").returncode == 0
    assert _failures(tmp_path) == 0
    bench = tmp_path / "strap.csv"
    bench.write_text(bench.read_text("utf-8").replace("20.0", "12.0").replace("11.0", "7.0"), "utf-8")
    assert _step(tmp_path, "sh", "ci.sh").returncode == 1
    assert _failures(tmp_path) == 2
    worse = _step(tmp_path, sys.executable, "worse.py")
    assert worse.returncode == 1
    assert "further" in worse.stderr


def _step(folder: Path, *command: str) -> subprocess.CompletedProcess[str]:
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    return subprocess.run(
        command, cwd=folder, env={**os.environ, "PATH": path}, capture_output=True, text=True, timeout=600, check=False
    )


def _failures(folder: Path) -> int:
    return int(ElementTree.parse(folder / "junit.xml").getroot().get("failures", "-1"))
