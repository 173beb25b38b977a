"""plot, and the folders that neither plot nor report can use."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from sprain_cosim.errors import InputError
from sprain_cosim.figures.gallery import write_figures
from sprain_cosim.folders.read import read_folders

from .test_run import call, refused


def test_figures_of_all_kinds_together(results: Path, tmp_path: Path) -> None:
    before = {p: p.stat().st_mtime_ns for p in results.rglob("*") if p.is_file()}
    outcome = call("plot", *(str(results / n) for n in ("study", "touching", "amv", "run")), "--out", str(tmp_path))
    assert outcome.returncode == 0, outcome.stderr
    names = {p.stem for p in (tmp_path / "figures").iterdir() if p.name != "captions.txt"}
    assert {
        "landing",
        "moment_angle",
        "cdf",
        "percentiles",
        "poses",
        "amv",
        "tornado_study",
        "tornado_touching",
        "phase",
        "sharing",
        "torque_angle",
    } <= names
    assert all((tmp_path / "figures" / f"{n}.{kind}").stat().st_size > 3000 for n in names for kind in ("png", "svg"))
    assert {p: p.stat().st_mtime_ns for p in results.rglob("*") if p.is_file()} == before
    shown = (tmp_path / "figures" / "amv.svg").read_text("utf-8")
    assert "Monte Carlo, 24 landings" in shown
    assert "Initial pose: published" in shown


def test_figures_go_into_the_first_folder(results: Path) -> None:
    assert call("plot", str(results / "amv")).returncode == 0
    assert (results / "amv" / "figures" / "amv.svg").is_file()


def test_figures_for_a_journal(results: Path, tmp_path: Path) -> None:
    """Kinds, one figure of all, another response, what stands below; wrong names in one line."""
    options = (
        "--format",
        "pdf,tiff",
        "--width",
        "double",
        "--panels",
        "--only",
        "cdf",
        "--response",
        "peak_talocrural_angle_deg",
    )
    outcome = call("plot", str(results / "study"), *options, "--out", str(tmp_path))
    assert outcome.returncode == 0, outcome.stderr
    assert {p.name for p in (tmp_path / "figures").iterdir()} == {"cdf.pdf", "cdf.tiff", "captions.txt"}
    caption = (tmp_path / "figures" / "captions.txt").read_text("utf-8")
    for words in ("cdf. Distribution.", "n = 24 (monte-carlo)", "95 %", "Initial pose: published", "sprain-cosim 0."):
        assert words in caption
    folders = read_folders([results / "study"])
    with pytest.raises(InputError, match="--only violin: these folders allow no such figure, but cdf, "):
        write_figures(folders, tmp_path / "x", only=["violin"])
    with pytest.raises(InputError, match=r"--response peak_talocrural_angle: .*did you mean peak_talocrural_angle_deg"):
        write_figures(folders, tmp_path / "x", response="peak_talocrural_angle")
    with pytest.raises(InputError, match=r"--response : these folders have no such response"):
        write_figures(folders, tmp_path / "x", response="")


def spoil(folder: Path, kind: str) -> list[str]:
    """A folder that is not what it should be, and words of the answer."""
    folder.mkdir()
    if kind == "empty":
        return ["holds no run, study or comparison"]
    if kind == "unfinished":
        (folder / "ledger.sqlite").write_bytes(b"")
        return ["not finished", "--resume"]
    if kind == "not JSON":
        (folder / "trials.csv").write_text("trial,status\n")
        (folder / "summary.json").write_text("{")
        return ["summary.json", "cannot be read"]
    if kind == "a list":
        (folder / "trials.csv").write_text("trial,status\n")
        (folder / "summary.json").write_text("[]")
        return ["one JSON object"]
    if kind == "something else":
        (folder / "trials.csv").write_text("patient,age\n")
        (folder / "summary.json").write_text("{}")
        return ["not a folder of `sprain-cosim study`"]
    if kind == "a run without signals":
        (folder / "summary.json").write_text(
            json.dumps({"status": "completed", "message": "", "scheme": "jacobi", "title": "x"})
        )
        return ["signals.csv", "no such file"]
    if kind == "broken signals":
        (folder / "summary.json").write_text(
            json.dumps({"status": "completed", "message": "", "scheme": "jacobi", "title": "x"})
        )
        (folder / "signals.csv").write_text("time [s],plant.a\n0,x\n")
        return ["signals.csv", "cannot be read"]
    (folder / "compare.json").write_text('{"braces": {"soft": {}}}')
    return ["none of their folders"]


@pytest.mark.parametrize("command", ["plot", "report"])
@pytest.mark.parametrize(
    "kind",
    [
        "empty",
        "unfinished",
        "not JSON",
        "a list",
        "something else",
        "a run without signals",
        "broken signals",
        "comparison without members",
    ],
)
def test_wrong_folders_end_in_one_line(command: str, kind: str, tmp_path: Path) -> None:
    words = spoil(tmp_path / "x", kind)
    refused(call(command, str(tmp_path / "x")), 2, *words)
    assert not (tmp_path / "x" / "figures").exists()
    assert not (tmp_path / "x" / "report.html").exists()


@pytest.mark.parametrize("command", ["plot", "report"])
def test_missing_folders_and_files_in_their_place(command: str, tmp_path: Path) -> None:
    refused(call(command, str(tmp_path / "nowhere")), 2, "no such folder")
    (tmp_path / "file").write_text("x")
    refused(call(command, str(tmp_path / "file")), 2, "is a file")
    refused(call(command), 2, "Missing argument")


@pytest.mark.skipif(os.geteuid() == 0, reason="root writes everywhere")
def test_a_folder_that_cannot_be_written(results: Path, tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    refused(call("plot", str(results / "run"), "--out", str(tmp_path / "x")), 4, "cannot be written")
