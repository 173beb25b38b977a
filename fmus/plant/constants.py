"""The base person's constants: tables of `data/`, the compiled MuJoCo model, the sole in blocks."""

from __future__ import annotations

import math
from functools import lru_cache

import mujoco
import numpy as np

from . import kernels, person
from .interface import ANKLE_MUSCLES, SEGMENTS
from .model import GRAVITY, Muscles, Skeleton, load_bodies, load_movements, load_muscles, load_skeleton, table, vector

PLATFORM_PIVOT = (-0.2, 0.015, 0.35)
MAX_PENNATION = math.acos(0.1)
FLATNESS = (1.0, 4.0, 1.0)  # height counts more: flat blocks lie on one side of the platform or the other
TURNS = ((0, 0, 1), (1, 0, 0), (0, 1, 0))  # of a ball joint, one after the other: z, x, y


@lru_cache(maxsize=1)
def anatomy() -> tuple[Skeleton, Muscles, mujoco.MjModel]:
    skeleton = load_skeleton()
    return skeleton, load_muscles(skeleton), mujoco.MjModel.from_xml_string(skeleton.mjcf())


@lru_cache(maxsize=1)
def sole() -> np.ndarray:
    """(7, n): x, y, z in the calcaneus frame [m], area [m^2] and mean squares of the normals' components of each
    facet."""
    columns = ("x_m", "y_m", "z_m", "area_m2", "normal_x", "normal_y", "normal_z")
    rows = table("sole")
    return np.array([[float(row[c]) for row in rows] for c in columns])


def blocks(facets: np.ndarray) -> np.ndarray:
    """(1,) of person.sole_record: (7, n) facets sorted into m spatial blocks, and these into groups of a
    vector's lanes, padded with repeated facets of no area;
    `blocks` holds the centres and half extents of their bounding boxes."""
    if facets.shape[1] > kernels.MAX_FACETS // 2:
        raise ValueError(f"a sole of {facets.shape[1]} facets; at most {kernels.MAX_FACETS // 2} are supported")

    def split(members: np.ndarray, size: int) -> list[np.ndarray]:
        if len(members) <= size:
            return [members]
        here = facets[:3, members]
        widest = np.argmax(np.ptp(here, axis=1) * FLATNESS)
        members = members[np.argsort(here[widest], kind="stable")]
        half = math.ceil(len(members) / 2 / size) * size
        return split(members[:half], size) + split(members[half:], size)

    groups = [np.concatenate(split(block, kernels.LANES)) for block in split(np.arange(facets.shape[1]), kernels.BLOCK)]
    whole = groups + groups[-1:] * (-len(groups) % kernels.LANES)
    padded = np.array([np.resize(members, kernels.BLOCK) for members in whole])
    ordered = np.ascontiguousarray(facets[:, padded].transpose(1, 0, 2))
    for block, members in zip(ordered, groups, strict=False):
        block[3, len(members) :] = 0.0
    ordered[len(groups) :, 3] = 0.0
    low, high = ordered[:, :3].min(axis=2), ordered[:, :3].max(axis=2)
    out = np.zeros(1, person.sole_record(len(whole)))
    out["facets"], out["normals"] = ordered[:, :4], ordered[:, 4:]
    out["blocks"] = np.hstack([(low + high) / 2, (high - low) / 2]).T
    return out


def record() -> np.ndarray:
    """(1,) of person.BASE."""
    out = np.zeros(1, person.BASE)
    _model(out[0]["model"])
    out["sole"] = blocks(sole())
    _tables(out[0])
    return out


def _model(model: np.void) -> None:
    skeleton, muscles, compiled = anatomy()
    _bodies(model, compiled)
    _splines(model, skeleton)
    _muscles(model, muscles)
    _springs(model)
    model["pivot"] = PLATFORM_PIVOT
    model["jcs_zero"] = neutral_jcs(model["talocrural_axis"])
    model["published_height"] = skeleton.initial()[0][1]


def segment(body: str) -> str:
    """Which of SEGMENTS a body of the table is scaled with."""
    return {
        "pelvis": "pelvis",
        "femur": "thigh",
        **dict.fromkeys(("tibia", "patella"), "shank"),
        **dict.fromkeys(("talus", "calcn", "toes"), "foot"),
    }.get(body.removesuffix("_r").removesuffix("_l"), "torso")


def _tables(base: np.void) -> None:
    """What a person of another size is made from: the bodies of the table and the points of the muscles in their
    frames."""
    skeleton, movements, bodies = anatomy()[0], load_movements(), load_bodies()
    names, moving = [b.name for b in bodies], skeleton.names
    for k, body in enumerate(bodies):
        carrier, _, turn = skeleton.placed[body.name]
        fused = [m for m in movements if m.body == body.name and m.motion == "translation" and carrier != body.name]
        base["segment"][k] = SEGMENTS.index(segment(body.name))
        base["parent"][k] = names.index(body.parent) if body.parent in names else -1
        base["carrier"][k], base["moves"][k] = 1 + moving.index(carrier), carrier == body.name
        base["turn"][k], base["mass"][k] = turn, body.mass
        base["slide"][k] = sum((m.at(m.value) * m.axis for m in fused), np.zeros(3))
        for name in ("com", "inertia", "at_parent", "at_child"):
            base[name][k] = getattr(body, name)
    for p, row in enumerate(table("paths")):
        base["point_body"][p] = names.index(row["body"])
        base["point"][p] = vector({f"p_{k}": v for k, v in row.items()}, "p")
    coupled = [m for m in skeleton.movements if m.spline is not None]
    base["measured"] = skeleton.initial()[0]
    base["spline_axis"] = [int(np.argmax(m.axis)) if m.motion == "translation" else -1 for m in coupled]


