"""Liner and two smooth stops (equation: README.md)."""

from __future__ import annotations

import math
from typing import ClassVar

from .._fmi import Fmi2Slave
from .interface import AXES, variables


class Slave(Fmi2Slave):
    variables: ClassVar[list[dict]] = variables()

    def __init__(self, **keywords: str) -> None:
        super().__init__(**keywords)
        self._angles = self.slots(*(f"{a}_angle" for a in AXES))
        self._velocities = self.slots(*(f"{a}_velocity" for a in AXES))
        self._outputs = slice(self.index["subtalar_torque"], self.index["stored_energy"] + 1)

    def initialise(self) -> None:
        names = (
            "liner_stiffness",
            "stop_stiffness",
            "damping_coefficient",
            "inversion_stop",
            "eversion_stop",
            "transition",
        )
        self._parameters = tuple(self[n] for n in names)
        self.refresh()

    def step(self, time: float, step: float) -> None:
        self.refresh()

    def refresh(self) -> None:
        k, stop, c, outer, inner, w = self._parameters
        angle, velocity = float(self.values[self._angles][0]), float(self.values[self._velocities][0])
        over, slope_over, energy_over = _ramp((angle - outer) / w)
        under, slope_under, energy_under = _ramp((-angle - inner) / w)
        torque = -k * angle - stop * w * (over - under) - c * velocity
        energy = 0.5 * k * angle * angle + stop * w * w * (energy_over + energy_under)
        self.values[self._outputs] = (torque, k + stop * (slope_over + slope_under), c, energy)


def _ramp(x: float) -> tuple[float, float, float]:
    """A ramp with a rounded corner: 0 for x < -1, x for x > 1, (x + 1)^2 / 4 between; its slope and its integral."""
    if x <= -1.0:
        return 0.0, 0.0, 0.0
    if x >= 1.0:
        return x, 1.0, (x * x - 1.0) / 2 + 2.0 / 3.0
    return (x + 1.0) ** 2 / 4, (x + 1.0) / 2, math.pow(x + 1.0, 3) / 12
