"""Makes the plant's drawing (fmus/plant/extra/sprain-cosim/skeleton.json) from the model's tables: the tree of the
bodies that move or carry something, so that a pose follows from the 15 coordinates and a person's factors, and round
volumes carried by them. Joints and the sole
are the model's own; the thickness of limbs and trunk is drawn by eye. Run: python tools/make_skeleton.py"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT))

from fmus.plant.constants import PLATFORM_PIVOT, segment  # noqa: E402
from fmus.plant.interface import SEGMENTS  # noqa: E402
from fmus.plant.model import Movement, load_bodies, load_movements, rotation, table, vector  # noqa: E402

TARGET = ROOT / "fmus" / "plant" / "extra" / "sprain-cosim" / "skeleton.json"
ANGLES = np.radians(np.arange(-120.0, 11.0, 1.0))  # the knee's translations are linear between these, within 0.01 mm
SLICE, THICKNESS = 0.008, 0.011  # m, of the sole

# body of the table, part, then from and to in its frame [m] with the radius at each
VOLUMES: list[tuple[str, str, list[float], float, list[float], float]] = [
    ("pelvis", "shorts", [-0.078, -0.025, -0.062], 0.100, [-0.078, -0.025, 0.062], 0.100),
    ("pelvis", "shorts", [-0.085, 0.02, -0.05], 0.102, [-0.085, 0.02, 0.05], 0.102),
    *(("torso", "shirt", [0.012, -0.05, 0.4 * z], 0.098, [-0.02, 0.27, z], 0.098) for z in (-0.085, 0.085)),
    *(
        ("torso", "shirt", [0.012, -0.05, 0.4 * z], 0.100, [-0.018, 0.30, z], 0.100)
        for z in (-0.056, -0.028, 0.0, 0.028, 0.056)
    ),
    ("torso", "shirt", [-0.022, 0.27, -0.10], 0.092, [-0.022, 0.27, 0.10], 0.092),
    *(("torso", "shirt", [-0.02, 0.30, 0.10 * z], 0.080, [-0.004, 0.372, 0.155 * z], 0.056) for z in (-1.0, 1.0)),
    *(("torso", "shirt", [-0.02, 0.385, 0.0], 0.060, [-0.004, 0.372, 0.155 * z], 0.054) for z in (-1.0, 1.0)),
    ("torso", "shirt", [-0.018, 0.30, 0.0], 0.100, [-0.01, 0.41, 0.0], 0.055),
    *((f"humerus_{s}", "shirt", [0.0, -0.005, 0.0], 0.053, [0.006, -0.12, 0.0], 0.051) for s in "rl"),
    *((f"femur_{s}", "shorts", [0.0, -0.02, 0.0], 0.088, [0.0, -0.17, 0.0], 0.082) for s in "rl"),
    ("torso", "skin", [-0.005, 0.40, 0.0], 0.052, [0.02, 0.52, 0.0], 0.048),
    ("torso", "skin", [0.02, 0.59, 0.0], 0.086, [0.035, 0.63, 0.0], 0.090),
    ("torso", "skin", [0.04, 0.545, 0.0], 0.060, [0.07, 0.56, 0.0], 0.050),
    *((f"humerus_{s}", "skin", [0.0, -0.02, 0.0], 0.046, [0.014, -0.31, 0.0], 0.036) for s in "rl"),
    *((f"radius_{s}", "skin", [0.0, 0.0, 0.0], 0.037, [-0.0096, -0.2576, 0.0], 0.025) for s in "rl"),
    *((f"hand_{s}", "skin", [0.0, -0.01, 0.0], 0.028, [0.01, -0.13, 0.0], 0.020) for s in "rl"),
    *((f"femur_{s}", "skin", [0.0, -0.06, 0.0], 0.080, [0.0, -0.40, 0.0], 0.054) for s in "rl"),
    *((f"femur_{s}", "skin", [0.0, -0.40, 0.0], 0.054, [0.005, -0.445, 0.0], 0.053) for s in "rl"),
    *((f"tibia_{s}", "skin", [0.0, -0.03, 0.0], 0.052, [-0.012, -0.14, 0.0], 0.056) for s in "rl"),
    *((f"tibia_{s}", "skin", [-0.012, -0.14, 0.0], 0.056, [-0.004, -0.33, 0.0], 0.038) for s in "rl"),
    *((f"tibia_{s}", "skin", [-0.004, -0.33, 0.0], 0.038, [0.0, -0.455, 0.0], 0.034) for s in "rl"),
    ("calcn_r", "foot", [0.020, 0.020, -0.002], 0.027, [0.042, 0.046, -0.004], 0.034),
    ("calcn_r", "foot", [0.018, 0.030, -0.002], 0.027, [0.030, 0.066, -0.006], 0.022),
    ("calcn_r", "foot", [0.042, 0.046, -0.006], 0.033, [0.135, 0.024, -0.008], 0.024),
    ("calcn_r", "foot", [0.042, 0.036, 0.002], 0.030, [0.135, 0.020, 0.008], 0.022),
    ("calcn_r", "foot", [0.020, 0.018, -0.004], 0.026, [0.19, 0.010, -0.022], 0.018),
    ("calcn_r", "foot", [0.020, 0.014, 0.004], 0.024, [0.18, 0.010, 0.028], 0.017),
    ("calcn_r", "foot", [0.135, 0.022, 0.0], 0.024, [0.20, 0.010, 0.004], 0.016),
    ("tibia_r", "brace", [-0.005, -0.335, 0.0], 0.0435, [0.0, -0.425, 0.0], 0.0405),
    ("calcn_r", "brace", [0.020, 0.018, -0.002], 0.030, [0.050, 0.026, -0.004], 0.035),
    ("calcn_r", "brace", [0.085, 0.028, -0.006], 0.034, [0.105, 0.024, -0.006], 0.033),
    ("calcn_l", "foot", [0.015, 0.018, 0.0], 0.028, [0.06, 0.046, 0.006], 0.034),
    ("calcn_l", "foot", [0.06, 0.046, 0.006], 0.032, [0.17, 0.008, 0.006], 0.020),
    ("calcn_l", "foot", [0.02, 0.006, 0.0], 0.020, [0.17, 0.004, 0.018], 0.018),
    ("calcn_l", "foot", [0.06, 0.008, -0.01], 0.018, [0.17, 0.004, -0.018], 0.018),
    ("toes_l", "foot", [0.0, 0.006, 0.016], 0.017, [0.045, 0.004, 0.014], 0.012),
    ("toes_l", "foot", [0.0, 0.006, -0.018], 0.017, [0.055, 0.004, -0.014], 0.012),
]
KNEE, ANKLE = ("tibia_r", [0.0, -0.02, 0.0]), ("talus_r", [0.0, 0.0, 0.0])


def sole() -> list[tuple[str, str, list[float], float, list[float], float]]:
    """Capsules across the foot, one per slice, that touch the model's own sole from inside."""
    facets = np.array([[float(row[c]) for c in ("x_m", "y_m", "z_m")] for row in table("sole")])
    out = []
    for low in np.arange(facets[:, 0].min(), facets[:, 0].max(), SLICE):
        inside = facets[(facets[:, 0] >= low) & (facets[:, 0] < low + SLICE)]
        if len(inside) < 4:
            continue
        x, left, right = low + SLICE / 2, inside[:, 2].min(), inside[:, 2].max()
        radius = min(THICKNESS, (right - left) / 2)
        ends = []
        for z in (left + radius, right - radius):
            near = inside[np.abs(inside[:, 2] - z) < radius]
            height = float(np.quantile(near[:, 1], 0.1) if len(near) else inside[:, 1].min())
            ends.append([x, height + radius, z])
        out.append(("calcn_r", "sole", ends[0], radius, ends[1], radius))
    return out


