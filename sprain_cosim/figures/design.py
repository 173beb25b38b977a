"""Figures of a design question: the probability over the parameter, and one parameter over the other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from numpy.typing import NDArray

from ..study.summary import in_figures
from ..units import percentage_ends
from .style import (
    BLUE,
    FLOOR,
    GREEN,
    INK,
    LINES,
    OCHRE,
    PURPLE,
    SKY,
    VERMILION,
    legend_above,
    legend_line,
    sheet,
    small,
    styled,
)

Array = NDArray[np.float64]
LOWEST = 30.0  # times below the goal, where the axis of probabilities ends at the latest
MOTIONS = {"supination": (PURPLE, "o"), "plantarflexion": (SKY, "s"), "dorsiflexion": (OCHRE, "^")}
OTHER = (INK, "D")


@dataclass(frozen=True)
class Designed:
    """P over a parameter, and what was found.

    - goal: 0 ... 1, `event` in words
    - parameter, quantity: label of the axis, "brace angle scale"
    - value, low, high: (m,) of the curve: P and its band
    - at: the value found with the ends of its interval, None where there is none; `sure`: what holds with confidence
    - least: the goal holds from `at` on, else up to it
    - resistance: {motion: [(parameter, N·m at 5°, N·m at 10°), ...]}
    - threshold: ends of P at the value found, as far as the threshold is known; `behind` which threshold, in words
    """

    event: str
    goal: float
    quantity: str
    parameter: Array
    value: Array
    low: Array
    high: Array
    at: tuple[float, float | None, float | None] | None
    sure: float | None
    least: bool
    resistance: Mapping[str, Sequence[tuple[float, float, float]]] = field(default_factory=dict)
    threshold: tuple[float, float] | None = None
    behind: str = ""


@styled
def design_curve(found: Designed, note: str = "") -> Figure:
    """The curve with its band as far as it is known, the goal, the value found with both its doubts and the one that
    holds with 95 % confidence; below, what the device resists in ordinary motion."""
    figure, axes = sheet([5.6, *([2.8] if found.resistance else [])], note, sharex=True)
    axis = axes[0]
    known = found.low > 0
    axis.fill_between(found.parameter, found.low, found.high, where=known, color=BLUE, alpha=0.22, linewidth=0)
    axis.plot(found.parameter, np.where(known, found.value, np.nan), color=BLUE)
    axis.axhline(found.goal, color=INK, linewidth=0.8, linestyle=(0, (5, 1.6)))
    entries: list[tuple[Any, str]] = [
        (legend_line(BLUE), f"P({found.event})"),
        (legend_line(BLUE, linewidth=5, alpha=0.25), "95 % of each value by itself (landings; threshold held)"),
        (legend_line(INK, (0, (5, 1.6)), linewidth=0.8), f"the goal, {100 * found.goal:g} %"),
    ]
    if not known.all():
        most = found.high * np.where(known & np.roll(known, 1) & np.roll(known, -1), np.nan, 1.0)
        axis.plot(found.parameter, most, color=BLUE, linewidth=0.9, linestyle=LINES[2])
        entries.insert(2, (legend_line(BLUE, LINES[2], linewidth=0.9), "no more than this; how much less is not known"))
    ends = axis.get_xlim()
    if found.sure is not None:
        span = (found.sure, found.parameter[-1]) if found.least else (found.parameter[0], found.sure)
        axis.axvspan(*span, color=GREEN, alpha=0.12, linewidth=0)
        entries.append(
            (legend_line(GREEN, linewidth=5, alpha=0.3), f"the goal holds, 95 % sure: {in_figures(found.sure)}")
        )
    entries += _draw_value(axis, found)
    axis.set_yscale("log")
    seen = found.value[known & (found.value > 0)]
    bottom = max(float(seen.min()) * 0.6, found.goal / LOWEST) if len(seen) else found.goal / LOWEST
    axis.set_ylim(
        min(bottom, found.goal / 3),
        min(1.0, max(float(found.high.max()) * 1.3, found.goal * 3, 1.2 * (found.threshold or (0.0, 0.0))[1])),
    )
    axis.set_xlim(ends)
    _percent_axis(axis)
    axis.set_ylabel("probability [%]")
    axis.grid()
    if found.resistance:
        _draw_resistance(axes[1], found.resistance)
        entries += [
            (legend_line(colour, marker=mark, markersize=3), f"resists {motion} of 10° (dotted: 5°)")
            for motion in found.resistance
            for colour, mark in [MOTIONS.get(motion, OTHER)]
        ]
    axes[-1].set_xlabel(found.quantity)
    legend_above(figure, entries)
    return figure


def _draw_value(axis: Axes, found: Designed) -> list[tuple[Any, str]]:
    """The value found, its interval along the goal, upright what the threshold leaves open of P there."""
    if found.at is None:
        return []
    value, low, high = found.at
    ends = [found.parameter[0] if low is None else low, found.parameter[-1] if high is None else high]
    axis.plot(ends, [found.goal] * 2, color=VERMILION, linewidth=3.0, alpha=0.6, solid_capstyle="butt")
    axis.plot(value, found.goal, "o", color=VERMILION, markersize=4.5, zorder=5)
    said = ["below the range" if low is None else in_figures(low)]
    said += ["above the range" if high is None else in_figures(high)]
    words = f"{'least' if found.least else 'largest'} value {in_figures(value)}, 95 % {' … '.join(said)}"
    entries: list[tuple[Any, str]] = [(legend_line(VERMILION, marker="o"), words)]
    if found.threshold is not None:
        thin: Any = dict(color=VERMILION, linewidth=1.0, marker="_", markersize=5)
        axis.plot([value] * 2, [max(end, FLOOR) for end in found.threshold], **thin)
        words = f"{found.behind}, at that value: {percentage_ends(*found.threshold)[0]} %"
        entries.append((legend_line(VERMILION, linewidth=1.0, marker="|", markersize=5), words))
    return entries


def _draw_resistance(axis: Axes, resistance: Mapping[str, Sequence[tuple[float, float, float]]]) -> None:
    for motion, rows in resistance.items():
        at, five, ten = np.array(sorted(rows)).T
        colour, mark = MOTIONS.get(motion, OTHER)
        axis.plot(at, ten, marker=mark, markersize=3, color=colour)
        axis.plot(at, five, marker=mark, markersize=3, color=colour, linestyle=(0, (1.2, 1.2)))
    axis.set_ylim(bottom=min(0.0, axis.get_ylim()[0]))
    axis.set_ylabel("resists [N·m]")
    axis.grid()


def _percent_axis(axis: Axes) -> None:
    axis.yaxis.set_major_locator(LogLocator(10, (1.0, 2.0, 5.0)))
    axis.yaxis.set_major_formatter(FuncFormatter(lambda p, _: f"{100 * p:g}"))
    axis.yaxis.set_minor_formatter(NullFormatter())


@styled
def trade_off(
    quantity: str,
    second: str,
    points: Sequence[tuple[float, float, float, float, float | None]],
    least: bool,
    goal: str,
    bounds: tuple[float, float],
    note: str = "",
) -> Figure:
    """One parameter over the other: points (second, value, low, high, what holds with confidence or None) on the curve
    on whose one side the goal holds. `bounds` of the first parameter."""
    figure, (axis,) = sheet([6.0], note)
    at, value, low, high = (np.array([p[k] for p in points], float) for k in range(4))
    axis.plot(at, value, "o-", color=VERMILION)
    axis.vlines(at, low, high, color=VERMILION, linewidth=3.0, alpha=0.5)
    word = "least" if least else "largest"
    entries: list[tuple[Any, str]] = [
        (legend_line(VERMILION, marker="o"), f"{word} value for {goal}"),
        (legend_line(VERMILION, linewidth=3.0, alpha=0.5), "its 95 % interval, each by itself"),
    ]
    sure = [(p[0], p[4]) for p in points if p[4] is not None]
    if sure:
        x, y = np.array(sure, float).T
        axis.plot(x, y, color=GREEN, linestyle=(0, (5, 1.6)))
        axis.fill_between(x, y, bounds[1] if least else bounds[0], color=GREEN, alpha=0.12, linewidth=0)
        entries.append((legend_line(GREEN, (0, (5, 1.6))), "the goal holds, 95 % sure at each value"))
    axis.set_ylim(*bounds)
    axis.set_xlabel(second)
    axis.set_ylabel(quantity, fontsize=small())
    axis.grid()
    legend_above(figure, entries)
    return figure
