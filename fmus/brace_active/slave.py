"""A trigger, a lag and a limit (equation: README.md)."""

from __future__ import annotations

import math
import struct
from typing import ClassVar

from .._fmi import Fmi2Slave
from .interface import AXES, variables

LEVER = 0.04  # m, of the strap about the subtalar axis


class Slave(Fmi2Slave):
    variables: ClassVar[list[dict]] = variables()

    def __init__(self, **keywords: str) -> None:
        super().__init__(**keywords)
        self._angles = self.slots(*(f"{a}_angle" for a in AXES))
        self._velocities = self.slots(*(f"{a}_velocity" for a in AXES))
        self._outputs = slice(self.index["subtalar_torque"], self.index["strap_tension"] + 1)
        self._tension, self._tight = 0.0, False

    def initialise(self) -> None:
        names = (
            "angle_threshold",
            "velocity_threshold",
            "gain",
            "damping_gain",
            "torque_limit",
            "lag",
            "passive_stiffness",
        )
        self._parameters = tuple(self[n] for n in names)
        self._tension, self._tight = 0.0, False
        self.refresh()

    def step(self, time: float, step: float) -> None:
        threshold, fast, gain, damping, limit, lag, _ = self._parameters
        angle, velocity = float(self.values[self._angles][0]), float(self.values[self._velocities][0])
        if angle > threshold and velocity > fast:
            self._tight = True
        elif angle < threshold:
            self._tight = False
        command = min(limit, max(0.0, gain * (angle - threshold) + damping * velocity)) if self._tight else 0.0
        self._tension = command + (self._tension - command) * math.exp(-step / lag)
        self.refresh()

    def refresh(self) -> None:
        k = self._parameters[6]
        angle = float(self.values[self._angles][0])
        self.values[self._outputs] = (-k * angle - self._tension, k, 0.0, self._tension / LEVER)

    def save(self) -> bytes:
        return struct.pack("d?", self._tension, self._tight)

    def restore(self, state: bytes) -> None:
        self._tension, self._tight = struct.unpack("d?", state)
