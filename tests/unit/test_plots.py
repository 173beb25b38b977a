"""Figures show the data they are given, name units and signs on their axes, and can be read at the width of a journal
column."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.markers import CARETLEFTBASE, CARETRIGHTBASE
from matplotlib.patches import Rectangle
from matplotlib.text import Text
from scipy import stats

from sprain_cosim import figures as plots
from sprain_cosim.cosim.result import Result
from sprain_cosim.figures import Sample
from sprain_cosim.figures.comparison import MOTIONS, comparison_figure, paired
from sprain_cosim.figures.law import resisting
from sprain_cosim.figures.pairs import strongest
from sprain_cosim.figures.paper import LAWS, Repeated, figure_1c, figure_4, signed_gap
from sprain_cosim.figures.samples import Authors, drawn_ranks
from sprain_cosim.figures.selection import as_interval
from sprain_cosim.figures.style import in_two, palette
from sprain_cosim.folders.comparison import INJURY, BraceSummary, ComparisonSummary, MeanEstimate
from sprain_cosim.literature import AUTHORS_IMPORTANCE, BRACES, LI_SAFE, LI_SPRAIN, LI_SPRAIN_VELOCITY, PASSIVE

TIME = np.linspace(0, 0.15, 61)
NAMES = (
    *(signal for _, signal, _ in plots.PANELS),
    "plant.brace_subtalar_torque",
    "plant.inversion_angle",
    "plant.inversion_velocity",
)


def run(seed: int, braced: bool = True) -> Result:
    rng = np.random.default_rng(seed)
    values = np.cumsum(rng.normal(0, 0.05, (len(TIME), len(NAMES))), axis=0)
    names = NAMES if braced else tuple(n for n in NAMES if "brace" not in n)
    return Result(TIME, values[:, : len(names)], names, (None,) * len(names), "completed", "", "impedance")


def sample(seed: int, title: str = "Study $6_{") -> Sample:
    values = np.random.default_rng(seed).normal(30, 3, 50)
    levels = {p: (float(np.percentile(values, p)), 28.0, 32.0) for p in (5.0, 50.0, 95.0)}
    r = {"plant.drop_height": (0.6, 0.5, 0.7), "plant.talocrural_angle_at_contact": (-0.2, -0.3, -0.1)}
    return Sample(title, values, np.linspace(0, 0.9, 50), np.linspace(0.1, 1, 50), levels, {5.0: 23.2, 50.0: 29.7}, r)


def columns(n: int = 60) -> list[plots.Column]:
    rng = np.random.default_rng(7)
    drop, angle, tone = rng.normal(0.3, 0.05, n), rng.normal(-34, 5, n), rng.lognormal(-1.6, 0.2, n)
    peak = plots.Column("peak subtalar angle [deg]", 60 * drop - 20 * tone + rng.normal(20, 1, n), "supination")
    return [
        plots.Column("drop height [m]", drop),
        plots.Column("talocrural angle at contact [deg]", angle, "dorsiflexion"),
        plots.Column("co-activation", tone),
        peak,
    ]


BRACES_DRAWN = {
    f"Acme_Sport_Pro_2000_rigid_size_4{k}": plots.Difference(-5.0 - k, (-6.3 - k, -4.0 - k)) for k in range(5)
}
DOUBTFUL = {name: plots.Difference(-0.05, (-0.08, -0.02), (-0.4, -0.01)) for name in BRACES_DRAWN}
ANGLES = np.radians(np.linspace(-35, 35, 29))
QUANTITY = "peak subtalar angle [deg], + supination"
NOTE = "Initial pose: touching."
R = sample(1).sensitivity
POPULATION = (
    "plant.subtalar_angle_at_contact",
    "subject.sex",
    "subject.lateral_epicondyle_height",
    "plant.drop_height",
)
OPEN = Sample("few", percentiles={5.0: (20.1, np.nan, 21.9), 50.0: (27.4, 25.4, 28.9), 95.0: (32.2, 30.8, np.nan)})
LONG = "30° slope, population of women and men (50 : 50 %), 150 % brace, co-activation 20 %, reflex gain 5, to the end"
COMPARED = ("none", "a rather long name of a brace", "b")
ESTIMATES = {
    "peak_subtalar_angle_deg": MeanEstimate(-9.4, -9.75, -9.05, 200),
    "peak_inversion_from_neutral_deg": MeanEstimate(-6.2, -6.4, -6.0, 200),
}
LOADS = {
    INJURY: MeanEstimate(0.0051, 0.0045, 0.0074, 200),
    "anatomy_subtalar_moment_Nm": MeanEstimate(4.2, 4.0, 4.4, 200),
}
BRACED = {
    "brace_subtalar_moment_Nm": MeanEstimate(13.1, 12.4, 13.8, 200),
    "anatomy_share": MeanEstimate(0.2471, 0.2416, 0.2526, 200),
}
RESISTS = {f"{motion}_{d}deg": 0.3 * d + k for k, motion in enumerate(MOTIONS) for d in (5, 10)}
COMPARISON = ComparisonSummary(
    kind="study",
    source="study6",
    method="monte-carlo",
    landings=200,
    initial_pose="touching",
    braces={
        name: BraceSummary(status="completed", n_completed=200, metrics=LOADS)
        if name == "none"
        else BraceSummary(
            status="completed",
            n_completed=200,
            metrics=LOADS | BRACED,
            difference_to_none=ESTIMATES,
            resistance_Nm=RESISTS,
        )
        for name in COMPARED
    },
)
DESIGNED = plots.Designed(
    "peak inversion from neutral above 35 ± 6 deg, n\u00a0=\u00a020",
    0.02,
    "brace angle scale",
    np.linspace(0.5, 3.0, 6),
    np.array([0.061, 0.035, 0.015, 0.005, 0.002, 0.0009]),
    np.array([0.046, 0.033, 0.014, 0.004, 0.0, 0.0]),
    np.array([0.081, 0.037, 0.016, 0.006, 0.003, 0.0015]),
    (1.3676, 1.3531, None),
    1.381,
    True,
    {motion: [(0.5, 0.3, 0.6), (3.0, 2.0, 10.0)] for motion in MOTIONS},
    (0.003, 0.097),
    "threshold, n\u00a0=\u00a020",
)
FIGURES: dict[str, Callable[[], Figure]] = {
    "landing": lambda: plots.landing_signals([("a", run(1)), ("no brace", run(2, False))], NOTE),
    "many landings": lambda: plots.landing_signals(
        [(f"landing {k} with a rather long name of its own", run(k)) for k in range(9)], NOTE
    ),
    "moment_angle": lambda: plots.moment_angle([("a", run(1)), ("b", run(2))], NOTE),
    "phase": lambda: plots.phase(
        [("a", np.arange(9.0), np.arange(9.0) * 90)], [("s", np.arange(20.0), np.arange(20.0) * 40)], NOTE
    ),
    "sharing": lambda: plots.sharing(
        [("a", np.array([5.0]), np.array([60.0])), ("s", np.arange(9.0), np.zeros(9))], NOTE
    ),
    "fan": lambda: plots.fan(
        [("s", TIME, {signal: np.random.default_rng(1).normal(size=(30, len(TIME))) for _, signal, _ in plots.PANELS})],
        NOTE,
    ),
    "cdf": lambda: plots.cdf([sample(1), sample(2)], QUANTITY, NOTE),
    "amv": lambda: plots.level_search(
        sample(1),
        {"5": {"plant.drop_height": 0.6, "brace.angle_scale": -0.8}, "95": {"plant.drop_height": 1.0}},
        QUANTITY,
        sample(2),
        NOTE,
    ),
    "tornado": lambda: plots.tornado(R, R, "s", QUANTITY, {"plant.drop_height": 0.61}, NOTE),
    "tornado of a population": lambda: plots.tornado(
        dict.fromkeys(POPULATION, (0.4, 0.2, 0.6)), dict.fromkeys(POPULATION, (0.1, -0.2, 0.4)), "s", QUANTITY, {}, NOTE
    ),
    "tornado of persons": lambda: plots.tornado(
        dict.fromkeys(POPULATION[2:], (0.4, 0.2, 0.6)), {POPULATION[3]: (0.1, -1.2, 2.8)}, "s", QUANTITY, {}, NOTE
    ),
    "percentiles": lambda: plots.percentiles([sample(1), sample(2)], QUANTITY, NOTE),
    "percentiles of few landings": lambda: plots.percentiles([sample(1), OPEN], QUANTITY, NOTE),
    "percentiles of long titles": lambda: plots.percentiles([sample(1, LONG), sample(2, LONG)], QUANTITY, NOTE),
    "sharing of long titles": lambda: plots.sharing(
        [(LONG, np.arange(3.0, 9.0), np.arange(6.0)), ("no brace", np.array([31.0]), np.zeros(1))],
        NOTE,
        {LONG: (0.21, 0.68)},
    ),
    "fan of long titles": lambda: plots.fan(
        [
            (
                LONG,
                TIME,
                {signal: np.random.default_rng(1).normal(size=(30, len(TIME))) for _, signal, _ in plots.PANELS},
            )
        ],
        NOTE,
    ),
    "compare": lambda: comparison_figure(
        COMPARISON, {}, {name: np.random.default_rng(1).normal(30, 3, 200) for name in COMPARED}
    ),
    "compare long names": lambda: comparison_figure(
        replace(COMPARISON, braces=dict.fromkeys(BRACES_DRAWN, COMPARISON.braces["b"])),
        {},
        {name: np.random.default_rng(1).normal(30, 3, 200) for name in BRACES_DRAWN},
    ),
    "compare landings": lambda: comparison_figure(COMPARISON, {name: run(1) for name in COMPARED}, {}),
    "paired": lambda: paired(COMPARISON, dict.fromkeys(COMPARED, (1e-7, 0.011)), palette(COMPARED, ["none"])),
    "design": lambda: plots.design_curve(DESIGNED, NOTE),
    "trade_off": lambda: plots.trade_off(
        "brace angle scale",
        "brace torque scale [N·m]",
        [(1.0, 2.0, 1.9, 2.1, 2.05), (2.0, 1.5, 1.4, 1.6, None)],
        True,
        "P + threshold ≤ 2 %",
        (0.5, 3.0),
        NOTE,
    ),
    "poses": lambda: plots.poses([("published", sample(1)), ("touching", sample(2))], QUANTITY, NOTE),
    "published": lambda: plots.published([("s", np.arange(5.0), np.arange(5.0) + 0.1)], NOTE),
    "forest": lambda: plots.forest(
        [
            plots.Changed("peak subtalar angle, + supination", "deg", BRACES_DRAWN),
            plots.Changed("probability of inversion beyond 35 ± 6°", "percentage points", DOUBTFUL),
            plots.Changed("subtalar moment of the anatomy at the peak", "N·m", BRACES_DRAWN),
        ],
        "no brace",
        palette(list(BRACES_DRAWN)),
        NOTE,
    ),
    "pairs": lambda: plots.pairs(columns(), True, NOTE),
    "pairs of persons": lambda: plots.pairs(
        [
            plots.Column("foot breadth [m]", np.linspace(0.0822, 0.111, 60)),
            plots.Column("sex, 0 woman, 1 man", np.arange(60.0) % 2),
            *columns()[::3],
        ],
        True,
        NOTE,
    ),
    "grid": lambda: plots.grid(
        np.arange(4.0), [(f"gain {k}", np.arange(4.0) + k) for k in range(6)], "co-activation", QUANTITY, NOTE
    ),
    "questions": lambda: plots.questions(
        [
            plots.Answer(
                "peak inversion from neutral above 35 ± 6 deg, n = 10",
                0.016,
                (0.0157, 0.0158),
                (8e-4, 0.15),
                {"normal": 0.016, "lognormal": 0.006, "Weibull": 0.025},
            ),
            plots.Answer("inversion moment above 2.7 ... 4.3 N·m, no law between", None, (0.9, 0.97), (0.6, 0.96)),
        ],
        [plots.Exceeded(QUANTITY, *(np.linspace(a, b, 9) for a, b in ((20, 40), (1, 0), (0.9, 0), (1, 0.1))))],
        NOTE,
    ),
    "torque_angle": plots.torque_angle,
    "form": lambda: plots.event_search(
        plots.Answer(
            "peak inversion from neutral above 35 ± 6 deg",
            0.0157,
            (0.0155, 0.0159),
            None,
            {"normal": 0.0157, "Weibull": 0.025},
        ),
        {"first order": 0.0207, "second order, Hohenbichler-Rackwitz": 0.0151, "second order, Tvedt": 0.0149},
        {"plant.drop_height": 0.17, "plant.talocrural_angle_at_contact": -0.08, "threshold": -0.96},
        NOTE,
    ),
    "sobol": lambda: plots.variance_shares(
        {"plant.drop_height": (0.3, 0.1, 0.5), "controller.coactivation": (-0.02, -0.3, 0.2)},
        {"plant.drop_height": (0.4, 0.2, 0.6), "controller.coactivation": (0.05, 0.0, 0.1)},
        QUANTITY,
        "Study 6",
        NOTE,
    ),
    "figure_1c": lambda: figure_1c(
        {
            name: {axis: (ANGLES, resisting(axis, ANGLES, scale) + 1.0) for axis in PASSIVE}
            for name, scale in LAWS.items()
        },
        "No landing, no initial pose.",
    ),
    "figure_4": lambda: figure_4(
        [Repeated(k, sample(k, f"Study {k}: 30° slope, 150 % brace, co-activation 20 %")) for k in range(1, 6)]
        + [Repeated(6, sample(6), np.random.default_rng(1).normal(30, 3, 40))],
        QUANTITY,
        NOTE,
    ),
    "figure_5": lambda: plots.level_search(
        sample(1),
        AUTHORS_IMPORTANCE,
        QUANTITY,
        sample(2),
        NOTE,
        Authors({50.0: (29.7, 29.3, 29.8)}, AUTHORS_IMPORTANCE),
    ),
}


@cache
def drawn(name: str) -> Figure:
    return FIGURES[name]()


def texts(figure: Figure) -> list[Text]:
    return [t for t in figure.findobj(Text) if t.get_text() and t.get_visible()]  # type: ignore[misc]


@pytest.mark.parametrize("name", FIGURES)
def test_a_figure_fits_a_column_and_can_be_read(name: str) -> None:
    figure = drawn(name)
    assert figure.get_size_inches()[0] == pytest.approx(8.5 / 2.54)
    assert min(t.get_fontsize() for t in texts(figure)) >= 7
    width, height = figure.canvas.get_width_height()
    outside = {
        t.get_text()
        for axis in figure.axes
        for t in (axis.title, axis._left_title, axis.xaxis.label, axis.yaxis.label)  # type: ignore[attr-defined]
        if t.get_text()
        and not (
            t.get_window_extent().x0 >= -1
            and t.get_window_extent().x1 <= width + 1
            and t.get_window_extent().y1 <= height + 1
        )
    }
    assert not outside


@pytest.mark.parametrize("name", ["cdf", "sharing", "fan"])
def test_files_are_letters_in_a_vector_file_and_the_same_each_time(name: str, tmp_path: Path) -> None:
    png, svg = plots.save(drawn(name), tmp_path / "figure")
    assert png.read_bytes().startswith(b"\x89PNG")
    assert "<text" in svg.read_text("utf-8"), "letters stay letters"
    assert plots.picture(FIGURES[name](), "svg") == svg.read_bytes()


@pytest.mark.parametrize("name", FIGURES)
def test_axes_name_units_and_signs_and_the_figure_its_pose(name: str) -> None:
    figure = drawn(name)
    words = " ".join(t.get_text() for t in texts(figure))
    assert re.search(r"\[(deg|N·m|ms|kN|deg/s|%)\]", words) or name.startswith("tornado")
    assert re.search(r"\+\s", words) or "− less" in words or name == "design"
    assert "initial pose" in " ".join(words.lower().split())  # however the note is wrapped
    for axis in figure.axes:
        said = " ".join(f"{axis.get_title('left')} {axis.get_xlabel()} {axis.get_ylabel()}".split())
        assert (
            re.search(r"\[.+\]|Pearson|input SD|importance|torque scale", said)
            or name.startswith("pairs")
            or axis.get_shared_x_axes().joined(axis, figure.axes[-1])
        ), said


def test_the_data_drawn_are_the_data_given() -> None:
    runs = [("a", run(1)), ("b", run(2, False))]
    angles = plots.landing_signals(runs).axes[0]
    for line, (_, result) in zip(angles.lines, runs, strict=False):
        np.testing.assert_allclose(
            line.get_xydata(), np.column_stack([1e3 * TIME, np.degrees(result["plant.subtalar_angle"])])
        )
    one = sample(3)
    (axis,) = plots.cdf([one], QUANTITY).axes
    x, y = np.asarray(axis.lines[0].get_xydata()).T
    np.testing.assert_allclose(x[1:], np.sort(one.values))
    np.testing.assert_allclose(y, np.arange(51) / 50)
    circles = [tuple(np.asarray(line.get_xydata())[0]) for line in axis.lines[1:] if len(line.get_xdata()) == 1]
    assert circles == [(23.2, 0.05), (29.7, 0.5)]
    left = plots.tornado(R, R, "s", QUANTITY).axes[0]
    assert [bar.get_width() for bar in left.patches] == [-0.2, 0.6], "the largest on top"
    bars = plots.sharing([("a", np.array([5.0]), np.array([60.0]))]).axes[0].patches
    assert [bar.get_width() for bar in bars] == [5.0, 60.0]
    theirs, ours = np.arange(5.0), np.arange(5.0) + 0.25
    scatter, error = plots.published([("s", theirs, ours)]).axes
    np.testing.assert_allclose(scatter.lines[1].get_xydata(), np.column_stack([theirs, ours]))
    np.testing.assert_allclose(error.lines[0].get_ydata(), 0.25)
    lines = plots.grid(theirs, [("gain 1", ours), ("gain 2", 2 * ours)], "co-activation", QUANTITY).axes[0].lines
    np.testing.assert_allclose(lines[1].get_xydata(), np.column_stack([theirs, 2 * ours]))
    signals = {"plant.subtalar_angle": np.random.default_rng(1).normal(size=(40, len(TIME)))}
    median = plots.fan([("s", TIME, signals)]).axes[0].lines[0]
    np.testing.assert_allclose(median.get_ydata(), np.degrees(np.median(signals["plant.subtalar_angle"], axis=0)))


@pytest.mark.parametrize("name", ["percentiles", "sharing", "fan"])
def test_long_titles_are_told_to_their_end(name: str) -> None:
    words = " ".join(" ".join(t.get_text() for t in texts(drawn(f"{name} of long titles"))).split())
    assert LONG.replace(" %", "\u00a0%") in words.replace(" %", "\u00a0%")
    assert "…" not in words.replace(" … ", "")


def test_numbers_stand_with_their_doubts() -> None:
    def said(name: str) -> str:
        return " ".join(" ".join(t.get_text() for t in texts(drawn(name))).split())

    assert "5.5 ± 0.2 + 2.5 ± 0.7 N·m: 26 % brace" in said("sharing of long titles")
    assert "anatomy 24.7 ± 0.5 %" in said("compare")
    assert "mean subtalar moment [N·m]" in said("compare")
    assert "0.51 % 0.45 … 0.74 < 0.01 … 1.1" in said("paired")
    assert "least value 1.368, 95 % 1.353 … above the range" in said("design")
    assert "95 % sure: 1.381" in said("design")
    assert "threshold, n = 20, at that value: 0.3 … 9.7 %" in said("design")
    assert "(1.57 … 1.58 %)" in said("questions")
    assert "(1.55 … 1.59 %)" in said("form")


def test_an_end_that_is_not_known_is_drawn_nowhere() -> None:
    """Few landings leave an interval open: a tip that points beyond the level, no bar that ends there."""
    (axis,) = drawn("percentiles of few landings").axes
    bars = [line.get_xdata() for line in axis.lines if line.get_linewidth() == 4.5]
    tips = {float(line.get_xdata()[0]): line.get_marker() for line in axis.lines if line.get_marker() in range(12)}
    assert [list(bar) for bar in bars[-3:]] == [[20.1, 21.9], [25.4, 28.9], [30.8, 32.2]]
    assert tips == {20.1: CARETLEFTBASE, 32.2: CARETRIGHTBASE}
    assert "open end: too few landings" in " ".join(t.get_text() for t in texts(drawn("percentiles of few landings")))
    unknown = [np.nan, np.nan]
    assert np.array_equal(as_interval(27.4, None, None)[1:], unknown, equal_nan=True)
    without = plots.percentiles([Sample("lhs", percentiles={50.0: (27.4, *unknown)})], QUANTITY)
    assert not [line for line in without.axes[0].lines if line.get_marker() in range(12)]


@pytest.mark.parametrize(
    ("name", "lines"),
    [
        ("linear", ["linear"]),
        ("AcmePro2000_size_44", ["AcmePro2000_", "size_44"]),
        ("Acme_Sport_Pro_2000_rigid_left_foot_size_44", ["Acme_Sport_Pro_…", "foot_size_44"]),
        ("a" * 30 + "1234567890", ["a" * 15 + "…", "aaaaaa1234567890"]),
    ],
)
def test_names_of_a_series_stay_apart_beside_their_rows(name: str, lines: list[str]) -> None:
    assert in_two(name).split("\n") == lines


def test_a_comparison_calls_no_brace_by_one_name() -> None:
    for name in ("compare", "compare landings", "paired"):
        words = [t.get_text() for t in texts(drawn(name))]
        assert "none" not in words
        assert words.count("no brace") >= (0 if name == "paired" else 1)


def test_a_design_is_drawn_as_far_as_it_is_known() -> None:
    """Where the band's lower end is not known, its upper end alone stands."""
    curve, most = drawn("design").axes[0].lines[0], drawn("design").axes[0].lines[2]
    np.testing.assert_array_equal(np.isnan(curve.get_ydata()), DESIGNED.low <= 0)
    shown = ~np.isnan(most.get_ydata())
    assert set(DESIGNED.parameter[DESIGNED.low <= 0]) <= set(DESIGNED.parameter[shown])
    np.testing.assert_array_equal(most.get_ydata()[shown], DESIGNED.high[shown])


