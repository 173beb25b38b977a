"""Studies end to end: the same table whatever the workers, resumed or not; a folder in use; too many failures."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import sprain_cosim as sc
from sprain_cosim import process, processor
from sprain_cosim.errors import InputError, SimulationError
from sprain_cosim.process import Limits
from sprain_cosim.study.backends.backend import Job
from sprain_cosim.study.campaign import Campaign
from sprain_cosim.study.codec import encode
from sprain_cosim.study.dispatch import Dispatch
from sprain_cosim.study.ledger import Ledger, Row
from sprain_cosim.study.manifest import read_manifest
from sprain_cosim.study.merge import merge
from sprain_cosim.study.reproduce import reproduce
from sprain_cosim.study.runner import _request
from sprain_cosim.study.seal import NECESSARY, seal
from sprain_cosim.study.summary import StudySummary
from sprain_cosim.study.trajectories import FIRST
from sprain_cosim.study.worker import Outcome
from sprain_cosim.uq.distributions import Normal
from tests.light import study_file

TRIALS = 24


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("studies") / "whole"
    sc.load_study("study6").run(trials=TRIALS, workers=1, out=out)
    return out


def test_two_workers_give_the_same_table(whole: Path, tmp_path: Path) -> None:
    campaign = sc.load_study("study6").run(trials=TRIALS, workers=2, out=tmp_path / "two")
    assert (tmp_path / "two" / "trials.csv").read_bytes() == (whole / "trials.csv").read_bytes()
    assert campaign.summary["n_completed"] == TRIALS


def test_rows_are_the_landings_they_name(whole: Path) -> None:
    campaign = sc.load_study("study6").run(trials=TRIALS, workers=1, out=whole, resume=True)
    row = campaign.trials.iloc[7]
    scenario = campaign.study.scenario
    for name, heading in zip(campaign.study.names, campaign.study.headings, strict=True):
        unit = heading.partition("[")[2].rstrip("]")
        scenario = scenario.override(name, f"{float(row[heading])!r} {unit}" if unit else float(row[heading]))
    assert scenario.run().metrics["peak_subtalar_angle_deg"] == row["peak_subtalar_angle_deg"]


def test_enlarging_keeps_rows_and_runs_only_new_ones(whole: Path, tmp_path: Path) -> None:
    out = tmp_path / "grown"
    sc.load_study("study6").run(trials=6, workers=1, out=out)
    before = (out / "timing.csv").read_text().splitlines()
    sc.load_study("study6").run(trials=TRIALS, workers=2, out=out, resume=True)
    assert (out / "trials.csv").read_bytes() == (whole / "trials.csv").read_bytes()
    assert (out / "timing.csv").read_text().splitlines()[: len(before)] == before


def test_a_study_that_stops_when_it_knows_enough_resumes_to_the_byte(tmp_path: Path) -> None:
    """Two workers, one, and one that goes on after 60 landings of the plain study stop after the same look."""
    study = sc.load_study(study_file(tmp_path))
    known = "mean 0.2 deg"

    def landed(name: str, **options: Any) -> Campaign:
        return study.run(trials=200, out=tmp_path / name, trajectories=0, **options)

    whole = landed("whole", until=known, workers=2)
    rule = whole.summary.until
    assert rule is not None
    assert rule.known
    assert 50 < rule.trials < 200
    assert rule.saved == 200 - rule.trials
    study.run(trials=60, workers=1, out=tmp_path / "grown", trajectories=0)
    grown = landed("grown", until=known, workers=1, resume=True)
    assert (tmp_path / "grown" / "trials.csv").read_bytes() == (tmp_path / "whole" / "trials.csv").read_bytes()
    assert replace(grown.summary, wall_s=None).to_json() == replace(whole.summary, wall_s=None).to_json()
    assert landed("grown", until=known, resume=True).summary.to_json() == grown.summary.to_json(), "nothing ran"
    wider = landed("grown", until="mean 1 deg", resume=True).summary.until
    assert wider is not None
    assert wider.trials == rule.trials, "landings that are there are kept"
    assert reproduce(tmp_path / "whole" / "manifest.json", workers=1).identical
    never = landed("whole", until="mean 0.001 deg", resume=True).summary.until
    assert never is not None
    assert (never.known, never.trials, never.saved) == (False, 200, 0)


def test_enlarging_sobol_keeps_rows_and_a_changed_marginal_leaves_the_other_columns() -> None:
    study = sc.load_study("study6")
    few, many = (replace(study, method="sobol", trials=n).sample() for n in (128, 1024))
    assert np.array_equal(many[:128], few)
    other = replace(study, marginals={**study.marginals, "plant.drop_height": Normal(0.4, 0.01)})
    for method in ("monte-carlo", "sobol"):
        before, after = (replace(s, method=method, trials=64).sample() for s in (study, other))
        changed = (before != after).any(axis=0)
        assert [n for n, c in zip(study.names, changed, strict=True) if c] == ["plant.drop_height"]


def test_a_latin_hypercube_cannot_be_enlarged(tmp_path: Path) -> None:
    study = sc.load_study("study6")
    study.run(method="lhs", trials=2, workers=1, out=tmp_path / "lhs", trajectories=0)
    with pytest.raises(InputError, match=r"holds another study \(trials: 2 then, 4 now\)"):
        study.run(method="lhs", trials=4, workers=1, out=tmp_path / "lhs", resume=True)


def test_given_inputs_repeat_the_study(whole: Path, tmp_path: Path) -> None:
    table = tmp_path / "inputs.csv"
    import pandas as pd

    trials = pd.read_csv(whole / "trials.csv")
    study = sc.load_study("study6")
    trials[["trial", *study.headings]].iloc[[3, 11]].to_csv(table, index=False)
    campaign = study.with_inputs(table).run(workers=1)
    assert campaign.trials["trial"].tolist() == [3, 11]
    assert np.array_equal(campaign.trials["peak_subtalar_angle_deg"], trials["peak_subtalar_angle_deg"].iloc[[3, 11]])


def test_another_study_in_the_folder_is_refused(whole: Path) -> None:
    with pytest.raises(InputError, match="seed: 20211208 then, 1 now"):
        sc.load_study("study6").run(trials=TRIALS, seed=1, out=whole, resume=True)
    with pytest.raises(InputError, match="--resume"):
        sc.load_study("study6").run(trials=TRIALS, out=whole)


def test_a_folder_in_use_names_its_holder(tmp_path: Path) -> None:
    study = sc.load_study("study6")
    with (
        Ledger(tmp_path / "s", study.digest, study.identity),
        pytest.raises(InputError, match=f"in use by process {os.getpid()}"),
    ):
        Ledger(tmp_path / "s", study.digest, study.identity)
    Ledger(tmp_path / "s", study.digest, study.identity).close()


def test_killed_driver_loses_nothing_that_was_committed(whole: Path, tmp_path: Path) -> None:
    out = tmp_path / "killed"
    code = (
        "import os, signal, sys, sprain_cosim as sc\n"
        "from sprain_cosim.study import dispatch\n"
        "dispatch.COMMIT = -1.0\n"  # after each trial: in 0.25 s a fast machine finishes all
        "def progress(finished, total, failed, seconds):\n"
        "    if finished > 4: os.kill(os.getpid(), signal.SIGKILL)\n"
        f"sc.load_study('study6').run(trials={TRIALS}, workers=1, out=sys.argv[1], progress=progress)\n"
    )
    ended = subprocess.run([sys.executable, "-c", code, str(out)], capture_output=True, check=False)
    assert ended.returncode == -signal.SIGKILL
    study = sc.load_study("study6")
    with Ledger(out, study.digest, study.identity) as ledger:
        kept = {row.trial: row.outcome.wall for row in ledger.rows()}
    assert len(kept) == 5
    campaign = study.run(trials=TRIALS, workers=2, out=out, resume=True)
    assert (out / "trials.csv").read_bytes() == (whole / "trials.csv").read_bytes()
    assert {t: campaign.timing["wall_s"][t] for t in kept} == kept, "kept trials are not run again"


def test_amv_resumes_from_its_ledger(tmp_path: Path) -> None:
    first = replace(sc.load_study("amv6"), check=False).run(workers=2, out=tmp_path / "amv")
    walls = first.timing["wall_s"].tolist()
    again = replace(sc.load_study("amv6"), check=False).run(workers=1, out=tmp_path / "amv", resume=True)
    assert again.timing["wall_s"].tolist() == walls
    assert again.summary["amv"]["levels"] == first.summary["amv"]["levels"]
    assert again.summary["amv"]["evaluations_requested"] == 14


def test_too_many_failures_stop_the_study(tmp_path: Path) -> None:
    with pytest.raises(SimulationError, match=r"2 of 2 trials failed, more than --max-failed .* trial 1 timeout"):
        sc.load_study("study2").run(trials=50, workers=1, out=tmp_path / "bad", limits=Limits(trial=1e-4))


def test_failed_trials_are_rows_and_bound_the_percentiles(tmp_path: Path) -> None:
    """Trials that ran out of time stay in the table; with none completed no moment is made up."""
    campaign = sc.load_study("study2").run(
        trials=2, workers=1, out=tmp_path / "bad", limits=Limits(trial=1e-4), max_failed=1.0
    )
    assert campaign.trials["status"].tolist() == ["timeout", "timeout"]
    assert campaign.summary["n_failed"] == 2
    assert campaign.summary["failures"] == {"timeout": 2}
    assert campaign.summary["responses"] == {}


def test_three_hangs_in_a_row_end_the_study_and_a_longer_limit_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before any trial has finished a hang is not repeated; a limit that is stated later runs again what a shorter one
    has ended."""
    study, out = sc.load_study("study2"), tmp_path / "s"
    with monkeypatch.context() as patch:
        patch.setattr(process, "FIRST_TRIAL", 1e-4)
        with pytest.raises(SimulationError, match=r"hung three times in a row: trials 0, 1 and 2 each .* 0\.0001 s"):
            study.run(trials=5, workers=1, out=out, max_failed=1.0, trajectories=0)
    with Ledger.read(out) as ledger:
        ended = [(row.trial, row.outcome.status, row.outcome.attempts) for row in ledger.rows()]
        assert "0.0001 s: until 5 have finished" in next(ledger.failed()).outcome.message
    assert ended == [(0, "timeout", 1), (1, "timeout", 1), (2, "timeout", 1)]
    done = study.run(trials=5, workers=1, out=out, resume=True, limits=Limits(trial=60.0), trajectories=0)
    assert (done.trials["status"] == "completed").all()
    assert "trials 0, 1, 2 had been ended by a shorter limit of wall time; they run again" in done.warnings[0]


