"""Braces side by side: the numbers are those of the single runs, rows of a study are the same landings, a crash costs
one column."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from fmus.brace_bushing.device import POLYNOMIALS
from sprain_cosim import InputError, SimulationError, load_scenario, load_study
from sprain_cosim.brace.bench import Bench
from sprain_cosim.brace.compare import compare_braces, load_source
from sprain_cosim.brace.comparison import LINES, Entry, comparison_listing, summarise_comparison
from sprain_cosim.brace.decision import FIRST, land_until_decided
from sprain_cosim.brace.estimates import injury_change
from sprain_cosim.folders.comparison import ComparisonSummary
from sprain_cosim.folders.read import read_folder
from sprain_cosim.process import Limits
from sprain_cosim.report.verdict import verdicts
from sprain_cosim.study.reproduce import reproduce
from sprain_cosim.uq.distributions import Normal
from sprain_cosim.uq.exceedance import doubted_exceedance
from sprain_cosim.uq.sequential import planned_looks, spent
from sprain_cosim.uq.statistics import mean
from tests.docs_commands import ROOT
from tests.native import compile_fmu


@pytest.fixture(scope="module")
def landing(tmp_path_factory: pytest.TempPathFactory):
    """One landing; a device that crashes among the braces."""
    folder = tmp_path_factory.mktemp("landing")
    bad = compile_fmu(folder / "bad.fmu", fault="segfault")
    return compare_braces(
        "incline30",
        {"stiff": "brace_bushing", "bad": bad, "linear": "brace_linear"},
        settings={"stiff.angle_scale": 2.4},
        out=folder / "out",
    )


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory):
    out = tmp_path_factory.mktemp("study") / "out"
    return compare_braces(
        "study6",
        {"paper": "brace_bushing", "linear": "brace_linear"},
        settings={"paper.angle_scale": 2.4},
        out=out,
        trials=8,
        workers=1,
    )


def test_a_landing_is_that_of_run(landing) -> None:
    braces = landing.summary["braces"]
    for name, scenario in (("none", load_scenario("incline30")), ("stiff", load_scenario("incline30_brace"))):
        result = scenario.run(halve=True)
        for key in ("peak_subtalar_angle_deg", "peak_inversion_from_neutral_deg", "peak_jcs_inversion_deg"):
            assert braces[name]["metrics"][key]["value"] == result.metrics[key]
        assert 0 < braces[name]["coupling_doubt_deg"] == result.coupling_doubt
    stiff, none = (braces[n]["metrics"] for n in ("stiff", "none"))
    assert braces["stiff"]["difference_to_none"]["peak_subtalar_angle_deg"]["value"] == pytest.approx(
        stiff["peak_subtalar_angle_deg"]["value"] - none["peak_subtalar_angle_deg"]["value"], abs=1e-12
    )
    assert "brace_work_J" not in none
    assert stiff["anatomy_share"]["value"] == pytest.approx(
        1 / (1 + stiff["brace_subtalar_moment_Nm"]["value"] / stiff["anatomy_subtalar_moment_Nm"]["value"])
    )
    pair = landing.summary["pairs"]["linear - stiff"]["peak_subtalar_angle_deg"]["value"]
    assert pair == pytest.approx(
        braces["linear"]["metrics"]["peak_subtalar_angle_deg"]["value"] - stiff["peak_subtalar_angle_deg"]["value"],
        abs=1e-12,
    )


def test_work_of_the_torques_is_work_of_the_moments(landing) -> None:
    """The foot has two degrees of freedom under the shank: torque times Euler angle on three axes is moment times angle
    on those two."""
    for name in ("stiff", "linear"):
        signals = pd.read_csv(landing.out / name / "signals.csv")
        work = sum(
            np.trapezoid(signals[f"plant.brace_{axis}_moment "
                                 "[N.m]"], signals[f"plant.{axis}_angle [rad]"]) for axis in ("talocrural", "subtalar")
        )  # fmt: skip
        value = landing.summary["braces"][name]["metrics"]["brace_work_J"]["value"]
        assert value == pytest.approx(work, abs=0.02)


def test_ordinary_motion(landing) -> None:
    """A linear brace: stiffness times angle about its axis, nothing about the other. The bushing: its torques projected
    on the axis, the Euler angles taken from the plant at two neighbouring postures."""
    linear, stiff = (landing.summary["braces"][n]["resistance_Nm"] for n in ("linear", "stiff"))
    assert linear["supination_10deg"] == pytest.approx(30 * math.radians(10), rel=1e-9)
    assert linear["supination_5deg"] == pytest.approx(30 * math.radians(5), rel=1e-9)
    assert linear["plantarflexion_10deg"] == pytest.approx(0, abs=1e-12)
    rest = load_scenario("incline30").with_master(stop="0.5 ms")
    for posture, axis, degrees in (("supination_10deg", "subtalar", 10.0), ("plantarflexion_5deg", "talocrural", -5.0)):
        angles = []
        for d in (degrees - 0.01, degrees, degrees + 0.01):
            at = {"talocrural": 0.0, "subtalar": 0.0, axis: d}
            scenario = rest
            for a, value in at.items():
                scenario = scenario.override(f"plant.{a}_angle_at_contact", f"{value} deg")
            result = scenario.run()
            angles.append(np.array([result[f"plant.rotation_{k}_angle"][0] for k in "xyz"]))
        torque = np.array(
            [-np.polyval([c, b, a, 0.0], 2.4 * t) for t, (a, b, c) in zip(angles[1], POLYNOMIALS, strict=True)]
        )
        projected = torque @ (angles[2] - angles[0]) / math.radians(0.02)
        assert stiff[posture] == pytest.approx(-math.copysign(1, degrees) * projected, rel=1e-4)


def test_the_tutorial_shows_what_comes_out(landing) -> None:
    """Its columns of one landing that this one has too, number by number."""
    page = (
        (ROOT / "docs" / "vendor-tutorial.md")
        .read_text()
        .partition("incline30  ·  ")[2]
        .partition("landings completed")[0]
    )
    shown = {line[:44].strip(): line[44:] for line in page.splitlines() if line.strip()}
    columns = shown[""].split()
    assert "doubt of the step" in shown
    for label, key, factor in LINES:
        cells = [c for c in shown[label.strip()].replace(" / ", "/").split() if c]
        for name in ("none", "stiff"):
            metric = landing.summary["braces"][name]["metrics"].get(key)
            if metric is not None:
                place = columns.index(name) - len(columns)  # what none lacks is blank in front
                assert cells[place] == f"{factor * metric['value']:.2f}", (label, name)


def test_a_crash_costs_its_own_column(landing) -> None:
    assert [e.name for e in landing.failed] == ["bad"]
    bad = landing.summary["braces"]["bad"]
    assert bad["status"] == "failed"
    assert "SIGSEGV" in bad["message"] and not bad["message"].startswith("brace: ")  # every line of it begins "bad: "
    assert bad["metrics"] == {}
    printed = comparison_listing(landing.summary)
    assert "bad: failed: " in printed
    assert f"{landing.summary['braces']['linear']['metrics']['peak_subtalar_angle_deg']['value']:.2f}" in printed
    held = json.loads((landing.out / "compare.json").read_text())
    assert held == landing.summary.to_json()
    assert sorted(p.name for p in landing.out.iterdir()) == ["compare.json", "figures", "linear", "none", "stiff"]


def test_the_figure_has_units_signs_and_a_column_s_width(landing) -> None:
    drawn = (landing.out / "figures" / "compare.svg").read_text()
    for words in (
        "[deg], + supination",
        "[deg], − less than",
        "[N·m], + resists supination",
        "[N·m], + resists the motion",
        "time after contact [ms]",
        "Failed: bad",
    ):
        assert words in drawn
    picture = (landing.out / "figures" / "compare.png").read_bytes()
    assert int.from_bytes(picture[16:20]) == pytest.approx(8.5 / 2.54 * 300, abs=1)


def test_a_hang_ends_with_its_child(tmp_path: Path) -> None:
    device = compile_fmu(tmp_path / "hangs.fmu", fault="hang_step")
    with Bench(load_scenario("incline30").replace_fmu("brace", device), Limits(trial=1.0)) as bench:
        with pytest.raises(SimulationError, match="overran its limit of wall time"):
            bench.land(tmp_path / "out")
        assert bench._child is not None
        bench.close()
    assert not (tmp_path / "out").exists()


def test_what_the_guard_refuses_is_a_failed_brace(tmp_path: Path) -> None:
    scenario = load_scenario("incline30").with_master(scheme="jacobi")
    found = compare_braces(
        scenario,
        {"steep": "brace_linear"},
        settings={"steep.subtalar_stiffness_coefficient": "9000 N.m/rad"},
        out=tmp_path / "jacobi",
    )
    assert "jacobi" in found.failed[0].message


def test_rows_of_a_study_are_the_same_landings(study, tmp_path: Path) -> None:
    """Whatever the brace, and those that the study itself draws; the folder of a brace is that of a study."""
    tables = {n: pd.read_csv(study.out / n / "trials.csv") for n in ("none", "paper", "linear")}
    shared = [c for c in tables["none"] if c.startswith(("plant.", "controller."))]
    assert len(shared) >= 8
    for name in ("paper", "linear"):
        pd.testing.assert_frame_equal(tables[name][shared], tables["none"][shared], check_exact=True)
    assert (tables["paper"]["brace.angle_scale"] == 2.4).all()
    own = load_study("study6")
    alone = own.replace_fmu("brace", "brace_bushing").override("brace.angle_scale", 2.4).run(trials=8, workers=1)
    assert np.array_equal(alone.trials["peak_subtalar_angle_deg"], tables["paper"]["peak_subtalar_angle_deg"])
    assert json.loads((study.out / "linear" / "summary.json").read_text())["n_completed"] == 8


def test_differences_of_a_study_are_paired(study) -> None:
    key = "peak_subtalar_angle_deg"
    tables = {n: pd.read_csv(study.out / n / "trials.csv")[key] for n in ("none", "paper", "linear")}
    for name, other, found in (
        ("paper", "none", study.summary["braces"]["paper"]["difference_to_none"][key]),
        ("linear", "paper", study.summary["pairs"]["linear - paper"][key]),
    ):
        test = stats.ttest_rel(tables[name], tables[other])
        interval = test.confidence_interval(0.95)
        assert found["value"] == pytest.approx((tables[name] - tables[other]).mean(), rel=1e-9)
        assert (found["ci_low"], found["ci_high"]) == (
            pytest.approx(interval.low, rel=1e-9),
            pytest.approx(interval.high, rel=1e-9),
        )
        assert found["n"] == 8
    apart = stats.ttest_ind(tables["paper"], tables["none"]).confidence_interval(0.95)
    paired = study.summary["braces"]["paper"]["difference_to_none"][key]
    assert paired["ci_high"] - paired["ci_low"] < apart.high - apart.low
    risk = study.summary["braces"]["none"]["metrics"]["probability_of_injury"]["value"]
    inversion = pd.read_csv(study.out / "none" / "trials.csv")["peak_inversion_from_neutral_deg"]
    assert risk == pytest.approx(stats.norm(35, 6).cdf(inversion).mean(), rel=1e-9)


def test_a_probability_has_both_doubts_of_its_study(study) -> None:
    """The interval that a study states for its question, and the other shapes of the threshold."""
    for name in ("none", "paper", "linear"):
        inversion = pd.read_csv(study.out / name / "trials.csv")["peak_inversion_from_neutral_deg"]
        own = doubted_exceedance(inversion, Normal(35, 6))
        brace = study.summary["braces"][name]
        risk = brace["metrics"]["probability_of_injury"]
        assert (risk["ci_low"], risk["ci_high"]) == pytest.approx((own.sampling.low, own.sampling.high), rel=1e-9)
        assert brace["injury_shapes"] == pytest.approx(own.shapes, rel=1e-9)
    printed = comparison_listing(study.summary).splitlines()
    at = next(k for k, line in enumerate(printed) if line.startswith("P(inversion"))
    assert printed[at].count("±") == 1, "that of the threshold, in the label"
    shapes = sorted(own.shapes.values())
    assert printed[at + 4].strip().startswith("as far as the landings know it")
    for line, ends in ((printed[at + 1], (own.sampling.low, own.sampling.high)), (printed[at + 2], shapes[::2])):
        assert line.endswith(" ... ".join(f"{100 * end:.2g}" for end in ends))


@pytest.mark.parametrize("n", [24, 200])
def test_the_change_of_a_rare_injury_has_an_interval_that_holds(n: int) -> None:
    """Student's ended above the truth in 0.43 and 0.22 of the comparisons: few landings come near the threshold."""
    rng = np.random.default_rng(4)

    def landed(rows: int) -> tuple[np.ndarray, np.ndarray]:
        z = rng.standard_normal(rows)
        bare = 15.0 + 3.0 * z + 0.9 * (z**2 - 1.0)
        return 0.7 * bare + 1.5 * rng.standard_normal(rows), bare

    truth = injury_change(*landed(2_000_000), random=False).value
    found = [injury_change(*landed(n), random=True) for _ in range(200)]
    assert np.mean([e.ci_low <= truth <= e.ci_high for e in found]) >= 0.95


