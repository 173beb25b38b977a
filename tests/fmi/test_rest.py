"""The start: muscles have, at contact, the activation that belongs to what their controller gives at rest."""

from __future__ import annotations

from pathlib import Path

import pytest

from sprain_cosim.scenario import Scenario, load_scenario
from tests.laws import WHEN, controller

PUBLISHED = 17.55  # deg, OpenSim 4.6: reflex gain 10 without delay, published pose


def reflex(**more: float | str) -> Scenario:
    scenario = load_scenario("incline30_reflex").override("plant.initial_pose", "published")
    for name, value in more.items():
        scenario = scenario.override(f"controller.{name}", value)
    return scenario


def peak(scenario: Scenario) -> float:
    result = scenario.run()
    assert result.status == "completed", result.message
    return result.metrics["peak_subtalar_angle_deg"]


@pytest.mark.parametrize("step", ["0.5 ms", "0.1 ms"])
def test_an_answer_without_delay_begins_with_the_first_step(step: str) -> None:
    """Not with the activations: 20.46 deg, where they take the stretch of the first instant for an answer at rest."""
    scenario = reflex(reflex_delay="0 s", reflex_gain=10.0).with_master(communication_step=step)
    assert peak(scenario) == pytest.approx(PUBLISHED, abs=0.1)
    activated = scenario.override("plant.initial_ankle_activation", 0.01)
    assert peak(scenario) == peak(activated)


@pytest.mark.parametrize("scheme", ["jacobi", "gauss-seidel", "iterative"])
def test_under_other_schemes(scheme: str) -> None:
    scenario = reflex(reflex_delay="0 s", reflex_gain=10.0).with_master(scheme)
    assert peak(scenario) == pytest.approx(PUBLISHED, abs=0.3 if scheme == "jacobi" else 0.1)


@pytest.mark.parametrize("when", WHEN)
def test_a_foreign_controller_starts_alike(when: str, tmp_path: Path) -> None:
    """Whenever its tool computes outputs: at once, at the end of the initialisation, or in a step only. Its
    co-activation counts from contact on, its reflex from the first step on."""
    answering = reflex().replace_fmu("controller", controller(tmp_path / "reflex.fmu", when, gain=10.0))
    assert peak(answering) == pytest.approx(PUBLISHED, abs=0.1)
    scenario = load_scenario("incline30_coactivation").override("controller.invertor_ratio", 1.0)
    tensed = scenario.replace_fmu("controller", controller(tmp_path / "base.fmu", when, base=0.6))
    assert peak(tensed) == pytest.approx(peak(scenario), abs=0.02)


def test_a_session_starts_every_run_alike(tmp_path: Path) -> None:
    """The instance that is asked for outputs at rest leaves nothing behind."""
    scenario = reflex().replace_fmu("controller", controller(tmp_path / "base.fmu", "step", gain=10.0, base=0.3))
    with scenario.with_master(stop="20 ms").open() as session:
        first, second = session.run(), session.run()
    assert (first.values == second.values).all()


def test_a_reflex_whose_first_stretch_ends_within_a_step() -> None:
    """A corner of study 6: 15.573 deg by OpenSim 4.6, at the default step."""
    scenario = load_scenario("incline30_mixed")
    corner = {
        "plant.drop_height": "0.486 m",
        "plant.contact_modulus": "37 MPa/m",
        "plant.contact_dissipation": "2.7 s/m",
        "plant.passive_angle_scale": 1.19,
        "plant.ankle_strength_scale": 1.15,
        "plant.talocrural_angle_at_contact": "-49 deg",
        "plant.subtalar_angle_at_contact": "15 deg",
        "controller.coactivation": 0.42,
        "controller.reflex_gain": 5.0,
        "brace.angle_scale": 2.21,
    }
    for name, value in corner.items():
        scenario = scenario.override(name, value)
    assert peak(scenario) == pytest.approx(15.573, abs=0.1)
    assert peak(scenario.with_master(communication_step="0.1 ms")) == pytest.approx(15.573, abs=0.1)
