"""Spring and damper that act outside a slack; a strap pulls but never pushes (equation: README.md)."""

from __future__ import annotations

from typing import ClassVar

from .._fmi import Fmi2Slave
from .interface import AXES, variables


class Slave(Fmi2Slave):
    variables: ClassVar[list[dict]] = variables()

    def __init__(self, **keywords: str) -> None:
        super().__init__(**keywords)
        self._angles = self.slots(*(f"{a}_angle" for a in AXES))
        self._velocities = self.slots(*(f"{a}_velocity" for a in AXES))
        self._outputs = slice(self.index[f"{AXES[0]}_torque"], self.index[f"{AXES[-1]}_damping"] + 1)

    def initialise(self) -> None:
        self._axes = [
            tuple(self[f"{a}_{p}"] for p in ("stiffness_coefficient", "damping_coefficient", "rest_angle", "slack"))
            for a in AXES
        ]
        self.refresh()

    def step(self, time: float, step: float) -> None:
        self.refresh()

    def refresh(self) -> None:
        torques, stiffnesses, dampings = [], [], []
        angles, velocities = self.values[self._angles].tolist(), self.values[self._velocities].tolist()
        for angle, velocity, (k, c, rest, slack) in zip(angles, velocities, self._axes, strict=True):
            x = angle - rest
            side = 1.0 if x > 0 else -1.0
            stretch = abs(x) - slack
            pull = k * stretch + c * side * velocity
            if stretch <= 0.0:
                torques.append(0.0)
                stiffnesses.append(0.0)
                dampings.append(c if slack == 0.0 else 0.0)
            elif pull <= 0.0 < slack:
                torques.append(0.0)
                stiffnesses.append(0.0)
                dampings.append(0.0)
            else:
                torques.append(-side * pull)
                stiffnesses.append(k)
                dampings.append(c)
            if slack == 0.0:
                torques[-1] = -k * x - c * velocity
                stiffnesses[-1] = k
        self.values[self._outputs] = torques + stiffnesses + dampings
