"""The guard on the real plant: what a device does by itself is said, not refused, and no step is advised against it."""

from __future__ import annotations

from pathlib import Path

import pytest

from sprain_cosim import compare_braces
from sprain_cosim.scenario import load_scenario
from tests.laws import BRACES, brace, sampled
from tests.native import device

AWAY = "the device pushes away about subtalar (stiffness -30"


@pytest.mark.parametrize("step", [None, "0.05 ms"])
def test_an_over_centre_brace_runs(step: str | None, tmp_path: Path) -> None:
    """30 N.m/rad over its centre; the peak does not depend on the step."""
    scenario = load_scenario("incline30").replace_fmu("brace", brace(tmp_path / "brace.fmu", "OVER", saves=True))
    result = scenario.with_master(communication_step=step).run()
    assert result.status == "completed"
    assert result.warning.startswith(AWAY)
    assert "--step" not in result.warning
    assert result.metrics["peak_subtalar_angle_deg"] == pytest.approx(35.7, abs=0.2)


def test_an_over_centre_brace_is_compared(tmp_path: Path) -> None:
    done = compare_braces("incline30", {"snap": brace(tmp_path / "brace.fmu", "OVER")}, out=tmp_path / "out")
    assert not done.failed
    assert any(AWAY in warning for warning in done.entries[1].warnings)


def test_a_wrong_sign_is_named_before_any_oscillation(tmp_path: Path) -> None:
    """A spring that pushes: no word of steps or schemes, but of the sign."""
    scenario = load_scenario("incline30").replace_fmu("brace", device(tmp_path / "brace.fmu", sign=-1.0))
    result = scenario.with_master(stop="60 ms").run()
    assert result.status == "completed"
    assert "if it should resist, its sign is wrong (factor = -1 in a mapping file)" in result.warning
    assert "oscillation" not in result.warning
    assert "--step" not in result.warning


@pytest.mark.parametrize(
    ("law", "words"),
    [
        (
            "LOCK",
            "the device pushed the foot further away from neutral: 7.5 J about subtalar; if it should resist",
        ),
        ("STOP", "the device pushed the foot further away from neutral: 3.12 J about subtalar; if it should resist"),
        ("STRAP", "where the foot turns back, as that of a device that slides does (friction, hysteresis): its moment"),
        ("FED", "are its units right, those of its angles too?"),
    ],
)
def test_what_only_the_course_of_a_landing_shows(law: str, words: str, tmp_path: Path) -> None:
    """Devices that push beyond a threshold, or that are too stiff for a brace: nothing of it shows at the start."""
    scenario = load_scenario("incline30").replace_fmu("brace", brace(tmp_path / "brace.fmu", law))
    assert words in scenario.unconfined().run().warning


@pytest.mark.parametrize("law", BRACES)
def test_no_word_about_honest_braces(law: str, tmp_path: Path) -> None:
    scenario = load_scenario("incline30").replace_fmu("brace", brace(tmp_path / "brace.fmu", law))
    warning = scenario.unconfined().run().warning
    assert "sign" not in warning
    assert "units" not in warning


def test_a_slowly_sampled_brace_is_not_refused(tmp_path: Path) -> None:
    """200 N.m/rad held for 15 ms: the growth is that of the hold."""
    fmu = sampled(tmp_path / "brace.fmu", "subtalar", 200.0, 0.0, 0.015, fixed=True)
    result = load_scenario("incline30").replace_fmu("brace", fmu).run()
    assert result.status == "completed"
    assert "the device holds its torque for 15 ms" in result.warning
