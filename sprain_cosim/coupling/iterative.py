"""Every step is repeated, from saved states, until the torque that the plant felt is the mean of the devices' torques at both ends of the step: second
order, whatever the device. Relaxation after Aitken. A step that does not settle ends the run."""

from __future__ import annotations

import numpy as np

from ..errors import SimulationError
from ..system import Assembly
from .energy import TORQUE, Exchange

TOLERANCE = 1e-6
MAX_ITERATIONS = 50


class Iterative:
    name = "iterative"
    lag = 0
    order = 2

    def start(self, assembly: Assembly) -> None:
        self._slots = assembly.slots(lambda name: name.endswith(TORQUE))
        self._before: np.ndarray | None = None

    def step(self, assembly: Assembly, time: float, step: float) -> None:
        bus, slots = assembly.bus, self._slots
        now, start = bus[slots].copy(), bus.copy()
        guess = now if self._before is None else 2.0 * now - self._before
        states = [(member, member.instance.save()) for member in assembly.members]
        relaxation, last = 1.0, None
        try:
            for k in range(MAX_ITERATIONS):
                if k:
                    for member, state in states:
                        member.instance.restore(state)
                    bus[:] = start
                bus[slots] = 0.5 * (now + guess)
                for member in assembly.members:
                    if member.late:
                        member.sent = False
                    else:
                        assembly.transfer(member)
                    assembly.advance(member, time, step)
                assembly.settle()
                gap = bus[slots] - guess
                if np.abs(gap).max(initial=0.0) <= TOLERANCE * (1.0 + np.abs(bus[slots]).max(initial=0.0)):
                    self._before = now
                    return
                if last is not None and (change := gap - last) @ change > 0.0:
                    relaxation = float(np.clip(-relaxation * (last @ change) / (change @ change), 0.05, 2.0))
                guess, last = guess + relaxation * gap, gap
        finally:
            for member, state in states:
                member.instance.release(state)
        names = ", ".join(np.array(assembly.names)[slots][np.abs(gap) > TOLERANCE])
        raise SimulationError(
            f"iterative: {names} did not settle in {MAX_ITERATIONS} iterations at {time + step:.6g} s; take a smaller step or scheme impedance"
        )

    def applied(self, exchange: Exchange) -> Exchange.Torques:
        return 0.5 * (exchange.torque[1:] + exchange.torque[:-1])
