"""What FMUs say, through their logger and by the status warning: counted, the first shown, never sent to a terminal;
statuses that FMI does not know end a run in one line."""

from __future__ import annotations

import gc
import json
import os
import re
import subprocess
import sys
import threading
from pathlib import Path

import pandas as pd
import pytest

import sprain_cosim as sc
from sprain_cosim.errors import SprainError
from sprain_cosim.fmu.messages import Log, Messages, line, receive
from tests.native import SPEECH, device

KINDS = [(1, False), (2, False), (3, False), (1, True), (2, True), (3, True)]
STOP = "15 ms"


@pytest.fixture(scope="module")
def speakers(tmp_path_factory: pytest.TempPathFactory) -> dict[tuple[int, bool], Path]:
    folder = tmp_path_factory.mktemp("speakers")
    return {
        (fmi, exchange): device(folder / f"speaker{fmi}{'_me' if exchange else ''}.fmu", fmi, exchange, speaks=True)
        for fmi, exchange in KINDS
    }


def scenario(fmu: Path, speech: str) -> sc.Scenario:
    found = sc.load_scenario("incline30").replace_fmu("brace", fmu).with_master("gauss-seidel", stop=STOP)
    return found.override("brace.speech", float(SPEECH.index(speech)))


@pytest.mark.parametrize("kind", KINDS)
def test_what_an_fmu_says_is_counted_run_by_run(kind: tuple[int, bool], speakers: dict[tuple[int, bool], Path]) -> None:
    """In one session, so that nothing is left over from the run before."""
    fmu = speakers[kind]
    with scenario(fmu, "silent").open(in_process=True) as session:
        found = {
            speech: session.run({"brace.speech": float(SPEECH.index(speech))})
            for speech in ("silent", "informs", "warns", "controls", "thread", "many", "after_free", "silent")
        }
    assert {result.status for result in found.values()} == {"completed"}
    said = {speech: result.messages.get("brace") for speech, result in found.items()}
    assert said["silent"] is None
    assert said["informs"] == Messages(1, 0, "all is well", False)
    assert said["warns"] == Messages(2, 1, "strap near its end", True)
    assert said["controls"] == Messages(1, 0, "\\x1b[2J\\x1b]0;mine\\x07 \ufffd tidy", True)
    assert said["thread"] == Messages(1, 0, "from another thread", True)
    assert said["many"] == Messages(1000, 0, "at last", True)
    assert said["after_free"] is None
    assert "plant" not in found["warns"].messages
    assert found["warns"].signals.equals(found["silent"].signals), "what is said changes no number"


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("speech", "words"),
    [
        ("fails", "reported an error .*: strap torn at 10 ms$"),  # not the last line that it logged
        ("unknown", "gave status 17 "),
        ("negative", "gave status -3 "),
    ],
)
def test_a_step_that_fails_is_one_line_that_quotes_the_error(
    kind: tuple[int, bool], speech: str, words: str, speakers: dict[tuple[int, bool], Path]
) -> None:
    result = scenario(speakers[kind], speech).run(in_process=True)
    assert result.status == "failed"
    assert "\n" not in result.message
    assert re.search(f"^brace: {words}", result.message), result.message
    if speech == "fails":
        assert result.messages["brace"].first == "strap torn at 10 ms"


def test_the_last_error_of_a_process_that_dies_is_kept(speakers: dict[tuple[int, bool], Path]) -> None:
    result = scenario(speakers[3, False], "dies").run()
    assert result.status == "failed"
    assert "ended by signal SIGABRT; it said: no licence" in result.message


@pytest.mark.parametrize("isolate", [False, True])
def test_a_warning_status_alone_counts(isolate: bool, speakers: dict[tuple[int, bool], Path]) -> None:
    """Each step from 10.5 ms on; with every FMU in a process of its own as well."""
    chosen = scenario(speakers[2, False], "only_status")
    result = (chosen.isolated() if isolate else chosen).run()
    assert result.messages == {"brace": Messages(0, 10, "", True)}
    assert result.messages["brace"].text == "its FMU answered 10 calls with a warning"


def test_what_is_said_stands_in_the_summaries(speakers: dict[tuple[int, bool], Path], tmp_path: Path) -> None:
    """Of a run, and of a study with how many trials; resumed alike."""
    study = sc.load_study("study2").replace_fmu("brace", speakers[2, False]).with_master("gauss-seidel", stop=STOP)
    sampled = sc.load_study("study2")
    table = pd.DataFrame(sampled.sample()[:3], columns=sampled.headings)
    table["brace.speech"] = [SPEECH.index(s) for s in ("informs", "silent", "warns")]
    table.to_csv(tmp_path / "rows.csv", index=False)
    plan = study.with_inputs(tmp_path / "rows.csv")
    done = plan.run(workers=1, out=tmp_path / "s", trajectories=0)
    said = done.summary.fmu_messages["brace"]
    assert said.text(3) == (
        "its FMU logged 3 messages and answered 1 call with a warning in 2 of 3 trials; the first, in trial 2: strap "
        "near its end"
    )
    again = plan.run(workers=1, out=tmp_path / "s", trajectories=0, resume=True, parquet=False)
    assert again.summary.fmu_messages == done.summary.fmu_messages
    written = json.loads((tmp_path / "s" / "summary.json").read_text())["fmu_messages"]
    assert written == {
        "brace": {"trials": 2, "count": 3, "warnings": 1, "first": "strap near its end", "trial": 2, "grave": True}
    }


