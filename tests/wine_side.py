"""What tests/robust/test_under_wine.py has run by the Windows Python: `python -m tests.wine_side WHAT FOLDER`, which
leaves its answer in FOLDER/WHAT.json."""

from __future__ import annotations

import ctypes
import json
import random
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from sprain_cosim import load_scenario, load_study
from sprain_cosim.process import Limits
from sprain_cosim.shipped import shipped_scenarios
from sprain_cosim.study.worker import Worker

TRIALS = 50
KILLS, MANY = 10, 400  # of a driver, trials of its study
COMMAND = (sys.executable, "-m", "sprain_cosim")
PATIENT = Limits(trial=300.0)  # a Python takes its time to start there


def scenarios(folder: Path) -> Any:
    """{name: metrics} of the scenarios that ship."""
    return {name: dict(load_scenario(name).run().metrics) for name in shipped_scenarios()}


def studies(folder: Path) -> Any:
    """Study 6 with one and with two workers: the numbers of completed trials."""
    return [
        load_study("study6").run(trials=TRIALS, workers=k, out=folder / f"{k}", limits=PATIENT).summary["n_completed"]
        for k in (1, 2)
    ]


def faults(folder: Path) -> Any:
    """[status, message] of the trials of a study whose brace fails in some; the table says in which, and how."""
    scenario = load_scenario("incline30").replace_fmu("brace", folder / "faulty.fmu")
    found = []
    with Worker(scenario, ("brace.fault",), Limits(trial=10.0, start=300.0)) as worker:
        for fault in json.loads((folder / "faults.txt").read_text()):
            outcome = worker.run([fault])
            found.append([outcome.status, outcome.message, dict(outcome.metrics)])
    return found


def kills(folder: Path) -> Any:
    """The driver of a study is ended KILLS times, each time when it has committed some rows more than before: rows that
    were committed and are gone or changed, rows kept after each kill."""
    out = folder / "killed"
    options = ["--trials", str(MANY), "--workers", "2", "--resume", "--progress", "json", "--trial-limit", "300 s"]
    command = [*COMMAND, "study", "study6", *options, "--out", str(out)]
    moments, kept, lost, counts = random.Random(3), dict[int, bytes](), 0, []
    for _ in range(KILLS):
        enough = len(kept) + moments.randint(1, MANY // (2 * KILLS))
        with subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True) as driver:
            _wait(driver, partial(_holds, out, enough))
            before = kept | _rows(out)
            driver.kill()
        kept = _rows(out)
        lost += sum(kept.get(trial) != row for trial, row in before.items())
        counts.append(len(kept))
    ended = subprocess.run(command, capture_output=True, text=True)
    after = _rows(out)
    lost += sum(after.get(trial) != row for trial, row in kept.items())
    return {"lost": lost, "kept": counts, "finished": len(after), "code": ended.returncode}


def stops(folder: Path) -> Any:
    """Ctrl-C at the console of a study, and of a run whose device hangs: exit code and last words of both; of the study
    also the rows that it kept, those after --resume, and the exit code of that. The C library of wine does not hand on
    Ctrl-Break."""
    console = ctypes.WinDLL("kernel32")  # type: ignore[attr-defined]
    console.FreeConsole()
    console.AllocConsole()
    signal.signal(signal.SIGINT, lambda *_: None)  # it goes to all processes of the console
    out = folder / "stopped"
    options = ["--trials", str(MANY), "--workers", "2", "--progress", "none", "--trial-limit", "300 s"]
    study = [*COMMAND, "study", "study6", *options, "--out", str(out)]
    with subprocess.Popen(study, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True) as driver:
        _wait(driver, partial(_holds, out, 5))
        of_study = _stopped(driver, console)
    kept = len(_rows(out))
    again = subprocess.run([*study, "--resume"], capture_output=True)
    run = [*COMMAND, "run", "incline30", "--fmu", f"brace={folder / 'hanging.fmu'}"]
    with subprocess.Popen(run, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True) as driver:
        _wait(driver, (folder / "hangs").exists)
        of_run = _stopped(driver, console)
    return {"study": of_study, "kept": kept, "finished": len(_rows(out)), "again": again.returncode, "run": of_run}


def _wait(driver: subprocess.Popen[str], happened: Callable[[], bool]) -> None:
    """Until it has; on a busy machine that takes its time."""
    while not happened():
        assert driver.poll() is None, driver.communicate()
        time.sleep(0.02)


def _stopped(driver: subprocess.Popen[str], console: Any) -> tuple[int, str]:
    """Exit code and last words."""
    assert console.GenerateConsoleCtrlEvent(0, 0)
    words = driver.communicate()[1].strip().splitlines()
    return driver.returncode, " / ".join(words[-3:])


def limits(folder: Path) -> Any:
    """[status, message] of trials whose brace spins for longer than its processor time, and after that does not."""
    scenario = load_scenario("incline30").replace_fmu("brace", folder / "greedy.fmu")
    found = []
    with Worker(scenario, ("brace.fault",), Limits(trial=300.0, cpu=3.0)) as worker:
        for fault in json.loads((folder / "greedy.txt").read_text()):
            outcome = worker.run([fault])
            found.append([outcome.status, outcome.message])
    return found


def _rows(folder: Path) -> dict[int, bytes]:
    """{trial: metrics} of what is committed."""
    try:
        database = sqlite3.connect(folder / "ledger.sqlite")
        try:
            return dict(database.execute("SELECT trial, metrics FROM trials"))
        finally:
            database.close()
    except sqlite3.Error:
        return {}


def _holds(folder: Path, count: int) -> bool:
    return len(_rows(folder)) >= count


if __name__ == "__main__":
    what, place = sys.argv[1], Path(sys.argv[2])
    answer = {f.__name__: f for f in (scenarios, studies, faults, kills, stops, limits)}[what](place)
    (place / f"{what}.json").write_text(json.dumps(answer))