def test_levels_of_a_search_stand_with_what_random_landings_say() -> None:
    levels = Sample("AMV", percentiles={50.0: (30.7, 30.7, 30.7)}, published={50.0: 30.7})
    figure = plots.level_search(levels, {"50": {"plant.drop_height": 1.0}}, QUANTITY, tested={50.0: (58.0, 63.8)})
    lines = [np.asarray(line.get_xydata()) for line in figure.axes[0].lines]
    assert any(line.shape == (2, 2) and np.allclose(line, [[30.7, 0.58], [30.7, 0.638]]) for line in lines)
    assert "share of random landings below it, 95\u00a0%" in [t.get_text() for t in figure.legends[0].get_texts()]
    ours, theirs = (line for line in figure.axes[0].lines if len(line.get_xdata()) == 1)
    assert theirs.get_markersize() > 2**0.5 * ours.get_markersize() + 1, "a ring about ours, not a disc of our colour"


def test_moments_share_one_scale() -> None:
    """What is ten times as large looks ten times as high."""
    for name, moments in (("landing", (3, 4)), ("fan", (3, 4)), ("moment_angle", (0, 1))):
        anatomy, brace = (drawn(name).axes[k] for k in moments)
        assert "moment" in anatomy.get_title("left")
        assert "moment" in brace.get_title("left")
        assert anatomy.get_ylim() == brace.get_ylim()


