"""The landing as glTF: the file by the rules of the specification, and its content by the landing's."""

from __future__ import annotations

import json
import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sprain_cosim.animate.moving import MovingBodies, platform_axes
from sprain_cosim.export.gltf import SLOW, write_glb
from sprain_cosim.folders.landing import Landing

from .test_export import landing as landing  # the same landing, run once a module

COMPONENTS = {5123: ("<u2", 2), 5126: ("<f4", 4)}
WIDTH = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}


class Read:
    """A .glb, read by the rules of glTF 2.0: container, views inside the buffer, accessors inside their views and
    aligned, every index inside its list, bounds as stated, quaternions of unit length, times that grow."""

    def __init__(self, content: bytes) -> None:
        magic, version, length = struct.unpack_from("<4sII", content)
        assert (magic, version, length) == (b"glTF", 2, len(content))
        size, kind = struct.unpack_from("<I4s", content, 12)
        assert kind == b"JSON" and size % 4 == 0
        self.json: dict[str, Any] = json.loads(content[20 : 20 + size])
        rest, kind = struct.unpack_from("<I4s", content, 20 + size)
        assert kind == b"BIN\0" and rest % 4 == 0 and 28 + size + rest == len(content)
        self.data = content[28 + size :]
        assert self.json["asset"]["version"] == "2.0"
        assert self.json["buffers"] == [{"byteLength": rest}]
        self.arrays = [self._array(entry) for entry in self.json["accessors"]]
        self._shapes()
        self._animation()

    def _array(self, entry: dict[str, Any]) -> np.ndarray:
        view = self.json["bufferViews"][entry["bufferView"]]
        kind, size = COMPONENTS[entry["componentType"]]
        wide = WIDTH[entry["type"]]
        assert view["byteOffset"] % size == 0
        assert entry["count"] * wide * size == view["byteLength"]
        assert view["byteOffset"] + view["byteLength"] <= len(self.data)
        found = np.frombuffer(self.data, kind, entry["count"] * wide, view["byteOffset"]).reshape(-1, wide)
        assert np.isfinite(found).all()
        if "min" in entry:
            assert np.array_equal(found.min(axis=0), np.array(entry["min"], kind))
            assert np.array_equal(found.max(axis=0), np.array(entry["max"], kind))
        return found

    def _shapes(self) -> None:
        for mesh in self.json["meshes"]:
            for primitive in mesh["primitives"]:
                places, normals = (self.arrays[primitive["attributes"][k]] for k in ("POSITION", "NORMAL"))
                assert "min" in self.json["accessors"][primitive["attributes"]["POSITION"]]
                triangles = self.arrays[primitive["indices"]]
                assert len(places) == len(normals) and triangles.max() < len(places) and len(triangles) % 3 == 0
                assert np.abs(np.linalg.norm(normals, axis=1) - 1).max() < 1e-5
                assert 0 <= primitive["material"] < len(self.json["materials"])
                a, b, c = places[triangles.reshape(-1, 3)].transpose(1, 0, 2)
                outward = np.einsum("ij,ij->i", np.cross(b - a, c - a), normals[triangles.reshape(-1, 3)].mean(axis=1))
                assert outward.min() > -1e-9, "counter-clockwise from outside"
        (scene,) = self.json["scenes"]
        assert sorted(scene["nodes"]) == list(range(len(self.json["nodes"])))
        assert all(node.get("mesh", 0) < len(self.json["meshes"]) for node in self.json["nodes"])

    def _animation(self) -> None:
        (moved,) = self.json["animations"]
        targets = [(c["target"]["node"], c["target"]["path"]) for c in moved["channels"]]
        assert len(set(targets)) == len(targets)
        for sampler in moved["samplers"]:
            times = self.arrays[sampler["input"]][:, 0]
            assert times[0] == 0 and (np.diff(times) > 0).all()
            assert len(self.arrays[sampler["output"]]) == len(times)
        for (_, path), channel in zip(targets, moved["channels"], strict=True):
            values = self.arrays[moved["samplers"][channel["sampler"]]["output"]]
            assert values.shape[1] == (4 if path == "rotation" else 3)
            if path == "rotation":
                assert np.abs(np.linalg.norm(values, axis=1) - 1).max() < 1e-6

    def moved(self, name: str, path: str) -> np.ndarray:
        node = [n["name"] for n in self.json["nodes"]].index(name)
        (animation,) = self.json["animations"]
        (sampler,) = [c["sampler"] for c in animation["channels"] if c["target"] == {"node": node, "path": path}]
        found: np.ndarray = self.arrays[animation["samplers"][sampler]["output"]]
        return found