def test_several_braces_hear_that_each_interval_holds_by_itself() -> None:
    entries = [_entry(name, _noise(k), 30) for k, name in enumerate(("none", "a", "b", "c"))]
    study6 = replace(load_study("study6"), trials=30)
    assert "the 3 differences of braces all hold with 85 % at the least" in comparison_listing(
        summarise_comparison(study6, entries)
    )
    assert "by itself" not in comparison_listing(summarise_comparison(study6, entries[:3]))


def test_held_at_the_value_that_was_set(study) -> None:
    """Not at the study's own mean of 150 %."""
    assert study.summary["braces"]["paper"]["resistance_Nm"]["supination_10deg"] == pytest.approx(5.79, abs=0.01)


def test_a_study_goes_on(study) -> None:
    with pytest.raises(InputError, match="--resume"):
        compare_braces("study6", {"paper": "brace_bushing", "linear": "brace_linear"}, out=study.out, trials=8)
    with pytest.raises(
        InputError, match=r"holds another study \(marginals\.brace\.angle_scale"
    ):  # other parameters than the folder was made with
        compare_braces(
            "study6",
            {"paper": "brace_bushing", "linear": "brace_linear"},
            out=study.out,
            trials=8,
            workers=1,
            resume=True,
        )
    again = compare_braces(
        "study6",
        {"paper": "brace_bushing", "linear": "brace_linear"},
        settings={"paper.angle_scale": 2.4},
        out=study.out,
        trials=8,
        workers=1,
        resume=True,
    )
    assert again.summary == study.summary


