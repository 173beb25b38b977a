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
from sprain_cosim.study.worker import Stopped, Worker
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
        assert failed.message.startswith("plant: ")
        assert "drop_height = -1 m: must lie between" in failed.message
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
