"""A study that stops when a number is known: what is asked, what is refused, what each look knew."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import sprain_cosim as sc
from sprain_cosim.errors import InputError
from sprain_cosim.report.verdict import until_words
from sprain_cosim.study.codec import decode, encode
from sprain_cosim.study.evaluation import summarise
from sprain_cosim.study.listing import study_listing
from sprain_cosim.study.summary import StudySummary
from sprain_cosim.study.until import Until, parse_until
from sprain_cosim.uq.distributions import Normal
from sprain_cosim.uq.exceedance import Bounds
from sprain_cosim.uq.measured import Measured

PEAK, INVERSION = "peak_subtalar_angle_deg", "peak_inversion_from_neutral_deg"


@pytest.mark.parametrize(
    ("text", "asked"),
    [
        ("p95 0.5 deg", Until(PEAK, 0.5, level=0.95)),
        ("p97.5 within 1 deg", Until(PEAK, 1.0, level=0.975)),
        (f"p5 of {INVERSION} ± 0.5 deg", Until(INVERSION, 0.5, level=0.05)),
        ("mean +- 0.2deg", Until(PEAK, 0.2)),
        ("mean of peak_vertical_grf_N 0.1 kN", Until("peak_vertical_grf_N", 100.0)),
        (f"P({INVERSION} > 35 +- 6 deg) within 1 %", Until(INVERSION, 0.01, threshold=Normal(35.0, 6.0))),
        (
            f"P({INVERSION} > 35 +- 6 deg, n = 10) 0.5%",
            Until(INVERSION, 0.005, threshold=Measured(Normal(35.0, 6.0), 10)),
        ),
        (f"P({INVERSION} > 20 .. 30 deg) 0.02", Until(INVERSION, 0.02, threshold=Bounds(20.0, 30.0))),
    ],
)
def test_what_is_asked(text: str, asked: Until) -> None:
    assert parse_until(text, PEAK) == asked


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("p95", "must read"),
        ("p95 0.5", "needs a unit"),
        ("p0 1 deg", "no percentile"),
        ("p95 of peak_subtalar_angle 1 deg", "no such metric"),
        ("p95 -1 deg", "must read"),
        ("mean 0 deg", "must be positive"),
        (f"P({INVERSION} > 35 deg) 60 %", "between 0 and 50 %"),
        (f"P({INVERSION} > 35) 1 %", "needs a unit"),
        (f"P({INVERSION} > 35 deg) of {PEAK} 1 %", "stands in its brackets"),
    ],
)
def test_what_cannot_be_asked_is_one_line(text: str, said: str) -> None:
    with pytest.raises(InputError, match=said) as problem:
        parse_until(text, PEAK)
    assert "\n" not in str(problem.value)


def study_file(folder: Path, settings: str) -> Path:
    path = folder / "mine.toml"
    path.write_text(
        'scenario = "incline30"\n[marginals]\n"plant.drop_height" = { normal = { mean = "0.3 m", sd = "0.02 m" } }\n'
        f"[study]\n{settings}\n"
    )
    return path


def test_a_study_file_asks_it_too(tmp_path: Path) -> None:
    one = sc.load_study(study_file(tmp_path, 'until = "p95 0.5 deg"'))
    assert one.until == (Until(PEAK, 0.5, level=0.95),)
    two = sc.load_study(study_file(tmp_path, f'until = ["mean 0.2 deg", "P({INVERSION} > 35 +- 6 deg) 1 %"]'))
    assert two.until[1].threshold in {q.threshold for q in two.exceedances}
    assert decode(encode(two)).until == two.until
    assert two.passed_over("sobol") == ("study.until: method sobol does not look at it",)
    assert replace(two, method="sobol").watched == ()
    with pytest.raises(InputError, match=r"study\.until 'p95 0\.5'"):
        sc.load_study(study_file(tmp_path, 'until = "p95 0.5"'))
    with pytest.raises(InputError, match="asked twice"):
        sc.load_study(study_file(tmp_path, 'until = ["p95 0.5 deg", "p95 1 deg"]'))


def test_only_random_samples_stop(tmp_path: Path) -> None:
    study = sc.load_study(study_file(tmp_path, ""))
    with pytest.raises(InputError, match="no random sample"):
        study.with_until(["p95 1 deg"], "sobol")
    with pytest.raises(InputError, match="has no parts"):
        study.run(until="p95 1 deg", shard=(1, 2), out=tmp_path / "out")
    assert not (tmp_path / "out").exists()


def landings(study: sc.Study, n: int, failed: int = 0) -> pd.DataFrame:
    x = replace(study, trials=n).sample()
    y = 40.0 + 100.0 * (x[:, 0] - 0.3)
    status = np.array(["failed"] * failed + ["completed"] * (n - failed))
    columns = {"trial": np.arange(n), "status": status, "message": ""}
    metrics = {PEAK: y, INVERSION: 0.7 * y}
    return pd.DataFrame(columns | dict(zip(study.headings, x.T, strict=True)) | metrics)


def test_what_each_look_knew_is_kept_and_said(tmp_path: Path) -> None:
    """SD 2 deg: at 120 landings the mean is known to about ± 0.5, never to ± 0.05."""
    study = sc.load_study(study_file(tmp_path, 'until = "mean 0.6 deg"\ntrials = 300'))
    summary = summarise(study, landings(study, 120), None)
    rule = summary.until
    assert rule is not None
    assert (rule.planned, rule.trials, rule.saved) == ((50, 80, 120, 180, 270, 300), 120, 180)
    (mean,) = rule.watched.values()
    assert [look.n for look in mean.looks] == [50, 80, 120]
    assert rule.known
    assert mean.known
    assert mean.trials_needed is None
    low, high = summary.responses[PEAK].mean_ci
    assert (mean.looks[-1].ci_low, mean.looks[-1].ci_high) == (low, high), "the table shows the same interval"
    assert summary.n_requested == 120
    assert StudySummary.from_json(summary.to_json(), "x") == summary
    text = study_listing(study, summary)
    assert "known after 120 trials, 180 of 300 saved: mean of peak_subtalar_angle_deg = " in text
    assert "wanted ± 0.6" in text
    assert "180 of 300 landings saved" in str(until_words(rule))

    narrow = replace(study, until=(Until(PEAK, 0.05),))
    said = summarise(narrow, landings(narrow, 300), None).until
    assert said is not None
    assert not said.known
    needed = said.watched[f"mean of {PEAK}"].trials_needed
    assert "not known after 300 trials, all that were allowed" in said.sentence
    assert 300 * 20 < needed < 300 * 200
    assert f"about {needed} trials would do" in said.sentence
    assert "not known" in str(until_words(said))


def test_failed_trials_count_against_a_percentile() -> None:
    """Whatever they would have given."""
    y, asked = np.random.default_rng(1).standard_normal(400), Until(PEAK, 0.3, level=0.5)
    whole, holed = asked.estimate(y, 0, 0.95), asked.estimate(y, 8, 0.95)
    assert holed.low < whole.low < whole.value < whole.high < holed.high
    assert asked.estimate(y[:10], 5, 0.95).low == -np.inf
    assert not asked.known(asked.estimate(y[:10], 5, 0.95))
