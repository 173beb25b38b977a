"""The musculoskeletal model: tables in `data/` -> seven moving bodies, MJCF, and the constants of the kernels.

Frames: X anterior, Y up, Z right; SI and radians. Coordinates ("reduced", 15 of them, in this order): pelvis_tx,
pelvis_ty, pelvis_tz, pelvis_tilt, pelvis_list, pelvis_rotation, hip_flexion_r, hip_adduction_r, hip_rotation_r,
knee_angle_r, ankle_angle_r (talocrural, + dorsiflexion), subtalar_angle_r (+ supination), lumbar_extension,
lumbar_bending, lumbar_rotation. MuJoCo sees 20 joint coordinates: the knee and the patella are two translations and a
rotation each, all functions of the knee angle.

Source: DeMers, Hicks & Delp 2017 (doi 10.1016/j.jbiomech.2016.11.002), extended by Yoder, Petrella & Farrokhi 2021
(doi 10.3389/fbioe.2021.765331).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .interface import table

GRAVITY = 9.80665
AXES = "xyz"


def vector(row: dict[str, str], prefix: str, unit: str = "_m") -> np.ndarray:
    return np.array([float(row[f"{prefix}_{axis}{unit}"]) for axis in AXES])


@dataclass(frozen=True)
class Spline:
    """Cubic spline over the knee angle, (n,) knots and values, with third derivatives at the ends taken from the cubics
    through the four outermost knots (Forsythe, Malcolm & Moler 1977, chapter 4); linear beyond the knots."""

    knots: np.ndarray
    values: np.ndarray

    @cached_property
    def coefficients(self) -> np.ndarray:
        """(n - 1, 4): value, slope, half second and sixth third derivative at the left end of each interval."""
        x, y = self.knots, self.values
        n, h, slope = len(x), np.diff(x), np.diff(y) / np.diff(x)
        matrix, right = np.zeros((n, n)), np.zeros(n)
        second = np.diff(slope) / (x[2:] - x[:-2])
        third = np.diff(second) / (x[3:] - x[:-3])
        matrix[0, :2], right[0] = (-h[0], h[0]), h[0] ** 2 * third[0]
        matrix[-1, -2:], right[-1] = (h[-1], -h[-1]), -(h[-1] ** 2) * third[-1]
        for i in range(1, n - 1):
            matrix[i, i - 1 : i + 2] = h[i - 1], 2 * (h[i - 1] + h[i]), h[i]
            right[i] = slope[i] - slope[i - 1]
        sigma = np.linalg.solve(matrix, right)
        return np.column_stack([y[:-1], slope - h * (sigma[1:] + 2 * sigma[:-1]), 3 * sigma[:-1], np.diff(sigma) / h])

    def __call__(self, angle: float) -> float:
        i = int(np.clip(np.searchsorted(self.knots, angle) - 1, 0, len(self.knots) - 2))
        t = angle - self.knots[i]
        a, b, c, d = self.coefficients[i]
        return float(a + t * (b + t * (c + t * d)))


@dataclass(frozen=True)
class Movement:
    """One row of joints.csv: a translation along a parent axis or a body-fixed rotation."""

    body: str
    motion: str
    axis: np.ndarray
    coordinate: str
    spline: Spline | None
    scale: float
    free: bool
    value: float
    speed: float

    def at(self, coordinate: float) -> float:
        return coordinate if self.spline is None else self.scale * self.spline(coordinate)


def rotation(axis: np.ndarray, angle: float) -> np.ndarray:
    """(3, 3) rotation by `angle` [rad] about `axis` (Rodrigues)."""
    x, y, z = axis / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


@dataclass(frozen=True)
class Body:
    """Mass properties in the body's own frame; inertia (3, 3) about the centre of mass."""

    name: str
    parent: str
    at_parent: np.ndarray
    at_child: np.ndarray
    mass: float
    com: np.ndarray
    inertia: np.ndarray

    def with_load(self, other: Body, position: np.ndarray, turn: np.ndarray) -> Body:
        """This body with `other` rigidly attached at `position`, orientation `turn`, both in this body's frame."""
        mass = self.mass + other.mass
        com_other = position + turn @ other.com
        com = (self.mass * self.com + other.mass * com_other) / mass

        def about(body_mass: float, body_com: np.ndarray, inertia: np.ndarray) -> np.ndarray:
            r = body_com - com
            return inertia + body_mass * (r @ r * np.eye(3) - np.outer(r, r))

        inertia = about(self.mass, self.com, self.inertia) + about(other.mass, com_other, turn @ other.inertia @ turn.T)
        return Body(self.name, self.parent, self.at_parent, self.at_child, mass, com, inertia)


