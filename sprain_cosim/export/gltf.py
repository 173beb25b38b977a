"""A landing as animated glTF 2.0 in one binary file (.glb): opens in viewers, Blender and slides.

Metres, y up, as glTF has it and as the plant's ground frame is (x forward, z to the right of the person). Bodies are
nodes that move; force and moments are arrows that grow. The animation is slowed, because a landing of 150 ms would be
over before a viewer shows it."""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.colors import to_rgb
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from .. import __version__
from ..animate.moving import HALF_PLATFORM, MovingBodies
from ..animate.stage import PLATFORM, part_colour
from ..figures.style import ANATOMY, BRACE, GROUND
from ..files import whole_file
from ..folders.landing import Landing

SLOW = 20.0  # times slower than real time, as the film
AROUND, RINGS = 16, 5  # of a round cone
SEEN_THROUGH = {"skin": 0.28, "foot": 0.28, "brace": 0.55, "sole": 0.6}  # opacity of what lies over the bones
FORCE, MOMENT = 0.42, 0.16  # length [m] of the largest arrow
THIN, FLOAT, SHORT = 1e-3, 5126, 5123
ARRAYS, INDICES = 34962, 34963  # targets of buffer views

Array = NDArray[Any]


def write_glb(landing: Landing, target: Path) -> tuple[int, float]:
    """Writes the landing; returns how many poses it has and how many seconds its animation lasts. Raises InputError for
    a plant or a record that cannot be drawn, EnvironmentProblem."""
    moving = MovingBodies.of(landing)
    with whole_file(target, parents=True) as partial:
        partial.write_bytes(glb(moving))
    return len(moving.time), SLOW * float(moving.time[-1])


def glb(moving: MovingBodies) -> bytes:
    """The content of the file."""
    made = _Document()
    names = list(moving.places)
    roots = [made.node(name, _mesh_of_body(made, moving, name)) for name in names]
    platform = made.node("platform", made.mesh("platform", [(*_slab(moving.outline), made.material(PLATFORM))]))
    made.nodes[platform] |= {
        "translation": [float(c) for c in moving.pivot],
        "rotation": [math.sin(0.5 * moving.tilt), 0.0, 0.0, math.cos(0.5 * moving.tilt)],
    }
    times = made.accessor((SLOW * moving.time).astype("<f4"), bounds=True)
    for node, name in zip(roots, names, strict=True):
        made.move(times, node, "translation", moving.places[name])
        made.move(times, node, "rotation", moving.turns[name])
    arrows = [_arrow_node(made, times, *arrow) for arrow in _arrows(moving)]
    return made.binary([*roots, platform, *arrows], moving)


def _arrows(moving: MovingBodies) -> list[tuple[str, str, Array, Array]]:
    """(name, colour, where it begins (n, 3), arrow (n, 3) [m]) of the force and of the moments on the foot."""
    late = moving.time > 0.005  # the first contact of a pose inside the floor may be many times larger
    top = max(1.0, float(np.linalg.norm(moving.force[late], axis=1).max(initial=1.0)))
    length = np.linalg.norm(moving.force, axis=1, keepdims=True)
    force = FORCE / top * moving.force * np.minimum(1.0, top / np.maximum(length, 1.0))
    moment = max(20.0, *(float(np.abs(moving.signals[who]).max()) for who in ("anatomy", "brace")))
    found = [("force on the foot", GROUND, moving.point, force)]
    for who, colour in (("anatomy", ANATOMY), ("brace", BRACE)):
        if who == "anatomy" or moving.braced:
            # a positive moment resists supination: it acts on the foot against the axis
            along = -MOMENT / moment * moving.signals[who][:, None] * moving.axis
            found.append((f"moment of the {who}", colour, moving.ankle, along))
    return found


def _arrow_node(made: _Document, times: int, name: str, colour: str, start: Array, way: Array) -> int:
    """An arrow of one metre along y, turned and scaled at each time."""
    shape = (*_arrow(), made.material(np.array(to_rgb(colour))))
    node = made.node(name, made.mesh(name, [shape]))
    length = np.linalg.norm(way, axis=1)
    direction = np.where(length[:, None] > THIN, way / np.maximum(length, 1e-12)[:, None], [0.0, 1.0, 0.0])
    scale = np.maximum(length, 1e-6)
    made.move(times, node, "translation", start)
    made.move(times, node, "rotation", _from_y(direction))
    made.move(times, node, "scale", np.stack([np.minimum(1.0, 8 * scale), scale, np.minimum(1.0, 8 * scale)], axis=1))
    return node


def _from_y(direction: Array) -> Array:
    """(n, 4) quaternions that turn y into the unit vectors (n, 3)."""
    axis = np.stack([direction[:, 2], np.zeros(len(direction)), -direction[:, 0]], axis=1)
    size = np.linalg.norm(axis, axis=1, keepdims=True)
    axis = np.where(size > 1e-9, axis / np.maximum(size, 1e-12), [1.0, 0.0, 0.0])
    angle = np.arccos(np.clip(direction[:, 1], -1.0, 1.0))[:, None]
    turns: Array = Rotation.from_rotvec(angle * axis).as_quat()
    return turns


