"""Design questions as studies: asked in words or in a file, run, resumed, read back. The plant costs nothing: its peak
of inversion is PEAK (height + lean), which meets a threshold that varies."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from pathlib import Path

import pytest

import sprain_cosim as sc
from sprain_cosim.errors import InputError
from sprain_cosim.folders.read import read_folders
from sprain_cosim.folders.study import StudyFolder
from sprain_cosim.report.blocks import PageTable
from sprain_cosim.report.design import design_blocks, design_verdict
from sprain_cosim.report.page import report_page
from sprain_cosim.study.goal import parse_goal
from sprain_cosim.study.listing import design_listing, study_listing
from sprain_cosim.study.study import Study
from sprain_cosim.study.summary import Comfort, read_summary
from tests.light import plant, study_file

PEAK = 17.0 / 4.0  # rad/m
GOAL = "P(peak_inversion_from_neutral_deg > 60 +- 5 deg, n = 12) <= 5 %"
DESIGN = """
scenario = "light.toml"
title = "A light plant"
[marginals]
"plant.lean" = {{ normal = {{ mean = "0 m", sd = "0.01 m" }} }}
[study]
trials = 100
[design]
goal = "{goal}"
vary = {{ "plant.height" = [{vary}] }}
"""


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("light")
    study_file(folder)
    plant(folder / "light.fmu", lean=True)
    (folder / "design.toml").write_text(DESIGN.format(goal=GOAL, vary='"0.1 m", "50 cm"'))
    return folder


@pytest.fixture(scope="module")
def found(place: Path) -> Path:
    study = sc.load_study(place / "design.toml")
    study.run(workers=2, out=place / "runs", trajectories=0)
    return place / "runs"


def truth() -> float:
    """The height [m] at which the peak exceeds the threshold in 5 %: both are normal."""
    scale = math.degrees(PEAK)
    return (60.0 - 1.6448536 * math.hypot(5.0, scale * 0.01)) / scale


def test_the_largest_value_its_doubts_and_its_keys(found: Path) -> None:
    design = read_summary(found).design
    assert design is not None
    (point,) = design.points
    assert (design.find, point.status, design.landings, design.failed) == ("largest", "met", 100, 0)
    assert point.value == pytest.approx(truth(), rel=0.02)
    content = json.loads((found / "summary.json").read_text())["design"]
    for key in ("value", "ci_low", "ci_high", "value_95", "probability", "landings"):
        assert key in content
    assert content["probability"]["value"] == pytest.approx(0.05, rel=0.05)
    low, high = content["probability"]["threshold_ci"]
    assert low < 0.03 and high > 0.08 and content["probability"]["sampling_ci"][1] < high
    assert content["comfort"] == []  # no brace is varied


def test_the_listing_says_what_was_asked_and_found(place: Path, found: Path) -> None:
    text = study_listing(sc.load_study(place / "design.toml"), read_summary(found))
    assert "P(peak_inversion_from_neutral_deg above 60 ± 5 deg, n = 12) <= 5 %" in text
    assert "largest plant.height [m]" in text and "holds with 95 % confidence" in text
    assert "threshold, n = 12" in text and "from 48 specimens" in text


@pytest.mark.parametrize(
    ("status", "value_95", "sampled", "verdict", "words"),
    [
        ("met", 0.2, (0.045, 0.055), "met", "met with 95 % confidence at 0.2 m"),
        ("met", None, (0.045, 0.055), "undecided", "open whether it holds at 0.2"),
        ("everywhere", None, (0.03, 0.055), "undecided", "open whether it holds at 0.2"),
        ("nowhere", None, (0.049, 0.08), "undecided", "open whether it holds at 0.2"),
        ("nowhere", None, (0.051, 0.08), "not met", "not met by any value"),
    ],
)
def test_the_goal_is_met_not_met_or_undecided_wherever_it_is_said(
    found: Path, status: str, value_95: float | None, sampled: tuple[float, float], verdict: str, words: str
) -> None:
    design = read_summary(found).design
    assert design is not None
    (point,) = design.points
    said = replace(point.probability, value=sum(sampled) / 2, sampling_ci=sampled)
    one = replace(design, points=(replace(point, status=status, value_95=value_95, probability=said, comfort=()),))
    assert one.to_json()["verdict"] == one.to_json()["points"][0]["verdict"] == verdict
    assert words in "\n".join(design_listing(one)) and words in dict(one.rows())["largest plant.height"]
    (folder,) = read_folders([found])
    assert isinstance(folder, StudyFolder)
    sentence = str(design_verdict(folder, one, "it").text)
    assert ("is open" in sentence) == (verdict == "undecided")
    assert ("No value from" in sentence) == (verdict == "not met")
    best = "does not meet" if status == "nowhere" else "meets"
    assert (f"by the best estimate, which {best} the goal" in one.doubt) == (verdict == "undecided") == bool(one.doubt)


def test_one_value_holds_with_confidence_wherever_it_stands(found: Path) -> None:
    """Rounded to the safe side above, it was rounded to the nearest beside its resistance."""
    design = read_summary(found).design
    assert design is not None
    (point,) = design.points
    held = (Comfort("value_95", 0.20009, {"supination_10deg": 1.0}),)
    one = replace(design, find="least", points=(replace(point, value_95=0.20009, comfort=held),))
    assert [line.split()[-1] for line in design_listing(one) if line.lstrip().startswith("plant.height")] == ["0.2001"]
    (table, _) = design_blocks(
        replace(one, points=(replace(one.points[0], value_95=1.1703, comfort=(replace(held[0], value=1.1703),)),))
    )
    assert isinstance(table, PageTable)
    assert [row[0] for row in table.rows if "95 % sure, " in str(row[0])] == [
        "resists 5 / 10° at the value that is 95 % sure, 1.171 m [N·m]"
    ]


def test_what_the_polynomial_says_stands_beside_what_the_fresh_landings_say(found: Path) -> None:
    design = read_summary(found).design
    assert design is not None
    (point,) = design.points
    assert point.surface is not None and point.surface != point.probability.value == pytest.approx(0.05, abs=1e-12)
    text = "\n".join(design_listing(design))
    assert re.search(
        rf"P at plant.height = {point.value:.4g} +0.05\n  by the polynomial alone +{point.surface:.3g}\n", text
    )


def test_resumed_it_asks_for_the_same_points_and_runs_none(place: Path, found: Path) -> None:
    (found / "summary.json").unlink()
    before = (found / "timing.csv").read_bytes()
    again = sc.load_study(place / "design.toml").run(workers=1, out=found, resume=True, trajectories=0)
    assert (found / "timing.csv").read_bytes() == before
    assert again.summary.design is not None and again.summary.design.points[0].status == "met"
    with pytest.raises(InputError, match="holds another study"):
        sc.load_study(place / "design.toml").run(workers=1, out=found, resume=True, seed=9)


def test_words_and_file_ask_the_same(place: Path) -> None:
    plain = place / "plain.toml"
    plain.write_text((place / "design.toml").read_text().partition("[design]")[0])
    asked = sc.load_study(plain).asking(GOAL, ["plant.height=0.1..0.5 m"], landings=100)
    written = sc.load_study(place / "design.toml")
    assert asked.digest == written.digest
    other = written.asking("P(peak_inversion_from_neutral_deg > 50 deg) <= 1 %")
    assert other.vary == written.vary and other.trials == 100 and other.goal != written.goal


def test_figure_and_report_of_a_design(found: Path) -> None:
    page = report_page(read_folders([found]))
    assert "Largest value: A light plant" in page  # the figure
    words = re.sub(r"<[^>]*>", "", page)
    assert (
        "The largest is 0.208" in words and "the probability of peak inversion from neutral above 60 ± 5 deg" in words
    )
    assert "as far as the 12 specimens behind the threshold know it" in words
    assert "searched from 0.10 to 0.50 m" in words


@pytest.mark.parametrize(
    ("goal", "text"),
    [
        ("P(peak_inversion_from_neutral_deg > 35) <= 2 %", "needs a unit"),
        ("P(peak_inversion_from_neutral_deg > 35 +- 6 deg, n = 2) <= 2 %", "at least 3 specimens"),
        ("P(peak_inversion > 35 deg) <= 2 %", "no such metric"),
        ("P(peak_inversion_from_neutral_deg > 35 deg) >= 2 %", "from above"),
        ("P(peak_inversion_from_neutral_deg > 35 deg) <= 0 %", "between 0 and 100 %"),
        ("P(peak_inversion_from_neutral_deg > 35 deg) <= 2 deg", "dimension"),
        ("P(peak_inversion_from_neutral_deg > 35 deg)", "must read"),
    ],
)
def test_goals_that_cannot_be_asked(goal: str, text: str) -> None:
    with pytest.raises(InputError, match=text):
        parse_goal(goal)


@pytest.mark.parametrize(
    ("vary", "text"),
    [
        ("plant.heigth=0.1..0.5 m", "did you mean height"),
        ("plant.height=0.5..0.1 m", "must rise"),
        ("plant.height=0.1..0.5", "needs a unit"),
        ("plant.height=0.5 m", "LOW..HIGH"),
        ("plant.inversion_angle=0..1 rad", "not a parameter"),
    ],
)
def test_ranges_that_cannot_be_searched(place: Path, vary: str, text: str) -> None:
    with pytest.raises(InputError, match=text):
        sc.load_study(place / "design.toml").asking(None, [vary])


def test_what_a_study_lacks_is_said_before_anything_runs(place: Path, tmp_path: Path) -> None:
    study: Study = sc.load_study(place / "design.toml")

    def refused(asked: Study, text: str) -> None:
        with pytest.raises(InputError, match=text):
            asked.run(out=tmp_path / "none")
        assert not (tmp_path / "none").exists()

    refused(study.override("plant.height", "0.3 m"), "is fixed by --set")
    refused(study.override("plant.lean", "0 m"), "nothing is uncertain")
    refused(study.asking(None, landings=60), "at least 100")
    with pytest.raises(InputError, match="goes with method design alone"):
        study.run(method="monte-carlo")
    with pytest.raises(InputError, match="needs \\[design\\]"):
        sc.load_study("study6").run(method="design")
    with pytest.raises(InputError, match="no \\[design\\]"):
        sc.load_study("study6").asking(GOAL)
    two = ["plant.height=0.1..0.5 m", "plant.height=0.1..0.4 m"]
    with pytest.raises(InputError, match="given twice"):
        study.asking(None, two)
