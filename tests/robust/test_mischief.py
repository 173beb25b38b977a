"""Foreign FMUs that harm what is around them: nothing they do changes this program, another trial or the user's files,
and nothing ends in a result that is none."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest

import sprain_cosim as sc
from sprain_cosim.cli import _run
from sprain_cosim.process import Limits
from sprain_cosim.sandbox.kernel import SIGNAL_ABI, offered
from sprain_cosim.study.plan import Plan
from tests.native import MISCHIEF, mischief
from tests.processes import soon

FULL = offered().landlock >= SIGNAL_ABI and offered().seccomp
needs_all = pytest.mark.skipif(not FULL, reason=f"this kernel offers {offered()}")
STOP = "20 ms"
LIMITS = Limits(trial=8.0)
HARMLESS = [
    "fork_once",
    "fork_stays",
    "leave_session",
    "daemon",
    "kill_parent",
    "stop_parent",
    "folder",
    "locale",
    "handler",
    "thread",
    "own_file",
    "socket",
    "steal",
    "round_up",
    "trap",
    "flush_to_zero",
]
OWN = ("environment", "umask")  # the trial that does it feels it itself, no other does
ENDS = {
    "exit_in_step": ("crashed", "exit code 0"),
    "unknown_status": ("failed", "status 17"),
    "negative_status": ("failed", "status -3"),
    "write_descriptors": ("crashed", ""),
    "close_descriptors": ("crashed", ""),
    "stop_itself": ("timeout", "wall time"),
}


@pytest.fixture(scope="module")
def fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("mischief")
    (folder / "target").mkdir()
    return mischief(folder / "brace.fmu", folder=folder / "target")


@pytest.fixture
def target(fmu: Path) -> Path:
    folder = fmu.parent / "target"
    (folder / "stolen").unlink(missing_ok=True)
    (folder / "secret").write_text("what is not yours")
    return folder


def scenario(fmu: Path, kind: str = "none") -> sc.Scenario:
    found = sc.load_scenario("incline30").replace_fmu("brace", fmu).with_master(stop=STOP)
    return found.override("brace.mischief", float(MISCHIEF.index(kind)))


def study(fmu: Path, kinds: list[str], folder: Path) -> Plan:
    chosen = sc.load_study("study2").replace_fmu("brace", fmu)
    table = pd.DataFrame(sc.load_study("study2").sample()[: len(kinds)], columns=sc.load_study("study2").headings)
    table["brace.mischief"] = [MISCHIEF.index(kind) for kind in kinds]
    table.to_csv(folder / "inputs.csv", index=False)
    return chosen.with_inputs(folder / "inputs.csv")


def rows(fmu: Path, kinds: list[str], folder: Path, **options: object) -> pd.DataFrame:
    folder.mkdir(exist_ok=True)
    return study(fmu, kinds, folder).run(**{"workers": 1, "limits": LIMITS, "max_failed": 1.0} | options).trials


def processes_of(folder: Path) -> list[str]:
    """Of anybody, that have this folder's FMU loaded."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                if str(folder) in (entry / "maps").read_text():
                    found.append(entry.name)
            except OSError:
                continue
    return found


@needs_all
def test_a_study_goes_on_whatever_a_trial_does(fmu: Path, target: Path, tmp_path: Path) -> None:
    """Each kind of harm between clean trials: the clean ones are those of a study without harm, to the bit; harm that
    the sandbox refuses changes not even its own trial."""
    kinds = [k for kind in [*HARMLESS, *OWN, *ENDS] for k in ("none", kind)]
    clean = rows(fmu, ["none"] * len(kinds), tmp_path / "clean")
    harmed = rows(fmu, kinds, tmp_path / "harmed")
    assert (clean["status"] == "completed").all()
    response = [c for c in clean.columns if c.startswith("peak_")]
    for k, kind in enumerate(kinds):
        status, message = harmed.loc[k, ["status", "message"]]
        if kind in ENDS:
            assert (status, ENDS[kind][1] in message) == (ENDS[kind][0], True), (kind, status, message)
            continue
        assert status == "completed", (kind, message)
        if kind not in OWN:
            assert (harmed.loc[k, response] == clean.loc[k, response]).all(), kind
    assert not (target / "stolen").exists()
    assert soon(lambda: not processes_of(fmu.parent), 2.0)


@needs_all
@pytest.mark.parametrize("workers", [1, 2])
def test_a_device_that_forks_once_gives_no_row_of_another(workers: int, fmu: Path, tmp_path: Path) -> None:
    """24 trials, without the sandbox, which would refuse the fork: both processes come back, one of them has nothing to
    say."""
    kinds = ["none", "fork_once", *["none"] * 4] * 4
    clean = rows(fmu, ["none"] * 24, tmp_path / "clean", workers=workers)
    plan = study(fmu, kinds, tmp_path)
    bare = plan.unconfined()
    forked = bare.run(workers=workers, limits=LIMITS, max_failed=1.0).trials
    response = [c for c in clean.columns if c.startswith("peak_")]
    assert (forked["status"] == "completed").all(), forked["message"].tolist()
    assert (forked[response] == clean[response]).all().all()


