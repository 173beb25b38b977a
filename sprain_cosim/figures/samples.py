"""Figures of studies: distributions, the advanced mean value method over Monte Carlo, sensitivities, poses side by
side, published against simulated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.markers import CARETLEFTBASE, CARETRIGHTBASE
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from .style import (
    BLUE,
    DOTS,
    FAINT,
    FORM,
    GROUND,
    HATCHES,
    INK,
    LINE,
    LINES,
    MOST_DRAWN,
    PATCH,
    PURPLE,
    SERIES,
    SKY,
    VERMILION,
    SeriesLook,
    grow,
    label,
    large,
    legend_above,
    legend_line,
    letters,
    lines_of,
    looks,
    looks_of,
    sheet,
    small,
    styled,
    text_width,
    title_lines,
    width_of,
)

BETWEEN = 18.0  # points that ticks and gaps take beside the panels of a row

Array = NDArray[np.float64]
Interval = tuple[float, float, float]  # value, low and high end
Entries = list[tuple[Any, str]]  # of a legend: handle and text


@dataclass(frozen=True)
class Sample:
    """A response of a study, in the response's unit.

    - title: of the study
    - values: (n,), empty for a search such as AMV
    - low, high: (n,) bounds of the distribution function at the sorted values
    - percentiles: {level in %: (value, low, high)}; one end NaN where the sample is too small to close the interval,
      both where it allows none
    - published: {level in %: value}
    - sensitivity: {parameter: (r, low, high)}
    """

    title: str
    values: Array = field(default_factory=lambda: np.empty(0))
    low: Array | None = None
    high: Array | None = None
    percentiles: Mapping[float, Interval] = field(default_factory=dict)
    published: Mapping[float, float] = field(default_factory=dict)
    sensitivity: Mapping[str, Interval] = field(default_factory=dict)


@dataclass(frozen=True)
class Authors:
    """What Yoder et al. 2021 found by the advanced mean value method and by Monte Carlo.

    - sampled: {level in %: (value, low, high)} of their Monte Carlo trials
    - importance: {level: {parameter: component}}
    """

    sampled: Mapping[float, Interval] = field(default_factory=dict)
    importance: Mapping[str, Mapping[str, float]] = field(default_factory=dict)


@styled
def cdf(samples: Sequence[Sample], quantity: str, note: str = "") -> Figure:
    """Distribution functions of `quantity` ("peak subtalar angle [deg], + supination") laid over each other, as Figure
    4 of Yoder et al. 2021; circles are published percentiles. One or two samples carry their 95 % bounds."""
    figure, (axis,) = sheet([6.0], note)
    entries: Entries = []
    for look, sample in zip(looks_of([s.title for s in samples]), samples, strict=True):
        step_curve(axis, sample, look, len(samples) <= 2)
        entries.append((look.key(), sample.title))
        for level, value in sample.published.items():
            published_circle(axis, value, level / 100, 5)
    probability_axis(axis, quantity)
    if any(s.published for s in samples):
        entries.append((published_key(5), "published 5, 50, 95 % (Yoder et al. 2021)"))
    if len(samples) <= 2 and any(s.low is not None for s in samples):
        entries.append((legend_line(FAINT, linewidth=5, alpha=0.5), "95 % bounds at each value (Clopper-Pearson)"))
    legend_above(figure, entries)
    return figure


@styled
def level_search(
    search: Sample,
    importance: Mapping[str, Mapping[str, float]],
    quantity: str,
    sample: Sample | None = None,
    note: str = "",
    theirs: Authors | None = None,
    tested: Mapping[float, tuple[float, float]] | None = None,
) -> Figure:
    """The advanced mean value method over Monte Carlo, as Figure 5 of Yoder et al. 2021.

    Levels above, importance of the inputs below.

    - search: its `percentiles` are the levels of the method
    - importance: {level: {parameter: component of the unit vector}}, + where more of the parameter raises the response
    - sample: Monte Carlo trials of the same study
    - theirs: what the paper's authors found
    - tested: {level in %: ends of the 95 % interval of the share [%] of random landings that lies below its value}
    """
    names = sorted(
        {n for row in importance.values() for n in row},
        key=lambda n: max(abs(row.get(n, 0.0)) for row in importance.values()),
    )
    figure, (top, below) = sheet([4.6, height_of(names)], note)
    entries = _draw_levels(top, search, sample, theirs, tested or {})
    probability_axis(top, quantity, True)
    if sample is None:
        values = [v for v, _, _ in search.percentiles.values()] + list(search.published.values())
        width = max(values) - min(values) or 1.0
        top.set_xlim(min(values) - 0.45 * width, max(values) + 0.45 * width)
    entries += _draw_importance(below, importance, names, theirs)
    legend_above(figure, entries)
    return figure


def _draw_levels(
    axis: Axes,
    search: Sample,
    sample: Sample | None,
    theirs: Authors | None,
    tested: Mapping[float, tuple[float, float]],
) -> Entries:
    entries: Entries = []
    if sample is not None and len(sample.values):
        step_curve(axis, sample, SeriesLook(GROUND, "-", ""), True)
        entries.append((legend_line(GROUND), f"Monte Carlo, {len(sample.values)} landings, 95 % bounds"))
    for level, (value, low, high) in ({} if theirs is None else theirs.sampled).items():
        axis.plot([low, high], [level / 100] * 2, color=INK, linewidth=0.9, marker="|", markersize=4, zorder=4)
        axis.plot(value, level / 100, "s", markersize=4, markerfacecolor="white", markeredgecolor=INK, zorder=4)
    beside: Any = dict(textcoords="offset points", fontsize=small(), color=letters(VERMILION), va="center", bbox=PATCH)
    for level, (value, _, _) in search.percentiles.items():
        axis.plot(value, level / 100, "D", color=VERMILION, markersize=5, zorder=5)
        if level in tested:
            shares = [share / 100 for share in tested[level]]
            axis.plot([value, value], shares, color=VERMILION, linewidth=1.0, marker="_", markersize=5, zorder=4)
        right = search.published.get(level, value) < value  # away from the published level
        beside |= dict(ha="left" if right else "right")
        if theirs is None:
            axis.annotate(f"{value:z.1f}", (value, level / 100), ((8 if right else -8) * FORM.get().scale, 0), **beside)
    for level, value in search.published.items():
        published_circle(axis, value, level / 100, 9, zorder=6)  # around a mark of ours at the same place
    numbers = ["", ""]
    if theirs is not None:
        known = ([v for v, _, _ in search.percentiles.values()], search.published.values())
        numbers = [": " + " / ".join(f"{v:z.1f}" for v in values) for values in known]
    entries.append((legend_line(VERMILION, "none", marker="D"), f"{search.title}{numbers[0]}"))
    if tested:
        whisker = legend_line(VERMILION, "-", linewidth=1.0, marker="|", markersize=5)
        entries.append((whisker, "share of random landings below it, 95 %"))
    if search.published:
        entries.append((published_key(7), f"published (Yoder et al. 2021){numbers[1]}"))
    if theirs is not None and theirs.sampled:
        key: Any = dict(marker="s", markersize=4, markerfacecolor="white", linewidth=0.9)
        entries.append((legend_line(INK, **key), "published Monte Carlo levels, 95 % of 1000 trials"))
    return entries


def _draw_importance(
    axis: Axes, importance: Mapping[str, Mapping[str, float]], names: Sequence[str], theirs: Authors | None
) -> Entries:
    entries: Entries = []
    height = 0.8 / max(len(importance), 1)
    colours = (SKY, BLUE, PURPLE, *SERIES)
    for j, (name, row) in enumerate(importance.items()):
        look: Any = dict(facecolor=colours[j % len(colours)], hatch=HATCHES[j % len(HATCHES)])
        look |= dict(edgecolor="white", linewidth=0)
        places = np.arange(len(names)) + 0.4 - height * (j + 0.5)
        axis.barh(places, [row.get(n, 0.0) for n in names], height, **look)
        entries.append((Rectangle((0, 0), 1, 1, **look), f"importance at the {name} % level"))
        for place, parameter in zip(places, names, strict=True):
            known = {} if theirs is None else theirs.importance.get(name, {})
            if parameter in known:
                published_circle(axis, known[parameter], float(place), 3.0, "white")
    if theirs is not None and theirs.importance:
        entries.append((published_key(3.0, "white"), "published, from the authors' design points"))
    name_inputs(axis, names)
    axis.set(xlim=(-1, 1), xticks=[-1, -0.5, 0, 0.5, 1])
    axis.set_xlabel("importance (unit vector),\n+ raises the response")
    return entries


@styled
def tornado(
    sensitivity: Mapping[str, Interval],
    spread: Mapping[str, Interval],
    title: str,
    quantity: str,
    published: Mapping[str, float] | None = None,
    note: str = "",
) -> Figure:
    """Sensitivities of the `quantity` of the study `title`, the largest on top: Pearson's r {parameter: (value, low,
    high)} with 95 % intervals, circles for `published` ones, and how the response's SD follows the parameter's SD,
    `spread` (dσ/dσ normalised, likewise)."""
    names = sorted(sensitivity, key=lambda n: abs(sensitivity[n][0]))
    panels = [(sensitivity, ("Pearson's r,", "+ raises it"))] + (
        [(spread, ("its SD per input SD,", "+ widens it"))] if spread else []
    )
    figure, axes = sheet([height_of(names)], note, len(panels), sharey=True)
    room = (width_of(figure) - max(map(_width_of_name, names), default=0.0) - BETWEEN) / len(panels)
    below = [[line for part in meaning for line in lines_of(part, room, large())] for _, meaning in panels]
    grow(figure, LINE * max(len(lines) - 2 for lines in below))
    for axis, (values, _), lines in zip(axes, panels, below, strict=True):
        for k, name in enumerate(names):
            if name in values:
                value, low, high = values[name]
                axis.barh(k, value, 0.62, color=BLUE if value >= 0 else VERMILION, alpha=0.85)
                axis.plot([low, high], [k, k], color=INK, linewidth=0.9, marker="|", markersize=4)
        name_inputs(axis, names)
        axis.set_xlabel("\n".join(lines))
        reach = 1.08 * max([1e-3, *(float(np.nanmax(np.abs(interval))) for interval in values.values())])
        size = 10.0 ** np.floor(np.log10(reach))
        tick = size * max(step for step in (1, 2, 5) if step * size <= reach)
        axis.set(xlim=(-reach, reach), xticks=(-tick, 0.0, tick))
        axis.tick_params(axis="y", labelleft=axis is axes[0])
    entries: Entries = [(legend_line(INK, linewidth=0.9, marker="|", markersize=4), "95 % interval")]
    for name, r in (published or {}).items():
        if name in names:
            published_circle(axes[0], r, names.index(name), 4.5, "white")
            entries[1:] = [(published_key(4.5, "white"), "published r (Yoder et al. 2021, Table 2)")]
    legend_above(figure, [(legend_line(INK, "none"), text) for text in (title, quantity)] + entries)
    return figure


@styled
def percentiles(samples: Sequence[Sample], quantity: str, note: str = "") -> Figure:
    """5, 50 and 95 % levels of each sample with their 95 % intervals (thick, an open end as a tip), the span between
    them (thin), and published levels as circles."""
    titles = [title_lines(sample.title, 44) for sample in samples]
    heights = [0.8 + LINE * len(lines) for lines in titles]
    figure, (axis,) = sheet([0.9 + sum(heights)], note)
    top, at = 0.0, dict[str, Any](fontsize=small(), transform=axis.get_yaxis_transform(), va="top")
    for sample, look, lines, height in zip(samples, looks_of([s.title for s in samples]), titles, heights, strict=True):
        place, color = top + LINE * len(lines) + 0.24, look.colour
        values = [v for v, _, _ in sample.percentiles.values()]
        axis.plot([min(values), max(values)], [place, place], color=color, linewidth=0.9)
        for value, low, high in sample.percentiles.values():
            tip, pale = open_end(low, high), dict[str, Any](color=color, alpha=0.4)
            ends = [value if tip is not None and np.isnan(end) else end for end in (low, high)]
            axis.plot(ends, [place, place], linewidth=4.5, solid_capstyle="butt", **pale)
            if tip is not None:
                axis.plot(value, place, marker=tip, markersize=7, markeredgewidth=0, **pale)
            axis.plot(value, place, "|", color=color, markersize=8, markeredgewidth=1.4)
        for value in sample.published.values():
            published_circle(axis, value, place, 4.5)
        axis.text(0, top, "\n".join(lines), **at)
        axis.text(1, top, " / ".join(f"{v:z.1f}" for v in values).replace("-", "−"), ha="right", **at)
        top += height
    axis.set_ylim(top, -0.05)
    axis.set_yticks([])
    axis.spines["left"].set_visible(False)
    axis.grid(axis="x")
    axis.set_xlabel(quantity)
    entries = [(legend_line(FAINT, linewidth=4.5, alpha=0.7), "5, 50, 95 % level with 95 % interval")]
    if any(open_end(low, high) is not None for s in samples for _, low, high in s.percentiles.values()):
        key = legend_line(FAINT, "none", marker=CARETLEFTBASE, markersize=7, markeredgewidth=0)
        entries.append((key, "open end: too few landings to close it"))
    if any(s.published for s in samples):
        entries.append((legend_line(INK, "none", marker="o", markerfacecolor="none"), "published (Yoder et al. 2021)"))
    legend_above(figure, entries)
    return figure


@styled
def poses(pairs: Sequence[tuple[str, Sample]], quantity: str, note: str = "") -> Figure:
    """The same study from different initial poses, `pairs` of (pose, sample), side by side: distributions above,
    Pearson's r with its intervals below."""
    names = [n for n in pairs[0][1].sensitivity if all(n in s.sensitivity for _, s in pairs)]
    names.sort(key=lambda n: max(abs(s.sensitivity[n][0]) for _, s in pairs))
    figure, axes = sheet([4.6, height_of(names)] if names else [5.2], note)
    entries: Entries = []
    for j, ((pose, sample), look) in enumerate(zip(pairs, looks(len(pairs)), strict=True)):
        step_curve(axes[0], sample, look, True)
        title = sample.title if pose in sample.title else f"{pose} pose · {sample.title}"
        entries.append((look.key(marker=look.dot, markersize=4), title))
        for level, value in sample.published.items():
            published_circle(axes[0], value, level / 100, 5)
        for k, name in enumerate(names):
            value, low, high = sample.sensitivity[name]
            place = k + 0.18 * (len(pairs) - 1) - 0.36 * j
            axes[1].plot([low, high], [place, place], color=look.colour, linewidth=1.0)
            axes[1].plot(value, place, look.dot, color=look.colour, markersize=4)
    probability_axis(axes[0], quantity, bool(names))
    if any(s.published for _, s in pairs):
        entries.append((published_key(5), "published 5, 50, 95 % (Yoder et al. 2021)"))
    if names:
        name_inputs(axes[1], names)
        axes[1].set_xlabel("Pearson's r, 95 % interval,\n+ raises the response")
    legend_above(figure, entries)
    return figure


