"""The figure of a comparison: how far the foot rolled, what each brace changed, who bore the moment, what ordinary motion costs."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from ..metrics import Signals
from ..plots import FAINT, INK

if TYPE_CHECKING:
    from .compare import Comparison

# Okabe & Ito's colours for every kind of colour vision; identity is told by label and line style as well
COLOURS = ("#000000", "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
LINES = ("-", (0, (5, 1.6)), (0, (1.2, 1.2)), (0, (6, 1.5, 1.2, 1.5)), (0, (10, 2)), (0, (4, 1.2, 1.2, 1.2, 1.2, 1.2)), (0, (2.5, 2.5)))
ANATOMY, BRACE = "#E69F00", "#0072B2"
MOTIONS = {"plantarflexion": "#56B4E9", "dorsiflexion": "#009E73", "supination": "#CC79A7"}
WIDTH, HEIGHT, PER_BRACE = 7.2, 4.4, 0.34  # inches


def figure(comparison: Comparison, runs: Mapping[str, Signals]) -> Figure:
    """`runs` {brace: signals of its landing} of a scenario; empty for a study, whose landings are drawn as a distribution."""
    data = comparison.data
    shown = [n for n, b in data["braces"].items() if b["status"] == "completed"]
    drawn = Figure(figsize=(WIDTH, HEIGHT + PER_BRACE * len(shown)), layout=ConstrainedLayoutEngine(w_pad=0.06, h_pad=0.08, wspace=0.03, hspace=0.04))
    FigureCanvasAgg(drawn)
    (first, changes), (moments, motion) = drawn.subplots(2, 2)
    colour = {n: COLOURS[k % len(COLOURS)] for k, n in enumerate(data["braces"])}
    if runs:
        _curves(first, {n: runs[n] for n in shown}, colour)
    else:
        _distribution(first, comparison, shown, colour)
    _changes(changes, data, [n for n in shown if n != "none"])
    _moments(moments, data, shown)
    _motion(motion, data, [n for n in shown if data["braces"][n]["resistance_Nm"]])
    drawn.suptitle(
        f"{data['source']}: the same landing{'s' if data['kind'] == 'study' else ''} with each brace",
        color=INK,
        fontsize=10,
        fontweight="bold",
        ha="left",
        x=0.012,
    )
    gone = [n for n in data["braces"] if n not in shown]
    failed = f" · failed: {', '.join(gone)}" if gone else ""
    pose = f"pose {data['initial_pose']} · " if data["initial_pose"] else ""
    count = f"{data['landings']} landings" if data["kind"] == "study" else "one landing"
    drawn.supxlabel(f"{data['title']} · {pose}{count}{failed}", color="#5c677d", fontsize=7.5, ha="left", x=0.012)
    return drawn


def _curves(axis: Axes, runs: Mapping[str, Signals], colour: Mapping[str, str]) -> None:
    for k, (name, run) in enumerate(runs.items()):
        angle = math.degrees(1.0) * run["plant.subtalar_angle"]
        axis.plot(1e3 * run.time, angle, color=colour[name], linestyle=LINES[k % len(LINES)], linewidth=1.6, label=name)
        top = int(np.argmax(angle))
        axis.plot(1e3 * run.time[top], angle[top], "o", color=colour[name], markersize=4.5, markeredgecolor="white", markeredgewidth=0.6, zorder=4)
    _frame(axis, "Subtalar angle", "time after contact [ms]", "[deg], + supination")
    axis.legend(frameon=False, fontsize=8, labelcolor=INK, handlelength=2.6, loc="best")
    axis.grid(axis="y", color=FAINT, alpha=0.3, linewidth=0.6)


def _distribution(axis: Axes, comparison: Comparison, names: list[str], colour: Mapping[str, str]) -> None:
    """5 to 95 % as a line, the middle half as a bar, the median as a tick, the landings as dots below."""
    entries = {e.name: e for e in comparison.entries}
    for place, name in enumerate(names):
        y = np.sort(entries[name].completed["peak_subtalar_angle_deg"].to_numpy(float))
        p5, p25, p50, p75, p95 = np.percentile(y, [5, 25, 50, 75, 95])
        axis.plot([p5, p95], [place, place], color=colour[name], linewidth=1.4, solid_capstyle="butt")
        axis.plot([p25, p75], [place, place], color=colour[name], linewidth=7, solid_capstyle="butt")
        axis.plot([p50], [place], "|", color="white", markersize=7, markeredgewidth=1.6, zorder=4)
        kept = y[:: max(1, len(y) // 400)]
        axis.plot(kept, np.full(len(kept), place + 0.3), "|", color=colour[name], markersize=4, markeredgewidth=0.4, alpha=0.5)
    _named(axis, names)
    _frame(axis, "Peak supination: 5, 25, 50, 75, 95 %", "[deg], + supination", "")


def _changes(axis: Axes, data: Mapping[str, Any], names: list[str]) -> None:
    styles = (("peak_subtalar_angle_deg", "supination", "#0072B2", "o", -0.13), ("peak_inversion_from_neutral_deg", "inversion", "#D55E00", "s", 0.13))
    for place, name in enumerate(names):
        for key, label, colour, marker, shift in styles:
            e = data["braces"][name]["difference_to_none"].get(key)
            if not e or e["value"] is None:
                continue
            ends = None if e["ci_low"] is None else [[e["value"] - e["ci_low"]], [e["ci_high"] - e["value"]]]
            axis.errorbar(
                e["value"], place + shift, xerr=ends, fmt=marker, color=colour, markersize=5, capsize=2.5, elinewidth=1.3,
                label=label if place == 0 else None,
            )  # fmt: skip
    axis.axvline(0, color=FAINT, linewidth=0.8, zorder=0)
    _named(axis, names)
    axis.locator_params(axis="x", nbins=6)
    interval = ", 95 % interval" if data["kind"] == "study" and data["method"] in ("monte-carlo", "table") else ""
    _frame(axis, f"Change of the peak against none{interval}", "[deg], − less than without a brace", "")
    if names:
        axis.legend(frameon=False, fontsize=8, labelcolor=INK, handletextpad=0.3, ncols=2, loc="lower left", bbox_to_anchor=(-0.02, -0.02))
        axis.set_ylim(len(names) - 0.5 + 0.35, -0.6)


def _moments(axis: Axes, data: Mapping[str, Any], names: list[str]) -> None:
    for place, name in enumerate(names):
        values = data["braces"][name]["metrics"]
        anatomy, brace = (values.get(f"{who}_subtalar_moment_Nm", {}).get("value") for who in ("anatomy", "brace"))
        left = 0.0
        for value, colour, label in ((anatomy, ANATOMY, "anatomy"), (brace, BRACE, "brace")):
            if value is not None:
                axis.barh(place, value, left=left, height=0.55, color=colour, label=label if place == len(names) - 1 else None)
                left += value
        share = values.get("anatomy_share", {}).get("value")
        axis.annotate(f"anatomy {100 * (1.0 if brace is None else share):.0f} %" if brace is None or share is not None else "", (max(left, 0.0), place), (3, 0),
                      textcoords="offset points", va="center", fontsize=7.5, color=INK)  # fmt: skip
    _named(axis, names)
    _frame(axis, "Who resists at the peak", "moment about the subtalar axis [N·m], + resists supination", "")
    axis.locator_params(axis="x", nbins=6)
    axis.margins(x=0.34)
    if axis.dataLim.x0 >= 0:
        axis.set_xlim(left=0)
    axis.set_ylim(len(names) - 0.5 + 0.45, -0.6)
    axis.legend(frameon=False, fontsize=8, labelcolor=INK, handlelength=1.0, handletextpad=0.4, ncols=2, loc="lower right")


def _motion(axis: Axes, data: Mapping[str, Any], names: list[str]) -> None:
    """Bars at 10 degrees, a tick in each at 5."""
    height = 0.24
    for place, name in enumerate(names):
        held = data["braces"][name]["resistance_Nm"]
        for k, (motion, colour) in enumerate(MOTIONS.items()):
            at = place + (k - 1) * height
            axis.barh(at, held[f"{motion}_10deg"], height=0.9 * height, color=colour, label=motion if place == 0 else None)
            axis.plot([held[f"{motion}_5deg"]] * 2, [at - 0.45 * height, at + 0.45 * height], color=INK, linewidth=1.2)
    axis.axvline(0, color=FAINT, linewidth=0.8, zorder=0)
    _named(axis, names)
    _frame(axis, "What 10° of ordinary motion costs (tick: 5°)", "moment of the brace [N·m], + resists", "")
    if names:
        axis.margins(x=0.06)
        axis.set_ylim(len(names) - 0.5 + 0.5, -0.6)
        axis.legend(frameon=False, fontsize=8, labelcolor=INK, handlelength=1.0, handletextpad=0.4, columnspacing=1.0, ncols=3, loc="lower right")


def _named(axis: Axes, names: list[str]) -> None:
    axis.set_yticks(range(len(names)), names)
    axis.set_ylim(len(names) - 0.4, -0.6)
    axis.tick_params(axis="y", length=0)


def _frame(axis: Axes, title: str, across: str, up: str) -> None:
    axis.set_title(title, loc="left", fontsize=9, color=INK)
    axis.set_xlabel(across, fontsize=8, color=INK)
    axis.set_ylabel(up, fontsize=8, color=INK)
    axis.spines[["top", "right"]].set_visible(False)
    axis.spines[["left", "bottom"]].set_color(FAINT)
    axis.tick_params(colors=INK, labelsize=8)
