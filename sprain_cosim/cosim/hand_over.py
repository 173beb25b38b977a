"""Torques carried on by stiffness and damping: what the plant makes of an impedance hand-over, done outside it where
the plant stops between two exchanges or a device is not called at one."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..contract import MOTION, impedance_input, motion_output, torque_input

if TYPE_CHECKING:
    from .assembly import Assembly

Values = NDArray[np.floating]


class HandOver:
    """The stiffness and damping on the plant's inputs, about the axes of the system's torques (d)."""

    def __init__(self, assembly: Assembly) -> None:
        self._assembly = assembly
        self.axes = list(assembly.system.torques)
        self._motion = [[assembly.index[motion_output(a, kind)] for a in self.axes] for kind in MOTION]
        self._impedance = [
            [[assembly.index.get(impedance_input(a, b, kind), assembly.zero) for b in self.axes] for a in self.axes]
            for kind in MOTION
        ]
        self._inputs = [assembly.index[torque_input(a)] for a in self.axes]
        slots = (np.array(s, dtype=np.intp) for s in (self._motion, self._impedance, self._inputs))
        self._motion_factor, self._impedance_factor, self._input_factor = (
            np.array([assembly.factor(k) for k in s.ravel().tolist()]).reshape(s.shape) for s in slots
        )

    def motion(self) -> Values:
        """(2, d) the plant's present angles [rad] and velocities [rad/s]."""
        motion: Values = self._assembly.bus[self._motion] * self._motion_factor
        return motion

    def change(self, since: Values) -> Values:
        """(d,) [N.m] of the torques since the plant's motion was `since` (2, d): -K d(angle) - C d(velocity)."""
        impedance = self._assembly.bus[self._impedance] * self._impedance_factor
        change: Values = -np.einsum("kij,kj->i", impedance, self.motion() - since)
        return change

    def carry_on(self, since: Values) -> None:
        """Moves the plant's torque inputs on from the motion `since` to the present one."""
        self._assembly.bus[self._inputs] += self.change(since) / self._input_factor
