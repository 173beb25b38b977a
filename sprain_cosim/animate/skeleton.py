"""The body that is drawn: a plant's FMU carries it as extra/sprain-cosim/skeleton.json, and its coordinates give the
pose."""

from __future__ import annotations

import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError
from ..files import parse_json

FILE = "extra/sprain-cosim/skeleton.json"
Pose = dict[str, tuple[np.ndarray, np.ndarray]]  # {body: (origin (3,) [m], orientation (3, 3))} in the ground's frame


@dataclass(frozen=True)
class Skeleton:
    """The content of FILE.

    - bodies: from the root to the ends, each with its parent, the joint's place in both bodies and its movements; of a
      locked joint `shift` [m] and `turn`; `segment`: which factors of a person's lengths it has
    - volumes: round cones (part, body, both ends [m] in the body's frame, both radii [m])
    - points: named landmarks (body, place [m] in the body's frame)
    - platform: pivot [m], and the parameter that holds its incline
    - factors: of each segment, the parameters that hold its length factors in x, y and z
    """

    content: Mapping[str, Any]

    @classmethod
    def read(cls, fmu: Path) -> Skeleton:
        """Raises InputError for a plant without a drawing."""
        try:
            with zipfile.ZipFile(fmu) as archive:
                return cls(parse_json(archive.read(FILE).decode(), f"{fmu}: its {FILE}"))
        except KeyError:
            raise InputError(f"{fmu}: has no {FILE}, so its landing cannot be drawn") from None
        except (OSError, ValueError, zipfile.BadZipFile) as problem:
            raise InputError(f"{fmu}: its {FILE} cannot be read: {problem}") from None

    def scaled(self, parameter: Callable[[str], float]) -> Skeleton:
        """Of the person whose length factors `parameter` gives by name; one without factors is drawn as it is."""
        factors = {
            segment: np.array([parameter(name) for name in names])
            for segment, names in self.content.get("factors", {}).items()
        }
        if all((f == 1.0).all() for f in factors.values()):
            return self
        of = {body["name"]: factors[body["segment"]] for body in self.content["bodies"]} | {"ground": np.ones(3)}
        bodies = [
            body
            | {name: body[name] * of[body["parent"]] for name in ("at_parent", "shift") if name in body}
            | {"at_child": body["at_child"] * of[body["name"]]}
            | {"movements": [_scaled_movement(m, of[body["parent"]]) for m in body["movements"]]}
            for body in self.content["bodies"]
        ]
        volumes = [_scaled_volume(v, of[v["body"]]) for v in self.content["volumes"]]
        points = {name: p | {"at": p["at"] * of[p["body"]]} for name, p in self.content["points"].items()}
        return Skeleton({**self.content, "bodies": bodies, "volumes": volumes, "points": points})

    @cached_property
    def coordinates(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(m["coordinate"] for body in self.content["bodies"] for m in body["movements"]))

    def pose(self, coordinates: Mapping[str, float | np.ndarray]) -> Pose:
        """From the coordinates [rad, m] to the place of every body; from (n,) values of each to n places (n, 3) and
        orientations (n, 3, 3)."""
        many = np.broadcast_shapes(*(np.shape(value) for value in coordinates.values()))
        placed: Pose = {"ground": (np.zeros((*many, 3)), np.broadcast_to(np.eye(3), (*many, 3, 3)))}
        for body in self.content["bodies"]:
            origin, turn = placed[body["parent"]]
            joint = np.array(body["at_parent"], float) + body.get("shift", 0.0)
            local = np.array(body["turn"]) if "turn" in body else np.eye(3)
            for movement in body["movements"]:
                value, axis = coordinates[movement["coordinate"]], np.array(movement["axis"], float)
                if "values" in movement:
                    value = np.interp(value, *movement["values"])
                if movement["motion"] == "translation":
                    joint = joint + np.multiply.outer(value, axis)
                else:
                    local = local @ rotation(axis, value)
            turn_here = turn @ local
            at_child = np.array(body["at_child"], float)
            placed[body["name"]] = (origin + np.matvec(turn, joint) - turn_here @ at_child, turn_here)
        return placed

    def point(self, name: str, pose: Pose) -> np.ndarray:
        """(3,) [m] of a named landmark: knee, ankle; (n, 3) in n poses."""
        landmark = self.content["points"][name]
        origin, turn = pose[landmark["body"]]
        place: np.ndarray = origin + turn @ np.array(landmark["at"])
        return place

    @cached_property
    def parts(self) -> list[str]:
        return [v["part"] for v in self.content["volumes"]]

    def volumes(self, pose: Pose) -> np.ndarray:
        """(n, 8): both ends [m] in the ground's frame and both radii [m], one row for each of `parts`."""
        rows = np.empty((len(self._ends), 8))
        rows[:, 6:] = [v["radii"] for v in self.content["volumes"]]
        for body, members in self._members.items():
            origin, turn = pose[body]
            rows[members, :3] = origin + self._ends[members, :3] @ turn.T
            rows[members, 3:6] = origin + self._ends[members, 3:] @ turn.T
        return rows

    @cached_property
    def _ends(self) -> np.ndarray:
        return np.array([[*v["from"], *v["to"]] for v in self.content["volumes"]])

    @cached_property
    def _members(self) -> dict[str, np.ndarray]:
        of_body = [v["body"] for v in self.content["volumes"]]
        return {body: np.array([k for k, b in enumerate(of_body) if b == body]) for body in dict.fromkeys(of_body)}


def _scaled_movement(movement: dict[str, Any], factors: np.ndarray) -> dict[str, Any]:
    """A translation that follows a coordinate belongs to the parent."""
    if movement["motion"] != "translation" or "values" not in movement:
        return movement
    over, values = movement["values"]
    return movement | {"values": [over, np.abs(movement["axis"]) @ factors * np.array(values)]}


def _scaled_volume(volume: dict[str, Any], factors: np.ndarray) -> dict[str, Any]:
    """Thick by the mean of the factors across its length."""
    start, end = np.array(volume["from"]), np.array(volume["to"])
    along = int(np.argmax(np.abs(end - start)))
    across = np.sqrt(np.delete(factors, along).prod())
    return volume | {"from": start * factors, "to": end * factors, "radii": np.array(volume["radii"]) * across}


def rotation(axis: np.ndarray, angle: float | np.ndarray) -> np.ndarray:
    """(3, 3) rotation by `angle` [rad] about `axis` (Rodrigues); (n, 3, 3) by n angles."""
    x, y, z = axis / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    turn: np.ndarray = (
        np.eye(3) + np.multiply.outer(np.sin(angle), cross) + np.multiply.outer(1 - np.cos(angle), cross @ cross)
    )
    return turn
