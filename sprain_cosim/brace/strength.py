"""How strong a device is, and whether a brace can be so: a wrong unit, or one that nobody declared, shows in this."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

from ..literature import BRACE_STIFFNESS, BRACE_TORQUE


@dataclass(frozen=True)
class Strength:
    """Of a device, over all its axes.

    - torque: the largest in the recorded landing [N.m]
    - stiffness: the largest secant stiffness at held angles [N.m/rad]
    """

    torque: float
    stiffness: float

    @classmethod
    def of(cls, static: Mapping[str, Any], recorded: Mapping[str, Any]) -> Self:
        """From the results of the probes `static` and `recorded`."""
        rest = dict(zip(static["torque"], static["rest"], strict=True))
        held = [
            (axis, sign * degrees, torque)
            for axis, pairs in static["torque"].items()
            for degrees, *both in pairs
            for sign, torque in zip((1, -1), both, strict=True)
        ]
        held += [(axis, degrees, torque) for axis, rows in static["one_sided"].items() for degrees, torque in rows]
        secants = (abs((torque - rest[axis]) / math.radians(degrees)) for axis, degrees, torque in held)
        return cls(max(recorded["peak_torque"]), max(secants, default=0.0))

    def times(self, factor: float) -> Strength:
        return Strength(factor * self.torque, factor * self.stiffness)

    @property
    def doubt(self) -> str:
        """Why no brace is so: "too weak" or "too strong"; empty where one may be."""
        if self.torque > BRACE_TORQUE[1] or self.stiffness > BRACE_STIFFNESS[1]:
            return "too strong for a brace"
        weak = self.torque < BRACE_TORQUE[0] and self.stiffness < BRACE_STIFFNESS[0]
        return "too weak for a brace" if weak else ""
