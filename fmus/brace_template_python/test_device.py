"""The law as plain Python, nothing compiled: python -m pytest brace_template_python"""

from types import SimpleNamespace

import device

START = {"stiffness": 40.0, "damping": 0.2, "rest_angle": 0.0}


def brace(angle: float, velocity: float = 0.0, **parameters: float) -> SimpleNamespace:
    """The record of values after the law was evaluated."""
    values = SimpleNamespace(**{**START, **parameters}, subtalar_angle=angle, subtalar_velocity=velocity)
    device.refresh(values)
    return values


def test_no_torque_at_rest() -> None:
    assert brace(0.1, rest_angle=0.1).subtalar_torque == 0.0


def test_it_resists() -> None:
    """The torque is that of the brace on the foot: opposite to the angle and to the velocity."""
    assert brace(0.5).subtalar_torque == -20.0
    assert brace(0.0, velocity=10.0).subtalar_torque == -2.0


def test_stiffness_and_damping_are_the_slopes_of_the_torque() -> None:
    h = 1e-6
    stiffness = -(brace(0.1 + h).subtalar_torque - brace(0.1 - h).subtalar_torque) / (2 * h)
    damping = -(brace(0.1, h).subtalar_torque - brace(0.1, -h).subtalar_torque) / (2 * h)
    assert abs(brace(0.1).subtalar_stiffness - stiffness) < 1e-6
    assert abs(brace(0.1).subtalar_damping - damping) < 1e-6
