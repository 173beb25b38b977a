"""All at once: every component takes its step with the others' outputs at its beginning. The way of masters that step
in parallel."""

from __future__ import annotations

from typing import Any

from ..assembly import Assembly
from ..energy import Exchange, Values


class Jacobi:
    name = "jacobi"
    lag = 1
    order = 1

    def start(self, assembly: Assembly) -> None:
        pass

    def step(self, assembly: Assembly, time: float, step: float) -> None:
        for member in assembly.stepping:
            assembly.advance(member, time, step, all_outputs=True)
        assembly.carry_on()
        for member in assembly.stepping:
            assembly.transfer(member)

    def applied(self, exchange: Exchange) -> Values:
        return exchange.torque[:-1]

    def save(self) -> Any:
        return None

    def restore(self, memory: Any) -> None:
        pass
