"""tools/axes_figure.py: the drawing shows the motion that the contract's words describe, by the model's own joints."""

from __future__ import annotations

import numpy as np

from sprain_cosim.animate.skeleton import Skeleton
from sprain_cosim.shipped import FMUS
from tools import axes_figure


def displaced(coordinate: str, point: tuple[float, float, float]) -> np.ndarray:
    """(3,) [m] displacement of a point of the right foot when the angle goes from 0 to TURN: forward, up, right."""
    skeleton = Skeleton.read(FMUS / "plant.fmu")
    places = []
    for angle in (0.0, axes_figure.TURN):
        pose = skeleton.pose(dict.fromkeys(skeleton.coordinates, 0.0) | {coordinate: angle})
        origin, turn = pose["calcn_r"]
        places.append(origin + turn @ np.array(point))
    return places[1] - places[0]


def test_positive_subtalar_rolls_the_lateral_edge_down_and_inward() -> None:
    lateral, medial = (displaced("subtalar_angle_r", (0.05, 0.0, side)) for side in (0.045, -0.045))
    assert lateral[1] < medial[1] - 0.01
    assert lateral[2] < 0.0


def test_positive_talocrural_pulls_the_toes_up() -> None:
    assert displaced("ankle_angle_r", (0.19, 0.01, 0.0))[1] > 0.05
