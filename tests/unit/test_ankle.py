"""A measured ankle: the passive law from torque-angle tables, with intervals, and the brace between two tables."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from sprain_cosim.brace.ankle import MeasuredAnkle, brace_between, measured_ankle
from sprain_cosim.cli import _run
from sprain_cosim.errors import InputError
from sprain_cosim.fmu.component import Component
from sprain_cosim.fmu.driver import Driver
from sprain_cosim.literature import PASSIVE
from sprain_cosim.scenario import load_scenario

DEGREES = np.linspace(-20.0, 45.0, 27)


def csv(path: Path, columns: Mapping[str, np.ndarray], degrees: np.ndarray = DEGREES) -> Path:
    names = ["angle [deg]", *(f"{name} [N.m]" for name in columns)]
    rows = [",".join(f"{v:.12g}" for v in row) for row in zip(degrees, *columns.values(), strict=True)]
    path.write_text("\n".join([",".join(names), *rows]) + "\n")
    return path


def euler(degrees: np.ndarray = DEGREES) -> dict[str, np.ndarray]:
    """Of the model's law about its three axes."""
    t = np.radians(degrees)
    return {f"{axis}_resistance": t * (a + t * (b + t * c)) for axis, (a, b, c) in PASSIVE.items()}


@pytest.fixture(scope="module")
def hinges() -> dict[str, np.ndarray]:
    """What the plant's own ankle resists about its hinges, one turned at a time."""
    plant = next(c for c in load_scenario("incline30").components() if c.name == "plant")
    out: dict[str, list[float]] = {"subtalar_resistance": [], "talocrural_resistance": []}
    with Driver(plant, (), ["anatomy_subtalar_moment", "anatomy_talocrural_moment"]) as driver:
        for angle in np.radians(DEGREES):
            for joint, other in (("subtalar", "talocrural"), ("talocrural", "subtalar")):
                driver.start({f"{joint}_angle_at_contact": angle, f"{other}_angle_at_contact": 0.0}, stop=1.0)
                out[f"{joint}_resistance"].append(driver[f"anatomy_{joint}_moment"])
    return {name: np.array(values) for name, values in out.items()}


def ratios(found: MeasuredAnkle) -> dict[str, float]:
    return {c.parameter: c.value / c.model for c in found.coefficients}


def test_a_table_about_the_three_axes_gives_all_nine_coefficients(tmp_path: Path) -> None:
    found, _ = measured_ankle(csv(tmp_path / "x.csv", euler()))
    assert list(ratios(found).values()) == pytest.approx([1.0] * 9, rel=1e-8)
    assert found.rms == pytest.approx(0.0, abs=1e-9)
    assert "rotation_z: data from -20 to 45 deg" in found.listing()
    one, _ = measured_ankle(csv(tmp_path / "y.csv", {"rotation_y_resistance": 1.5 * euler()["rotation_y_resistance"]}))
    assert [c.fitted for c in one.coefficients] == [False] * 3 + [True] * 3 + [False] * 3
    assert ratios(one)["passive_y_cubic"] == pytest.approx(1.5)
    assert ratios(one)["passive_x_cubic"] == 1.0


def test_intervals_cover_what_they_say(tmp_path: Path) -> None:
    """95 % of 120 noisy tables, within three standard errors; the scatter of each axis is its own."""
    random = np.random.default_rng(7)
    inside = np.zeros(9)
    for _ in range(120):
        noise = {"rotation_x_resistance": 0.5, "rotation_y_resistance": 0.1, "rotation_z_resistance": 0.02}
        columns = {n: v + random.normal(0, noise[n], len(v)) for n, v in euler().items()}
        found, _ = measured_ankle(csv(tmp_path / "x.csv", columns))
        inside += [c.low <= c.model <= c.high for c in found.coefficients]
    assert (np.abs(inside / 120 - 0.95) <= 3 * math.sqrt(0.95 * 0.05 / 120)).all(), inside


def test_tables_about_the_hinges_scale_the_model(hinges: Mapping[str, np.ndarray], tmp_path: Path) -> None:
    """Against the moments that the plant itself gives: the virtual work is that of its joints."""
    found, _ = measured_ankle(csv(tmp_path / "x.csv", {n: 1.3 * v for n, v in hinges.items()}))
    assert list(ratios(found).values()) == pytest.approx([1.3] * 9, rel=1e-6)
    assert found.rms < 1e-6
    alone, _ = measured_ankle(csv(tmp_path / "y.csv", {"subtalar_resistance": hinges["subtalar_resistance"]}))
    assert list(ratios(alone).values()) == pytest.approx([1.0] * 9, rel=1e-6)
    assert any("rotation_z: not measured" in note for note in alone.notes)
    assert any("a hinge cannot tell its axes apart" in note for note in alone.notes)
    with pytest.raises(InputError, match=r"about hinges .*give a table of one kind"):
        measured_ankle(csv(tmp_path / "z.csv", {**hinges, **euler()}))


