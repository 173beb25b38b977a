"""The figure of a study's questions: how likely a response exceeds a threshold, with what is not known of the sample
and of the threshold apart."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from numpy.typing import NDArray

from ..records import ends_of
from ..units import FINEST, percentage, percentage_ends
from .style import (
    BLUE,
    FAINT,
    FLOOR,
    FORM,
    INK,
    LINE,
    VERMILION,
    grow,
    legend_above,
    legend_line,
    on_axis,
    sheet,
    small,
    styled,
)

Array = NDArray[np.float64]
Pair = tuple[float, float]
MARKERS: Mapping[str, str] = {"normal": "o", "lognormal": "^", "Weibull": "s"}
ROW = 0.6  # height of an answer's bars [cm]
CURVE, AROUND = 1.9, 1.35  # height of a curve's panel, and of its title and axis [cm]


@dataclass(frozen=True)
class Answer:
    """A probability.

    - title: the event, in words
    - value: None for bounds
    - sampling, threshold: 95 % intervals from the sample and of the threshold, None where none is known
    - shapes: {law of the same mean and SD: value}
    - finest: what `percentage` shows of it
    """

    title: str
    value: float | None
    sampling: Pair | None = None
    threshold: Pair | None = None
    shapes: Mapping[str, float] = field(default_factory=dict)
    finest: float = FINEST

    @property
    def words(self) -> str:
        """The value with what the sample leaves open; numbers stay with their units when a line is broken."""
        said = [self.title]
        if self.value is not None:
            low, high = self.sampling or (None, None)
            ends = "".join(f" ({e} %)" for e in percentage_ends(low, high, self.finest))
            said.append(f"{percentage(self.value, self.finest)} %{ends}")
        words = ": ".join(said)
        return re.sub(r" (?=%|deg|N·m|±|…|\.\.\.)|(?<=±|=|…|<|>) |(?<=\.\.\.) ", "\u00a0", words)


@dataclass(frozen=True)
class Exceeded:
    """The probability (n,) of exceeding fixed thresholds (n,) of one response, with the ends (n,) of its intervals."""

    quantity: str
    threshold: Array
    value: Array
    low: Array
    high: Array


@styled
def questions(answers: Sequence[Answer], curves: Sequence[Exceeded], note: str = "") -> Figure:
    """Each answer as two bars, sample above threshold, on a logarithmic axis; below, each response's probability of
    exceeding any fixed threshold, with its band."""
    titles = [textwrap.wrap(answer.words, FORM.get().letters_in(58)) for answer in answers]
    heights = [ROW + LINE * len(lines) for lines in titles]
    figure, axes = sheet([sum(heights) + 0.15, *(CURVE for _ in curves)], note)
    grow(figure, 0.85 + AROUND * len(curves))
    _draw_answers(axes[0], answers, titles, heights)
    for axis, curve in zip(axes[1:], curves, strict=True):
        _draw_curve(axis, curve)
    entries: list[tuple[Any, str]] = []
    if any(a.sampling for a in answers):
        entries.append((legend_line(BLUE, linewidth=4.5), "what the sample leaves open (95 %)"))
    if any(a.threshold for a in answers):
        entries.append((legend_line(VERMILION, linewidth=2.2), "what is open of the threshold (95 %, or its ends)"))
    shapes = [law for law in MARKERS if any(law in a.shapes for a in answers)]
    entries += [(shape_key(law), f"threshold {law}, of the same mean and SD") for law in shapes]
    legend_above(figure, entries)
    return figure


def _draw_answers(
    axis: Axes, answers: Sequence[Answer], titles: Sequence[Sequence[str]], heights: Sequence[float]
) -> None:
    """From above, in centimetres."""
    least, top = 0.3, 0.0
    for answer, lines, height in zip(answers, titles, heights, strict=True):
        found = [*(answer.sampling or ()), *(answer.threshold or ()), *answer.shapes.values(), answer.value]
        least = min([least, *(v for v in found if v is not None and v > 0)])
        words = axis.text(
            0, top, "\n".join(lines), fontsize=small(), transform=axis.get_yaxis_transform(), va="top", linespacing=1.15
        )
        words.set_in_layout(False)  # longer than the panel, shorter than the sheet
        place = top + LINE * len(lines)
        _draw_answer(axis, answer, place + 0.16, place + 0.38)
        top += height
    axis.set_xscale("log")
    axis.set_xlim(max(0.6 * least, FLOOR), 1.0)
    axis.xaxis.set_major_locator(LogLocator(10))
    axis.xaxis.set_major_formatter(FuncFormatter(lambda p, _: in_percent(p)))
    axis.xaxis.set_minor_formatter(NullFormatter())
    axis.set_ylim(top + 0.1, -0.05)
    axis.set_yticks([])
    axis.spines["left"].set_visible(False)
    axis.grid(axis="x")
    axis.set_xlabel("probability [%]")


def _draw_answer(axis: Axes, answer: Answer, above: float, below: float) -> None:
    if answer.sampling is not None:
        ends = np.maximum(answer.sampling, FLOOR)
        axis.plot(ends, [above, above], color=BLUE, linewidth=4.5, solid_capstyle="butt")
    if answer.threshold is not None:
        ends = np.maximum(answer.threshold, FLOOR)
        axis.plot(ends, [below, below], color=VERMILION, linewidth=2.2, solid_capstyle="butt")
    if (shapes := ends_of(answer.shapes)) is not None:
        axis.plot(np.maximum(shapes, FLOOR), [below, below], color=INK, linewidth=0.6)
    for law, value in answer.shapes.items():
        place, mark = on_axis(value, MARKERS[law])
        look: Any = dict(color="white", markeredgecolor=INK, markersize=4, clip_on=False, zorder=3)
        axis.plot(place, below, mark, **look)
    if answer.value is not None:
        place, mark = on_axis(answer.value, "|")
        axis.plot(place, above, mark, color=INK, markersize=8, markeredgewidth=1.4)


def _draw_curve(axis: Axes, curve: Exceeded) -> None:
    axis.fill_between(curve.threshold, curve.low, curve.high, color=BLUE, alpha=0.22, linewidth=0)
    axis.plot(curve.threshold, curve.value, color=BLUE)
    axis.set_ylim(-0.02, 1.02)
    axis.set_yticks([0, 0.5, 1], ["0 %", "50 %", "100 %"])
    axis.axhline(0, color=FAINT, linewidth=0.5)
    axis.grid()
    axis.set_title("landings above a fixed threshold, 95 % band")
    axis.set_xlabel(curve.quantity.replace(", +", ",\n+"))


def shape_key(law: str) -> Any:
    return legend_line(INK, "none", marker=MARKERS[law], markerfacecolor="white", markersize=4)


def in_percent(p: float) -> str:
    share = 100 * p
    return f"{share:.0f} %" if share >= 10 else f"{share:.2g} %"
