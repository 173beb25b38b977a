"""The size of a person from OpenSim's model file (.osim): masses, how far joints lie apart, and the scale factors of
the bodies' drawings, which the scale tool leaves there.

The tool's factors are against the model that was scaled, which is of another size than this plant (gait2392's thigh is
0.40 m long, the plant's 0.43 m). So they say how a segment's axes differ, and the distance of its joints how long it
is."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from ..errors import InputError
from ..files import read_text
from .offsets import lengthened, measured_length, segment_places

LARGEST = 64 << 20  # B
Factors = tuple[float, float, float]  # along x, y, z
SEGMENTS = {  # of the plant: the bodies of a model, the first of which speaks for the segment
    "pelvis": ("pelvis",),
    "thigh": ("femur_r", "femur_l"),
    "shank": ("tibia_r", "tibia_l", "patella_r", "patella_l"),
    "foot": ("calcn_r", "talus_r", "toes_r", "calcn_l", "talus_l", "toes_l"),
    "torso": ("torso",),
}
OURS = {body for bodies in SEGMENTS.values() for body in bodies}
ARMS = ("humerus", "ulna", "radius", "hand")  # go with the torso
LEAST, MOST = 0.5, 2.0  # of a factor that a person can have
ALIKE = 0.005  # of a factor
AS_THEY_STAND = (
    "no joint in the file measures it; the factors are taken as they stand, against the model that was scaled"
)
UNSCALED = "all scale factors are 1: this is the size of the model as it came, of no person"


@dataclass(frozen=True)
class OpenSimModel:
    """What a model file says of its person.

    - name
    - mass: [kg] of all bodies
    - factors: {segment of the plant: (3,) x, y, z}, against the plant
    - stated: {segment: (3,) as the file has them}, against the model that was scaled
    - lengths: {segment: [m] between its joints}, where the file's joints could be read
    - notes: what was read otherwise than one may think
    - others: bodies that the plant has not
    - knee: positive direction of the knee, flexion or extension; None where its range does not say
    """

    name: str
    mass: float
    factors: Mapping[str, Factors]
    stated: Mapping[str, Factors]
    lengths: Mapping[str, float]
    notes: tuple[str, ...]
    others: tuple[str, ...]
    knee: str | None

    def parameters(self) -> dict[str, float]:
        """Of the plant."""
        named = {f"{s}_scale_{a}": f for s, xyz in self.factors.items() for a, f in zip("xyz", xyz, strict=True)}
        return {"body_mass": self.mass, **named}


def read_osim(path: Path, side: str = "right") -> OpenSimModel:
    """Raises InputError in one line."""
    root, model, bodies = _parsed(path)
    masses = {name: _number(path, f"mass of {name}", body.findtext("mass")) for name, body in bodies.items()}
    scales = {name: _factors(path, name, body) for name, body in bodies.items()}
    places = segment_places(root, side)
    stated, notes = _segments(scales, side, places)
    factors = dict(stated)
    for segment, times in lengthened({n: np.array(f) for n, f in stated.items()}, places).items():
        x, y, z = (round(times * f, 6) for f in stated.get(segment, (1.0, 1.0, 1.0)))
        factors[segment] = x, y, z
    arms = [n for n in bodies if n.rpartition("_")[0] in ARMS]
    if arms:
        notes.append(f"arms ({', '.join(sorted(arms))}): scaled with the torso, as the plant has it")
    others = tuple(n for n in bodies if n not in OURS and n not in arms)
    unmeasured = [segment for segment in stated if segment not in places]
    if unmeasured:
        notes.append(f"{', '.join(unmeasured)}: {AS_THEY_STAND}")
    if stated and all(f == 1.0 for three in stated.values() for f in three):
        notes.append(UNSCALED)
    lengths = {segment: measured_length(segment, place) for segment, place in places.items()}
    name, mass = model.get("name", path.stem), sum(masses.values())
    return OpenSimModel(name, mass, factors, stated, lengths, tuple(notes), others, _knee(root, side))


def _parsed(path: Path) -> tuple[ElementTree.Element, ElementTree.Element, dict[str, ElementTree.Element]]:
    """The document, its model, and {name: body} without the ground. Raises InputError for what is no model of a body
    that this plant has."""
    try:
        root = ElementTree.fromstring(read_text(path, LARGEST).encode())
    except ElementTree.ParseError as problem:
        raise InputError(f"{path}: is no XML of an OpenSim model: {problem}") from None
    model = root.find("Model") if root.tag == "OpenSimDocument" else None
    bodies = {b.get("name", ""): b for b in root.iter("Body") if b.get("name") not in ("ground", None)}
    if model is None or not bodies:
        raise InputError(f"{path}: is no OpenSim model (.osim): it has no <Model> with bodies")
    if not OURS & bodies.keys():
        raise InputError(
            f"{path}: none of its bodies is one of this plant's (pelvis, femur_r, tibia_r, calcn_r, torso); it has "
            f"{', '.join(list(bodies)[:5])}. Leave --model out, and name the person with --subject of `run`"
        )
    return root, model, bodies


def _segments(
    scales: Mapping[str, Factors | None], side: str, measured: Collection[str]
) -> tuple[dict[str, Factors], list[str]]:
    """Factors of the plant's segments, and what a reader must know of them."""
    factors: dict[str, Factors] = {}
    notes: list[str] = []
    for segment, members in SEGMENTS.items():
        if side == "left":
            members = tuple(f"{m[:-1]}{'l' if m[-1] == 'r' else 'r'}" if m[-2:] in ("_l", "_r") else m for m in members)
        have = {m: f for m in members if (f := scales.get(m)) is not None}
        if not have:
            taken = "its axes are taken as alike" if segment in measured else "1 is taken"
            notes.append(f"{segment}: the file has no scale factors of {members[0]}; {taken}")
            continue
        first, *rest = have
        if first != members[0]:
            notes.append(f"{segment}: the file has no scale factors of {members[0]}; those of {first} are taken")
        factors[segment] = have[first]
        apart = [m for m in rest if np.abs(np.subtract(have[m], have[first])).max() > ALIKE]
        if apart:
            notes.append(f"{segment}: the factors of {first} are taken; those of {', '.join(apart)} differ")
    return factors, notes


