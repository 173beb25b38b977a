"""The life of a study from the command line: interrupted, killed, locked, out of disk, moved; nothing finished is lost
and the table is the same."""

from __future__ import annotations

import contextlib
import io
import json
import os
import random
import resource
import signal
import subprocess
import sys
import time
import uuid
from pathlib import Path

import pandas as pd
import pytest

from sprain_cosim.errors import InputError
from sprain_cosim.study.ledger import Ledger
from tests.processes import soon

ROOT = Path(__file__).parent.parent.parent
TRIALS = 60
ENDLESS = 1_000_000  # trials of a study that is ended before
LANDING = "20 ms"  # short, for many of them
DRIVER = f"""if True:
    import os, sys, time
    from dataclasses import replace
    import sprain_cosim.study.file as module
    from sprain_cosim import cli
    from sprain_cosim.study import dispatch, progress
    load = module.load_study
    def shorter(name):
        study = load(name)
        return replace(study, scenario=study.scenario.with_master(stop="{LANDING}"))
    module.load_study, progress.EVERY = shorter, 0.0
    rows, held = dispatch.Dispatch._rows, os.environ.get("SPRAIN_TEST_HELD_AT", "")
    def held_rows(self, *jobs):
        for row in rows(self, *jobs):
            while self.ledger.count() >= int(held if held.isdigit() else open(held).read() or 0):
                time.sleep(0.001)
            yield row
    if held:
        dispatch.COMMIT, dispatch.Dispatch._rows = -1.0, held_rows
    cli.main(sys.argv[1:])
"""


def start(
    out: Path, *options: str, trials: int = TRIALS, mark: str = "", limit: int | None = None, **environment: str
) -> subprocess.Popen[str]:
    """`sprain-cosim study study6` with short landings; `limit` [B] the size that its files may have.
    SPRAIN_TEST_HELD_AT: every trial is committed at once, and the driver stays still while so many are in the ledger,
    so that a fast machine does not finish before it is killed; a number, or a file that has it."""
    command = ["study", "study6", "--trials", str(trials), "--trajectories", "none", "--out", str(out), *options]
    return subprocess.Popen(
        [sys.executable, "-c", DRIVER, *command],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT), "SPRAIN_TEST_MARK": mark, **environment},
        cwd=environment.get("PWD"),
        preexec_fn=None if limit is None else lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)),
    )


def finish(out: Path, *options: str, trials: int = TRIALS, **environment: str) -> bytes:
    """Runs to the end; trials.csv."""
    process = start(out, *options, trials=trials, **environment)
    _, said = process.communicate(timeout=600)
    assert process.returncode == 0, said
    return (out / "trials.csv").read_bytes()


def until_some_are_finished(process: subprocess.Popen[str], least: int) -> None:
    assert process.stderr is not None
    for line in process.stderr:
        if line.startswith("{") and json.loads(line)["finished"] >= least:
            return
    raise AssertionError("the study ended before")


def marked(mark: str) -> list[int]:
    """Processes that carry the mark of a driver in their environment, zombies aside."""
    found = []
    for entry in os.listdir("/proc"):
        try:
            if (
                entry.isdigit()
                and f"SPRAIN_TEST_MARK={mark}\0".encode() in (Path("/proc") / entry / "environ").read_bytes()
            ):
                found.append(int(entry))
        except OSError:
            continue
    return found


def gone(mark: str) -> bool:
    """Within 2 s all processes with the mark of a driver."""
    assert soon(lambda: not marked(mark), 2.0), f"processes {marked(mark)} are still there"
    return True


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """From an empty folder, which --resume takes as a fresh start; its progress for machines ends with all trials."""
    process = start(tmp_path_factory.mktemp("life"), "--workers", "1", "--resume", "--progress", "json")
    _, said = process.communicate(timeout=600)
    assert process.returncode == 0, said
    lines = [json.loads(line) for line in said.splitlines()]
    assert lines[-1]["finished"] == lines[-1]["total"] == TRIALS
    assert set(lines[0]) == {"finished", "total", "failed", "rate_per_s", "left_s"}
    return (Path(process.args[process.args.index("--out") + 1]) / "trials.csv").read_bytes()


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_interrupt_keeps_what_is_finished_and_says_how_to_go_on(
    number: signal.Signals, code: int, whole: bytes, tmp_path: Path
) -> None:
    out, mark = tmp_path / "out", uuid.uuid4().hex
    process = start(out, "--workers", "2", "--progress", "json", trials=ENDLESS, mark=mark)
    until_some_are_finished(process, 1)
    process.send_signal(number)
    in_time = soon(lambda: process.poll() is not None, 2.0)
    _, said = process.communicate(timeout=60)
    assert (process.returncode, in_time) == (code, True), said
    hint, error = said.splitlines()[-2:]
    assert hint.startswith(f"continue with: sprain-cosim study study6 --trials {ENDLESS}")
    assert hint.endswith("--resume")
    assert error == "error: interrupted"
    assert gone(mark)
    with Ledger.read(out) as ledger:
        assert len(ledger.finished()[0]) >= 1
    assert not (out / "trials.csv").exists()
    assert not [p.name for p in out.iterdir() if p.name.startswith(".") and p.name != ".lock"]
    if number == signal.SIGINT:
        resumed = finish(out, "--resume", "--workers", "2")
        rows = resumed.count(b"\n") - 1  # what was finished beyond the trials asked for is kept
        assert rows >= TRIALS
        assert resumed == (whole if rows == TRIALS else finish(tmp_path / "fresh", "--workers", "2", trials=rows))


