"""The pairs of a sample: inputs and response against each other, with their rank correlations."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from .style import BLUE, FORM, GROUND, INK, MATRIX, MOST_DRAWN, sheet, small, styled, text_width

Array = NDArray[np.float64]
CELL, MOST = 1.7, 5  # cm of a cell in a single column; inputs at most
LETTERS = 6.4  # of a label, per cm of its cell
AS_POINTS = 300  # more points are a picture inside the figure


@dataclass(frozen=True)
class Column:
    """Values (n,) of an input or a response, with its name and unit, and what + means where that is to be said."""

    title: str
    values: Array
    sign: str = ""


def most_inputs() -> int:
    """How many inputs a figure of this form has room for, beside the response: 3 in a single column, 5 at most."""
    form = FORM.get()
    return max(2, min(MOST, int(form.width / form.scale / (CELL + 0.35)) - 1))


def strongest(inputs: Sequence[Column], response: Column, most: int) -> list[Column]:
    """The `most` inputs of the largest absolute rank correlation with the response, those first; what does not vary is
    left out."""
    varied = [column for column in inputs if np.ptp(column.values) > 0]
    if not varied or not np.ptp(response.values) > 0:
        return varied[:most]
    from ..uq.sensitivity import spearman

    r = np.abs(spearman(np.column_stack([c.values for c in varied]), response.values).value)
    return [varied[k] for k in np.argsort(-r, kind="stable")[:most]]


@styled
def pairs(columns: Sequence[Column], intervals: bool, note: str = "") -> Figure:
    """`columns`, the response last: points below the diagonal, distributions on it, Spearman's rank correlation above
    with its 95 % interval where `intervals` (independent draws). Of large samples some points are drawn, the numbers
    are of all."""
    from ..uq.sensitivity import spearman

    m, every = len(columns), np.column_stack([c.values for c in columns])
    signs = "; ".join(f"{c.title.partition(' [')[0]} +\u00a0{c.sign}" for c in columns if c.sign)
    figure, axes = sheet([1.05 * _cell(m)] * m, f"{note} Signs: {signs}." if signs else note, m)
    figure.set_label(MATRIX)
    ranks = [spearman(every, column.values) for column in columns]
    for place, axis in enumerate(axes):
        row, at = divmod(place, m)
        if at > row:
            r = ranks[row]
            _number(axis, r.value[at], (r.low[at], r.high[at]) if intervals else ())
            continue
        if at == row:
            _marginal(axis, columns[row].values)
        else:
            _scatter(axis, columns[at].values, columns[row].values, row == m - 1)
        _label(axis, columns, row, at)
    return figure


def _cell(m: int) -> float:
    """Width of one of `m` cells [cm of a journal]: the names at the left take nearly as much as one."""
    return FORM.get().width / FORM.get().scale / (m + 0.9)


def _number(axis: Axes, value: float, ends: Sequence[float]) -> None:
    axis.set(xticks=[], yticks=[])
    axis.spines[:].set_visible(False)
    middle: Any = dict(transform=axis.transAxes, ha="center", va="center")
    if np.isnan(value):
        axis.text(0.5, 0.5, "–", **middle)
        return
    words = "\n".join([f"{value:+z.2f}", " …\n".join(f"{end:+z.2f}" for end in ends)]).strip()
    axis.text(0.5, 0.5, words.replace("-", "−"), fontsize=small(), color=INK, **middle)


def _marginal(axis: Axes, values: Array) -> None:
    axis.hist(values, bins=max(5, min(20, int(np.sqrt(len(values))))), color=GROUND, alpha=0.6)
    axis.set_yticks([])
    axis.spines["left"].set_visible(False)


def _scatter(axis: Axes, x: Array, y: Array, of_response: bool) -> None:
    every = -(-len(x) // MOST_DRAWN)
    x, y = x[::every], y[::every]
    look: Any = dict(markersize=1.8, alpha=0.45, markeredgewidth=0, color=BLUE if of_response else GROUND)
    axis.plot(x, y, "o", rasterized=len(x) > AS_POINTS, **look)


def _label(axis: Axes, columns: Sequence[Column], row: int, at: int) -> None:
    """Names at the left and below; numbers there alone."""
    last, cell = len(columns) - 1, _cell(len(columns))
    wide, points = int(LETTERS * cell), 72 / 2.54 * cell * FORM.get().scale
    axis.set(xlim=_ends(columns[at].values), xticks=_two_ticks(columns[at].values, points))
    if at != row:
        axis.set(ylim=_ends(columns[row].values), yticks=_two_ticks(columns[row].values, points))
    if row == last:
        axis.set_xlabel(textwrap.fill(columns[at].title, wide), fontsize=small())
    else:
        axis.tick_params(axis="x", labelbottom=False)
    if at == 0 and row > 0:
        axis.set_ylabel(textwrap.fill(columns[row].title, wide), fontsize=small())
    elif at != row:
        axis.tick_params(axis="y", labelleft=False)


def _ends(values: Array) -> tuple[float, float]:
    room = 0.06 * float(np.ptp(values)) or 1.0
    return float(values.min()) - room, float(values.max()) + room


def _two_ticks(values: Array, points: float) -> list[float]:
    """Round values away from the ends, two at most, and one where two numbers would touch in a cell `points` wide; of
    two values, such as those of a choice, both."""
    if len(both := np.unique(values)) == 2:
        return [float(value) for value in both]
    low, high = _ends(values)
    fit: list[list[float]] = []
    for share, bins in product((0.12, 0.04), (6, 10, 4)):
        room = share * (high - low)
        ticks = MaxNLocator(bins, steps=[1, 2, 5, 10]).tick_values(low, high)
        inside = [float(tick) for tick in ticks if low + room <= tick <= high - room]
        fit.append(inside if len(inside) < 3 else [inside[0], inside[-1]])
        if len(inside) > 1 and _apart(fit[-1], points / (high - low)):
            return fit[-1]
    return fit[0][:1]


def _apart(ticks: Sequence[float], scale: float) -> bool:
    """Whether the numbers at two ticks leave a gap between them, at `scale` points per unit."""
    decimals = max(len(f"{tick:.6g}".partition(".")[2]) for tick in ticks)
    wide = [text_width(f"{tick:.{decimals}f}", small()) for tick in ticks]
    return scale * (ticks[-1] - ticks[0]) >= 0.5 * sum(wide) + 4.0 * FORM.get().scale
