"""What commands leave is read back by one reader for each kind of folder; the previous version's folders too."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from sprain_cosim.errors import InputError
from sprain_cosim.figures import gallery
from sprain_cosim.folders.comparison import ComparisonFolder, MeanEstimate, read_comparison_summary
from sprain_cosim.folders.read import read_folder, read_folders
from sprain_cosim.folders.run import RunFolder, RunSummary, check_run_folder, coupling_note, read_run, write_run
from sprain_cosim.folders.study import StudyFile, StudyFolder, read_study
from sprain_cosim.records import FORMAT
from sprain_cosim.report.page import report_page
from sprain_cosim.study.ledger import Ledger

BEFORE = Path(__file__).parent.parent / "folders_0_1"  # folders of version 0.1.0, signals with fewer rows and columns
PEAK = "peak_subtalar_angle_deg"


def test_folders_of_the_previous_version_are_read() -> None:
    run, study, search, comparison = read_folders([BEFORE / n for n in ("run", "study", "search", "comparison")])
    assert isinstance(run, RunFolder)
    assert run.summary.metrics[PEAK] == json.loads((BEFORE / "run" / "summary.json").read_text())["metrics"][PEAK]
    assert run.result.scheme == run.summary.scheme
    assert isinstance(study, StudyFolder)
    assert (len(study.trials), len(study.done)) == (24, 24)
    assert study.manifest.fmus["brace"].sha256
    assert "plant.drop_height" in study.varied
    assert study.is_sample
    assert study.published_peak["50 % [deg]"] == 29.7
    assert isinstance(search, StudyFolder)
    assert not search.is_sample
    assert isinstance(comparison, ComparisonFolder)
    assert set(comparison.members) == {"none", "a", "b"}
    assert comparison.summary.braces["a"].difference_to_none[PEAK].value is not None
    text = report_page([run, study, search, comparison])
    assert "In 24 simulated landings" in text
    assert len({drawn.name for drawn in gallery.draw([run, study])}) > 5


@pytest.mark.parametrize(("kind", "file"), [("run", "summary.json"), ("comparison", "compare.json")])
def test_a_file_of_the_previous_version_gains_keys_and_loses_none(kind: str, file: str) -> None:
    before = json.loads((BEFORE / kind / file).read_text())
    found = read_run(BEFORE / kind).summary if kind == "run" else read_comparison_summary(BEFORE / kind)
    coupling = {"held": {}, "coupling_doubt_deg": None, "coupling_converged": None}
    more = {**coupling, "isolation": "", "granted": {}, "fmu_messages": {}} if kind == "run" else {}
    added = {"format": FORMAT, **more}
    assert found.to_json() == before | added
    assert type(found).from_json(found.to_json(), "again") == found


def test_a_run_is_written_last_and_read_whole(tmp_path: Path) -> None:
    run = read_run(BEFORE / "run")
    target = tmp_path / "deep" / "run"
    write_run(target, run.result, b"picture", run.summary)
    (target / ".signals.0123abcd.partial.csv").write_text("left by a process that was killed")
    check_run_folder(target)
    write_run(target, run.result, b"picture", run.summary)
    assert sorted(p.name for p in target.iterdir()) == ["landing.png", "signals.csv", "summary.json"]
    again = read_run(target)
    assert again.summary == run.summary
    assert (again.result.values == run.result.values).all()
    (target / "letter.txt").write_text("")
    with pytest.raises(InputError, match=r"holds other files \(letter\.txt\)"):
        check_run_folder(target)


def test_folders_that_are_none_say_so(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="nowhere: no such folder"):
        read_run(tmp_path / "nowhere")
    (tmp_path / "a file").write_text("")
    for reader in (read_run, read_folder, Ledger.read):
        with pytest.raises(InputError, match="a file: is a file; name a folder"):
            reader(tmp_path / "a file")
        with pytest.raises(InputError, match="no such folder"):
            reader(tmp_path / ("x" * 300))
    (tmp_path / "my folder").mkdir()
    for reader in (read_run, read_folder, Ledger.read):
        with pytest.raises(InputError, match=r"`sprain-cosim .* --out '/.*/my folder'`"):
            reader(tmp_path / "my folder")
    shutil.copytree(BEFORE / "run", tmp_path / "run")
    content = json.loads((tmp_path / "run" / "summary.json").read_text())
    for changed, cause in (
        ({"format": FORMAT + 1}, r"summary\.json: has format 3"),
        ({"metrics": {PEAK: "high"}}, rf"summary\.json, metrics, {PEAK}: must be a number"),
    ):
        (tmp_path / "run" / "summary.json").write_text(json.dumps(content | changed))
        with pytest.raises(InputError, match=cause):
            read_folder(tmp_path / "run")
    del content["scheme"]
    (tmp_path / "run" / "summary.json").write_text(json.dumps(content))
    with pytest.raises(InputError, match=r"not a folder of `sprain-cosim run`: summary\.json lacks scheme"):
        read_folder(tmp_path / "run")


def test_a_comparison_names_only_folders_inside_it(tmp_path: Path) -> None:
    shutil.copytree(BEFORE / "comparison", tmp_path / "c")
    content = json.loads((tmp_path / "c" / "compare.json").read_text())
    content["braces"]["a"]["folder"] = "../secret"
    (tmp_path / "c" / "compare.json").write_text(json.dumps(content))
    with pytest.raises(InputError, match=r"names '\.\./secret', which is no folder beside it"):
        read_folder(tmp_path / "c")


def test_a_study_file_that_is_odd_or_absent_is_read_as_far_as_it_goes(tmp_path: Path) -> None:
    assert StudyFile.read(tmp_path / "study.toml") == StudyFile()
    (tmp_path / "study.toml").write_text('scenario = 5\nmarginals = 1\n[study]\nresponses = "x"\n[grid]\na = [1]\n')
    assert StudyFile.read(tmp_path / "study.toml") == StudyFile("5", grid={"a": [1]})
    shutil.copytree(BEFORE / "study", tmp_path / "s")
    (tmp_path / "s" / "manifest.json").unlink()
    assert read_study(tmp_path / "s").manifest.versions == {}


def test_the_note_below_a_figure_names_pose_and_coupling() -> None:
    summary = RunSummary(
        status="completed",
        message="",
        title="t",
        scheme="jacobi",
        initial_pose="touching",
        communication_step_s=5e-4,
    )
    assert coupling_note([summary, summary]) == "Initial pose: touching; jacobi coupling every 0.5 ms."


def test_half_the_width_of_an_interval() -> None:
    assert MeanEstimate(1.0, 0.5, 2.0, 4).half_width == 0.75
    assert MeanEstimate(1.0).half_width is None
