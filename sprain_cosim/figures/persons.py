"""For whom a brace works: peak and probability of each brace by measures of the persons who landed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..folders.comparison import INJURY, NONE, ComparisonSummary, Persons, called
from ..literature import INJURY_INVERSION_TEXT
from ..records import ends_of
from .style import SeriesLook, label, legend_above, palette, sheet, styled

HEIGHT = 3.4  # cm of a panel
PALE, WIDE = 0.25, 4.0  # of what the shape of the threshold leaves open, points


@styled
def persons_figure(summary: ComparisonSummary) -> Figure:
    """One row a measure: the mean of the response left, the probability right, over parts of the measure's range with
    equal numbers of landings, each with its 95 % interval, and pale what the shape of the threshold leaves open of
    the probability. `summary` has persons, and parts of them."""
    persons = summary.persons
    assert persons is not None
    parts = ", ".join(str(n) for n in sorted({len(bands) for bands in persons.bands.values()}))
    note = f"{summary.source}: {summary.count}, the same for every brace. Means over {parts} parts of the persons with "
    note += "equal numbers, with their 95\u00a0% intervals; pale, of the probability: a threshold of another shape."
    drawn, axes = sheet([HEIGHT] * len(persons.bands), note, columns=2)
    braces = list(next(iter(persons.bands.values()))[0].metrics)
    shown = palette(list(summary.braces), [NONE])
    for row, name in enumerate(persons.bands):
        left, right = axes[2 * row], axes[2 * row + 1]
        _by_measure(left, persons, name, persons.response, 1.0, {b: shown[b] for b in braces})
        _by_measure(right, persons, name, INJURY, 100.0, {b: shown[b] for b in braces})
        right.set_ylim(bottom=0.0)
        if row == 0:
            left.set_title("peak inversion [deg]")
            right.set_title(f"P(> {INJURY_INVERSION_TEXT}°) [%]")
    names = [(shown[b].key(marker=shown[b].dot, markersize=2.5), called(b)) for b in braces]
    legend_above(drawn, names, columns=min(3, len(names)))
    return drawn


def _by_measure(
    axis: Axes, persons: Persons, name: str, metric: str, factor: float, look: Mapping[str, SeriesLook]
) -> None:
    bands = persons.bands[name]
    for shift, (brace, one) in enumerate(look.items()):
        found = [band.metrics[brace].get(metric) for band in bands]
        middles = [0.5 * (b.low + b.high) if b.mean is None else b.mean for b in bands]
        points = [(at, e) for at, e in zip(middles, found, strict=True) if e and e.value is not None]
        if not points:
            continue
        offset = 0.004 * (bands[-1].high - bands[0].low) * (shift - 0.5 * (len(look) - 1))
        x = np.array([at + offset for at, _ in points])
        shapes = [ends_of(band.injury_shapes.get(brace)) if metric == INJURY else None for band in bands]
        for at, doubt in zip(middles, shapes, strict=True):
            if doubt:
                low_end, high_end = (factor * end for end in doubt)
                axis.vlines(at + offset, low_end, high_end, color=one.colour, alpha=PALE, linewidth=WIDE)
        y = factor * np.array([e.value for _, e in points], float)
        ends = [[np.nan if end is None else end for end in (e.ci_low, e.ci_high)] for _, e in points]
        low, high = factor * np.array(ends, float).T
        half = np.array([y - low, high - y])  # an interval of a probability is not even about it
        drawn: Any = dict(color=one.colour, linestyle=one.line, marker=one.dot, markersize=2.5, capsize=1.5)
        axis.errorbar(x, y, yerr=half, **drawn)
    axis.set_xlabel(f"{label(name)} [{persons.units[name]}]")
    axis.grid(axis="y")
    axis.locator_params(axis="x", nbins=4)