@pytest.mark.parametrize(
    ("source", "braces", "settings", "message"),
    [
        ("incline30", {}, {}, "at least one brace"),
        ("incline30", {"none": "brace_bushing"}, {}, "--brace none=.*none of none, plant"),
        ("incline30", {"a-b": "brace_bushing"}, {}, "letters, digits and _"),
        ("incline30", {"soft": "brace_bushin"}, {}, "--brace soft=brace_bushin: .*did you mean brace_bushing"),
        (
            "incline30",
            {"soft": "brace_bushing"},
            {"soft.angle_scal": 2.0},
            r"--set soft\.angle_scal: .*did you mean angle_scale",
        ),
        ("incline30", {"soft": "brace_bushing"}, {"brace.angle_scale": 2.0}, r"say whose, such as soft\.angle_scale"),
        ("incline30", {"soft": "brace_bushing"}, {"plant.drop_hight": "0.3 m"}, "did you mean drop_height"),
        ("incline30", {"soft": "plant"}, {}, "soft: "),
        ("amv6", {"soft": "brace_bushing"}, {}, "method amv chooses its landings.*study6"),
        ("incline31", {"soft": "brace_bushing"}, {}, "did you mean incline30"),
    ],
)
def test_refused_before_anything_runs(source: str, braces: dict, settings: dict, message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=message) as caught:
        compare_braces(source, braces, settings=settings, out=tmp_path / "out")
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "out").exists()


