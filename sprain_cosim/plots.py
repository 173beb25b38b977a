"""Figures. Drawn without a display; every function returns a matplotlib Figure."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from .metrics import Signals

INK, FAINT = "#1f2933", "#9aa5b1"
SUBTALAR, TALOCRURAL, ANATOMY, BRACE, GROUND = "#c1292e", "#1b6ca8", "#2a9d8f", "#e09f3e", "#5c677d"
LINES = ("-", (0, (5, 1.6)), (0, (1.2, 1.2)), (0, (6, 1.5, 1.2, 1.5)))
DEGREES = math.degrees(1.0)


def landing(runs: Sequence[tuple[str, Signals]], note: str = "") -> Figure:
    """Ankle angles, velocities, subtalar moment of anatomy and brace, ground reaction over time, the subtalar peak marked.

    `runs` are (title, signals); more than one are laid over each other with different line styles. `note` goes below the figure."""
    figure = Figure(figsize=(9.6, 6.6), layout=ConstrainedLayoutEngine(w_pad=0.12, h_pad=0.12))
    FigureCanvasAgg(figure)
    axes = figure.subplots(2, 2, sharex=True)
    (angles, velocities), (moments, ground) = axes
    braced = any(_braced(run) for _, run in runs)
    for style, (_, run) in zip(LINES * len(runs), runs, strict=False):
        ms = 1e3 * run.time
        solid = dict(linestyle=style, linewidth=1.9)
        angles.plot(ms, DEGREES * run["plant.talocrural_angle"], color=TALOCRURAL, **solid)
        angles.plot(ms, DEGREES * run["plant.subtalar_angle"], color=SUBTALAR, **solid)
        velocities.plot(ms, DEGREES * run["plant.talocrural_velocity"], color=TALOCRURAL, **solid)
        velocities.plot(ms, DEGREES * run["plant.subtalar_velocity"], color=SUBTALAR, **solid)
        moments.plot(ms, run["plant.anatomy_subtalar_moment"], color=ANATOMY, **solid)
        if _braced(run):
            moments.plot(ms, run["plant.brace_subtalar_moment"], color=BRACE, **solid)
        ground.plot(ms, run["plant.ground_force_y"] / 1e3, color=GROUND, **solid)
        k = int(np.argmax(run["plant.subtalar_angle"]))
        for axis in axes.flat:
            axis.axvline(ms[k], color=SUBTALAR, linewidth=0.8, alpha=0.45, linestyle=style, zorder=0)
        peak = DEGREES * run["plant.subtalar_angle"][k]
        angles.plot(ms[k], peak, "o", color=SUBTALAR, markersize=6, zorder=4, markeredgecolor="white")
        label = {"textcoords": "offset points", "color": SUBTALAR, "fontsize": 9, "fontweight": "bold", "annotation_clip": False}
        angles.annotate(f"{peak:.1f}° at {ms[k]:.1f} ms", (ms[k], peak), (7, 7), **label)
    _panel(angles, "Ankle angle [deg]", [("subtalar, + supination", SUBTALAR), ("talocrural, + dorsiflexion", TALOCRURAL)])
    _panel(velocities, "Ankle angular velocity [deg/s]", [])
    _panel(moments, "Resisting moment about the subtalar axis [N·m]", [("anatomy", ANATOMY)] + ([("brace", BRACE)] if braced else []))
    _panel(ground, "Vertical ground reaction [kN]", [])
    for axis in axes[1]:
        axis.set_xlabel("time after contact [ms]", color=INK)
    low, high = angles.get_ylim()
    angles.set_ylim(low, high + 0.14 * (high - low))
    angles.set_xlim(0, max(1e3 * run.time[-1] for _, run in runs))
    if len(runs) == 1:
        figure.suptitle(runs[0][0], color=INK, fontsize=13, fontweight="bold", ha="left", x=0.015)
    else:
        handles = [angles.plot([], [], color=INK, linestyle=style, linewidth=1.9)[0] for style, _ in zip(LINES * len(runs), runs, strict=False)]
        figure.legend(handles, [title for title, _ in runs], loc="outside upper left", ncols=2, frameon=False, fontsize=10, labelcolor=INK, handlelength=3)
    if note:
        figure.supxlabel(note, color=FAINT, fontsize=8, ha="left", x=0.015)
    return figure


def _panel(axis: Axes, title: str, legend: list[tuple[str, str]]) -> None:
    axis.set_title(title, loc="left", fontsize=10, color=INK)
    axis.spines[["top", "right"]].set_visible(False)
    axis.spines[["left", "bottom"]].set_color(FAINT)
    axis.tick_params(colors=INK, labelsize=9, length=3)
    axis.grid(axis="y", color=FAINT, alpha=0.25, linewidth=0.7)
    axis.axhline(0, color=FAINT, linewidth=0.7)
    if legend:
        handles = [axis.plot([], [], color=color, linewidth=2.5)[0] for _, color in legend]
        axis.legend(handles, [name for name, _ in legend], frameon=False, fontsize=9, loc="best", labelcolor="linecolor", handlelength=1.2)


def _braced(run: Signals) -> bool:
    return any(name.startswith("plant.brace_") and name.endswith("_torque") for name in run.index)
