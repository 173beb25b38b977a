"""From the columns of a storage file to the plant's 15 coordinates: names, degrees, the sign of the knee, the side, the
heading; what is missing and what is left aside.

The right leg of the plant lands. A left-footed landing is mirrored at the sagittal plane: the left leg's coordinates
are the right one's with the same sign (so OpenSim defines them); what turns or moves the trunk sideways changes its
sign."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, nearest
from ..export.landing import COORDINATES, TRANSLATIONS
from .storage import StorageTable

Array = NDArray[np.float64]
ESSENTIAL = (
    *("pelvis_ty", "pelvis_tilt", "pelvis_list", "pelvis_rotation"),
    *("hip_flexion_r", "hip_adduction_r", "hip_rotation_r", "knee_angle_r", "ankle_angle_r"),
)
MIRRORED = ("pelvis_tz", "pelvis_list", "pelvis_rotation", "lumbar_bending", "lumbar_rotation")  # change their sign
TRUNK = ("pelvis_tilt", "pelvis_list", "pelvis_rotation")
LOCKED = (  # coordinates of the model that this plant holds fast at the measured state
    *("mtp_angle_r", "hip_flexion_l", "hip_adduction_l", "hip_rotation_l", "knee_angle_l", "ankle_angle_l"),
    *("subtalar_angle_l", "mtp_angle_l"),
    *(f"{c}_{s}" for s in "rl" for c in ("arm_flex", "arm_add", "arm_rot", "elbow_flex", "pro_sup")),
    *(f"{c}_{s}" for s in "rl" for c in ("wrist_flex", "wrist_dev")),
)
RAJAGOPAL = ("knee_angle_r_beta", "knee_angle_l_beta")  # the patella's coordinates of Rajagopal 2016 and its children
WALKER = "walker_knee"  # their joint
HYPEREXTENSION = 15.0  # deg, beyond which no knee extends: the sign with more than that is flexion
FLAT = 7.0  # rad: no coordinate of a landing turns further, so that such a number is one of degrees
STIFF = 3.2  # deg: within which no body lands, so that a file of such angles is one of radians
PATH = re.compile(r"(?:/?jointset)?/?(?:[\w.]+/)+(?P<name>\w+)/(?P<kind>value|speed)")
RATE = re.compile(r"(?P<name>\w+)_(?:u|speed)")
AHEAD = 60.0  # deg off the plant's forward axis, beyond which a heading must be said


@dataclass(frozen=True)
class Course:
    """The motion as the plant names and counts it, over the file's rows.

    - time: (n,) [s]
    - values: {coordinate: (n,)} [rad, m]; a coordinate that the file lacks is absent
    - speeds: likewise [rad/s, m/s], of the columns that the file has
    - sources: {coordinate: label of its column}
    - turned: sentences about signs that were turned, and about the side
    - unused: {label of a column that is not used: why}
    - lines: (n,) line of the file of each row
    """

    time: Array
    values: Mapping[str, Array]
    speeds: Mapping[str, Array]
    sources: Mapping[str, str]
    turned: tuple[str, ...]
    unused: Mapping[str, str]
    lines: tuple[int, ...]

    @property
    def missing(self) -> tuple[str, ...]:
        return tuple(c for c in COORDINATES if c not in self.values)


def read_course(
    table: StorageTable,
    side: str = "right",
    knee: str | None = None,
    angles: str | None = None,
    turn: float = 0.0,
    flexion: str | None = None,
) -> Course:
    """The course of the landing leg `side`.

    - knee: direction in which the file's knee is positive, flexion or extension; None: found
    - angles: unit of the file's angles, degrees or radians, where the header says nothing or is wrong
    - turn: [rad] about the vertical by which the motion is turned
    - flexion: what a model of the subject says of the knee's positive direction: flexion or extension

    Raises InputError in one line."""
    found = _columns(table, side)
    factor = _factor(table, found, angles)
    values, speeds = dict[str, Array](), dict[str, Array]()
    for (coordinate, kind), label in found.items():
        column = table.columns[label] * (1.0 if coordinate in TRANSLATIONS else factor)
        (values if kind == "value" else speeds)[coordinate] = column
    _check_missing(table, values, found)
    sources = {c: label for (c, kind), label in found.items() if kind == "value"}
    turned: list[str] = []
    positive, why = _knee(table, values["knee_angle_r"], sources["knee_angle_r"], knee, flexion)
    if positive == "flexion":
        for group in (values, speeds):
            if "knee_angle_r" in group:
                group["knee_angle_r"] = -group["knee_angle_r"]
        turned.append(f"knee: + flexion in the file ({why}), + extension in the plant: the sign was turned")
    else:
        turned.append(f"knee: + extension in the file ({why}), as in the plant")
    if side == "left":
        for group in (values, speeds):
            group.update({c: -group[c] for c in MIRRORED if c in group})
        turned.append(f"left foot: mirrored, the left leg as the right one; sign turned of {', '.join(MIRRORED)}")
    speeds = {c: column for c, column in speeds.items() if c in values}
    course = Course(table.time, values, speeds, sources, tuple(turned), _unused(table, found, side), table.lines)
    return turned_about_the_vertical(course, turn) if turn else course


def _columns(table: StorageTable, side: str) -> dict[tuple[str, str], str]:
    """{(coordinate of the plant, value or speed): label}."""
    out: dict[tuple[str, str], str] = {}
    for label in table.columns:
        name, kind = _named(label)
        wanted = _of_side(name, side)
        if wanted is None:
            continue
        if (wanted, kind) in out:
            raise InputError(
                f"{table.path}: columns {out[wanted, kind]} and {label} are both the {kind} of {name}; leave one out"
            )
        out[wanted, kind] = label
    return out


def _named(label: str) -> tuple[str, str]:
    """Name of the coordinate, and value or speed."""
    if found := PATH.fullmatch(label):
        return found["name"], found["kind"]
    if label not in COORDINATES and (found := RATE.fullmatch(label)):
        return found["name"], "speed"
    return label, "value"


def _of_side(name: str, side: str) -> str | None:
    """The plant's coordinate of a name of the file's; None for one that the plant has not."""
    if side == "left" and name.endswith("_l"):
        name = f"{name[:-2]}_r"
    elif side == "left" and name.endswith("_r"):
        return None
    return name if name in COORDINATES else None


def _on_side(coordinate: str, side: str) -> str:
    return f"{coordinate[:-2]}_l" if side == "left" and coordinate.endswith("_r") else coordinate


def _check_missing(table: StorageTable, values: Mapping[str, Array], found: Mapping[tuple[str, str], str]) -> None:
    labels = [_named(label)[0] for label in table.columns]
    side = "left" if any(label.endswith("_l") for label in found.values()) else "right"
    missing = [c for c in ESSENTIAL if c not in values]
    if len(missing) == len(ESSENTIAL):
        some = ", ".join(list(table.columns)[:4])
        raise InputError(
            f"{table.path}: none of its columns ({some}, ...) has a name that the OpenSim model has (pelvis_tilt, "
            "hip_flexion_r, knee_angle_r, ...): rename them, or write the motion with OpenSim's inverse kinematics"
        )
    if missing:
        first = _on_side(missing[0], side)
        names = ", ".join(_on_side(c, side) for c in missing)
        close = nearest(first, labels) if len(labels) > 12 or "did you mean" in nearest(first, labels) else ""
        raise InputError(
            f"{table.path}: has no column {names}, without which there is no landing{close}; add it, or rename the "
            "column that holds it"
        )


def _factor(table: StorageTable, found: Mapping[tuple[str, str], str], angles: str | None) -> float:
    """Radians per unit of the file's angles. Raises InputError for a header that says nothing, or no truth."""
    largest, where = 0.0, ""
    for (coordinate, kind), label in found.items():
        if kind == "value" and coordinate not in TRANSLATIONS:
            most = float(np.nanmax(np.abs(table.columns[label]), initial=0.0))
            largest, where = max((largest, where), (most, label))
    if angles is None and table.in_degrees is None:
        look = "degrees" if largest > FLAT else "radians" if largest < 2.0 else "either"
        raise InputError(
            f"{table.path}: its header has no line inDegrees=yes or inDegrees=no, and its angles (up to {largest:.3g}) "
            f"look like {look}: add the line, or say --angles degrees or --angles radians"
        )
    in_degrees = angles == "degrees" if angles is not None else bool(table.in_degrees)
    if not in_degrees and largest > FLAT:
        said = "--angles radians" if angles is not None else "its header says inDegrees=no"
        raise InputError(
            f"{table.path}: {said}, but {where} reaches {largest:.4g}, which can only be degrees: correct the "
            "header, or say --angles degrees"
        )
    if in_degrees and angles is None and 0.0 < largest < STIFF:
        raise InputError(
            f"{table.path}: its header says inDegrees=yes, but no angle is larger than {largest:.3g}, which can only "
            "be radians: correct the header, or say --angles radians"
        )
    return float(np.pi / 180.0) if in_degrees else 1.0


