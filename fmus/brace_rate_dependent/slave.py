"""Stiffness between a slow and a fast value, by velocity, with a lag (equation: README.md)."""

from __future__ import annotations

import math
import struct
from typing import ClassVar

from .._fmi import Fmi2Slave
from .interface import AXES, variables


class Slave(Fmi2Slave):
    variables: ClassVar[list[dict]] = variables()

    def __init__(self, **keywords: str) -> None:
        super().__init__(**keywords)
        self._angles = self.slots(*(f"{a}_angle" for a in AXES))
        self._velocities = self.slots(*(f"{a}_velocity" for a in AXES))
        self._outputs = slice(self.index["subtalar_torque"], self.index["activation"] + 1)
        self._activation = 0.0

    def initialise(self) -> None:
        names = ("slow_stiffness", "fast_stiffness", "damping_coefficient", "transition_velocity", "exponent", "lag")
        self._parameters = tuple(self[n] for n in names)
        self._activation = self._target()
        self.refresh()

    def step(self, time: float, step: float) -> None:
        lag, target = self._parameters[5], self._target()
        self._activation = target + (self._activation - target) * (math.exp(-step / lag) if lag > 0.0 else 0.0)
        self.refresh()

    def _target(self) -> float:
        ratio = (abs(float(self.values[self._velocities][0])) / self._parameters[3]) ** self._parameters[4]
        return ratio / (1.0 + ratio)

    def refresh(self) -> None:
        slow, fast, c = self._parameters[:3]
        angle, velocity = float(self.values[self._angles][0]), float(self.values[self._velocities][0])
        k = slow + self._activation * (fast - slow)
        self.values[self._outputs] = (-k * angle - c * velocity, k, c, self._activation)

    def save(self) -> bytes:
        return struct.pack("d", self._activation)

    def restore(self, state: bytes) -> None:
        (self._activation,) = struct.unpack("d", state)
