"""Torque -s P(f t) about each Euler axis, P the cubic polynomials of the passive ankle (source: README.md)."""

from __future__ import annotations

from typing import ClassVar

from .._fmi import Fmi2Slave
from .interface import AXES, variables

# N.m of the angle in rad: linear, quadratic, cubic
POLYNOMIALS = (
    (9.52095038, -29.57608094, 169.01588105),
    (3.61796125, -10.1612135, 64.5279144),
    (5.98187224, 15.74951827, 33.6780792),
)


class Slave(Fmi2Slave):
    variables: ClassVar[list[dict]] = variables()

    def __init__(self, **keywords: str) -> None:
        super().__init__(**keywords)
        self._angles = self.slots(*(f"{a}_angle" for a in AXES))
        self._outputs = slice(self.index["rotation_x_torque"], self.index["stored_energy"] + 1)

    def initialise(self) -> None:
        self._scales = self["angle_scale"], self["torque_scale"]
        self.refresh()

    def step(self, time: float, step: float) -> None:
        self.refresh()

    def refresh(self) -> None:
        f, s = self._scales
        torques, stiffnesses, energy = [], [], 0.0
        for t, (a, b, c) in zip(self.values[self._angles].tolist(), POLYNOMIALS, strict=True):
            x = f * t
            torques.append(-s * x * (a + x * (b + x * c)))
            stiffnesses.append(s * f * (a + x * (2 * b + x * 3 * c)))
            energy += s * t * x * (a / 2 + x * (b / 3 + x * c / 4))
        self.values[self._outputs] = torques + stiffnesses + [energy]
