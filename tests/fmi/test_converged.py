"""Has a landing's coupling converged at its step? What half the step changes, against an exchange that is ten times as
fine."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sprain_cosim.cosim.result import CONVERGED, PEAK
from sprain_cosim.files import read_toml
from sprain_cosim.scenario import Scenario, load_scenario
from sprain_cosim.study.file import load_study
from sprain_cosim.study.worker import made_again
from sprain_cosim.validation import laboratory
from tests.laws import controller

FIGURES = read_toml(Path(laboratory.__file__).parent / "figures.toml")
Landings = list[tuple[float, float, bool]]  # of each: error of the peak [deg], stated doubt [deg], converged


@pytest.fixture(scope="module")
def reflex(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A foreign controller whose excitations follow the stretch without delay."""
    return controller(tmp_path_factory.mktemp("reflex") / "reflex.fmu", "step", gain=1.0)


def test_published_landings_are_not_called_so() -> None:
    """At most one of them, at the default step."""
    called = []
    for entry in FIGURES["landing"]:
        scenario = laboratory.scenario("incline30", {"plant.initial_pose": entry["pose"], **entry.get("set", {})})
        result = scenario.run(halve=True)
        assert result.coupling_doubt is not None
        if not result.converged:
            called.append(entry["case"])
    assert len(called) <= 1, called


def landings(reflex: Path, seed: int, count: int) -> Landings:
    """Random corners with the project's own controller, delayed or not, and with a foreign one; half of them braced."""
    random = np.random.default_rng(seed)
    found = []
    for k in range(count):
        scenario = corner(random, reflex if k % 2 else None)
        result = scenario.run(halve=True)
        fine = scenario.with_master(communication_step="0.05 ms").run()
        assert (result.status, fine.status) == ("completed", "completed")
        assert result.coupling_doubt is not None
        error = result.metrics[PEAK] - fine.metrics[PEAK]
        found.append((abs(error), result.coupling_doubt, bool(result.converged)))
    return found


def corner(random: np.random.Generator, reflex: Path | None) -> Scenario:
    scenario = load_scenario("incline30_mixed").unconfined()
    if reflex is not None:
        scenario = scenario.replace_fmu("controller", reflex).override("controller.gain", random.uniform(0, 10))
    else:
        own = {
            "coactivation": random.uniform(0, 0.6),
            "reflex_gain": random.uniform(0, 10),
            "reflex_delay": f"{random.choice([0.0, random.uniform(20, 60)])} ms",
        }
        for name, value in own.items():
            scenario = scenario.override(f"controller.{name}", value)
    values = {
        "initial_pose": str(random.choice(["touching", "published"])),
        "drop_height": f"{random.uniform(0.2, 0.5)} m",
        "contact_modulus": f"{random.uniform(35, 65)} MPa/m",
        "contact_dissipation": f"{random.uniform(2.5, 8)} s/m",
        "passive_angle_scale": random.uniform(0.8, 1.2),
        "ankle_strength_scale": random.uniform(0.85, 1.15),
        "talocrural_angle_at_contact": f"{random.uniform(-49, -19)} deg",
        "subtalar_angle_at_contact": f"{random.uniform(-15, 15)} deg",
    }
    for name, value in values.items():
        scenario = scenario.override(f"plant.{name}", value)
    if random.random() < 0.5:
        return scenario.without("brace")
    return scenario.override("brace.angle_scale", random.uniform(1.0, 2.4))


def judge(found: Landings) -> tuple[int, int, int, int]:
    """How many are wrong by more than CONVERGED, how many of these are called so; how many are right, and called
    wrong."""
    wrong = [called for error, _, called in found if error > CONVERGED]
    right = [called for error, _, called in found if error <= CONVERGED]
    return len(wrong), wrong.count(False), len(right), right.count(False)


def test_a_few_corners(reflex: Path) -> None:
    """No error is more than 0.1 deg beyond what was stated of it."""
    found = landings(reflex, seed=16, count=6)
    assert all(error <= doubt + CONVERGED for error, doubt, _ in found), found


@pytest.mark.long
def test_hits_and_false_alarms(reflex: Path) -> None:
    """200 corners: most of the wrong ones are called so, few of the right ones; the figures of docs/validation.md."""
    found = landings(reflex, seed=4, count=200)
    wrong, called, right, alarms = judge(found)
    print(f"wrong by more than 0.1 deg: {wrong}, called so {called}; right: {right}, called wrong {alarms}")
    print("largest error that was not called so:", max(error for error, _, converged in found if converged))
    assert called >= 0.8 * wrong
    assert alarms <= 0.15 * right
    assert max(error for error, _, converged in found if converged) <= 0.15


def test_rows_of_a_study_are_counted(tmp_path: Path) -> None:
    """One in sixteen trials is made again at half its step, chosen by its inputs: whatever the number of workers."""
    study = load_study("study3").override("controller.reflex_delay", "0 s").with_master(communication_step="2 ms")
    done = [study.run(trials=40, workers=workers, out=tmp_path / str(workers)) for workers in (1, 2)]
    tables = [(tmp_path / str(workers) / "trials.csv").read_bytes() for workers in (1, 2)]
    assert tables[0] == tables[1]
    trials = done[0].trials
    again = [made_again(row) for row in trials[done[0].study.headings].to_numpy(float).tolist()]
    told = trials["message"].str.startswith("coupling not converged at 2 ms")
    assert 1 <= sum(again) <= 8
    assert told.sum() >= 1
    assert not told[~np.array(again)].any()
    note = f"coupling not converged in {told.sum()} of the {sum(again)} trials that were made again at half the step"
    assert any(text.startswith(note) for text in done[0].summary.notes)


def test_it_is_said(reflex: Path) -> None:
    """By the run and in its summary, with a step that helps."""
    from sprain_cosim.folders.run import RunSummary

    scenario = load_scenario("incline30").replace_fmu("controller", reflex).override("controller.gain", 10.0)
    scenario = scenario.override("plant.initial_pose", "published").unconfined()
    coarse = scenario.with_master(communication_step="2 ms").run(halve=True)
    assert coarse.converged is False
    assert coarse.warning.startswith("coupling not converged at 2 ms: half the step changes the peak of the foot by ")
    assert '--step "0.5 ms" leaves about a quarter' in coarse.warning
    summary = RunSummary.of(scenario, coarse)
    assert summary.coupling_converged is False
    assert summary.coupling_doubt_deg == pytest.approx(2 * abs(coarse.halved[PEAK]))
    assert scenario.run().halved is None


def test_a_tolerance_in_words_is_halved_like_a_number() -> None:
    with load_scenario("incline30").with_master(stop="30 ms").open() as session:
        number, text = (session.at_half_the_step({"plant.tolerance": value}) for value in (0.02, "0.02"))
        assert number == text
        assert number != session.at_half_the_step({"plant.tolerance": 0.01})
