"""Figures of landings: signals over time, moments over angle, the phase plane, who bears the moment, fans of many
landings."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from ..cosim.result import Result
from ..folders.run import RunSummary, coupling_note, write_run
from ..literature import INJURY_INVERSION, LI_SAFE, LI_SOURCE, LI_SPRAIN, LI_SPRAIN_VELOCITY
from ..metrics import IMPACT, Signals, brace_torques
from .style import (
    BORNE,
    FAINT,
    GROUND,
    INK,
    LINE,
    LINES,
    MOST_DRAWN,
    MUTED,
    PATCH,
    band_above,
    legend_above,
    legend_line,
    letters,
    looks_of,
    picture,
    sheet,
    small,
    styled,
    title_lines,
)

Array = NDArray[np.float64]
DEGREES = math.degrees(1.0)
TIME = "time after contact [ms]"
# what is drawn over time: title with unit and sign, signal, factor to the unit
PANELS = (
    ("subtalar angle [deg], + supination", "plant.subtalar_angle", DEGREES),
    ("talocrural angle [deg], + dorsiflexion", "plant.talocrural_angle", DEGREES),
    ("subtalar velocity [deg/s], + supination", "plant.subtalar_velocity", DEGREES),
    ("subtalar moment, anatomy [N·m], + resists", "plant.anatomy_subtalar_moment", 1.0),
    ("subtalar moment, brace [N·m], + resists", "plant.brace_subtalar_moment", 1.0),
    ("vertical ground reaction [kN], + up", "plant.ground_force_y", 1e-3),
)


@styled
def landing_signals(runs: Sequence[tuple[str, Signals]], note: str = "") -> Figure:
    """Ankle angles, velocity, subtalar moments and ground reaction over time; `runs` are (title, signals), laid over
    each other, the subtalar peaks marked."""
    drawn = [p for p in PANELS if any(_has(run, p[1]) for _, run in runs)]
    look = looks_of([title for title, _ in runs])
    figure, axes = sheet([2.9] + [2.3] * (len(drawn) - 1), note, sharex=True)
    for axis, (title, signal, factor) in zip(axes, drawn, strict=True):
        for one, (_, run) in zip(look, runs, strict=True):
            if _has(run, signal):
                axis.plot(1e3 * run.time, factor * run[signal], **one.along(len(run.time)))
        _panel(axis, title)
        if signal == "plant.ground_force_y":
            _cut_impact(axis, [(run.time, factor * run[signal]) for _, run in runs if _has(run, signal)])
    peaks = [
        (int(np.argmax(run["plant.subtalar_angle"])), DEGREES * float(run["plant.subtalar_angle"].max()))
        for _, run in runs
    ]
    for (color, *_), (_, run), (k, peak) in zip(look, runs, peaks, strict=True):
        at = 1e3 * run.time[k]
        axes[0].plot(at, peak, "o", color=color, markeredgecolor="white", markeredgewidth=0.6, zorder=4)
        if len(runs) <= 2:
            above = peak == max(p for _, p in peaks)
            style_of_text: Any = dict(
                textcoords="offset points",
                ha="center" if above else "left",  # the lower one beside the rise that leads to its peak
                va="bottom" if above else "top",
                color=letters(color),
                fontsize=small(),
                bbox=PATCH,
            )
            axes[0].annotate(f"{peak:z.1f}° at {at:.1f} ms", (at, peak), (0, 5 if above else -5), **style_of_text)
    band_above(axes[0], 0.18)
    _share_moments(axes, drawn)
    axes[-1].set_xlabel(TIME)
    axes[-1].set_xlim(0, max(1e3 * run.time[-1] for _, run in runs))
    names = [
        title if len(runs) <= 2 else f"{title} (peak\u00a0{peak:z.1f}°)"
        for (title, _), (_, peak) in zip(runs, peaks, strict=True)
    ]
    legend_above(
        figure,
        [(one.key(), name) for one, name in zip(look, names, strict=True)],
    )
    return figure


@styled
def moment_angle(runs: Sequence[tuple[str, Signals]], note: str = "") -> Figure:
    """Resisting subtalar moment of anatomy and brace over the subtalar angle, as the landings went through them: a loop
    shows rate dependence or coupling with the other axes."""
    braced = any(_has(run, "plant.brace_subtalar_moment") for _, run in runs)
    look = looks_of([title for title, _ in runs])
    figure, axes = sheet([3.6] * (1 + braced), note, sharex=True)
    for axis, who in zip(axes, ("anatomy", "brace"), strict=False):
        signal = f"plant.{who}_subtalar_moment"
        for one, (_, run) in zip(look, runs, strict=True):
            if _has(run, signal):
                angle, moment = DEGREES * run["plant.subtalar_angle"], run[signal]
                axis.plot(angle, moment, **one.along(len(angle)))
                k = int(np.argmax(angle))
                at_peak: Any = dict(markeredgecolor="white", markeredgewidth=0.6, zorder=4)
                axis.plot(angle[k], moment[k], "o", color=one.colour, **at_peak)
        _panel(axis, f"moment of the {who} [N·m], + resists supination")
    _share_moments(axes, [("", f"plant.{who}_subtalar_moment", 1.0) for who in ("anatomy", "brace")][: len(axes)])
    axes[-1].set_xlabel("subtalar angle [deg], + supination; ● at its peak")
    legend_above(
        figure,
        [(one.key(), title) for one, (title, _) in zip(look, runs, strict=True)],
    )
    return figure


@styled
def phase(
    tracks: Sequence[tuple[str, Array, Array]], points: Sequence[tuple[str, Array, Array]], note: str = ""
) -> Figure:
    """Inversion velocity over inversion angle, beside the injury range and the measured sprain.

    - tracks: (title, angle (n,) [deg], velocity (n,) [deg/s]) of single landings
    - points: (title, peak angles (m,) [deg], peak velocities (m,) [deg/s]) of studies; a trial's two peaks do not come
      at the same time

    Angles are inversion from the neutral pose; each published source has a zero of its own.
    """
    figure, (axis,) = sheet([7.0], note)
    mean, sd = INJURY_INVERSION
    axis.axvspan(mean - sd, mean + sd, color=FAINT, alpha=0.28, linewidth=0)
    entries = _draw_tracks_and_points(axis, tracks, points)
    entries += _draw_measured_trials(axis)
    axis.axhline(0, color=FAINT, linewidth=0.6)
    axis.grid(axis="y")
    axis.set_xlabel("inversion from the neutral pose [deg], + inversion")
    axis.set_ylabel("inversion velocity [deg/s], + inversion")
    axis.set_xlim(axis.get_xlim()[0], max(62.0, axis.get_xlim()[1]))
    _limit_velocity(axis, tracks, points)
    legend_above(figure, entries)
    return figure


def _draw_tracks_and_points(
    axis: Axes, tracks: Sequence[tuple[str, Array, Array]], points: Sequence[tuple[str, Array, Array]]
) -> list[tuple[Any, str]]:
    """Returns the entries of the legend."""
    titles = list(dict.fromkeys(title for title, _, _ in (*points, *tracks)))
    look = dict(zip(titles, looks_of(titles), strict=True))
    diamond: Any = dict(markersize=3.5, markeredgecolor="white", markeredgewidth=0.5, zorder=4)
    for title, angle, velocity in points:
        dots: Any = dict(color=look[title].colour, markersize=2.2, alpha=0.5, markeredgewidth=0)
        axis.plot(angle, velocity, look[title].dot, rasterized=len(angle) > MOST_DRAWN, **dots)
    for title, angle, velocity in tracks:
        axis.plot(angle, velocity, **look[title].along(len(angle)))
        axis.plot(angle.max(), velocity.max(), "D", color=look[title][0], **diamond)
    lines, dots = {title for title, _, _ in tracks}, {title for title, _, _ in points}
    entries: list[tuple[Any, str]] = []
    for title, one in look.items():
        if title not in dots:
            entries.append((one.key(), title))
            continue
        line = one.line if title in lines else "none"
        entries.append((legend_line(one.colour, line, marker=one.dot, markersize=3.5), title))
    if points:
        small_dot: Any = dict(marker="o", markersize=2.2, markeredgewidth=0)
        entries.append((legend_line(INK, "none", **small_dot), "peak angle and peak velocity of each trial"))
    if tracks:
        entries.append(
            (
                legend_line(INK, "none", marker="D", markersize=3.5),
                "peak angle and peak velocity of the landing drawn as a line",
            )
        )
    return entries


def _draw_measured_trials(axis: Axes) -> list[tuple[Any, str]]:
    """The angles measured without injury, whose velocity is not stated: a column over all velocities; and the measured
    sprain. Returns the entries of the legend."""
    (mean, sd), column = INJURY_INVERSION, axis.get_xaxis_transform()
    frame: Any = dict(fill=False, edgecolor=INK, linestyle=LINES[1])
    axis.add_patch(Rectangle((LI_SAFE[0], 0), LI_SAFE[1] - LI_SAFE[0], 1, linewidth=0.9, transform=column, **frame))
    axis.plot([LI_SPRAIN, LI_SPRAIN], LI_SPRAIN_VELOCITY, color=INK, linewidth=1.8, solid_capstyle="butt")
    return [
        (
            Rectangle((0, 0), 1, 1, color=FAINT, alpha=0.28, linewidth=0),
            f"{mean:g} ± {sd:g}°: inversion at injury of cadaver ankles",
        ),
        (Rectangle((0, 0), 1, 1, **frame), f"angles measured without injury, velocity not stated ({LI_SOURCE})"),
        (legend_line(INK, linewidth=1.8), f"measured sprain ({LI_SOURCE})"),
    ]


def _limit_velocity(
    axis: Axes, tracks: Sequence[tuple[str, Array, Array]], points: Sequence[tuple[str, Array, Array]]
) -> None:
    """Leaves out the few trials far above the others, and says how many they are."""
    velocities = np.concatenate([v for _, _, v in (*points, *tracks)])
    top = max(
        1.1 * LI_SPRAIN_VELOCITY[1],
        *(1.3 * float(np.percentile(v, 95)) for _, _, v in points),
        *(1.1 * float(v.max()) for _, _, v in tracks),
        0.0,
    )
    axis.set_ylim(min(-50.0, 1.1 * float(velocities.min())), top)
    beyond = int(np.sum(velocities > top))
    if beyond:
        text = f"↑ {beyond} trials above, up to {velocities.max():.0f} deg/s"
        axis.text(0.01, 0.99, text, fontsize=small(), color=MUTED, transform=axis.transAxes, va="top")


@styled
def sharing(
    rows: Sequence[tuple[str, Array, Array]], note: str = "", doubts: Mapping[str, tuple[float, float]] | None = None
) -> Figure:
    """Who bears the subtalar moment at the peak of supination: `rows` (title, moments of the anatomy (n,) [N·m], of the
    brace (n,)), one value for a landing, one for each trial of a study, whose means are drawn with lines from the 5 %
    to the 95 % level.

    - doubts: {title: half widths of the 95 % intervals of the two means}
    """
    words = [
        [*title_lines(title, 58), _borne(anatomy, brace, (doubts or {}).get(title))] for title, anatomy, brace in rows
    ]
    heights = [0.75 + LINE * len(lines) + 0.3 * (len(a) > 1) for lines, (_, a, _) in zip(words, rows, strict=True)]
    figure, (axis,) = sheet([1.0 + sum(heights)], note)
    top = 0.0
    for lines, height, (_, anatomy, brace) in zip(words, heights, rows, strict=True):
        axis.text(0, top, "\n".join(lines), fontsize=small(), transform=axis.get_yaxis_transform(), va="top")
        place = top + LINE * len(lines) + 0.27
        a, b = float(np.mean(anatomy)), float(np.mean(brace))
        axis.barh(place, a, 0.36, **BORNE["anatomy"])
        axis.barh(place, b, 0.36, left=a, **BORNE["brace"])
        for values, start in ((anatomy, 0.0), (brace, a)) if len(anatomy) > 1 else ():
            low, high = np.percentile(values, [5, 95])
            if high > low:
                spread: Any = dict(color=INK, linewidth=0.8, marker="|", markersize=3)
                axis.plot([start + low, start + high], [place + 0.32] * 2, **spread)
        top += height
    axis.set_ylim(top + 0.1, -0.05)
    axis.set_yticks([])
    axis.spines["left"].set_visible(False)
    axis.axvline(0, color=FAINT, linewidth=0.6)
    axis.margins(x=0.03)
    many = any(len(anatomy) > 1 for _, anatomy, _ in rows)
    axis.set_xlabel(f"{'mean ' * many}subtalar moment at peak supination [N·m], + resists")
    entries: list[tuple[Any, str]] = [(Rectangle((0, 0), 1, 1, **look), who) for who, look in BORNE.items()]
    if many:
        entries.append((legend_line(INK, linewidth=0.8, marker="|", markersize=3), "5 … 95 % of landings"))
    legend_above(figure, entries, len(entries))
    return figure


def _borne(anatomy: Array, brace: Array, doubt: tuple[float, float] | None) -> str:
    """The means with their doubts; the brace's share is the mean of the landings' shares, as in a comparison."""
    ends = ["" if doubt is None else f" ± {half:.1f}" for half in doubt or (0.0, 0.0)]
    means = [f"{np.mean(values):z.1f}{end}" for values, end in zip((anatomy, brace), ends, strict=True)]
    if not np.any(brace):
        return f"{means[0]} N·m: no brace"
    both = anatomy + brace
    share = f": {100 * np.mean((brace / both)[both > 0]):.0f} % brace" if np.any(both > 0) else ""
    return f"{means[0]} + {means[1]} N·m{share}"


@styled
def fan(
    groups: Sequence[tuple[str, Array, Mapping[str, Array]]],
    note: str = "",
    others: Sequence[tuple[str, Array, Mapping[str, Array]]] = (),
) -> Figure:
    """Many landings over time: median, 25 ... 75 % and 5 ... 95 % at each moment. `groups` are (title, time (t,) [s],
    {signal: (n, t)}), up to three; moments have a scale that holds those of the `others` as well, which are drawn
    elsewhere."""
    drawn = [p for p in PANELS if any(p[1] in signals for _, _, signals in groups)]
    figure, axes = sheet([2.9] + [2.3] * (len(drawn) - 1), note, sharex=True)
    chosen = looks_of([title for title, _, _ in groups])
    for axis, (title, signal, factor) in zip(axes, drawn, strict=True):
        for look, (_, time, signals) in zip(chosen, groups, strict=True):
            if signal in signals:
                p5, p25, p50, p75, p95 = np.percentile(factor * signals[signal], [5, 25, 50, 75, 95], axis=0)
                ms = 1e3 * time
                axis.fill_between(ms, p5, p95, color=look.colour, alpha=0.16, linewidth=0)
                axis.fill_between(ms, p25, p75, color=look.colour, alpha=0.3, linewidth=0)
                axis.plot(ms, p50, **look.along(len(ms)))
        _panel(axis, title)
        if signal == "plant.ground_force_y":
            _cut_impact(
                axis,
                [
                    (time, np.percentile(factor * signals[signal], 95, axis=0))
                    for _, time, signals in groups
                    if signal in signals
                ],
                "95 % level ",
            )
    for axis, (_, signal, factor) in zip(axes, drawn, strict=True):
        for _, _, signals in others if signal.endswith("_subtalar_moment") else ():
            if signal in signals:
                ends = np.percentile(factor * signals[signal], [5, 95], axis=0)
                axis.update_datalim([(0.0, float(ends.min())), (0.0, float(ends.max()))], updatex=False)
                axis.autoscale_view(scalex=False)
    _share_moments(axes, drawn)
    axes[-1].set_xlabel(TIME)
    axes[-1].set_xlim(0, max(1e3 * time[-1] for _, time, _ in groups))
    entries: list[tuple[Any, str]] = [
        (look.key(), f"{title}, {len(next(iter(signals.values())))}\u00a0landings: median")
        for look, (title, _, signals) in zip(chosen, groups, strict=True)
    ]
    entries += [
        (Rectangle((0, 0), 1, 1, color=GROUND, alpha=0.46, linewidth=0), "25 … 75 % of the landings at each moment"),
        (Rectangle((0, 0), 1, 1, color=GROUND, alpha=0.16, linewidth=0), "5 … 95 %"),
    ]
    legend_above(figure, entries)
    return figure


def _share_moments(axes: Sequence[Axes], drawn: Sequence[tuple[str, str, float]]) -> None:
    """One scale for the moments of anatomy and brace: what is ten times as large looks ten times as high."""
    moments = [axis for axis, (_, signal, _) in zip(axes, drawn, strict=True) if signal.endswith("_subtalar_moment")]
    ends = [axis.get_ylim() for axis in moments]
    for axis in moments:
        axis.set_ylim(min(low for low, _ in ends), max(high for _, high in ends))


def _has(run: Signals, signal: str) -> bool:
    if signal.startswith("plant.brace_"):
        return signal in run.index and bool(brace_torques(run))
    return signal in run.index


def _cut_impact(axis: Axes, series: Sequence[tuple[Array, Array]], what: str = "") -> None:
    """The published pose starts inside the floor: its force of the first 5 ms would hide all the rest."""
    top = 1.15 * max((float(values[time > IMPACT].max()) for time, values in series if time[-1] > IMPACT), default=0.0)
    if axis.get_ylim()[1] > 1.5 * top > 0:
        axis.set_ylim(-0.04 * top, top)
        highest = max(float(values.max()) for _, values in series)
        axis.text(
            0.99,
            0.97,
            f"cut off: {what}{highest:.0f} kN in the first 5 ms",
            fontsize=small(),
            color=MUTED,
            transform=axis.transAxes,
            va="top",
            ha="right",
        )


def _panel(axis: Axes, title: str) -> None:
    axis.set_title(title)
    axis.locator_params(axis="y", nbins=4, min_n_ticks=3, steps=[1, 2, 2.5, 5, 10])
    axis.grid(axis="y")
    axis.axhline(0, color=FAINT, linewidth=0.6)


def landing_picture(result: Result, summary: RunSummary) -> bytes:
    """The content of landing.png in a run's folder."""
    return picture(landing_signals([(summary.title, result)], coupling_note([summary])), "png")


def leave_run(folder: Path, result: Result, summary: RunSummary) -> None:
    """Writes the folder of a run, its picture included. Raises EnvironmentProblem."""
    write_run(folder, result, landing_picture(result, summary), summary)
