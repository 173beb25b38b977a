"""What the FMU shows to the outside: names, units, start values, signs. Plain data."""

from __future__ import annotations

from typing import Any

MODEL = "brace_bushing"
DESCRIPTION = "Idealised ankle brace: the anatomical cubic bushing with its angles scaled"

AXES = ("rotation_x", "rotation_y", "rotation_z")

PARAMETERS = (  # name, unit, start, least, greatest, description
    (
        "angle_scale",
        "1",
        1.0,
        0.0,
        100.0,
        "f: scales the angles; 2.4 is the paper's 240 % brace, 1 is as stiff as the anatomy",
    ),
    ("torque_scale", "1", 1.0, 0.0, 100.0, "scales the torques"),
)
INPUTS = (  # name, unit, description
    ("rotation_x_angle", "rad", "body-fixed X-Y-Z Euler angle of the calcaneus in the tibia"),
    ("rotation_y_angle", "rad", "body-fixed X-Y-Z Euler angle of the calcaneus in the tibia"),
    ("rotation_z_angle", "rad", "body-fixed X-Y-Z Euler angle of the calcaneus in the tibia"),
)
OUTPUTS = (  # name, unit, description, inputs that change it at once
    ("rotation_x_torque", "N.m", "of the brace on the foot", ("rotation_x_angle",)),
    ("rotation_y_torque", "N.m", "of the brace on the foot", ("rotation_y_angle",)),
    ("rotation_z_torque", "N.m", "of the brace on the foot", ("rotation_z_angle",)),
    ("rotation_x_stiffness", "N.m/rad", "-d(torque)/d(angle)", ("rotation_x_angle",)),
    ("rotation_y_stiffness", "N.m/rad", "-d(torque)/d(angle)", ("rotation_y_angle",)),
    ("rotation_z_stiffness", "N.m/rad", "-d(torque)/d(angle)", ("rotation_z_angle",)),
    (
        "stored_energy",
        "J",
        "elastic energy; 0 at zero angles",
        ("rotation_x_angle", "rotation_y_angle", "rotation_z_angle"),
    ),
)


def variables() -> list[dict[str, Any]]:
    """The rows of the three tables, in the order of their value references."""
    out: list[dict[str, Any]] = []
    for name, unit, start, least, greatest, text in PARAMETERS:
        out.append(dict(name=name, causality="parameter", unit=unit, description=text))
        out[-1].update(variability="fixed", start=start, min=least, max=greatest)
    for name, unit, text in INPUTS:
        out.append(dict(name=name, causality="input", unit=unit, description=text))
        out[-1].update(variability="continuous", start=0.0)
    for name, unit, text, depends in OUTPUTS:
        out.append(dict(name=name, causality="output", unit=unit, description=text))
        out[-1].update(variability="continuous", depends=list(depends))
    return out
