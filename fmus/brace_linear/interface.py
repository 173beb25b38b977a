"""Variables. Plain data."""

from __future__ import annotations

MODEL = "brace_linear"
DESCRIPTION = "Linear spring-damper with rest angle and slack about each anatomic axis"

AXES = ("talocrural", "subtalar")


def variables() -> list[dict]:
    signal = dict(variability="continuous")
    out: list[dict] = []
    out.append(
        dict(
            name="talocrural_stiffness_coefficient",
            causality="parameter",
            variability="fixed",
            unit="N.m/rad",
            start=0.0,
            min=0.0,
            max=10000.0,
            description="k: of the spring outside the slack",
        )
    )
    out.append(
        dict(
            name="talocrural_damping_coefficient",
            causality="parameter",
            variability="fixed",
            unit="N.m.s/rad",
            start=0.0,
            min=0.0,
            max=1000.0,
            description="c: of the damper outside the slack",
        )
    )
    out.append(
        dict(
            name="talocrural_rest_angle",
            causality="parameter",
            variability="fixed",
            unit="rad",
            start=0.0,
            min=-1.0,
            max=1.0,
            description="middle of the slack",
        )
    )
    out.append(
        dict(
            name="talocrural_slack",
            causality="parameter",
            variability="fixed",
            unit="rad",
            start=0.0,
            min=0.0,
            max=1.0,
            description="half the play: no torque within rest_angle -+ slack",
        )
    )
    out.append(
        dict(
            name="subtalar_stiffness_coefficient",
            causality="parameter",
            variability="fixed",
            unit="N.m/rad",
            start=30.0,
            min=0.0,
            max=10000.0,
            description="k: of the spring outside the slack",
        )
    )
    out.append(
        dict(
            name="subtalar_damping_coefficient",
            causality="parameter",
            variability="fixed",
            unit="N.m.s/rad",
            start=0.3,
            min=0.0,
            max=1000.0,
            description="c: of the damper outside the slack",
        )
    )
    out.append(
        dict(
            name="subtalar_rest_angle",
            causality="parameter",
            variability="fixed",
            unit="rad",
            start=0.0,
            min=-1.0,
            max=1.0,
            description="middle of the slack",
        )
    )
    out.append(
        dict(
            name="subtalar_slack",
            causality="parameter",
            variability="fixed",
            unit="rad",
            start=0.0,
            min=0.0,
            max=1.0,
            description="half the play: no torque within rest_angle -+ slack",
        )
    )
    for axis in AXES:
        out.append(
            dict(
                name=f"{axis}_angle",
                causality="input",
                unit="rad",
                start=0.0,
                description="zero at the neutral pose",
                **signal,
            )
        )
    for axis in AXES:
        out.append(
            dict(
                name=f"{axis}_velocity",
                causality="input",
                unit="rad/s",
                start=0.0,
                description="of the angle",
                **signal,
            )
        )
    for kind, unit, text in (
        ("torque", "N.m", "of the brace on the foot"),
        ("stiffness", "N.m/rad", "-d(torque)/d(angle)"),
        ("damping", "N.m.s/rad", "-d(torque)/d(velocity)"),
    ):
        for axis in AXES:
            out.append(
                dict(
                    name=f"{axis}_{kind}",
                    causality="output",
                    unit=unit,
                    description=text,
                    depends=[f"{axis}_angle", f"{axis}_velocity"],
                    **signal,
                )
            )
    return out
