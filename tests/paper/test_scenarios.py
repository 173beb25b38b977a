"""The six scenarios against the paper's study means (Yoder, Petrella & Farrokhi 2021, doi 10.3389/fbioe.2021.765331;
the published base cases, and the same landings with the foot just touching simulated with OpenSim 4.6), and their
numerical convergence."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from sprain_cosim.cosim.result import PEAK
from sprain_cosim.literature import GROUND_TEXT
from sprain_cosim.scenario import load_scenario
from sprain_cosim.shipped import shipped_scenarios

PUBLISHED = {
    "level": 0.8,
    "incline30": 48.5,
    "incline30_reflex": 42.1,
    "incline30_coactivation": 30.4,
    "incline30_brace": 30.0,
    "incline30_mixed": 30.8,
}
TOUCHING = {
    "level": 1.1,
    "incline30": 49.6,
    "incline30_reflex": 38.6,
    "incline30_coactivation": 31.6,
    "incline30_brace": 29.8,
    "incline30_mixed": 28.3,
}
CASES = [
    (name, pose, peak)
    for pose, peaks in (("published", PUBLISHED), ("touching", TOUCHING))
    for name, peak in peaks.items()
]

# mean and standard deviation of the inputs (Table 1 of the paper; angles in rad)
PLANT = {
    "plant.drop_height": (0.30, 0.05),
    "plant.talocrural_angle_at_contact": (math.radians(-34.0), math.radians(5.0)),
    "plant.subtalar_angle_at_contact": (0.0, math.radians(5.0)),
    "plant.contact_modulus": (50e6, 5e6),
    "plant.contact_dissipation": (5.0, 1.0),
    "plant.passive_angle_scale": (1.0, 0.0625),
    "plant.ankle_strength_scale": (1.0, 0.05),
}
MIXED = {
    **PLANT,
    "brace.angle_scale": (1.5, 0.0625),
    "controller.coactivation": (0.20, 0.05),
    "controller.reflex_gain": (5.0, 1.0),
}


def peak(name: str, pose: str, step: str | None = None, tolerance: float | None = None, **_: object) -> float:
    scenario = load_scenario(name).override("plant.initial_pose", pose).with_master(communication_step=step)
    if tolerance:
        scenario = scenario.override("plant.tolerance", tolerance)
    return scenario.run().metrics["peak_subtalar_angle_deg"]


@pytest.mark.parametrize(("name", "pose", "expected"), CASES)
def test_peak_subtalar_supination(name: str, pose: str, expected: float) -> None:
    assert peak(name, pose) == pytest.approx(expected, abs=0.5)


@pytest.mark.parametrize(("name", "pose"), [(name, pose) for name, pose, _ in CASES])
def test_a_tenth_of_the_tolerance_and_half_the_step_change_little(name: str, pose: str) -> None:
    assert peak(name, pose, "0.25 ms", 2e-4) == pytest.approx(peak(name, pose), abs=0.2)


def corners(inputs: dict[str, tuple[float, float]]) -> list[dict[str, float]]:
    """All at +3 SD, all at -3 SD, 20 seeded random sign patterns; shares stay at or above zero."""
    rng = np.random.default_rng(20211208)
    signs = [np.ones(len(inputs)), -np.ones(len(inputs)), *rng.choice([-1.0, 1.0], (20, len(inputs)))]
    return [
        {
            name: max(mean + 3 * s * sd, 0.0) if mean > 0 else mean + 3 * s * sd
            for s, (name, (mean, sd)) in zip(sign, inputs.items(), strict=True)
        }
        for sign in signs
    ]


@pytest.mark.parametrize("pose", ["published", "touching"])
@pytest.mark.parametrize(("name", "inputs"), [("incline30", PLANT), ("incline30_mixed", MIXED)])
def test_corners_are_as_converged_as_the_mean(name: str, inputs: dict[str, tuple[float, float]], pose: str) -> None:
    scenario = load_scenario(name).override("plant.initial_pose", pose)
    fine = scenario.with_master(communication_step="0.25 ms").override("plant.tolerance", 2e-4)
    with scenario.open() as usual, fine.open() as better:
        changes = []
        for corner in corners(inputs):
            results = usual.run(corner), better.run(corner)
            assert [r.status for r in results] == ["completed", "completed"], [r.message for r in results]
            changes.append(
                results[0].metrics["peak_subtalar_angle_deg"] - results[1].metrics["peak_subtalar_angle_deg"]
            )
    assert max(map(abs, changes)) < 0.2


def test_other_grounds_land_and_the_page_has_their_numbers() -> None:
    """On ice the foot slips instead of turning; a step's edge under the outer sole turns it where a level floor does
    not."""
    page = (Path(__file__).parents[2] / "docs" / "other-landings.md").read_text("utf-8")
    rows = {c[1].strip(" `"): c for line in page.splitlines() if len(c := line.split("|")) == 7}
    peaks = {}
    for name in ("surface_gym_floor", "surface_turf", "surface_ice", "surface_sand", "step_edge"):
        scenario = load_scenario(name)
        result = scenario.run()
        assert result.status == "completed", result.message
        peaks[name] = result.metrics["peak_subtalar_angle_deg"]
        if name in rows:
            parameters = scenario.system().parameters
            keys = ("contact_modulus", "contact_dissipation", "contact_friction")
            stated = [float(cell.split()[0]) for cell in rows[name][2:5]]
            found = [float(parameters[f"plant.{key}"]) for key in keys]
            assert stated == pytest.approx([found[0] / 1e6, *found[1:]])
            assert parameters["plant.contact_viscous_friction"] == 0.0
    assert len(rows.keys() & peaks.keys()) == 4
    assert peaks["surface_ice"] < 20.0 < 30.0 < peaks["step_edge"]


@pytest.mark.parametrize("name", shipped_scenarios())
def test_no_scenario_warns_at_its_own_settings(name: str) -> None:
    scenario = load_scenario(name)
    result = scenario.run(halve=True)
    assert (result.status, result.warning, scenario.doubts()) == ("completed", "", [])
    assert result.converged


@pytest.mark.parametrize("name", ["surface_gym_floor", "surface_sand", "step_edge", "incline30"])
def test_the_doubt_of_the_step_holds_the_error_of_the_plants_own_steps(name: str) -> None:
    """At the default tolerance; without a viscous part of the friction that leaves 0.1 to 0.2 deg, which is said."""
    scenario = load_scenario(name).override("plant.tolerance", 0.0025).with_master(stop="150 ms")
    result = scenario.run(halve=True)
    exact = scenario.override("plant.tolerance", 2.5e-5).run().metrics[PEAK]
    assert result.coupling_doubt is not None
    assert abs(result.metrics[PEAK] - exact) < 1.25 * result.coupling_doubt
    assert result.converged is (name == "incline30")


def test_a_landing_that_is_cut_short_says_so() -> None:
    scenario = load_scenario("step_edge")
    whole = scenario.run()
    cut = scenario.with_master(stop="150 ms").run()
    assert whole.metrics[PEAK] > cut.metrics[PEAK] + 10.0
    assert cut.warning.startswith(
        "the foot still turned at the stop (150 ms): its peak is the largest angle till then; "
    )
    assert cut.warning.endswith('--stop "300 ms" shows how it goes on')
    assert '--stop "150 ms" shows how it goes on' in scenario.with_master(stop="30 ms").run().warning


def test_peaks_that_are_of_no_roll_or_of_no_standing_body_say_so() -> None:
    """A foot that turns inwards has its peak at contact; a body that has sunk into the ground has the largest speed."""
    scenario = load_scenario("incline30").override("plant.drop_height", "0.8 m")
    sunk = scenario.recording("plant.pelvis_ty").with_master(stop="500 ms").run()
    assert sunk["plant.pelvis_ty"].min() < 0.0  # m: below the pivot of the platform
    assert sunk["plant.pelvis_ty"][sunk.time <= 0.3].min() > 0.2
    assert 'peaks of that time are of no landing (subtalar velocity 491 ms); --stop "300 ms"' in sunk.warning
    assert scenario.with_master(stop="300 ms").run().warning == ""
    inwards = load_scenario("incline30").override("plant.platform_incline", "-15 deg").run()
    assert inwards.metrics["time_of_peak_subtalar_s"] == 0.0
    assert inwards.warning == "the foot never rolled outwards: its peak is the angle at contact"
    assert load_scenario("incline30").run().warning == ""


def test_drops_and_slopes_that_were_never_tried_are_said() -> None:
    scenario = load_scenario("incline30")
    for name, tried, untried in (
        ("plant.drop_height", "80 cm", "81 cm"),
        ("plant.platform_incline", "45 deg", "46 deg"),
        ("plant.platform_incline", "-15 deg", "-16 deg"),
    ):
        assert scenario.override(name, tried).doubts() == []
        (told,) = scenario.override(name, untried).doubts()
        assert told.startswith(f"{name} = {untried}: landings were only tried from ")


def test_ground_reactions_are_stated_as_they_are() -> None:
    """In the limits of every report, in the credibility report and on the first page of the documentation."""
    found = []
    for name, pose, _ in CASES:
        result = load_scenario(name).with_parameters(plant={"initial_pose": pose}).run()
        found.append(result.metrics["peak_vertical_grf_after_impact_N"])
    least, most = min(found), max(found)
    weight = 67.544 * 9.80665
    stated = f"{least / 1e3:.0f} to {most / 1e3:.0f} kN, {least / weight:.0f} to {most / weight:.0f} body weights"
    assert stated == GROUND_TEXT
    assert GROUND_TEXT in (Path(__file__).parents[2] / "docs" / "index.md").read_text("utf-8")