def _bodies(model: np.void, compiled: mujoco.MjModel) -> None:
    """Masses, inertias and joints as MuJoCo compiled them; the kernels' recursion knows which joints there are."""
    model["gravity"] = -compiled.opt.gravity[1]
    turn = np.zeros(9)
    for body in range(1, kernels.NB):
        mujoco.mju_quat2Mat(turn, compiled.body_iquat[body])
        frame = turn.reshape(3, 3)
        model["body_mass"][body] = compiled.body_mass[body]
        model["body_com"][body] = compiled.body_ipos[body]
        model["body_inertia"][body] = (frame @ np.diag(compiled.body_inertia[body]) @ frame.T).ravel()
        anchor = compiled.jnt_pos[compiled.body_jntadr[body]]
        model["anchor"][body], model["anchor_in_parent"][body] = anchor, compiled.body_pos[body] + anchor
    axes, slides = compiled.jnt_axis, compiled.jnt_type == mujoco.mjtJoint.mjJNT_SLIDE
    along = np.eye(3)
    expected = [*along, *TURNS, *TURNS, *along[:2], TURNS[0], axes[12], axes[13], *along[:2], TURNS[0], *TURNS]
    sliding = [*[True] * 3, *[False] * 6, True, True, *[False] * 3, True, True, *[False] * 4]
    if not (np.array_equal(axes, expected) and slides.tolist() == sliding and not compiled.body_quat[:, 1:].any()):
        raise ValueError("the joints of the MuJoCo model are not those that kernels.skeleton goes through")
    model["talocrural_axis"], model["subtalar_axis"] = axes[12], axes[13]


def _splines(model: np.void, skeleton: Skeleton) -> None:
    coupled = [v for v in skeleton.movements if v.spline is not None]
    for j, movement in enumerate(coupled):
        assert movement.spline is not None
        size = len(movement.spline.knots)
        model["spline_size"][j], model["spline_scale"][j] = size, movement.scale
        model["spline_knot"][j, :size] = movement.spline.knots
        model["spline_coefficient"][j, : size - 1] = movement.spline.coefficients


def ankle_muscles(muscles: Muscles) -> list[int]:
    """Positions of the muscles that the controller reaches, in the order of interface.ANKLE_MUSCLES."""
    return [muscles.names.index(f"{name}_r") for name in ANKLE_MUSCLES]


def _muscles(model: np.void, muscles: Muscles) -> None:
    model["max_force"] = muscles.max_force
    model["l_opt"], model["l_slack"] = muscles.optimal_length, muscles.slack_length
    model["height"] = muscles.optimal_length * np.sin(muscles.pennation)
    model["l_min"] = np.maximum(0.01 * muscles.optimal_length, model["height"] / math.sin(MAX_PENNATION))
    for name in ("length_gain", "velocity_gain", "rest_length"):
        model[name] = getattr(muscles, name)
    for name in ("point_muscle", "point_body", "point", "point_coordinate"):
        model[name] = getattr(muscles, name)
    model["conditional"] = np.flatnonzero(muscles.point_coordinate >= 0)
    model["point_low"], model["point_high"] = muscles.point_range.T
    model["ankle_muscle"] = ankle_muscles(muscles)
    model["tibialis_anterior"] = muscles.names.index("tib_ant_r")


def _springs(model: np.void) -> None:
    bushings = {(r["bushing"], r["axis"]): r for r in table("bushings")}
    columns = ("linear_Nm", "quadratic_Nm", "cubic_Nm", "damping_Nm_s")
    for i, axis in enumerate("xyz"):
        model["ankle_bushing"][i] = model["brace_bushing"][i] = [float(bushings["ankle", axis][c]) for c in columns[:3]]
        model["lumbar_bushing"][i] = [float(bushings["lumbar", axis][c]) for c in columns]
    limits = {row["coordinate"]: row for row in table("limits")}
    turn = math.degrees(1.0)
    for i, name in enumerate(("lumbar_extension", "knee_angle_r")):
        row = limits[name]
        model["limit"][i] = [
            math.radians(float(row["upper_deg"])),
            math.radians(float(row["lower_deg"])),
            float(row["upper_stiffness_Nm_per_deg"]) * turn,
            float(row["lower_stiffness_Nm_per_deg"]) * turn,
            float(row["damping_Nm_s_per_deg"]) * turn,
            math.radians(float(row["transition_deg"])),
        ]


def neutral_jcs(e1: np.ndarray) -> tuple[float, float, float]:
    """Raw angles of the joint coordinate system (kernels.jcs_angles) [rad] in the neutral pose, where tibia and
    calcaneus have one frame; `e1` is the talocrural axis in it."""
    e3 = np.array([0.0, 1.0, 0.0])
    e2 = np.cross(e3, e1) / np.linalg.norm(np.cross(e3, e1))
    upright = e3 - (e3 @ e1) * e1
    upright /= np.linalg.norm(upright)
    return math.asin(e2 @ upright), math.asin(e1 @ e3), math.asin(e2[2])


__all__ = ["GRAVITY", "anatomy", "ankle_muscles", "blocks", "neutral_jcs", "record", "segment", "sole"]
