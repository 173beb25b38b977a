"""What the FMU shows to the outside: names, units, start values. Plain data.

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
INPUTS = ("subtalar_angle", "rad"), ("subtalar_velocity", "rad/s")
OUTPUTS = ("subtalar_torque", "N.m"), ("subtalar_stiffness", "N.m/rad"), ("subtalar_damping", "N.m.s/rad")


def variables() -> list[dict]:
    out = []
    for name, unit, start, least, greatest, text in PARAMETERS:
        out.append(
            dict(
                name=name,
                causality="parameter",
                variability="fixed",
                unit=unit,
                start=start,
                min=least,
                max=greatest,
                description=text,
            )
        )
    for name, unit in INPUTS:
        out.append(
            dict(
                name=name,
                causality="input",
                variability="continuous",
                unit=unit,
                start=0.0,
                description="0 at the neutral pose, + supination",
            )
        )
    for name, unit in OUTPUTS:
        follows = [n for n, _ in INPUTS]  # the inputs that change it at once
        out.append(
            dict(
                name=name,
                causality="output",
                variability="continuous",
                unit=unit,
                description="of the brace on the foot",
                depends=follows,
            )
        )
    return out