@pytest.fixture(scope="module")
def read(landing: Landing, tmp_path_factory: pytest.TempPathFactory) -> Read:
    target = tmp_path_factory.mktemp("gltf") / "x.glb"
    poses, seconds = write_glb(landing, target)
    assert (poses, seconds) == (61, pytest.approx(SLOW * 0.06))
    assert target.stat().st_size < 1_500_000
    return Read(target.read_bytes())


def test_bodies_force_and_moments_are_those_of_the_landing(read: Read, landing: Landing) -> None:
    moving = MovingBodies.of(landing)
    for body in moving.places:
        np.testing.assert_allclose(read.moved(body, "translation"), moving.places[body], atol=1e-6)
        np.testing.assert_allclose(read.moved(body, "rotation"), moving.turns[body], atol=1e-6)
    k = int(np.argmax(np.linalg.norm(moving.force, axis=1)))
    turn = Rotation.from_quat(read.moved("force on the foot", "rotation")[k])
    np.testing.assert_allclose(
        turn.apply([0.0, 1.0, 0.0]), moving.force[k] / np.linalg.norm(moving.force[k]), atol=1e-6
    )
    np.testing.assert_allclose(read.moved("force on the foot", "translation")[k], moving.point[k], atol=1e-6)
    brace = read.moved("moment of the brace", "scale")[:, 1]
    assert np.corrcoef(brace, np.abs(moving.signals["brace"]))[0, 1] > 0.9999
    names = [node["name"] for node in read.json["nodes"]]
    assert "platform" in names and "moment of the anatomy" in names


def test_the_platform_is_tilted_as_the_parameter_says(read: Read) -> None:
    (platform,) = [node for node in read.json["nodes"] if node["name"] == "platform"]
    normal = Rotation.from_quat(platform["rotation"]).apply([0.0, 1.0, 0.0])
    np.testing.assert_allclose(normal, [0.0, np.cos(np.pi / 6), np.sin(np.pi / 6)], atol=1e-12)


def test_the_platform_ends_at_its_edge(landing: Landing, tmp_path: Path) -> None:
    edge = {"plant.platform_edge_distance": 0.03, "plant.platform_edge_direction": 0.4}
    write_glb(replace(landing, parameters={**landing.parameters, **edge}), tmp_path / "x.glb")
    read = Read((tmp_path / "x.glb").read_bytes())  # counter-clockwise from outside, as all
    (mesh,) = [mesh for mesh in read.json["meshes"] if mesh["name"] == "platform"]
    places = read.arrays[mesh["primitives"][0]["attributes"]["POSITION"]]
    moving = MovingBodies.of(landing)
    foot = platform_axes(moving.tilt) @ (moving.places["calcn_r"][0] - moving.pivot)
    reach = (places[:, [0, 2]] - foot[[0, 2]]) @ [np.cos(0.4), np.sin(0.4)]
    assert reach.max() == pytest.approx(0.03, abs=1e-6)


def test_it_is_the_same_file_each_time(landing: Landing, tmp_path: Path) -> None:
    for name in ("a.glb", "b.glb"):
        write_glb(landing, tmp_path / name)
    assert (tmp_path / "a.glb").read_bytes() == (tmp_path / "b.glb").read_bytes()