@styled
def published(studies: Sequence[tuple[str, Array, Array]], note: str = "") -> Figure:
    """Simulated over published peak subtalar angle, trial by trial: `studies` are (title, published (n,) [deg],
    simulated (n,) [deg])."""
    figure, (axis, error) = sheet([5.6, 3.0], note, sharex=True)
    every = np.concatenate([np.concatenate([p, s]) for _, p, s in studies])
    ends = [float(every.min()) - 1, float(every.max()) + 1]
    axis.plot(ends, ends, color=FAINT, linewidth=0.7)
    entries = []
    for (title, theirs, ours), look in zip(studies, looks_of([title for title, _, _ in studies]), strict=True):
        many = len(theirs) > MOST_DRAWN
        dots: Any = dict(color=look.colour, markersize=2.2, alpha=0.6, markeredgewidth=0, rasterized=many)
        axis.plot(theirs, ours, look.dot, **dots)
        error.plot(theirs, ours - theirs, look.dot, **dots)
        rms, bias = float(np.sqrt(np.mean((ours - theirs) ** 2))), float(np.mean(ours - theirs))
        entries.append(
            (
                legend_line(look.colour, "none", marker=look.dot, markersize=4),
                f"{title}: {len(ours)} trials, RMS {rms:.3f}°, bias {bias:+z.3f}°".replace("-", "−"),
            )
        )
    axis.set_ylabel("simulated [deg]")
    axis.set_title("peak subtalar angle, + supination")
    error.axhline(0, color=FAINT, linewidth=0.7)
    error.set_title("simulated − published [deg]")
    error.set_xlabel("published peak subtalar angle [deg] (Yoder et al. 2021)")
    legend_above(figure, entries)
    return figure


