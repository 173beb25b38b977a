"""What a shell and a notebook show of a result: short, with its doubt, and nothing that the page would run."""

from __future__ import annotations

import pickle
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

import sprain_cosim as sc
from sprain_cosim.brace.compare import Comparison
from sprain_cosim.cosim.result import PEAK
from sprain_cosim.folders.comparison import ComparisonFolder
from sprain_cosim.folders.read import read_folder
from sprain_cosim.folders.run import RunFolder
from sprain_cosim.folders.study import StudyFolder
from sprain_cosim.notebook import LONGEST, Card
from sprain_cosim.scenario.scenario import Session
from sprain_cosim.study.campaign import Campaign, at_hand
from sprain_cosim.study.plan import Plan
from sprain_cosim.uq.design import DesignResult, GoalCurve, GoalPoint
from sprain_cosim.uq.exceedance import Exceedance
from sprain_cosim.uq.statistics import Estimate

OLD = Path(__file__).parent.parent / "folders_0_1"


@pytest.fixture(scope="module")
def session() -> Iterator[Session]:
    with sc.load_scenario("incline30_brace").with_master(stop="60 ms").open() as opened:
        assert isinstance(opened, Session)
        yield opened


@pytest.fixture(scope="module")
def landing(session: Session) -> sc.Result:
    return session.run()


def campaign(name: str) -> Campaign:
    folder = read_folder(OLD / name)
    assert isinstance(folder, StudyFolder)
    plan = sc.load_study("study6")
    assert isinstance(plan, Plan)
    return Campaign(plan, folder.summary, None, at_hand((folder.trials, folder.trials)))


def test_a_landing_in_brief(landing: sc.Result) -> None:
    line = repr(landing)
    assert len(line) <= LONGEST
    assert line.startswith("Result(completed: peak supination ")
    assert f"{landing.metrics[PEAK]:.2f} deg (what the communication step leaves open is not known)" in line
    assert f"coupling error {100 * (landing.coupling_error or 0.0):.2g} % of the exchanged energy" in line
    judged = replace(landing, halved={PEAK: 0.02})
    assert f"{landing.metrics[PEAK]:.2f} ± 0.04 deg" in repr(judged)
    page = judged._repr_html_()
    assert "± 0.04 deg" in page and page.count("<tr>") == 4 and "<caption" in page and "Result: completed" in page


def test_a_failed_landing_says_why_and_runs_nothing_in_the_page(landing: sc.Result) -> None:
    failed = replace(landing, status="failed", message="<script>no</script>\x1b[31m " + "x" * 5000)
    assert len(repr(failed)) <= LONGEST
    assert "<script>" in repr(failed) and "\x1b" not in repr(failed) and PEAK not in repr(failed)
    assert "&lt;script&gt;" in failed._repr_html_() and "<script>" not in failed._repr_html_()
    assert len(failed._repr_html_()) < 2000


@pytest.mark.parametrize("name", ["study", "search", "form", "light"])
def test_a_study_in_brief(name: str) -> None:
    done = campaign(name)
    for shown in (done, done.summary, read_folder(OLD / name)):
        line = repr(shown)
        assert isinstance(shown, Card)
        assert len(line) <= LONGEST and f"{done.summary.n_completed} of {done.summary.n_requested} landings" in line
        assert "95 %" in line or "own check" in line
        assert "landings completed" in shown._repr_html_()


def test_a_comparison_in_brief() -> None:
    folder = read_folder(OLD / "comparison")
    assert isinstance(folder, ComparisonFolder)
    for shown in (folder, folder.summary, Comparison((), folder.summary, folder.path)):
        assert len(repr(shown)) <= LONGEST
        assert "changes the peak by" in repr(shown) and "a changes" in repr(shown)
        assert all(f">{brace}</th>" in shown._repr_html_() for brace in folder.summary.braces)
    many = {f"brace_{k}": folder.summary.braces["a"] for k in range(50)}
    assert len(repr(replace(folder.summary, braces=many))) <= LONGEST


def test_a_run_folder_in_brief() -> None:
    folder = read_folder(OLD / "run")
    assert isinstance(folder, RunFolder)
    for shown in (folder, folder.summary, folder.result):
        assert len(repr(shown)) <= LONGEST and "peak supination" in repr(shown)


