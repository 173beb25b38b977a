"""Landings as tables for other tools, and the choice of a trial."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace
from io import StringIO
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from sprain_cosim.errors import InputError
from sprain_cosim.export.landing import COORDINATES, forces, ground, states, write_landing
from sprain_cosim.folders.landing import Landing, choose_trial
from sprain_cosim.scenario import load_scenario
from sprain_cosim.shipped import fmu_path

PLANT = fmu_path("plant", Path.cwd(), "plant")
OPENSIM = os.environ.get("SPRAIN_OPENSIM_PYTHON", sys.executable)  # a Python that has the package opensim
READ = """
import sys
try:
    import opensim
except ImportError:
    sys.exit(77)
table, storage = opensim.TimeSeriesTable(sys.argv[1]), opensim.Storage(sys.argv[1])
print(table.getNumRows(), table.getNumColumns(), int(storage.isInDegrees()), table.getIndependentColumn()[-1], sep=",")
for label in sys.argv[2:]:
    column = table.getDependentColumn(label)
    print(label, column[column.size() - 1], sep=",")
"""


@pytest.fixture(scope="module")
def landing() -> Landing:
    chosen = load_scenario("incline30_brace").with_master(stop="60 ms").recording("plant.*")
    return Landing(
        "landing", chosen.heading, chosen.initial_pose(), chosen.run(), {"plant.platform_incline": np.pi / 6}, PLANT
    )


def parse(path: Path) -> tuple[dict[str, str], pd.DataFrame]:
    """A storage file by the rules of OpenSim's reader: header until endheader, then labels and rows."""
    head, _, body = path.read_text().partition("endheader\n")
    return dict(line.split("=", 1) for line in head.splitlines() if "=" in line), pd.read_csv(
        StringIO(body), sep="\t", index_col=0
    )


def test_coordinates_in_degrees(landing: Landing, tmp_path: Path) -> None:
    assert write_landing(landing, tmp_path / "x.mot") == (121, 15)
    head, table = parse(tmp_path / "x.mot")
    assert (head["nRows"], head["nColumns"], head["inDegrees"]) == ("121", "16", "yes")
    assert tuple(table.columns) == COORDINATES
    assert table.index.name == "time"
    result = landing.result
    assert table["subtalar_angle_r"].to_numpy() == pytest.approx(np.degrees(result["plant.subtalar_angle"]), abs=1e-8)
    assert table["pelvis_ty"].to_numpy() == pytest.approx(result["plant.pelvis_ty"], abs=1e-9)
    write_landing(landing, tmp_path / "x.sto", content="coordinates")
    head, table = parse(tmp_path / "x.sto")
    assert head["inDegrees"] == "no"
    assert table["subtalar_angle_r"].to_numpy() == pytest.approx(result["plant.subtalar_angle"], abs=1e-9)


def test_states_are_complete_and_consistent(landing: Landing) -> None:
    table = states(landing)
    assert table.shape == (121, 2 * 15 + 2 * 49)
    middle = slice(60, 110)
    for path in (
        "/jointset/ankle_r/ankle_angle_r",
        "/jointset/ground_pelvis/pelvis_ty",
        "/jointset/hip_r/hip_flexion_r",
    ):
        slope = np.gradient(table[f"{path}/value"].to_numpy(), table.index.to_numpy())
        assert slope[middle] == pytest.approx(table[f"{path}/speed"].to_numpy()[middle], abs=0.02 * np.abs(slope).max())
    activation = table.filter(like="/activation")
    assert activation.shape[1] == 49
    assert activation.to_numpy().min() >= 0.0
    assert activation.to_numpy().max() <= 1.0


def test_ground_reaction_and_forces(landing: Landing) -> None:
    table = ground(landing)
    assert table.columns[3] == "ground_force_px"
    k = int(np.argmax(landing.result["plant.ground_force"]))
    assert np.linalg.norm(table.iloc[k, :3]) == pytest.approx(landing.result["plant.ground_force"][k])
    normal = np.array([0.0, np.cos(np.pi / 6), np.sin(np.pi / 6)])
    assert (table.iloc[k, 3:6].to_numpy() - [-0.2, 0.015, 0.35]) @ normal == pytest.approx(0.0, abs=1e-12)
    assert np.cross(table.iloc[k, 6:9].to_numpy(float), normal) == pytest.approx(np.zeros(3), abs=1e-12)
    loads = forces(landing)
    assert loads["brace_subtalar_moment"].to_numpy() == pytest.approx(landing.result["plant.brace_subtalar_moment"])
    assert loads["soleus_r"].max() > 500.0