def _number(path: Path, what: str, text: str | None) -> float:
    try:
        value = float(text or "")
    except ValueError:
        value = float("nan")
    if not np.isfinite(value) or value < 0:
        raise InputError(f"{path}: {what}: {'is missing' if text is None else f'{text.strip()!r} is no mass'}")
    return value


def _factors(path: Path, name: str, body: ElementTree.Element) -> Factors | None:
    """Of the body's drawings (OpenSim 4: each mesh's; OpenSim 3: the body's times its first mesh's), or None where it
    has none. The drawings of frames are no body's."""
    meshes = body.findall("attached_geometry/*/scale_factors")
    found = [_three(path, name, element) for element in (*body.findall("VisibleObject/scale_factors"), *meshes[:1])]
    if body.find("VisibleObject") is not None:
        found += [_three(path, name, e) for e in body.findall("VisibleObject/GeometrySet/objects/*/scale_factors")[:1]]
    if not found:
        return None
    x, y, z = (float(f) for f in np.prod(found, axis=0))
    if not all(LEAST <= f <= MOST for f in (x, y, z)):
        raise InputError(
            f"{path}: scale_factors of {name} are {x:g} {y:g} {z:g}: no person is {min(x, y, z):g} times as large "
            f"as the model ({LEAST:g} to {MOST:g}); is the drawing in other units? Leave --model out, or correct it"
            if min(x, y, z) < LEAST
            else f"{path}: scale_factors of {name} are {x:g} {y:g} {z:g}: must lie between {LEAST:g} and {MOST:g}"
        )
    return x, y, z


def _three(path: Path, name: str, element: ElementTree.Element) -> Factors:
    try:
        x, y, z = (abs(float(word)) for word in (element.text or "").split())
    except ValueError:
        raise InputError(f"{path}: scale_factors of {name}: {element.text!r} are not three numbers") from None
    return x, y, z


def _knee(root: ElementTree.Element, side: str) -> str | None:
    for coordinate in root.iter("Coordinate"):
        words = (coordinate.findtext("range") or "").split()
        if coordinate.get("name") == f"knee_angle_{side[0]}" and len(words) == 2:
            low, high = (float(w) for w in words)
            return "flexion" if high > 1.0 and low > -1.0 else "extension" if low < -1.0 and high < 1.0 else None
    return None
