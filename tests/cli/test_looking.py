"""animate, export and reproduce on the command line, from the folders that run and study leave."""

from __future__ import annotations

import json
import shutil
import zipfile
from pathlib import Path

import pandas as pd
import pytest

from sprain_cosim.animate.film import animate
from sprain_cosim.cli import _run
from sprain_cosim.errors import InputError
from sprain_cosim.figures.landings import leave_run
from sprain_cosim.fmu.cache import cache_folder
from sprain_cosim.folders.landing import choose_common_trial, load_landing, load_landings
from sprain_cosim.folders.run import RunSummary
from sprain_cosim.scenario import Scenario, load_scenario
from sprain_cosim.shipped import fmu_path
from tests.cli.test_run import call, refused

SHORT = (
    'base = "incline30"\n[components.brace]\nfmu = "brace_bushing"\n[parameters]\n"brace.angle_scale" = '
    '2.4\n[master]\nstop = "30 ms"\n'
)
STUDY = (
    'scenario = "short.toml"\n[marginals]\n"plant.drop_height" = { normal = { mean = "0.30 m", sd = "0.02 m" } '
    "}\n[study]\ntrials = 5\nseed = 3\n"
)


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run and a study of a short landing."""
    folder = tmp_path_factory.mktemp("place")
    (folder / "short.toml").write_text(SHORT)
    (folder / "study.toml").write_text(STUDY)
    assert call("run", "short.toml", "--out", "run", cwd=folder).returncode == 0
    made = call(
        "study",
        "study.toml",
        "--out",
        "many",
        "--workers",
        "1",
        "--progress",
        "none",
        "--set",
        "brace.angle_scale=1.5",
        cwd=folder,
    )
    assert made.returncode == 0, made.stderr
    return folder


def test_animation_lands_in_the_folder_and_a_run_may_be_repeated(place: Path) -> None:
    made = call("animate", "run", "many", "--slow", "5", "--trial", "worst", cwd=place)
    refused(made, 2, "run: holds a single run", "leave --trial out")
    made = call("animate", "run", "--slow", "5", cwd=place)
    assert made.returncode == 0, made.stderr
    assert made.stdout.startswith("written: run/animation.webp (4 pictures, ")
    assert (place / "run" / "animation.webp").read_bytes()[8:12] == b"WEBP"
    assert call("run", "short.toml", "--out", "run", cwd=place).returncode == 0


def test_trials_of_a_study(place: Path) -> None:
    peaks = pd.read_csv(place / "many" / "trials.csv").set_index("trial")["peak_subtalar_angle_deg"]
    for which, number in {"worst": peaks.idxmax(), "p0": peaks.idxmin(), "2": 2}.items():
        landing = load_landing(place / "many", which)
        assert f"many, trial {number}" in landing.label
        assert landing.result.metrics["peak_subtalar_angle_deg"] == pytest.approx(peaks[number], rel=1e-12)
        assert "plant.pelvis_tx" in landing.result.index
        assert landing.parameters["brace.angle_scale"] == 1.5
    made = call("animate", "many", "--trial", "worst", "--out", "worst.png", cwd=place)
    assert made.returncode == 0, made.stderr
    assert (
        made.stderr
        == f"many, trial {peaks.idxmax()}, largest peak_subtalar_angle_deg: 30° slope, 150 % brace, ankle muscles off\n"
    )
    made = call("export", "many", "--trial", "2", "-o", "two.csv", cwd=place)
    assert made.returncode == 0, made.stderr
    assert pd.read_csv(place / "two.csv")["plant.subtalar_angle [rad]"].max() * 57.29577951308232 == pytest.approx(
        peaks[2], rel=1e-8
    )


def land(scenario: Scenario, folder: Path) -> RunSummary:
    result = scenario.recording("plant.*").run()
    summary = RunSummary.of(scenario, result)
    leave_run(folder, result, summary)
    return summary


def test_another_fmu_is_named(place: Path, tmp_path: Path) -> None:
    device = tmp_path / "mine.fmu"
    shutil.copy(fmu_path("brace_bushing", tmp_path, "brace"), device)
    study = str(place / "study.toml")
    made = call(
        "study",
        study,
        "--fmu",
        f"brace={device}",
        "--out",
        "s",
        "--trials",
        "2",
        "--workers",
        "1",
        "--progress",
        "none",
        cwd=tmp_path,
    )
    assert made.returncode == 0, made.stderr
    with zipfile.ZipFile(device, "a") as archive:
        archive.writestr("extra/note.txt", "the same device in another archive")
    shown = call("animate", "s", "--out", "x.png", cwd=tmp_path)  # by the copy that the study kept
    assert shown.returncode == 0, shown.stderr
    shutil.rmtree(cache_folder() / "files")
    refused(call("animate", "s", "--out", "x.png", cwd=tmp_path), 2, "its study is another now (fmus.brace: ")
    again = call("reproduce", "s/manifest.json", "--workers", "1", "--progress", "none", cwd=tmp_path)
    assert again.returncode == 0, again.stderr
    assert "differs: FMU brace: SHA-256 " in again.stdout
    assert "identical: 2 trials" in again.stdout
    device.unlink()
    refused(call("reproduce", "s/manifest.json", cwd=tmp_path), 2, f"brace = {device}", "gone; put it back")


def test_reproduce_identical_and_the_first_that_differs(place: Path, tmp_path: Path) -> None:
    many = tmp_path / "many"
    shutil.copytree(place / "many", many)
    again = call(
        "reproduce",
        str(many / "manifest.json"),
        "--workers",
        "1",
        "--progress",
        "none",
        "--json",
        "--out",
        "again",
        cwd=tmp_path,
    )
    assert again.returncode == 0, again.stderr
    assert json.loads(again.stdout) == {
        "identical": True,
        "trials": 5,
        "different": 0,
        "first": None,
        "differences": [],
        "out": "again",
    }
    assert (tmp_path / "again" / "trials.csv").read_bytes() == (many / "trials.csv").read_bytes()

    trials = pd.read_csv(many / "trials.csv", dtype=str, keep_default_na=False)
    before = trials.loc[3, "peak_subtalar_angle_deg"]
    trials.loc[3, "peak_subtalar_angle_deg"] = before[:-1] + ("1" if before[-1] != "1" else "2")  # the last digit
    trials.loc[4, "status"] = "failed"
    trials.to_csv(many / "trials.csv", index=False)
    manifest = json.loads((many / "manifest.json").read_text())
    manifest["versions"]["numpy"] = "1.0"
    (many / "manifest.json").write_text(json.dumps(manifest))
    again = call("reproduce", str(many), "--workers", "1", "--progress", "none", cwd=tmp_path)
    assert again.returncode == 1, again.stderr
    assert "differs: numpy 1.0 then, " in again.stdout
    assert (
        "2 of 5 trials differ; the first is trial 3: peak_subtalar_angle_deg = "
        f"{trials.loc[3, 'peak_subtalar_angle_deg']} then, {before} now" in again.stdout
    )
    assert (tmp_path / "many-again" / "trials.csv").is_file()


def test_reproduce_without_a_ledger(place: Path, tmp_path: Path) -> None:
    many = tmp_path / "many"
    shutil.copytree(place / "many", many)
    (many / "ledger.sqlite").unlink()
    shutil.copy(place / "short.toml", many)
    # the study had --set brace.angle_scale=1.5, which its study.toml does not know
    outcome = call("reproduce", "many/manifest.json", cwd=tmp_path)
    refused(outcome, 2, "parameters.brace.angle_scale: 1.5 then", "--set brace.angle_scale=1.5")
    plain = tmp_path / "plain"
    assert (
        call(
            "study",
            str(place / "study.toml"),
            "--trials",
            "3",
            "--seed",
            "8",
            "--workers",
            "1",
            "--out",
            "plain",
            cwd=tmp_path,
        ).returncode
        == 0
    )
    (plain / "ledger.sqlite").unlink()
    shutil.copy(place / "short.toml", plain)
    again = call("reproduce", "plain/manifest.json", "--workers", "1", cwd=tmp_path)
    assert again.returncode == 0, again.stderr
    assert "identical: 3 trials" in again.stdout


BAD = [
    (["animate", "nowhere"], ["nowhere", "no such folder"]),
    (["animate", "run", "--out", "x.avi"], ["x.avi", "an animation ends in .webp"]),
    (["animate", *["run"] * 7, "--out", "x.webp"], ["7 landings: up to 6"]),
    (["animate", "many", "--trial", "77", "--out", "x.png"], ["has no trial 77"]),
    (["animate", "many", "--trial", "p200", "--out", "x.png"], ["percentile such as p95"]),
    (["export", "run", "-o", "x.xls"], ["format 'xls' is unknown"]),
    (["export", "run"], ["-o"]),
    (["reproduce", "nowhere.json"], ["nowhere.json", "no such file"]),
    (["reproduce", "run/summary.json"], ["not a study's manifest"]),
]


@pytest.mark.parametrize(("arguments", "words"), BAD, ids=lambda v: " ".join(v) if isinstance(v, list) else str(v))
def test_bad_input_is_one_line_and_exit_2(
    arguments: list[str],
    words: list[str],
    place: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(place)
    before = sorted(p.name for p in place.iterdir())
    assert _run(arguments, []) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    last = printed.err.strip().splitlines()[-1]
    assert last.startswith("error: ")
    assert all(word in last for word in words), last
    assert sorted(p.name for p in place.iterdir()) == before


def test_the_landings_of_a_comparison_are_one_trial() -> None:
    """The one that is in the middle without a brace, among those that every brace completed; a number is taken as it
    is, unless a brace failed there."""
    done, peak = ["completed"] * 4, [10.0, 31.0, 50.0, 29.0]
    none = pd.DataFrame({"trial": range(4), "status": done, "peak": peak})
    soft = none.assign(status=[*done[:3], "failed"], peak=[5.0, 2.0, 1.0, 4.0])
    tables = {"soft": soft, "none": none}
    assert choose_common_trial(tables, "peak", "p50", "c")[0] == 1
    assert choose_common_trial(tables, "peak", "worst", "c") == (2, "trial 2, largest peak without a brace")
    assert choose_common_trial(tables, "peak", "1", "c") == (1, "trial 1")
    assert choose_common_trial({"soft": soft}, "peak", "worst", "c") == (0, "trial 0, largest peak with soft")
    with pytest.raises(InputError, match="trial 3 was not completed with every brace"):
        choose_common_trial(tables, "peak", "3", "c")


def test_landings_of_a_comparison(place: Path, tmp_path: Path) -> None:
    bare = load_scenario("incline30").with_master(stop="5 ms")
    braced = load_scenario("incline30_brace").with_master(stop="5 ms")
    assert {land(bare, tmp_path / "none").status, land(braced, tmp_path / "soft").status} == {"completed"}
    entries = {name: {"folder": name, "status": "completed"} for name in ("none", "soft")} | {
        "bad": {"folder": "bad", "status": "failed"}
    }
    (tmp_path / "compare.json").write_text(json.dumps({"braces": entries}))
    runs = load_landings(tmp_path)
    assert [run.title for run in runs] == ["no brace", "soft"]
    assert animate(runs, tmp_path / "both.png") == 1
    with pytest.raises(InputError, match="one folder for each brace"):
        load_landing(tmp_path)
    (tmp_path / "compare.json").write_text("{}")
    with pytest.raises(InputError, match=r"compare\.json: lacks braces"):
        load_landings(tmp_path)
