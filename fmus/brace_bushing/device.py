"""Torque -s P(f t) about each Euler axis, P the cubic polynomials of the passive ankle (source: README.md)."""

from .interface import AXES

# N.m of the angle in rad: linear, quadratic, cubic
POLYNOMIALS = (
    (9.52095038, -29.57608094, 169.01588105),
    (3.61796125, -10.1612135, 64.5279144),
    (5.98187224, 15.74951827, 33.6780792),
)
GROUPS = {kind: [f"{axis}_{kind}" for axis in AXES] for kind in ("angle", "torque", "stiffness")}


def refresh(values):
    f, s = values.angle_scale, values.torque_scale
    energy = 0.0
    for k in range(3):
        a, b, c = POLYNOMIALS[k]
        t = values.angle[k]
        x = f * t
        values.torque[k] = -s * x * (a + x * (b + x * c))
        values.stiffness[k] = s * f * (a + x * (2 * b + x * 3 * c))
        energy += s * t * x * (a / 2 + x * (b / 3 + x * c / 4))
    values.stored_energy = energy


def differentiate(values, seed, result):
    f, s = values.angle_scale, values.torque_scale
    for k in range(3):
        _, b, c = POLYNOMIALS[k]
        result.torque[k] = -values.stiffness[k] * seed.angle[k]
        result.stiffness[k] = s * f * f * (2 * b + 6 * f * values.angle[k] * c) * seed.angle[k]
        result.stored_energy -= values.torque[k] * seed.angle[k]
