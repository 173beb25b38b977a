"""The studies of Yoder, Petrella & Farrokhi 2021 (doi 10.3389/fbioe.2021.765331) through study files, FMUs and
runner."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import sprain_cosim as sc
from sprain_cosim.uq import statistics
from sprain_cosim.uq.reliability import amv, amv_plus, hmv, mean_value
from sprain_cosim.validation.checks.paper import RECORDS, published_inputs
from tests.reference import needs_reference
from tools.reference import read

PEAK = "peak_subtalar_angle_deg"


def inputs(study: int, folder: Path) -> Path:
    """The published trials of a study as a table for --inputs."""
    published_inputs(read(f"paper/study{study}_trials.csv")).to_csv(folder / "inputs.csv", index=False)
    return folder / "inputs.csv"


@pytest.mark.parametrize("study", range(1, 7))
def test_marginals_are_those_of_table_1(study: int) -> None:
    """Mean and SD of every input of 2000 sampled trials within four standard errors of the published trials' own."""
    chosen = sc.load_study(f"study{study}")
    x = pd.DataFrame(chosen.sample(), columns=list(chosen.names))
    records = read(f"paper/study{study}_trials.csv") if needs_reference.args[0] is False else None
    if records is None:
        pytest.skip("reference numbers not found (set SPRAIN_REFERENCE)")
    for column, (heading, convert, _) in RECORDS.items():
        name = heading.partition(" [")[0]
        if name not in x:
            assert records[column].isna().all() or records[column].eq(0).all(), column
            continue
        published = convert(records[column]).to_numpy() * (math.pi / 180 if heading.endswith("[deg]") else 1.0)
        n, m = len(published), len(x)
        spread = published.std(ddof=1)
        assert abs(x[name].mean() - published.mean()) < 4 * spread * math.sqrt(1 / n + 1 / m), name
        assert abs(math.log(x[name].std(ddof=1) / spread)) < 4 * math.sqrt(0.5 / n + 0.5 / m), name


@needs_reference
@pytest.mark.long
@pytest.mark.parametrize("study", range(1, 7))
def test_published_inputs_give_the_published_statistics(study: int, tmp_path: Path) -> None:
    """Mean and SD within 0.05°, percentiles within 0.15°, every Pearson r within 0.02 of the records' own."""
    chosen = sc.load_study(f"study{study}").with_inputs(inputs(study, tmp_path))
    trials = chosen.run(workers=2).trials
    records = read(f"paper/study{study}_trials.csv")
    assert trials["trial"].tolist() == records["trial"].tolist()
    assert (trials["status"] == "completed").all()
    ours, theirs = trials[PEAK].to_numpy(), records["peak_subtalar_deg"].to_numpy()
    misses = {}
    for name, bound, of in (
        ("mean", 0.05, np.mean),
        ("sd", 0.05, np.std),
        *((f"{p} %", 0.15, lambda v, p=p: np.percentile(v, p)) for p in (5, 50, 95)),
    ):
        if abs(of(ours) - of(theirs)) > bound:
            misses[name] = of(ours) - of(theirs)
    for heading in chosen.headings:
        x = trials[heading]
        if x.std() > 0:
            gap = np.corrcoef(x, ours)[0, 1] - np.corrcoef(x, theirs)[0, 1]
            if abs(gap) > 0.02:
                misses[heading] = gap
    assert not misses


