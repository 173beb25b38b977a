"""Fault injection: a device in C that crashes, hangs, lies and litters costs its own trials and no other."""

from __future__ import annotations

import json
import time
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

import sprain_cosim as sc
from sprain_cosim.cli import cli
from sprain_cosim.errors import SimulationError
from sprain_cosim.fmu.messages import Log
from sprain_cosim.process import Child, Limits, ProcessEnded
from sprain_cosim.study.study import Study
from sprain_cosim.study.trajectories import read_trajectory
from sprain_cosim.study.worker import Worker
from tests.native import FAULTS, compile_fmu
from tests.processes import alive_in, soon

LIMIT = 1.0  # s of wall time for what hangs
AMPLE = 60.0  # s for what does not, however loaded the machine is
VARIED = FAULTS.index("hang_load")  # the others can be chosen by a trial
EXPECTED = {
    "segfault": ("crashed", "SIGSEGV"),
    "abort": ("crashed", "SIGABRT"),
    "exit": ("crashed", "exit code 0"),
    "hang_step": ("timeout", "wall time"),
    "hang_start": ("timeout", "wall time"),
    "error": ("failed", "brace"),
    "fatal": ("failed", "brace"),
    "discard": ("failed", "brace"),
    "spin": ("timeout", "wall time"),
    "gorge": ("crashed", "SIGSEGV"),
    "nan": ("failed", "subtalar_torque"),
    "positive_infinity": ("failed", "subtalar_torque"),
    "negative_infinity": ("failed", "subtalar_torque"),
    "huge": ("failed", "plant"),
}


