"""Which figures folders allow, and when published figures may stand beside them. Folders are small and made by hand."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from sprain_cosim.errors import InputError
from sprain_cosim.figures import Difference, gallery
from sprain_cosim.figures.braces import brace_differences, threshold_doubts
from sprain_cosim.figures.selection import named_folders, palette_of, sample_of
from sprain_cosim.figures.style import SERIES, UNBRACED, Form, drawn_as
from sprain_cosim.folders.comparison import BraceSummary, ComparisonFolder, ComparisonSummary, MeanEstimate
from sprain_cosim.folders.read import read_folder, read_folders
from sprain_cosim.folders.study import StudyFolder

FILE = """scenario = "incline30_mixed"
[parameters]
"plant.initial_pose" = "published"
[marginals]
"plant.drop_height" = { lognormal = { mean = "0.30 m", sd = "0.05 m" } }
"plant.contact_dissipation" = { lognormal = { mean = "5 s/m", sd = "1 s/m" } }
[study]
method = "monte-carlo"
[published]
"5 % [deg]" = 23.2
"50 % [deg]" = 29.7
"""
PEAK, INVERSION = "peak_subtalar_angle_deg", "peak_inversion_from_neutral_deg"
FMUS = {"plant": "plant.fmu", "controller": "reflex_controller.fmu"}


def study(
    folder: Path,
    pose: str = "published",
    fmus: dict[str, str] | None = None,
    parameters: dict[str, Any] | None = None,
    **head: Any,
) -> Path:
    """A finished study of 30 trials."""
    folder.mkdir()
    rng = np.random.default_rng(1)
    table = pd.DataFrame({"trial": range(30), "status": "completed", "message": ""})
    table["plant.drop_height [m]"], table["plant.contact_dissipation [s/m]"] = (
        rng.normal(0.3, 0.05, 30),
        rng.normal(5, 1, 30),
    )
    table["peak_subtalar_angle_deg"] = 20 + 30 * table["plant.drop_height [m]"]
    table.to_csv(folder / "trials.csv", index=False)
    counts = {"n_requested": 30, "n_completed": 30, "n_failed": 0}
    (folder / "summary.json").write_text(
        json.dumps({"title": "S", "method": "monte-carlo", "initial_pose": pose, **counts, **head})
    )
    (folder / "study.toml").write_text(FILE)
    ran = {"plant.initial_pose": pose} | (parameters or {})
    devices = {name: {"file": f"/somewhere/{file}", "sha256": file} for name, file in (fmus or FMUS).items()}
    (folder / "manifest.json").write_text(json.dumps({"fmus": devices, "identity": {"parameters": ran}}))
    return folder


def names(*paths: Path) -> list[str]:
    return [drawn.name for drawn in gallery.draw(read_folders(paths))]


def test_published_figures_stand_only_beside_the_study_they_belong_to(tmp_path: Path) -> None:
    def published(path: Path) -> dict[float, float]:
        found = read_folder(path)
        assert isinstance(found, StudyFolder)
        return dict(sample_of("s", found).published)

    assert published(study(tmp_path / "same")) == {5.0: 23.2, 50.0: 29.7}
    assert published(study(tmp_path / "pose", pose="touching")) == {}
    assert published(study(tmp_path / "device", fmus={**FMUS, "brace": "my_brace.fmu"})) == {}
    assert published(study(tmp_path / "dropped", dropped=["brace.angle_scale"])) == {}
    other = study(tmp_path / "other")
    table = pd.read_csv(other / "trials.csv").drop(columns="plant.contact_dissipation [s/m]")
    table.to_csv(other / "trials.csv", index=False)
    assert published(other) == {}, "an input that the study varies was not varied"
    held = study(tmp_path / "held")
    pd.read_csv(held / "trials.csv").assign(**{"plant.contact_dissipation [s/m]": 5.0}).to_csv(
        held / "trials.csv", index=False
    )
    assert published(held) == {}, "a comparison set it to one value"


def test_a_result_has_one_colour_and_landings_without_a_brace_are_grey(tmp_path: Path) -> None:
    braced = {**FMUS, "brace": "brace_bushing.fmu"}
    folders = read_folders([study(tmp_path / "a", fmus=braced, title="A"), study(tmp_path / "b", title="B")])
    looks = palette_of(folders)
    assert looks["B"][0] == UNBRACED
    assert looks["A"][0] == SERIES[0]
    alone = read_folders([tmp_path / "b"])
    assert palette_of(alone)["B"][0] == SERIES[0], "grey is for what stands beside a brace"
    with drawn_as(Form(palette=looks)):
        lines = {d.name: d for d in gallery.draw(folders)}["cdf"].draw().axes[0].lines
    assert [line.get_color() for line in lines[:1]] == [SERIES[0]]
    assert UNBRACED in [line.get_color() for line in lines]


def test_poses_of_one_question_are_drawn_side_by_side(tmp_path: Path) -> None:
    one, two = study(tmp_path / "a"), study(tmp_path / "b", pose="touching")
    assert "poses" in names(one, two)
    assert "poses" not in names(one)
    assert "poses" not in names(one, study(tmp_path / "c", pose="touching", fmus={**FMUS, "brace": "my_brace.fmu"})), (
        "another device is another question"
    )
    titles = [name for name, _ in named_folders(read_folders([one, two]))]
    assert titles == ["published pose · S", "touching pose · S"]


def test_published_trials_are_matched_by_number_and_inputs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = study(tmp_path / "s", method="table")
    table = pd.read_csv(path / "trials.csv")
    records = pd.DataFrame({"trial": table["trial"], "drop_height_m": table["plant.drop_height [m]"]})
    records["contact_dissipation_s_m"] = table["plant.contact_dissipation [s/m]"]
    records = records.assign(
        coactivation=0.0,
        reflex_gain=0.0,
        brace_scale_bi=np.nan,
        peak_subtalar_deg=table["peak_subtalar_angle_deg"] + 0.25,
    )
    (tmp_path / "paper").mkdir()
    records.to_csv(tmp_path / "paper" / "study2_trials.csv", index=False)
    monkeypatch.delenv("SPRAIN_REFERENCE", raising=False)
    assert "published" not in names(path)
    monkeypatch.setenv("SPRAIN_REFERENCE", str(tmp_path))
    (drawn,) = (d for d in gallery.draw(read_folders([path])) if d.name == "published")
    np.testing.assert_allclose(drawn.draw().axes[1].lines[0].get_ydata(), -0.25)
    records.assign(drop_height_m=records["drop_height_m"] + 0.01).to_csv(
        tmp_path / "paper" / "study2_trials.csv", index=False
    )
    assert "published" not in names(path), "other inputs"
    records.assign(brace_scale_bi=0.5).to_csv(tmp_path / "paper" / "study2_trials.csv", index=False)
    assert "published" not in names(path), "the records had a brace"


def test_questions_are_drawn_where_they_are_asked(tmp_path: Path) -> None:
    """Those of the literature of one study alone, so that a comparison of many braces has no figure for each."""
    known = {"event": "above 35 ± 6 deg", "probability": 0.02, "ci_low": 0.01, "ci_high": 0.03}
    own = known | {"source": "own", "response": PEAK, "threshold_ci": [0.001, 0.1], "shapes": {"weibull": 0.03}}
    curve = {"threshold": [20, 30], "probability": [1.0, 0.0], "low": [0.9, 0.0], "high": [1.0, 0.1]}
    first = study(tmp_path / "a", questions={"peak_inversion_from_neutral_deg": known})
    second = study(tmp_path / "b", questions={PEAK: known, f"{PEAK} above": own}, curves={PEAK: curve})

    def drawn(*folders: Path) -> list[str]:
        return [d.name for d in gallery.draw(read_folders(list(folders))) if d.name.startswith("questions")]

    assert drawn(first) == ["questions"]
    assert drawn(first, second) == ["questions"]
    third = study(tmp_path / "c", questions={f"{PEAK} above": own})
    assert drawn(second, third) == ["questions_b", "questions_c"]


def comparison(folder: Path, without_none: bool = False) -> ComparisonFolder:
    """Two braces over the same 30 landings; their probabilities under three laws of the threshold."""
    members, braces = {}, {}
    for k, name in enumerate(("none", "soft", "stiff")):
        laws = {"normal": 0.06 - 0.02 * k, "lognormal": 0.05 - 0.02 * k, "weibull": 0.08 - 0.025 * k}
        asked = {INVERSION: {"event": "above 35 ± 6 deg", "probability": laws["normal"], "shapes": laws}}
        found = read_folder(
            study(folder / name, fmus=FMUS if k == 0 else {**FMUS, "brace": f"{name}.fmu"}, questions=asked)
        )
        assert isinstance(found, StudyFolder)
        members[name] = found
        change = {PEAK: MeanEstimate(-5.0 * k, -5.0 * k - 1, -5.0 * k + 1, 30)}
        change["probability_of_injury"] = MeanEstimate(-0.02 * k, -0.02 * k - 0.01, -0.02 * k + 0.01, 30)
        failed = k == 0 and without_none
        status = "failed" if failed else "completed"
        braces[name] = BraceSummary(
            status=status, n_completed=30, difference_to_none={} if k == 0 or failed else change
        )
    pairs = {"stiff - soft": {PEAK: MeanEstimate(-5.0, -6.0, -4.0, 30)}}
    summary = ComparisonSummary(kind="study", method="monte-carlo", landings=30, braces=braces, pairs=pairs)
    return ComparisonFolder(folder, summary, members)


def test_the_forest_of_a_comparison(tmp_path: Path) -> None:
    """Threshold: the same law for both, so that its doubt cancels as far as both share it."""
    compared = comparison(tmp_path)
    panels, reference = brace_differences(compared)
    assert reference == "none"
    assert [p.quantity.partition(",")[0] for p in panels] == [
        "peak subtalar angle",
        "probability of inversion beyond 35 ± 6°",
    ]
    assert list(panels[0].rows) == ["soft", "stiff"]
    assert panels[0].rows["stiff"].sampling == (-11.0, -9.0)
    assert panels[0].rows["stiff"].threshold is None
    found = panels[1].rows["stiff"]
    assert (found.value, *(found.sampling or ())) == pytest.approx((-4.0, -5.0, -3.0))
    assert found.threshold == pytest.approx((-5.0, -4.0)), "lognormal and normal 4, Weibull 5 percent points"
    drawn = [d.name for d in gallery.draw([compared])]
    assert drawn[:2] == ["paired", "forest"]
    assert not [name for name in drawn if name.startswith("pairs")], "none for each of many braces"


def test_the_forest_of_single_landings_has_the_doubt_of_the_threshold(tmp_path: Path) -> None:
    """Their folders ask no questions; compare.json says what thresholds of other laws give."""
    compared = comparison(tmp_path)
    braces = {
        name: replace(brace, injury_shapes=compared.members[name].summary.questions[INVERSION].shapes)
        for name, brace in compared.summary.braces.items()
    }
    members = {
        name: replace(member, summary=replace(member.summary, questions={}))
        for name, member in compared.members.items()
    }
    summary = replace(compared.summary, kind="scenario", braces=braces)
    single = replace(compared, members=members, summary=summary)
    assert brace_differences(single)[0][1].rows["stiff"].threshold == pytest.approx((-5.0, -4.0))
    assert braces["stiff"].injury_doubt_against(braces["none"]) == pytest.approx((-0.05, -0.04))
    assert threshold_doubts(single) == threshold_doubts(compared) != {}


def test_the_forest_without_landings_without_a_brace(tmp_path: Path) -> None:
    panels, reference = brace_differences(comparison(tmp_path, without_none=True))
    assert reference == "soft"
    assert {p.quantity.partition(",")[0]: dict(p.rows) for p in panels} == {
        "peak subtalar angle": {"stiff": Difference(-5.0, (-6.0, -4.0))}
    }


def test_the_pairs_of_a_study_are_in_the_units_that_people_read(tmp_path: Path) -> None:
    path = study(tmp_path / "s")
    table = pd.read_csv(path / "trials.csv")
    table["plant.contact_modulus [Pa/m]"] = np.linspace(4e7, 6e7, 30)
    table["plant.held [m]"] = 1.0
    table.to_csv(path / "trials.csv", index=False)
    (drawn,) = (d for d in gallery.draw(read_folders([path])) if d.name == "pairs")
    names = [axis.get_xlabel().replace("\n", " ") for axis in drawn.draw().axes if axis.get_xlabel()]
    assert names[0] == "drop height [m]", "the largest rank correlation first"
    assert set(names[1:3]) == {"contact modulus [MPa/m]", "contact dissipation [s/m]"}
    assert names[3] == "peak subtalar angle [deg]"
    assert "The response and its inputs." in drawn.caption
    low, high = drawn.draw().axes[-1 - 4 + names.index("contact modulus [MPa/m]") + 1].get_xlim()
    assert 35 < low < 40 < 60 < high < 65


@pytest.mark.parametrize(
    ("only", "words"),
    [
        ("violin", r"--only violin: these folders allow no such figure, but questions, phase, torque_angle$"),
        ("pairs", r"but questions, .*; it needs a sampled study of which 4 landings completed"),
        ("forest", r"it needs a comparison of which a brace and"),
    ],
)
def test_figures_that_folders_do_not_allow_say_what_they_need(only: str, words: str, tmp_path: Path) -> None:
    asked = {PEAK: {"event": "above 35 ± 6 deg", "probability": 0.02}}
    path = study(tmp_path / "s", questions=asked)
    few = pd.read_csv(path / "trials.csv").head(1)
    few["peak_inversion_from_neutral_deg"], few["peak_jcs_inversion_velocity_deg_s"] = 20.0, 500.0
    few.to_csv(path / "trials.csv", index=False)
    with pytest.raises(InputError, match=words):
        gallery.write_figures(read_folders([path]), tmp_path, only=[only])
    few.assign(status="failed", peak_subtalar_angle_deg=np.nan).to_csv(path / "trials.csv", index=False)
    with pytest.raises(InputError, match="none of its 1 landings completed; nothing to draw"):
        gallery.write_figures(read_folders([path]), tmp_path)


def test_what_is_not_asked_for_is_not_drawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folders = read_folders([study(tmp_path / "s")])

    def never(*_: object) -> None:
        raise AssertionError("drawn")

    for other in ("pairs", "torque_angle"):
        monkeypatch.setattr(gallery.plots, other, never)
    written = gallery.write_figures(folders, tmp_path, ["png"], only=["cdf"])
    assert [path.name for path in written] == ["cdf.png", "captions.txt"]
    with pytest.raises(AssertionError, match="drawn"):
        gallery.write_figures(folders, tmp_path, ["png"], only=["torque_angle"])


def test_captions_say_what_is_drawn_and_no_more(tmp_path: Path) -> None:
    """Of a landing there is no interval; a figure of samples is not one of a grid beside them."""
    folders = read_folders([study(tmp_path / "a", title="A"), study(tmp_path / "b", title="B", method="grid")])
    written = gallery.write_figures(folders, tmp_path, ["svg"], only=["cdf", "torque_angle"])
    cdf, law = written[-1].read_text("utf-8").strip().split("\n\n")
    assert "A: n = 30 (monte-carlo)" in cdf
    assert "B:" not in cdf
    assert "95 % bounds of each share by itself" in cdf
    assert "95 %" not in law