def test_a_design_in_brief() -> None:
    rows = np.linspace(0.0, 3.0, 500)
    curve, certain = GoalCurve(rows, rows, rows, rows), Estimate(0.05, 0.04, 0.06)
    probability = Exceedance(0.05, certain, None, {}, None, None, 100)
    point = GoalPoint(None, "met", 1.25, 1.1, 1.4, 1.4, probability, None, curve, 100, 0)
    found = DesignResult("least", (point,) * 9, 300, 2, 0.97, 0.5)
    assert len(repr(found)) <= LONGEST
    assert "met 1.25 (95 %: 1.1 ... 1.4)" in repr(found) and "6 more" in repr(found)


def test_results_draw_themselves(landing: sc.Result) -> None:
    figure = landing.plot()
    assert isinstance(figure, Figure) and len(figure.axes[0].lines) > 0
    copied = pickle.loads(pickle.dumps(landing.plot("moment_angle")))
    assert isinstance(copied, Figure) and copied._repr_png_()[:4] == b"\x89PNG"  # type: ignore[attr-defined]
    with pytest.raises(sc.InputError, match=r"plot\('cdf'\): there is no such figure, but landing, moment_angle$"):
        landing.plot("cdf")
    with pytest.raises(sc.InputError, match="nothing to draw"):
        replace(landing, time=landing.time[:0], values=landing.values[:0], status="failed").plot()


def test_a_study_without_a_folder_draws_its_distribution() -> None:
    done = campaign("light")
    assert len(done.plot("cdf").axes[0].lines) > 0
    with pytest.raises(sc.InputError, match="a study with a folder"):
        done.plot("tornado")


@pytest.mark.parametrize("name", ["run", "study", "comparison"])
def test_a_folder_opens_and_draws_itself(name: str) -> None:
    folder = sc.open_folder(str(OLD / name))
    assert type(folder).__name__ == f"{name.capitalize()}Folder"
    assert isinstance(folder.plot(), Figure)
    if name == "study":
        return
    with pytest.raises(sc.InputError, match=r"plot\('film'\): there is no such figure, but "):
        folder.plot("film")


def test_finished_objects_draw_what_their_folder_holds() -> None:
    comparison, study = sc.open_folder(OLD / "comparison"), sc.open_folder(OLD / "study")
    assert isinstance(comparison, ComparisonFolder) and isinstance(study, StudyFolder)
    assert isinstance(Comparison((), comparison.summary, comparison.path).plot("paired"), Figure)
    assert isinstance(replace(campaign("study"), out=study.path).plot("cdf"), Figure)


def test_a_folder_that_is_none_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(sc.InputError, match="no such folder"):
        sc.open_folder(tmp_path / "nothing")


def test_signals_say_their_units(landing: sc.Result) -> None:
    assert "plant.subtalar_angle [rad]" in landing.labelled_signals
    assert landing.signals.attrs["units"]["plant.subtalar_angle"] == "rad"
    assert landing.csv().startswith(",".join(["time [s]", *landing.labelled_signals.columns]) + "\n")


def test_values_with_units_in_a_session(session: Session, landing: sc.Result) -> None:
    high = session.run({"plant.drop_height": "35 cm"})
    assert high.metrics == session.run({"plant.drop_height": 0.35}).metrics
    assert high.metrics[PEAK] > landing.metrics[PEAK]
    assert session.run({"plant.drop_height": np.float64(0.25)}).status == "completed"


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("plant.drop_height", "35", "needs a unit"),
        ("plant.drop_height", "35 deg", "plant.drop_height"),
        ("plant.drop_height", "high", "plant.drop_height = 'high'"),
        ("plant.drop_hight", "35 cm", "drop_height"),
        ("plant.drop_hight", 0.35, "drop_height"),
        ("plnat.drop_height", 0.35, "no component"),
        ("plant.subtalar_angle", "3 deg", "not a parameter"),
        ("plant.drop_height", None, "expected a number in m"),
        ("plant.drop_height", [0.3], "expected a number in m"),
        ("plant.drop_height", "-5 m", "outside its range"),
    ],
)
def test_a_value_that_does_not_fit_is_refused(session: Session, name: str, value: object, words: str) -> None:
    with pytest.raises(sc.InputError, match=words):
        session.run({name: value})  # type: ignore[dict-item]
