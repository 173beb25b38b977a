"""What the FMU shows to the outside: names, units, start values, signs. Plain data."""

from __future__ import annotations

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
