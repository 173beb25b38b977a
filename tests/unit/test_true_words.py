"""No number without the word that keeps a reader from misreading it; each fact has one source."""

from __future__ import annotations

import re
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

import sprain_cosim as sc
from sprain_cosim.figures.selection import named_folders
from sprain_cosim.folders.comparison import PEAK, ComparisonFolder, MeanEstimate
from sprain_cosim.folders.read import read_folder, read_folders
from sprain_cosim.folders.study import StudyFolder
from sprain_cosim.literature import DEPTH, DEPTH_TEXT, DEPTHS, INJURY_INVERSION
from sprain_cosim.metrics import THROWN, pose_artefacts
from sprain_cosim.report.blocks import Verdict
from sprain_cosim.report.page import report_page
from sprain_cosim.report.verdict import verdicts
from sprain_cosim.study.evaluation import TWO_THRESHOLDS, summarise
from sprain_cosim.study.questions import QUESTIONS

from .test_gallery import comparison

BEFORE = Path(__file__).parent.parent / "folders_0_1"
ROOT = Path(__file__).parent.parent.parent


def texts(*folders: Path) -> str:
    """The sentences of the verdict, without tags."""
    found = read_folders(folders)
    blocks = verdicts(found, named_folders(found))
    words = " ".join(f"{getattr(block, 'headline', '')} {getattr(block, 'text', '')}" for block in blocks)
    return re.sub(r"<[^>]+>", "", words)


def headline(compared: ComparisonFolder, **changes: Any) -> str:
    verdict = verdicts([replace(compared, summary=replace(compared.summary, **changes))], [])[0]
    assert isinstance(verdict, Verdict)
    return re.sub(r"<[^>]+>", "", str(verdict.headline))


def test_the_answer_is_read_in_ten_seconds(tmp_path: Path) -> None:
    """Which brace, by how much, how sure; 200 words a minute are 33 in ten seconds."""
    compared = comparison(tmp_path)
    assert (said := headline(compared)) == (
        "With stiff the ankle rolls least: 10.0° less than without a brace (95 % sure: 9.0 to 11.0°), 5.0° less than "
        "with soft, the next (4.0 to 6.0°)."
    )
    assert len(said.split()) <= 33
    turned = {"soft - stiff": {PEAK: MeanEstimate(5.0, 4.0, 6.0, 30)}}
    assert headline(compared, pairs=turned) == said, "a pair is the same either way round"


def test_no_brace_is_called_the_best_that_is_not_told_apart(tmp_path: Path) -> None:
    compared = comparison(tmp_path)
    alike = {"stiff - soft": {PEAK: MeanEstimate(-0.5, -1.5, 0.5, 30)}}
    said = headline(compared, pairs=alike)
    assert "not told apart from soft (−1.5 to 0.5°)" in said
    assert "least" not in said
    assert headline(compared, kind="scenario").endswith("One landing: no interval.")
    assert headline(compared, method="lhs").endswith("No interval: these landings are no random sample.")
    worse = {name: replace(brace, difference_to_none={PEAK: MeanEstimate(0.3, -0.2, 0.8, 30)} if k else {})
             for k, (name, brace) in enumerate(compared.summary.braces.items())}  # fmt: skip
    said = headline(compared, braces=worse)
    assert "0.3° more than without a brace (95 % sure: −0.2 to 0.8°), which is not told apart from none" in said
    assert "least" not in said


def test_a_search_is_held_against_the_sample_of_the_same_landings() -> None:
    """Its own check cannot know how far a level is off; the sample in the same report can."""
    said = texts(BEFORE / "study", BEFORE / "search")
    assert "it does not measure how far a level is off" in said
    assert re.search(r"Beside Study 6: .*: the 50 % level lies (inside|outside) the 95 % interval of ", said)
    assert "Beside" not in texts(BEFORE / "search"), "nothing to hold it against"
    study, search = (read_folder(BEFORE / kind) for kind in ("study", "search"))
    assert isinstance(study, StudyFolder)
    assert isinstance(search, StudyFolder)
    p50 = study.summary.responses[study.response].percentiles["50"]
    level = search.summary.amv.levels["50"]  # type: ignore[union-attr]
    inside = p50.ci_low <= level.value <= p50.ci_high  # type: ignore[operator]
    assert f"the 50 % level lies {'inside' if inside else 'outside'}" in said


