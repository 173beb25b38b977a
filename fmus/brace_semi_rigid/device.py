"""Liner and two smooth stops (equation: README.md)."""

import math


def ramp(x):
    """A ramp with a rounded corner: 0 for x < -1, x for x > 1, (x + 1)^2 / 4 between; its slope and its integral."""
    if x <= -1.0:
        return 0.0, 0.0, 0.0
    if x >= 1.0:
        return x, 1.0, (x * x - 1.0) / 2 + 2.0 / 3.0
    return (x + 1.0) ** 2 / 4, (x + 1.0) / 2, math.pow(x + 1.0, 3) / 12


def refresh(values):
    k, stop, c, w = values.liner_stiffness, values.stop_stiffness, values.damping_coefficient, values.transition
    angle, velocity = values.subtalar_angle, values.subtalar_velocity
    over, slope_over, energy_over = ramp((angle - values.inversion_stop) / w)
    under, slope_under, energy_under = ramp((-angle - values.eversion_stop) / w)
    values.subtalar_torque = -k * angle - stop * w * (over - under) - c * velocity
    values.subtalar_stiffness, values.subtalar_damping = k + stop * (slope_over + slope_under), c
    values.stored_energy = 0.5 * k * angle * angle + stop * w * w * (energy_over + energy_under)


def curvature(x):
    """Second derivative of the ramp."""
    return 0.5 if -1.0 < x < 1.0 else 0.0


def differentiate(values, seed, result):
    k, c, w, angle = values.subtalar_stiffness, values.subtalar_damping, values.transition, values.subtalar_angle
    result.subtalar_torque = -k * seed.subtalar_angle - c * seed.subtalar_velocity
    over, under = curvature((angle - values.inversion_stop) / w), curvature((-angle - values.eversion_stop) / w)
    result.subtalar_stiffness = values.stop_stiffness / w * (over - under) * seed.subtalar_angle
    conservative = values.subtalar_torque + c * values.subtalar_velocity
    result.stored_energy = -conservative * seed.subtalar_angle
