"""Figures of searches for one number: the probability of an event by form, the indices of sobol-indices."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from ..records import ends_of
from .questions import Answer, in_percent, shape_key
from .samples import Interval, height_of, name_inputs
from .style import BLUE, FLOOR, INK, SKY, VERMILION, legend_above, legend_line, on_axis, sheet, styled

ROW = 0.62  # cm of a method


@styled
def event_search(
    answer: Answer, orders: Mapping[str, float], importance: Mapping[str, float], note: str = ""
) -> Figure:
    """The probability of an event with both of its doubts, what first and second order alone say, and which inputs lead
    to it.

    - answer: the estimate from sampling about the design point
    - orders: {method: probability}
    - importance: {input, or "threshold": component of the unit vector}, + where more of it raises the response
    """
    names = sorted(importance, key=lambda n: abs(importance[n]))
    rows: list[tuple[str, float | None]] = [
        ("sampling" if answer.sampling is not None else "first order", answer.value),
        *orders.items(),
    ]
    figure, (top, below) = sheet([1.5 + ROW * (len(rows) + 1), height_of(names)], note)
    entries: list[tuple[Any, str]] = [(legend_line(INK, "none", marker="|", markersize=8), answer.words)]
    entries += _draw_event(top, rows, answer)
    _draw_bars(below, [importance[n] for n in names], names)
    below.set(xlim=(-1, 1), xticks=[-1, -0.5, 0, 0.5, 1])
    below.set_xlabel("importance (unit vector),\n+ leads to the event")
    legend_above(figure, entries)
    return figure


def _draw_event(axis: Axes, rows: Sequence[tuple[str, float | None]], answer: Answer) -> list[tuple[Any, str]]:
    entries: list[tuple[Any, str]] = []
    if answer.sampling is not None:
        ends = [max(end, FLOOR) for end in answer.sampling]
        axis.plot(ends, [0, 0], color=BLUE, linewidth=5.5, alpha=0.6, solid_capstyle="butt")
        entries.append((legend_line(BLUE, linewidth=5.5, alpha=0.6), "what the landings leave open (95 %)"))
    for place, (_, value) in enumerate(rows):
        if value is not None:
            at, mark = on_axis(value, "|")
            axis.plot(at, place, mark, color=INK, markersize=8, markeredgewidth=1.4)
    last, doubt = len(rows), answer.threshold or ends_of(answer.shapes)
    if doubt is not None:
        axis.plot([max(end, FLOOR) for end in doubt], [last, last], color=VERMILION, linewidth=2.2)
        entries.append((legend_line(VERMILION, linewidth=2.2), "what is open of the threshold"))
    for law, value in answer.shapes.items():
        key = shape_key(law)
        at, mark = on_axis(value, key.get_marker())
        axis.plot(at, last, mark, color="white", markeredgecolor=INK, markersize=4)
        entries.append((key, f"threshold {law}, of the same mean and SD"))
    labels = [name.replace(", ", ",\n") for name, _ in rows] + (["threshold"] if doubt is not None else [])
    axis.set_yticks(range(len(labels)), labels)
    axis.set_ylim(len(labels) - 0.4, -0.6)
    axis.tick_params(axis="y", length=0)
    axis.set_xscale("log")
    low, high = axis.get_xlim()
    axis.set_xlim(max(FLOOR, min(low, 0.3 * high)), min(1.0, 1.5 * high))
    axis.xaxis.set_major_locator(LogLocator(10, (1.0, 3.0)))
    axis.xaxis.set_major_formatter(FuncFormatter(lambda p, _: in_percent(p)))
    axis.xaxis.set_minor_formatter(NullFormatter())
    axis.grid(axis="x")
    axis.set_xlabel("probability [%]")
    return entries


@styled
def variance_shares(
    first: Mapping[str, Interval], total: Mapping[str, Interval], quantity: str, title: str, note: str = ""
) -> Figure:
    """Sobol' indices of the inputs {parameter: (value, low, high)}: what each explains of the variance of `quantity`
    alone, and in all with the others."""
    names = sorted(total, key=lambda n: total[n][0])
    figure, (axis,) = sheet([1.2 + 0.7 * len(names)], note)
    entries: list[tuple[Any, str]] = [(legend_line(INK, "none"), text) for text in (title, quantity)]
    looks: Sequence[tuple[str, Mapping[str, Interval], float, Any]] = (
        ("first order: alone", first, 0.19, dict(facecolor=BLUE, edgecolor="white", linewidth=0)),
        ("total: with the others", total, -0.19, dict(facecolor=SKY, hatch="////", edgecolor="white", linewidth=0)),
    )
    for words, values, shift, look in looks:
        for place, name in enumerate(names):
            if name not in values:
                continue
            value, low, high = values[name]
            axis.barh(place + shift, value, 0.36, **look)
            axis.plot([low, high], [place + shift] * 2, color=INK, linewidth=0.9, marker="|", markersize=3)
        entries.append((Rectangle((0, 0), 1, 1, **look), words))
    name_inputs(axis, names)
    ends = [end for values in (first, total) for interval in values.values() for end in interval if end == end]
    axis.set_xlim(min(-0.12, 1.05 * min(ends)), max(1.02, 1.05 * max(ends)))
    axis.set_xticks([0, 0.25, 0.5, 0.75, 1.0], ["0", "25", "50", "75", "100"])
    axis.set_xlabel("share of the variance [%]")
    entries.append((legend_line(INK, linewidth=0.9, marker="|", markersize=3), "95 % interval"))
    legend_above(figure, entries)
    return figure


def _draw_bars(axis: Axes, values: Sequence[float], names: Sequence[str]) -> None:
    for place, value in enumerate(values):
        axis.barh(place, value, 0.62, color=BLUE if value >= 0 else VERMILION, alpha=0.85)
    name_inputs(axis, names)