class Standin:
    """A backend whose trials end in any order, `hung` of them by their limit."""

    batch = 0.0

    def __init__(self, hung: set[int], seed: int) -> None:
        self.hung, self.rng, self.jobs = hung, np.random.default_rng(seed), list[Job]()

    def workers(self) -> int:
        return 4

    def send(self, jobs: list[Job]) -> None:
        self.jobs += jobs

    def receive(self) -> list[Row]:
        job = self.jobs.pop(int(self.rng.integers(len(self.jobs))))
        outcome = Outcome("timeout", "late", wall=10.0) if job.trial in self.hung else Outcome("completed", "")
        return [Row(job.trial, job.values, outcome, "0")]

    def close(self) -> list[Row]:
        return []


@pytest.mark.parametrize("seed", range(4))
def test_whether_hangs_are_in_a_row_does_not_depend_on_the_order_in_which_trials_end(seed: int) -> None:
    """Neighbours in the order in which trials begin; those that a resumed study skips are not among them."""
    blocks = [(np.arange(k, k + 10), np.zeros((10, 1))) for k in (0, 10)]
    for hung, found in (({2, 3, 5, 6, 8, 9}, ""), ({8, 9, 10}, "8, 9 and 10"), ({0, 1, 3}, "0, 1 and 3")):
        with Ledger(None, "", {}) as ledger:
            for number in () if found != "0, 1 and 3" else (2,):
                ledger.add(Row(number, np.zeros(1), Outcome("completed", ""), "0"))
            dispatch = Dispatch(ledger, Standin(hung, seed), suspects=["brace"])
            if not found:
                dispatch.finish(blocks, 20)
                assert ledger.count() == 20
                continue
            with pytest.raises(SimulationError, match=rf'brace hung .*: trials {found} .* --trial-limit "50 s"'):
                dispatch.finish(blocks, 20)