def _mesh_of_body(made: _Document, moving: MovingBodies, body: str) -> int | None:
    parts: dict[str, list[tuple[Array, Array, Array]]] = {}
    for volume in moving.volumes:
        if volume["body"] == body:
            parts.setdefault(str(volume["part"]), []).append(_round_cone(volume))
    shapes = []
    for part, cones in parts.items():
        shapes.append((*_joined(cones), made.material(part_colour(part), SEEN_THROUGH.get(part, 1.0))))
    return made.mesh(body, shapes) if shapes else None


# ---- shapes: places (n, 3) [m], normals (n, 3), triangles (m, 3)


def _round_cone(volume: Mapping[str, Any]) -> tuple[Array, Array, Array]:
    """Two balls and the cone that touches both."""
    start, end = np.array(volume["from"], float), np.array(volume["to"], float)
    first, second = (float(r) for r in volume["radii"])
    length = float(np.linalg.norm(end - start))
    along = (end - start) / length if length > 1e-9 else np.array([0.0, 1.0, 0.0])
    lean = math.asin(max(-1.0, min(1.0, (first - second) / length))) if length > 1e-9 else 0.0
    low, high = np.linspace(-0.5 * math.pi, lean, RINGS + 1), np.linspace(lean, 0.5 * math.pi, RINGS + 1)
    angles = np.concatenate([low, high])
    radii = np.concatenate([np.full(RINGS + 1, first), np.full(RINGS + 1, second)])
    at = np.concatenate([np.zeros(RINGS + 1), np.full(RINGS + 1, length)])
    profile = np.stack([at + radii * np.sin(angles), radii * np.cos(angles), np.sin(angles)], axis=1)
    return _revolved(start, along, profile)


def _revolved(start: Array, along: Array, profile: Array) -> tuple[Array, Array, Array]:
    """A surface of revolution about `along` from `start`; rows of `profile`: distance and radius [m], slope of the
    normal along the axis. Triangles are counter-clockwise from outside."""
    across = np.cross(along, [0.0, 1.0, 0.0] if abs(along[1]) < 0.9 else [1.0, 0.0, 0.0])
    across /= np.linalg.norm(across)
    turn = 2 * math.pi * np.arange(AROUND + 1) / AROUND
    out = np.cos(turn)[:, None] * across + np.sin(turn)[:, None] * np.cross(along, across)
    distance, radius, slope = profile.T
    places = start + distance[:, None, None] * along + radius[:, None, None] * out
    normals = slope[:, None, None] * along + np.sqrt(np.maximum(0.0, 1 - slope**2))[:, None, None] * out
    row, column = np.meshgrid(np.arange(len(profile) - 1), np.arange(AROUND), indexing="ij")
    a = (row * (AROUND + 1) + column).ravel()
    b = a + AROUND + 1
    triangles = np.concatenate([np.stack([a, a + 1, b], axis=1), np.stack([a + 1, b + 1, b], axis=1)])
    return places.reshape(-1, 3), normals.reshape(-1, 3), triangles


def _arrow() -> tuple[Array, Array, Array]:
    up, thick = np.array([0.0, 1.0, 0.0]), 0.006
    shaft = np.array([[0, 0, -1], [0, thick, -1], [0, thick, 0], [0.8, thick, 0]], float)
    head = np.array([[0.8, 0, -1], [0.8, 2.4 * thick, -1], [0.8, 2.4 * thick, 0.1], [1.0, 0, 0.1]], float)
    return _joined([_revolved(np.zeros(3), up, shaft), _revolved(np.zeros(3), up, head)])


def _slab(outline: Array) -> tuple[Array, Array, Array]:
    """The platform, its top face through the origin; `outline` (k, 2): x and z of its corners."""
    k = len(outline)
    top = np.stack([outline[:, 0], np.zeros(k), outline[:, 1]], axis=1)
    up, deep = np.array([0.0, 1.0, 0.0]), np.array([0.0, 2.0 * HALF_PLATFORM[1], 0.0])
    fan = np.array([[0, n + 1, n] for n in range(1, k - 1)])
    parts = [(top, np.tile(up, (k, 1)), fan), (top - deep, np.tile(-up, (k, 1)), fan[:, ::-1])]
    for one, other in zip(top, np.roll(top, -1, axis=0), strict=True):
        out = np.cross(up, other - one) / np.linalg.norm(other - one)
        places = np.array([one, other, other - deep, one - deep])
        parts.append((places, np.tile(out, (4, 1)), np.array([[0, 1, 2], [0, 2, 3]])))
    return _joined(parts)


