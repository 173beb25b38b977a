"""A study's sample in the form of SALib and OpenTURNS, which are the oracles here."""

from __future__ import annotations

import json
import shutil
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.special import ndtri

import sprain_cosim as sc
from sprain_cosim.errors import EnvironmentProblem, InputError
from sprain_cosim.export.sample import _openturns, _salib
from sprain_cosim.study.codec import encode
from sprain_cosim.study.evaluation import summarise
from sprain_cosim.study.folder import finish_folder
from sprain_cosim.study.ledger import Ledger
from sprain_cosim.study.methods import SEARCHES
from sprain_cosim.study.plan import Plan
from sprain_cosim.study.summary import StudySummary, read_summary
from sprain_cosim.uq.distributions import (
    Beta,
    Choices,
    Empirical,
    Exponential,
    Fixed,
    LogNormal,
    Normal,
    Triangular,
    Truncated,
    Uniform,
    Weibull,
)
from tests import light
from tests.docs_commands import ROOT, blocks

BEFORE = Path(__file__).parent.parent / "folders_0_1"
PEAK = "peak_subtalar_angle_deg"
DROP, ANGLE, ACTIVITY, SCALE = INPUTS = (
    "plant.drop_height [m]",
    "plant.subtalar_angle_at_contact [rad]",
    "controller.coactivation",
    "brace.angle_scale",
)
VARIED = list(INPUTS[:3])
LAWS = [
    Normal(-0.6, 0.1),
    LogNormal(0.3, 0.05),
    Uniform(1.0, 2.4),
    Weibull(3.0, 0.5),
    Exponential(2.0),
    Triangular(-1.0, 0.5, 2.0),
    Truncated(Normal(0.2, 0.1), 0.1, 0.5),
    Truncated(Normal(0.2, 0.1), low=0.1),
    Truncated(Normal(0.2, 0.1), high=0.3),
    Truncated(LogNormal(0.2, 0.05), 0.1, 0.3),
    Beta(2.0, 3.0, -1.0, 4.0),
    Empirical((0.31, 0.28, 0.35, 0.4)),
]
BY_THEIR_ENDS = (Truncated(LogNormal(0.2, 0.05), 0.1, 0.3), Beta, Empirical)  # those that SALib has not


def stand_in(x: np.ndarray) -> np.ndarray:
    """(n,) of (n, 4) inputs: the peak [deg] of a landing that costs nothing, with an interaction."""
    drop, angle, activity, _ = x.T
    return 29.0 + 40.0 * (drop - 0.3) + 20.0 * angle - 24.0 * (activity - 0.2) + 100.0 * (drop - 0.3) * angle


def finished(plan: Plan, folder: Path) -> StudySummary:
    """The folder of a study whose landings are `stand_in`."""
    landed: list[np.ndarray] = []
    found = plan.search(lambda x: stand_in(landed.append(x) or x)) if plan.method in SEARCHES else None
    x = landed[0] if landed else plan.sample()
    x = np.column_stack([x, np.zeros((len(x), 4 - x.shape[1]))])
    trials = pd.DataFrame({"trial": np.arange(len(x)), "status": "completed", "message": ""})
    trials[plan.headings] = x[:, : len(plan.names)]
    trials[[PEAK, "time_of_peak_subtalar_s"]] = np.column_stack([stand_in(x), 0.1 * x[:, 0]])
    Ledger(folder, plan.digest, plan.identity, json.dumps(encode(plan))).close()
    summary = summarise(plan, trials, found)
    finish_folder(folder, trials, trials[["trial"]], summary, parquet=False)
    return summary


