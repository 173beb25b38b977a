"""What the FMU shows to the outside: names, units, start values, signs. Plain data.

Units of this exporter: 1, rad, rad/s, m, m/s, s, N, N.m, N.m/rad, N.m.s/rad, J.
"""

from __future__ import annotations

MODEL = "brace_template_python"
DESCRIPTION = "Linear spring and damper about the subtalar axis"

PARAMETERS = (  # name, unit, start, least, greatest, description
    ("stiffness", "N.m/rad", 40.0, 0.0, 10000.0, "k"),
    ("damping", "N.m.s/rad", 0.2, 0.0, 100.0, "c"),
    ("rest_angle", "rad", 0.0, -1.5, 1.5, "angle without torque"),
)
INPUTS = (  # name, unit, description
    ("subtalar_angle", "rad", "0 at the neutral pose, + supination"),
    ("subtalar_velocity", "rad/s", "of the angle"),
)
OUTPUTS = (  # name, unit, description, inputs that change it at once
    ("subtalar_torque", "N.m", "of the brace on the foot", ("subtalar_angle", "subtalar_velocity")),
    ("subtalar_stiffness", "N.m/rad", "-d(torque)/d(angle)", ("subtalar_angle", "subtalar_velocity")),
    ("subtalar_damping", "N.m.s/rad", "-d(torque)/d(velocity)", ("subtalar_angle", "subtalar_velocity")),
)
