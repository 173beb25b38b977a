"""What the FMU shows to the outside: names, units, start values, signs. Plain data."""

from __future__ import annotations

from typing import Any

MODEL = "brace_table"
DESCRIPTION = "Measured torque-angle curves, loading and unloading, read from resources/table.json"

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
