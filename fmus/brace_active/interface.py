"""What the FMU shows to the outside: names, units, start values, signs. Plain data."""

from __future__ import annotations

MODEL = "brace_active"
DESCRIPTION = "Tightens when the foot rolls out too far and too fast; actuator with lag and torque limit"

AXES = ("subtalar",)

PARAMETERS = (  # name, unit, start, least, greatest, description
    ("angle_threshold", "rad", 0.17453292519943295, -1.0, 1.5, "tightens beyond this angle (10 deg) ..."),
    ("velocity_threshold", "rad/s", 3.490658503988659, 0.0, 100.0, "... when faster than this (200 deg/s)"),
    ("gain", "N.m/rad", 150.0, 0.0, 10000.0, "g: commanded torque per angle beyond the threshold"),
    ("damping_gain", "N.m.s/rad", 1.0, 0.0, 1000.0, "d: commanded torque per velocity"),
    ("torque_limit", "N.m", 25.0, 0.0, 1000.0, "most that the actuator gives"),
    ("lag", "s", 0.008, 0.0001, 1.0, "time constant of the actuator"),
    ("passive_stiffness", "N.m/rad", 5.0, 0.0, 10000.0, "k: of the strap at rest"),
)
INPUTS = (  # name, unit, description
    ("subtalar_angle", "rad", "zero at the neutral pose"),
    ("subtalar_velocity", "rad/s", "of the angle"),
)
OUTPUTS = (  # name, unit, description, inputs that change it at once
    ("subtalar_torque", "N.m", "of the brace on the foot", ("subtalar_angle", "subtalar_velocity")),
    ("subtalar_stiffness", "N.m/rad", "-d(torque)/d(angle)", ("subtalar_angle", "subtalar_velocity")),
    ("subtalar_damping", "N.m.s/rad", "-d(torque)/d(velocity)", ("subtalar_angle", "subtalar_velocity")),
    ("strap_tension", "N", "actuator torque over a lever of 40 mm", ()),
)
