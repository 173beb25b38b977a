"""Result folders that several test modules look at."""

from __future__ import annotations

from pathlib import Path

import pytest

from .test_run import call

STUDY = ("study", "study6", "--trials", "24", "--workers", "1", "--progress", "none", "--out")


@pytest.fixture(scope="session")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run, two studies that differ in their initial pose, an AMV study of the same question, a comparison."""
    folder = tmp_path_factory.mktemp("results")
    assert call("run", "incline30_brace", "--out", str(folder / "run")).returncode == 0
    assert call(*STUDY, str(folder / "study")).returncode == 0
    assert call(*STUDY, str(folder / "touching"), "--set", "plant.initial_pose=touching").returncode == 0
    compared = (
        "compare",
        "incline30",
        "--brace",
        "soft=brace_linear",
        "--brace",
        "stiff=brace_bushing",
        "--out",
        str(folder / "compared"),
    )
    assert call(*compared).returncode == 0
    assert (
        call(
            "study", "amv6", "--no-check", "--workers", "1", "--progress", "none", "--out", str(folder / "amv")
        ).returncode
        == 0
    )
    return folder
