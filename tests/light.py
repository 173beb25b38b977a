"""A study that costs nothing and gives the same bits everywhere: a plant of polynomials, tests/sources/light.c."""

from __future__ import annotations

from pathlib import Path

from tests.native import compile_fmu

AXES = ("subtalar", "talocrural", "dorsiflexion", "inversion", "internal_rotation")
SIGNALS = {
    **{f"{a}_angle" if a in AXES[:2] else f"jcs_{a}_raw_angle": "rad" for a in AXES},
    **{f"{a}_velocity": "rad/s" for a in AXES},
    **{f"anatomy_{a}_moment": "N.m" for a in AXES},
    "inversion_angle": "rad",
    "ground_force_y": "N",
}
STUDY = """
scenario = "light.toml"
title = "A light plant"
[marginals]
"plant.height" = { normal = { mean = "0.3 m", sd = "0.03 m" } }
[study]
trials = 5
seed = 3
"""


def plant(target: Path, lean: bool = False) -> Path:
    """The FMU of the plant; its parameter is `height` [m], with `lean` a second, added to it."""
    listed = [_variable("height", 0, 'causality="parameter" variability="fixed"', 'unit="m" start="0.3"')]
    for number, (name, unit) in enumerate(SIGNALS.items(), 1):
        listed.append(_variable(name, number, 'causality="output" variability="continuous"', f'unit="{unit}"'))
    outputs = tuple(range(2, len(SIGNALS) + 2))
    if lean:
        kind = 'causality="parameter" variability="fixed"'
        listed.append(_variable("lean", len(SIGNALS) + 1, kind, 'unit="m" start="0"'))
    return compile_fmu(target, "light", "".join(listed), outputs, macros=("-DLEAN",) if lean else ())


def _variable(name: str, reference: int, kind: str, real: str) -> str:
    return f'<ScalarVariable name="{name}" valueReference="{reference}" {kind}><Real {real}/></ScalarVariable>'


def study_file(folder: Path, trials: int = 5) -> Path:
    """light.fmu, light.toml and study.toml in a folder; the study's path."""
    plant(folder / "light.fmu")
    scenario = ('title = "Light"', "[components.plant]", 'fmu = "light.fmu"', "[master]", 'stop = "50 ms"')
    (folder / "light.toml").write_text("\n".join([*scenario, ""]))
    (folder / "study.toml").write_text(STUDY.replace("trials = 5", f"trials = {trials}"))
    return folder / "study.toml"
