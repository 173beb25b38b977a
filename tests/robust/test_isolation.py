"""A worker process survives what a device does to it: crash, exit, hang, error; the trials after it give the same
numbers."""

from __future__ import annotations

import os
import signal
import threading
from pathlib import Path

import pytest

from sprain_cosim.errors import SimulationError
from sprain_cosim.process import Limits
from sprain_cosim.scenario import load_scenario
from sprain_cosim.study.worker import EXCHANGE, Stopped, Worker
from tests.native import compile_fmu

NAMES = ("plant.drop_height",)


@pytest.fixture(scope="module")
def clean() -> dict[str, float]:
    with Worker(load_scenario("incline30"), NAMES) as worker:
        return dict(worker.run([0.3]).metrics)


def test_same_numbers_as_in_this_process(clean: dict[str, float]) -> None:
    assert clean == load_scenario("incline30").override("plant.drop_height", "0.3 m").run().metrics


def test_a_child_that_dies_costs_one_try(clean: dict[str, float]) -> None:
    with Worker(load_scenario("incline30"), NAMES) as worker:
        worker.run([0.31])
        assert worker._child is not None
        os.killpg(worker._child._process.pid, signal.SIGSEGV)
        outcome = worker.run([0.3])
        assert (outcome.status, outcome.attempts) == ("completed", 2)
        assert dict(outcome.metrics) == clean


def test_overrunning_is_a_timeout_and_the_next_trial_runs() -> None:
    with Worker(load_scenario("incline30"), NAMES, Limits(trial=1e-4)) as worker:
        outcome = worker.run([0.3])
        assert (outcome.status, outcome.attempts) == ("timeout", 2)
        worker._trials = Limits().of_trials()
        assert worker.run([0.3]).status == "completed"


def test_a_failed_trial_says_why_and_the_next_is_clean(clean: dict[str, float]) -> None:
    with Worker(load_scenario("incline30"), NAMES) as worker:
        failed = worker.run([-1.0])
        assert failed.status == "failed"
        assert failed.message == "plant.drop_height = -1 m: outside its range 0 ... 5 m"
        assert dict(worker.run([0.3]).metrics) == clean


def test_a_recycled_child_agrees_to_the_bit(clean: dict[str, float]) -> None:
    with Worker(load_scenario("incline30"), NAMES, Limits(recycle=1)) as worker:
        worker.run([0.3])
        first = worker._child
        assert dict(worker.run([0.3]).metrics) == clean
        assert worker._child is not first
        assert worker._last is not None
        worker._last = (worker._last[0], {**clean, "peak_subtalar_angle_deg": 0.0})
        with pytest.raises(SimulationError, match="other numbers"):
            worker.run([0.3])


def test_trials_several_at_once_are_those_one_by_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """Up to a failed one in one exchange; with a trajectory by themselves; all by themselves where the process ends."""
    scenario, trials = load_scenario("incline30"), [([0.3 + 0.01 * k], k == 6) for k in range(12)]
    trials[8] = ([-1.0], False)
    monkeypatch.setattr(Worker, "_at_once", lambda self: 0 if self._alone else 4)
    with Worker(scenario, NAMES) as several, Worker(scenario, NAMES) as single:
        found = list(several.run_all(trials))
        alone = [single.run(*trial) for trial in trials]
        assert [len(outcomes) for outcomes in found] == [4, 2, 1, 2, 3]
        for one, other in zip((outcome for outcomes in found for outcome in outcomes), alone, strict=True):
            assert (one.status, one.message, dict(one.metrics)) == (other.status, other.message, dict(other.metrics))
            assert (bool(one.trajectory), one.attempts) == (bool(other.trajectory), 1)
        assert several._child is not None
        os.killpg(several._child._process.pid, signal.SIGSEGV)
        again = list(several.run_all(trials[:3]))
        assert [dict(o.metrics) for outcomes in again for o in outcomes] == [dict(o.metrics) for o in alone[:3]]
        assert len(again) == 3


def test_how_many_at_once() -> None:
    """Once a limit is learned, as many as fill an exchange, none beyond the life of their process."""
    with Worker(load_scenario("incline30"), NAMES, Limits(recycle=9)) as worker:
        for _ in range(5):
            assert worker._at_once() == 0
            worker.run([0.3])
        worker._pace = EXCHANGE / 3.5
        assert worker._at_once() == 3
        worker._pace = EXCHANGE / 100.5
        assert worker._at_once() == 4
        worker._alone = 1
        assert worker._at_once() == 0


def test_kill_ends_the_process_and_the_run() -> None:
    worker = Worker(load_scenario("incline30"), NAMES)
    worker.run([0.3])
    assert worker._child is not None
    process = worker._child._process
    killer = threading.Thread(target=worker.kill)
    killer.start()
    killer.join()
    assert process.poll() is not None
    with pytest.raises(Stopped):
        worker.run([0.3])


def test_a_system_that_cannot_open_is_one_message(tmp_path: Path) -> None:
    """Its library asks for more memory than there is."""
    large = compile_fmu(tmp_path / "large.fmu", macros=("-DRESERVES=(8ul<<30)",))
    scenario = load_scenario("incline30").replace_fmu("brace", large)
    with (
        Worker(scenario, NAMES, Limits(memory=4 << 30)) as worker,
        pytest.raises(SimulationError, match=r"large\.fmu: its library cannot be loaded"),
    ):
        worker.run([0.3])