def test_moments_share_one_scale_between_figures() -> None:
    """Braces of a comparison that stand in two fans."""
    moments = [(f"b{k}", TIME, {"plant.brace_subtalar_moment": np.full((20, len(TIME)), 10.0**k)}) for k in range(3)]
    first, second = (plots.fan(moments[k : k + 2], "", moments).axes[0].get_ylim() for k in (0, 2))
    assert first == pytest.approx(second)
    assert first[1] > 100


def test_the_event_of_a_search_has_its_methods_and_both_doubts() -> None:
    top, below = FIGURES["form"]().axes
    places = {
        float(line.get_xdata()[0]): float(line.get_ydata()[0]) for line in top.lines if len(line.get_xdata()) == 1
    }
    assert places[0.0157] == 4, "the threshold's shape last"
    assert (places[0.0207], places[0.0151], places[0.0149]) == (1, 2, 3)
    assert [tuple(line.get_xdata()) for line in top.lines if len(line.get_xdata()) == 2] == [
        (0.0155, 0.0159),
        (0.0157, 0.025),
    ]
    assert [bar.get_width() for bar in below.patches] == [-0.08, 0.17, -0.96], "the largest on top"


def test_the_forest_has_each_difference_with_both_doubts() -> None:
    _, probability, _ = FIGURES["forest"]().axes
    assert [tuple(line.get_xdata()) for line in probability.lines[1:4]] == [(-0.4, -0.01), (-0.08, -0.02), (-0.05,)]
    assert tuple(probability.lines[0].get_xdata()) == (0, 0), "the line of no difference"
    words = [text.get_text() for text in probability.texts]
    assert words == ["−0.05\n−0.08 … −0.02\n−0.40 … −0.01"] * len(DOUBTFUL)
    assert probability.get_xlabel() == "difference to no brace [percentage points]"