def test_csv_and_parquet_hold_every_signal(landing: Landing, tmp_path: Path) -> None:
    write_landing(landing, tmp_path / "x.csv")
    table = pd.read_csv(tmp_path / "x.csv", index_col=0)
    assert table.index.name == "time [s]"
    assert table.shape == landing.result.values.shape
    assert table["plant.subtalar_angle [rad]"].to_numpy() == pytest.approx(
        landing.result["plant.subtalar_angle"], abs=1e-10
    )
    pytest.importorskip("pyarrow")
    write_landing(landing, tmp_path / "x.parquet")
    assert np.array_equal(pd.read_parquet(tmp_path / "x.parquet").to_numpy(), landing.result.values)


def test_opensim_reads_it(landing: Landing, tmp_path: Path) -> None:
    asked = {"x.mot": "ankle_angle_r", "x.sto": "/forceset/soleus_r/fiber_length"}
    expected = {
        "x.mot": np.degrees(landing.result["plant.ankle_angle_r"][-1]),
        "x.sto": landing.result["plant.soleus_r_fibre_length"][-1],
    }
    for name, label in asked.items():
        rows, columns = write_landing(landing, tmp_path / name)
        ended = subprocess.run(
            [OPENSIM, "-c", READ, name, label], cwd=tmp_path, capture_output=True, text=True, timeout=120
        )
        if ended.returncode == 77:
            pytest.skip("the package opensim is not installed (set SPRAIN_OPENSIM_PYTHON to a Python that has it)")
        assert ended.returncode == 0, ended.stderr
        size, value = (line.split(",") for line in ended.stdout.strip().splitlines()[-2:])
        assert [int(size[0]), int(size[1]), int(size[2])] == [rows, columns, name == "x.mot"]
        assert float(size[3]) == pytest.approx(0.060)
        assert float(value[1]) == pytest.approx(expected[name], rel=1e-9)


def test_what_cannot_be_exported_says_why(landing: Landing, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"format 'stoo' is unknown .did you mean sto"):
        write_landing(landing, tmp_path / "x.stoo")
    plain = replace(landing, label="old", result=load_scenario("incline30").with_master(stop="2 ms").run())
    with pytest.raises(InputError, match="old: its record has no pelvis_tilt"):
        write_landing(plain, tmp_path / "x.mot")
    assert list(tmp_path.iterdir()) == []


def test_a_trial_by_number_worst_or_percentile() -> None:
    table = pd.DataFrame(
        {"trial": [0, 1, 2, 5, 7], "status": ["completed"] * 4 + ["failed"], "peak": [10.0, 40.0, 20.0, 30.0, 99.0]}
    )
    assert choose_trial(table, "peak", "5", "s") == (5, "trial 5")
    assert choose_trial(table, "peak", "7", "s")[0] == 7
    assert choose_trial(table, "peak", "worst", "s")[0] == 1  # a failed trial has no peak
    assert [choose_trial(table, "peak", f"p{p}", "s")[0] for p in (0, 30, 50, 70, 100)] == [0, 2, 2, 5, 1]
    for rounding in (1.0 - 1e-15, 1.0, 1.0 + 1e-15):  # p50 lies between two trials; rounding does not choose
        other = table.assign(peak=table["peak"] * [1.0, 1.0, rounding, 1.0 / rounding, 1.0])
        assert choose_trial(other, "peak", "p50", "s")[0] == 2
    for wrong, words in (
        ("6", "has no trial 6; they are numbered 0 ... 7"),
        ("p101", "must be a number, worst, or a percentile"),
        ("best", "must be"),
        ("", "--trial '': must be"),
    ):
        with pytest.raises(InputError, match=words):
            choose_trial(table, "peak", wrong, "s")
    with pytest.raises(InputError, match="no completed trial has other"):
        choose_trial(table, "other", "worst", "s")