def test_summary_is_json_and_says_what_happened(whole: Path) -> None:
    summary = json.loads((whole / "summary.json").read_text())
    assert summary["n_requested"] == summary["n_completed"] == TRIALS
    assert summary["n_failed"] == 0
    level = summary["responses"]["peak_subtalar_angle_deg"]["percentiles"]["50"]
    assert level["ci_low"] < level["value"] < level["ci_high"]


def test_a_finished_folder_is_not_computed_again(tmp_path: Path) -> None:
    """The exports stay as they are while they are what was asked for; one that was edited or is gone is made again."""
    out = tmp_path / "s"
    first = sc.load_study("study2").run(trials=5, workers=1, out=out)
    exports = [p for p in out.iterdir() if p.is_file() and not p.name.startswith(("ledger", "."))]
    stamps = {p.name: p.stat().st_mtime_ns for p in exports}
    seen: list[int] = []

    def resumed(trials: int = 5) -> Campaign:
        study = sc.load_study("study2")
        return study.run(trials=trials, workers=1, out=out, resume=True, progress=lambda *a: seen.append(a[0]))

    again = resumed()
    assert seen == [5]
    assert {p: (out / p).stat().st_mtime_ns for p in stamps} == stamps
    assert again.summary == first.summary
    pd.testing.assert_frame_equal(again.trials, first.trials)
    pd.testing.assert_frame_equal(again.timing, first.timing)
    before = (out / "trials.csv").read_bytes()
    for damage in (  # after which nothing is landed again: all is said once
        lambda: (out / "trials.csv").write_bytes(before.replace(b"1", b"2")),
        lambda: (out / "trials.csv").unlink(),
        lambda: (out / "summary.json").write_text("{}"),
        lambda: (out / "trajectories" / "000001.record").unlink(),
    ):
        damage()
        seen.clear()
        resumed()
        assert seen == [5]
        assert (out / "trials.csv").read_bytes() == before
        assert (out / "trajectories" / "000001.record").is_file()
        assert json.loads((out / "summary.json").read_text())["n_completed"] == 5
    assert resumed(trials=7).summary.n_completed == 7
    assert len(pd.read_csv(out / "trials.csv")) == 7