@dataclass(frozen=True)
class Skeleton:
    """Seven moving bodies; every locked joint is fused into its nearest moving ancestor with its exact composite
    inertia."""

    bodies: dict[str, Body]
    movements: list[Movement]
    placed: dict[str, tuple[str, np.ndarray, np.ndarray]]
    """body of the table -> (moving body that carries it, position, orientation in that body)."""

    @property
    def names(self) -> list[str]:
        return list(self.bodies)

    @property
    def coordinates(self) -> list[str]:
        return list(dict.fromkeys(m.coordinate for m in self.movements))

    def initial(self) -> tuple[np.ndarray, np.ndarray]:
        """(15,) coordinates and (15,) speeds of the measured state at contact."""
        first: dict[str, Movement] = {}
        for movement in self.movements:
            first.setdefault(movement.coordinate, movement)
        return np.array([m.value for m in first.values()]), np.array([m.speed for m in first.values()])

    def mjcf(self) -> str:
        """The MuJoCo model: joints and inertia only; contact, muscles and bushings are the kernels' own."""

        def text(values: np.ndarray) -> str:
            return " ".join(repr(float(v)) for v in values)

        def element(body: Body) -> str:
            i = body.inertia
            full = np.array([i[0, 0], i[1, 1], i[2, 2], i[0, 1], i[0, 2], i[1, 2]])
            joints = "".join(
                f'<joint name="{body.name}_{k}" type="{"slide" if m.motion == "translation" else "hinge"}" '
                f'axis="{text(m.axis)}" pos="{text(body.at_child)}"/>'
                for k, m in enumerate(m for m in self.movements if m.body == body.name)
            )
            children = "".join(element(child) for child in self.bodies.values() if child.parent == body.name)
            return (
                f'<body name="{body.name}" pos="{text(body.at_parent - body.at_child)}">{joints}'
                f'<inertial pos="{text(body.com)}" mass="{body.mass!r}" fullinertia="{text(full)}"/>{children}</body>'
            )

        return (
            '<mujoco model="landing"><compiler angle="radian"/>'
            f'<option gravity="0 {-GRAVITY!r} 0"><flag contact="disable" constraint="disable"/></option>'
            f"<worldbody>{element(self.bodies['pelvis'])}</worldbody></mujoco>"
        )


def load_movements() -> list[Movement]:
    splines: dict[str, tuple[list[float], list[float]]] = {}
    for row in table("splines"):
        x, y = splines.setdefault(row["spline"], ([], []))
        x.append(float(row["knee_angle_rad"]))
        y.append(float(row["value_m_or_rad"]))
    return [
        Movement(
            row["body"],
            row["motion"],
            vector(row, "axis", ""),
            row["coordinate"],
            Spline(*(np.array(v) for v in splines[row["spline"]])) if row["spline"] else None,
            float(row["scale"] or 1.0),
            row["status"] == "free",
            float(row["initial_value_rad_or_m"]),
            float(row["initial_speed_rad_s_or_m_s"]),
        )
        for row in table("joints")
    ]