@pytest.mark.long
@pytest.mark.parametrize("study", range(1, 7))
def test_fresh_sample_agrees_with_the_published_statistics(study: int) -> None:
    """Mean, SD, percentiles and r of 1000 trials within three standard errors of the difference (and the published
    figures' own rounding); means of Table 3 within a tenth of the published SD, or what rounding and two samples of
    1000 explain. The seed stands in the study file."""
    campaign = sc.load_study(f"study{study}").run(workers=2)
    published, y = campaign.study.published, campaign.trials[PEAK].to_numpy()
    estimates = {"mean": statistics.mean(y), "sd": statistics.standard_deviation(y)} | {
        f"{p} %": statistics.percentile(y, p / 100) for p in (5, 50, 95)
    }
    misses = {}
    for name, e in estimates.items():
        gap = abs(e.value - published[f"{name} [deg]"])
        if gap > 3 * math.sqrt(2) * e.half_width / 1.96 + 0.05:
            misses[name] = gap
    for name, r in published["pearson"].items():
        found = campaign.summary["sensitivity"][PEAK][name]["pearson"]["value"]
        if abs(math.atanh(found) - math.atanh(r)) > 3 * math.sqrt(2 / 997) + 0.005 / (1 - min(abs(r), 0.99) ** 2):
            misses[f"r of {name}"] = found - r
    for name, (mean, sd) in published["metrics"].items():
        column = campaign.trials[name]
        rounding = 0.5 if float(mean).is_integer() else 0.05
        if abs(column.mean() - mean) > max(0.1 * sd, 3 * math.sqrt(2 / 1000) * column.std()) + rounding:
            misses[name] = column.mean() - mean
    assert not misses


@pytest.fixture(scope="module")
def amv6():
    """The study and a function of its inputs (n, 10) on one open scenario; a landing asked for twice is run once."""
    study = sc.load_study("amv6")
    known: dict[bytes, float] = {}
    with study.scenario.open() as session:

        def peak(x: np.ndarray) -> np.ndarray:
            for row in x:
                if row.tobytes() not in known:
                    known[row.tobytes()] = session.run(dict(zip(study.names, row, strict=True))).metrics[PEAK]
            return np.array([known[row.tobytes()] for row in x])

        yield study, peak


def test_amv_of_study_6(amv6) -> None:
    """14 landings. The authors' levels are 25.2, 30.7, 34.3°; at 5 % true gradients lead 0.5° lower, see the next
    test."""
    study, peak = amv6
    found = amv(peak, tuple(study.marginals.values()))
    assert found.evaluations.requested == 14
    assert found.status == "ok", found.reasons
    assert found.value[0.5] == pytest.approx(30.7, abs=0.2)
    assert found.value[0.95] == pytest.approx(34.3, abs=0.2)
    assert found.value[0.05] == pytest.approx(24.7, abs=0.1)
    importance = dict(zip(study.names, found.linear_importance, strict=True))
    for name, expected in (
        ("plant.drop_height", 0.62),
        ("plant.subtalar_angle_at_contact", 0.56),
        ("controller.coactivation", -0.38),
        ("plant.talocrural_angle_at_contact", 0.27),
    ):
        assert importance[name] == pytest.approx(expected, abs=0.03), name


@needs_reference
def test_amv_from_the_authors_gradients_is_theirs(amv6) -> None:
    """Their gradients are differences of outputs with one decimal, six of ten zero. From those recorded outputs our AMV
    comes to their design points, and our landings there to their levels: the whole gap at 5 % is the rounding of their
    gradients."""
    study, peak = amv6
    records = read("paper/amv_trials.csv")
    marginals = tuple(study.marginals.values())
    means = np.array([m.mean for m in marginals])
    columns = {  # the record's trial that moved each input
        "plant.drop_height": 2,
        "plant.contact_modulus": 3,
        "plant.contact_dissipation": 4,
        "plant.passive_angle_scale": 5,
        "controller.coactivation": 6,
        "controller.reflex_gain": 7,
        "plant.talocrural_angle_at_contact": 8,
        "plant.subtalar_angle_at_contact": 9,
        "plant.ankle_strength_scale": 10,
        "brace.angle_scale": 11,
    }
    published = records.set_index("trial")["peak_subtalar_deg"]

    def recorded(x: np.ndarray) -> np.ndarray:
        moved = [np.flatnonzero(~np.isclose(row, means, rtol=1e-9, atol=1e-12)) for row in x]
        return np.array(
            [
                peak(row[np.newaxis])[0]
                if len(where) > 1
                else published[columns[study.names[where[0]]] if len(where) else 1]
                for row, where in zip(x, moved, strict=True)
            ]
        )

    found = amv(recorded, marginals)
    for trial, level in ((12, 0.05), (13, 0.5), (14, 0.95)):
        assert abs(found.value[level] - published[trial]) <= 0.2, (level, found.value)
        design = dict(zip(study.names, found.design_point[level], strict=True))
        record = records.set_index("trial").loc[trial]
        assert design["plant.drop_height"] == pytest.approx(record["drop_height_m"], abs=0.003)
        assert design["controller.coactivation"] == pytest.approx(record["coactivation"], abs=0.003)
        assert math.degrees(design["plant.talocrural_angle_at_contact"]) == pytest.approx(
            record["talocrural_deg"], abs=0.2
        )
        assert math.degrees(design["plant.subtalar_angle_at_contact"]) == pytest.approx(record["subtalar_deg"], abs=0.2)


