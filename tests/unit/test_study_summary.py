"""A study's summary: the same file comes back, the previous version's is read, users' scripts keep their keys."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from sprain_cosim.errors import InputError
from sprain_cosim.study.summary import (
    FORMAT,
    Comfort,
    DesignCurve,
    DesignPoint,
    DesignSearch,
    DoubtedProbability,
    FormSearch,
    LevelSearch,
    StudySummary,
    Threshold,
    read_summary,
)

BEFORE = Path(__file__).parent.parent / "folders_0_1"  # folders of version 0.1.0, signals with fewer rows and columns
PEAK = "peak_subtalar_angle_deg"


@pytest.mark.parametrize("kind", ["study", "search", "form"])
def test_a_summary_of_the_previous_version_is_read_whole(kind: str) -> None:
    """Nothing but the format is added when it is written again."""
    before = json.loads((BEFORE / kind / "summary.json").read_text())
    summary = read_summary(BEFORE / kind)
    assert summary.to_json() == before | {"format": FORMAT, "isolation": "", "granted": {}, "fmu_messages": {}}
    assert StudySummary.from_json(summary.to_json(), "again") == summary


def test_the_fields_are_those_of_the_file() -> None:
    summary = read_summary(BEFORE / "study")
    before = json.loads((BEFORE / "study" / "summary.json").read_text())
    median = before["responses"][PEAK]["percentiles"]["50"]
    assert summary.responses[PEAK].percentiles["50"].ci_high == median["ci_high"]
    drop = summary.sensitivity[PEAK].inputs["plant.drop_height"]
    assert drop.ci.dsd_dsd == tuple(before["sensitivity"][PEAK]["plant.drop_height"]["ci"]["dsd_dsd"])
    assert summary.sensitivity[PEAK].linear is not None
    assert summary.trajectories is not None
    assert summary.trajectories.roles["p50"] == before["trajectories"]["p50"]
    assert summary.first_kept == 24
    assert summary.search is None
    assert isinstance(read_summary(BEFORE / "search").search, LevelSearch)
    form = read_summary(BEFORE / "form").search
    assert isinstance(form, FormSearch)
    assert form.threshold.mean is not None


def test_scripts_read_it_by_keys() -> None:
    summary = read_summary(BEFORE / "study")
    assert summary["responses"][PEAK]["percentiles"]["50"]["value"] == summary.responses[PEAK].percentiles["50"].value
    assert "amv" not in summary
    assert summary.get("amv", {}) == {}
    assert json.loads(json.dumps(dict(summary))) == summary.to_json()


def test_a_threshold_is_a_number_or_a_distribution() -> None:
    for threshold in (Threshold(35.0), Threshold(35.0, "Normal(mean=35, sd=6)")):
        assert Threshold.from_json(threshold.to_json(), "") == threshold
    assert Threshold(35.0).to_json() == 35.0


@pytest.mark.parametrize(
    ("changed", "cause"),
    [
        ({"format": 99}, "has format 99, this version reads up to"),
        ({"n_failed": "2"}, "n_failed: must be a whole number"),
        ({"responses": {PEAK: {"mean": 1.0, "sd": "wide"}}}, f"responses, {PEAK}, sd: must be a number"),
        ({"sensitivity": {PEAK: []}}, f"sensitivity, {PEAK}: must be an object"),
        ({"trajectories": 5}, "trajectories: must be an object"),
        ({"title": 5}, "title: must be a text"),
    ],
)
def test_an_edited_summary_is_named_to_the_key(tmp_path: Path, changed: dict[str, Any], cause: str) -> None:
    content = json.loads((BEFORE / "study" / "summary.json").read_text())
    (tmp_path / "summary.json").write_text(json.dumps(content | changed))
    with pytest.raises(InputError) as caught:
        read_summary(tmp_path)
    assert str(caught.value).startswith(f"{tmp_path / 'summary.json'}")
    assert cause in str(caught.value)


def test_a_value_that_holds_is_rounded_to_where_it_holds() -> None:
    """1.17022 is the least: 1.170 would not do."""
    found = DesignSearch("P(x above 1) <= 2 %", 0.02, "x", "brace.k", "", (0.2, 4.0), "least", (), 300, 0, 0.9, 0.1)
    most = replace(found, find="largest")
    for value, up, down in ((1.17022, 1.171, 1.170), (0.023491, 0.0235, 0.02349), (12345.0, 12350.0, 12340.0)):
        assert found.on_the_safe_side(value) == pytest.approx(up)
        assert most.on_the_safe_side(value) == pytest.approx(down)
    for value in (1.17, 0.5, -2.25, 0.0):
        assert found.on_the_safe_side(value) == pytest.approx(value)


def test_motions_against_which_a_device_does_nothing_stand_apart() -> None:
    held = (
        Comfort("value", 1.0, {"supination_5deg": 0.3, "supination_10deg": 0.9, "dorsiflexion_10deg": 0.001}),
        Comfort("low", 0.2, {"supination_10deg": 0.0, "dorsiflexion_10deg": 0.0, "plantarflexion_10deg": None}),
    )
    p, curve = DoubtedProbability(0.02), DesignCurve((), (), (), ())
    point = DesignPoint("met", 1.0, 0.9, 1.1, 1.1, p, curve, 100, 0, comfort=held)
    assert point.motions == (["supination", "plantarflexion"], ["dorsiflexion"])