def _knee(table: StorageTable, angle: Array, label: str, stated: str | None, of_model: str | None) -> tuple[str, str]:
    """The direction in which the file's knee is positive, and how that is known. Raises InputError where it is not, or
    where the signs contradict each other."""
    if stated is not None:
        return stated, f"as --knee {stated} says"
    signs: dict[str, str] = {}
    if of_model is not None:
        signs[of_model] = "range of the knee in the model file"
    names = [n for n in table.columns if _named(n)[0] in RAJAGOPAL or WALKER in n]
    if names:
        signs.setdefault("flexion", f"column {names[0]}, which models after Rajagopal 2016 have")
    low, high = (float(np.degrees(f(angle))) for f in (np.nanmin, np.nanmax))
    seen = f"{label} goes from {low:z.0f} to {high:z.0f} deg"
    if high > HYPEREXTENSION and low > -HYPEREXTENSION:
        signs.setdefault("flexion", f"{seen}, and no knee extends so far")
    elif low < -HYPEREXTENSION and high < HYPEREXTENSION:
        signs.setdefault("extension", f"{seen}, and no knee extends so far")
    if len(signs) > 1:
        raise InputError(
            f"{table.path}: the sign of the knee contradicts itself: + flexion by {signs['flexion']}, + extension by "
            f"{signs['extension']}; say --knee flexion or --knee extension: the direction that is positive in the file"
        )
    if not signs:
        raise InputError(
            f"{table.path}: whether the knee is positive in flexion cannot be told ({seen}); say --knee flexion or "
            "--knee extension: the direction that is positive in the file"
        )
    return next(iter(signs.items()))


