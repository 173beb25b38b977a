"""The law of the brace (equation: README.md), over one record of all variables by name.

A brace with memory has a record of its own as well: STATE = {"tension": 0.0}, moved on by `step(values, state, step)`
over `step` [s] with the inputs held."""


def refresh(values):
    """Outputs of the present inputs."""
    k, c = values.stiffness, values.damping
    values.subtalar_torque = -k * (values.subtalar_angle - values.rest_angle) - c * values.subtalar_velocity
    values.subtalar_stiffness = k
    values.subtalar_damping = c
