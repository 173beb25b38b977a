"""The size of a person from OpenSim's model file (.osim): masses, and the scale factors of the bodies' drawings, which
the scale tool leaves there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from ..errors import InputError
from ..files import read_text

LARGEST = 64 << 20  # B
Factors = tuple[float, float, float]  # along x, y, z
SEGMENTS = {  # of the plant: the bodies of a model, the first of which speaks for the segment
    "pelvis": ("pelvis",),
    "thigh": ("femur_r", "femur_l"),
    "shank": ("tibia_r", "tibia_l", "patella_r", "patella_l"),
    "foot": ("calcn_r", "talus_r", "toes_r", "calcn_l", "talus_l", "toes_l"),
    "torso": ("torso",),
}
ARMS = ("humerus", "ulna", "radius", "hand")  # go with the torso
LEAST, MOST = 0.5, 2.0  # of a factor that a person can have
ALIKE = 0.005  # of a factor


@dataclass(frozen=True)
class OpenSimModel:
    """What a model file says of its person.

    - name
    - mass: [kg] of all bodies
    - factors: {segment of the plant: (3,) x, y, z}
    - notes: what was read otherwise than one may think
    - others: bodies that the plant has not
    - knee: positive direction of the knee, flexion or extension; None where its range does not say
    """

    name: str
    mass: float
    factors: Mapping[str, Factors]
    notes: tuple[str, ...]
    others: tuple[str, ...]
    knee: str | None

    def parameters(self) -> dict[str, float]:
        """Of the plant."""
        named = {f"{s}_scale_{a}": f for s, xyz in self.factors.items() for a, f in zip("xyz", xyz, strict=True)}
        return {"body_mass": self.mass, **named}


def read_osim(path: Path, side: str = "right") -> OpenSimModel:
    """Raises InputError in one line."""
    try:
        root = ElementTree.fromstring(read_text(path, LARGEST).encode())
    except ElementTree.ParseError as problem:
        raise InputError(f"{path}: is no XML of an OpenSim model: {problem}") from None
    model = root.find("Model") if root.tag == "OpenSimDocument" else None
    bodies = {b.get("name", ""): b for b in root.iter("Body") if b.get("name") not in ("ground", None)}
    if model is None or not bodies:
        raise InputError(f"{path}: is no OpenSim model (.osim): it has no <Model> with bodies")
    masses = {name: _number(path, f"mass of {name}", body.findtext("mass")) for name, body in bodies.items()}
    scales = {name: _factors(path, name, body) for name, body in bodies.items()}
    factors, notes = _segments(scales, side)
    arms = [n for n in scales if n.rpartition("_")[0] in ARMS]
    ours = {m for members in SEGMENTS.values() for m in members} | set(arms)
    if arms:
        notes.append(f"arms ({', '.join(sorted(arms))}): scaled with the torso, as the plant has it")
    others = tuple(n for n in bodies if n not in ours)
    return OpenSimModel(
        model.get("name", path.stem), sum(masses.values()), factors, tuple(notes), others, _knee(root, side)
    )


def _segments(scales: Mapping[str, Factors | None], side: str) -> tuple[dict[str, Factors], list[str]]:
    """Factors of the plant's segments, and what a reader must know of them."""
    factors: dict[str, Factors] = {}
    notes: list[str] = []
    for segment, members in SEGMENTS.items():
        if side == "left":
            members = tuple(f"{m[:-1]}{'l' if m[-1] == 'r' else 'r'}" if m[-2:] in ("_l", "_r") else m for m in members)
        have = {m: f for m in members if (f := scales.get(m)) is not None}
        if not have:
            notes.append(f"{segment}: the file has no scale factors of {members[0]}; 1 is taken")
            continue
        first, *rest = have
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
    """Of the body's first drawing that has any."""
    for element in body.iter("scale_factors"):
        try:
            x, y, z = (abs(float(word)) for word in (element.text or "").split())
        except ValueError:
            raise InputError(f"{path}: scale_factors of {name}: {element.text!r} are not three numbers") from None
        if not all(LEAST <= f <= MOST for f in (x, y, z)):
            raise InputError(
                f"{path}: scale_factors of {name} are {x:g} {y:g} {z:g}: no person is {min(x, y, z):g} times as large "
                f"as the model ({LEAST:g} to {MOST:g}); is the drawing in other units? Leave --model out, or correct it"
                if min(x, y, z) < LEAST
                else f"{path}: scale_factors of {name} are {x:g} {y:g} {z:g}: must lie between {LEAST:g} and {MOST:g}"
            )
        return x, y, z
    return None


def _knee(root: ElementTree.Element, side: str) -> str | None:
    for coordinate in root.iter("Coordinate"):
        words = (coordinate.findtext("range") or "").split()
        if coordinate.get("name") == f"knee_angle_{side[0]}" and len(words) == 2:
            low, high = (float(w) for w in words)
            return "flexion" if high > 1.0 and low > -1.0 else "extension" if low < -1.0 and high < 1.0 else None
    return None
