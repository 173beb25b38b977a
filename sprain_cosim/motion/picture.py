"""The pose at contact against that without a motion, the height of the sole over the file, and how far the speeds
depend on the smoothing."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from ..animate.skeleton import Skeleton
from ..animate.solid import Camera
from ..animate.stage import HALF, PLATFORM, X, Y, Z, part_colour
from ..export.landing import COORDINATES
from ..figures import FAINT, GROUND, INK, SUBTALAR, shorten
from ..scenario import Scenario, load_scenario
from .start import MotionStart, StartValue

TALL, WIDE = 420, 250  # pixels of a view
HIGH = 2.05  # m of a view


def pose_figure(start: MotionStart) -> Figure:
    """Draws the pose from behind and from the right side, beside the plant's own."""
    drawing = Skeleton.read(start.scenario.fmus["plant"])
    rows = 2 if not len(start.heights) else 3
    figure = Figure(figsize=(9.0, 6.6 + 1.9 * (rows - 2)), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(rows, 4, height_ratios=[3.4, 2.4, 1.5][:rows])
    incline = _parameter(start.scenario, "platform_incline")
    landings = {"motion": start.scenario, "without a motion": load_scenario(start.base)}
    column = 0
    for name, landing in landings.items():
        coordinates, skeleton = _placed(landing), drawing.scaled(partial(_parameter, landing))
        for title, right in (("from behind", Z), ("from the right", X)):
            axis = figure.add_subplot(grid[0, column])
            axis.imshow(_view(skeleton, coordinates, right, incline, "brace" in start.scenario.fmus))
            axis.set_title(f"{name}, {title}", fontsize=8, color=INK)
            axis.set_axis_off()
            column += 1
    turning = [v for v in start.values.values() if v.unit == "rad"]
    moving = [v for v in start.values.values() if v.unit == "m"]
    _draw_speeds(figure.add_subplot(grid[1, :3]), turning, math.degrees(1.0), "deg/s")
    _draw_speeds(figure.add_subplot(grid[1, 3]), moving, 1.0, "m/s")
    if rows == 3:
        _draw_height(figure.add_subplot(grid[2, :]), start)
    title = f"{shorten(start.table.path.name, 60)} at {start.contact.at:.6g} s, {start.side} foot; pose {start.pose}"
    mirrored = " (mirrored)" if start.side == "left" else ""
    figure.suptitle(f"{title}{mirrored}", fontsize=10, color=INK, parse_math=False)
    return figure


def _parameter(scenario: Scenario, name: str) -> float:
    value = scenario.system().parameters.get(f"plant.{name}")
    if value is None:
        plant = next(c for c in scenario.components() if c.name == "plant")
        value = plant.connectors[name].start
    assert isinstance(value, float)
    return value


def _placed(scenario: Scenario) -> dict[str, float]:
    """Coordinates at the start of the landing, with the pelvis where the pose puts it."""
    result = scenario.recording("plant.*").with_master(stop="0.5 ms", communication_step="0.5 ms").run()
    return {c: float(result[f"plant.{c}"][0]) for c in COORDINATES}


def _view(
    skeleton: Skeleton, coordinates: Mapping[str, float], right: np.ndarray, incline: float, braced: bool
) -> np.ndarray:
    pose = skeleton.pose(coordinates)
    ankle = skeleton.point("ankle", pose)
    turn = np.array([X, [0.0, math.cos(incline), math.sin(incline)], [0.0, -math.sin(incline), math.cos(incline)]])
    shown = np.array([braced or part != "brace" for part in skeleton.parts])
    colours = np.array([part_colour(part) for part in skeleton.parts])[shown]
    pivot = np.array(skeleton.content["platform"]["pivot"], float)
    middle = ankle.copy()
    middle[1] = ankle[1] + 0.5 * HIGH - 0.3
    camera = Camera(right, Y, middle, TALL / HIGH, WIDE, TALL)
    under = ankle - turn[1] * float((ankle - pivot) @ turn[1])
    return camera.picture(skeleton.volumes(pose)[shown], colours, under - HALF[1] * turn[1], turn, HALF, PLATFORM)


def _draw_speeds(axis: Axes, values: list[StartValue], factor: float, unit: str) -> None:
    for k, v in enumerate(values):
        axis.plot([k, k], [factor * v.low, factor * v.high], color=SUBTALAR, lw=5, alpha=0.35, solid_capstyle="butt")
        axis.plot(k, factor * v.speed, "o", color=SUBTALAR, ms=4)
        axis.plot(k, factor * v.own[1], "_", color=INK, ms=10, mew=1.2)
    axis.axhline(0, color=FAINT, lw=0.7)
    axis.set_xticks(range(len(values)), [v.coordinate for v in values], rotation=35, ha="right", fontsize=7)
    axis.tick_params(axis="y", labelsize=7)
    axis.set_title(f"speeds [{unit}]", loc="left", fontsize=8, color=INK)
    axis.spines[["top", "right"]].set_visible(False)
    if len(values) > 3:
        axis.text(
            1.0, 1.03, "dot: as taken · bar: other smoothings · dash: without a motion", transform=axis.transAxes,
            ha="right", fontsize=7, color=INK,
        )  # fmt: skip


def _draw_height(axis: Axes, start: MotionStart) -> None:
    axis.plot(start.course.time, 1e3 * start.heights, color=GROUND, lw=1.3)
    axis.axvline(start.contact.at, color=SUBTALAR, lw=1.2)
    axis.set_title("lowest point of the sole over a level floor [mm], in the file's height", loc="left", fontsize=8)
    axis.set_xlabel("time in the file [s]", fontsize=8)
    axis.tick_params(labelsize=7)
    axis.spines[["top", "right"]].set_visible(False)
