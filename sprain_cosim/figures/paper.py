"""Figures 1C, 4 and 5 of Yoder, Petrella & Farrokhi 2021 (doi 10.3389/fbioe.2021.765331), ours with the published
figures beside."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ..literature import BRACES
from .law import AXES, SPAN, law_looks, resisting
from .samples import Sample, open_end, probability_axis, published_circle, published_key, step_curve
from .style import FAINT, FORM, INK, legend_above, legend_line, looks, sheet, small, styled

Array = NDArray[np.float64]
LAWS = {"passive ankle": 1.0, **BRACES}  # angle scale f
EVERY = 5.0  # degrees between two circles
TOP = 60.0  # N·m, where the panels end


@dataclass(frozen=True)
class Repeated:
    """One study of the paper, run here.

    number   of the study
    sample   its peaks and levels, with the published levels
    records  peaks (n,) of the authors' own trials, as far as they are at hand
    """

    number: int
    sample: Sample
    records: Array | None = None

    @property
    def gaps(self) -> dict[float, float]:
        """{level in %: ours minus published}."""
        ours = self.sample.percentiles
        return {level: ours[level][0] - value for level, value in self.sample.published.items() if level in ours}

    @property
    def agreeing(self) -> int:
        """How many published levels lie within our 95 % intervals, of those that have both ends."""
        ours = self.sample.percentiles
        return sum(ours[p][1] <= self.sample.published[p] <= ours[p][2] for p in self.gaps)

    @property
    def open_ended(self) -> int:
        """How many published levels stand beside an interval that too few landings leave open."""
        return sum(open_end(*self.sample.percentiles[p][1:]) is not None for p in self.gaps)


def signed_gap(value: float, digits: int) -> str:
    """ "−0.5", and "+0.0" for whatever rounds to nothing."""
    return f"{round(value, digits) + 0.0:+.{digits}f}".replace("-", "−")


@styled
def figure_1c(measured: Mapping[str, Mapping[str, tuple[Array, Array]]], note: str = "") -> Figure:
    """Resisting torque of the shipped bushing over the angle, as its FMU gives it, {law of LAWS: {axis: (angle [rad],
    torque [N·m])}}; circles are the published polynomial."""
    figure, axes = sheet([3.1] * len(AXES), note, sharex=True)
    entries: list[tuple[Any, str]] = []
    for (name, scale), colour, line in zip(LAWS.items(), *law_looks(len(LAWS) - 1), strict=True):
        for axis, key in zip(axes, AXES, strict=True):
            angle, torque = measured[name][key]
            axis.plot(np.degrees(angle), torque, color=colour, linestyle=line)
            at = np.arange(-SPAN, SPAN + EVERY / 2, EVERY)
            law = resisting(key, np.radians(at), scale)
            for degrees, value in zip(at, law, strict=True):
                if abs(value) < TOP:
                    published_circle(axis, degrees, value, 3.2)
        entries.append((legend_line(colour, line), f"{name}, f = {scale:g}: the FMU"))
    for axis, title in zip(axes, AXES.values(), strict=True):
        axis.set_title(f"torque about {title}")
        axis.set_ylim(-TOP, TOP)
        axis.axhline(0, color=FAINT, linewidth=0.6)
        axis.axvline(0, color=FAINT, linewidth=0.6)
        axis.grid()
    axes[0].text(-SPAN, TOP - 4, f"clipped at ± {TOP:g} N·m", fontsize=small(), va="top")
    axes[-1].set_xlabel("angle [deg]; torque + resists the positive angle")
    entries.append((published_key(3.2), "P(f t), published coefficients"))
    legend_above(figure, entries)
    return figure


@styled
def figure_4(studies: Sequence[Repeated], quantity: str, note: str = "") -> Figure:
    """Distribution functions of the six studies; circles are the published 5, 50 and 95 % levels, thin lines the
    authors' own trials. The legend has our levels minus theirs."""
    figure, (axis,) = sheet([7.4], note)
    entries: list[tuple[Any, str]] = []
    for study, look in zip(studies, looks(len(studies)), strict=True):
        sample = study.sample
        if study.records is not None:
            theirs = np.sort(study.records)
            share = np.arange(1, len(theirs) + 1) / len(theirs)
            axis.step(theirs, share, where="post", color=INK, linewidth=0.6, alpha=0.7)
        step_curve(axis, sample, look)
        for level, value in sample.published.items():
            published_circle(axis, value, level / 100, 4.5)
        apart = ",\u00a0".join(signed_gap(gap, 1) for gap in study.gaps.values())
        entries.append((look.key(), f"{sample.title} ({apart}°)" if apart else sample.title))
    probability_axis(axis, quantity)
    _number(axis, studies)
    entries.append((published_key(4.5), "published levels; in brackets ours minus theirs at 5, 50, 95 %"))
    if any(study.records is not None for study in studies):
        entries.append((legend_line(INK, linewidth=0.6), "half of the authors' own trials"))
    legend_above(figure, entries)
    return figure


def _number(axis: Axes, studies: Sequence[Repeated]) -> None:
    """Each curve's number where it leaves the 5 % level, above its neighbour's where that is too near."""
    low, high = axis.get_xlim()
    before, rows = -np.inf, 0
    beside: Any = dict(fontsize=small(), ha="right", va="center", textcoords="offset points")
    for at, number in sorted((float(np.percentile(s.sample.values, 5)), s.number) for s in studies):
        rows = rows + 1 if at - before < 0.05 * (high - low) else 0
        axis.annotate(str(number), (at, 0.05), (-5, 9 * rows * FORM.get().scale), **beside)
        before = at
