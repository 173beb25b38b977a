"""Figures as journals and slides want them: no letter cut off or over another in any width and style, contrast, names
of files, what stands below."""

from __future__ import annotations

import re
from collections.abc import Callable
from importlib import resources
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from matplotlib import rc_context
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Text

from sprain_cosim import figures as plots
from sprain_cosim.animate.stage import part_colour
from sprain_cosim.errors import InputError
from sprain_cosim.figures.gallery import figure_form, figure_kinds
from sprain_cosim.figures.style import (
    ANATOMY,
    BRACE,
    DOUBLE,
    GROUND,
    SERIES,
    SINGLE,
    SUBTALAR,
    TALOCRURAL,
    UNBRACED,
    Form,
    _style,
    drawn_as,
    palette,
    picture,
)

from .test_plots import FIGURES, drawn, run, sample

FORMS = {
    "single": Form(),
    "double": Form(DOUBLE),
    "screen": Form(16.0, screen=True),
    "panels": Form(SINGLE, panels=True),
}


def letters(figure: Figure) -> list[tuple[Text, np.ndarray]]:
    """All words that are drawn, with left, bottom, right and upper end of each [pixels]."""
    figure.draw_without_rendering()
    renderer = figure.canvas.get_renderer()  # type: ignore[attr-defined]
    kept, drawn = set[Text](), set[Text]()  # matplotlib keeps the labels of ticks outside the limits
    for axis in figure.axes:
        for direction in (axis.xaxis, axis.yaxis):
            for tick in (*direction.get_major_ticks(), *direction.get_minor_ticks()):
                kept |= {tick.label1, tick.label2}
            for tick in direction._update_ticks():
                drawn |= {label for label in (tick.label1, tick.label2) if label.get_visible()}
    found = []
    for text in figure.findobj(Text):
        assert isinstance(text, Text)
        if text.get_visible() and text.get_text().strip() and (text not in kept or text in drawn):
            found.append((text, np.array(text.get_window_extent(renderer).extents)))
    return found


@pytest.mark.parametrize("form", [f if f == "panels" else pytest.param(f, marks=pytest.mark.long) for f in FORMS])
@pytest.mark.parametrize("name", FIGURES)
def test_no_letter_is_cut_off_or_lies_over_another(name: str, form: str) -> None:
    with drawn_as(FORMS[form]), rc_context(_style()):  # ticks are made while drawing, also those of a file
        figure = FIGURES[name]()
        found = letters(figure)
    width, height = figure.get_size_inches() * figure.dpi
    assert abs(figure.get_size_inches()[0] * 2.54 - FORMS[form].width) < 1e-6
    slack = 1.5
    for text, (left, low, right, high) in found:
        inside = left > -slack and low > -slack and right < width + slack and high < height + slack
        assert inside, f"{text.get_text()!r} is cut off"
        rgb = np.array(to_rgb(text.get_color()))
        linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
        assert 1.05 / (0.05 + linear @ [0.2126, 0.7152, 0.0722]) >= 4.5, f"{text.get_text()!r} is pale"
    for (one, a), (other, b) in combinations(found, 2):
        over = np.minimum(a[2:], b[2:]) - np.maximum(a[:2], b[:2])
        assert not (over > slack).all(), f"{one.get_text()!r} lies over {other.get_text()!r}"


def test_panels_have_letters() -> None:
    with drawn_as(Form(panels=True)):
        titles = [axis.get_title(loc="left") for axis in FIGURES["landing"]().axes]
    assert [title[0] for title in titles] == list("ABCDEF")[: len(titles)]
    assert titles[0].endswith("subtalar angle [deg], + supination")


@pytest.mark.parametrize("name", FIGURES)
def test_percent_axes_stay_within_0_and_100(name: str) -> None:
    figure = drawn(name)
    for axis in figure.axes:
        for direction in (axis.xaxis, axis.yaxis):
            labels = [tick.label1.get_text() for tick in direction._update_ticks()]
            if "[%]" in direction.get_label_text() or any(text.endswith("%") for text in labels):
                values = [float(text.rstrip(" %")) for text in labels if text]
                assert values
                assert all(0 <= value <= 100 for value in values), labels


def marks(line: Line2D) -> tuple[object, ...]:
    """What is left of a series in grey."""
    return str(line._dash_pattern), line.get_marker()  # type: ignore[attr-defined]


MANY: dict[str, Callable[[], Figure]] = {
    "cdf": lambda: plots.cdf([sample(k, f"study {k}") for k in range(9)], "peak subtalar angle [deg]"),
    "landing": lambda: plots.landing_signals([(f"landing {k}", run(k)) for k in range(9)]),
    "moment_angle": lambda: plots.moment_angle([(f"landing {k}", run(k)) for k in range(9)]),
    "phase": lambda: plots.phase(
        [(f"landing {k}", np.arange(9.0), 90 * np.arange(9.0)) for k in range(6)],
        [(f"study {k}", np.arange(20.0), 40 * np.arange(20.0)) for k in range(6)],
    ),
    "published": lambda: plots.published([(f"study {k}", np.arange(5.0), np.arange(5.0)) for k in range(9)]),
    "grid": lambda: plots.grid(
        np.arange(4.0), [(f"gain {k}", np.arange(4.0) + k) for k in range(9)], "co-activation", "peak [deg]"
    ),
}


