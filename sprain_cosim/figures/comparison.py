"""The figures of a comparison: what each brace changed, and how sure that is; how far the foot rolled, who bore the
moment, what ordinary motion costs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from numpy.typing import NDArray

from ..folders.comparison import INJURY, NONE, BraceSummary, ComparisonSummary, MeanEstimate, called
from ..literature import INJURY_INVERSION_TEXT
from ..metrics import Signals
from ..units import percentage, percentage_ends
from .selection import both_ends
from .style import (
    BORNE,
    FAINT,
    FLOOR,
    INK,
    SeriesLook,
    in_two,
    legend_line,
    letters,
    on_axis,
    palette,
    sheet,
    small,
    styled,
)

PEAKS = (  # response, name, marker, filled, place on the line
    ("peak_subtalar_angle_deg", "supination", "o", True, -0.14),
    ("peak_inversion_from_neutral_deg", "inversion", "s", False, 0.14),
)
PAD = 8.0  # points between a panel and its title
TWO_LINES = 0.72  # cm of a row whose name takes two lines
MOTIONS = {"plantarflexion": "....", "dorsiflexion": "////", "supination": ""}  # hatches, in the brace's colour
Doubt = tuple[float, float]


@styled
def comparison_figure(
    summary: ComparisonSummary, runs: Mapping[str, Signals], peaks: Mapping[str, NDArray[np.float64]]
) -> Figure:
    """`runs` {brace: signals of its landing} of a scenario; empty for a study, whose landings are drawn as a
    distribution of `peaks` {brace: (landings,) peak of supination [deg]}."""
    shown = list(summary.completed)
    braces = [n for n in shown if n != NONE]
    note = f"{summary.source}: {summary.count}, the same for every brace. "
    note += f"Initial pose: {summary.initial_pose}. " if summary.initial_pose else ""
    note += f"Failed: {', '.join(summary.failed)}." if summary.failed else ""
    row = TWO_LINES if any("\n" in in_two(called(name)) for name in shown) else 0.0
    heights = [
        4.4 if runs else 1.3 + 0.72 * len(shown),
        1.7 + max(row, 0.55) * len(braces),
        1.7 + max(row, 0.5) * len(shown),
        1.7 + 0.75 * len(braces),
    ]
    drawn, (first, changes, moments, motion) = sheet(heights, note.strip())
    look = palette(list(summary.braces), [NONE])
    if runs:
        _curves(first, {n: runs[n] for n in shown}, look)
    else:
        _distribution(first, {n: peaks[n] for n in shown}, look)
    _changes(changes, summary, braces, look)
    _moments(moments, summary.completed, "mean " * summary.is_study)
    _motion(motion, {n: held for n in braces if (held := summary.braces[n].resistance_Nm)}, look)
    return drawn


def _curves(axis: Axes, runs: Mapping[str, Signals], look: Mapping[str, SeriesLook]) -> None:
    for name, run in runs.items():
        angle = math.degrees(1.0) * run["plant.subtalar_angle"]
        colour = look[name].colour
        axis.plot(1e3 * run.time, angle, label=called(name), **look[name].along(len(angle)))
        top = int(np.argmax(angle))
        axis.plot(
            1e3 * run.time[top],
            angle[top],
            "o",
            color=colour,
            markersize=3.5,
            markeredgecolor="white",
            markeredgewidth=0.5,
            zorder=4,
        )
    axis.set_title("Subtalar angle [deg], + supination")
    axis.set_xlabel("time after contact [ms]")
    axis.legend(loc="upper left", handlelength=2.6)
    axis.grid(axis="y")


def _distribution(axis: Axes, peaks: Mapping[str, NDArray[np.float64]], look: Mapping[str, SeriesLook]) -> None:
    """5 to 95 % as a line, the middle half as a bar, the median as a gap in it, the landings as ticks below."""
    for place, (name, values) in enumerate(peaks.items()):
        y = np.sort(values)
        p5, p25, p50, p75, p95 = np.percentile(y, [5, 25, 50, 75, 95])
        colour = look[name][0]
        axis.plot([p5, p95], [place, place], color=colour, solid_capstyle="butt")
        axis.plot([p25, p75], [place, place], color=colour, linewidth=6, solid_capstyle="butt")
        axis.plot([p50], [place], "|", color="white", markersize=6, markeredgewidth=1.4, zorder=4)
        kept = y[:: max(1, len(y) // 400)]
        axis.plot(
            kept, np.full(len(kept), place + 0.32), "|", color=colour, markersize=3, markeredgewidth=0.35, alpha=0.6
        )
    _named(axis, list(peaks), 0.1)
    axis.set_title("Peaks of 5, 25, 50, 75, 95 % of landings")
    axis.set_xlabel("peak subtalar angle [deg], + supination")


def _changes(
    axis: Axes, summary: ComparisonSummary, names: Sequence[str], look: Mapping[str, SeriesLook], numbers: bool = False
) -> None:
    """`numbers`: the change of the first peak in words at the right."""
    for key, label, marker, filled, shift in PEAKS:
        for place, name in enumerate(names):
            e = summary.braces[name].difference_to_none.get(key)
            if e is None or e.value is None:
                continue
            colour, ends = look[name][0], None
            if e.ci_low is not None and e.ci_high is not None:
                ends = [[e.value - e.ci_low], [e.ci_high - e.value]]
            style: Any = dict(fmt=marker, color=colour, markerfacecolor=colour if filled else "white")
            axis.errorbar(e.value, place + shift, xerr=ends, capsize=2, elinewidth=1, **style)
            if numbers and filled:
                words = _interval_words(e)
                at: Any = dict(transform=axis.get_yaxis_transform(), ha="left", va="center", fontsize=small())
                axis.text(1.02, place, words, color=letters(colour), **at)
        axis.plot([], [], marker, color=INK, markerfacecolor=INK if filled else "white", label=label)
    axis.axvline(0, color=FAINT, linewidth=0.6, zorder=0)
    _named(axis, names, 0.75)
    interval = ", 95 % interval" if summary.has_intervals else ""
    axis.set_title(f"Peak against no brace{interval}", pad=PAD)
    axis.set_xlabel("change [deg], − less than without a brace")
    axis.legend(ncols=2, loc="lower left", handletextpad=0.2)


def _interval_words(e: MeanEstimate) -> str:
    value = f"{e.value:+z.1f}°"
    if e.ci_low is not None and e.ci_high is not None:
        value += f"\n{e.ci_low:+z.1f} … {e.ci_high:+z.1f}"
    return value.replace("-", "−")


@styled
def paired(summary: ComparisonSummary, doubts: Mapping[str, Doubt], look: Mapping[str, SeriesLook]) -> Figure:
    """What each brace changed, paired over the same landings, and how likely the injury threshold is exceeded with
    each: the answer of a comparison with both of its doubts.

    - doubts: {brace: ends of the probability as far as the threshold is known}
    - look: {brace: colour and line style}
    """
    shown = list(summary.completed)
    braces = [n for n in shown if n != NONE]
    risks = {n: e for n in shown if (e := summary.braces[n].metrics.get(INJURY)) and e.value is not None}
    heights = [1.7 + 0.75 * len(braces)] + ([1.9 + 1.05 * len(risks)] if risks else [])
    note = f"{summary.source}: {summary.count}, the same for every brace. "
    note += f"Initial pose: {summary.initial_pose}." if summary.initial_pose else ""
    figure, axes = sheet(heights, note.strip())
    _changes(axes[0], summary, braces, look, numbers=True)
    if risks:
        _risks(axes[1], risks, doubts, look)
    return figure


def _risks(
    axis: Axes, risks: Mapping[str, MeanEstimate], doubts: Mapping[str, Doubt], look: Mapping[str, SeriesLook]
) -> None:
    """Probabilities on a logarithmic axis: thick what the landings leave open, thin what the threshold does;
    what lies below the floor of the axis points beyond it."""
    at: Any = dict(transform=axis.get_yaxis_transform(), ha="left", va="center", fontsize=small())
    for place, (name, e) in enumerate(risks.items()):
        colour = look[name][0]
        if name in doubts:
            low, high = (100 * max(FLOOR, d) for d in doubts[name])
            axis.plot([low, high], [place] * 2, color=colour, linewidth=1.0, marker="|", markersize=5)
            if doubts[name][0] < FLOOR:
                axis.plot(low, place, on_axis(doubts[name][0], "|")[1], color=colour, markersize=5)
        if e.ci_low is not None and e.ci_high is not None:
            low, high = (100 * max(FLOOR, d) for d in (e.ci_low, e.ci_high))
            axis.plot([low, high], [place] * 2, color=colour, linewidth=5.5, alpha=0.45, solid_capstyle="butt")
        share = e.value or 0.0
        at_axis, mark = on_axis(share, "o")
        axis.plot(100 * at_axis, place, mark, color=colour)
        words = [f"{percentage(share)} %"]
        words += [percentage_ends(*pair)[0] for pair in (both_ends((e.ci_low, e.ci_high)), doubts.get(name)) if pair]
        axis.text(1.02, place, "\n".join(words), color=letters(colour), linespacing=1.1, **at)
    _named(axis, list(risks), 0.75)
    axis.set_xscale("log")
    axis.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    low, high = axis.get_xlim()
    if high < 30 * low:  # too narrow for the powers of ten alone
        axis.xaxis.set_major_locator(LogLocator(10, (1.0, 2.0, 5.0)))
    axis.xaxis.set_minor_formatter(NullFormatter())
    axis.set_title("Inversion beyond the injury range", pad=PAD)
    axis.set_xlabel(f"probability [%], {INJURY_INVERSION_TEXT}° from neutral")
    keys: dict[str, Any] = {}
    if any(e.half_width is not None for e in risks.values()):
        keys["landings"] = legend_line(INK, linewidth=5.5, alpha=0.45)
    if doubts.keys() & risks.keys():
        keys["threshold"] = legend_line(INK, linewidth=1.0, marker="|")
    if keys:
        axis.legend(list(keys.values()), list(keys), ncols=2, loc="lower left", handletextpad=0.9)


def _moments(axis: Axes, braces: Mapping[str, BraceSummary], mean: str) -> None:
    for place, summary in enumerate(braces.values()):
        means = {metric: estimate.value for metric, estimate in summary.metrics.items()}
        anatomy, brace = (means.get(f"{who}_subtalar_moment_Nm") for who in ("anatomy", "brace"))
        left = 0.0
        for value, bar in ((anatomy, BORNE["anatomy"]), (brace, BORNE["brace"])):
            axis.barh(place, value or 0.0, left=left, height=0.55, **bar)
            left += value or 0.0
        share = MeanEstimate(1.0) if brace is None else summary.metrics.get("anatomy_share")
        if share is not None and share.value is not None:
            doubt = "" if share.half_width is None else f" ± {100 * share.half_width:.1f}"
            axis.annotate(
                f"anatomy {100 * share.value:.{1 if doubt else 0}f}{doubt} %",
                (max(left, 0.0), place),
                (3, 0),
                textcoords="offset points",
                va="center",
                fontsize=small(),
            )
    axis.margins(x=0.5)
    if axis.dataLim.x0 >= 0:
        axis.set_xlim(left=0)
    _named(axis, list(braces), 0.75)
    axis.set_title("Who resists at the peak", pad=PAD)
    axis.set_xlabel(f"{mean}subtalar moment [N·m], + resists supination")
    _squares(axis, BORNE)


def _motion(axis: Axes, resistance: Mapping[str, Mapping[str, float]], look: Mapping[str, SeriesLook]) -> None:
    """`resistance` {brace: {posture: moment [N·m]}}. Bars at 10 degrees, a tick in each at 5."""
    height = 0.25
    for k, motion in enumerate(MOTIONS):
        for place, (name, held) in enumerate(resistance.items()):
            at = place + (k - 1) * height
            axis.barh(at, held[f"{motion}_10deg"], height=0.9 * height, **_hatched(look[name][0], motion))
            axis.plot([held[f"{motion}_5deg"]] * 2, [at - 0.45 * height, at + 0.45 * height], color=INK, linewidth=1.0)
    axis.axvline(0, color=FAINT, linewidth=0.6, zorder=0)
    axis.margins(x=0.06)
    _named(axis, list(resistance), 0.6)
    axis.set_title("What 10° of motion costs (tick: 5°)", pad=PAD)
    axis.set_xlabel("moment of the brace [N·m], + resists the motion")
    _squares(axis, {motion: _hatched(INK, motion) for motion in MOTIONS})


def _hatched(colour: str, motion: str) -> dict[str, Any]:
    return dict(facecolor=colour, hatch=MOTIONS[motion], edgecolor="white", linewidth=0)


def _squares(axis: Axes, entries: Mapping[str, Any]) -> None:
    handles = [Patch(label=name, **look) for name, look in entries.items()]
    axis.legend(handles=handles, ncols=len(handles), loc="lower right", handlelength=1.0, handletextpad=0.4)


def _named(axis: Axes, names: Sequence[str], room: float) -> None:
    """One line a brace, from above, with `room` below for a legend."""
    axis.set_yticks(range(len(names)), [in_two(called(name)) for name in names])
    axis.set_ylim(len(names) - 0.5 + room, -0.55)
    axis.tick_params(axis="y", length=0)
    axis.locator_params(axis="x", nbins=6)