def kills(out: Path, count: int, trials: int, rng: random.Random) -> bytes:
    """Kills the driver `count` times at random moments; what had been committed stays as it was and no process outlives
    it by 2 s."""
    kept: dict[int, float] = {}
    for _ in range(count):
        mark, least = uuid.uuid4().hex, min(len(kept) + rng.randrange(1, 8), trials - 4)
        options = ("--resume", "--workers", "2", "--progress", "json")
        process = start(out, *options, trials=trials, mark=mark, SPRAIN_TEST_HELD_AT=str(least + 3))
        if rng.random() < 0.8:
            until_some_are_finished(process, least)
        else:  # while it starts
            time.sleep(rng.random())
        process.kill()
        process.communicate()
        assert gone(mark)
        if (out / "ledger.sqlite").is_file():
            with Ledger.read(out) as ledger:
                now = {row.trial: row.outcome.wall for row in ledger.rows()}
            assert {trial: now.get(trial) for trial in kept} == kept, "an acknowledged trial was lost or run again"
            kept = now
            assert len(kept) < trials, "it had ended before"
        if len(kept) > trials - 10:
            break
    table = finish(out, "--resume", "--workers", "2", trials=trials)
    with Ledger.read(out) as ledger:
        now = {row.trial: row.outcome.wall for row in ledger.rows()}
    assert {trial: now[trial] for trial in kept} == kept
    assert sorted(now) == list(range(trials))
    return table


def test_killed_at_random_moments(whole: bytes, tmp_path: Path) -> None:
    assert kills(tmp_path / "out", 3, TRIALS, random.Random(3)) == whole


def test_killed_here_and_finished_on_dask(tmp_path: Path) -> None:
    pytest.importorskip("distributed")
    out, mark = tmp_path / "out", uuid.uuid4().hex
    trials = 300
    process = start(out, "--workers", "1", "--progress", "json", trials=trials, mark=mark, SPRAIN_TEST_HELD_AT="5")
    until_some_are_finished(process, 5)
    process.kill()
    process.communicate()
    with Ledger.read(out) as ledger:
        kept = {row.trial: row.outcome.wall for row in ledger.rows()}
    assert 5 <= len(kept) < trials
    table = finish(out, "--resume", "--scheduler", "local-cluster", "--workers", "2", trials=trials)
    assert table == finish(tmp_path / "whole", "--workers", "2", trials=trials)
    with Ledger.read(out) as ledger:
        assert {row.trial: row.outcome.wall for row in ledger.rows() if row.trial in kept} == kept


@pytest.mark.long
def test_killed_a_hundred_times(tmp_path: Path) -> None:
    assert kills(tmp_path / "out", 100, 4000, random.Random(4)) == finish(
        tmp_path / "whole", "--workers", "2", trials=4000
    )


VICTIMS = ("driver", "worker", "all")


def finished_in(out: Path) -> set[int]:
    """The trials that are in the ledger now."""
    if not (out / "ledger.sqlite").is_file():
        return set()
    try:
        with Ledger.read(out) as ledger:
            return set(ledger.finished()[0].tolist())
    except InputError:  # the first process is just making it
        return set()


