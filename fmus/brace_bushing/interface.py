"""Variables of the paper's brace. Plain data."""

from __future__ import annotations

MODEL = "brace_bushing"
DESCRIPTION = "Idealised ankle brace: the anatomical cubic bushing with its angles scaled"

AXES = ("rotation_x", "rotation_y", "rotation_z")


def variables() -> list[dict]:
    parameter = dict(causality="parameter", variability="fixed", unit="1", min=0.0, max=100.0)
    signal = dict(variability="continuous")
    out: list[dict] = [
        dict(name="angle_scale", start=1.0, description="f: scales the angles; 2.4 is the paper's 240 % brace, 1 is as stiff as the anatomy", **parameter),
        dict(name="torque_scale", start=1.0, description="scales the torques", **parameter),
    ]  # fmt: skip
    for axis in AXES:
        out.append(dict(name=f"{axis}_angle", causality="input", unit="rad", start=0.0, description="body-fixed X-Y-Z Euler angle of the calcaneus in the tibia", **signal))  # fmt: skip
    for axis in AXES:
        out.append(dict(name=f"{axis}_torque", causality="output", unit="N.m", description="of the brace on the foot", depends=[f"{axis}_angle"], **signal))  # fmt: skip
    for axis in AXES:
        out.append(dict(name=f"{axis}_stiffness", causality="output", unit="N.m/rad", description="-d(torque)/d(angle)", depends=[f"{axis}_angle"], **signal))  # fmt: skip
    out.append(dict(name="stored_energy", causality="output", unit="J", description="elastic energy; 0 at zero angles", depends=[f"{a}_angle" for a in AXES], **signal))  # fmt: skip
    return out
