"""The law of the brace (equation: README.md)."""

from __future__ import annotations

from typing import ClassVar

from .._fmi import Fmi2Slave
from .interface import variables


class Slave(Fmi2Slave):
    variables: ClassVar[list[dict]] = variables()

    def initialise(self) -> None:
        """Parameters and first inputs are set: give consistent outputs."""
        self.refresh()

    def step(self, time: float, step: float) -> None:
        """From `time` to `time + step` [s] with the inputs held. A brace with memory moves its own state here, and
        saves it in `save`/`restore`."""
        self.refresh()

    def refresh(self) -> None:
        """Outputs of the present inputs."""
        k, c = self["stiffness"], self["damping"]
        self["subtalar_torque"] = -k * (self["subtalar_angle"] - self["rest_angle"]) - c * self["subtalar_velocity"]
        self["subtalar_stiffness"] = k
        self["subtalar_damping"] = c
