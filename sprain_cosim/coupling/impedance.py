"""Gauss-Seidel with the devices' stiffness and damping handed to the plant, which applies torque - K d(angle) - C d(velocity) within its own
steps. Exact for a device that is linear in angle and velocity, second order for others, and free of the delay that destabilises a held torque."""

from __future__ import annotations

from ..system import Assembly
from .gauss_seidel import GaussSeidel


class Impedance(GaussSeidel):
    name = "impedance"

    def start(self, assembly: Assembly) -> None:
        assembly.hand_over(True)
