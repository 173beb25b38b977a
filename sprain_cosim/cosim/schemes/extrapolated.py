"""Gauss-Seidel with the devices' torques extrapolated linearly to the middle of the coming step, which makes it second
order. Excitations are left alone: the controller gives the mean over the coming step. Unstable for strongly damped
devices: needs damping * step < effective inertia."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...contract import is_torque
from ..assembly import Assembly
from ..energy import Exchange, Values


class Extrapolated:
    name = "gauss-seidel-extrapolated"
    lag = 0
    order = 2

    def start(self, assembly: Assembly) -> None:
        self._slots = assembly.feedback_slots(is_torque)
        self._before: np.ndarray | None = None
        self._last_step = 0.0

    def step(self, assembly: Assembly, time: float, step: float) -> None:
        now = assembly.bus[self._slots].copy()
        if self._before is not None:
            assembly.bus[self._slots] = now + 0.5 * step / self._last_step * (now - self._before)
        self._before, self._last_step = now, step
        for member in assembly.stepping:
            if member.fed_back:
                member.inputs_set = False  # those on the bus are the extrapolated ones
            else:
                assembly.transfer(member)
            assembly.advance(member, time, step)
        assembly.refresh_feedback()

    def applied(self, exchange: Exchange) -> Values:
        ahead = exchange.torque[:-1].copy()
        ahead[1:] += 0.5 * (exchange.steps[1:] / exchange.steps[:-1])[:, None] * np.diff(exchange.torque[:-1], axis=0)
        return ahead

    def save(self) -> Any:
        return self._before, self._last_step

    def restore(self, memory: Any) -> None:
        self._before, self._last_step = memory
