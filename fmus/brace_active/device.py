"""A trigger, a lag and a limit (equation: README.md)."""

import math

LEVER = 0.04  # m, of the strap about the subtalar axis
STATE = {"tension": 0.0, "tight": 0}


def initialise(values, state):
    state.tension, state.tight = 0.0, 0
    refresh(values, state)


def step(values, state, step):
    angle, velocity = values.subtalar_angle, values.subtalar_velocity
    if angle > values.angle_threshold and velocity > values.velocity_threshold:
        state.tight = 1
    elif angle < values.angle_threshold:
        state.tight = 0
    command = 0.0
    if state.tight == 1:
        wanted = values.gain * (angle - values.angle_threshold) + values.damping_gain * velocity
        command = min(values.torque_limit, max(0.0, wanted))
    state.tension = command + (state.tension - command) * math.exp(-step / values.lag)
    refresh(values, state)


def refresh(values, state):
    k = values.passive_stiffness
    values.subtalar_torque = -k * values.subtalar_angle - state.tension
    values.subtalar_stiffness, values.subtalar_damping = k, 0.0
    values.strap_tension = state.tension / LEVER


def differentiate(values, seed, result):
    result.subtalar_torque = -values.passive_stiffness * seed.subtalar_angle
