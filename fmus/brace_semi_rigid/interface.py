"""What the FMU shows to the outside: names, units, start values, signs. Plain data."""

from __future__ import annotations

MODEL = "brace_semi_rigid"
DESCRIPTION = "Semi-rigid shell: soft liner between hard stops about the subtalar axis, free talocrural hinge"

AXES = ("subtalar",)

PARAMETERS = (  # name, unit, start, least, greatest, description
    ("liner_stiffness", "N.m/rad", 8.0, 0.0, 10000.0, "k: of the liner between the stops"),
    ("stop_stiffness", "N.m/rad", 300.0, 0.0, 100000.0, "K: of the shell beyond a stop"),
    ("damping_coefficient", "N.m.s/rad", 0.2, 0.0, 1000.0, "c"),
    ("inversion_stop", "rad", 0.2617993877991494, 0.0, 1.5, "angle of the outer stop (15 deg)"),
    ("eversion_stop", "rad", 0.2617993877991494, 0.0, 1.5, "angle of the inner stop, counted positive (15 deg)"),
    ("transition", "rad", 0.03490658503988659, 0.001, 0.5, "w: over which a stop comes in (2 deg)"),
)
INPUTS = (  # name, unit, description
    ("subtalar_angle", "rad", "zero at the neutral pose"),
    ("subtalar_velocity", "rad/s", "of the angle"),
)
OUTPUTS = (  # name, unit, description, inputs that change it at once
    ("subtalar_torque", "N.m", "of the brace on the foot", ("subtalar_angle", "subtalar_velocity")),
    ("subtalar_stiffness", "N.m/rad", "-d(torque)/d(angle)", ("subtalar_angle", "subtalar_velocity")),
    ("subtalar_damping", "N.m.s/rad", "-d(torque)/d(velocity)", ("subtalar_angle", "subtalar_velocity")),
    ("stored_energy", "J", "elastic energy", ("subtalar_angle",)),
)