def test_a_log_gives_the_first_warning_and_quotes_the_last_error() -> None:
    log = Log("brace")
    log.add("hello\n", 0)
    log.add(b"\xffout of range", 1)
    log.add("worse", 3)
    log.add("bye", 0)
    assert log.found() == Messages(4, 0, "\ufffdout of range", True)
    assert log.quote() == ": worse"
    log.clear()
    assert (log.found(), log.quote()) == (None, "")
    log.add("Traceback (most recent call last):\n  File x\nValueError: no such strap\n", 3)
    assert log.quote() == ": ValueError: no such strap"
    assert len(line("x" * 10_000)) == 500


def test_nobody_listens_to_what_is_gone() -> None:
    """The logger lives as long as the process; what a freed instance says is dropped."""
    log = Log("brace")
    name = log.label.encode()
    receive(None, name, 1, b"", b"one")
    assert log.found() == Messages(1, 0, "one", True)
    del log
    gc.collect()
    for speaker in (name, None, b"", b"brace", b"brace_99999999999999999999"):
        receive(None, speaker, 1, b"", b"two")


def test_a_sum_keeps_the_order() -> None:
    several = [Messages(1, 0, "calm", False), Messages(0, 2, "", True), Messages(3, 1, "grave", True)]
    assert Messages.sum(several) == Messages(4, 3, "grave", True)
    assert Messages.sum(several[:2]) == Messages(1, 2, "calm", True)
    assert Messages.sum([]) is None


def command(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-P", "-m", "sprain_cosim", *arguments], cwd=cwd, capture_output=True, text=True, check=False
    )


def test_an_fmu_that_prints_does_not_spoil_the_result(speakers: dict[tuple[int, bool], Path], tmp_path: Path) -> None:
    """In the command's own process: the command moves its stdout aside, and points descriptor 1 at stderr."""
    options = ["run", "incline30", "--fmu", f"brace={speakers[2, False]}", "--stop", STOP, "--json", "--in-process"]
    ran = command(*options, "--set", f"brace.speech={SPEECH.index('prints')}", cwd=tmp_path)
    assert ran.returncode == 0, ran.stderr
    assert json.loads(ran.stdout)["status"] == "completed"
    assert "printed by the device" in ran.stderr


def test_control_characters_do_not_reach_the_terminal(speakers: dict[tuple[int, bool], Path], tmp_path: Path) -> None:
    options = ["run", "incline30", "--fmu", f"brace={speakers[2, False]}", "--stop", STOP, "--json"]
    ran = command(*options, "--set", f"brace.speech={SPEECH.index('controls')}", cwd=tmp_path)
    assert ran.returncode == 0, ran.stderr
    assert "warning: brace: its FMU logged 1 message; the first: \\x1b[2J\\x1b]0;mine\\x07 \ufffd tidy" in ran.stderr
    assert not re.search("[\x00-\x08\x0b-\x1f\x7f]", ran.stderr + ran.stdout)
    assert json.loads(ran.stdout)["fmu_messages"]["brace"]["count"] == 1


def test_check_notes_what_the_device_says(speakers: dict[tuple[int, bool], Path]) -> None:
    report = sc.check_brace(speakers[2, False], settings={"speech": float(SPEECH.index("warns"))})
    notes = [note for note in report.notes if "strap near its end" in note]
    assert len(notes) == 1
    assert re.match(r"its FMU logged \d+ messages and answered \d+ calls with a warning; the first: ", notes[0])


def test_two_threads_at_once_lose_nothing(speakers: dict[tuple[int, bool], Path]) -> None:
    """Ten landings each of shipped FMUs in this process, and a thread with a foreign one: the numbers of one thread
    alone, and this process as it was at any moment: stdout, working folder, descriptors."""
    own, foreign = sc.load_scenario("incline30_mixed").with_master(stop=STOP), scenario(speakers[2, False], "prints")
    alone = [chosen.run().signals for chosen in (own, foreign)]
    before, stdout, descriptors = os.getcwd(), sys.stdout, len(os.listdir("/proc/self/fd"))
    wrong: list[str] = []
    places: set[str] = set()

    def land(k: int, chosen: sc.Scenario, times: int) -> None:
        try:
            for _ in range(times):
                result = chosen.run()
                if result.status != "completed" or not result.signals.equals(alone[k]):
                    wrong.append(f"{k}: {result.message}")
        except (SprainError, OSError) as problem:
            wrong.append(str(problem))

    threads = [threading.Thread(target=land, args=work) for work in ((0, own, 10), (0, own, 10), (1, foreign, 2))]
    for thread in threads:
        thread.start()
    while any(thread.is_alive() for thread in threads):
        places.add(os.getcwd())
        threads[0].join(1e-4)
    for thread in threads:
        thread.join()
    assert not wrong
    assert places == {before}
    assert (os.getcwd(), sys.stdout) == (before, stdout)
    assert len(os.listdir("/proc/self/fd")) <= descriptors
