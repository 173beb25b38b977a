"""What a coupling scheme is: how the components exchange values over one communication step. One file per scheme."""

from __future__ import annotations

from typing import Protocol

from ..energy import Exchange
from ..system import Assembly


class Scheme(Protocol):
    """`start` runs once, on an assembly that has started. `step` takes the assembly from consistent values at `time` to
    consistent values at `time + step` [s], inputs transferred. `applied` says which torque it let the plant apply over
    each step, `lag` by how many steps a recorded device torque is behind. `order` of convergence. A scheme may keep
    memory of a run; every run makes a new one."""

    name: str
    lag: int
    order: int

    def start(self, assembly: Assembly) -> None: ...

    def step(self, assembly: Assembly, time: float, step: float) -> None: ...

    def applied(self, exchange: Exchange) -> Exchange.Torques: ...