@styled
def grid(levels: Array, rows: Sequence[tuple[str, Array]], parameter: str, quantity: str, note: str = "") -> Figure:
    """A response over the `levels` (n,) of a `parameter`, one line for each of the `rows` (title, values (n,)): a grid
    is no sample."""
    figure, (axis,) = sheet([6.0], note)
    entries = []
    for k, (title, values) in enumerate(rows):
        shade = k / max(len(rows) - 1, 1)
        color: Any = (
            tuple(np.array(to_rgb(VERMILION)) * (1 - shade) + np.array(to_rgb(BLUE)) * shade)
            if len(rows) > len(LINES)
            else SERIES[k]
        )
        drawn: Any = dict(marker=DOTS[k % len(DOTS)], markersize=3)
        axis.plot(levels, values, color=color, linestyle=LINES[k % len(LINES)], **drawn)
        entries.append((legend_line(color, LINES[k % len(LINES)], **drawn), title))
    axis.set_xlabel(parameter)
    axis.set_ylabel(quantity)
    axis.grid()
    legend_above(figure, entries, 1 if len(rows) <= len(LINES) else 2)
    return figure


def open_end(low: float, high: float) -> int | None:
    """The mark of an interval's open end, which lies anywhere beyond; None for an interval with both ends or none."""
    if np.isnan(low) == np.isnan(high):
        return None
    return int(CARETLEFTBASE if np.isnan(low) else CARETRIGHTBASE)


