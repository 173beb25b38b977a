"""One after the other: each component takes its step with the newest outputs of those before it."""

from __future__ import annotations

from ..energy import Exchange
from ..system import Assembly


class GaussSeidel:
    name = "gauss-seidel"
    lag = 0
    order = 1

    def start(self, assembly: Assembly) -> None:
        pass

    def step(self, assembly: Assembly, time: float, step: float) -> None:
        for member in assembly.members:
            if not member.sent:
                assembly.transfer(member)
            assembly.advance(member, time, step)
        assembly.settle()

    def applied(self, exchange: Exchange) -> Exchange.Torques:
        return exchange.torque[:-1]
