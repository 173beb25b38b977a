"""Gauss-Seidel with the devices' stiffness and damping handed to the plant, which applies torque - K d(angle) - C d(velocity) within its own
steps. Exact for a device that is linear in angle and velocity, second order for others, and free of the delay that destabilises a held torque."""

from __future__ import annotations

import numpy as np

from ..system import Assembly
from .energy import Exchange
from .gauss_seidel import GaussSeidel


class Impedance(GaussSeidel):
    name = "impedance"

    def start(self, assembly: Assembly) -> None:
        assembly.hand_over(True)

    def applied(self, exchange: Exchange) -> Exchange.Torques:
        """The mean of a torque that starts at the device's and changes with K and C over the step."""
        turned, quickened = np.diff(exchange.angle, axis=0), np.diff(exchange.velocity, axis=0)
        stiffness, damping = exchange.stiffness[:-1], exchange.damping[:-1]
        return exchange.torque[:-1] - 0.5 * (np.einsum("nij,nj->ni", stiffness, turned) + np.einsum("nij,nj->ni", damping, quickened))
