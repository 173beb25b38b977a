"""What a study says about trials that need no landing: the questions from every kind of sample, intervals, the stopping
rule, honest gaps."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from time import perf_counter

import numpy as np
import pandas as pd
import pytest

import sprain_cosim as sc
from sprain_cosim.errors import InputError
from sprain_cosim.shipped import shipped_studies
from sprain_cosim.study.evaluation import FACTORS, summarise
from sprain_cosim.study.listing import study_listing
from sprain_cosim.study.questions import Question
from sprain_cosim.study.summary import StudySummary
from sprain_cosim.uq import Normal, Uniform
from sprain_cosim.uq.exceedance import doubted_exceedance
from sprain_cosim.uq.measured import Measured
from sprain_cosim.uq.reliability import LevelResult, amv, form_exceedance
from sprain_cosim.uq.statistics import exceedance

INVERSION, MOMENT, PEAK = (
    "peak_inversion_from_neutral_deg",
    "anatomy_jcs_inversion_moment_Nm",
    "peak_subtalar_angle_deg",
)


@pytest.fixture(scope="module")
def study6():
    return sc.load_study("study6")


def peak(study, x: np.ndarray) -> np.ndarray:
    """Linear in the inputs, with the spread that study 6 has."""
    weights = dict.fromkeys(study.names, 0.3) | {
        "plant.drop_height": 2.0,
        "plant.subtalar_angle_at_contact": 1.8,
        "controller.coactivation": -1.2,
    }
    return 29.0 + (x - study.joint.means) / study.joint.sds @ np.array([weights[n] for n in study.names])


def landings(study, failed: int = 0) -> pd.DataFrame:
    x = study.sample()
    y = peak(study, x)
    table = pd.DataFrame({"trial": study.numbers or np.arange(len(x)), "status": "completed", "message": ""})
    table[study.headings] = x
    table[PEAK], table[INVERSION], table[MOMENT] = y, 0.7 * y, y - 25
    table.loc[: failed - 1, "status"] = "timeout" if failed else "completed"
    return table


@pytest.fixture(scope="module")
def exact(study6) -> dict[str, float]:
    """The probabilities of the two questions from two million landings of the same formula."""
    y = peak(study6, study6.joint.from_standard(np.random.default_rng(5).standard_normal((400_000, 10))))
    return {
        INVERSION: exceedance(0.7 * y, Normal(35.0, 6.0)).value,
        MOMENT: exceedance(y - 25, Uniform(2.7, 4.3)).value,
    }


@pytest.mark.parametrize(("method", "trials"), [("monte-carlo", 1000), ("sobol", 1024), ("lhs", 1000), ("table", 1000)])
def test_questions_with_intervals_from_every_sample(study6, exact, method: str, trials: int) -> None:
    study = replace(study6, method="sobol" if method == "table" else method, trials=trials)
    if method == "table":
        study = replace(
            study6,
            method="table",
            trials=trials,
            table=replace(study6, seed=2, trials=trials).sample(),
            numbers=tuple(range(trials)),
        )
    summary = summarise(study, landings(study), None)
    for name, expected in exact.items():
        q = summary.questions[name]
        assert q.ci_low <= q.probability <= q.ci_high
        wide = q.ci_high - q.ci_low
        assert q.ci_low - 0.5 * wide <= expected <= q.ci_high + 0.5 * wide
    if method != "monte-carlo":
        assert summary.notes, "how the intervals come about is said"
    assert (summary.responses[PEAK].percentiles["5"].ci_low is None) == (method == "lhs")


def test_sobol_replicates_are_narrower_than_monte_carlo(study6) -> None:
    ends = []
    for method in ("monte-carlo", "sobol"):
        study = replace(study6, method=method, trials=1024)
        q = summarise(study, landings(study), None).questions[INVERSION]
        ends.append(q.ci_high - q.ci_low)
    assert ends[1] < 0.5 * ends[0]


def test_failed_trials_widen_and_are_counted(study6) -> None:
    study = replace(study6, trials=400)
    whole, holed = (summarise(study, landings(study, failed), None) for failed in (0, 8))
    assert holed.n_failed == 8
    assert holed.failures == {"timeout": 8}
    q, r = (s.questions[INVERSION] for s in (whole, holed))
    assert r.ci_high - r.ci_low >= q.ci_high - q.ci_low + 0.01
    low, high = holed.responses[PEAK].percentiles["50"].with_failures
    assert low <= whole.responses[PEAK].percentiles["50"].value <= high
    sobol = replace(study6, method="sobol", trials=400)
    broken = summarise(sobol, landings(sobol, 8), None)
    assert broken.responses[PEAK].percentiles["50"].ci_low is None
    assert "complete replicates" in broken.notes[0]


def test_levels_are_bounded_whatever_the_worst_landings_would_have_given(study6) -> None:
    """The three in ten landings that roll furthest fail: the 95 % level of the others, and its interval, are far below
    that of all; and no number of further trials tells."""
    study = replace(study6, trials=200)
    table = landings(study)
    whole = summarise(study, table, None).responses[PEAK].percentiles["95"].value
    table.loc[np.argsort(table[PEAK].to_numpy())[-60:], "status"] = "failed"
    summary = summarise(study, table, None)
    level = summary.responses[PEAK].percentiles["95"]
    assert level.ci_high < whole
    text = study_listing(study, replace(summary, wall_s=1.0))
    (note,) = [n for n in summary.notes if "landings failed" in n]
    low, high = level.with_failures
    assert low <= whole
    assert high is None
    assert note in text
    assert note.startswith("60 of 200 landings failed: ")
    assert note.endswith(f"95 % {low:.2f} ... open")
    q = summary.questions[INVERSION]
    assert q.dominates == "failures"
    assert "The 60 failed landings dominate" in text
    assert "more trials narrow it" not in text
    few = landings(study, failed=1)
    assert summarise(study, few, None).questions[MOMENT].dominates == "sampling"


def test_a_level_that_too_few_trials_close_has_an_open_end(study6) -> None:
    """50 values: none of them bounds the 5 % level from below (0.95^50 > 2.5 %), which a blank did not say."""
    study = replace(study6, trials=50)
    summary = summarise(study, landings(study), None)
    level = summary.responses[PEAK].percentiles["5"]
    assert (level.ci_low, summary.responses[PEAK].percentiles["95"].ci_high) == (None, None)
    text = study_listing(study, replace(summary, wall_s=1.0))
    assert f"open ... {level.ci_high:.2f}" in text
    assert "50 trials leave an end of the interval of 5 %, 95 % open" in text
    assert "72 trials close it" in text
    assert 0.95**72 <= 0.025 < 0.95**71
    closed = replace(study6, trials=72)
    text = study_listing(closed, replace(summarise(closed, landings(closed), None), wall_s=1.0))
    assert "open ..." not in text
    assert "... open" not in text


def test_peaks_that_are_of_no_roll_are_counted(study6) -> None:
    study = replace(study6, trials=40)
    table = landings(study)
    table["time_of_peak_subtalar_s"] = np.repeat([0.15, 0.0, 0.31, 0.1], [5, 4, 3, 28])
    notes = summarise(study, table, None).notes
    assert any("in 8 of 40 trials the foot still turned at the stop" in n for n in notes)  # 0.31 s is later, too
    assert any("in 4 of 40 trials the foot never rolled outwards" in n for n in notes)
    assert any("of no landing (supination in 3 of 40 trials)" in n for n in notes)


@pytest.mark.parametrize(("trials", "said"), [(3, "mean, SD and percentiles take 4"), (12, "no sensitivities")])
def test_too_few_trials_say_so(study6, trials: int, said: str) -> None:
    study = replace(study6, trials=trials)
    summary = summarise(study, landings(study), None)
    assert any(said in note for note in summary.notes)
    assert not summary.questions
    assert not summary.sensitivity
    assert bool(summary.responses) == (trials >= 4)


def test_stopping_rule(study6) -> None:
    """The widest of the three intervals against the one wanted, and how many trials it would take."""
    wide, narrow = (
        summarise(s, landings(s), None).stopping
        for s in (replace(study6, trials=300, half_width=w) for w in (2.0, 0.3))
    )
    assert wide.met
    assert not narrow.met
    assert 300 < narrow.trials_needed == math.ceil(300 * (max(narrow.half_width.values()) / 0.3) ** 2)
    x = replace(study6, trials=narrow.trials_needed + 300).sample()
    enough = replace(study6, method="table", table=x, trials=len(x), half_width=0.4)
    assert summarise(enough, landings(enough), None).stopping.met


def test_sensitivities_have_errors_and_intervals(study6) -> None:
    study = replace(study6, trials=600)
    found = summarise(study, landings(study), None).sensitivity[PEAK]
    drop, inert = found.inputs["plant.drop_height"], found.inputs["controller.reflex_gain"]
    for factor in FACTORS:
        low, high = getattr(drop.ci, factor)
        assert low < getattr(drop, factor) < high
        assert 0 < getattr(drop.standard_error, factor) < 0.3
    assert drop.ci.dsd_dsd[0] > 0, "the largest contributor is beyond noise"
    assert inert.ci.dsd_dsd[0] < 0.1
    total = sum(v.importance**2 for v in found.inputs.values())
    assert total == pytest.approx(1.0)
    assert found.chaos.q2 > 0.95
    assert sum(v.sobol_first for v in found.inputs.values()) == pytest.approx(1.0, abs=0.05)


def test_factors_on_the_spread_have_no_error_from_few_trials_and_say_so(study6) -> None:
    study = replace(study6, trials=60)
    summary = summarise(study, landings(study), None)
    drop = summary.sensitivity[PEAK].inputs["plant.drop_height"]
    assert drop.dsd_dsd is not None
    assert (drop.standard_error.dsd_dsd, drop.ci.dsd_dsd) == (None, (None, None))
    assert any("dSD/dSD without errors below 100" in note for note in summary.notes)


def test_a_grid_becomes_a_table_and_no_probability(study6) -> None:
    study = sc.load_study("demers2017")
    x = study.sample()
    assert x.shape == (121, 2)
    table = pd.DataFrame({"trial": range(121), "status": "completed", "message": ""})
    table[study.headings] = x
    table[PEAK] = table[INVERSION] = 50 - 30 * x[:, 0] - x[:, 1]
    table.loc[5, "status"] = "failed"
    summary = summarise(study, table, None)
    values = summary.grid.responses[PEAK]
    assert (len(values), len(values[0])) == (11, 11)
    assert values[0][5] is None
    assert values[10][10] == pytest.approx(10.0)
    assert not summary.questions
    printed = study_listing(study, replace(summary, wall_s=1.0))
    assert "controller.coactivation down, controller.reflex_gain across" in printed
    assert "failed" in printed


def test_levels_answer_the_question_without_an_interval(study6, exact) -> None:
    study = replace(sc.load_study("amv6"), responses=(INVERSION,))
    found = amv(lambda x: 0.7 * peak(study, x), tuple(study.marginals.values()))
    summary = summarise(
        study,
        pd.DataFrame({"trial": [], "status": [], "message": [], **{h: [] for h in study.headings}, INVERSION: []}),
        found,
    )
    q = summary.questions[INVERSION]
    assert q.probability == pytest.approx(exact[INVERSION], rel=0.05)
    assert q.ci_low is None
    assert "own error is not known" in " ".join(summary.notes)


def searched(study, found):
    """The summary of a search that ran without landings."""
    columns = ["trial", "status", "message", *study.headings, *study.responses]
    return replace(summarise(study, pd.DataFrame({c: [] for c in columns}), found), wall_s=1.0)


def test_levels_are_tested_on_random_landings(study6) -> None:
    """A hinge that slopes at the means do not see: the size of the error stands beside each level; without the test the
    reader is told what is lost."""

    def bent(x: np.ndarray) -> np.ndarray:
        return np.maximum(peak(study6, x), 26.0)

    asked = Question(PEAK, Normal(40.0, 6.0))
    study = replace(study6, method="amv", questions=(asked,))
    found = study.search(bent)
    assert found.status == "ok"
    checked = searched(study, replace(found, check=study.level_check(bent, found)))
    test = checked.amv.check
    assert (checked.amv.status, checked.amv.evaluations_executed) == ("suspect", 14)
    assert 100 <= test.n <= 400
    assert test.verdict["5"] == "suspect"
    assert test.ci["5"][0] < test.off["5"] < test.ci["5"][1]
    assert "percentage points" in checked.amv.reasons[-1]
    assert StudySummary.from_json(checked.to_json(), "") == checked
    assert f"tested on {test.n} random landings" in study_listing(study, checked)
    q = checked.questions[asked.name]
    assert q.ci_low < q.probability < q.ci_high
    assert q.trials == test.n
    assert q.sentence.startswith("The levels alone say ")
    alone = searched(study, found)
    assert alone.amv.check is None
    assert any("not tested on random landings" in note for note in alone.notes)


def test_form_is_followed_by_second_order_and_sampling(study6) -> None:
    """Two regions exceed the threshold, first order finds one; the estimate has both, and an interval."""
    study = replace(study6, method="form", threshold=8.0, responses=(PEAK,))

    def response(x: np.ndarray) -> np.ndarray:
        return np.abs(peak(study6, x) - 29.0)

    rows = study6.joint.from_standard(np.random.default_rng(1).standard_normal((200_000, 10)))
    exact = float(np.mean(response(rows) > 8.0))
    summary = searched(study, study.search(response))
    form = summary.form
    assert form.ci_low <= exact <= form.ci_high
    assert form.probability == pytest.approx(exact, rel=0.15)
    assert 0.4 * exact < form.first_order < 0.7 * exact
    assert form.design_points == 2
    assert any("FORM says" in remark for remark in form.remarks)
    assert set(form.second_order) == {"Breitung", "Hohenbichler-Rackwitz", "Tvedt"}
    assert StudySummary.from_json(summary.to_json(), "") == summary
    text = study_listing(study, summary)
    assert "450 landings about 2 design points" in text
    assert "first order" in text
    alone = replace(study, check=False)
    summary = searched(alone, alone.search(response))
    assert summary.form.ci_low is None
    assert any("first order alone" in note for note in summary.notes)
    assert "(first order: no interval)" in study_listing(alone, summary)


def test_form_says_what_the_specimens_behind_its_threshold_leave_open(study6) -> None:
    """From the landings about the design point: no further one."""
    asked = Question(INVERSION, Measured(Normal(35.0, 6.0), 10))
    study = replace(study6, method="form", questions=(asked,), responses=(INVERSION,))
    found = study.search(lambda x: 0.7 * peak(study6, x))
    summary = searched(study, found)
    plain = doubted_exceedance(0.7 * peak(study6, replace(study6, trials=1000).sample()), asked.threshold)
    form = summary.form
    assert form.threshold_ci == pytest.approx((plain.threshold.low, plain.threshold.high), rel=0.1)
    assert form.shapes == pytest.approx(plain.shapes, rel=0.1)
    assert (form.specimens, form.dominates) == (10, "threshold")
    assert summary.notes == ()
    both = replace(study, threshold=Normal(35.0, 6.0))  # the file's own, and the same law with its specimens
    assert (both.sought, both.limit, both.digest) == (study.sought, study.limit, study.digest)
    assert searched(both, found).notes == ()
    other = replace(study, threshold=Normal(30.0, 6.0))
    assert any("no answer to" in note for note in searched(other, found).notes)
    assert StudySummary.from_json(summary.to_json(), "") == summary
    assert "threshold, n = 10" in study_listing(study, summary)
    first = searched(replace(study, check=False), replace(study, check=False).search(lambda x: 0.7 * peak(study6, x)))
    assert any("10 specimens behind the threshold are not in first order" in note for note in first.notes)


def test_sobol_samples_that_are_no_power_of_two_hear_a_word(study6) -> None:
    def notes(trials: int) -> str:
        study = replace(study6, method="sobol", trials=trials)
        return " ".join(summarise(study, landings(study), None).notes)

    assert "125 points a sequence are no power of two" in notes(1000)
    assert "512 or 1024 trials tell more" in notes(1000)
    assert "power of two" not in notes(1024)


def test_failed_trials_stand_beside_every_statistic(study6) -> None:
    study = replace(study6, trials=200)
    summary = summarise(study, landings(study, failed=3), None)
    assert {r.failed for r in summary.responses.values()} == {3}
    assert {q.failed for q in summary.questions.values()} == {3}
    text = study_listing(study, replace(summary, wall_s=1.0))
    assert text.count("3 failed left out") >= 5 + 3  # each line of a response, and each further table
    assert "sample, 197 trials (3 failed)" in text
    assert "failed left out" not in study_listing(study, replace(summarise(study, landings(study), None), wall_s=1.0))


def test_form_with_an_uncertain_threshold(study6) -> None:
    """Inputs and threshold normal, response linear: the probability is exact; the threshold is the last entry."""
    inputs = [Normal(20.0, 3.0), Normal(0.0, 5.0)]
    calls = []

    def response(x: np.ndarray) -> np.ndarray:
        calls.append(len(x))
        return x[:, 0] + 0.5 * x[:, 1]

    found = form_exceedance(response, inputs, Normal(35.0, 6.0))
    beta = 15 / math.sqrt(9 + 6.25 + 36)
    assert found.beta == pytest.approx(beta, abs=1e-6)
    assert found.alpha == pytest.approx(np.array([3, 2.5, -6]) / math.sqrt(51.25), abs=1e-5)
    assert sum(calls) < found.evaluations.executed, "a step of the threshold alone is no evaluation of the response"
    fixed = form_exceedance(response, inputs, 30.0)
    assert fixed.beta == pytest.approx(10 / math.sqrt(15.25), abs=1e-6)


def test_amv_is_judged_by_the_records_monte_carlo() -> None:
    """At 5 and 50 % the authors' AMV lies outside the intervals of their own Monte Carlo trials, and the output says
    so."""
    study = sc.load_study("amv6")
    published = amv(lambda x: peak(study, x), tuple(study.marginals.values()))
    found: LevelResult = replace(published, value={0.05: 25.2, 0.5: 30.7, 0.95: 34.3})
    empty = pd.DataFrame({"trial": [], "status": [], "message": [], **{h: [] for h in study.headings}, PEAK: []})
    summary = replace(summarise(study, empty, found), wall_s=1.0)
    verdicts = [summary.amv.levels[level].against_monte_carlo for level in ("5", "50", "95")]
    assert verdicts == ["above by 1.2", "above by 1", "inside"]
    assert "above by 1.2 / above by 1.2" in study_listing(study, summary)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (
            '{ lognormal = { mean = "0.30 m", sd = "0.05 m" } }',
            '{ normal = { mean = "0.30 m", sd = "0.2 m" } }',
            "6.7 % of the trials would lie outside",
        ),
        ('"0.30 m", sd = "0.05 m"', '0.30, sd = "0.05 m"', "needs a unit"),
        ('"-34 deg"', '"-34 rad"', "of the trials would lie outside"),
        ('"-34 deg"', '"-34"', "needs a unit"),
        ("{ lognormal = { mean = 0.20, sd = 0.05 } }", "{ lognormal = { mean = 0, sd = 0 } }", "write { fixed = 0 }"),
        ("mean = 5.0, sd = 1.0", "mean = 5.0, sd = -1.0", "must be positive"),
        (
            "[study]",
            '[correlation]\n"plant.drop_height, controller.coactivation" = -0.99\n[study]',
            "cannot be attained",
        ),
        (
            "[study]",
            '[correlation]\n"plant.ankle_strength_scale, plant.passive_angle_scale" = '
            '0.9\n"plant.ankle_strength_scale, brace.angle_scale" = 0.9\n'
            '"plant.passive_angle_scale, brace.angle_scale" = -0.9\n[study]',
            "not positive definite",
        ),
        (
            "[study]",
            '[correlation]\n"plant.drop_height, brace.angle_scale" = 0.3\n'
            '"brace.angle_scale, plant.drop_height" = 0.2\n[study]',
            "is stated twice, also as 'plant.drop_height, brace.angle_scale'; remove one",
        ),
        ('mean = "-34 deg", sd = "5 deg"', 'mean = "-34 deg", sd = "1e-15 deg"', "its sd is lost in rounding"),
        (
            'mean = "-34 deg", sd = "5 deg"',
            'mean = "-34 deg", sd = "1e300 deg"',
            "too large, too small or too far apart",
        ),
        ('method = "monte-carlo"', 'method = "amv"\nstep = 1e-17', "study.step = 1e-17: must lie between 1e-06 and 5"),
        ('method = "monte-carlo"', 'method = "hmv"\ntolerance = 1e300', "must be less than one standard deviation"),
        ('method = "monte-carlo"', 'method = "amv+"\nbudget = 10', "budget = 10: the first step of method amv+ takes"),
        (
            'method = "monte-carlo"',
            'threshold = { normal = { mean = "35 deg", sd = "1e-17 deg" } }',
            "lost in rounding",
        ),
        ('method = "monte-carlo"', 'method = "form"\nthreshold = "35 m"', "expected rad"),
        ('method = "monte-carlo"', 'method = "form"', "needs study.threshold"),
        ("trials = 1000", "trials = 99999999999999999999", "at most 10000000"),
        ('method = "monte-carlo"', 'method = "monte carlo"', "did you mean monte-carlo?"),
        ('method = "monte-carlo"', 'method = "monte-carlo"\nhalf_width = "0 deg"', "must be a positive value"),
        ('method = "monte-carlo"', 'method = "sobol-indices"\nreplicates = 3', "multiple of its 3 replicates"),
    ],
)
def test_impossible_studies_are_refused_in_one_line(tmp_path, old: str, new: str, said: str) -> None:
    from sprain_cosim.shipped import scenario_folder

    source = (scenario_folder() / "studies" / "study6.toml").read_text()
    assert old in source
    path = tmp_path / "mine.toml"
    path.write_text(source.replace(old, new, 1))
    with pytest.raises(InputError, match=r".") as problem:
        sc.load_study(path)
    assert said in str(problem.value)
    assert len(str(problem.value).splitlines()) <= 2


def test_a_budget_that_is_spent_before_the_first_step_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """The levels' own points come on top of the slopes'."""
    from sprain_cosim.study import search

    study = sc.load_study("amv6")

    def spent(self: object, function: object) -> None:
        raise search.BudgetTooSmall("a budget of 7 evaluations does not even allow the AMV step")

    monkeypatch.setattr(type(study), "search", spent)
    with pytest.raises(InputError, match=r"study\.budget = 2000: is spent before the first step of method amv"):
        search.run_search(study, None)  # type: ignore[arg-type]


def test_radians_written_as_degrees_are_warned_about(tmp_path) -> None:
    from sprain_cosim.shipped import scenario_folder

    path = tmp_path / "mine.toml"
    shipped = (scenario_folder() / "studies" / "study6.toml").read_text()
    path.write_text(shipped.replace('mean = "-34 deg", sd = "5 deg"', 'mean = "-0.593 deg", sd = "0.0873 deg"'))
    assert "radians written as degrees" in sc.load_study(path).warnings[-1]
    assert not sc.load_study("study6").warnings


@pytest.mark.parametrize(
    ("law", "said"),
    [
        ('{ normal = { mean = "0 deg", sd = "5 deg" }, low = "-10 deg", high = "10 deg" }', "has 0 ± 4.4 deg"),
        ('{ normal = { mean = "0 deg", sd = "5 deg" }, low = "0 deg" }', "has 3.989 ± 3.01 deg"),
        ('{ normal = { mean = "0 deg", sd = "5 deg" }, low = "-20 deg", high = "20 deg" }', ""),
    ],
)
def test_a_law_that_is_cut_says_what_is_drawn(tmp_path, law: str, said: str) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(f'scenario = "incline30"\n[marginals]\n"plant.subtalar_angle_at_contact" = {law}\n')
    study = sc.load_study(path)
    assert [said in line and "not 0 ± 5 deg" in line for line in study.warnings] == [True] * bool(said)


@pytest.mark.parametrize(("sd", "warned"), [("12 kg", False), ("25 kg", True)])
def test_persons_drawn_one_by_one_beyond_those_measured_are_told(tmp_path, sd: str, warned: bool) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(
        'scenario = "mine_scenario.toml"\n[marginals]\n'
        f'"subject.mass" = {{ lognormal = {{ mean = "80 kg", sd = "{sd}" }} }}\n'
    )
    (tmp_path / "mine_scenario.toml").write_text('base = "incline30"\n[subject]\nsex = "male"\nstature = "1.76 m"\n')
    lines = [line for line in sc.load_study(path).warnings if "of 1000 persons have measures outside" in line]
    assert len(lines) == warned


def test_what_the_polynomial_behind_shares_does_not_predict_is_told(study6) -> None:
    """Of a bent response in ten inputs 100 rows allow a plane alone: the interval of the share of the bent input held
    0.75 of 100 samples, without a word."""
    study = replace(study6, trials=120)
    trials = landings(study)
    told = " may belong to any input"
    assert not any(told in note for note in summarise(study, trials, None).notes)
    trials[PEAK] += 3.0 * np.random.default_rng(1).standard_normal(120)
    summary = summarise(study, trials, None)
    assert summary.sensitivity[PEAK].chaos.q2 < 0.9
    assert sum(note.startswith(PEAK) and told in note for note in summary.notes) == 1


def test_a_latin_hypercube_has_the_mean_that_independent_trials_bound(study6) -> None:
    study = replace(study6, method="lhs", trials=60)
    found = summarise(study, landings(study), None).responses[PEAK]
    assert found.mean_ci[0] < found.mean < found.mean_ci[1]
    assert found.sd_ci is None
    assert found.percentiles["50"].ci_low is None


def test_samples_keep_their_rows_and_columns(study6) -> None:
    """Enlarging Monte Carlo and Sobol' keeps rows; another marginal without correlation leaves the other columns; a
    Latin hypercube has one size."""
    for method in ("monte-carlo", "sobol"):
        small, large = (replace(study6, method=method, trials=n).sample() for n in (64, 256))
        assert np.array_equal(large[:64], small)
    correlation = np.eye(10)
    correlation[0, 7] = correlation[7, 0] = 0.4
    joined = replace(study6, trials=64, correlation=correlation)
    other = joined.override("plant.contact_modulus", "60 MPa/m")
    kept = [i for i, name in enumerate(study6.names) if name != "plant.contact_modulus"]
    assert np.array_equal(joined.sample()[:, kept], other.sample()[:, kept])
    identities = [replace(study6, method="lhs", trials=n).identity["trials"] for n in (64, 65)]
    assert identities[0] != identities[1]


def test_the_study_on_the_page_loads(tmp_path) -> None:
    page = (Path(__file__).parent.parent.parent / "docs" / "studies.md").read_text()
    path = tmp_path / "mine.toml"
    path.write_text(page.partition("```toml\n")[2].partition("```")[0])
    study = sc.load_study(path)
    assert study.half_width == 1.0
    assert study.sample().shape == (200, 4)
    assert {name for name in shipped_studies() if f"`{name}`" in page} >= {
        "amv6",
        "form6",
        "demers2017",
        "brace_scaling",
    }
    for name in shipped_studies():
        assert sc.load_study(name).checked().source == name


def test_a_large_study_is_summed_up_in_seconds(study6) -> None:
    """100 000 trials: no bootstrap, polynomial chaos from the first ones; the factors' intervals by their standard
    errors."""
    rng = np.random.default_rng(3)
    x = study6.joint.from_standard(rng.standard_normal((100_000, 10)))
    table = pd.DataFrame({"trial": np.arange(len(x)), "status": "completed", "message": ""})
    table[study6.headings] = x
    table[PEAK] = peak(study6, x) + rng.standard_normal(len(x))
    began = perf_counter()
    found = summarise(replace(study6, trials=len(x)), table, None).sensitivity[PEAK]
    assert perf_counter() - began < 60
    drop = found.inputs["plant.drop_height"]
    assert drop.ci.dsd_dsd[1] - drop.ci.dsd_dsd[0] == pytest.approx(3.92 * drop.standard_error.dsd_dsd)


def test_shares_of_correlated_inputs_do_not_depend_on_the_lines_and_say_where_they_differ(study6) -> None:
    """Two inputs that go together: what each explains with the other, by itself, and Shapley's share between them."""
    names = ("plant.drop_height", "plant.subtalar_angle_at_contact")
    base = replace(study6, trials=300, marginals={n: study6.marginals[n] for n in names})
    found = []
    for order in (names, names[::-1]):
        both = {n: base.marginals[n] for n in order}
        study = replace(base, marginals=both, correlation=np.array([[1.0, 0.7], [0.7, 1.0]]))
        x = study.sample()
        y = {n: x[:, k] for k, n in enumerate(order)}
        peaks = 40.0 * y[names[0]] + 20.0 * y[names[1]]
        rows = dict(zip(study.headings, x.T, strict=True)) | {PEAK: peaks}
        table = pd.DataFrame({"trial": np.arange(len(x)), "status": "completed", "message": "", **rows})
        found.append(summarise(study, table, None))
    one, other = (s.sensitivity[PEAK].inputs for s in found)
    for name in names:
        for kind in ("shapley", "sobol_first", "sobol_total", "importance"):
            assert getattr(one[name], kind) == getattr(other[name], kind)
        assert one[name].shapley_ci == other[name].shapley_ci
        low, high = one[name].shapley_ci
        assert 0.0 <= low <= one[name].shapley <= high <= 1.0
        assert one[name].sobol_total < one[name].shapley < one[name].sobol_first
    assert sum(v.shapley for v in one.values()) == pytest.approx(1.0)
    assert any("with what goes along with it (first)" in note for note in found[0].notes)
    text = study_listing(replace(base, correlation=None), replace(found[0], wall_s=1.0))
    assert "Shapley, 95 % interval" in text
    assert StudySummary.from_json(found[0].to_json(), "") == found[0]


def test_an_input_without_a_column_is_named_before_and_after(study6, tmp_path: Path) -> None:
    """It stays at its mean in every row, so that nothing is due to it."""
    path = tmp_path / "rows.csv"
    lines = [f"{0.25 + 0.001 * k:.3f},{k - 15}" for k in range(30)]
    path.write_text("\n".join(["plant.drop_height [m],plant.subtalar_angle_at_contact [deg]", *lines, ""]))
    study = study6.with_inputs(str(path))
    (warning,) = (w for w in study.warnings if "no column" in w)
    assert "brace.angle_scale (1.5)" in warning
    assert "plant.talocrural_angle_at_contact (-34 deg)" in warning
    assert "plant.drop_height" not in warning
    (note,) = (n for n in summarise(study, landings(study), None).notes if "the same in all rows" in n)
    assert "brace.angle_scale" in note
    assert "plant.drop_height" not in note
