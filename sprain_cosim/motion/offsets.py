"""How far the joints of an OpenSim model lie apart: lengths of a person's segments that need no model to compare with.

In OpenSim 4 a joint stands in the JointSet with an offset frame in either body, in OpenSim 3 in its child body with
places in both. Translations that follow a coordinate are taken at 0."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
# between which bodies of the right leg a segment is measured, along which axes of the outer one's place in the inner
MEASURED = {
    "pelvis": ("pelvis", "femur_r", "z"),
    "thigh": ("femur_r", "tibia_r", "xyz"),
    "shank": ("tibia_r", "talus_r", "xyz"),
    "foot": ("calcn_r", "toes_r", "xyz"),
    "torso": ("torso", "humerus_r", "y"),
}
# [m] the same places in the plant of the base person (DeMers, Hicks & Delp 2017, doi 10.1016/j.jbiomech.2016.11.002)
PLANT_PLACES = {
    "pelvis": (-0.0699828, -0.0654294, 0.0826529),
    "thigh": (-0.0057340, -0.4328098, 0.0),
    "shank": (0.0, -0.464696, 0.0),
    "foot": (0.18713, -0.00209318, 0.00113032),
    "torso": (0.00323147, 0.379279, 0.17412),
}


def segment_places(root: Element, side: str) -> dict[str, Array]:
    """{segment: (3,) [m] where the joint that ends it lies in its frame}, of those whose joint the file has."""
    joints = {child: (parent, place) for child, parent, place in (*_of_version_4(root), *_of_version_3(root))}
    found = {}
    for segment, ends in MEASURED.items():
        inner, outer = (f"{end[:-1]}{side[0]}" if end.endswith("_r") else end for end in ends[:2])
        parent, place = joints.get(outer, ("", np.zeros(3)))
        if parent == inner and np.isfinite(place).all():
            found[segment] = place
    return found


def measured_length(segment: str, place: ArrayLike) -> float:
    """[m] along the axes that measure the segment."""
    axes = ["xyz".index(axis) for axis in MEASURED[segment][2]]
    return float(np.linalg.norm(np.asarray(place, dtype=float)[axes]))


def _of_version_4(root: Element) -> Iterator[tuple[str, str, Array]]:
    """(child, parent, place of the child's origin in the parent)."""
    for joint in root.iter():
        sockets = [joint.findtext(f"socket_{end}_frame") for end in ("parent", "child")]
        if not joint.tag.endswith("Joint") or None in sockets:
            continue
        frames = {
            frame.get("name"): (frame.findtext("socket_parent") or "", _numbers(frame.findtext("translation")))
            for frame in joint.iter("PhysicalOffsetFrame")
        }
        names = [str(socket).rpartition("/")[2] for socket in sockets]
        (parent, at_parent), (child, at_child) = (frames.get(name, (name, np.zeros(3))) for name in names)
        place = at_parent + _moved(joint) - at_child
        yield child.rpartition("/")[2], parent.rpartition("/")[2], place


def _of_version_3(root: Element) -> Iterator[tuple[str, str, Array]]:
    for body in root.iter("Body"):
        for joint in body.findall("Joint/*"):
            place = (
                _numbers(joint.findtext("location_in_parent")) + _moved(joint) - _numbers(joint.findtext("location"))
            )
            yield body.get("name", ""), (joint.findtext("parent_body") or "").strip(), place


def _moved(joint: Element) -> Array:
    """(3,) what the joint's translations add while its coordinates are 0."""
    total = np.zeros(3)
    for axis in joint.iter("TransformAxis"):
        if (axis.get("name") or "").startswith("translation"):
            total += _numbers(axis.findtext("axis")) * _at_zero(axis)
    return total


def _at_zero(axis: Element) -> float:
    factor = np.prod([float(m.findtext("scale") or 1.0) for m in axis.iter("MultiplierFunction")])
    for function in axis.iter():
        x, y = function.findtext("x"), function.findtext("y")
        if x and y:  # a spline
            return float(factor * np.interp(0.0, _numbers(x), _numbers(y)))
        if coefficients := function.findtext("coefficients"):  # a polynomial, the constant last
            return float(factor * _numbers(coefficients)[-1])
        if value := function.findtext("value"):
            return float(factor * float(value))
    return 0.0


def _numbers(text: str | None) -> Array:
    """NaN where they are none."""
    try:
        found = np.array([float(word) for word in (text or "0 0 0").split()])
    except ValueError:
        return np.full(3, np.nan)
    return found


def lengthened(factors: Mapping[str, Array], places: Mapping[str, Array]) -> dict[str, float]:
    """{segment: by how much its factors must be multiplied, so that the plant's joints lie as far apart as the
    file's}."""
    found = {}
    for segment, place in places.items():
        plant = measured_length(segment, factors.get(segment, np.ones(3)) * np.array(PLANT_PLACES[segment]))
        if (own := measured_length(segment, place)) > 0:
            found[segment] = own / plant
    return found