@pytest.mark.parametrize("name", MANY)
def test_many_series_differ_in_more_than_colour(name: str) -> None:
    """The entries of the legend, and what is drawn: no two have the same dashes and the same mark."""
    figure = MANY[name]()
    (legend,) = figure.legends
    named = {
        text.get_text().partition(" (")[0].partition(":")[0]: marks(handle)
        for handle, text in zip(legend.legend_handles, legend.get_texts(), strict=True)
        if isinstance(handle, Line2D) and re.match(r"study|landing \d|gain", text.get_text())
    }
    assert len(named) == (12 if name == "phase" else 9)
    assert len(set(named.values())) == len(named), "in the legend"
    lines = [marks(line) for line in figure.axes[0].lines if len(line.get_xdata()) > 2]
    assert len(set(lines)) == len(lines), "in the panel"


def test_braces_differ_from_no_brace_in_more_than_colour() -> None:
    looks = palette(["none", *"abcdefgh"], ["none"])
    grey = {(str(look.line), look.dot if look.marked else "") for look in looks.values()}
    assert len(grey) == len(looks)
    assert len({look.dot for look in looks.values()}) == len(looks)


COLOUR_BLIND = {  # of linear red, green, blue; Machado, Oliveira & Fernandes 2009, severity 1
    "trichromat": np.eye(3),
    "deuteranope": [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.011820, 0.042940, 0.968881],
    ],
    "protanope": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
}
XYZ = np.array(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
)
COLOURS = (*SERIES, UNBRACED)


def linear(colour: str) -> np.ndarray:
    rgb = np.array(to_rgb(colour))
    return np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)


def lab(rgb: np.ndarray) -> np.ndarray:
    """CIELAB at the white of sRGB."""
    x, y, z = np.cbrt(XYZ @ np.clip(rgb, 0, 1) / XYZ.sum(axis=1))
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])


@pytest.mark.parametrize("eyes", COLOUR_BLIND)
def test_colours_are_told_apart(eyes: str) -> None:
    """The nearest two of all, and of the first four and grey, which most figures have."""
    seen = {colour: lab(np.array(COLOUR_BLIND[eyes]) @ linear(colour)) for colour in COLOURS}
    assert lab(np.ones(3)) == pytest.approx((100, 0, 0), abs=1e-9), "the measure itself"
    for among, least in ((COLOURS, 12.5), ((*SERIES[:4], UNBRACED), 18.0)):
        assert min(np.linalg.norm(seen[a] - seen[b]) for a, b in combinations(among, 2)) > least


def test_colours_are_seen_on_paper_and_in_the_dark() -> None:
    css = (resources.files("sprain_cosim.report") / "style.css").read_text("utf-8")
    paper, dark = re.findall(r"--paper: (#\w+);", css)[:2]
    grounds = [float(linear(ground) @ XYZ[1]) for ground in ("#ffffff" if paper == "#fff" else paper, dark)]
    assert grounds[0] > 0.99 > 0.02 > grounds[1]
    for colour in (*COLOURS, ANATOMY, BRACE, SUBTALAR, TALOCRURAL, GROUND):
        for ground in grounds:
            low, high = sorted((ground, float(linear(colour) @ XYZ[1])))
            assert (high + 0.05) / (low + 0.05) >= 3, (colour, ground)


def test_film_and_glb_take_their_colours_from_the_figures() -> None:
    assert tuple(part_colour("brace")) == pytest.approx(to_rgb(BRACE))
    for text in (Path(str(resources.files("sprain_cosim") / name)).read_text("utf-8")
                 for name in ("animate/film.py", "export/gltf.py", "report/scene.py", "report/charts.py")):  # fmt: skip
        assert not re.search(r"#[0-9a-fA-F]{6}", text)


@pytest.mark.parametrize("kind", ["pdf", "tiff"])
def test_files_of_a_journal_are_the_same_each_time(kind: str) -> None:
    first, second = (picture(FIGURES["cdf"](), kind) for _ in range(2))
    assert first == second
    assert first.startswith({"pdf": b"%PDF", "tiff": b"II*"}[kind])
    if kind == "pdf":
        assert b"/Type3" not in first, "letters are fonts that can be edited"


def test_options_of_plot() -> None:
    assert figure_form("double", False, True) == Form(DOUBLE, False, True)
    assert figure_form("12.5", False, False).width == figure_form("12.5 cm", False, False).width == 12.5
    assert figure_form(None, True, False).width > SINGLE
    assert figure_kinds("PDF, svg,pdf") == ["pdf", "svg"]
    for text in ("wide", "3", "-1", "nan"):
        with pytest.raises(InputError, match="--width"):
            figure_form(text, False, False)
    for text in ("jpg", ",", "pdf,eps"):
        with pytest.raises(InputError, match="--format"):
            figure_kinds(text)
