"""Cubic pieces from resources/table.json; where loading and unloading differ, the torque passes from one to the other
(README.md)."""

from __future__ import annotations

import json
import struct
from bisect import bisect_right
from typing import ClassVar

from .._fmi import Fmi2Slave
from .interface import AXES, variables

Curve = list[list[float]]  # rows of angle [rad], torque [N.m], slope [N.m/rad]


class Slave(Fmi2Slave):
    variables: ClassVar[list[dict]] = variables()

    def __init__(self, **keywords: str) -> None:
        super().__init__(**keywords)
        self._angles = self.slots(*(f"{a}_angle" for a in AXES))
        self._outputs = slice(self.index[f"{AXES[0]}_torque"], self.index[f"{AXES[-1]}_stiffness"] + 1)
        table = json.loads((self.resources / "table.json").read_text("utf-8"))
        self._axes: list[tuple[Curve, Curve] | None] = [
            (table[a]["loading"], table[a]["unloading"]) if a in table else None for a in AXES
        ]
        self._before = [(0.0, 0.0)] * len(
            AXES
        )  # angle and share of the increasing branch (-1 ... 1) at the last communication point

    def initialise(self) -> None:
        self._scale, self._turn = self["torque_scale"], self["turn"]
        self._before = [(angle, 1.0 if angle >= 0.0 else -1.0) for angle in self.values[self._angles].tolist()]
        self.refresh()

    def step(self, time: float, step: float) -> None:
        self._before = self.refresh()

    def refresh(self) -> list[tuple[float, float]]:
        torques, stiffnesses, now = [], [], []
        for angle, curves, (last, share) in zip(
            self.values[self._angles].tolist(), self._axes, self._before, strict=True
        ):
            moved = share + 2.0 * (angle - last) / self._turn
            share = min(1.0, max(-1.0, moved))
            now.append((angle, share))
            if curves is None:
                torques.append(0.0)
                stiffnesses.append(0.0)
                continue
            loading, slope_loading = evaluate(curves[0], angle)
            unloading, slope_unloading = evaluate(curves[1], angle)
            # rising angle is loading beyond zero and unloading before it
            up = 0.5 * (1.0 + share) if angle >= 0.0 else 0.5 * (1.0 - share)
            torques.append(self._scale * (up * loading + (1.0 - up) * unloading))
            turning = 0.0 if abs(moved) >= 1.0 else (1.0 if angle >= 0.0 else -1.0) / self._turn * (loading - unloading)
            stiffnesses.append(-self._scale * (up * slope_loading + (1.0 - up) * slope_unloading + turning))
        self.values[self._outputs] = torques + stiffnesses
        return now

    def save(self) -> bytes:
        return struct.pack(f"{2 * len(AXES)}d", *(v for pair in self._before for v in pair))

    def restore(self, state: bytes) -> None:
        flat = struct.unpack(f"{2 * len(AXES)}d", state)
        self._before = list(zip(flat[::2], flat[1::2], strict=True))


def evaluate(curve: Curve, angle: float) -> tuple[float, float]:
    """Torque and slope: cubic Hermite between the rows, straight on with the end slopes outside."""
    first, last = curve[0], curve[-1]
    if angle <= first[0] or angle >= last[0]:
        x, y, slope = first if angle <= first[0] else last
        return y + slope * (angle - x), slope
    k = bisect_right(curve, angle, key=lambda row: row[0]) - 1
    (x0, y0, m0), (x1, y1, m1) = curve[k], curve[k + 1]
    h = x1 - x0
    t = (angle - x0) / h
    secant = (y1 - y0) / h
    c = 3.0 * secant - 2.0 * m0 - m1
    d = m0 + m1 - 2.0 * secant
    return y0 + h * t * (m0 + t * (c + t * d)), m0 + t * (2.0 * c + 3.0 * t * d)
