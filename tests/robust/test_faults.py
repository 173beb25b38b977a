"""Fault injection: a device in C that crashes, hangs, lies and litters costs its own trials and no other."""

from __future__ import annotations

import os
import time
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import sprain_cosim as sc
from sprain_cosim.isolation import Limits, Worker
from sprain_cosim.uq.study import Study
from tests.native import FAULTS, compile_fmu

LIMIT = 1.0  # s of wall time for a landing of 20 ms
EXPECTED = {
    "segfault": ("crashed", "SIGSEGV"),
    "abort": ("crashed", "SIGABRT"),
    "exit": ("crashed", "exit code 0"),
    "hang_step": ("timeout", "wall time"),
    "hang_start": ("timeout", "wall time"),
    "error": ("failed", "brace"),
    "fatal": ("failed", "brace"),
    "discard": ("failed", "brace"),
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


def campaign(study: Study, faults: list[int], folder: Path, **options):
    """A study of the published marginals with a column of faults."""
    sampled = sc.load_study("study2")
    table = pd.DataFrame(sampled.sample()[: len(faults)], columns=sampled.headings)
    table["brace.fault"] = faults
    path = folder / "inputs.csv"
    table.to_csv(path, index=False)
    return study.with_inputs(path).run(out=folder / "out", limits=Limits(trial=LIMIT), max_failed=1.0, **options)


def test_every_fault_is_classified_and_touches_no_other_trial(study: Study, tmp_path: Path) -> None:
    """One trial of each kind between clean ones; the clean ones equal a fault-free run to the bit."""
    rng = np.random.default_rng(7)
    faults = [code for kind in rng.permutation(len(FAULTS)) for code in (0, int(kind))]
    (tmp_path / "with").mkdir()
    (tmp_path / "without").mkdir()
    broken = campaign(study, faults, tmp_path / "with", workers=2).trials
    clean = campaign(study, [0] * len(faults), tmp_path / "without", workers=2).trials
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


def test_a_hang_is_ended_in_time_with_its_grandchildren(study: Study) -> None:
    names = ("brace.fault",)
    with Worker(study.scenario, names, Limits(trial=LIMIT)) as worker:
        assert worker.run([0.0]).status == "completed"
        assert worker.run([float(FAULTS.index("fork"))]).status == "completed"
        assert worker._child is not None
        group = worker._child._process.pid
        began = time.monotonic()
        worker._child.trials = worker.limits.recycle  # the next run is on a fresh child
        outcome = worker.run([float(FAULTS.index("hang_step"))])
        assert outcome.status == "timeout"
        assert outcome.attempts == 2
        assert time.monotonic() - began < 2 * (LIMIT + 1) + 6
    assert not _alive(group)


def _alive(group: int) -> list[str]:
    """Processes of a group that are not zombies."""
    found = []
    for entry in os.listdir("/proc"):
        if entry.isdigit():
            try:
                fields = (Path("/proc") / entry / "stat").read_text().rpartition(")")[2].split()
            except OSError:
                continue
            if int(fields[2]) == group and fields[0] != "Z":
                found.append(entry)
    return found


def test_what_a_device_prints_last_is_kept(study: Study) -> None:
    with Worker(study.scenario, ("brace.fault",), Limits(trial=LIMIT)) as worker:
        outcome = worker.run([float(FAULTS.index("fatal"))])
    assert outcome.status == "failed"
    assert len(outcome.log) <= 4000
