"""What the FMU shows to the outside: names, units, start values, signs. Plain data."""

from __future__ import annotations

MODEL = "brace_linear"
DESCRIPTION = "Linear spring-damper with rest angle and slack about each anatomic axis"

AXES = ("talocrural", "subtalar")

PARAMETERS = (  # name, unit, start, least, greatest, description
    ("talocrural_stiffness_coefficient", "N.m/rad", 0.0, 0.0, 10000.0, "k: of the spring outside the slack"),
    ("talocrural_damping_coefficient", "N.m.s/rad", 0.0, 0.0, 1000.0, "c: of the damper outside the slack"),
    ("talocrural_rest_angle", "rad", 0.0, -1.0, 1.0, "middle of the slack"),
    ("talocrural_slack", "rad", 0.0, 0.0, 1.0, "half the play: no torque within rest_angle -+ slack"),
    ("subtalar_stiffness_coefficient", "N.m/rad", 30.0, 0.0, 10000.0, "k: of the spring outside the slack"),
    ("subtalar_damping_coefficient", "N.m.s/rad", 0.3, 0.0, 1000.0, "c: of the damper outside the slack"),
    ("subtalar_rest_angle", "rad", 0.0, -1.0, 1.0, "middle of the slack"),
    ("subtalar_slack", "rad", 0.0, 0.0, 1.0, "half the play: no torque within rest_angle -+ slack"),
)
INPUTS = (  # name, unit, description
    ("talocrural_angle", "rad", "zero at the neutral pose"),
    ("subtalar_angle", "rad", "zero at the neutral pose"),
    ("talocrural_velocity", "rad/s", "of the angle"),
    ("subtalar_velocity", "rad/s", "of the angle"),
)
OUTPUTS = (  # name, unit, description, inputs that change it at once
    ("talocrural_torque", "N.m", "of the brace on the foot", ("talocrural_angle", "talocrural_velocity")),
    ("subtalar_torque", "N.m", "of the brace on the foot", ("subtalar_angle", "subtalar_velocity")),
    ("talocrural_stiffness", "N.m/rad", "-d(torque)/d(angle)", ("talocrural_angle", "talocrural_velocity")),
    ("subtalar_stiffness", "N.m/rad", "-d(torque)/d(angle)", ("subtalar_angle", "subtalar_velocity")),
    ("talocrural_damping", "N.m.s/rad", "-d(torque)/d(velocity)", ("talocrural_angle", "talocrural_velocity")),
    ("subtalar_damping", "N.m.s/rad", "-d(torque)/d(velocity)", ("subtalar_angle", "subtalar_velocity")),
)
