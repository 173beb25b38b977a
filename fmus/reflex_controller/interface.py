"""Variables of the ankle's neuromuscular controller. Plain data."""

from __future__ import annotations

MODEL = "reflex_controller"
DESCRIPTION = "Co-activation of the ankle's evertors and invertors, and their delayed stretch reflex"

EVERTORS = ("ext_dig", "per_brev", "per_long", "per_tert")
INVERTORS = ("ext_hal", "flex_dig", "flex_hal", "tib_post")
MUSCLES = EVERTORS + INVERTORS


def variables() -> list[dict]:
    parameter = dict(causality="parameter", variability="fixed")
    out: list[dict] = [
        dict(name="coactivation", unit="1", start=0.0, min=0.0, max=1.0, description="excitation of the evertors", **parameter),
        dict(name="reflex_gain", unit="1", start=0.0, min=0.0, max=1000.0, description="excitation per stretch velocity", **parameter),
        dict(name="reflex_delay", unit="s", start=0.060, min=0.0, max=10.0, description="from stretch to excitation", **parameter),
        dict(name="invertor_ratio", unit="1", start=0.9322, min=0.0, max=100.0, description="co-activation of the invertors over that of the evertors", **parameter),
    ]  # fmt: skip
    for muscle in MUSCLES:
        out.append(dict(name=f"{muscle}_stretch_velocity", causality="input", variability="continuous", unit="1", start=0.0,
                        description="lengthening speed of the muscle over 10 optimal fibre lengths per second"))  # fmt: skip
    for muscle in MUSCLES:
        out.append(dict(name=f"{muscle}_excitation", causality="output", variability="continuous", unit="1",
                        description="not clamped; mean over the coming communication step"))  # fmt: skip
    return out
