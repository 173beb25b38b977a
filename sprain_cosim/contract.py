"""The brace contract, version 1.0, as data: profiles, axes, signals. docs/brace-contract.md is its text.

Torque is that of the brace on the foot, so a passive brace beyond its rest angle gives a torque of the opposite sign.
Angles are zero at the model's neutral pose."""

from __future__ import annotations

from functools import lru_cache

from .units import Unit, unit

VERSION = "1.0"
PROFILES = {
    "subtalar": ("subtalar",),
    "anatomic": ("talocrural", "subtalar"),
    "jcs": ("dorsiflexion", "inversion", "internal_rotation"),
    "bushing": ("rotation_x", "rotation_y", "rotation_z"),
}
AXES = tuple(dict.fromkeys(a for axes in PROFILES.values() for a in axes))
RANGE_DEG = {  # physiological range over which outputs must be finite [deg]
    "talocrural": (-50.0, 30.0),
    "subtalar": (-40.0, 60.0),
    "dorsiflexion": (-50.0, 30.0),
    "inversion": (-40.0, 60.0),
    "internal_rotation": (-40.0, 60.0),
    "rotation_x": (-40.0, 60.0),
    "rotation_y": (-40.0, 60.0),
    "rotation_z": (-50.0, 30.0),
}
POSITIVE = {  # what a positive angle looks like
    "talocrural": "toes pulled up",
    "subtalar": "foot rolled outward (supination)",
    "dorsiflexion": "toes pulled up",
    "inversion": "sole turned inward",
    "internal_rotation": "toes turned inward",
    "rotation_x": "sole turned inward",
    "rotation_y": "toes turned inward",
    "rotation_z": "toes pulled up",
}
MAX_VELOCITY_DEG_S = 1000.0
_ANGLE, _VELOCITY, _TORQUE = unit("rad"), unit("rad/s"), unit("N.m")
_STIFFNESS, _DAMPING = unit("N.m/rad"), unit("N.m.s/rad")
INPUTS: dict[str, Unit] = {
    **{f"{a}_angle": _ANGLE for a in AXES},
    **{f"{a}_velocity": _VELOCITY for a in AXES},
    "in_contact": unit("1"),
    "ground_force": unit("N"),
    "evertor_activation": unit("1"),
}
OUTPUTS: dict[str, Unit] = {
    **{f"{a}_torque": _TORQUE for a in AXES},
    **{f"{a}_stiffness": _STIFFNESS for a in AXES},
    **{f"{a}_damping": _DAMPING for a in AXES},
    **{f"{a}_{b}_stiffness": _STIFFNESS for p in PROFILES.values() for a in p for b in p if a != b},
    **{f"{a}_{b}_damping": _DAMPING for p in PROFILES.values() for a in p for b in p if a != b},
    "stored_energy": unit("J"),
    "dissipated_energy": unit("J"),
    "strap_tension": unit("N"),
}

# ---- a brace and the plant, as "component.variable"
PLANT = "plant"
MOTION = {"stiffness": "angle", "damping": "velocity"}  # what each of a brace's impedances multiplies


def torque_input(axis: str) -> str:
    """The plant's input for the brace's torque about `axis` [N.m]."""
    return f"{PLANT}.brace_{axis}_torque"


def torque_axis(connector: str) -> str | None:
    """The axis whose torque_input() this is; None for any other connector."""
    axis = connector.removeprefix(f"{PLANT}.brace_").removesuffix("_torque")
    return axis if connector == torque_input(axis) else None


def impedance_input(axis: str, other: str, kind: str) -> str:
    """The plant's input for -d(torque about `axis`)/d(angle or velocity of `other`) [SI]; `kind` is a key of MOTION."""
    return f"{PLANT}.brace_{axis}_{kind}" if axis == other else f"{PLANT}.brace_{axis}_{other}_{kind}"


def motion_output(axis: str, kind: str) -> str:
    """The plant's output that a brace's stiffness or damping (`kind`) about `axis` multiplies: angle [rad] or velocity
    [rad/s]."""
    return f"{PLANT}.{axis}_{MOTION[kind]}"


def inertia_output(axis: str) -> str:
    """The plant's output for its effective inertia about `axis` [kg.m2]."""
    return f"{PLANT}.{axis}_effective_inertia"


def is_torque(connector: str) -> bool:
    return connector.endswith("_torque")


def is_excitation(connector: str) -> bool:
    """Of a muscle, which the plant takes from a controller."""
    return connector.endswith("_excitation")


def is_impedance(connector: str) -> bool:
    return connector.endswith(tuple(f"_{kind}" for kind in MOTION))


@lru_cache(maxsize=4096)
def plain(name: str) -> str:
    """`.`, `_` and letter case do not count in names."""
    return name.replace("_", "").replace(".", "").lower()


def profile(axes: set[str]) -> str | None:
    """The narrowest profile that has all these axes; None when there is none."""
    return next((p for p, own in PROFILES.items() if axes and axes <= set(own)), None)
