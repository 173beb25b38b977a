"""Stiffness between a slow and a fast value, by velocity, with a lag (equation: README.md)."""

import math

STATE = {"activation": 0.0}


def target(values):
    ratio = (abs(values.subtalar_velocity) / values.transition_velocity) ** values.exponent
    return ratio / (1.0 + ratio)


def initialise(values, state):
    state.activation = target(values)
    refresh(values, state)


def step(values, state, step):
    reached = target(values)
    rest = math.exp(-step / values.lag) if values.lag > 0.0 else 0.0
    state.activation = reached + (state.activation - reached) * rest
    refresh(values, state)


def refresh(values, state):
    k = values.slow_stiffness + state.activation * (values.fast_stiffness - values.slow_stiffness)
    c = values.damping_coefficient
    values.subtalar_torque = -k * values.subtalar_angle - c * values.subtalar_velocity
    values.subtalar_stiffness, values.subtalar_damping = k, c
    values.activation = state.activation


def differentiate(values, seed, result):
    k, c = values.subtalar_stiffness, values.subtalar_damping
    result.subtalar_torque = -k * seed.subtalar_angle - c * seed.subtalar_velocity