def test_the_brace_is_what_the_second_table_has_more(hinges: Mapping[str, np.ndarray], tmp_path: Path) -> None:
    bare = csv(tmp_path / "bare.csv", {"subtalar_resistance": hinges["subtalar_resistance"]})
    brace = 30.0 * np.radians(DEGREES)
    worn = csv(tmp_path / "worn.csv", {"subtalar_resistance": (hinges["subtalar_resistance"] + brace)[3:]}, DEGREES[3:])
    _, curves = measured_ankle(bare)
    rows = np.array(brace_between(worn, curves, bare)["subtalar"]["loading"])
    assert np.degrees(rows[[0, -1], 0]) == pytest.approx([DEGREES[3], DEGREES[-1]])
    assert rows[:, 1] == pytest.approx(-30.0 * rows[:, 0], abs=1e-9)
    with pytest.raises(InputError, match="held less than without; are the tables swapped"):
        brace_between(bare, measured_ankle(worn)[1], worn)
    with pytest.raises(InputError, match=r"which .*bare\.csv does not: nothing to subtract"):
        brace_between(csv(tmp_path / "other.csv", {"talocrural_resistance": brace}), curves, bare)
    with pytest.raises(InputError, match="these curves are about Euler axes"):
        brace_between(worn, measured_ankle(csv(tmp_path / "e.csv", euler()))[1], tmp_path / "e.csv")
    far = csv(tmp_path / "far.csv", {"subtalar_resistance": 30.0 * np.arange(46.0, 50.0)}, np.arange(46.0, 50.0))
    with pytest.raises(InputError, match="fewer than three rows at angles"):
        brace_between(far, curves, bare)


def test_one_command_makes_the_ankle_and_the_brace(
    hinges: Mapping[str, np.ndarray], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bare = csv(tmp_path / "bare.csv", {"subtalar_resistance": 1.2 * hinges["subtalar_resistance"]})
    more = 1.2 * hinges["subtalar_resistance"] + 60.0 * np.radians(DEGREES)
    worn, target = csv(tmp_path / "worn.csv", {"subtalar_resistance": more}), tmp_path / "own.toml"
    target.write_text("mine")
    assert _run(["anatomy", "from-csv", str(bare), "--with-brace", str(worn), "-o", str(target)], []) == 0
    told, warned = capsys.readouterr()
    assert f"warning: {target}: is overwritten; the next version asks for --force\n" in warned
    assert "subtalar: -20 ... 45 deg; outside, the torque goes straight on" in told
    assert "95 % interval" in told
    scenario = load_scenario(target)
    stiffer = scenario.run().metrics["peak_subtalar_angle_deg"]
    assert stiffer < load_scenario("incline30").run().metrics["peak_subtalar_angle_deg"] - 1.0
    braced = scenario.replace_fmu("brace", tmp_path / "own_brace.fmu").run()
    assert braced.metrics["peak_subtalar_angle_deg"] < stiffer - 1.0
    assert Component.read("brace", tmp_path / "own_brace.fmu").outputs
    assert (tmp_path / "own.png").read_bytes().startswith(b"\x89PNG")


def test_what_a_table_leaves_open_is_said(tmp_path: Path) -> None:
    shifted, _ = measured_ankle(csv(tmp_path / "a.csv", {n: v + 4.0 for n, v in euler().items()}))
    assert any("is the table's zero the neutral pose?" in note for note in shifted.notes)
    weak = {"rotation_x_resistance": 20.0 * np.radians(DEGREES) - 30.0 * np.radians(DEGREES) ** 3}
    pushing, _ = measured_ankle(csv(tmp_path / "b.csv", weak))
    assert any("the fitted law pushes the foot" in note for note in pushing.notes)
    away = np.linspace(5.0, 40.0, 8)
    beyond, _ = measured_ankle(csv(tmp_path / "c.csv", euler(away), away))
    assert any("does not reach the neutral pose" in note for note in beyond.notes)
    loaded = euler()["rotation_x_resistance"]
    both = {"rotation_x_resistance_loading": 1.3 * loaded, "rotation_x_resistance_unloading": 0.7 * loaded}
    mean, _ = measured_ankle(csv(tmp_path / "d.csv", both))
    assert ratios(mean)["passive_x_linear"] == pytest.approx(1.0, rel=1e-6)
    assert any("loading and unloading differ" in note for note in mean.notes)
    few = np.array([-10.0, 5.0, 20.0])
    exact, _ = measured_ankle(csv(tmp_path / "e.csv", euler(few), few))
    assert {c.low for c in exact.coefficients} == {None}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            "angle [deg],inversion_torque [N.m]\n0,0\n1,-1\n2,-2\n",
            "rotation_y and rotation_z; measure about one of these",
        ),
        ("angle [deg],rotation_x_torque [N.m]\n-10,-5\n0,0\n10,5\n", "pushes the foot further instead of resisting"),
        (
            "angle [deg],rotation_x_resistance [N.m]\n0,0\n1,x\n2,2\n",
            "row 3, column 2 (rotation_x_resistance [N.m]): 'x'",
        ),
        ("angle [deg],rotation_x_resistance [m]\n0,0\n1,1\n2,2\n", "m is not a unit of torque"),
        ("angle [deg],subtalar_resistance [N.m]\n-1,-1\n0,0\n", "needs a header and at least three rows"),
    ],
)
def test_a_table_that_cannot_be_used_is_refused_in_one_line(
    text: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "x.csv").write_text(text)
    assert _run(["anatomy", "from-csv", str(tmp_path / "x.csv"), "-o", str(tmp_path / "y.toml")], []) == 2
    told = capsys.readouterr().err
    assert said in told
    assert told.count("\n") == 1
    assert not (tmp_path / "y.toml").exists()