def rounded(values: Any) -> Any:
    return np.round(np.asarray(values, float), 6).tolist()


def joint(movements: list[Movement]) -> dict[str, Any]:
    """How a body moves in its parent; a locked joint is a place and a turn."""
    if any(m.free for m in movements):
        return {
            "movements": [
                {"motion": m.motion, "axis": list(map(float, m.axis)), "coordinate": m.coordinate}
                | ({"values": [rounded(ANGLES), rounded([m.at(float(a)) for a in ANGLES])]} if m.spline else {})
                for m in movements
            ]
        }
    shift, turn = np.zeros(3), np.eye(3)
    for m in movements:
        if m.motion == "translation":
            shift = shift + m.at(m.value) * m.axis
        else:
            turn = turn @ rotation(m.axis, m.at(m.value))
    return {"movements": [], "shift": shift.tolist(), "turn": turn.tolist()}


def drawing() -> dict[str, Any]:
    movements = load_movements()
    every = {body.name: body for body in load_bodies()}
    carrying = {body for body, *_ in VOLUMES}
    for body in reversed(every.values()):  # children before their parents
        if body.name in carrying or any(m.free for m in movements if m.body == body.name):
            carrying.add(body.parent)
    moving = {m.body for m in movements if m.free} - {"patella_r"}  # carries nothing that is drawn
    bodies = [
        {
            "name": body.name,
            "parent": body.parent,
            "segment": segment(body.name),
            "at_parent": list(map(float, body.at_parent)),
            "at_child": list(map(float, body.at_child)),
            **joint([m for m in movements if m.body == body.name]),
        }
        for body in every.values()
        if body.name in carrying | moving
    ]
    volumes = [
        {
            "body": body,
            "part": "left " + part if body.endswith("_l") else part,
            "from": rounded(start),
            "to": rounded(end),
            "radii": rounded([r_start, r_end]),
        }
        for body, part, start, r_start, end, r_end in [*VOLUMES, *sole()]
    ]
    axis = next(vector(row, "axis", "") for row in table("joints") if row["body"] == "calcn_r")
    return {
        "unit": "m and rad; X anterior, Y up, Z right",
        "bodies": bodies,
        "volumes": volumes,
        "points": {
            "knee": dict(zip(("body", "at"), KNEE, strict=True)),
            "ankle": dict(zip(("body", "at"), ANKLE, strict=True)),
        },
        "factors": {name: [f"{name}_scale_{axis}" for axis in "xyz"] for name in SEGMENTS},
        "subtalar_axis": {"body": "calcn_r", "axis": rounded(axis / np.linalg.norm(axis))},
        "platform": {"pivot": list(PLATFORM_PIVOT), "incline": "platform_incline"},
    }


if __name__ == "__main__":
    TARGET.parent.mkdir(parents=True, exist_ok=True)
    text = json.dumps(drawing(), indent=1)
    import re

    text = re.sub(r"\[\s+([^\[\]{}]+?)\s+\]", lambda m: "[" + re.sub(r"\s+", " ", m.group(1)) + "]", text)
    TARGET.write_text(text + "\n", "utf-8")
    print(f"{TARGET}: {TARGET.stat().st_size} bytes")
