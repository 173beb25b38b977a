"""Questions of one's own: how they are written, what is refused, what a study answers, and that another one runs no
landing."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import sprain_cosim as sc
from sprain_cosim.cosim.result import Result
from sprain_cosim.errors import InputError
from sprain_cosim.metrics import NAMES, OF_BRACE, metrics
from sprain_cosim.study.codec import decode, encode
from sprain_cosim.study.evaluation import summarise
from sprain_cosim.study.listing import study_listing
from sprain_cosim.study.questions import parse_question
from sprain_cosim.study.summary import StudySummary
from sprain_cosim.uq.distributions import LogNormal, Normal, Weibull
from sprain_cosim.uq.exceedance import Bounds
from sprain_cosim.uq.measured import Measured
from tests.light import study_file

INVERSION, MOMENT = "peak_inversion_from_neutral_deg", "anatomy_jcs_inversion_moment_Nm"
OWN = f"P({INVERSION} > 35 +- 6 deg, n = 10)"


@pytest.mark.parametrize(
    ("text", "threshold", "event"),
    [
        (f"P({INVERSION} > 24 deg)", 24.0, "above 24 deg"),
        (f"P( {INVERSION}>24deg )", 24.0, "above 24 deg"),
        (f"P({INVERSION} > 35 ± 6 deg)", Normal(35.0, 6.0), "above 35 ± 6 deg"),
        (f"P({INVERSION} > 35 deg +/- 6 deg, n=10)", Measured(Normal(35.0, 6.0), 10), "above 35 ± 6 deg, n = 10"),
        (f"P({INVERSION} > weibull 35 +- 6 deg)", Weibull(35.0, 6.0), "above 35 ± 6 deg, Weibull"),
        (f"P({MOMENT} > 2.7 .. 4.3 N.m)", Bounds(2.7, 4.3), "above 2.7 ... 4.3 N·m, nothing known between"),
        (f"P({MOMENT} > 2700 N.mm)", pytest.approx(2.7), "above 2.7 N·m"),
        ("P(time_of_peak_subtalar_s > 80 ms)", pytest.approx(0.08), "above 0.08 s"),
    ],
)
def test_the_grammar_of_a_question(text: str, threshold: object, event: str) -> None:
    question = parse_question(text)
    assert question.threshold == threshold
    assert question.event == event


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("inversion > 3", "must read"),
        (f"P({INVERSION} > 35)", 'needs a unit, for example "35 deg"'),
        (f"P({INVERSION} > 35 +- 6)", "needs a unit"),
        (f"P({INVERSION} > 35 m)", "m has the dimension m"),
        (f"P({INVERSION} < 35 deg)", "ask what lies above"),
        ("P(peak_inversion_from_neutral > 35 deg)", f"did you mean {INVERSION}?"),
        (f"P({INVERSION} > 35 +- 6 deg, n = 2)", "n = 2: at least 3 specimens"),
        (f"P({INVERSION} > 35 +- 6 deg, n = few)", "n = few must be a whole number"),
        (f"P({INVERSION} > 35 deg, n = 10)", "n goes with a mean and a standard deviation"),
        (f"P({INVERSION} > 35 +- 0 deg)", "sd must be positive"),
        (f"P({INVERSION} > 4 .. 2 deg)", "low must be below high"),
        (f"P({INVERSION} > gumbel 35 +- 6 deg)", "unknown law 'gumbel'"),
        (f"P({INVERSION} > normal 35 deg)", "normal needs a mean and a standard deviation"),
    ],
)
def test_what_is_no_question_is_refused_in_one_line(text: str, message: str) -> None:
    with pytest.raises(InputError, match=r"^--question ") as problem:
        parse_question(text)
    assert message in str(problem.value)
    assert "\n" not in str(problem.value)


QUESTIONS = f"""
[[questions]]
response = "{INVERSION}"
above = {{ normal = {{ mean = "35 deg", sd = "6 deg" }}, n = 10 }}
[[questions]]
response = "{MOMENT}"
above = {{ low = "2.7 N.m", high = "4.3 N.m" }}
levels = [0.99]
"""


def of_file(tmp_path: Path, questions: str, settings: str = "") -> sc.Study:
    path = tmp_path / "mine.toml"
    marginal = '"plant.drop_height" = { normal = { mean = "0.3 m", sd = "0.03 m" } }'
    path.write_text(
        f'scenario = "incline30_brace"\n[marginals]\n{marginal}\n[study]\ntrials = 400\n{settings}\n{questions}'
    )
    return sc.load_study(path)


def rows(study: sc.Study, seed: int = 1) -> pd.DataFrame:
    """Landings as study 6 gives them, in two responses."""
    x, rng = study.sample(), np.random.default_rng(seed)
    table = pd.DataFrame({"trial": np.arange(len(x)), "status": "completed", "message": ""})
    table[study.headings] = x
    table["peak_subtalar_angle_deg"] = 30.0 + x[:, 0]
    table[INVERSION] = 21.4 + 2.2 * rng.standard_normal(len(x))
    table[MOMENT] = 4.9 + 1.4 * rng.standard_normal(len(x))
    return table


def test_a_study_file_asks(tmp_path: Path) -> None:
    study = of_file(tmp_path, QUESTIONS, 'responses = ["peak_inversion_from_neutral_deg"]\nthreshold = "24 deg"')
    summary = summarise(study, rows(study), None)
    own = [q for q in summary.questions.values() if q.source == "own"]
    assert [q.event for q in own] == [
        "above 24 deg",
        "above 35 ± 6 deg, n = 10",
        "above 2.7 ... 4.3 N·m, nothing known between",
    ]
    fixed, measured, box = own
    assert fixed.dominates == "sampling"
    assert fixed.threshold_ci is None
    # the two doubts stand apart: the sample knows to a tenth, ten specimens to two orders of magnitude
    low, high = measured.sampling_ci
    assert (high - low) / measured.probability < 0.25
    low, high = measured.threshold_ci
    assert 6e-4 < low < 1.2e-3
    assert 0.13 < high < 0.18
    assert measured.dominates == "threshold"
    assert "from 40 specimens" in measured.sentence
    assert set(measured.shapes) == {"normal", "lognormal", "weibull"}
    assert measured.shapes["lognormal"] < 0.5 * measured.shapes["normal"] < measured.shapes["weibull"]
    assert box.probability is None
    assert box.threshold_ci[0] < 0.75 < 0.9 < box.threshold_ci[1]
    # the literature's stay, and are called so
    known = summary.questions[INVERSION]
    assert (known.source, known.event) == ("literature", "above 35 ± 6 deg")
    assert known.threshold_ci is None
    assert "n is not stated" in known.sentence
    assert "99" in summary.responses[MOMENT].percentiles
    assert "99" not in summary.responses[INVERSION].percentiles
    curve = summary.curves[INVERSION]
    assert all(a >= b for a, b in zip(curve.probability, curve.probability[1:], strict=False))
    assert all(a <= p <= b for a, p, b in zip(curve.low, curve.probability, curve.high, strict=True))
    assert StudySummary.from_json(summary.to_json(), "") == summary
    text = study_listing(study, summary)
    for line in (
        f"P({INVERSION} above 35 ± 6 deg, n = 10) = ",
        "threshold, n = 10",
        "(literature)",
        "sample, 400 trials",
        "threshold of another shape",
    ):
        assert line in text
    assert decode(encode(study)).questions == study.questions


def test_levels_and_thresholds_are_obeyed_by_every_sample(tmp_path: Path) -> None:
    """They were passed over in silence by all but searches."""
    study = of_file(tmp_path, "", f'levels = [0.01, 0.99]\nthreshold = "22 deg"\nresponses = ["{INVERSION}"]')
    summary = summarise(study, rows(study), None)
    assert set(summary.responses[INVERSION].percentiles) == {"1", "5", "50", "95", "99"}
    assert summary.questions[f"{INVERSION} above 22 deg"].probability == pytest.approx(0.39, abs=0.08)


@pytest.mark.parametrize(
    ("questions", "settings", "message"),
    [
        ('[[questions]]\nabove = "3 deg"', "", "questions 1: needs response"),
        (f'[[questions]]\nresponse = "{INVERSION}"', "", "questions 1: asks nothing"),
        (f'[[questions]]\nresponse = "{INVERSION}"\nabove = 3', "", "questions 1.above = 3: needs a unit"),
        (f'[[questions]]\nresponse = "{INVERSION}"\nbelow = "3 deg"', "", "unknown key 'below'"),
        ('[[questions]]\nresponse = "inversion"\nabove = "3 deg"', "", "no such metric 'inversion'"),
        (QUESTIONS.replace("n = 10", "n = 2"), "", "questions 1.above: n = 2: at least 3 specimens"),
        (QUESTIONS.replace("n = 10", "n = 9.5"), "", "must be a whole number"),
        (QUESTIONS.replace("normal", "uniform").replace("mean", "low").replace("sd", "high"), "", "low must be below"),
        (QUESTIONS.replace("[0.99]", "[99]"), "", "must be probabilities between 0 and 1"),
        (QUESTIONS, 'method = "sobol-indices"', "draws no sample"),
        ("", 'responses = ["peak"]', "response 'peak': no such metric"),
        ("", "threshold = 22", "study.threshold = 22: needs a unit"),
    ],
)
def test_bad_questions_are_refused_before_the_first_landing(
    tmp_path: Path, questions: str, settings: str, message: str
) -> None:
    with pytest.raises(InputError) as problem:
        of_file(tmp_path, questions, settings)
    assert message in str(problem.value)


def test_form_searches_what_is_asked(tmp_path: Path) -> None:
    responses = f'responses = ["{INVERSION}"]'
    asked = of_file(tmp_path, QUESTIONS, f'{responses}\nmethod = "form"')
    assert asked.limit == Normal(35.0, 6.0)
    stated = of_file(tmp_path, "", f'{responses}\nmethod = "form"\nthreshold = "22 deg"')
    assert stated.limit == 22.0
    assert asked.identity["threshold"] == {"Normal": {"mean": 35.0, "sd": 6.0}}
    other = replace(asked, questions=(parse_question(f"P({INVERSION} > lognormal 35 +- 6 deg)"),))
    assert other.limit == LogNormal(35.0, 6.0)
    assert other.digest != asked.digest


def test_another_question_runs_no_landing(tmp_path: Path) -> None:
    """A finished folder answers it from its ledger: not a row, not a time changes."""
    study, out = sc.load_study(study_file(tmp_path, 24)), tmp_path / "runs"
    study.run(workers=1, out=out)
    before = {name: (out / name).read_bytes() for name in ("trials.csv", "timing.csv")}
    again = study.with_questions(OWN).run(workers=1, out=out, resume=True)
    assert f"{INVERSION} above 35 ± 6 deg, n = 10" in again.summary.questions
    assert {name: (out / name).read_bytes() for name in before} == before
    once_more = study.with_questions(OWN).run(workers=1, out=out, resume=True)
    assert once_more.summary.questions == again.summary.questions


def test_the_names_of_the_metrics_are_those_that_a_landing_gives() -> None:
    with_brace = sc.load_scenario("incline30_brace").with_master(stop="10 ms").run()
    assert isinstance(with_brace, Result)
    assert set(metrics(with_brace)) == set(NAMES)
    assert set(metrics(sc.load_scenario("incline30").with_master(stop="10 ms").run())) == set(NAMES) - set(OF_BRACE)
    assert not math.isnan(with_brace.metrics["brace_work_J"])
