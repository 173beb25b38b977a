"""Gauss-Seidel with the devices' stiffness and damping handed to the plant, which applies torque - K d(angle) - C
d(velocity) within its own steps. Exact for a device that is linear in angle and velocity, second order for others, and
free of the delay that destabilises a held torque. What a device does not declare is found by finite differences
(identify.py)."""

from __future__ import annotations

import numpy as np

from ..energy import Exchange
from ..identification import Identification
from ..system import Assembly
from .gauss_seidel import GaussSeidel


class Impedance(GaussSeidel):
    """Every `every` steps the identification is done anew where it has become wrong; 0: at the start only."""

    name = "impedance"
    order = 2

    def __init__(self, identification: Identification, every: int = 1) -> None:
        self._identification, self._every = identification, every
        self._count, self._memory = 0, identification.memory

    def start(self, assembly: Assembly) -> None:
        assembly.hand_over(True)
        assembly.agree()
        self._plant = next((m for m in assembly.members if m.name == "plant"), None)

    def step(self, assembly: Assembly, time: float, step: float) -> None:
        super().step(assembly, time, step)
        self._count += 1
        self._identification.memory = self._memory
        again = self._every and self._count % self._every == 0 and time + 2 * step <= assembly.stop + 1e-9 * step
        if again and self._identification.update(time + step, step) and self._plant:
            assembly.transfer(self._plant)
        self._memory = self._identification.memory

    def applied(self, exchange: Exchange) -> Exchange.Torques:
        """The mean of a torque that starts at the device's and changes with K and C over the step."""
        turned, quickened = np.diff(exchange.angle, axis=0), np.diff(exchange.velocity, axis=0)
        stiffness, damping = exchange.stiffness[:-1], exchange.damping[:-1]
        return exchange.torque[:-1] - 0.5 * (
            np.einsum("nij,nj->ni", stiffness, turned) + np.einsum("nij,nj->ni", damping, quickened)
        )