def test_the_pairs_of_a_sample_and_their_rank_correlations() -> None:
    given = columns()
    axes = plots.pairs(given, True).axes
    assert len(axes) == 16
    np.testing.assert_allclose(axes[12].lines[0].get_xydata(), np.column_stack([given[0].values, given[3].values]))
    for row, at in ((0, 1), (0, 3), (1, 3), (2, 3)):
        a, b = given[row].values, given[at].values
        r = stats.spearmanr(a, b).statistic
        half = 1.959964 * np.sqrt((1 + r**2 / 2) / (len(a) - 3))  # Bonett & Wright 2000
        value, low, high = (
            f"{v:+.2f}".replace("-", "−") for v in (r, *np.tanh(np.arctanh(r) + np.array([-half, half])))
        )
        assert axes[4 * row + at].texts[0].get_text() == f"{value}\n{low} …\n{high}"
    assert plots.pairs(given, False).axes[1].texts[0].get_text().count("\n") == 0
    many = plots.pairs(columns(4001), True).axes[12].lines[0]
    assert len(many.get_xdata()) <= 2000
    assert many.get_rasterized()


def test_published_points_stand_beside_ours() -> None:
    """Figure 1C: the law at every 5 degrees, not what was measured. Figure 4: levels, and how far ours are off."""
    circles = [
        tuple(np.asarray(line.get_xydata())[0])
        for line in FIGURES["figure_1c"]().axes[0].lines
        if line.get_marker() == "o"
    ]
    at_5 = np.radians(np.arange(-35.0, 36.0, 5.0))
    assert len(circles) == sum((np.abs(resisting("rotation_x", at_5, scale)) < 60).sum() for scale in LAWS.values())
    for degrees, torque in circles[:15]:
        assert torque == pytest.approx(resisting("rotation_x", np.radians(degrees)))
    one = sample(4)
    figure = figure_4([Repeated(4, one)], QUANTITY)
    at = [tuple(np.asarray(line.get_xydata())[0]) for line in figure.axes[0].lines if len(line.get_xdata()) == 1]
    assert at == [(23.2, 0.05), (29.7, 0.5)]
    low, middle = (one.percentiles[p][0] - one.published[p] for p in (5.0, 50.0))
    words = f"({low:+.1f},\u00a0{middle:+.1f}°)".replace("-", "−")
    assert figure.legends[0].get_texts()[0].get_text().replace("\n", " ").endswith(words)
    assert [signed_gap(v, 1) for v in (-0.04, 0.04, -0.06)] == ["+0.0", "+0.0", "−0.1"]
    assert Repeated(1, sample(1)).agreeing == sum(28.0 <= p <= 32.0 for p in (23.2, 29.7))
    few = Repeated(1, replace(OPEN, published={5.0: 21.0, 50.0: 26.0}))
    assert (few.agreeing, few.open_ended) == (1, 1), "an interval without its lower end holds nothing for sure"


