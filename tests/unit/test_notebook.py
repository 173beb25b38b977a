"""What a shell and a notebook show of a result: short, with its doubt, and nothing that the page would run."""

from __future__ import annotations

import gzip
import pickle
import shutil
import sys
import types
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

import sprain_cosim as sc
from sprain_cosim.brace.compare import Comparison
from sprain_cosim.brace.fit import FitReport
from sprain_cosim.cosim.result import PEAK
from sprain_cosim.dataset import cf_unit
from sprain_cosim.folders.comparison import ComparisonFolder
from sprain_cosim.folders.read import read_folder
from sprain_cosim.folders.run import RunFolder
from sprain_cosim.folders.study import StudyFolder
from sprain_cosim.notebook import LONGEST, Card, with_interval
from sprain_cosim.scenario.scenario import Session
from sprain_cosim.study.campaign import Campaign, at_hand
from sprain_cosim.study.plan import Plan
from sprain_cosim.study.progress import shown_to
from sprain_cosim.study.summary import Probability
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
    assert "the foot still turned at the stop (60 ms)" in line
    judged = replace(landing, halved={PEAK: 0.02}, warning="")
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
    point = GoalPoint(None, "met", 1.25, 1.1, 1.4, 1.4, probability, 0.05, None, curve, 100, 0)
    found = DesignResult("least", (point,) * 9, 300, 2, 0.97, 0.5)
    assert len(repr(found)) <= LONGEST
    assert "met 1.25 (95 %: 1.1 ... 1.4)" in repr(found) and "6 more" in repr(found)


def test_descriptions_in_brief(tmp_path: Path) -> None:
    braced, study = sc.load_scenario("incline30_brace"), sc.load_study("study6")
    law = sc.PythonComponent.define("brace", inputs={"u": "rad"}, outputs={"y": "N.m"}, output=lambda s, v: {"y": 0.0})
    report = FitReport("<b>.fmu", problems=["<script>"] * 50)
    for shown in (braced, study, braced.system(), *braced.components(), law, report):
        assert isinstance(shown, Card)
        assert 40 < len(repr(shown)) <= LONGEST, repr(shown)
        assert "<caption" in shown._repr_html_() and "<script>" not in shown._repr_html_()
    assert "plant.drop_height 0.30 m" in repr(braced) and "240 % brace" in repr(braced)
    assert "talocrural_angle_at_contact</th>" in study._repr_html_() and "mean -34 deg, SD 5 deg" in study._repr_html_()
    assert "inputs u [rad]; outputs y [N.m]; parameters none" in repr(law)
    gone = replace(braced, fmus={"plant": tmp_path / "gone.fmu"})
    assert len(repr(gone)) <= LONGEST


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


def test_columns_of_trials_say_their_units() -> None:
    for trials in (campaign("study").trials, sc.open_folder(OLD / "study").trials):  # type: ignore[union-attr]
        units = trials.attrs["units"]
        assert units["plant.drop_height [m]"] == "m" and units[PEAK] == "deg"
        assert set(units) <= set(trials.columns) and "status" not in units


def test_signals_as_labelled_arrays(landing: sc.Result, tmp_path: Path) -> None:
    pytest.importorskip("xarray", reason="the extra [xarray] is not installed")
    data = landing.to_xarray()
    angle = data["plant.subtalar_angle"]
    assert angle.dims == ("time",) and np.array_equal(angle, landing["plant.subtalar_angle"])
    assert angle.attrs == {"units": "rad", "long_name": "subtalar angle (plant)"}
    assert data["time"].attrs["units"] == "s" and data["brace.rotation_x_torque"].attrs["units"] == "N m"
    assert data.attrs["status"] == "completed" and data.attrs["coupling_error"] == landing.coupling_error
    assert "coupling_doubt_deg" not in data.attrs  # not known
    data.to_netcdf(tmp_path / "landing.nc", engine="scipy")