def test_trials_belong_to_a_study(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="--trials 5: incline30 is one landing"):
        compare_braces("incline30", {"soft": "brace_bushing"}, out=tmp_path / "out", trials=5)


def test_other_files_are_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("precious")
    with pytest.raises(InputError, match=r"holds other files \(thesis.tex\)"):
        compare_braces("incline30", {"soft": "brace_bushing"}, out=tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["thesis.tex"]


def test_scenario_or_study_by_what_the_file_says(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text('base = "incline30"\n')
    (tmp_path / "b.toml").write_text(
        'scenario = "incline30"\n[marginals]\n"plant.drop_height" = { normal = { mean = "0.3 m", sd = "0.01 m" } }\n'
    )
    assert type(load_source(str(tmp_path / "a.toml"))).__name__ == "Scenario"
    assert type(load_source(str(tmp_path / "b.toml"))).__name__ == "Study"
    assert type(load_source("study2")).__name__ == "Study"


# ---- pairs that stop when they are decided

PEAK = "peak_subtalar_angle_deg"


def _noise(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal(200)


def _entry(name: str, peaks: np.ndarray, rows: int) -> Entry:
    """A brace whose landing i peaks at peaks[i]; NaN for one that failed."""
    status = np.where(np.isnan(peaks[:rows]), "failed", "completed")
    return Entry(name, name, landings=pd.DataFrame({"trial": range(rows), "status": status, PEAK: peaks[:rows]}))


def _decided(peaks: dict[str, np.ndarray], trials: int, failing: tuple[str, int] | None = None):
    """`failing`: a brace and the landings at which it fails."""

    def land(name: str, rows: int, before: Entry | None) -> Entry:
        if failing is not None and name == failing[0] and rows >= failing[1]:
            return Entry(name, name, "failed", "the strap broke")
        return _entry(name, peaks[name], rows)

    return land_until_decided(["none", *(n for n in peaks if n != "none")], range(trials), land)


def test_looks_depend_on_the_number_of_landings_alone() -> None:
    assert planned_looks(1000, FIRST) == [10, 20, 30, 50, 80, 120, 180, 270, 410, 620, 930, 1000]
    assert planned_looks(10, FIRST) == [10]
    assert planned_looks(24, FIRST) == [10, 20, 24]


def test_a_brace_stops_when_its_last_pair_is_decided() -> None:
    peaks = {"none": _noise(0) + 5, "a": _noise(1), "b": _noise(2) - 9, "c": _noise(3)}
    entries, made, found = _decided(peaks, 100)
    assert made == [10, 20, 30, 50, 80, 100]
    assert {e.name: len(e.landings) for e in entries} == {"none": 100, "a": 100, "b": 10, "c": 100}
    assert (found.at_most, found.landed, found.saved) == (100, 310, 90)
    assert {pair: (d.lower, d.higher, d.n, len(d.looks)) for pair, d in found.pairs.items()} == {
        "b - a": ("b", "a", 10, 1),
        "c - a": (None, None, 100, 6),
        "c - b": ("b", "c", 10, 1),
    }
    assert found.lowest("abc") == "b"
    for d in found.pairs.values():
        for look in d.looks:
            assert (look.p_value <= look.level) == (look.ci_low * look.ci_high > 0.0)
    assert found.pairs["c - a"].looks[1].level == pytest.approx(spent(2))  # the only pair that is left
    assert found.pairs["b - a"].looks[0].value == pytest.approx((peaks["b"] - peaks["a"])[:10].mean())


def test_the_intervals_of_braces_that_stopped_are_those_of_their_looks() -> None:
    """At a level that holds for all looks: those of a difference at the look of the brace that stopped first."""
    peaks = {"none": _noise(0) + 5, "a": _noise(1), "b": _noise(2) - 9, "c": _noise(3)}
    entries, made, found = _decided(peaks, 30)
    summary = summarise_comparison(replace(load_study("study6"), trials=30), entries, made, found)
    for estimate, values, look in (
        (summary.braces["b"].metrics[PEAK], peaks["b"][:10], 1),
        (summary.braces["b"].difference_to_none[PEAK], (peaks["b"] - peaks["none"])[:10], 1),
        (summary.pairs["c - a"][PEAK], (peaks["c"] - peaks["a"])[:30], 3),
    ):
        interval = mean(values, 1 - spent(look), skewed=True)
        student = stats.ttest_1samp(values, 0).confidence_interval(1 - spent(look))
        assert interval.low <= student.low + 1e-9 and student.high - 1e-9 <= interval.high
        assert (estimate.ci_low, estimate.ci_high) == (pytest.approx(interval.low), pytest.approx(interval.high))
    printed = comparison_listing(summary)
    assert "at most 30 landings" in printed
    assert "10 of 10" in printed
    assert "b below a: decided after 10 paired landings; " in printed
    assert "c - a: undecided after 30 paired landings; difference " in printed
    assert f"{found.landed} landings made, {found.saved} of 120 saved" in printed
    assert ComparisonSummary.from_json(json.loads(json.dumps(summary.to_json())), "compare.json").decisions == found


def test_a_failed_brace_leaves_the_comparison_and_failed_landings_the_differences() -> None:
    peaks = {"none": _noise(0), "a": _noise(1), "b": _noise(2) - 9, "c": _noise(3)}
    entries, made, found = _decided(peaks, 50, ("c", 20))
    assert [e.status for e in entries] == ["completed", "completed", "completed", "failed"]
    assert made == [10, 20]
    assert {pair: d.n for pair, d in found.pairs.items()} == {"b - a": 10}
    assert found.saved == 150 - found.landed == 150 - 50
    peaks["b"][[2, 5]] = np.nan
    assert _decided({n: peaks[n] for n in ("none", "a", "b")}, 50)[2].pairs["b - a"].n == 8
    peaks["b"][:] = np.nan
    dead = _decided({n: peaks[n] for n in ("none", "a", "b")}, 50)[2].pairs["b - a"]
    assert (dead.lower, dead.n, dead.looks[-1].p_value, dead.looks[-1].ci_low) == (None, 0, 1.0, None)


@pytest.fixture(scope="module")
def scales(tmp_path_factory: pytest.TempPathFactory):
    return _scales(tmp_path_factory.mktemp("decided") / "out", workers=1)


def _scales(out: Path, **options):
    """The bushing with its angle scaled by 1.5 and by 1.6."""
    braces = {"a": "brace_bushing", "b": "brace_bushing"}
    values = {"a.angle_scale": 1.5, "b.angle_scale": 1.6}
    return compare_braces("study6", braces, settings=values, decide=True, out=out, **options)


def test_braces_that_the_landings_cannot_tell_apart_are_not_ranked(tmp_path: Path) -> None:
    """Twice the same brace, and one that is plainly stiffer: whichever came first had lowered the peak most of all."""
    braces = {"a": "brace_bushing", "b": "brace_bushing", "stiff": "brace_bushing"}
    alike = compare_braces("study6", {k: braces[k] for k in "ab"}, trials=20, out=tmp_path / "alike")
    verdict = verdicts([read_folder(alike.out)], [])[0]
    said = verdict.text
    assert "least" not in verdict.headline
    assert "These landings cannot tell a from b." in said
    settings = {"a.angle_scale": 1.5, "stiff.angle_scale": 2.4}
    apart = {k: braces[k] for k in ("a", "stiff")}
    told = compare_braces("study6", apart, settings=settings, trials=20, out=tmp_path / "apart")
    verdict = verdicts([read_folder(told.out)], [])[0]
    assert "With <b>stiff</b> the ankle rolls least" in verdict.headline
    assert "cannot tell" not in verdict.text


@pytest.mark.long
def test_scale_1_5_against_1_6_is_decided_in_twenty_pairs(scales) -> None:
    """On the model that ships; 1000 landings were allowed."""
    found = scales.summary.decisions
    pair = found.pairs["b - a"]
    assert (pair.lower, pair.higher) == ("b", "a")
    assert pair.n <= 20
    assert found.saved >= 3000 - 3 * 20
    table = pd.read_csv(scales.out / "b" / "trials.csv")
    assert len(table) == pair.n
    difference = table[PEAK] - pd.read_csv(scales.out / "a" / "trials.csv")[PEAK]
    assert pair.looks[-1].value == pytest.approx(difference.mean(), rel=1e-9)
    assert pair.looks[-1].ci_high < 0.0
    assert json.loads((scales.out / "a" / "summary.json").read_text())["n_requested"] == pair.n
    verdict = verdicts([read_folder(scales.out)], [])[0]
    said = verdict.text
    assert f"<b>b</b> keeps the peak lower than a: decided after {pair.n} paired landings, by 0." in said
    assert f"{found.saved} of 3000 landings were saved" in said
    assert "With <b>b</b> the ankle rolls least" in verdict.headline


@pytest.mark.long
def test_what_is_decided_is_the_same_for_any_workers_and_after_an_interruption(scales, tmp_path: Path) -> None:
    def stop(text: str) -> None:
        if text.startswith("none"):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        _scales(tmp_path / "out", workers=2, say=stop)
    with pytest.raises(InputError, match="--resume"):
        _scales(tmp_path / "out")
    assert _scales(tmp_path / "out", workers=2, resume=True).summary == scales.summary
    assert _scales(tmp_path / "out", workers=1, resume=True).summary == scales.summary
    again = reproduce(scales.out / "b", tmp_path / "again", workers=1)
    assert (again.identical, again.trials) == (True, scales.summary.decisions.pairs["b - a"].n)
    more = tmp_path / "more"  # one pair that is never decided
    same = {"a": "brace_linear", "b": "brace_linear"}
    first = compare_braces("study6", same, decide=True, trials=12, out=more, workers=2)
    assert [k.n for k in first.summary.decisions.pairs["b - a"].looks] == [10, 12]
    assert first.summary.decisions.saved == 0


@pytest.mark.parametrize(
    ("source", "braces", "trials", "message"),
    [
        ("incline30", "ab", None, "--decide: incline30 is one landing; name a study"),
        ("study6", "a", None, "--decide: compares braces with each other; name a second"),
        ("study6", "ab", 9, "--decide: 9 landings are fewer than the 10 of the first look"),
        ("demers2017", "ab", None, "--decide: demers2017: method grid fills its sample as a whole"),
        ("amv6", "ab", None, "method amv chooses its landings.*study6"),
    ],
)
def test_what_cannot_be_decided_is_refused(
    source: str, braces: str, trials: int | None, message: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=message) as caught:
        compare_braces(source, dict.fromkeys(braces, "brace_linear"), decide=True, trials=trials, out=tmp_path / "out")
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "out").exists()
