"""Spring and damper that act outside a slack; a strap pulls but never pushes (equation: README.md)."""

from .interface import AXES

GROUPS = {kind: [f"{axis}_{kind}" for axis in AXES] for kind in ("angle", "velocity", "torque", "stiffness", "damping")}

EXPERIMENT = {
    "parameters": {
        "talocrural_stiffness_coefficient": 20.0,
        "talocrural_damping_coefficient": 0.2,
        "subtalar_slack": 0.05,
    }
}


def law(k, c, rest, slack, angle, velocity):
    """(torque, stiffness, damping) of one axis."""
    x = angle - rest
    side = 1.0 if x > 0 else -1.0
    stretch = abs(x) - slack
    pull = k * stretch + c * side * velocity
    if slack == 0.0:
        return -k * x - c * velocity, k, c
    if stretch <= 0.0 or pull <= 0.0:
        return 0.0, 0.0, 0.0
    return -side * pull, k, c


def refresh(values):
    values.torque[0], values.stiffness[0], values.damping[0] = law(
        values.talocrural_stiffness_coefficient,
        values.talocrural_damping_coefficient,
        values.talocrural_rest_angle,
        values.talocrural_slack,
        values.angle[0],
        values.velocity[0],
    )
    values.torque[1], values.stiffness[1], values.damping[1] = law(
        values.subtalar_stiffness_coefficient,
        values.subtalar_damping_coefficient,
        values.subtalar_rest_angle,
        values.subtalar_slack,
        values.angle[1],
        values.velocity[1],
    )


def differentiate(values, seed, result):
    for k in range(2):
        result.torque[k] = -values.stiffness[k] * seed.angle[k] - values.damping[k] * seed.velocity[k]