def test_trials_as_labelled_arrays(landing: sc.Result, tmp_path: Path) -> None:
    """Trial 3 has its signals, trial 5 those until it ended early, the others none."""
    pytest.importorskip("xarray", reason="the extra [xarray] is not installed")
    place = tmp_path / "study"
    shutil.copytree(OLD / "study", place)
    (place / "trajectories").mkdir()
    for number, rows in ((3, 121), (5, 11)):
        short = replace(landing, time=landing.time[:rows], values=landing.values[:rows])
        (place / "trajectories" / f"{number:06d}.csv.gz").write_bytes(gzip.compress(short.csv().encode()))
    folder = sc.open_folder(place)
    assert isinstance(folder, StudyFolder)
    data = folder.to_xarray("plant.subtalar_angle")
    assert data.sizes == {"trial": 24, "time": 121} and data.attrs["n_completed"] == 24
    assert data["plant.drop_height"].attrs["units"] == "m" and data["status"].dtype.kind == "U"
    assert data[PEAK].attrs == {"units": "degree", "long_name": "largest supination about the subtalar axis"}
    angle = data["plant.subtalar_angle"]
    assert angle.sel(trial=3).to_numpy() == pytest.approx(landing["plant.subtalar_angle"], rel=1e-9)
    assert angle.notnull().sum("time").to_numpy()[[0, 3, 5]].tolist() == [0, 121, 11]
    with pytest.raises(sc.InputError, match=r"not recorded \(did you mean plant.subtalar_angle\?\)"):
        folder.to_xarray(["plant.subtalar_angel"])
    with pytest.raises(sc.InputError, match="no trial has its signals"):
        campaign("light").to_xarray(["plant.subtalar_angle"])