def test_a_finished_folder_of_100_000_trials_is_resumed_in_two_seconds(tmp_path: Path) -> None:
    """The ledger is written directly; the exports are noted as the study's end would. Processor time of one process."""
    out = tmp_path / "s"
    study = replace(sc.load_study("study6"), trials=100_000)
    names = [f"metric_{k}" for k in range(24)]
    rng = np.random.default_rng(3)
    values, inputs = rng.normal(size=(2, 1000, 24)), rng.normal(size=(1000, len(study.names)))
    with Ledger(out, study.digest, study.identity, json.dumps(encode(study))) as ledger:
        for trial in range(study.trials):
            metrics = dict(zip(names, values[trial % 2, trial % 1000].tolist(), strict=True))
            ledger.add(Row(trial, inputs[trial % 1000], Outcome("completed", "", metrics, 0.02), "0"))
        ledger.commit()
        for name in NECESSARY:
            (out / name).write_text("x" * 700 * (study.trials if name == "trials.csv" else 1))
        counts = {"n_requested": study.trials, "n_completed": study.trials, "n_failed": 0}
        summary = StudySummary(title="", method="monte-carlo", **counts)  # type: ignore[arg-type]
        (out / "summary.json").write_text(json.dumps(summary.to_json()))
        seal(out, ledger, _request(study, np.arange(study.trials), None, FIRST, False), [])
    began = time.process_time()
    study.run(out=out, resume=True)
    assert time.process_time() - began < 2.0


def test_a_study_takes_one_level_of_the_processor_and_says_which(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    older = processor.LEVELS[0]
    study, levels = sc.load_study("study6"), lambda: read_manifest(tmp_path / "s").processor
    monkeypatch.setenv(processor.VARIABLE, older)
    study.run(trials=2, workers=1, out=tmp_path / "s")
    assert levels() == (older,)
    monkeypatch.delenv(processor.VARIABLE)
    assert study.run(trials=3, workers=1, out=tmp_path / "s", resume=True).warnings == ()
    assert levels() == (older,), "the rest of the table comes from the same code"


@pytest.mark.long
@pytest.mark.skipif(processor.own() != processor.LEVELS[-1], reason=f"this processor has no {processor.LEVELS[-1]}")
def test_another_level_of_the_processor_is_named_and_no_fault(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    older, newer = processor.LEVELS
    study = sc.load_study("study6")
    for part, level in enumerate((older, newer), 1):
        monkeypatch.setenv(processor.VARIABLE, level)
        study.run(trials=4, workers=1, out=tmp_path / f"p{part}", shard=(part, 2))
    done = merge([tmp_path / "p1", tmp_path / "p2"], tmp_path / "both")
    assert f"p1: {older}" in done.warnings[0]
    assert f"p2: {newer}" in done.warnings[0]
    assert read_manifest(tmp_path / "both").processor == (older, newer)
    study.run(trials=2, workers=1, out=tmp_path / "s")
    same = reproduce(tmp_path / "s", tmp_path / "a", workers=1)
    assert same.identical
    assert same.differences == ()
    monkeypatch.setenv(processor.VARIABLE, older)
    other = reproduce(tmp_path / "s", tmp_path / "b", workers=1)
    assert (other.identical, other.rounding) == (False, True)
    assert other.differences == ("code for x86-64-v3 processors then, for x86-64-v2 now",)
    assert "the same but for the last digits" in other.text()
    monkeypatch.delenv(processor.VARIABLE)
    monkeypatch.setattr(processor, "runs_here", lambda level: False)  # as where the level of the folder is missing
    went_on = study.run(trials=3, workers=1, out=tmp_path / "b", resume=True)
    assert "ran code for x86-64-v2 processors, those that follow code for x86-64-v3" in went_on.warnings[0]
    assert read_manifest(tmp_path / "b").processor == (older, newer)