def test_what_the_published_pose_alone_gives_is_marked(tmp_path: Path) -> None:
    assert pose_artefacts(["peak_vertical_grf_N", "peak_subtalar_angle_deg"], "published") == ["peak_vertical_grf_N"]
    assert pose_artefacts(THROWN, "touching") == []
    assert report_page(read_folders([BEFORE / "study"])).count("of the published pose, not of a landing") == len(THROWN)
    assert "of the published pose" not in report_page(read_folders([BEFORE / "run"])), "it ran in the touching pose"


def landings(study: sc.Study) -> pd.DataFrame:
    x = study.sample()
    table = pd.DataFrame({"trial": range(len(x)), "status": "completed", "message": ""})
    table[study.headings] = x
    for name in ("peak_subtalar_angle_deg", *QUESTIONS, "peak_vertical_grf_N"):
        table[name] = 20.0 + x[:, 0]
    return table


def test_notes_say_why_two_probabilities_differ_and_what_the_pose_throws() -> None:
    study = replace(sc.load_study("study6"), trials=40, method="table", numbers=())
    study = replace(study, table=replace(study, method="monte-carlo").sample())
    summary = summarise(study, landings(study), None)
    assert len(summary.questions) == 2
    assert TWO_THRESHOLDS in summary.notes
    assert any("peak_vertical_grf_N" in note for note in summary.notes)
    touching = study.override("plant.initial_pose", "touching")
    notes = summarise(touching, landings(touching), None).notes
    assert not any("peak_vertical_grf_N" in note for note in notes)


def test_the_landings_of_a_comparison_are_called_by_the_method_that_drew_them(tmp_path: Path) -> None:
    """Each brace runs the rows of one sample; they are no rows of a user's table."""
    shutil.copytree(BEFORE / "study", tmp_path / "c" / "none")
    for name in ("none", "soft"):
        shutil.copytree(BEFORE / "study", tmp_path / "c" / name, dirs_exist_ok=True)
        summary = tmp_path / "c" / name / "summary.json"
        summary.write_text(summary.read_text().replace('"method": "monte-carlo"', '"method": "table"'))
    entries = ", ".join(f'"{n}": {{"status": "completed", "folder": "{n}"}}' for n in ("none", "soft"))
    (tmp_path / "c" / "compare.json").write_text(
        f'{{"kind": "study", "method": "monte-carlo", "landings": 24, "braces": {{{entries}}}}}'
    )
    assert "24 landings each (monte-carlo)" in report_page(read_folders([tmp_path / "c"]))
    assert "24 landings (rows of a table)" in report_page(read_folders([tmp_path / "c" / "none"]))


@pytest.mark.parametrize("page", ["README.md", "docs/index.md", "docs/theory/contact.md", "fmus/plant/README.md"])
def test_pages_state_the_depth_of_the_published_pose_alike(page: str) -> None:
    text = " ".join((ROOT / page).read_text("utf-8").split())
    assert f"{DEPTH[0]} mm (level) to {DEPTH[1]} mm (30° slope)" in text
    assert re.search(rf"{DEPTHS[0]} (to|…|–) {DEPTHS[1]} mm over the postures of the studies", text)
    assert not re.search(r"28\s*(–|to)\s*35 mm", text)


def test_the_thresholds_have_one_source() -> None:
    """The package writes them from literature.py; only docstrings and the published figures repeat them."""
    assert DEPTH_TEXT in report_page(read_folders([BEFORE / "run"]))
    event, threshold = QUESTIONS["peak_inversion_from_neutral_deg"]
    assert (threshold.mean, threshold.sd) == INJURY_INVERSION
    assert event == "above 35 ± 6 deg"
    for path in (ROOT / "sprain_cosim").rglob("*.py"):
        if path.name != "literature.py":
            code = re.sub(r'""".*?"""|#[^\n]*', "", path.read_text("utf-8"), flags=re.DOTALL)
            assert not re.search(r"35(\.0)?\s*±\s*6|Normal\(35|2\.7 \.\.\. 4\.3", code), path


def test_a_brace_that_was_chosen_as_the_best_of_several_is_said_to_be(tmp_path: Path) -> None:
    """Its interval is that of any one brace; the choice by the same landings is not in it."""
    two = comparison(tmp_path)
    pairs = {f"stiff - {name}": two.summary.pairs["stiff - soft"] for name in ("soft", "firm")}
    braces = {**two.summary.braces, "firm": two.summary.braces["soft"]}
    three = replace(two, summary=replace(two.summary, braces=braces, pairs=pairs))
    said_of_two, said_of_three = (verdicts([folder], [])[0] for folder in (two, three))
    assert isinstance(said_of_two, Verdict) and isinstance(said_of_three, Verdict)
    chosen = "the best of 3 was chosen by these same landings"
    assert chosen in said_of_three.text and "was chosen" not in said_of_two.text
