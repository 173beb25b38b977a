"""The torque-angle laws of the paper: the passive ankle and its two braces (Figures 1C and 2 of Yoder et al. 2021)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ..literature import BRACES, PASSIVE, PASSIVE_SOURCE
from .style import ANATOMY, BRACE, FAINT, LINES, SERIES, legend_above, legend_line, sheet, small, styled

SPAN = 35.0  # degrees to each side
AXES = {
    "rotation_x": "X [N·m], + inversion (sole inward)",
    "rotation_y": "Y [N·m], + internal rotation (toes inward)",
    "rotation_z": "Z [N·m], + dorsiflexion",
}


def resisting(axis: str, angle: NDArray[np.float64], angle_scale: float = 1.0) -> NDArray[np.float64]:
    """(n,) resisting torque P(f t) [N·m] about a body-fixed Euler axis at the `angle` (n,) [rad]; f = 1 is the ankle
    itself, f > 1 a brace."""
    a, b, c = PASSIVE[axis]
    t = angle_scale * angle
    return t * (a + t * (b + t * c))


def law_looks(braces: int) -> tuple[list[str], list[Any]]:
    """Colours and dashes of the passive ankle and of so many braces: those of anatomy and brace in every figure."""
    return [ANATOMY] + [BRACE] * braces, [LINES[k % len(LINES)] for k in range(1 + braces)]


@styled
def torque_angle(braces: Mapping[str, float] = BRACES, span: float = SPAN) -> Figure:
    """Resisting torque of the ankle and of `braces` {name: angle scale f} over -span ... span [deg], a panel for each
    Euler axis."""
    note = (
        f"P(f t) of the body-fixed X-Y-Z angles of the calcaneus in the tibia, zero at neutral ({PASSIVE_SOURCE}). "
        "Computed from the law alone: no landing, no initial pose."
    )
    figure, axes = sheet([3.1] * 3, note, sharex=True)
    degrees = np.linspace(-span, span, 281)
    for axis, (name, title) in zip(axes, AXES.items(), strict=True):
        for (_, scale), color, style in zip({"": 1.0, **braces}.items(), *law_looks(len(braces)), strict=True):
            axis.plot(degrees, resisting(name, np.radians(degrees), scale), color=color, linestyle=style)
        axis.set_title(f"torque about {title}")
        axis.set_ylim(-60, 60)
        axis.axhline(0, color=FAINT, linewidth=0.6)
        axis.axvline(0, color=FAINT, linewidth=0.6)
        axis.grid()
    axes[-1].set_xlabel("angle [deg]; torque + resists the positive angle")
    axes[0].text(-span, 56, "clipped at ± 60 N·m", fontsize=small(), va="top")
    at30 = {n: resisting("rotation_x", np.array([math.radians(30)]), f)[0] for n, f in braces.items()}
    names = ["passive ankle (f = 1)", *(f"{n} (f = {f:g}, {at30[n]:.0f} N·m at X = 30°)" for n, f in braces.items())]
    legend_above(figure, [(legend_line(c, s), n) for n, c, s in zip(names, *law_looks(len(braces)), strict=True)])
    return figure


@styled
def calibration(
    curves: Mapping[str, NDArray[np.float64]],
    note: str = "",
    fitted: str = "device, fitted",
    start: str = "device, at its start values",
) -> Figure:
    """Torques of a device, or of the ankle, about each axis: measured, at the start values of its parameters, fitted.

    - curves: {axis: (n, 4) angle [rad], measured, start and fitted torque [N·m], on the foot}
    - fitted, start: what the two laws are called
    """
    figure, axes = sheet([4.2] * len(curves), note)
    for axis, (name, rows) in zip(axes, curves.items(), strict=True):
        at = np.degrees(rows[:, 0])
        axis.plot(at, rows[:, 2], color=FAINT, linestyle=LINES[1])
        axis.plot(at, rows[:, 3], color=SERIES[0])
        axis.plot(at, rows[:, 1], "o", color=SERIES[1], markersize=3)
        axis.set_xlabel(f"{name} angle [deg]")
        axis.set_ylabel("torque on the foot [N·m]")
        axis.grid()
    entries = [
        (legend_line(SERIES[1], "none", marker="o"), "measured on the bench"),
        (legend_line(SERIES[0]), fitted),
        (legend_line(FAINT, LINES[1]), start),
    ]
    legend_above(figure, entries)
    return figure