def _unused(table: StorageTable, found: Mapping[tuple[str, str], str], side: str) -> dict[str, str]:
    used, out = set(found.values()), dict[str, str]()
    locked = {f"{c[:-2]}_{'r' if c.endswith('_l') else 'l'}" if side == "left" else c for c in LOCKED}
    for label in table.columns:
        if label in used:
            continue
        name = _named(label)[0]
        if name in locked:
            out[label] = "locked"
        elif name in RAJAGOPAL or name.startswith("patella"):
            out[label] = "follows the knee"
        else:
            out[label] = "unknown"
    return out


def turned_about_the_vertical(course: Course, angle: float) -> Course:
    """The same motion with its person and its place turned by `angle` [rad] about the vertical through the origin.
    Raises InputError where a coordinate of the pelvis is missing."""
    lacking = [c for c in (*TRANSLATIONS, *TRUNK) if c not in course.values]
    if lacking:
        raise InputError(f"--turn: needs all six coordinates of the pelvis; the file has no {', '.join(lacking)}")
    place = np.array([course.values[c] for c in (*TRANSLATIONS, *TRUNK)])
    moved = _turn(angle)(place)
    values = dict(course.values) | dict(zip((*TRANSLATIONS, *TRUNK), moved, strict=True))
    speeds = dict(course.speeds)
    if all(c in speeds for c in (*TRANSLATIONS, *TRUNK)):
        rate, h = np.array([speeds[c] for c in (*TRANSLATIONS, *TRUNK)]), 1e-6
        ahead, behind = _turn(angle)(place + h * rate), _turn(angle)(place - h * rate)
        change = (ahead - behind) / (2 * h)
        speeds |= dict(zip((*TRANSLATIONS, *TRUNK), change, strict=True))
    else:
        speeds = {c: v for c, v in speeds.items() if c not in (*TRANSLATIONS, *TRUNK)}
    text = f"turned by {np.degrees(angle):.4g} deg about the vertical, as --turn says"
    return replace(course, values=values, speeds=speeds, turned=(*course.turned, text))


def _turn(angle: float) -> Callable[[Array], Array]:
    """(6, n) coordinates of the pelvis -> those turned about the vertical; body-fixed angles about z, x, y."""
    c, s = np.cos(angle), np.sin(angle)
    about = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])

    def turned(place: Array) -> Array:
        a, b, g = place[3:]
        one, nil = np.ones_like(a), np.zeros_like(a)
        z = np.array([[np.cos(a), -np.sin(a), nil], [np.sin(a), np.cos(a), nil], [nil, nil, one]])
        x = np.array([[one, nil, nil], [nil, np.cos(b), -np.sin(b)], [nil, np.sin(b), np.cos(b)]])
        y = np.array([[np.cos(g), nil, np.sin(g)], [nil, one, nil], [-np.sin(g), nil, np.cos(g)]])
        r = np.einsum("ij,jkn,kln,lmn->imn", about, z, x, y)
        tilt, rotation = np.arctan2(-r[0, 1], r[1, 1]), np.arctan2(-r[2, 0], r[2, 2])
        angles = np.array([np.unwrap(tilt), np.arcsin(np.clip(r[2, 1], -1, 1)), np.unwrap(rotation)])
        return np.concatenate([about @ place[:3], angles])

    return turned


def facing(values: Mapping[str, float]) -> float:
    """[deg] from the plant's forward axis to where the pelvis faces, about the vertical, + to the left."""
    tilt, aside, about = (values[c] for c in TRUNK)
    forward = np.cos(tilt) * np.cos(about) - np.sin(tilt) * np.sin(aside) * np.sin(about)
    return float(np.degrees(np.arctan2(np.cos(aside) * np.sin(about), forward)))
