"""Variables. Plain data."""

from __future__ import annotations

MODEL = "brace_semi_rigid"
DESCRIPTION = "Semi-rigid shell: soft liner between hard stops about the subtalar axis, free talocrural hinge"

AXES = ("subtalar",)


def variables() -> list[dict]:
    signal = dict(variability="continuous")
    out: list[dict] = []
    out.append(
        dict(
            name="liner_stiffness",
            causality="parameter",
            variability="fixed",
            unit="N.m/rad",
            start=8.0,
            min=0.0,
            max=10000.0,
            description="k: of the liner between the stops",
        )
    )
    out.append(
        dict(
            name="stop_stiffness",
            causality="parameter",
            variability="fixed",
            unit="N.m/rad",
            start=300.0,
            min=0.0,
            max=100000.0,
            description="K: of the shell beyond a stop",
        )
    )
    out.append(
        dict(
            name="damping_coefficient",
            causality="parameter",
            variability="fixed",
            unit="N.m.s/rad",
            start=0.2,
            min=0.0,
            max=1000.0,
            description="c",
        )
    )
    out.append(
        dict(
            name="inversion_stop",
            causality="parameter",
            variability="fixed",
            unit="rad",
            start=0.2617993877991494,
            min=0.0,
            max=1.5,
            description="angle of the outer stop (15 deg)",
        )
    )
    out.append(
        dict(
            name="eversion_stop",
            causality="parameter",
            variability="fixed",
            unit="rad",
            start=0.2617993877991494,
            min=0.0,
            max=1.5,
            description="angle of the inner stop, counted positive (15 deg)",
        )
    )
    out.append(
        dict(
            name="transition",
            causality="parameter",
            variability="fixed",
            unit="rad",
            start=0.03490658503988659,
            min=0.001,
            max=0.5,
            description="w: over which a stop comes in (2 deg)",
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
            name="stored_energy",
            causality="output",
            unit="J",
            description="elastic energy",
            depends=["subtalar_angle"],
            **signal,
        )
    )
    return out
