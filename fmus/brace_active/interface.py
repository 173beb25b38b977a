"""Variables. Plain data."""

from __future__ import annotations

MODEL = "brace_active"
DESCRIPTION = "Tightens when the foot rolls out too far and too fast; actuator with lag and torque limit"

AXES = ("subtalar",)


def variables() -> list[dict]:
    signal = dict(variability="continuous")
    out: list[dict] = []
    out.append(
        dict(
            name="angle_threshold",
            causality="parameter",
            variability="fixed",
            unit="rad",
            start=0.17453292519943295,
            min=-1.0,
            max=1.5,
            description="tightens beyond this angle (10 deg) ...",
        )
    )
    out.append(
        dict(
            name="velocity_threshold",
            causality="parameter",
            variability="fixed",
            unit="rad/s",
            start=3.490658503988659,
            min=0.0,
            max=100.0,
            description="... when faster than this (200 deg/s)",
        )
    )
    out.append(
        dict(
            name="gain",
            causality="parameter",
            variability="fixed",
            unit="N.m/rad",
            start=150.0,
            min=0.0,
            max=10000.0,
            description="g: commanded torque per angle beyond the threshold",
        )
    )
    out.append(
        dict(
            name="damping_gain",
            causality="parameter",
            variability="fixed",
            unit="N.m.s/rad",
            start=1.0,
            min=0.0,
            max=1000.0,
            description="d: commanded torque per velocity",
        )
    )
    out.append(
        dict(
            name="torque_limit",
            causality="parameter",
            variability="fixed",
            unit="N.m",
            start=25.0,
            min=0.0,
            max=1000.0,
            description="most that the actuator gives",
        )
    )
    out.append(
        dict(
            name="lag",
            causality="parameter",
            variability="fixed",
            unit="s",
            start=0.008,
            min=0.0001,
            max=1.0,
            description="time constant of the actuator",
        )
    )
    out.append(
        dict(
            name="passive_stiffness",
            causality="parameter",
            variability="fixed",
            unit="N.m/rad",
            start=5.0,
            min=0.0,
            max=10000.0,
            description="k: of the strap at rest",
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
    out.append(
        dict(
            name="strap_tension",
            causality="output",
            unit="N",
            description="actuator torque over a lever of 40 mm",
            depends=[],
            **signal,
        )
    )
    return out
