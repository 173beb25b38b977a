"""What the FMU shows to the outside: names, units, start values, signs. Plain data."""

from __future__ import annotations

MODEL = "brace_rate_dependent"
DESCRIPTION = "Stiffens with velocity: soft in ordinary motion, stiff in a fast roll"

AXES = ("subtalar",)

PARAMETERS = (  # name, unit, start, least, greatest, description
    ("slow_stiffness", "N.m/rad", 10.0, 0.0, 10000.0, "k0: of slow motion"),
    ("fast_stiffness", "N.m/rad", 120.0, 0.0, 100000.0, "k1: of fast motion"),
    ("damping_coefficient", "N.m.s/rad", 0.1, 0.0, 1000.0, "c"),
    (
        "transition_velocity",
        "rad/s",
        5.235987755982989,
        0.1,
        100.0,
        "v at which half the stiffening is reached (300 deg/s)",
    ),
    ("exponent", "1", 4.0, 1.0, 20.0, "p: sharpness of the transition"),
    ("lag", "s", 0.003, 0.0, 1.0, "time constant of stiffening"),
)
INPUTS = (  # name, unit, description
    ("subtalar_angle", "rad", "zero at the neutral pose"),
    ("subtalar_velocity", "rad/s", "of the angle"),
)
OUTPUTS = (  # name, unit, description, inputs that change it at once
    ("subtalar_torque", "N.m", "of the brace on the foot", ("subtalar_angle", "subtalar_velocity")),
    ("subtalar_stiffness", "N.m/rad", "-d(torque)/d(angle)", ("subtalar_angle", "subtalar_velocity")),
    ("subtalar_damping", "N.m.s/rad", "-d(torque)/d(velocity)", ("subtalar_angle", "subtalar_velocity")),
    ("activation", "1", "0 soft, 1 stiff", ("subtalar_velocity",)),
)