def test_relatives_of_amv_reach_the_monte_carlo_interval_at_5_percent(amv6) -> None:
    """AMV+ comes to 23.9°, inside the records' 22.7 ... 24.0°, where AMV (24.7°) and the authors' AMV (25.2°) are
    outside; HMV climbs no lower."""
    study, peak = amv6
    marginals = tuple(study.marginals.values())
    plus, hybrid = (
        method(peak, marginals, (0.05,), tolerance=1e-2, difference="forward") for method in (amv_plus, hmv)
    )
    assert 22.7 <= plus.value[0.05] <= 24.0
    assert plus.value[0.05] == pytest.approx(hybrid.value[0.05], abs=0.03)
    assert plus.evaluations.executed < 120


def test_outputs_with_one_decimal_are_named_by_the_gate(amv6) -> None:
    """With the authors' resolution and steps half of the gradients are exactly zero; their importance levels come in
    steps."""
    study, peak = amv6
    found = mean_value(lambda x: np.round(peak(x), 1), tuple(study.marginals.values()))
    assert np.sum(found.gradient == 0.0) >= 5
    assert found.status == "suspect"
    assert "comes in steps of 0.1" in found.reasons[0]


@needs_reference
def test_grid_of_2017_meets_the_authors_runs() -> None:
    """Planned co-activation without reflex: peak subtalar angle within 0.15° of the authors' own files; reflexes add
    little once planned activity is strong, and alone they leave the peak above 40°: they come too late."""
    study = sc.load_study("demers2017")
    index = read("demers2017/index.csv")
    planned = index[index.case.str.contains("activation")]
    with study.scenario.open() as session:

        def peak(coactivation: float, gain: float) -> float:
            return session.run({"controller.coactivation": coactivation, "controller.reflex_gain": gain}).metrics[PEAK]

        for coactivation, published in zip(planned.coactivation, planned.peak_subtalar_deg, strict=True):
            assert peak(coactivation, 0.0) == pytest.approx(published, abs=0.15)
        assert 5.0 < peak(0.0, 0.0) - peak(0.0, 10.0) < 8.0
        assert peak(0.0, 5.0) == pytest.approx(peak(0.0, 10.0), abs=0.1)
        assert abs(peak(1.0, 10.0) - peak(1.0, 0.0)) < 0.5


def test_scaling_torque_is_not_scaling_angle() -> None:
    """240 %: the cubic of a scaled angle grows with its cube. Scaled in torque alone the peak stays 9° higher."""
    study = sc.load_study("brace_scaling")
    with study.scenario.open() as session:
        angle, torque, both = (
            session.run({"brace.angle_scale": f, "brace.torque_scale": t}).metrics[PEAK]
            for f, t in ((2.4, 1.0), (1.0, 2.4), (1.0, 13.0))
        )
    assert angle == pytest.approx(29.98, abs=0.1)
    assert 8.5 < torque - angle < 10.5
    assert both < angle
