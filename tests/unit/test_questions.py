"""Questions of one's own: how they are written, what is refused, what a study answers, and that another one runs no
landing."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.stats import spearmanr

import sprain_cosim as sc
from sprain_cosim.cosim.result import Result
from sprain_cosim.errors import InputError
from sprain_cosim.metrics import NAMES, OF_BRACE, metrics
from sprain_cosim.shipped import shipped_studies
from sprain_cosim.study.codec import decode, encode
from sprain_cosim.study.evaluation import summarise
from sprain_cosim.study.file import SETTINGS
from sprain_cosim.study.listing import study_listing
from sprain_cosim.study.methods import METHODS, USED_BY
from sprain_cosim.study.questions import parse_question
from sprain_cosim.study.summary import StudySummary
from sprain_cosim.uq.distributions import LogNormal, Normal, Weibull
from sprain_cosim.uq.exceedance import Bounds
from sprain_cosim.uq.measured import Measured
from sprain_cosim.uq.sampling import monte_carlo
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


BENCH = "specimen,angle_scale\n" + "".join(
    f"{k},{v:.4f}\n" for k, v in enumerate(np.exp(0.4 + 0.1 * np.random.default_rng(4).standard_normal(30)))
)


def measured(tmp_path: Path, spec: str, bench: str = BENCH, more: str = "") -> sc.Study:
    (tmp_path / "bench.csv").write_text(bench)
    (tmp_path / "mine.toml").write_text(
        'scenario = "incline30_brace"\n[marginals]\n'
        '"plant.drop_height" = { normal = { mean = "0.3 m", sd = "0.03 m" } }\n'
        f'"brace.angle_scale" = {spec}\n{more}\n[study]\ntrials = 400\n[[questions]]\n'
        f'response = "{INVERSION}"\nabove = {{ normal = {{ mean = "30 deg", sd = "3 deg" }} }}\n'
    )
    return sc.load_study(tmp_path / "mine.toml")


def test_measured_samples_are_fitted_and_their_number_is_carried_on(tmp_path: Path) -> None:
    study = measured(tmp_path, '{ samples = { file = "bench.csv", column = "angle_scale" } }')
    fit = study.fits["brace.angle_scale"]
    assert fit.n == 30
    assert study.marginals["brace.angle_scale"].mean == pytest.approx(1.5, rel=0.05)
    assert any("cannot tell" in warning for warning in study.warnings)
    table = rows(study)
    table[INVERSION] = 30.0 - 4.0 * study.sample()[:, 1]  # the measured input alone
    summary = summarise(study, table, None)
    own = next(q for q in summary.questions.values() if q.source == "own")
    low, high = own.inputs_ci
    assert low < own.probability < high
    assert high - low > own.ci_high - own.ci_low, "thirty specimens know less than four hundred landings"
    assert "The specimens behind the inputs leave" in own.sentence
    text = study_listing(study, summary)
    assert f"brace.angle_scale: {fit.law} fitted to 30 values of bench.csv" in text
    assert "Anderson-Darling A² =" in text
    assert StudySummary.from_json(summary.to_json(), "") == summary
    assert decode(encode(study)).fits == study.fits
    again = measured(tmp_path, '{ samples = { file = "bench.csv", column = "angle_scale", family = "weibull" } }')
    assert isinstance(again.marginals["brace.angle_scale"], Weibull)
    held = study.override("brace.angle_scale", 1.5)
    assert summarise(held, rows(held), None).fits is None


@pytest.mark.parametrize(
    ("bench", "spec", "message"),
    [
        ("a\n", "", "bench.csv: the sample is empty"),
        ("a\n1\n2\n", "", "2 values are too few to fit a distribution; at least 3"),
        ("a\n1.5\n1.5\n1.5\n", "", "all 3 values of the sample are 1.5: nothing varies"),
        ("a\n1.5\nx\n1.5\n", "", "row 3, a = 'x'"),
        ("a [N]\n1.5\n", "", "N has the dimension"),
        ("1.5\n1.6\n1.7\n", "", "needs a header"),
        ("a,b\n1,2\n", "", "has 2 columns; name one"),
        ("a,b\n1,2\n", '{ file = "bench.csv", column = "c" }', "has no column 'c'"),
        ("a\n-1\n2\n3\n", '{ file = "bench.csv", family = "weibull" }', "weibull need positive values"),
        ("a\n1\n2\n3\n", '{ file = "bench.csv", family = "gumbel" }', "must be normal or lognormal or weibull"),
        ("a\n1\n2\n3\n", '"other.csv"', "other.csv: no such file"),
    ],
)
def test_samples_that_are_none_are_refused_in_one_line(tmp_path: Path, bench: str, spec: str, message: str) -> None:
    with pytest.raises(InputError) as problem:
        measured(tmp_path, f"{{ samples = {spec or chr(34) + 'bench.csv' + chr(34)} }}", bench)
    assert message in str(problem.value)


def test_a_threshold_may_be_measured_too(tmp_path: Path) -> None:
    (tmp_path / "cadavers.csv").write_text("failure [rad]\n0.52\n0.61\n0.66\n0.58\n0.71\n")
    study = of_file(tmp_path, f'[[questions]]\nresponse = "{INVERSION}"\nabove = {{ samples = "cadavers.csv" }}')
    threshold = study.questions[0].threshold
    assert isinstance(threshold, Measured)
    assert threshold.n == 5
    assert threshold.marginal.mean == pytest.approx(math.degrees(0.616), rel=0.01)


def test_items_of_an_enumeration_are_chosen(tmp_path: Path) -> None:
    spec = "{ choices = { published = 1, touching = 3 } }"
    study = of_file(tmp_path, '[marginals."plant.initial_pose"]\nchoices = { published = 1, touching = 3 }')
    drawn = study.sample()[:, 1]
    values = set(drawn.tolist())
    assert len(values) == 2
    assert study.marginals["plant.initial_pose"].probabilities.tolist() in ([0.25, 0.75], [0.75, 0.25]), spec
    assert min(np.mean(drawn == v) for v in values) == pytest.approx(0.25, abs=0.07)
    summary = summarise(study, rows(study), None)
    moved = summary.sensitivity["peak_subtalar_angle_deg"].inputs["plant.initial_pose"]
    assert moved.pearson.value is not None
    assert moved.importance is None
    short = replace(study, scenario=study.scenario.with_master(stop="2 ms"), trials=4)
    poses = short.run(workers=1).trials
    assert (poses["status"] == "completed").all()
    assert poses.groupby("plant.initial_pose")["peak_vertical_grf_N"].mean().nunique() == 2
    with pytest.raises(InputError, match="choices have no slope that method amv could follow"):
        replace(study, method="amv").checked()
    with pytest.raises(InputError, match="must be one of"):
        of_file(tmp_path, '[marginals."plant.initial_pose"]\nchoices = ["publishd", "touching"]')
    with pytest.raises(InputError, match="only real parameters can vary"):
        of_file(tmp_path, '[marginals."plant.initial_pose"]\nnormal = { mean = 1, sd = 1 }')


def joined(tmp_path: Path, lines: tuple[str, ...], table: str = "correlation", rho: float = 0.5) -> sc.Study:
    (tmp_path / "joined.toml").write_text(
        'scenario = "incline30_mixed"\n[marginals]\n' + "\n".join(lines) + f"\n[{table}]\n"
        f'"plant.drop_height, plant.subtalar_angle_at_contact" = {rho}\n'
        f'[study]\ntrials = 100\nresponses = ["{INVERSION}"]\n'
    )
    return sc.load_study(tmp_path / "joined.toml")


LINES = (
    '"plant.drop_height" = { lognormal = { mean = "0.30 m", sd = "0.05 m" } }',
    '"plant.subtalar_angle_at_contact" = { normal = { mean = "0 deg", sd = "5 deg" } }',
    '"brace.angle_scale" = { uniform = { low = 1, high = 2 } }',
)


def response_of(study: sc.Study, x: np.ndarray) -> np.ndarray:
    at = {name: x[:, k] for k, name in enumerate(study.names)}
    return (
        21
        + 20 * at["plant.drop_height"]
        + 18 * at["plant.subtalar_angle_at_contact"] ** 2
        + at["plant.subtalar_angle_at_contact"]
    )


@pytest.mark.parametrize("method", ["monte-carlo", "lhs", "sobol"])
def test_the_order_of_the_lines_changes_no_landing(tmp_path: Path, method: str) -> None:
    studies = [replace(joined(tmp_path, lines), method=method, trials=104) for lines in (LINES, LINES[::-1])]
    one, other = ({name: s.sample()[:, k] for k, name in enumerate(s.names)} for s in studies)
    assert all(np.array_equal(one[name], other[name]) for name in one)
    assert studies[0].identity["order"]["drawing"] == studies[1].identity["order"]["drawing"]
    blocks = np.concatenate([x for _, x in studies[0].blocks()])
    assert np.array_equal(blocks, studies[0].sample())


def test_importance_does_not_depend_on_the_order_of_the_lines(tmp_path: Path) -> None:
    found = []
    for lines in (LINES, LINES[::-1], (LINES[1], LINES[2], LINES[0])):
        study = joined(tmp_path, lines)
        x = study.sample()
        table = pd.DataFrame({"trial": np.arange(len(x)), "status": "completed", "message": ""})
        table[study.headings] = x
        table[INVERSION] = response_of(study, x)
        sampled = summarise(study, table, None).sensitivity[INVERSION].inputs
        searched = replace(study, method="hmv", check=False)
        levels = summarise(searched, table.iloc[:0], searched.search(lambda x, s=study: response_of(s, x))).amv.levels
        form = replace(study, method="form", threshold=30.0, check=False)
        point = summarise(form, table.iloc[:0], form.search(lambda x, s=study: response_of(s, x))).form
        found.append(
            [sampled[name].importance for name in sorted(study.names)]
            + [levels[p].importance[name] for p in levels for name in sorted(study.names)]
            + [levels[p].value for p in levels]
        )
        assert point.importance["plant.drop_height"] > 0.5
        assert sampled["plant.drop_height"].importance > 0.5
    assert np.allclose(found[0][:3], found[1][:3], rtol=0, atol=1e-9)
    assert np.allclose(found[0][:3], found[2][:3], rtol=0, atol=1e-9)
    assert np.allclose(found[0], found[1], rtol=0, atol=1e-4)


def test_studies_without_correlations_or_in_order_are_drawn_as_before(tmp_path: Path) -> None:
    alone = sc.load_study("study6")
    assert "drawing" not in alone.identity["order"]
    ordered = joined(tmp_path, (LINES[2], LINES[0], LINES[1]))
    assert "drawing" not in ordered.identity["order"]
    for study in (alone, ordered):
        assert np.array_equal(replace(study, trials=20).sample(), monte_carlo(study.joint, 20, study.seed))


def test_ranks_may_be_correlated(tmp_path: Path) -> None:
    study = replace(joined(tmp_path, LINES, "rank_correlation", 0.6), trials=4000)
    x = study.sample()
    assert spearmanr(x[:, 0], x[:, 1]).statistic == pytest.approx(0.6, abs=0.04)
    with pytest.raises(InputError, match=r"rank_correlation\..*: no marginal 'plant.drop_height'"):
        joined(tmp_path, LINES[1:], "rank_correlation")
    both = joined(tmp_path, LINES, "correlation]\n'brace.angle_scale, plant.drop_height' = 0.1\n[rank_correlation")
    assert both.correlation[0, 2] == 0.1
    with pytest.raises(InputError, match=r"is stated twice, also as correlation\.plant\.drop_height"):
        joined(
            tmp_path,
            LINES,
            'correlation]\n"plant.drop_height, plant.subtalar_angle_at_contact" = 0.1\n[rank_correlation',
        )


def test_what_a_method_does_not_look_at_is_said(tmp_path: Path) -> None:
    study = of_file(tmp_path, "", 'step = 0.2\nhalf_width = "1 deg"\nreplicates = 8')
    assert study.passed_over() == tuple(
        f"study.{key}: method monte-carlo does not look at it" for key in ("replicates", "step")
    )
    assert [line.partition(":")[0] for line in study.passed_over("amv")] == [
        "study.trials",
        "study.half_width",
        "study.replicates",
    ]
    for name in shipped_studies():
        assert not sc.load_study(name).passed_over(), name
    assert {method for methods in USED_BY.values() for method in methods} <= set(METHODS)
    assert set(USED_BY) <= {key.name for key in SETTINGS.keys}