@needs_all
@pytest.mark.parametrize(
    "kind",
    [
        "exit_in_step",
        "exit_in_start",
        "exit_in_instantiate",
        "crash_in_instantiate",
        "unknown_status",
        "close_descriptors",
    ],
)
def test_a_run_never_ends_in_silence(kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Exit code 3 and one line, in and out of a landing; nothing on stdout."""
    fmu = mischief(tmp_path / "brace.fmu", kind)
    assert _run(["run", "incline30", "--fmu", f"brace={fmu}", "--stop", STOP], []) == 3
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert err.startswith("error: ")


@needs_all
@pytest.mark.parametrize("kind", ["exit_in_free", "crash_in_free"])
def test_what_happens_when_it_is_freed_changes_no_result(kind: str, tmp_path: Path) -> None:
    harmed = (
        sc.load_scenario("incline30").replace_fmu("brace", mischief(tmp_path / "a.fmu", kind)).with_master(stop=STOP)
    )
    clean = scenario(mischief(tmp_path / "b.fmu"))
    assert harmed.run().metrics == clean.run().metrics


@needs_all
def test_a_run_in_the_sandbox_is_the_same_to_the_bit(fmu: Path) -> None:
    chosen = scenario(fmu).recording("plant.*")
    apart, here = chosen.run(), chosen.run(in_process=True)
    assert apart.status == here.status == "completed", apart.message
    assert apart.signals.equals(here.signals)
    assert apart.metrics == here.metrics
    for name in ("scheme", "scheme_reason", "warning", "coupling_error", "parameters", "units", "exchanges", "held"):
        assert getattr(apart, name) == getattr(here, name), name
    assert chosen.isolation().kind == "sandbox"
    assert chosen.unconfined().isolation().kind == "none"
    assert sc.load_scenario("incline30").isolation().kind == "none"


@needs_all
@pytest.mark.parametrize(
    "kind", ["kill_parent", "stop_parent", "leave_session", "steal", "fork_once", "umask", "folder"]
)
def test_a_run_is_not_harmed(kind: str, fmu: Path, target: Path) -> None:
    before = os.getcwd(), os.umask(0o022)
    result = scenario(fmu, kind).run()
    assert result.status == "completed", result.message
    assert (os.getcwd(), os.umask(before[1])) == (before[0], 0o022)
    assert not (target / "stolen").exists()
    assert not processes_of(fmu.parent)


@needs_all
@pytest.mark.parametrize("kind", ["umask", "environment", "handler"])
def test_what_half_the_step_changes_is_put_back_too(kind: str, fmu: Path) -> None:
    harm = {"brace.mischief": float(MISCHIEF.index(kind))}
    with scenario(fmu).open() as session:
        first, harmed = session.run(), session.run(harm)
        assert session.at_half_the_step(harm)
        assert session.run().signals.equals(first.signals)
        assert session.run(harm).signals.equals(harmed.signals)


@needs_all
def test_a_session_survives_its_process(fmu: Path) -> None:
    with scenario(fmu).open() as session:
        first = session.run()
        crashed = session.run({"brace.mischief": float(MISCHIEF.index("exit_in_step"))})
        assert (crashed.status, len(crashed.time)) == ("failed", 0)
        assert "ended its process with exit code 0" in crashed.message
        assert "--isolate tells which FMU it is" in crashed.message
        assert session.run().signals.equals(first.signals)


@needs_all
def test_what_is_granted_is_said(fmu: Path, target: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The grant works, the summary and a warning name it."""
    table = tmp_path / "brace.map.toml"
    table.write_text(f'allow = ["read:{target}"]\n')
    command = ["run", "incline30", "--fmu", f"brace={fmu}", "--map", f"brace={table}", "--stop", STOP, "--json"]
    assert _run(command, []) == 0
    out, err = capsys.readouterr()
    summary = json.loads(out)
    assert (summary["isolation"], summary["granted"]) == ("sandbox", {"brace": [f"read:{target}"]})
    assert f"warning: brace: may use read:{target} beyond the sandbox ({table} allows it)" in err
    assert _run([*command, "--in-process"], []) == 0
    assert json.loads(capsys.readouterr().out)["isolation"] == "none"


def test_children_import_nothing_from_the_current_folder(tmp_path: Path) -> None:
    """numpy.py and json.py lie where the command is typed."""
    for name in ("numpy", "json", "pandas", "fmpy"):
        (tmp_path / f"{name}.py").write_text("import pathlib; pathlib.Path(__file__).with_suffix('.ran').touch()\n")
    code = (
        "import sys; sys.path = [p for p in sys.path if p]\n"
        "import os, sprain_cosim as sc\n"
        f"os.chdir({str(tmp_path)!r})\n"
        "print(sc.load_study('study2').run(trials=1, workers=1).summary.n_completed)"
    )
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([*filter(None, [os.environ.get("PYTHONPATH")]), ""])}
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=False)
    assert ran.stdout == "1\n", ran.stderr
    assert not list(tmp_path.glob("*.ran"))
