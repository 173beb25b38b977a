"""The picture around the views: what stands still is drawn once, what moves is drawn over it frame by frame."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon
from matplotlib.patheffects import withStroke
from matplotlib.text import Text

from ..errors import InputError, visible
from ..figures import DEGREES
from ..figures.style import (
    ANATOMY,
    BRACE,
    DOTS,
    FAINT,
    GROUND,
    INK,
    MUTED,
    SUBTALAR,
    TALOCRURAL,
    letters,
    lines_of,
    palette,
)
from ..folders.landing import Landing
from ..metrics import brace_torques
from .moving import HALF_PLATFORM, platform_axes, platform_edge, platform_place
from .skeleton import Pose, Skeleton
from .solid import PAPER, Camera

MOST = 6
COLOURS = {
    "brace": to_rgb(BRACE),
    "shirt": (0.30, 0.45, 0.62),
    "shorts": (0.20, 0.26, 0.36),
    "skin": (0.86, 0.68, 0.56),
    "foot": (0.86, 0.68, 0.56),
    "sole": (0.78, 0.60, 0.48),
    "bone": (0.93, 0.90, 0.82),
}
PLATFORM, HALF = np.array([0.68, 0.735, 0.79]), np.array(HALF_PLATFORM)  # colour, half extents [m]
X, Y, Z = np.eye(3)
EDGE, HEAD, GAP, CHART, FOOT = 14, 58, 12, 196, 28  # px
TITLE, LINE, SMALL_LINE = 14, 19, 13  # px, of the headings and the words below them
LONGEST = 0.72  # of a view's height: an arrow that would be longer is drawn so long, and hollow
# s; the force arrow's scale leaves out the first contact, which may be five times larger in the published pose
IMPACT = 0.005


@dataclass(frozen=True)
class View:
    """One view of a landing.

    - title: text in the corner
    - right: (3,) direction of the picture's width, in the ground's frame
    - low, high: lower and upper end of the picture above the platform's pivot [m]
    - at: middle of the picture to the right of the pivot [m]
    - width: pixels
    - whole: the whole body, or only the foot and the shank
    - torques: with moments as arcs about the ankle, and figures in a corner
    """

    title: str
    right: np.ndarray
    low: float
    high: float
    at: float
    width: int
    whole: bool = True
    torques: bool = False


WHOLE, SIDE = View("from behind", Z, -0.19, 1.97, -0.06, 250), View("from the right side", X, -0.19, 1.97, -0.03, 314)
CLOSE = View("ankle from behind", Z, -0.15, 0.47, -0.01, 412, whole=False, torques=True)


def _views(count: int) -> tuple[tuple[View, ...], int]:
    if count == 1:
        return (WHOLE, SIDE, CLOSE), 440
    if count == 2:
        return (
            View(CLOSE.title, Z, -0.15, 0.47, -0.01, 360, False, True),
            View(SIDE.title, X, -0.19, 1.97, -0.03, 236),
        ), 416
    width = 322 if count == 3 else 290
    return (View(CLOSE.title, Z, -0.15, 0.47, -0.01, width, False, True),), 380


class Stage:
    """`frames(times)` yields pictures (height, width, 3) uint8 of the landings side by side, all at the same time after
    contact [s]."""

    def __init__(self, runs: Sequence[Landing], slow: float, looks: Sequence[str] | None = None) -> None:
        """`looks`: a colour for each of the landings; None: as figures of them would have."""
        if not 1 <= len(runs) <= MOST:
            raise InputError(f"{len(runs)} landings: up to {MOST} can be shown side by side")
        self.runs, self.slow = runs, slow
        titles = [f"{n} {run.title}" for n, run in enumerate(runs)]
        bare = [title for title, run in zip(titles, runs, strict=True) if not brace_torques(run.result)]
        chosen = palette(titles, bare if len(bare) == 1 < len(runs) else ())
        self.colours = [chosen[title][0] for title in titles] if looks is None else list(looks)
        self.actors = [_Actor(run, colour if len(runs) > 1 else None) for run, colour in zip(runs, self.colours)]
        views, tall = _views(len(runs))
        block = sum(v.width for v in views) + GAP * (len(views) - 1)
        self.width = 2 * EDGE + len(runs) * block + (len(runs) - 1) * 2 * GAP
        self.titles = [self._lines(n, block, run.title, TITLE, "bold") for n, run in enumerate(runs)]
        self.below = [self._lines(n, block, _below(run), 9) for n, run in enumerate(runs)]
        head = HEAD + LINE * (max(map(len, self.titles)) - 1) + SMALL_LINE * (max(map(len, self.below)) - 1)
        self.height = head + tall + GAP + CHART + FOOT
        self.width += self.width % 2  # video wants even sizes
        self.height += self.height % 2
        self.figure = Figure(figsize=(self.width / 100, self.height / 100), dpi=100, facecolor="white")
        self.canvas: Any = FigureCanvasAgg(self.figure)  # untyped in matplotlib
        self.page = self._page(self.figure)
        self.labels = Figure(
            figsize=(self.width / 100, self.height / 100), dpi=100, facecolor="none"
        )  # what stands still in front of the views
        self.labels_canvas: Any = FigureCanvasAgg(self.labels)
        self.front = self._page(self.labels)
        self.clock = self._text(self.width - EDGE, 20, "", 15, INK, ha="right", weight="bold", moving=True)
        self._text(self.width - EDGE, 41, f"slowed {slow:g} times", 9, MUTED, ha="right")
        top = max(float(a["plant.ground_force"][a.run.result.time > IMPACT].max(initial=1.0)) for a in self.actors)
        moment = max(
            float(np.abs(a[f"plant.{who}_subtalar_moment"]).max(initial=1.0))
            for a in self.actors
            for who in ("anatomy", "brace")
        )
        reach = 0.40 * tall / top
        strongest = max(float(a["plant.ground_force"].max()) for a in self.actors)
        self._head(block, reach * strongest > LONGEST * tall)
        self.panels = []
        for n, actor in enumerate(self.actors):
            left = EDGE + n * (block + 2 * GAP)
            for view in views:
                self.panels.append(_Panel(self, actor, view, left, head, tall, reach, 150.0 / max(moment, 20.0)))
                left += view.width + GAP
        self.charts = self._charts(head + tall + GAP)

    def frames(self, times: np.ndarray) -> Iterator[np.ndarray]:
        for actor in self.actors:
            actor.prepare(times)
        self.canvas.draw()
        still = self.canvas.copy_from_bbox(self.figure.bbox)
        self.labels_canvas.draw()
        for panel in self.panels:
            panel.take_labels(np.asarray(self.labels_canvas.buffer_rgba()))
        for k, t in enumerate(times):
            self.canvas.restore_region(still)
            pixels = np.asarray(self.canvas.buffer_rgba())
            for panel in self.panels:
                panel.paint(pixels, k)
            self.clock.set_text(f"{1e3 * t:5.1f} ms")
            moving: list[Artist] = [self.clock, *(artist for panel in self.panels for artist in panel.move(k))]
            for chart in self.charts:
                moving += chart.move(t)
            for artist in moving:
                self.figure.draw_artist(artist)
            yield np.asarray(self.canvas.buffer_rgba())[..., :3].copy()

    # ---- what stands still

    def _page(self, figure: Figure) -> Axes:
        """All of a figure in pixels, y downwards."""
        page = figure.add_axes((0, 0, 1, 1), xlim=(0, self.width), ylim=(self.height, 0))
        page.axis("off")
        return page

    def label(self, x: float, y: float, text: str, size: float, colour: str) -> None:
        self.front.text(x, y, visible(text), fontsize=size * 0.72, color=colour, va="center", parse_math=False)

    def _text(self, x: float, y: float, text: str, size: float, colour: str, moving: bool = False, **more: Any) -> Text:
        return self.page.text(
            x,
            y,
            visible(text),
            fontsize=size * 0.72,
            color=colour,
            va="center",
            animated=moving,
            parse_math=False,
            **more,
        )

    def _room(self, n: int, block: int) -> int:
        """Pixels for the heading of landing `n`, beside the line in its colour and the clock."""
        return block - (30 if len(self.runs) > 1 else 0) - (120 if n == len(self.runs) - 1 else 0)

    def _lines(self, n: int, block: int, text: str, size: float, weight: str = "normal") -> list[str]:
        return lines_of(visible(text), 0.72 * self._room(n, block), 0.72 * size, weight, most=3) or [""]

    def _head(self, block: int, hollow: bool) -> None:
        last = 20 + LINE * (max(map(len, self.titles)) - 1)
        for n in range(len(self.runs)):
            left = EDGE + n * (block + 2 * GAP)
            if len(self.runs) > 1:
                self.page.plot(
                    [left, left + 22], [20, 20], color=self.colours[n], linewidth=3.5, solid_capstyle="round"
                )
                mark: Any = dict(markersize=8, markeredgecolor="white", markeredgewidth=0.8)
                self.page.plot([left + 11], [20], DOTS[n % len(DOTS)], color=self.colours[n], **mark)
                left += 30
            for k, line in enumerate(self.titles[n]):
                self._text(left, 20 + LINE * k, line, TITLE, INK, weight="bold")
            for k, line in enumerate(self.below[n]):
                self._text(left, last + 21 + SMALL_LINE * k, line, 9, MUTED)
        self._text(
            EDGE,
            self.height - 13,
            f"force on the foot at the centre of pressure{' (a hollow arrow is cut)' * hollow}; "
            "moments about the subtalar axis, + resists supination; parallel projection",
            9,
            MUTED,
        )

    def _charts(self, top: int) -> list[_Chart]:
        many = len(self.runs) > 1
        charts = []
        names = [
            "Subtalar angle [deg], + supination" if many else "Ankle angle [deg]",
            "Subtalar moment [N·m]",
            "Vertical ground force [kN]",
        ]
        width = (self.width - 2 * EDGE) / 3
        for n, name in enumerate(names):
            box = (EDGE + n * width + 34, top + 26, width - 52, CHART - 26 - 36)
            axes = self.figure.add_axes(
                (box[0] / self.width, 1 - (box[1] + box[3]) / self.height, box[2] / self.width, box[3] / self.height)
            )
            axes.set_title(name, loc="left", fontsize=7.4, color=INK)
            axes.spines[["top", "right"]].set_visible(False)
            axes.spines[["left", "bottom"]].set_color(FAINT)
            axes.tick_params(colors=INK, labelsize=6.6, length=2.5, pad=2)
            axes.set_xlabel("time after contact [ms]", fontsize=6.8, color=INK, labelpad=1)
            axes.axhline(0, color=FAINT, linewidth=0.6)
            charts.append(_Chart(axes))
        for n, actor in enumerate(self.actors):
            ms = 1e3 * actor.run.result.time
            lines = [
                (0, DEGREES * actor["plant.subtalar_angle"], SUBTALAR, "subtalar, + supination", "-"),
                (0, DEGREES * actor["plant.talocrural_angle"], TALOCRURAL, "talocrural, + dorsiflexion", "-"),
                (1, actor["plant.anatomy_subtalar_moment"], ANATOMY, "anatomy", (0, (3, 1.5)) if many else "-"),
                (1, actor["plant.brace_subtalar_moment"], BRACE, "brace", "-"),
                (2, actor["plant.ground_force_y"] / 1e3, GROUND, "", "-"),
            ]
            for where, values, colour, label, style in lines:
                if (many and colour == TALOCRURAL) or (colour == BRACE and not actor.braced):
                    continue
                shown, dot = (self.colours[n], DOTS[n % len(DOTS)]) if many else (colour, "o")
                charts[where].add(ms, values, shown, "" if many else label, style, dot)
        ends = max(1e3 * run.result.time[-1] for run in self.runs)
        for where, chart in enumerate(charts):
            chart.axes.set_xlim(0, ends)
            if where == 2:
                high = (
                    max(
                        float(a["plant.ground_force_y"][a.run.result.time > IMPACT].max(initial=1.0))
                        for a in self.actors
                    )
                    / 1e3
                )
                chart.axes.set_ylim(-0.06 * high, 1.15 * high)
                highest = max(float(a["plant.ground_force_y"].max()) for a in self.actors) / 1e3
                if highest > 1.15 * high:
                    said: Any = dict(transform=chart.axes.transAxes, ha="right", va="top", fontsize=6.6, color=MUTED)
                    chart.axes.text(0.99, 0.98, f"cut off: {highest:.0f} kN in the first 5 ms", **said)
            chart.legend(many and where == 1)
        return charts


class _Actor:
    """A landing: its signals, and the pose at each time of the film."""

    def __init__(self, run: Landing, cuff: str | None = None) -> None:
        """`cuff`: colour of the brace and of all that is told of it, where several braces are told apart."""
        self.cuff = BRACE if cuff is None else cuff
        self.run, self.skeleton = run, Skeleton.read(run.plant).scaled(run.parameter)
        run.need(self.skeleton.coordinates, "a drawing")
        self.braced = bool(brace_torques(run.result))
        self.incline = run.parameter(self.skeleton.content["platform"]["incline"])
        self.turn = platform_axes(self.incline)
        self.pivot, self.raised, edge = self._stand()
        self.cut = None if edge is None else np.array([edge[0], 0.0, edge[1], edge[2]])
        self.colours = np.array([part_colour(part) for part in self.skeleton.parts])
        self.colours[[part == "brace" for part in self.skeleton.parts]] = to_rgb(self.cuff)
        worn = np.array([self.braced or part != "brace" for part in self.skeleton.parts])
        self.whole, self.near = (
            worn,
            worn
            & np.array(
                [not part.startswith("left") and part not in ("shirt", "shorts") for part in self.skeleton.parts]
            ),
        )

    def _stand(self) -> tuple[np.ndarray, float, np.ndarray | None]:
        """The middle (3,) of the drawn part of the platform, how far it lies above the pivot [m], and the platform's
        edge: the pivot, or under the foot of a motion that lands beside what is drawn there."""
        first = self.skeleton.pose({c: float(self.run.result[f"plant.{c}"][0]) for c in self.skeleton.coordinates})
        place = platform_place(self.skeleton, first, self.incline)
        above = float(place[1] - self.skeleton.content["platform"]["pivot"][1])
        return place, above, platform_edge(self.run, first, place, self.incline)

    def __getitem__(self, name: str) -> np.ndarray:
        """(n,) a signal of the record; zeros where the record has none."""
        result = self.run.result
        return result[name] if name in result.index else np.zeros(len(result.time))

    def at(self, name: str, k: int) -> float:
        return float(np.interp(self.times[k], self.run.result.time, self[name]))

    def prepare(self, times: np.ndarray) -> None:
        self.times = np.minimum(times, self.run.result.time[-1])
        self.poses: list[Pose] = []
        for k in range(len(times)):
            self.poses.append(self.skeleton.pose({c: self.at(f"plant.{c}", k) for c in self.skeleton.coordinates}))
        self.volumes = [self.skeleton.volumes(pose) for pose in self.poses]


class _Panel:
    """One view of one landing: the picture, the force arrow, the arcs of the moments, figures in a corner."""

    def __init__(
        self, stage: Stage, actor: _Actor, view: View, left: int, top: int, tall: int, reach: float, degrees: float
    ) -> None:
        self.stage, self.actor, self.view, self.left, self.top, self.tall = stage, actor, view, left, top, tall
        self.reach, self.degrees = reach, degrees  # px/N and degrees of arc per N.m
        middle = actor.pivot + view.at * view.right
        middle[1] = 0.5 * (view.low + view.high) + actor.raised
        self.camera = Camera(view.right, Y, middle, tall / (view.high - view.low), view.width, tall)
        page = stage.page
        page.add_patch(
            Polygon(
                [
                    (left - 1, top - 1),
                    (left + view.width, top - 1),
                    (left + view.width, top + tall),
                    (left - 1, top + tall),
                ],
                fc=PAPER,
                ec="#d5dbe1",
                lw=1,
            )
        )
        metres = 0.2 if view.whole else 0.1
        bar, y = metres * self.camera.scale, top + (33 if view.whole else tall - 47)
        stage.label(left + 9, top + (16 if view.whole else tall - 13), view.title, 9.5, MUTED)
        stage.front.plot([left + 9, left + 9 + bar], [y, y], color=MUTED, lw=1.6, solid_capstyle="butt")
        stage.label(left + 14 + bar, y, f"{metres:g} m", 8.5, MUTED)
        self.arrow = Polygon(np.zeros((7, 2)), closed=True, fc=GROUND, ec="white", lw=0.8, alpha=0.92, animated=True)
        page.add_patch(self.arrow)
        self.arcs: list[tuple[int, str, Line2D, Polygon]] = []
        self.figures: list[tuple[Text, str, float, str]] = []
        if view.torques:
            for radius, name, colour in ((58, "anatomy", ANATOMY), (76, "brace", actor.cuff)):
                if name == "brace" and not actor.braced:
                    continue
                line = page.plot([], [], color=colour, lw=4.2, animated=True, solid_capstyle="butt")[0]
                head = Polygon(np.zeros((3, 2)), closed=True, fc=colour, ec="none", animated=True)
                page.add_patch(head)
                self.arcs.append((radius, f"plant.{name}_subtalar_moment", line, head))
            rows = [
                ("subtalar", "plant.subtalar_angle", DEGREES, "°", INK if len(stage.runs) > 1 else letters(SUBTALAR)),
                ("brace", "plant.brace_subtalar_moment", 1.0, " N·m", letters(actor.cuff)),
            ]
            rows += [
                ("anatomy", "plant.anatomy_subtalar_moment", 1.0, " N·m", letters(ANATOMY)),
                ("ground", "plant.ground_force", 1e-3, " kN", GROUND),
            ]
            for n, (name, signal, factor, unit, colour) in enumerate(
                row for row in rows if row[0] != "brace" or actor.braced
            ):
                y = top + 17 + 17 * n
                stage.label(left + 9, y, name, 10.5, colour)
                text = stage._text(left + 136, y, "", 11.5, colour, ha="right", weight="bold", moving=True)
                text.set_path_effects([withStroke(linewidth=2.5, foreground="white")])  # over the arrow
                self.figures.append((text, signal, factor, unit))
            stage.label(
                left + 9,
                top + tall - 29,
                f"platform tilted {DEGREES * actor.incline:z.0f}°{', with an edge' * (actor.cut is not None)}",
                9.5,
                MUTED,
            )

    def paint(self, pixels: np.ndarray, k: int) -> None:
        actor = self.actor
        chosen = actor.whole if self.view.whole else actor.near
        volumes, colours = actor.volumes[k][chosen], actor.colours[chosen]
        picture = self.camera.picture(
            volumes, colours, actor.pivot - HALF[1] * actor.turn[1], actor.turn, HALF, PLATFORM, actor.cut
        )
        picture[self.inked] = (1 - self.ink[:, 3:]) * picture[self.inked] + 255 * self.ink[:, 3:] * self.ink[:, :3]
        pixels[self.top : self.top + self.tall, self.left : self.left + self.view.width, :3] = picture

    def take_labels(self, page: np.ndarray) -> None:
        mine = page[self.top : self.top + self.tall, self.left : self.left + self.view.width]
        self.inked = np.nonzero(mine[..., 3])
        self.ink = mine[self.inked] / 255.0

    def move(self, k: int) -> list[Artist]:
        actor, shown = self.actor, list[Artist]()
        force = np.array([actor.at(f"plant.ground_force_{c}", k) for c in "xyz"])
        if (
            np.linalg.norm(force) * self.reach > 4
            and actor.at("plant.in_contact", k) > 0.5
            and "plant.ground_point_x" in actor.run.result.index
        ):
            start = self._pixel(np.array([actor.at(f"plant.ground_point_{c}", k) for c in "xyz"]))
            way = self.reach * np.array([force @ self.view.right, -force[1]])
            share = min(1.0, LONGEST * self.tall / max(float(np.linalg.norm(way)), 1e-9))
            self.arrow.set_xy(_arrow(start, start + share * way))
            self.arrow.set(fc=PAPER if share < 1.0 else GROUND, ec=GROUND if share < 1.0 else "white")
            shown.append(self.arrow)
        middle = self._pixel(actor.skeleton.point("ankle", actor.poses[k]))
        for radius, signal, line, head in self.arcs:
            turn = float(np.clip(self.degrees * actor.at(signal, k), -170.0, 170.0))
            if abs(turn) < 3.0:
                continue
            angles = np.radians(np.linspace(-40.0, -40.0 + turn, 40))
            line.set_data(middle[0] + radius * np.cos(angles), middle[1] - radius * np.sin(angles))
            tip, sign = angles[-1], math.copysign(1.0, turn)
            ahead = tip + sign * 13 / radius
            ends = [(radius - 8, tip), (radius + 8, tip), (radius, ahead)]
            head.set_xy([(middle[0] + r * math.cos(a), middle[1] - r * math.sin(a)) for r, a in ends])
            shown += [line, head]
        for text, signal, factor, unit in self.figures:
            text.set_text(f"{_plain(factor * actor.at(signal, k))}{unit}")
            shown.append(text)
        return shown

    def _pixel(self, point: np.ndarray) -> np.ndarray:
        place: np.ndarray = self.camera.project(point) + np.array([self.left, self.top])
        return place


class _Chart:
    """Curves over time [ms]: faint as a whole, strong up to now, with a dot."""

    def __init__(self, axes: Axes) -> None:
        self.axes = axes
        self.curves: list[tuple[np.ndarray, np.ndarray, Line2D, Line2D]] = []
        self.labels: list[tuple[str, str]] = []
        self.now = axes.axvline(0, color=INK, linewidth=0.7, alpha=0.5, animated=True)

    def add(self, ms: np.ndarray, values: np.ndarray, colour: str, label: str, style: object, mark: str) -> None:
        self.axes.plot(ms, values, color=colour, linewidth=1.0, alpha=0.28, linestyle=style)
        line = self.axes.plot([], [], color=colour, linewidth=1.7, animated=True, linestyle=style)[0]
        dot = self.axes.plot(
            [], [], mark, color=colour, markersize=4, markeredgecolor="white", markeredgewidth=0.6, animated=True
        )[0]
        self.curves.append((ms, values, line, dot))
        if label:
            self.labels.append((label, colour))

    def legend(self, by_style: bool) -> None:
        if by_style:
            handles = [Line2D([], [], color=INK, linestyle=s, linewidth=1.4) for s in ("-", (0, (3, 1.5)))]
            self.axes.legend(
                handles,
                ["brace", "anatomy"],
                frameon=False,
                fontsize=6.6,
                loc="upper right",
                labelcolor=INK,
                handlelength=2.0,
            )
        elif len(self.labels) > 1:
            handles = [Line2D([], [], color=c, linewidth=2) for _, c in self.labels]
            self.axes.legend(
                handles,
                [name for name, _ in self.labels],
                frameon=False,
                fontsize=6.6,
                loc="best",
                labelcolor=[letters(c) for _, c in self.labels],
                handlelength=1.1,
            )

    def move(self, time: float) -> list[Artist]:
        now = 1e3 * time
        shown: list[Artist] = [self.now]
        self.now.set_xdata([now, now])
        for ms, values, line, dot in self.curves:
            count = int(np.searchsorted(ms, now, "right"))
            here = min(now, ms[-1])
            value = float(np.interp(here, ms, values))
            line.set_data(np.append(ms[:count], here), np.append(values[:count], value))
            dot.set_data([here], [value])
            shown += [line, dot]
        return shown


def _below(run: Landing) -> str:
    return ", ".join(p for p in (f"initial pose {run.pose}" if run.pose else "", run.label) if p)


def part_colour(part: str) -> np.ndarray:
    """(3,) of 0...1: the colour of a part of the drawn body."""
    colour = np.array(COLOURS[part.removeprefix("left ")])
    return 0.75 * colour + 0.25 * PAPER if part in ("left skin", "left foot") else colour


def _arrow(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """(7, 2) outline of an arrow."""
    length = float(np.linalg.norm(end - start))
    along = (end - start) / max(length, 1e-9)
    side = np.array([-along[1], along[0]])
    neck = end - along * min(16.0, 0.6 * length)
    return np.array(
        [
            start + 2.6 * side,
            neck + 2.6 * side,
            neck + 8 * side,
            end,
            neck - 8 * side,
            neck - 2.6 * side,
            start - 2.6 * side,
        ]
    )


def _plain(value: float) -> str:
    """One decimal, a proper minus, no -0.0."""
    return f"{value:z.1f}".replace("-", "−")