def test_without_xarray_the_extra_is_named(landing: sc.Result, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(sc.EnvironmentProblem, match=r'pip install "sprain-cosim\[xarray\]"$'):
        landing.to_xarray()


@pytest.mark.parametrize(
    ("ours", "theirs"),
    [("N.m", "N m"), ("N·m", "N m"), ("deg/s", "degree/s"), ("", "1"), ("N.m.s/rad", "N m s/rad"), ("m/s2", "m/s2")],
)
def test_units_as_other_tools_read_them(ours: str, theirs: str) -> None:
    assert cf_unit(ours) == theirs


class FakeNotebook:
    """What a kernel has of IPython: `shown` are the texts of each place under the cell."""

    def __init__(self, kernel: object) -> None:
        self.shown: list[list[Any]] = []
        self.module: Any = types.ModuleType("IPython")
        self.module.get_ipython = lambda: types.SimpleNamespace(kernel=kernel, InteractiveTB=self)
        self.display: Any = types.ModuleType("IPython.display")
        self.display.display = self._display

    def _display(self, item: object, display_id: bool) -> object:
        assert display_id
        place = [item]
        self.shown.append(place)
        return types.SimpleNamespace(update=place.append)

    def structured_traceback(self, kind: type, error: Exception, stack: Any, tb_offset: int) -> list[str]:
        assert tb_offset == 0 and error.__cause__ is None
        self.frames = []
        while stack is not None:
            self.frames.append(stack.tb_frame.f_code.co_name)
            stack = stack.tb_next
        return [f"{kind.__name__}: {error}"]

    def install(self, patch: pytest.MonkeyPatch) -> FakeNotebook:
        patch.setitem(sys.modules, "IPython", self.module)
        patch.setitem(sys.modules, "IPython.display", self.display)
        return self


def test_progress_renews_itself_under_a_cell(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    notebook = FakeNotebook(object()).install(monkeypatch)
    report = shown_to("auto")
    assert report is not None
    for finished in (0, 4, 8, 3):  # a study, and another part of it
        report(finished, 8, 1, float(finished))
    [[_, half, last, again]] = notebook.shown
    assert repr(half) == "4 of 8 trials, 1 failed, 1.0/s, 4 s left"
    assert repr(last) == "8 of 8 trials, 1 failed" and 'value="1.000"' in last._repr_html_()
    assert repr(again).startswith("3 of 8 trials")
    assert capsys.readouterr() == ("", "")


def test_progress_is_silent_in_a_pipe(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "IPython", raising=False)
    assert shown_to("auto") is None  # pytest's stderr is no terminal
    FakeNotebook(None).install(monkeypatch)  # IPython in a pipe
    assert shown_to("auto") is None and shown_to(None) is None and shown_to("none") is None
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    assert shown_to("auto") is not None
    with pytest.raises(sc.InputError, match=r"progress = 'atuo': no such kind \(did you mean auto\?\)"):
        sc.load_study("study6").run(trials=1, progress="atuo")


def test_an_error_in_a_notebook_shows_the_readers_own_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    notebook = FakeNotebook(object()).install(monkeypatch)
    with pytest.raises(sc.InputError) as caught:
        sc.load_scenario("incline33")
    [line] = caught.value._render_traceback_()
    assert line.startswith("InputError: scenario 'incline33': no such file")
    assert notebook.frames == ["test_an_error_in_a_notebook_shows_the_readers_own_lines"]
    assert len(caught.traceback) > 2  # the whole stack is there for a debugger
    monkeypatch.delitem(sys.modules, "IPython")
    assert caught.value._render_traceback_() == [line]


def test_an_interrupt_says_how_to_go_on(tmp_path: Path) -> None:
    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt) as caught:
        sc.load_study("study6").run(trials=2, workers=1, out=tmp_path / "s", progress=stop)
    assert caught.value.__notes__ == [
        f"what is finished is kept in {tmp_path / 's'}; the same call with resume=True continues"
    ]


def test_all_that_may_be_set_is_a_table() -> None:
    table = sc.load_scenario("incline30_brace").parameter_table
    height = table.loc["plant.drop_height"]
    assert [height[c] for c in ("unit", "minimum", "maximum", "default", "value")] == ["m", 0.0, 5.0, 0.3, "0.30 m"]
    assert table.loc["brace.angle_scale", "value"] == 2.4
    assert "touching" in table.loc["plant.initial_pose", "choices"]
    assert all(table["meaning"].str.len() > 0)


@pytest.mark.parametrize(
    "values",
    [
        {"plant.drop_height": "35 cm"},
        {"plant.drop_height": 0.35},
        {"plant.drop_height": np.float32(0.35)},
        {"plant.drop_height": "1.1482939632545932 ft"},
    ],
)
def test_other_values_by_name(values: dict[str, Any]) -> None:
    braced = sc.load_scenario("incline30_brace")
    changed = braced.with_parameters(values, brace={"angle_scale": np.int64(2)}, plant={"initial_pose": "published"})
    height = changed.system().parameters["plant.drop_height"]
    assert height == pytest.approx(0.35, rel=1e-7) and isinstance(height, float)
    assert changed.parameters["brace.angle_scale"] == 2.0 and type(changed.parameters["brace.angle_scale"]) is float
    assert changed.initial_pose() == "published" and "200 % brace" in changed.heading
    study = sc.load_study("study6").with_parameters(values)
    assert study.marginals["plant.drop_height"].mean == pytest.approx(0.35, rel=1e-7)
    assert study.marginals["plant.drop_height"].is_fixed


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"plant": {"drop_height": "30 kg"}}, "kg has the dimension kg, expected m"),
        ({"plant": {"drop_hight": 0.3}}, "did you mean drop_height"),
        ({"plnt": {"drop_height": 0.3}}, r"no component 'plnt' \(did you mean plant"),
        ({"plant": {"platform_incline": 30}}, r"outside its range -1.0472 ... 1.0472 rad"),  # degrees meant
        ({"plant": {"drop_height": None}}, "expected a number"),
        ({"plant": "30 deg"}, "expected the parameters of plant"),
        ({"plant": {"initial_pose": 1}}, "must be one of touching"),
    ],
)
def test_other_values_that_do_not_fit_are_one_line(values: dict[str, Any], words: str) -> None:
    for described in (sc.load_scenario("incline30_brace"), sc.load_study("study6")):
        with pytest.raises(sc.InputError, match=words) as caught:
            described.with_parameters(**values)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"trials": "many"}, "trials = 'many': must be a whole number, 1 or more"),
        ({"trials": 8.5}, "trials = 8.5: must be a whole number"),
        ({"seed": -1}, "seed = -1: must be a whole number, 0 or more"),
        ({"workers": 0}, "workers = 0: must be a whole number, 1 or more"),
        ({"shard": (3, 2)}, r"shard = \(3, 2\): there are 2 parts"),
        ({"shard": 2}, "shard = 2: must be"),
        ({"shard": "3/2"}, "K from 1 to N"),
        ({"max_failed": "200 %"}, "must lie between 0 % and 100 %"),
        ({"trial_limit": "20"}, "trial_limit = 20: needs a unit"),
        ({"trial_limit": "-1 s"}, "trial_limit = '-1 s': must be positive"),
        ({"method": "monte"}, "did you mean monte-carlo"),
        ({"progress": 5}, "progress = 5: no such kind"),
    ],
)
def test_options_of_a_run_that_do_not_fit_are_one_line(options: dict[str, Any], words: str) -> None:
    with pytest.raises(sc.InputError, match=words) as caught:
        sc.load_study("study6").run(**options)
    assert "\n" not in str(caught.value)