@pytest.fixture(scope="module")
def studies(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Finished studies of three inputs of study 6 and a fixed one."""
    folder = tmp_path_factory.mktemp("handed")
    study6 = sc.load_study("study6")
    names = [heading.partition(" [")[0] for heading in INPUTS]
    correlation = np.eye(4)
    correlation[0, 1] = correlation[1, 0] = 0.5
    plan = replace(study6, marginals={n: study6.marginals[n] for n in names[:3]} | {names[3]: Fixed(1.5)}, seed=3)
    finished(replace(plan, method="sobol-indices", trials=64), folder / "indices")
    finished(replace(plan, trials=32, correlation=correlation), folder / "random")
    levels = {names[0]: (0.2, 0.3), names[1]: (-0.1, 0.0, 0.1)}
    finished(replace(plan, method="grid", marginals={}, grid=levels), folder / "grid")
    return folder


def table(folder: Path) -> pd.DataFrame:
    return pd.read_csv(folder / "trials.csv")


@pytest.mark.filterwarnings("ignore")
def test_salib_finds_our_indices_in_the_rows_of_an_indices_study(studies: Path) -> None:
    analyze = pytest.importorskip("SALib.analyze.sobol").analyze
    sample = sc.to_salib(studies / "indices")
    assert (sample.analyses, sample.failed) == (("sobol",), 0)
    assert f"does not vary, left out: {SCALE}" in sample.notes
    assert sample.trials[:6].tolist() == [0, 128, 192, 256, 64, 1], "A, A with a column of B each, B; of every point"
    rows = table(studies / "indices").set_index("trial").loc[sample.trials]
    assert np.array_equal(sample.X, rows[VARIED])
    assert np.array_equal(sample.Y[PEAK], rows[PEAK])
    theirs = analyze(sample.problem, sample.Y[PEAK], calc_second_order=False, seed=1)
    search = read_summary(studies / "indices").sobol
    assert search is not None
    for k, name in enumerate(VARIED):
        ours = search.indices[name.partition(" [")[0]]
        assert ours.first_low < theirs["S1"][k] < ours.first_high
        assert theirs["S1"][k] == pytest.approx(ours.first, abs=0.02)
        assert theirs["ST"][k] == pytest.approx(ours.total, rel=1e-9)


def test_openturns_finds_our_indices_in_the_rows_of_an_indices_study(studies: Path) -> None:
    ot = pytest.importorskip("openturns")
    sample = sc.to_openturns(studies / "indices")
    assert sample.size == 64
    assert list(sample.inputs.getDescription()) == VARIED
    assert sample.distribution.getMean() == pytest.approx([0.3, 0.0, 0.2])
    theirs = ot.SaltelliSensitivityAlgorithm(sample.inputs, sample.outputs.getMarginal([PEAK]), sample.size)
    search = read_summary(studies / "indices").sobol
    assert search is not None
    for name, first in zip(VARIED, theirs.getFirstOrderIndices(), strict=True):
        ours = search.indices[name.partition(" [")[0]]
        assert ours.first_low < first < ours.first_high


@pytest.mark.long
def test_a_study_of_indices_that_landed_is_in_the_order_of_the_analyses(tmp_path: Path) -> None:
    path = light.study_file(tmp_path)
    light.plant(tmp_path / "light.fmu", lean=True)
    lean = '"plant.lean" = { lognormal = { mean = "0.05 m", sd = "0.02 m" } }\n[study]\nmethod = "sobol-indices"'
    path.write_text(path.read_text().replace("[study]", lean).replace("trials = 5", "trials = 16"))
    sc.load_study(path).run(workers=1, out=tmp_path / "out", trajectories=0)
    assert sc.to_openturns(tmp_path / "out").size == 16


@pytest.mark.filterwarnings("ignore")
def test_a_sample_goes_over_with_its_columns_units_and_correlation(studies: Path) -> None:
    ot = pytest.importorskip("openturns")
    salib, sample = sc.to_salib(studies / "random"), sc.to_openturns(studies / "random")
    rows = table(studies / "random")
    assert salib.problem["names"] == VARIED
    assert salib.problem["dists"] == ["lognorm", "norm", "lognorm"]
    assert np.array_equal(salib.X, rows[VARIED])
    assert np.array_equal(np.array(sample.inputs), salib.X)
    assert list(sample.outputs.getDescription()) == list(salib.Y) == [c for c in rows if c in salib.Y]
    assert np.array_equal(np.array(sample.outputs.getMarginal([PEAK])).ravel(), rows[PEAK])
    for units in (salib.units, sample.units):
        assert [units[name] for name in (*VARIED, *salib.Y)] == ["m", "rad", "1", "deg", "s"]
    assert salib.analyses == ("delta", "pawn")
    assert "correlated" in salib.notes[-1]
    assert isinstance(sample.distribution, ot.JointDistribution)
    ot.RandomGenerator.SetSeed(1)
    drawn = np.array(sample.distribution.getSample(100_000))
    assert np.corrcoef(drawn[:, :2].T)[0, 1] == pytest.approx(0.5, abs=4 * 0.75 / 100_000**0.5)
    assert sample.size == 0
    pawn = pytest.importorskip("SALib.analyze.pawn")
    theirs = pawn.analyze(salib.problem, salib.X, salib.Y[PEAK], S=4, seed=1)
    assert theirs["median"][0] > theirs["median"][2]


@pytest.mark.filterwarnings("ignore")
def test_the_example_on_the_page(
    studies: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("SALib")
    (example,) = (b.text for b in blocks(ROOT / "docs" / "studies.md") if "to_salib" in b.text)
    (tmp_path / "runs").mkdir()
    shutil.copytree(studies / "random", tmp_path / "runs" / "s6")
    monkeypatch.chdir(tmp_path)
    exec(example, {})
    printed = capsys.readouterr().out
    assert "('delta', 'pawn')" in printed
    assert all(name in printed for name in VARIED)


def test_a_grid_has_no_distribution(studies: Path) -> None:
    sample = sc.to_salib(studies / "grid")
    assert sample.problem["dists"] == ["unif", "unif"]
    assert sample.problem["bounds"] == [[0.2, 0.3], [-0.1, 0.1]]
    assert sample.analyses == ()
    assert any("the rows of a grid have no distribution" in note for note in sample.notes)
    pytest.importorskip("openturns")
    assert sc.to_openturns(studies / "grid").distribution is None


def test_folders_of_the_previous_version_go_over_by_the_ends_of_their_sample() -> None:
    sample = sc.to_salib(BEFORE / "study")
    assert sample.units["plant.talocrural_angle_at_contact [rad]"] == "rad"
    assert sample.units["controller.reflex_gain"] == "1"
    assert set(sample.problem["dists"]) == {"unif"}
    assert "its distributions are not recorded" in sample.notes


def edited(source: Path, target: Path, **columns: object) -> Path:
    """A copy of a study's folder whose trials 3 and 7 have other cells."""
    shutil.copytree(source, target)
    rows = table(target)
    for name, value in columns.items():
        rows.loc[[3, 7], name] = value
    rows.to_csv(target / "trials.csv", index=False)
    return target


def test_failed_trials_are_left_out_and_counted(studies: Path, tmp_path: Path) -> None:
    sample = sc.to_salib(edited(studies / "random", tmp_path / "few", status="timeout"))
    assert (sample.failed, len(sample.X), len(sample.Y[PEAK])) == (2, 30, 30)
    assert not {3, 7} & {*sample.trials.tolist()}
    assert "2 of 32 trials failed and are left out" in sample.notes
    sample = sc.to_salib(edited(studies / "random", tmp_path / "gap", **{PEAK: np.nan}))
    assert PEAK not in sample.Y
    assert f"not known of every completed trial, left out: {PEAK}" in sample.notes
    with pytest.raises(InputError, match=r"need every trial \(without trial 3, 7\); run it with method sobol or monte"):
        sc.to_salib(edited(studies / "indices", tmp_path / "torn", status="crash"))
    with pytest.raises(InputError, match="not in the order of a study of Sobol' indices"):
        sc.to_openturns(edited(studies / "indices", tmp_path / "other", **{DROP: 0.3}))
    renamed = edited(studies / "random", tmp_path / "renamed")
    table(renamed).rename(columns={DROP: "plant.drop_height [cm]"}).to_csv(renamed / "trials.csv", index=False)
    with pytest.raises(InputError, match=r"column plant\.drop_height \[cm\]: is no input of the study that the ledger"):
        sc.to_openturns(renamed)
    with pytest.raises(InputError, match=r"column plant\.drop_height \[m\]: a completed trial has no value"):
        sc.to_salib(edited(studies / "random", tmp_path / "hole", **{DROP: np.nan}))


def test_folders_that_hold_no_sample_say_so(studies: Path, tmp_path: Path) -> None:
    half = tmp_path / "half"
    half.mkdir()
    shutil.copy(studies / "random" / "ledger.sqlite", half)
    none = edited(studies / "random", tmp_path / "none")
    table(none).assign(status="crash").to_csv(none / "trials.csv", index=False)
    for hand_over in (sc.to_salib, sc.to_openturns):
        for folder, text in (
            (tmp_path / "nowhere", "nowhere: no such folder"),
            (tmp_path, "no study in it; make one with `sprain-cosim study STUDY"),
            (half, "is not finished; continue it with `.* --resume`"),
            (none, "no trial completed"),
            (BEFORE / "run", "not a folder of `sprain-cosim study`"),
            (BEFORE / "form", "method form chooses its trials, .* delta, rbd_fast and pawn"),
        ):
            with pytest.raises(InputError, match=text) as problem:
                hand_over(folder)
            assert len(str(problem.value).splitlines()) == 1


def test_without_openturns_one_line_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "openturns", None)
    with pytest.raises(EnvironmentProblem, match=r"needs the extra \[reliability\]: pip install"):
        sc.to_openturns(BEFORE / "study")


