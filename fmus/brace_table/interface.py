"""Variables. Plain data."""

from __future__ import annotations

MODEL = "brace_table"
DESCRIPTION = "Measured torque-angle curves, loading and unloading, read from resources/table.json"

AXES = ("talocrural", "subtalar")


def variables() -> list[dict]:
    signal = dict(variability="continuous")
    out: list[dict] = [
        dict(
            name="torque_scale",
            causality="parameter",
            variability="fixed",
            unit="1",
            start=1.0,
            min=0.0,
            max=100.0,
            description="scales all torques",
        ),
        dict(
            name="turn",
            causality="parameter",
            variability="fixed",
            unit="rad",
            start=0.03490658503988659,
            min=1e-4,
            max=1.0,
            description="angle over which the torque goes from one branch to the other (2 deg)",
        ),
    ]
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
    for kind, unit, text in (
        ("torque", "N.m", "of the brace on the foot"),
        ("stiffness", "N.m/rad", "-d(torque)/d(angle)"),
    ):
        for axis in AXES:
            out.append(
                dict(
                    name=f"{axis}_{kind}",
                    causality="output",
                    unit=unit,
                    description=text,
                    depends=[f"{axis}_angle"],
                    **signal,
                )
            )
    return out