@pytest.fixture(scope="module")
def faulty(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return compile_fmu(tmp_path_factory.mktemp("faulty") / "faulty.fmu")


@pytest.fixture(scope="module")
def study(faulty: Path) -> Study:
    return sc.load_study("study2").replace_fmu("brace", faulty)


def campaign(study: Study, faults: list[int], folder: Path, limit: float = LIMIT, **options):
    """A study of the published marginals with a column of faults."""
    sampled = sc.load_study("study2")
    table = pd.DataFrame(sampled.sample()[: len(faults)], columns=sampled.headings)
    table["brace.fault"] = faults
    path = folder / "inputs.csv"
    table.to_csv(path, index=False)
    return study.with_inputs(path).run(out=folder / "out", limits=Limits(trial=limit), max_failed=1.0, **options)


def test_every_fault_is_classified_and_touches_no_other_trial(study: Study, tmp_path: Path) -> None:
    """One trial of each kind between clean ones; the clean ones equal a fault-free run to the bit."""
    kinds = [FAULTS[code] for code in np.random.default_rng(7).permutation(VARIED)]
    hanging = [kind for kind in kinds if EXPECTED.get(kind, ("",))[0] == "timeout"]
    for name, several, limit in (
        ("hanging", hanging, LIMIT),
        ("others", [kind for kind in kinds if kind not in hanging], AMPLE),
    ):
        faults = [code for kind in several for code in (0, FAULTS.index(kind))]
        for folder in (tmp_path / name, tmp_path / f"{name}_clean"):
            folder.mkdir()
        broken = campaign(study, faults, tmp_path / name, limit, workers=2).trials
        clean = campaign(study, [0] * len(faults), tmp_path / f"{name}_clean", AMPLE, workers=2).trials
        assert (clean["status"] == "completed").all()
        for k, code in enumerate(faults):
            row, kind = broken.iloc[k], FAULTS[code]
            if kind in EXPECTED:
                status, word = EXPECTED[kind]
                assert row["status"] == status, (kind, row["message"])
                assert word in row["message"], kind
            else:
                assert row["status"] == "completed", (kind, row["message"])
                assert row["peak_subtalar_angle_deg"] == clean["peak_subtalar_angle_deg"][k], kind


@pytest.mark.long
def test_a_thousand_trials_with_a_tenth_of_them_faulty(study: Study, tmp_path: Path) -> None:
    """A thousand trials, a hundred faults: clean trials as in a fault-free run to the bit, every fault a row
    with its class and a command that runs it again."""
    rng = np.random.default_rng(11)
    faults = np.zeros(1000, int)
    faults[rng.choice(1000, 100, replace=False)] = rng.integers(1, VARIED, 100)
    (tmp_path / "with").mkdir()
    (tmp_path / "without").mkdir()
    broken = campaign(
        study, faults.tolist(), tmp_path / "with", limit=4.0, workers=2
    ).trials  # 100 MB of output take a while
    clean = campaign(study, [0] * 1000, tmp_path / "without", limit=4.0, workers=2).trials
    kinds = [FAULTS[code] for code in faults]
    harmless = np.array([kind not in EXPECTED for kind in kinds])
    metrics = [c for c in clean.columns[3:] if c != "brace.fault"]
    pd.testing.assert_frame_equal(broken.loc[harmless, metrics], clean.loc[harmless, metrics], check_exact=True)
    for kind, status, message in zip(kinds, broken["status"], broken["message"], strict=True):
        if kind in EXPECTED:
            assert status == EXPECTED[kind][0]
            assert EXPECTED[kind][1] in message
        else:
            assert status == "completed"
    listed = json.loads((tmp_path / "with" / "out" / "failures.json").read_text())
    assert [f["trial"] for f in listed] == np.flatnonzero(~harmless).tolist()
    assert all(
        f["replay"].startswith("sprain-cosim trial ") and f["attempts"] == (1 if f["status"] == "failed" else 2)
        for f in listed
    )


def test_a_failed_trial_is_quarantined_with_what_its_replay_needs(study: Study, tmp_path: Path) -> None:
    campaign(study, [0, FAULTS.index("segfault"), FAULTS.index("nan")], tmp_path, AMPLE, workers=1)
    out = tmp_path / "out"
    crashed, failed = json.loads((out / "failures.json").read_text())
    assert (crashed["trial"], crashed["status"], crashed["attempts"]) == (1, "crashed", 2)
    assert crashed["inputs"]["brace.fault"] == FAULTS.index("segfault")
    assert crashed["replay"] == f"sprain-cosim trial {out} 1"
    assert failed["status"] == "failed"
    record = read_trajectory(out / "trajectories" / "000002.record")  # as far as it went
    assert 0.009 < record.time[-1] <= 0.011
    ran = CliRunner().invoke(cli, ["trial", str(out), "1"], standalone_mode=False)
    assert isinstance(ran.exception, SimulationError)
    assert "trial 1 crashed: ended by signal SIGSEGV (recorded: crashed)" in str(ran.exception)


def test_a_leak_is_answered_by_a_fresh_process(study: Study) -> None:
    leak = float(FAULTS.index("leak"))
    with Worker(study.scenario, ("brace.fault",), Limits(growth=32 << 20)) as worker:
        for _ in range(10):  # growth counts from the tenth trial on
            worker.run([0.0])
        child = worker._child
        before = worker.run([0.0]).metrics
        assert worker._child is child
        assert worker.run([leak]).status == "completed"
        assert worker.run([0.0]).metrics == before
        assert worker._child is not child


def test_a_leak_among_several_trials_is_answered_too(study: Study, monkeypatch: pytest.MonkeyPatch) -> None:
    """No further trial runs in the process that leaks."""
    leak = float(FAULTS.index("leak"))
    with Worker(study.scenario, ("brace.fault",), Limits(growth=32 << 20)) as worker:
        for _ in range(10):
            worker.run([0.0])
        child = worker._child
        monkeypatch.setattr(worker, "_at_once", lambda: 4 if worker._child is child else 0)
        found = list(worker.run_all([([fault], False) for fault in (0.0, leak, 0.0, 0.0)]))
        assert [len(outcomes) for outcomes in found] == [2, 1, 1]
        assert worker._child is not child
        assert found[0][0].metrics == found[1][0].metrics


def test_too_much_processor_time_is_a_timeout(study: Study) -> None:
    with Worker(study.scenario, ("brace.fault",), Limits(cpu=0.0)) as worker:
        outcome = worker.run([float(FAULTS.index("spin"))])
    assert (outcome.status, outcome.attempts) == ("timeout", 2)
    assert "processor time" in outcome.message


def test_too_much_memory_costs_the_trial(study: Study) -> None:
    """The limit leaves room for the landing and not for what the device asks for."""
    with Worker(study.scenario, ("brace.fault",), Limits(memory=4 << 30)) as worker:
        assert worker.run([0.0]).status == "completed"
        outcome = worker.run([float(FAULTS.index("gorge"))])
        assert outcome.status == "crashed"
        assert worker.run([0.0]).status == "completed"


def test_a_device_that_hangs_when_it_is_loaded_is_one_message(tmp_path: Path) -> None:
    hanging = compile_fmu(tmp_path / "hanging.fmu", fault="hang_load")
    study = sc.load_study("study2").replace_fmu("brace", hanging)
    with (
        Worker(study.scenario, study.names, Limits(start=4.0)) as worker,
        pytest.raises(SimulationError, match=r"cannot be opened: .*wall time"),
    ):
        worker.run([m.mean for m in study.marginals.values()])


def test_a_hang_is_ended_in_time_with_its_grandchildren(study: Study) -> None:
    names, limits = ("brace.fault",), Limits(trial=LIMIT)
    child = Child("sprain_cosim.study.worker", limits)
    try:
        child.open((study.scenario, study.scenario.system(), names, ""), limits.of_starts().seconds)
        for fault in ("none", "fork"):
            assert child.call("run", [float(FAULTS.index(fault))], False, 60.0, limit=60.0)["status"] == "completed"
        group = child._process.pid
        assert len(alive_in(group)) == 2
        began = time.monotonic()
        with pytest.raises(ProcessEnded, match="wall time"):
            child.call("run", [float(FAULTS.index("hang_step"))], False, 60.0, limit=LIMIT)
        assert LIMIT <= time.monotonic() - began < 10 * LIMIT
    finally:
        child.close()
    assert soon(lambda: not alive_in(group), 1.0)  # killed, and not yet buried by the system


def test_what_a_device_prints_last_is_kept(study: Study) -> None:
    with Worker(study.scenario, ("brace.fault",), Limits(trial=AMPLE)) as worker:
        outcome = worker.run([float(FAULTS.index("fatal"))])
    assert outcome.status == "failed"
    assert len(outcome.log) <= 4000


@pytest.mark.parametrize(
    ("messages", "words"),
    [
        ([], ""),
        ([(0, "starts"), (0, "ends\n")], ": ends"),
        ([(3, "tau is negative"), (0, "see the manual"), (1, "licence ends soon")], ": tau is negative"),
        ([(0, "ERROR: tau is negative\nsee line 3 of the log"), (0, "freed 3 blocks")], ": ERROR: tau is negative"),
        ([(3, 'Traceback:\n  File "error.py", line 2\nValueError: tau\n')], ": ValueError: tau"),
        ([(0, ""), (0, "\n")], ""),
    ],
)
def test_a_failure_quotes_the_error_of_the_log(messages: list[tuple[int, str]], words: str) -> None:
    """By its status, else by its words; not what was said last."""
    log = Log("brace")
    for status, text in messages:
        log.add(text, status)
    assert log.quote() == words