def _joined(parts: Sequence[tuple[Array, Array, Array]]) -> tuple[Array, Array, Array]:
    begin = np.cumsum([0, *(len(places) for places, _, _ in parts[:-1])])
    triangles = [part[2] + first for part, first in zip(parts, begin, strict=True)]
    return np.concatenate([p for p, _, _ in parts]), np.concatenate([n for _, n, _ in parts]), np.concatenate(triangles)


@dataclass
class _Document:
    """What a glTF document lists; each method adds to it and returns the place of what it added."""

    nodes: list[dict[str, Any]] = field(default_factory=list)
    meshes: list[dict[str, Any]] = field(default_factory=list)
    materials: list[dict[str, Any]] = field(default_factory=list)
    accessors: list[dict[str, Any]] = field(default_factory=list)
    views: list[dict[str, Any]] = field(default_factory=list)
    samplers: list[dict[str, Any]] = field(default_factory=list)
    channels: list[dict[str, Any]] = field(default_factory=list)
    data: bytearray = field(default_factory=bytearray)

    def accessor(self, values: Array, bounds: bool = False, target: int | None = None) -> int:
        content = np.ascontiguousarray(values).tobytes()
        view: dict[str, Any] = {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(content)}
        self.views.append(view | ({} if target is None else {"target": target}))
        self.data += content + bytes(-len(content) % 4)
        entry: dict[str, Any] = {
            "bufferView": len(self.views) - 1,
            "componentType": SHORT if values.dtype == np.dtype("<u2") else FLOAT,
            "count": len(values),
            "type": {1: "SCALAR", 3: "VEC3", 4: "VEC4"}[1 if values.ndim == 1 else values.shape[1]],
        }
        if bounds:
            low, high = values.min(axis=0), values.max(axis=0)
            entry |= {"min": np.atleast_1d(low).tolist(), "max": np.atleast_1d(high).tolist()}
        self.accessors.append(entry)
        return len(self.accessors) - 1

    def material(self, colour: Array, opacity: float = 1.0) -> int:
        """`colour` as screens have it (sRGB); glTF wants it linear."""
        linear = np.where(colour <= 0.04045, colour / 12.92, ((colour + 0.055) / 1.055) ** 2.4)
        base = [*(round(float(c), 5) for c in linear), opacity]
        entry: dict[str, Any] = {
            "pbrMetallicRoughness": {"baseColorFactor": base, "metallicFactor": 0.0, "roughnessFactor": 0.8}
        }
        entry |= {"alphaMode": "BLEND"} if opacity < 1 else {}
        if entry not in self.materials:
            self.materials.append(entry)
        return self.materials.index(entry)

    def mesh(self, name: str, shapes: Sequence[tuple[Array, Array, Array, int]]) -> int:
        primitives = [
            {
                "attributes": {
                    "POSITION": self.accessor(places.astype("<f4"), True, ARRAYS),
                    "NORMAL": self.accessor(normals.astype("<f4"), False, ARRAYS),
                },
                "indices": self.accessor(triangles.astype("<u2").ravel(), False, INDICES),
                "material": material,
            }
            for places, normals, triangles, material in shapes
        ]
        self.meshes.append({"name": name, "primitives": primitives})
        return len(self.meshes) - 1

    def node(self, name: str, mesh: int | None) -> int:
        self.nodes.append({"name": name} | ({} if mesh is None else {"mesh": mesh}))
        return len(self.nodes) - 1

    def move(self, times: int, node: int, path: str, values: Array) -> None:
        """`values` (n, 3 or 4) of the node's `path` over the accessor of `times`."""
        output = self.accessor(values.astype("<f4"))
        self.samplers.append({"input": times, "output": output, "interpolation": "LINEAR"})
        self.channels.append({"sampler": len(self.samplers) - 1, "target": {"node": node, "path": path}})

    def binary(self, roots: Sequence[int], moving: MovingBodies) -> bytes:
        document = {
            "asset": {"version": "2.0", "generator": f"sprain-cosim {__version__}"},
            "scene": 0,
            "scenes": [
                {"name": moving.title, "nodes": list(roots), "extras": {"landing": moving.label, "slowed": SLOW}}
            ],
            "nodes": self.nodes,
            "meshes": self.meshes,
            "materials": self.materials,
            "accessors": self.accessors,
            "bufferViews": self.views,
            "buffers": [{"byteLength": len(self.data)}],
            "animations": [
                {"name": f"landing, slowed {SLOW:g} times", "samplers": self.samplers, "channels": self.channels}
            ],
        }
        text = json.dumps(document, separators=(",", ":"), allow_nan=False).encode()
        text += b" " * (-len(text) % 4)
        length = 12 + 8 + len(text) + 8 + len(self.data)
        head = struct.pack("<4sII", b"glTF", 2, length) + struct.pack("<I4s", len(text), b"JSON")
        return head + text + struct.pack("<I4s", len(self.data), b"BIN\x00") + bytes(self.data)
