"""Every step is repeated, from saved states, until the torque that the plant felt is the mean of the devices' torques
at both ends of the step: second order, whatever the device. Quasi-Newton relaxation (Broyden's update, kept from step
to step; with one torque it is the secant method). A step that does not converge ends the run."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...contract import is_torque
from ...errors import SimulationError
from ..assembly import Assembly
from ..energy import Exchange, Values

TOLERANCE = 1e-6
MAX_ITERATIONS = 50


class Iterative:
    name = "iterative"
    lag = 0
    order = 2

    def start(self, assembly: Assembly) -> None:
        self._slots = assembly.feedback_slots(is_torque)
        self._before: np.ndarray | None = None
        self._slope = -np.eye(len(self._slots))  # d(gap)/d(guess); this start is plain substitution

    def step(self, assembly: Assembly, time: float, step: float) -> None:
        bus, slots = assembly.bus, self._slots
        now, start = bus[slots].copy(), bus.copy()
        guess = now if self._before is None else 2.0 * now - self._before
        states = [(member, member.instance.save_state()) for member in assembly.stepping]
        last: tuple[np.ndarray, np.ndarray] | None = None
        try:
            for k in range(MAX_ITERATIONS):
                if k:
                    for member, state in states:
                        member.instance.restore_state(state)
                    bus[:] = start
                bus[slots] = 0.5 * (now + guess)
                self._advance(assembly, time, step)
                gap = bus[slots] - guess
                if np.abs(gap).max(initial=0.0) <= TOLERANCE * (1.0 + np.abs(bus[slots]).max(initial=0.0)):
                    self._before = now
                    return
                if last is not None and (moved := guess - last[0]).any():
                    self._slope += np.outer(gap - last[1] - self._slope @ moved, moved) / (moved @ moved)
                last = guess, gap
                guess = guess - np.linalg.lstsq(self._slope, gap, rcond=None)[0]
        finally:
            for member, state in states:
                member.instance.free_state(state)
        names = ", ".join(np.array(assembly.names)[slots][np.abs(gap) > TOLERANCE])
        raise SimulationError(
            f"iterative: {names} did not settle in {MAX_ITERATIONS} iterations at {time + step:.6g} s; take a smaller "
            "step or scheme impedance"
        )

    @staticmethod
    def _advance(assembly: Assembly, time: float, step: float) -> None:
        """With the torques that stand on the bus."""
        for member in assembly.stepping:
            if member.fed_back:
                member.inputs_set = False
            else:
                assembly.transfer(member)
            assembly.advance(member, time, step)
        assembly.refresh_feedback()

    def applied(self, exchange: Exchange) -> Values:
        return 0.5 * (exchange.torque[1:] + exchange.torque[:-1])

    def save(self) -> Any:
        return self._before, self._slope.copy()

    def restore(self, memory: Any) -> None:
        self._before, self._slope = memory[0], memory[1].copy()
