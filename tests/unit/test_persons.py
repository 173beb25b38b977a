"""Which persons a brace works for, and whether the person or the posture matters more: on rows of known laws."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from sprain_cosim.brace.persons import persons_listing, persons_of
from sprain_cosim.figures.persons import persons_figure
from sprain_cosim.folders.comparison import INJURY, INVERSION, BraceSummary, ComparisonSummary
from sprain_cosim.literature import INJURY_INVERSION
from sprain_cosim.report.blocks import Cell, PageTable
from sprain_cosim.report.persons import groups_table, persons_sentence, persons_tables
from sprain_cosim.study.groups import group_of_input, groups_listing, input_groups
from sprain_cosim.study.summary import VarianceShare
from sprain_cosim.units import percentage_ends
from sprain_cosim.uq import statistics
from sprain_cosim.uq.distributions import Normal
from sprain_cosim.uq.exceedance import of_shapes
from sprain_cosim.uq.groups import group_share

HEADINGS = ["subject.sex", "subject.stature [m]", "subject.mass [kg]", "plant.subtalar_angle_at_contact [rad]"]
SHOWN_INPUTS = ("subject.mass", "plant.subtalar_angle_at_contact")
N = 400


def landings(brace: float) -> pd.DataFrame:
    """Inversion grows with the mass alone, by `brace` deg/kg, and a little with the posture."""
    rng = np.random.default_rng(5)
    sex = rng.integers(0, 2, N).astype(float)
    stature = 1.63 + 0.13 * sex + 0.06 * rng.standard_normal(N)
    mass = 65 + 20 * sex + 10 * rng.standard_normal(N)
    posture = 0.09 * rng.standard_normal(N)
    peak = 10 + brace * (mass - 75) + 10 * posture
    columns = dict(zip(HEADINGS, (sex, stature, mass, posture), strict=True))
    return pd.DataFrame({"trial": np.arange(N), **columns, INVERSION: peak, INJURY: peak / 100}).set_index("trial")


@pytest.fixture(scope="module")
def summary() -> ComparisonSummary:
    landed = {"none": landings(0.3), "soft": landings(0.1)}
    persons = persons_of(landed, HEADINGS, (INVERSION, INJURY), INVERSION)
    braces = {name: BraceSummary(status="completed", n_completed=N) for name in landed}
    return ComparisonSummary(kind="study", source="x", title="x", landings=N, braces=braces, persons=persons)


def test_bands_show_for_whom_a_brace_works(summary: ComparisonSummary) -> None:
    persons = summary.persons
    assert persons is not None
    assert list(persons.bands) == ["subject.stature", "subject.mass"]
    bands = persons.bands["subject.mass"]
    assert [band.n for band in bands] == [N // 5] * 5
    means = [band.metrics["none"][INVERSION].value or 0.0 for band in bands]
    rows = landings(0.3)
    lightest = rows.nsmallest(N // 5, "subject.mass [kg]")
    assert means == sorted(means)
    assert means[0] == pytest.approx(lightest[INVERSION].mean(), rel=1e-12)
    assert bands[0].low == rows["subject.mass [kg]"].min()
    assert all(band.mean is not None and band.low < band.mean < band.high for band in bands)
    assert bands[0].metrics["none"][INVERSION].half_width is not None
    found = bands[0].metrics["none"][INJURY]
    asked = statistics.exceedance(lightest[INVERSION], Normal(*INJURY_INVERSION))
    assert (found.value, found.ci_low, found.ci_high) == (asked.value, asked.low, asked.high)


def test_the_worst_tenth_are_the_heavy(summary: ComparisonSummary) -> None:
    assert summary.persons is not None
    worst = summary.persons.worst["none"]
    rows = landings(0.3).sort_values(INVERSION, ascending=False)
    assert (worst.n, worst.above) == (40, rows[INVERSION].iloc[39])
    assert next(iter(worst.inputs)) == "subject.mass"
    mass = worst.inputs["subject.mass"]
    assert mass.worst == pytest.approx(rows["subject.mass [kg]"].iloc[:40].mean())
    assert (mass.shift.ci_low or 0) > 1.0
    text = "\n".join(persons_listing(summary.persons, INVERSION, "peak inversion [deg]", 1.0))
    assert "worst tenth with none (peak inversion [deg] from" in text
    assert "mass +" in text


def test_a_summary_with_persons_travels_and_is_shown(summary: ComparisonSummary) -> None:
    assert ComparisonSummary.from_json(summary.to_json(), "x").persons == summary.persons
    assert summary.persons is not None
    assert len(persons_figure(summary).axes) == 4
    tables = persons_tables(summary.persons)
    assert len(tables) == 7
    bands, worst = (block for block in tables[:4] if isinstance(block, PageTable))
    assert bands.heads[2] == "no brace: P(injury) [%]"
    mass, posture = (next(row for row in worst.rows if getattr(row[0], "name", "") == n) for n in SHOWN_INPUTS)
    assert [str(c) for c in mass[1:4]] == ["kg", "100", "72"]
    assert str(posture[1]) == "deg"
    said = persons_sentence(summary.persons, "none")
    assert said.startswith(" With none that probability depends on the body mass: ")
    assert persons_sentence(summary.persons, "absent") == persons_sentence(None, "none") == ""


def test_the_figure_draws_the_intervals_of_the_table(summary: ComparisonSummary) -> None:
    """Those of a probability are not even about it."""
    assert summary.persons is not None
    right = persons_figure(summary).axes[3]
    for bars, brace in zip(right.containers, ("none", "soft"), strict=True):
        found = [band.metrics[brace][INJURY] for band in summary.persons.bands["subject.mass"]]
        drawn = [segment[:, 1] for segment in bars.lines[2][0].get_segments()]
        np.testing.assert_allclose(drawn, [[100 * (e.ci_low or 0), 100 * (e.ci_high or 0)] for e in found])
    assert found[0].value is not None and found[0].ci_high - found[0].value != found[0].value - found[0].ci_low


def test_the_doubt_of_the_threshold_stands_beside_every_probability(summary: ComparisonSummary) -> None:
    assert summary.persons is not None
    heaviest = landings(0.3).nlargest(N // 5, "subject.mass [kg]")[INVERSION].to_numpy()
    shapes = summary.persons.bands["subject.mass"][-1].injury_shapes["none"]
    assert shapes == pytest.approx(of_shapes(heaviest, Normal(*INJURY_INVERSION)), rel=1e-12)
    (ends,) = percentage_ends(min(shapes.values()), max(shapes.values()))
    table = next(block for block in persons_tables(summary.persons) if isinstance(block, PageTable))
    cell = table.rows[-1][2]
    assert isinstance(cell, Cell)
    assert cell.notes[1] == f"threshold's shape {ends}"
    assert f"; threshold's shape {ends} %)" in persons_sentence(summary.persons, "none")
    pale = [c for c in persons_figure(summary).axes[3].collections if c.get_alpha() is not None]
    assert len(pale) == 2 * 5
    worst = summary.persons.worst["none"]
    tenth = landings(0.3).nlargest(40, INVERSION)[INVERSION].to_numpy()
    assert worst.injury_shapes == pytest.approx(of_shapes(tenth, Normal(*INJURY_INVERSION)), rel=1e-12)


def test_persons_of_one_measure_stay_together() -> None:
    """Three persons in 120 landings each, and one in few: no part begins within a person."""
    rows = landings(0.3).iloc[:370].copy()
    rows["subject.stature [m]"] = np.repeat([1.60, 1.70, 1.80, 1.90], [120, 120, 120, 10])
    persons = persons_of({"none": rows}, HEADINGS, (INVERSION,), INVERSION)
    assert persons is not None
    assert [(b.low, b.high, b.n) for b in persons.bands["subject.stature"]] == [
        (1.60, 1.60, 120),
        (1.70, 1.70, 120),
        (1.80, 1.90, 130),
    ]
    rows["subject.stature [m]"] = np.where(np.arange(370) < 5, 1.60, 1.70)
    persons = persons_of({"none": rows}, HEADINGS, (INVERSION,), INVERSION)
    assert persons is not None
    assert list(persons.bands) == ["subject.mass"]


def test_shifts_of_few_landings_are_known_as_badly_as_they_are() -> None:
    """Of 40 landings four are the worst: inputs without effect shift by what chance gives, and the intervals say so."""
    rng = np.random.default_rng(3)
    names = [f"plant.x{k}" for k in range(2000)]
    rows = pd.DataFrame(rng.standard_normal((40, len(names) + 1)), columns=[*names, INVERSION])
    rows["subject.stature [m]"] = 1.6 + 0.1 * rng.standard_normal(40)
    persons = persons_of({"none": rows}, [*names, "subject.stature [m]"], (INVERSION,), INVERSION)
    assert persons is not None
    found = [persons.worst["none"].inputs[name].shift for name in names]
    held = np.mean([(e.ci_low or 0.0) < 0.0 < (e.ci_high or 0.0) for e in found])
    assert 0.93 < held < 0.97
    assert " ± " in persons_listing(persons, INVERSION, "peak", 1.0)[-1]


def test_landings_that_are_no_random_sample_have_no_intervals() -> None:
    persons = persons_of({"none": landings(0.3)}, HEADINGS, (INVERSION,), INVERSION, random=False)
    assert persons is not None
    assert persons.bands["subject.mass"][0].metrics["none"][INVERSION].ci_low is None
    assert persons.worst["none"].inputs["subject.mass"].shift.ci_high is None


def test_landings_of_one_person_say_nothing_about_persons() -> None:
    rows = {"none": landings(0.3)}
    assert persons_of(rows, HEADINGS[3:], (INVERSION,), INVERSION) is None
    assert persons_of({"none": rows["none"].iloc[:30]}, HEADINGS, (INVERSION,), INVERSION) is None


def test_shares_of_groups_are_those_of_the_closed_form() -> None:
    """y = 2 x1 + x2² + x3 + x1 x3 / 2 with x1 and x2 of correlation 0.6: 6, 1 and 0.25 of 7.25."""
    rng = np.random.default_rng(11)
    z = rng.standard_normal((1000, 3))
    x1, x2, x3 = z[:, 0], 0.6 * z[:, 0] + 0.8 * z[:, 1], z[:, 2]
    y = 2 * x1 + x2**2 + x3 + 0.5 * x1 * x3
    for columns, expected in (((x1, x2), 6 / 7.25), ((x3,), 1 / 7.25)):
        share = group_share(np.column_stack(columns), y)
        assert share.low < expected < share.high
        assert share.high - share.low < 0.2
    assert abs(group_share(rng.standard_normal((1000, 2)), y).value) < 0.02
    assert np.isnan(group_share(np.ones((1000, 1)), y).value)


def test_person_and_posture_are_told_apart() -> None:
    rows = landings(0.3)
    values = {INVERSION: rows[INVERSION].to_numpy()}
    groups = input_groups(HEADINGS, rows, values, [INVERSION])
    assert groups is not None
    shares = groups[INVERSION]
    assert list(shares) == ["person", "posture"]
    mass, posture = rows["subject.mass [kg]"].std() * 0.3, rows[HEADINGS[3]].std() * 10
    assert shares["person"].value == pytest.approx(mass**2 / (mass**2 + posture**2), abs=0.05)
    assert "person" in groups_listing(INVERSION, shares)[2]
    twice = groups_listing(INVERSION, {"person": VarianceShare(0.8), "posture": VarianceShare(0.35)})
    assert twice[-1].split() == ["twice:", "groups", "are", "correlated", "15", "%"]
    assert len(groups_table({"study": (INVERSION, shares)})) == 2
    table, _ = groups_table({"soft": (INVERSION, shares), "none": (INVERSION, {}), "stiff": (INVERSION, shares)})
    assert isinstance(table, PageTable)
    assert table.heads == ["", "soft", "stiff"], "whose shares they are"
    assert groups_table({"none": (INVERSION, {})}) == []
    assert input_groups(HEADINGS[3:], rows, values, [INVERSION]) is None
    assert group_of_input("plant.contact_modulus") == "fall and ground"
    assert group_of_input("controller.reflex_gain") == "control"
