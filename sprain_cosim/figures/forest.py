"""The forest of a comparison: what each brace changed, paired over the same landings, response by response, with what
the landings and what the threshold leave open."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .style import (
    FORM,
    INK,
    LINE,
    SeriesLook,
    grow,
    in_two,
    large,
    legend_above,
    legend_line,
    letters,
    lines_of,
    sheet,
    small,
    styled,
    text_width,
    width_of,
)

ROW, OPEN = 0.72, 0.28  # height of a brace [cm], and of a line more of words
BESIDE = 14.0  # cm of a journal's letters from which on panels stand side by side
BESIDE_NAMES = 12.0  # points of ticks and gaps
Doubt = tuple[float, float]


@dataclass(frozen=True)
class Difference:
    """With the brace minus without, in the unit of its panel.

    value      mean over the pairs
    sampling   ends of its 95 % interval from the landings, None where they are no random sample
    threshold  its ends as far as the threshold is known; None for a response that has none
    """

    value: float
    sampling: Doubt | None = None
    threshold: Doubt | None = None


@dataclass(frozen=True)
class Changed:
    """One panel.

    quantity  what is compared
    unit      of its differences
    rows      {brace: its difference}
    """

    quantity: str
    unit: str
    rows: Mapping[str, Difference] = field(default_factory=dict)


@styled
def forest(panels: Sequence[Changed], reference: str, look: Mapping[str, SeriesLook], note: str = "") -> Figure:
    """`panels` one below the other, two side by side on a wide sheet; a line at no difference to the `reference`."""
    form, braces = FORM.get(), list(dict.fromkeys(brace for panel in panels for brace in panel.rows))
    columns = 2 if form.width / form.scale >= BESIDE and len(panels) > 1 else 1
    tall = ROW + OPEN * any(d.threshold for panel in panels for d in panel.rows.values())
    rows = [panels[k : k + columns] for k in range(0, len(panels), columns)]
    figure, axes = sheet([1.5 + tall * len(braces)] * len(rows), note, columns)
    names = [line for brace in braces for line in in_two(brace).split("\n")]
    room = width_of(figure) / columns - max(text_width(line, small()) for line in names) - BESIDE_NAMES
    titles = [lines_of(panel.quantity, room, large()) for panel in panels]
    for axis, panel, title in zip(axes, panels, titles, strict=False):
        _draw_panel(axis, panel, look, f"difference to {reference}", "\n".join(title))
    grow(figure, LINE * sum(max(map(len, titles[k : k + columns])) - 1 for k in range(0, len(titles), columns)))
    for axis in axes[len(panels) :]:
        axis.remove()
    every = [d for panel in panels for d in panel.rows.values()]
    dot = legend_line(INK, "none", marker="o")
    entries: list[tuple[Any, str]] = [(dot, f"brace minus {reference}, over the same landings")]
    if any(d.sampling for d in every):
        entries.append((legend_line(INK, linewidth=5.5, alpha=0.45), "what the landings leave open (95 %)"))
    if any(d.threshold for d in every):
        entries.append((legend_line(INK, linewidth=1.0, marker="|"), "what the threshold leaves open"))
    legend_above(figure, entries)
    return figure


def _draw_panel(axis: Axes, panel: Changed, look: Mapping[str, SeriesLook], against: str, title: str) -> None:
    beside: Any = dict(transform=axis.get_yaxis_transform(), ha="left", va="center", fontsize=small(), linespacing=1.1)
    axis.axvline(0, color=INK, linewidth=0.7, zorder=0)
    for place, (brace, found) in enumerate(panel.rows.items()):
        colour = look[brace].colour
        if found.threshold is not None:
            axis.plot(found.threshold, [place] * 2, color=colour, linewidth=1.0, marker="|", markersize=5)
        if found.sampling is not None:
            axis.plot(found.sampling, [place] * 2, color=colour, linewidth=5.5, alpha=0.45, solid_capstyle="butt")
        axis.plot(found.value, place, look[brace].dot, color=colour)
        axis.text(1.02, place, _words(found), color=letters(colour), **beside)
    axis.set_yticks(range(len(panel.rows)), [in_two(brace) for brace in panel.rows])
    axis.set_ylim(len(panel.rows) - 0.4, -0.6)
    axis.tick_params(axis="y", length=0)
    axis.margins(x=0.08)
    axis.locator_params(axis="x", nbins=5)
    axis.grid(axis="x")
    axis.set_title(title)
    axis.set_xlabel(f"{against} [{panel.unit}]")


def _words(found: Difference) -> str:
    """Value and ends, with as many digits as tell the ends of the narrower doubt apart."""
    widths = [high - low for low, high in (pair for pair in (found.sampling, found.threshold) if pair) if high > low]
    span = 0.5 * min(widths, default=2 * abs(found.value))
    digits = 1 if span >= 0.1 else 2 if span >= 0.01 else 3
    lines = [f"{found.value:+.{digits}f}"]
    lines += [f"{pair[0]:+.{digits}f} … {pair[1]:+.{digits}f}" for pair in (found.sampling, found.threshold) if pair]
    return "\n".join(lines).replace("-", "−")