def test_the_authors_importance_is_a_unit_vector_from_their_design_points() -> None:
    """Inputs of the 5 and 95 % runs of their search in standard scores over the level's, its sign that of the level."""
    for level, drop, tone, talocrural, subtalar in (("5", 0.247, 0.235, -37.4, -3.4), ("95", 0.371, 0.173, -31.2, 2.8)):
        scores = []
        for x, mean, sd in ((drop, 0.30, 0.05), (tone, 0.20, 0.05)):
            zeta = np.sqrt(np.log1p((sd / mean) ** 2))
            scores.append((np.log(x / mean) + zeta**2 / 2) / zeta)
        scores += [(talocrural + 34) / 5, subtalar / 5]
        beta = stats.norm.ppf(float(level) / 100)
        np.testing.assert_allclose(list(AUTHORS_IMPORTANCE[level].values()), np.array(scores) / beta * 1.0, atol=0.006)
    for row in AUTHORS_IMPORTANCE.values():
        assert sum(v**2 for v in row.values()) == pytest.approx(1.0, abs=0.012)


def test_the_strongest_inputs_are_kept() -> None:
    drop, angle, tone, peak = columns()
    held = plots.Column("held", np.ones(60))
    assert strongest([angle, held, tone, drop], peak, 2) == [drop, tone]
    assert strongest([angle, held, tone, drop], peak, 9) == [drop, tone, angle], "what does not vary is left out"