def test_options_of_a_comparison_that_do_not_fit_are_one_line(tmp_path: Path) -> None:
    for braces, options, words in (
        (["brace_linear"], {}, "must be {name: FMU}"),
        ({"a": "brace_linear"}, {"trials": "many"}, "trials = 'many': must be a whole number"),
        ({"a": "brace_linear"}, {"max_failed": 3}, "must lie between"),
        ({"a": "brace_linear"}, {"step": "5"}, "needs a unit"),
    ):
        with pytest.raises(sc.InputError, match=words):
            sc.compare_braces("study6", braces, out=tmp_path / "c", **options)  # type: ignore[arg-type]


def test_a_signal_that_there_is_not_is_named(landing: sc.Result) -> None:
    with pytest.raises(sc.InputError, match=r"no such signal \(did you mean plant.subtalar_angle\?\)"):
        landing["plant.subtalar_angel"]
    assert "plant.subtalar_angle" in landing._ipython_key_completions_()


def test_times_with_units() -> None:
    scenario = sc.load_scenario("incline30")
    for step, stop in ((5e-4, 0.1), ("0.5 ms", "100 ms")):
        assert scenario.with_master(communication_step=step, stop=stop).master == sc.Master(5e-4, 0.1)
        assert sc.Master(communication_step=step, stop=stop) == sc.Master(5e-4, 0.1)  # type: ignore[arg-type]
    for call in (scenario.with_master, sc.Master):
        with pytest.raises(sc.InputError, match='needs a unit, for example "100 ms"'):
            call(stop="100")  # type: ignore[operator]
        with pytest.raises(sc.InputError, match="kg has the dimension kg, expected s"):
            call(stop="100 kg")  # type: ignore[operator]


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
        ("plant.drop_height", -5, "plant.drop_height = -5 m: outside its range 0 ... 5 m"),
        ("plant.drop_height", 5.5, "plant.drop_height = 5.5 m: outside its range 0 ... 5 m"),
        ("plant.foot_scale_x", np.float32(4.0), "plant.foot_scale_x = 4: outside its range 0.5 ... 2"),
        ("plant.drop_height", float("nan"), "plant.drop_height = nan m: must be a finite number"),
        ("plant.drop_height", True, "expected a number in m"),
        ("plant.initial_pose", 7, "plant.initial_pose = 7: must be one of touching, published, given"),
        ("plant.initial_pose", 0.5, "must be one of touching"),
    ],
)
def test_a_value_that_does_not_fit_is_refused(session: Session, name: str, value: object, words: str) -> None:
    with pytest.raises(sc.InputError, match=words):
        session.run({name: value})  # type: ignore[dict-item]


def test_a_number_in_brief_has_all_its_doubts() -> None:
    """An end that is known is told, and how far a threshold is known also where no number of specimens says it."""
    assert with_interval(33.284, 32.071, None, "deg") == "33.28 deg (95 %: 32.07 ... open)"
    assert with_interval(33.284, None, None, "deg") == "33.28 deg (no interval)"
    shapes = {"normal": 0.0146, "weibull": 0.0238, "lognormal": 0.0051}
    known = Probability("above 35 ± 6 deg", 0.0146, sampling_ci=(0.0115, 0.0241), shapes=shapes)
    assert known.doubted == "0.0146 (95 %: sample 0.0115 ... 0.0241; threshold of another shape 0.0051 ... 0.0238)"
    measured = replace(known, threshold_ci=(0.001, 0.16))
    assert measured.doubted == "0.0146 (95 %: sample 0.0115 ... 0.0241, threshold 0.001 ... 0.16)"
    assert Probability("above 35 deg", 0.0146).doubted == "0.0146 (no interval)"