def step_curve(axis: Axes, sample: Sample, look: SeriesLook, bounds: bool = False) -> None:
    """The empirical distribution function of a sample, with its bounds as a band."""
    values = np.sort(sample.values)
    at = drawn_ranks(len(values))
    x, share = values[at], (at + 1) / len(values)
    axis.step(np.append(x[:1], x), np.append(0.0, share), where="post", **look.along(len(x) + 1))
    if bounds and sample.low is not None and sample.high is not None:
        axis.fill_between(x, sample.low[at], sample.high[at], step="post", color=look.colour, alpha=0.22, linewidth=0)


def drawn_ranks(n: int) -> NDArray[np.int64]:
    """The places in a sorted sample of `n` values that a curve is drawn through: all up to MOST_DRAWN, else as many,
    evenly, the ends included."""
    return np.arange(n) if n <= MOST_DRAWN else np.linspace(0, n - 1, MOST_DRAWN).round().astype(np.int64)


def published_circle(axis: Axes, x: float, y: float, size: float, face: str = "none", zorder: int = 5) -> None:
    """A published value."""
    edge: Any = dict(markerfacecolor=face, markeredgecolor=INK, markeredgewidth=0.9)
    axis.plot(x, y, "o", markersize=size, zorder=zorder, **edge)


def published_key(size: float, face: str = "none") -> Any:
    return legend_line(INK, "none", marker="o", markersize=size, markerfacecolor=face)


