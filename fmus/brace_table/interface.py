"""What the FMU shows to the outside: names, units, start values, signs. Plain data."""

from __future__ import annotations

MODEL = "brace_table"
DESCRIPTION = "Measured torque-angle curves, loading and unloading, read from the FMU's resources"

AXES = ("talocrural", "subtalar")

PARAMETERS = (  # name, unit, start, least, greatest, description
    ("torque_scale", "1", 1.0, 0.0, 100.0, "scales all torques"),
    (
        "turn",
        "rad",
        0.03490658503988659,
        0.0001,
        1.0,
        "angle over which the torque goes from one branch to the other (2 deg)",
    ),
)
INPUTS = (  # name, unit, description
    ("talocrural_angle", "rad", "zero at the neutral pose"),
    ("subtalar_angle", "rad", "zero at the neutral pose"),
)
OUTPUTS = (  # name, unit, description, inputs that change it at once
    ("talocrural_torque", "N.m", "of the brace on the foot", ("talocrural_angle",)),
    ("subtalar_torque", "N.m", "of the brace on the foot", ("subtalar_angle",)),
    ("talocrural_stiffness", "N.m/rad", "-d(torque)/d(angle)", ("talocrural_angle",)),
    ("subtalar_stiffness", "N.m/rad", "-d(torque)/d(angle)", ("subtalar_angle",)),
)
