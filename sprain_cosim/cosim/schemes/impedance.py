"""Gauss-Seidel with the devices' stiffness and damping handed to the plant, which applies torque - K d(angle) - C
d(velocity) within its own steps. Exact for a device that is linear in angle and velocity, second order for others, and
free of the delay that destabilises a held torque. What a device does not declare is found by finite differences
(identification.py)."""

from __future__ import annotations

from typing import Any

from ...contract import PLANT
from ..assembly import Assembly
from ..energy import Exchange, Values, handed_over
from ..identification import Identification
from ..loops import make_consistent
from .gauss_seidel import GaussSeidel


class Impedance(GaussSeidel):
    """Every `every` steps the identification is done anew where it has become wrong; 0: at the start only."""

    name = "impedance"
    order = 2

    def __init__(self, identification: Identification, every: int = 1) -> None:
        self._identification, self._every = identification, every
        self._count, self._recent = 0, identification.recent

    @property
    def identifies(self) -> bool:
        """Something is to be found anew along the run."""
        return bool(self._every) and self._identification.repeats

    def start(self, assembly: Assembly) -> None:
        assembly.hand_over(True)
        make_consistent(assembly)
        self._plant = next((m for m in assembly.members if m.name == PLANT), None)

    def step(self, assembly: Assembly, time: float, step: float) -> None:
        super().step(assembly, time, step)
        self._count += 1
        self._identification.recent = self._recent
        again = self._every and self._count % self._every == 0 and time + 2 * step <= assembly.stop + 1e-9 * step
        if again and self._identification.update(time + step, step) and self._plant:
            assembly.transfer(self._plant)
        self._recent = self._identification.recent

    def applied(self, exchange: Exchange) -> Values:
        """The mean of a torque that starts at the device's and changes with K and C over the step."""
        return exchange.torque[:-1] + 0.5 * handed_over(exchange)

    def save(self) -> Any:
        return self._count, self._recent

    def restore(self, memory: Any) -> None:
        self._count, self._recent = memory
