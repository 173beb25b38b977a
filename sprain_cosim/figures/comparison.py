"""The figure of a comparison: how far the foot rolled, what each brace changed, who bore the moment, what ordinary
motion costs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from ..folders.comparison import NONE, BraceSummary, ComparisonSummary
from ..metrics import Signals
from .style import ANATOMY, BLACK, BLUE, BRACE, FAINT, INK, PURPLE, SKY, SMALL, VERMILION, looks, sheet, shorten, styled

PEAKS = (
    ("peak_subtalar_angle_deg", "supination", BLUE, "o", -0.14),
    ("peak_inversion_from_neutral_deg", "inversion", VERMILION, "s", 0.14),
)
PAD = 8.0  # points between a panel and its title
MOTIONS = {"plantarflexion": SKY, "dorsiflexion": BLUE, "supination": PURPLE}


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
    heights = [
        4.4 if runs else 1.3 + 0.72 * len(shown),
        1.7 + 0.55 * len(braces),
        1.7 + 0.5 * len(shown),
        1.7 + 0.75 * len(braces),
    ]
    drawn, (first, changes, moments, motion) = sheet(heights, note.strip())
    look = dict(zip(summary.braces, [(BLACK, "-"), *looks(len(summary.braces) - 1)], strict=True))
    if runs:
        _curves(first, {n: runs[n] for n in shown}, look)
    else:
        _distribution(first, {n: peaks[n] for n in shown}, look)
    _changes(changes, summary, braces)
    _moments(moments, summary.completed)
    _motion(motion, {n: held for n in braces if (held := summary.braces[n].resistance_Nm)})
    return drawn


def _curves(axis: Axes, runs: Mapping[str, Signals], look: Mapping[str, tuple[str, Any]]) -> None:
    for name, run in runs.items():
        angle = math.degrees(1.0) * run["plant.subtalar_angle"]
        colour, style = look[name]
        axis.plot(1e3 * run.time, angle, color=colour, linestyle=style, label=name)
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


def _distribution(axis: Axes, peaks: Mapping[str, NDArray[np.float64]], look: Mapping[str, tuple[str, Any]]) -> None:
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
    axis.set_title("Peak subtalar angle: 5, 25, 50, 75, 95 % of landings")
    axis.set_xlabel("[deg], + supination")


def _changes(axis: Axes, summary: ComparisonSummary, names: Sequence[str]) -> None:
    for key, label, colour, marker, shift in PEAKS:
        for place, name in enumerate(names):
            e = summary.braces[name].difference_to_none.get(key)
            if e is None or e.value is None:
                continue
            ends = None
            if e.ci_low is not None and e.ci_high is not None:
                ends = [[e.value - e.ci_low], [e.ci_high - e.value]]
            axis.errorbar(e.value, place + shift, xerr=ends, fmt=marker, color=colour, capsize=2, elinewidth=1)
        axis.plot([], [], marker, color=colour, label=label)
    axis.axvline(0, color=FAINT, linewidth=0.6, zorder=0)
    _named(axis, names, 0.75)
    interval = ", 95 % interval" if summary.has_intervals else ""
    axis.set_title(f"Change of the peak against no brace{interval}", pad=PAD)
    axis.set_xlabel("[deg], − less than without a brace")
    axis.legend(ncols=2, loc="lower left", handletextpad=0.2)


def _moments(axis: Axes, braces: Mapping[str, BraceSummary]) -> None:
    for place, summary in enumerate(braces.values()):
        means = {metric: estimate.value for metric, estimate in summary.metrics.items()}
        anatomy, brace = (means.get(f"{who}_subtalar_moment_Nm") for who in ("anatomy", "brace"))
        left = 0.0
        for value, colour in ((anatomy, ANATOMY), (brace, BRACE)):
            axis.barh(place, value or 0.0, left=left, height=0.55, color=colour)
            left += value or 0.0
        share = 1.0 if brace is None else means.get("anatomy_share")
        if share is not None:
            axis.annotate(
                f"anatomy {100 * share:.0f} %",
                (max(left, 0.0), place),
                (3, 0),
                textcoords="offset points",
                va="center",
                fontsize=SMALL,
            )
    axis.margins(x=0.34)
    if axis.dataLim.x0 >= 0:
        axis.set_xlim(left=0)
    _named(axis, list(braces), 0.75)
    axis.set_title("Who resists at the peak", pad=PAD)
    axis.set_xlabel("subtalar moment [N·m], + resists supination")
    _squares(axis, {"anatomy": ANATOMY, "brace": BRACE})


def _motion(axis: Axes, resistance: Mapping[str, Mapping[str, float]]) -> None:
    """`resistance` {brace: {posture: moment [N·m]}}. Bars at 10 degrees, a tick in each at 5."""
    height = 0.25
    for k, (motion, colour) in enumerate(MOTIONS.items()):
        for place, held in enumerate(resistance.values()):
            at = place + (k - 1) * height
            axis.barh(at, held[f"{motion}_10deg"], height=0.9 * height, color=colour)
            axis.plot([held[f"{motion}_5deg"]] * 2, [at - 0.45 * height, at + 0.45 * height], color=INK, linewidth=1.0)
    axis.axvline(0, color=FAINT, linewidth=0.6, zorder=0)
    axis.margins(x=0.06)
    _named(axis, list(resistance), 0.6)
    axis.set_title("What 10° of ordinary motion costs (tick: 5°)", pad=PAD)
    axis.set_xlabel("moment of the brace [N·m], + resists the motion")
    _squares(axis, MOTIONS)


def _squares(axis: Axes, entries: Mapping[str, str]) -> None:
    handles = [Patch(color=colour, label=name) for name, colour in entries.items()]
    axis.legend(handles=handles, ncols=len(handles), loc="lower right", handlelength=1.0, handletextpad=0.4)


def _named(axis: Axes, names: Sequence[str], room: float) -> None:
    """One line a brace, from above, with `room` below for a legend."""
    axis.set_yticks(range(len(names)), [shorten(name, 16) for name in names])
    axis.set_ylim(len(names) - 0.5 + room, -0.55)
    axis.tick_params(axis="y", length=0)
    axis.locator_params(axis="x", nbins=6)
