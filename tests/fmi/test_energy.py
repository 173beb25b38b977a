"""The stated coupling error of honest black boxes on the real plant, against the same one exchanged every 0.02 ms."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sprain_cosim.cosim.result import Result
from sprain_cosim.scenario import load_scenario
from tests.laws import BRACES, brace

FINE = 25  # exchanges in 0.5 ms


def work(result: Result, every: int = 1) -> np.ndarray:
    """(n,) work of the brace on the foot up to each point [J]."""
    torque, angle = result["plant.brace_subtalar_torque"], result["plant.subtalar_angle"]
    return np.concatenate([[0.0], np.cumsum(0.5 * (torque[1:] + torque[:-1]) * np.diff(angle))])[::every]


@pytest.mark.parametrize("law", BRACES)
def test_the_stated_error_is_the_true_one_within_a_factor_of_three(law: str, tmp_path: Path) -> None:
    """The true one: the largest error of the work done up to any instant, as a share of the energy exchanged."""
    scenario = load_scenario("incline30").replace_fmu("brace", brace(tmp_path / "brace.fmu", law))
    usual = scenario.run()
    fine = scenario.with_master("gauss-seidel", "0.02 ms").run()
    assert (usual.status, fine.status) == ("completed", "completed")
    exchanged = np.abs(np.diff(work(fine))).sum()
    true = np.abs(work(usual) - work(fine, FINE)).max() / exchanged
    assert true / 3 < usual.coupling_error < 3 * true, (usual.coupling_error, true)


def test_a_run_that_is_not_judged_has_the_same_numbers() -> None:
    """As most trials of a study, whose rows say nothing of it."""
    with load_scenario("incline30_brace").open() as session:
        judged, other = session.run(), session.run(judged=False)  # type: ignore[call-arg]
    assert judged.coupling_error is not None
    assert other.coupling_error is None
    assert np.array_equal(judged.values, other.values)
    assert judged.metrics == other.metrics


def test_a_late_answer_is_said_and_lies_in_the_stated_error(tmp_path: Path) -> None:
    """Three times the half step that every held torque is behind."""
    late = load_scenario("incline30").replace_fmu("brace", brace(tmp_path / "late.fmu", "LATE"))
    result = late.run()
    assert "brace answers one step late, 0.5 ms, which no scheme makes good" in result.warning
    half = late.with_master(communication_step="0.25 ms").run()
    assert half.coupling_error == pytest.approx(0.5 * result.coupling_error, rel=0.1)
    for law in BRACES[:-1]:
        fmu = brace(tmp_path / f"{law}.fmu", law)
        assert "late" not in load_scenario("incline30").replace_fmu("brace", fmu).with_master(stop="5 ms").run().warning


def test_a_late_answer_with_saved_states_too(tmp_path: Path) -> None:
    fmu = brace(tmp_path / "late.fmu", "LATE", saves=True)
    assert "answers one step late" in load_scenario("incline30").replace_fmu("brace", fmu).run().warning
