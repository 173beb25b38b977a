"""Draws docs/figures/axes.png: what a positive angle about each anatomic axis looks like, on the body that the plant's
FMU carries. Arrows follow the motion that the model's own joints give. Run: python tools/axes_figure.py"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

sys.path.insert(0, str(Path(__file__).parent.parent))

from sprain_cosim.animate.skeleton import Skeleton
from sprain_cosim.animate.solid import Camera
from sprain_cosim.animate.stage import COLOURS, X, Y, Z
from sprain_cosim.contract import POSITIVE
from sprain_cosim.figures import INK, SUBTALAR, TALOCRURAL
from sprain_cosim.shipped import FMUS

TARGET = Path(__file__).parent.parent / "docs" / "figures" / "axes.png"
TURN = np.radians(25.0)
SIZE, SCALE = 420, 1050.0  # px, px/m
NOWHERE = np.array([0.0, -50.0, 0.0])
VIEWS = (  # coordinate, axis of the contract, direction to the right of the picture, name of the view, colour
    ("subtalar_angle_r", "subtalar", Z, "from behind", SUBTALAR),
    ("ankle_angle_r", "talocrural", X, "from the right side", TALOCRURAL),
)


def picture(skeleton: Skeleton, camera: Camera, angles: dict[str, float]) -> np.ndarray:
    """The right shank and foot at the coordinates `angles` [rad]."""
    pose = skeleton.pose(dict.fromkeys(skeleton.coordinates, 0.0) | angles)
    chosen = np.array([not p.startswith("left") and p not in ("shirt", "shorts", "brace") for p in skeleton.parts])
    colours = np.array([COLOURS[p.removeprefix("left ")] for p in skeleton.parts])
    small = np.full(3, 1e-3)
    return camera.picture(skeleton.volumes(pose)[chosen], colours[chosen], NOWHERE, np.eye(3), small, small)


def panel(axis: Axes, skeleton: Skeleton, view: tuple[str, str, np.ndarray, str, str]) -> None:
    coordinate, name, right, title, colour = view
    rest = dict.fromkeys(skeleton.coordinates, 0.0)
    pose = skeleton.pose(rest)
    ankle = skeleton.point("ankle", pose)
    camera = Camera(right, Y, ankle + 0.05 * Y + (0.05 * X if right is X else 0.0 * X), SCALE, SIZE, SIZE)
    neutral, turned = (picture(skeleton, camera, {coordinate: a}).astype(float) for a in (0.0, TURN))
    axis.imshow((0.35 * neutral + 0.65 * turned).astype(np.uint8))
    # a point of the sole's edge, or of the toes, carried by the joint
    local = np.array([0.19, 0.03, 0.0]) if right is X else np.array([0.12, 0.0, 0.05])
    way = []
    for angle in np.linspace(0.0, TURN, 30):
        origin, turn = skeleton.pose(rest | {coordinate: angle})["calcn_r"]
        way.append(camera.project(origin + turn @ local))
    path = np.array(way)
    axis.plot(*path.T, color=colour, linewidth=2.5)
    axis.annotate(
        "", path[-1] + 1.5 * (path[-1] - path[-4]), path[-4], arrowprops=dict(color=colour, width=2.0, headwidth=9)
    )
    axis.set_title(f"{name}_angle +\n{title}:\n{POSITIVE[name]}", fontsize=19, color=INK, loc="left", pad=10)
    axis.axis("off")
    axis.set_anchor("S")


def main() -> None:
    skeleton = Skeleton.read(FMUS / "plant.fmu")
    figure = Figure(figsize=(8.6, 5.5), layout="constrained")
    FigureCanvasAgg(figure)
    for axis, view in zip(figure.subplots(1, 2), VIEWS, strict=True):
        panel(axis, skeleton, view)
    figure.savefig(TARGET, dpi=110, metadata={"Software": None})
    print(f"written: {TARGET}")


if __name__ == "__main__":
    main()
