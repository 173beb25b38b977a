"""A device's parameters from a bench table: found again, with their intervals, or refused in one line."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from sprain_cosim.brace.calibrate import Calibration, calibrate, write_calibration
from sprain_cosim.errors import InputError
from sprain_cosim.shipped import fmu_path

STIFFNESS, REST = 37.0, math.radians(2.0)
VARY = {"subtalar_stiffness_coefficient": "5..90 N.m/rad", "subtalar_rest_angle": "-5..5 deg"}


@pytest.fixture(scope="module")
def fmu() -> Path:
    return fmu_path("brace_linear", Path.cwd(), "brace_linear")


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Thirty rows of a spring, with 0.2 N.m of noise."""
    path = tmp_path_factory.mktemp("bench") / "bench.csv"
    angles = np.linspace(-20.0, 30.0, 30)
    torque = STIFFNESS * (np.radians(angles) - REST) + 0.2 * np.random.default_rng(4).standard_normal(30)
    rows = "\n".join(f"{a:.4f},{t:.5f}" for a, t in zip(angles, torque, strict=True))
    path.write_text(f"angle [deg],subtalar_resistance [N.m]\n{rows}\n")
    return path


@pytest.fixture(scope="module")
def found(fmu: Path, bench: Path) -> Calibration:
    return calibrate(fmu, bench, VARY)


def test_parameters_are_found_with_their_intervals(found: Calibration, tmp_path: Path) -> None:
    stiffness, rest = found.parameters
    for parameter, truth in ((stiffness, STIFFNESS), (rest, REST)):
        assert parameter.low is not None and parameter.high is not None
        assert parameter.low < truth < parameter.high
    assert stiffness.high is not None and stiffness.high - stiffness.value < 1.5
    assert found.rms == pytest.approx(0.2, rel=0.3) and found.rms < 0.2 * found.rms_before and not found.notes
    assert found.settings() == f'--set brace.{stiffness.name}="{stiffness.text}" --set brace.{rest.name}="{rest.text}"'
    write_calibration(tmp_path / "values.toml", found, "bench.csv")
    assert stiffness.text in (tmp_path / "values.toml").read_text()
    assert (tmp_path / "values.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("ranges", "text"),
    [
        ({"subtalar_stifness_coefficient": "5..90 N.m/rad"}, "did you mean"),
        ({"subtalar_stiffness_coefficient": "90..5 N.m/rad"}, "must rise"),
        ({"subtalar_stiffness_coefficient": "5..90"}, "needs a unit"),
        ({"subtalar_stiffness_coefficient": "40 N.m/rad"}, "LOW..HIGH"),
        ({}, "name a parameter"),
    ],
)
def test_what_cannot_be_fitted(fmu: Path, bench: Path, ranges: dict[str, str], text: str) -> None:
    with pytest.raises(InputError, match=text):
        calibrate(fmu, bench, ranges)


def test_what_the_table_does_not_tell_is_said(fmu: Path, bench: Path) -> None:
    """A damping moves no held torque, and a range that ends too early is named."""
    found = calibrate(
        fmu,
        bench,
        {"subtalar_stiffness_coefficient": "5..20 N.m/rad", "subtalar_damping_coefficient": "0.1..2 N.m.s/rad"},
    )
    assert any("end of its range" in note for note in found.notes)
    assert any("cannot tell" in note for note in found.notes)
    assert all(p.low is None for p in found.parameters)