def test_the_force_of_a_start_inside_the_floor_does_not_hide_the_rest() -> None:
    result = run(1)
    values = result.values.copy()
    force = result.index["plant.ground_force_y"]
    values[:, force] = 1000.0
    values[0, force] = 41_000.0
    axis = plots.landing_signals([("a", Result(TIME, values, NAMES, result.units, "completed", "", ""))]).axes[-1]
    assert axis.get_ylim()[1] < 2
    assert "cut off: 41 kN in the first 5 ms" in [t.get_text() for t in axis.texts]


def test_the_laws_drawn_are_those_of_the_fmus() -> None:
    from fmus.brace_bushing.device import POLYNOMIALS

    assert tuple(PASSIVE.values()) == tuple(tuple(p) for p in POLYNOMIALS)
    assert resisting("rotation_x", np.array([0.2]))[0] == pytest.approx(
        0.2 * (9.52095038 + 0.2 * (-29.57608094 + 0.2 * 169.01588105))
    )
    for axis, (_, scale) in zip(plots.torque_angle().axes, (("", 1.0), *BRACES.items()), strict=True):
        assert len(axis.lines) >= 3, scale
    x_axis = plots.torque_angle().axes[0]
    degrees, torque = np.asarray(x_axis.lines[2].get_xydata()).T
    np.testing.assert_allclose(torque, resisting("rotation_x", np.radians(degrees), 2.4))