def probability_axis(axis: Axes, quantity: str, narrow: bool = False) -> None:
    axis.set_ylim(-0.02, 1.02)
    axis.set_yticks([0.05, 0.25, 0.5, 0.75, 0.95], ["5 %", "25 %", "50 %", "75 %", "95 %"])
    axis.grid()
    axis.set_ylabel("share of landings below")
    axis.set_xlabel(quantity.replace(", +", ",\n+") if narrow else quantity)


def height_of(names: Sequence[str]) -> float:
    """Of a panel with a row for each input [cm]: names with a sign take two lines."""
    long = [", " in label(name) for name in names]
    return 1.2 + (0.68 if any(a and b for a, b in pairwise(long)) else 0.6) * len(names)


def _in_lines(name: str) -> str:
    return label(name).replace(", ", "\n", 1)


def _width_of_name(name: str) -> float:
    """Of an input's name beside its row [points]."""
    return max(text_width(line, small()) for line in _in_lines(name).split("\n"))


def name_inputs(axis: Axes, names: Sequence[str]) -> None:
    axis.set_yticks(range(len(names)), [_in_lines(n) for n in names])
    axis.set_ylim(-0.6, len(names) - 0.4)
    axis.tick_params(axis="y", length=0)
    axis.axvline(0, color=FAINT, linewidth=0.6)
    axis.grid(axis="x")
