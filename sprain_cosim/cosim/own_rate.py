"""A component that is called at a rate of its own, and what the plant feels of it between two calls."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .result import Held
from .schedule import Rate

if TYPE_CHECKING:
    from .assembly import Assembly, Member
    from .hand_over import HandOver


class OwnRate:
    """One member of an assembly.

    A call at time t takes the member from t - period to t with the inputs of t (Gauss-Seidel at its own rate). Between
    two calls the outputs of a sampled member are held; the torques of another one are carried on by the stiffness and
    damping that it hands over, from the plant's motion at its last call."""

    def __init__(self, assembly: Assembly, member: Member, rate: Rate, hand_over: HandOver | None) -> None:
        self.member, self.rate = member, rate
        self._assembly, self._hand_over = assembly, hand_over
        torques = [(axis, s) for axis, s in assembly.system.torques.items() if s.startswith(f"{member.name}.")]
        self._rows = [list(assembly.system.torques).index(axis) for axis, _ in torques]
        self._slots = [assembly.index[source] for _, source in torques]
        self._factors = np.array([assembly.factor(k) for k in self._slots])
        self._calls = 0
        self._largest, self._change = np.zeros(len(torques)), np.zeros(len(torques))
        self._axes = [axis for axis, _ in torques]

    def start(self) -> None:
        """Once, with consistent values at the start."""
        self._calls = 0
        self._change[:] = 0.0
        self._remember()
        self._largest[:] = np.abs(self._torque)

    def call(self) -> None:
        """Its next step, with the newest values of the others. Raises SimulationError."""
        before = self._torque
        self._calls += 1
        self._assembly.transfer(self.member)
        period = self.rate.period
        self._assembly.advance(self.member, self._assembly.time + (self._calls - 1) * period, period, all_outputs=True)
        self._remember()
        np.maximum(self._change, np.abs(self._torque - before), out=self._change)
        np.maximum(self._largest, np.abs(self._torque), out=self._largest)

    def carry_on(self) -> None:
        """The torques at a point at which it is not called."""
        if self._hand_over is not None and self._rows:
            torque = self._torque + self._hand_over.change(self._motion)[self._rows]
            self._assembly.bus[self._slots] = torque / self._factors

    def held(self) -> Held | None:
        """How old its torques became; None where they are not held."""
        if not (self.rate.sampled and self._axes):
            return None
        k = int(np.argmax(self._change))
        largest, change = float(self._largest[k]), float(self._change[k])
        return Held(self.rate.period, change, change / largest if largest else 0.0, self._axes[k])

    def _remember(self) -> None:
        self._torque = self._assembly.bus[self._slots] * self._factors
        if self._hand_over is not None:
            self._motion = self._hand_over.motion()
