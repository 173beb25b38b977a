"""Bones of the right leg as round cones, drawn by eye about the joints of the plant's own skeleton: what lies under the
skin of a view that can be turned. No measured surface, and none of anybody else's."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

PART = "bone"
Place = tuple[float, float, float]
# ends [m] in the body's frame (x forward, y up, z to the right) and radii [m]; of the long bones from one joint to the
# next, where the lower end is added
FEMUR: tuple[tuple[Place, Place, float, float], ...] = (
    ((0.0, 0.0, 0.0), (0.0, -0.006, 0.004), 0.023, 0.022),
    ((0.0, -0.004, 0.006), (-0.002, -0.03, 0.042), 0.015, 0.017),
    ((-0.004, -0.012, 0.05), (-0.002, -0.05, 0.046), 0.014, 0.016),
)
TALUS: tuple[tuple[Place, Place, float, float], ...] = (
    ((-0.012, -0.008, 0.0), (0.016, -0.008, -0.002), 0.017, 0.018),
    ((0.012, -0.014, -0.004), (0.036, -0.02, -0.012), 0.013, 0.014),
)
FOOT: tuple[tuple[Place, Place, float, float], ...] = (
    ((0.008, 0.014, -0.003), (0.03, 0.022, 0.002), 0.019, 0.017),  # calcaneus
    ((0.03, 0.022, 0.002), (0.072, 0.024, 0.012), 0.016, 0.013),
    ((0.095, 0.034, -0.014), (0.107, 0.032, -0.012), 0.013, 0.012),  # navicular, cuneiforms, cuboid
    ((0.112, 0.03, -0.018), (0.126, 0.026, -0.018), 0.01, 0.01),
    ((0.112, 0.03, -0.004), (0.126, 0.026, -0.003), 0.01, 0.009),
    ((0.084, 0.024, 0.015), (0.104, 0.02, 0.018), 0.012, 0.011),
)
RAYS: tuple[tuple[Place, Place, Place, float], ...] = (  # base, head, tip and radius of the metatarsals and toes
    ((0.132, 0.022, -0.019), (0.19, 0.008, -0.024), (0.24, 0.004, -0.019), 0.0085),
    ((0.132, 0.024, -0.005), (0.2, 0.009, -0.006), (0.248, 0.003, -0.004), 0.0058),
    ((0.128, 0.022, 0.004), (0.194, 0.008, 0.008), (0.24, 0.003, 0.011), 0.0056),
    ((0.118, 0.02, 0.014), (0.184, 0.007, 0.021), (0.226, 0.003, 0.024), 0.0056),
    ((0.108, 0.018, 0.024), (0.172, 0.006, 0.033), (0.208, 0.003, 0.035), 0.0058),
)


def bones(bodies: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Volumes of the part PART, as a skeleton's own, for those of the `bodies` that are known here: femur, tibia, talus
    and calcaneus of the right leg. The long bones reach from joint to joint, whatever their length."""
    at = {str(body["name"]): body["at_parent"] for body in bodies}
    made: list[dict[str, Any]] = []
    if "femur_r" in at and "tibia_r" in at:
        made += [_cone("femur_r", *cone) for cone in (*FEMUR, *_femur_shaft(float(at["tibia_r"][1])))]
    if "tibia_r" in at and "talus_r" in at:
        made += [_cone("tibia_r", *cone) for cone in _shank(float(at["talus_r"][1]))]
    if "talus_r" in at:
        made += [_cone("talus_r", *cone) for cone in TALUS]
    if "calcn_r" in at:
        made += [_cone("calcn_r", *cone) for cone in FOOT]
        for base, head, tip, radius in RAYS:
            made.append(_cone("calcn_r", base, head, 1.1 * radius, 1.15 * radius))
            made.append(_cone("calcn_r", head, tip, radius, 0.7 * radius))
    return made


def _femur_shaft(knee: float) -> list[tuple[Place, Place, float, float]]:
    return [
        ((-0.002, -0.04, 0.04), (0.004, 0.55 * knee, 0.02), 0.015, 0.0125),
        ((0.004, 0.55 * knee, 0.02), (0.0, knee + 0.035, 0.002), 0.0125, 0.019),
        ((-0.004, knee + 0.016, -0.021), (0.008, knee + 0.018, -0.019), 0.02, 0.018),
        ((-0.004, knee + 0.016, 0.023), (0.008, knee + 0.018, 0.021), 0.02, 0.018),
    ]


def _shank(ankle: float) -> list[tuple[Place, Place, float, float]]:
    return [
        ((0.0, -0.04, -0.02), (0.0, -0.042, 0.022), 0.016, 0.016),  # tibia
        ((0.004, -0.048, -0.002), (0.004, 0.4 * ankle, -0.004), 0.021, 0.0125),
        ((0.004, 0.4 * ankle, -0.004), (0.0, ankle + 0.03, -0.006), 0.0125, 0.0125),
        ((0.0, ankle + 0.032, -0.008), (0.0, ankle + 0.022, -0.002), 0.0165, 0.0165),
        ((0.002, ankle + 0.02, -0.024), (0.004, ankle + 0.004, -0.026), 0.0095, 0.0075),
        ((-0.014, -0.062, 0.034), (-0.014, 0.5 * ankle, 0.032), 0.009, 0.006),  # fibula
        ((-0.014, 0.5 * ankle, 0.032), (-0.01, ankle + 0.02, 0.028), 0.006, 0.0085),
        ((-0.01, ankle + 0.016, 0.028), (-0.006, ankle - 0.01, 0.027), 0.0095, 0.007),
    ]


def _cone(body: str, start: Place, end: Place, first: float, second: float) -> dict[str, Any]:
    return {"body": body, "part": PART, "from": list(start), "to": list(end), "radii": [first, second]}