def load_bodies() -> list[Body]:
    """The bodies of the table as they stand there, parents before their children."""
    bodies = []
    for row in table("bodies"):
        xx, yy, zz, xy, xz, yz = (float(row[f"I{k}_kg_m2"]) for k in ("xx", "yy", "zz", "xy", "xz", "yz"))
        bodies.append(
            Body(
                row["body"],
                row["parent"],
                vector(row, "parent"),
                vector(row, "child"),
                float(row["mass_kg"]),
                vector(row, "com"),
                np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]),
            )
        )
    return bodies


def load_skeleton() -> Skeleton:
    movements = load_movements()
    moving: dict[str, Body] = {}
    placed: dict[str, tuple[str, np.ndarray, np.ndarray]] = {}
    for body in load_bodies():
        own = [m for m in movements if m.body == body.name]
        if any(m.free for m in own):
            moving[body.name] = body
            placed[body.name] = (body.name, np.zeros(3), np.eye(3))
            continue
        carrier, position, turn = placed[body.parent]
        shift = body.at_parent + sum((m.at(m.value) * m.axis for m in own if m.motion == "translation"), np.zeros(3))
        position, local = position + turn @ shift, np.eye(3)
        for m in own:
            if m.motion == "rotation":
                local = local @ rotation(m.axis, m.at(m.value))
        turn = turn @ local
        position = position - turn @ body.at_child
        placed[body.name] = (carrier, position, turn)
        moving[carrier] = moving[carrier].with_load(body, position, turn)
    order = [
        "pelvis",
        "femur_r",
        "tibia_r",
        "talus_r",
        "calcn_r",
        "patella_r",
        "torso",
    ]  # depth first, as MuJoCo numbers them
    free = [m for name in order for m in movements if m.body == name]
    return Skeleton({name: moving[name] for name in order}, free, placed)


@dataclass(frozen=True)
class Muscles:
    """(49,) constants of the muscles and the points of their paths in the frames of the moving bodies."""

    names: list[str]
    max_force: np.ndarray
    optimal_length: np.ndarray
    slack_length: np.ndarray
    pennation: np.ndarray
    group: list[str]
    length_gain: np.ndarray
    velocity_gain: np.ndarray
    rest_length: np.ndarray
    point_muscle: np.ndarray
    """(n,) muscle of each path point, ascending."""
    point_body: np.ndarray
    """(n,) moving body, 1-based as in MuJoCo."""
    point: np.ndarray
    """(n, 3)"""
    point_coordinate: np.ndarray
    """(n,) reduced coordinate on which a conditional point depends, -1 for fixed points."""
    point_range: np.ndarray
    """(n, 2) rad"""


def load_muscles(skeleton: Skeleton) -> Muscles:
    rows = table("muscles")
    names = [row["muscle"] for row in rows]
    gains = {row["reflex_group"]: row for row in table("reflexes")}

    def reflex(column: str) -> np.ndarray:
        return np.array([float(gains[r["reflex_group"]][column]) if r["reflex_group"] in gains else 0.0 for r in rows])

    def column(name: str) -> np.ndarray:
        return np.array([float(row[name]) for row in rows])

    index = {name: k + 1 for k, name in enumerate(skeleton.names)}
    coordinate = {name: k for k, name in enumerate(skeleton.coordinates)}
    points = table("paths")
    bodies, positions = [], []
    for row in points:
        carrier, position, turn = skeleton.placed[row["body"]]
        bodies.append(index[carrier])
        positions.append(position + turn @ vector({f"p_{k}": v for k, v in row.items()}, "p"))
    return Muscles(
        names,
        column("max_isometric_force_N"),
        column("optimal_fibre_length_m"),
        column("tendon_slack_length_m"),
        column("pennation_at_optimal_rad"),
        [row["reflex_group"] for row in rows],
        reflex("length_gain"),
        reflex("velocity_gain"),
        reflex("rest_length"),
        np.array([names.index(row["muscle"]) for row in points]),
        np.array(bodies),
        np.array(positions),
        np.array([coordinate[row["condition"]] if row["condition"] else -1 for row in points]),
        np.radians([[float(row["condition_min_deg"] or 0), float(row["condition_max_deg"] or 0)] for row in points]),
    )
