"""Variables. Plain data."""

from __future__ import annotations

MODEL = "brace_rate_dependent"
DESCRIPTION = "Stiffens with velocity: soft in ordinary motion, stiff in a fast roll"

AXES = ("subtalar",)


def variables() -> list[dict]:
    signal = dict(variability="continuous")
    out: list[dict] = []
    out.append(
        dict(
            name="slow_stiffness",
            causality="parameter",
            variability="fixed",
            unit="N.m/rad",
            start=10.0,
            min=0.0,
            max=10000.0,
            description="k0: of slow motion",
        )
    )
    out.append(
        dict(
            name="fast_stiffness",
            causality="parameter",
            variability="fixed",
            unit="N.m/rad",
            start=120.0,
            min=0.0,
            max=100000.0,
            description="k1: of fast motion",
        )
    )
    out.append(
        dict(
            name="damping_coefficient",
            causality="parameter",
            variability="fixed",
            unit="N.m.s/rad",
            start=0.1,
            min=0.0,
            max=1000.0,
            description="c",
        )
    )
    out.append(
        dict(
            name="transition_velocity",
            causality="parameter",
            variability="fixed",
            unit="rad/s",
            start=5.235987755982989,
            min=0.1,
            max=100.0,
            description="v at which half the stiffening is reached (300 deg/s)",
        )
    )
    out.append(
        dict(
            name="exponent",
            causality="parameter",
            variability="fixed",
            unit="1",
            start=4.0,
            min=1.0,
            max=20.0,
            description="p: sharpness of the transition",
        )
    )
    out.append(
        dict(
            name="lag",
            causality="parameter",
            variability="fixed",
            unit="s",
            start=0.003,
            min=0.0,
            max=1.0,
            description="time constant of stiffening",
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
            name="activation",
            causality="output",
            unit="1",
            description="0 soft, 1 stiff",
            depends=["subtalar_velocity"],
            **signal,
        )
    )
    return out
