"""One after the other: each component takes its step with the newest outputs of those before it."""

from __future__ import annotations

from typing import Any

from ..assembly import Assembly
from ..energy import Exchange, Values


class GaussSeidel:
    name = "gauss-seidel"
    lag = 0
    order = 1

    def start(self, assembly: Assembly) -> None:
        pass

    def step(self, assembly: Assembly, time: float, step: float) -> None:
        for member in assembly.stepping:
            if not member.inputs_set:
                assembly.transfer(member)
            assembly.advance(member, time, step)
        assembly.refresh_feedback()

    def applied(self, exchange: Exchange) -> Values:
        return exchange.torque[:-1]

    def save(self) -> Any:
        return None

    def restore(self, memory: Any) -> None:
        pass