def kills_while_it_runs(out: Path, count: int, trials: int, rng: random.Random) -> dict[str, int]:
    """Kills the driver, one worker, or all processes at once `count` times, always after this process has written rows;
    what had been committed stays as it was, and no process outlives its driver by 2 s. {victim: times}"""
    kept: dict[int, float] = {}
    done = dict.fromkeys(VICTIMS, 0)
    process: subprocess.Popen[str] | None = None
    mark, needed, before, gate = "", set[int](), set[int](), out.with_name("gate")
    while sum(done.values()) < count and len(kept) < trials - 200:
        if process is None:
            mark = uuid.uuid4().hex
            options = ("--resume", "--workers", str(rng.choice((1, 2))), "--progress", "none")
            gate.write_text("0")
            process = start(out, *options, trials=trials, mark=mark, SPRAIN_TEST_HELD_AT=str(gate))
            begun = len(finished_in(out))
        wait, ahead = rng.randrange(1, 8), rng.randrange(1, 30)
        while len(finished := finished_in(out)) < begun + wait or before or not needed <= finished:
            gate.write_text(str(len(finished) + ahead))
            if before and finished > before:
                before, needed = set(), set(range(max(finished) + 9))
            assert process.poll() is None, process.communicate()[1]
            time.sleep(0.01)
        victim = rng.choice(VICTIMS)
        children = [pid for pid in marked(mark) if pid != process.pid]
        if victim == "worker":
            if not children:
                continue
            with contextlib.suppress(ProcessLookupError):
                os.kill(rng.choice(children), signal.SIGKILL)
                done[victim] += 1
            # the trial that was hit must have its second try behind it, or a second kill makes it a failure, which is
            # right: it is one of the next after those that the first commit from here on shows
            before = finished_in(out)
            begun = len(before)
            continue
        for pid in (children if victim == "all" else []) + [process.pid]:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        process.communicate()
        process, needed, before = None, set(), set()
        done[victim] += 1
        assert gone(mark)
        with Ledger.read(out) as ledger:
            now = {row.trial: row.outcome.wall for row in ledger.rows()}
        assert {trial: now.get(trial) for trial in kept} == kept, "an acknowledged trial was lost or run again"
        kept = now
    if process is not None:
        process.kill()
        process.communicate()
    return done


@pytest.mark.long
def test_killed_while_it_runs(tmp_path: Path) -> None:
    """Driver, worker or all. SPRAIN_KILLS: how often; 300 for docs/reliability.md."""
    count = int(os.environ.get("SPRAIN_KILLS", "30"))
    trials = 40 * count + 300
    done = kills_while_it_runs(tmp_path / "out", count, trials, random.Random(17))
    print(done)
    assert sum(done.values()) == count
    assert min(done.values()) >= count // 6
    table = finish(tmp_path / "out", "--resume", "--workers", "2", trials=trials)
    assert table == finish(tmp_path / "whole", "--workers", "2", trials=trials)
    assert finished_in(tmp_path / "out") == set(range(trials))


def test_second_run_on_a_folder_names_the_first_and_a_stale_lock_is_no_matter(tmp_path: Path) -> None:
    out = tmp_path / "out"
    first = start(out, "--workers", "1", "--progress", "json", trials=ENDLESS)
    until_some_are_finished(first, 1)
    second = start(out, "--resume")
    _, said = second.communicate(timeout=60)
    assert second.returncode == 2
    assert said.splitlines()[-1].startswith(f"error: {out}: in use by process {first.pid}")
    first.kill()
    first.communicate()
    assert (out / ".lock").read_text().strip() == str(first.pid), "the killed one left its mark"
    with Ledger.read(out) as ledger:
        facts = ledger.facts
    Ledger(out, facts["digest"], json.loads(facts["identity"]), facts["study"]).close()


def test_full_disk_is_one_line_and_the_ledger_stays_valid(whole: bytes, tmp_path: Path) -> None:
    out = tmp_path / "out"
    process = start(out, "--workers", "2", "--progress", "none", trials=5000, limit=100_000)
    _, said = process.communicate(timeout=120)
    assert process.returncode == 4, said
    errors = [line for line in said.splitlines() if not line.startswith("warning")]
    assert len(errors) == 1
    assert errors[0].startswith(f"error: {out}: the ledger cannot be written")
    trials = pd.read_csv(io.BytesIO(whole), index_col="trial")
    with Ledger.read(out) as ledger:
        assert ledger._database.execute("PRAGMA integrity_check").fetchone() == ("ok",)
        rows = [row for row in ledger.rows() if row.trial < TRIALS]
    assert rows
    for row in rows:
        assert dict(row.outcome.metrics) == trials.loc[row.trial, list(row.outcome.metrics)].to_dict()


@pytest.mark.parametrize("where", ["/proc/study", "file/study"])
def test_folder_that_cannot_be_made_is_one_line(where: str, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    process = start(tmp_path / where)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 4, said
    assert len(said.splitlines()) == 1
    assert said.startswith("error: ")


def test_same_table_elsewhere(whole: bytes, tmp_path: Path) -> None:
    """Seven workers, another working directory, locale and hash seed; resumed when complete, it changes nothing and
    exits 0."""
    elsewhere = {"PWD": "/", "LC_ALL": "C", "PYTHONHASHSEED": "77", "TZ": "Asia/Kathmandu"}
    assert finish(tmp_path / "out", "--workers", "7", **elsewhere) == whole
    timing = (tmp_path / "out" / "timing.csv").read_bytes()
    assert finish(tmp_path / "out", "--workers", "7", "--resume") == whole
    assert (tmp_path / "out" / "timing.csv").read_bytes() == timing