@pytest.mark.parametrize("law", LAWS, ids=repr)
@pytest.mark.filterwarnings("ignore")
def test_distributions_are_spelled_so_that_their_quantiles_stay(law) -> None:
    ot, util = pytest.importorskip("openturns"), pytest.importorskip("SALib.util")
    p = np.array([0.001, 0.1, 0.37, 0.5, 0.9, 0.999])
    ours = law.from_standard(ndtri(p))
    theirs = _openturns(law, ot)
    assert [theirs.computeQuantile(v)[0] for v in p] == pytest.approx(ours, rel=1e-6, abs=1e-9)
    spelled = _salib(law)
    assert (spelled is None) == (law == BY_THEIR_ENDS[0] or isinstance(law, BY_THEIR_ENDS[1:]))
    if spelled is not None:
        problem = {"num_vars": 1, "names": ["x"], "dists": [spelled[0]], "bounds": [spelled[1]]}
        assert util.scale_samples(p[:, np.newaxis].copy(), problem).ravel() == pytest.approx(ours, rel=1e-6)


def test_distributions_that_a_tool_has_not() -> None:
    ot = pytest.importorskip("openturns")
    assert _openturns(Empirical((1.0, 1.0, 2.0)), ot) is None
    assert _openturns(Truncated(Empirical((1.0, 1.0, 2.0)), low=1.5), ot) is None
    assert _openturns(Choices((1.0, 3.0), (3.0, 1.0)), ot).getMean()[0] == pytest.approx(1.5)
    assert _salib(Choices((1.0, 3.0))) is None
    assert _salib(Triangular(-3.0, -2.0, -1.0)) is None, "SALib takes no end below zero"
    assert _salib(Triangular(0.0, 1.0, 1.0)) is None