def test_names_of_files_are_no_formulas() -> None:
    figure = plots.cdf([sample(1, "$\\frac{a}{ & <b>")], QUANTITY)
    assert b"&lt;b&gt;" in plots.picture(figure, "svg")


def test_a_measured_angle_without_a_velocity_is_drawn_at_none() -> None:
    """Li et al. 2018 state the velocity of the sprains alone."""
    track = ("a", np.linspace(0.0, 30.0, 20), np.linspace(0.0, 500.0, 20))
    axis = plots.phase([track], []).axes[0]
    (safe,) = (p for p in axis.patches if isinstance(p, Rectangle) and not p.get_fill())
    assert (safe.get_x(), safe.get_x() + safe.get_width()) == LI_SAFE
    assert safe.get_transform() == safe.get_patch_transform() + axis.get_xaxis_transform(), "a column, at no velocity"
    sprain = next(line for line in axis.lines if tuple(line.get_xdata()) == (LI_SPRAIN, LI_SPRAIN))
    assert tuple(sprain.get_ydata()) == LI_SPRAIN_VELOCITY


@pytest.mark.parametrize("n", [1, 2, 2000, 2001, 100_000])
def test_curves_of_large_samples_are_drawn_through_some(n: int) -> None:
    """The first and the last value among them, evenly by rank, all where they are few."""
    at = drawn_ranks(n)
    assert (at[0], at[-1]) == (0, n - 1)
    assert len(at) == min(n, 2000)
    assert set(np.diff(at)) <= ({1} if n <= 2000 else {n // 2000, n // 2000 + 1})
