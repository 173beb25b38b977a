"""A landing as rigid bodies that move, for views that a reader turns: the HTML report's and glTF."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..folders.landing import Landing
from ..metrics import brace_torques
from .bones import bones
from .skeleton import Pose, Skeleton

Array = NDArray[np.float64]
HALF_PLATFORM = (0.24, 0.018, 0.24)  # half extents [m] of the part of the platform that is drawn
EDGE = ("platform_edge_distance", "platform_edge_direction")  # parameters: from FOOT's origin at contact, from anterior
FOOT, NOWHERE = "calcn_r", 1000.0  # m
FEWEST_STEPS = 2


@dataclass(frozen=True)
class MovingBodies:
    """What moves, in the ground's frame (x forward, y up, z to the right of the person).

    title, label        of the landing
    time                (n,) [s] after contact, evenly spaced
    places              {body: (n, 3) origin [m]}
    turns               {body: (n, 4) orientation, a unit quaternion x, y, z, w}
    volumes             round cones of the bodies: part, ends [m] and radii [m] in the body's frame; bones among them
    braced              whether there is a brace
    pivot, tilt         of the drawn part of the platform: its middle (3,) [m], angle about x [rad] as its own parameter
                        has it
    outline             (k, 2) x and z [m] of the corners of its upper face from its middle, in its own frame
    edge                (3,) or None: where the platform ends, as `platform_edge` gives it
    ankle, axis         (n, 3) [m] of the ankle, (n, 3) unit vector of the subtalar axis
    force, point        (n, 3) [N] of the platform on the foot, (n, 3) [m] where it acts; zeros without contact
    signals             {name: (n,)} angle [deg] of the subtalar joint, moments [N·m] of anatomy and brace about it,
                        signs as in the figures
    """

    title: str
    label: str
    time: Array
    places: dict[str, Array]
    turns: dict[str, Array]
    volumes: tuple[dict[str, Any], ...]
    braced: bool
    pivot: Array
    tilt: float
    outline: Array
    edge: Array | None
    ankle: Array
    axis: Array
    force: Array
    point: Array
    signals: dict[str, Array]

    @classmethod
    def of(cls, landing: Landing, every: float = 1e-3) -> MovingBodies:
        """The landing at the times 0, `every` ... [s]. Raises InputError for a plant or a record that cannot be
        drawn."""
        skeleton, result = _with_bones(Skeleton.read(landing.plant)).scaled(landing.parameter), landing.result
        landing.need(skeleton.coordinates, "a drawing")
        steps = max(FEWEST_STEPS, int(result.time[-1] / every + 1e-9) + 1)
        time = np.minimum(every * np.arange(steps), result.time[-1])

        def at(name: str) -> Array:
            there = f"plant.{name}" in result.index
            return np.interp(time, result.time, result[f"plant.{name}"]) if there else np.zeros(steps)

        coordinates = {name: at(name) for name in skeleton.coordinates}
        pose = skeleton.pose(coordinates)
        first = {body: (place[0], turn[0]) for body, (place, turn) in pose.items()}
        carriers = _carriers(skeleton.content["bodies"])
        names = list(dict.fromkeys(carriers.values()))
        turns = {name: pose[name][1] for name in names}
        joint, tilt = skeleton.content["subtalar_axis"], landing.parameter(skeleton.content["platform"]["incline"])
        pivot = platform_place(skeleton, first, tilt)
        edge = platform_edge(landing, first, pivot, tilt)
        contact = at("in_contact") > 0.5
        braced = bool(brace_torques(result))
        volumes = [_carried(volume, carriers[volume["body"]], first) for volume in skeleton.content["volumes"]]
        return cls(
            title=landing.title,
            label=landing.label,
            time=time,
            places={name: pose[name][0] for name in names},
            turns={name: quaternions(turns[name]) for name in names},
            volumes=tuple(v for v in volumes if braced or v["part"] != "brace"),
            braced=braced,
            pivot=pivot,
            tilt=tilt,
            outline=platform_outline(edge),
            edge=edge,
            ankle=skeleton.point("ankle", pose),
            axis=turns[joint["body"]] @ np.array(joint["axis"], float),
            force=np.stack([at(f"ground_force_{c}") for c in "xyz"], axis=1) * contact[:, None],
            point=np.stack([at(f"ground_point_{c}") for c in "xyz"], axis=1) * contact[:, None],
            signals={
                "angle": math.degrees(1.0) * at("subtalar_angle"),
                "anatomy": at("anatomy_subtalar_moment"),
                "brace": at("brace_subtalar_moment"),
            },
        )

    @property
    def peak(self) -> int:
        """Where the subtalar angle is the largest."""
        return int(np.argmax(self.signals["angle"]))


def platform_place(skeleton: Skeleton, first: Pose, tilt: float) -> Array:
    """(3,) [m] the middle of the drawn part of the platform: the pivot, or under the foot of a motion that lands beside
    what is drawn there. `first`: the pose at contact."""
    pivot = np.array(skeleton.content["platform"]["pivot"], float)
    turn = platform_axes(tilt)
    along = turn @ (skeleton.point("ankle", first) - pivot)
    if (np.abs(along) <= HALF_PLATFORM)[[0, 2]].all():
        return pivot
    found: Array = pivot + along[0] * turn[0] + along[2] * turn[2]
    return found


def platform_axes(tilt: float) -> Array:
    """(3, 3): rows are the platform's axes in the ground's frame, the second one up from its face."""
    sine, cosine = math.sin(tilt), math.cos(tilt)
    return np.array([[1.0, 0.0, 0.0], [0.0, cosine, sine], [0.0, -sine, cosine]])


def platform_edge(landing: Landing, first: Pose, place: Array, tilt: float) -> Array | None:
    """(3,) where the platform ends: it is where edge[0] x + edge[1] z <= edge[2] [m] in its own frame, from `place`;
    None for one that goes on. `first`: the pose at contact."""
    if not all(name in landing.described.connectors for name in EDGE):
        return None
    distance, direction = (landing.parameter(name) for name in EDGE)
    if distance >= NOWHERE:
        return None
    toward = np.array([math.cos(direction), math.sin(direction)])
    foot = platform_axes(tilt) @ (first[FOOT][0] - place)
    return np.array([*toward, distance + toward @ foot[[0, 2]]])


def platform_outline(edge: Array | None) -> Array:
    """(k, 2) x and z [m] of the corners of the upper face that is drawn, in the order from x to z: a rectangle, cut at
    the edge."""
    x, z = HALF_PLATFORM[0], HALF_PLATFORM[2]
    corners = np.array([[-x, -z], [x, -z], [x, z], [-x, z]])
    if edge is None:
        return corners
    beyond = corners @ edge[:2] - edge[2]
    kept = []
    for k, corner in enumerate(corners):
        after = (k + 1) % 4
        if beyond[k] <= 0:
            kept.append(corner)
        if (beyond[k] <= 0) != (beyond[after] <= 0):
            kept.append(corner + beyond[k] / (beyond[k] - beyond[after]) * (corners[after] - corner))
    return np.array(kept).reshape(-1, 2)


def _carriers(bodies: Sequence[Mapping[str, Any]]) -> dict[str, str]:
    """{body: the body that it moves with}: itself, or what it is fixed to."""
    found: dict[str, str] = {}
    for body in bodies:
        name = str(body["name"])
        found[name] = name if body["movements"] else found.get(str(body["parent"]), name)
    return found


def _carried(volume: Mapping[str, Any], carrier: str, pose: Pose) -> dict[str, Any]:
    """The volume in the frame of the body that carries its own."""
    if volume["body"] == carrier:
        return dict(volume)
    (origin, turn), (place, frame) = pose[volume["body"]], pose[carrier]
    ends = {end: (frame.T @ (origin + turn @ np.array(volume[end]) - place)).tolist() for end in ("from", "to")}
    return {**volume, **ends, "body": carrier}


def _with_bones(skeleton: Skeleton) -> Skeleton:
    content = skeleton.content
    return Skeleton({**content, "volumes": [*content["volumes"], *bones(content["bodies"])]})


def quaternions(turns: Array) -> Array:
    """(n, 4) x, y, z, w of rotation matrices (n, 3, 3), each on the side of the one before it, so that what lies
    between two of them is the short way."""
    (a, b, c), (d, e, f), (g, h, i) = np.moveaxis(turns, 0, -1)
    four = np.array(  # four times each product of two components; the row of the largest component is the surest
        [
            [1 + a - e - i, b + d, c + g, h - f],
            [b + d, 1 - a + e - i, f + h, c - g],
            [c + g, f + h, 1 - a - e + i, d - b],
            [h - f, c - g, d - b, 1 + a + e + i],
        ]
    )
    largest = np.argmax(np.einsum("kkn->kn", four), axis=0)
    found: Array = four[largest, :, np.arange(len(turns))]
    found /= np.linalg.norm(found, axis=1, keepdims=True)
    back = np.cumsum(np.einsum("ij,ij->i", found[1:], found[:-1]) < 0) % 2 == 1
    found[1:][back] *= -1
    return found
