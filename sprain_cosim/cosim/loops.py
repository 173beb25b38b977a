"""Consistent values at one instant: direct feed-through between components, algebraic loops included.

Substitution solves chains, and loops whose gain is small; Newton's method with differences solves the others. A loop
without a solution is named connection by connection."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..errors import SimulationError

if TYPE_CHECKING:
    from .assembly import Assembly, Member

MAX_ROUNDS = 20
CONSISTENT = 1e-12  # relative to the larger of 1 and the value
FAR = 1e9

Values = NDArray[np.floating]


def make_consistent(assembly: Assembly) -> None:
    """Exchanges the values of all components until nothing changes. Raises SimulationError for a value that is not
    finite and for an algebraic loop without a solution, naming the connections of the loop."""
    bus = assembly.bus
    start, before = bus.copy(), bus.copy()
    ever = np.zeros(len(bus), dtype=bool)
    largest, growing = math.inf, 0
    for _ in range(MAX_ROUNDS):
        _exchange(assembly)
        difference = bus - before
        if not difference.any():  # nothing moved at all, and all is finite
            return
        change = np.abs(difference) / np.maximum(1.0, np.abs(before))
        moving = ~(change <= CONSISTENT)
        if not moving.any():
            return
        if not growing:
            _check_finite(assembly)
        ever |= moving
        growing = growing + 1 if not change.max() < largest else 0
        if growing == 3:
            break
        largest = change.max()
        before[:] = bus
    _Loop(assembly, ever).solve(start)


def _exchange(assembly: Assembly) -> None:
    if assembly.native is not None:
        assembly.native.exchange()
        return
    for member in assembly.members:
        assembly.transfer(member)
        member.instance.set_inputs()
        member.instance.get_outputs()
    for member in assembly.members:
        assembly.transfer(member)


class _Loop:
    """The inputs that equal the outputs which follow from them; `changing` marks the slots of the bus among which they
    are."""

    def __init__(self, assembly: Assembly, changing: NDArray[np.bool_]) -> None:
        self.assembly = assembly
        found = [(k, m) for m in assembly.members for k in range(m.inputs.start, m.inputs.stop) if changing[k]]
        self.slots = np.array([k for k, _ in found], dtype=np.intp)
        self.owners = [m for _, m in found]

    def solve(self, start: Values) -> None:
        """Newton's method with damped steps, from the bus `start`."""
        assembly = self.assembly
        assembly.bus[:] = start
        z = assembly.bus[self.slots].copy()
        gap = self._gap(z, assembly.members)
        for _ in range(MAX_ROUNDS):
            _check_finite(assembly)
            scale = np.maximum(1.0, np.abs(z))
            if scale.max() > FAR:  # a solution at infinity is none
                break
            if np.abs(gap / scale).max(initial=0.0) <= CONSISTENT:
                return
            step = np.linalg.lstsq(self._slope(z, gap, scale), gap, rcond=None)[0]
            for share in 0.5 ** np.arange(12):
                tried = self._gap(z - share * step, assembly.members)
                if np.isfinite(tried).all() and np.abs(tried / scale).max() < np.abs(gap / scale).max():
                    break
            else:
                if np.abs(gap / scale).max() <= 1e3 * CONSISTENT:  # as near as the rounding of the components allows
                    self._gap(z, assembly.members)
                    return
                break
            z, gap = z - share * step, tried
        open_ = np.abs(gap) > CONSISTENT * np.maximum(1.0, np.abs(z))
        names = [assembly.names[k] for k in self.slots[open_]]
        ends = ", ".join(f"{name} = {assembly.system.connections.get(name, 'what was identified')}" for name in names)
        raise SimulationError(f"the values at the start do not settle; no solution found for the loop through {ends}")

    def _slope(self, z: Values, gap: Values, scale: Values) -> Values:
        """(n, n) derivative of the gap by the inputs, by forward differences."""
        slope = np.empty((len(z), len(z)))
        for k, owner in enumerate(self.owners):
            moved = z.copy()
            moved[k] += 1e-6 * scale[k]
            slope[:, k] = (self._gap(moved, [owner]) - gap) / (1e-6 * scale[k])
            self._gap(z, [owner])
        return slope

    def _gap(self, inputs: Values, changed: Iterable[Member]) -> Values:
        """`inputs` minus the outputs that follow from them (n,); only `changed` members are evaluated. The inputs stay
        on the bus."""
        assembly, bus = self.assembly, self.assembly.bus
        bus[self.slots] = inputs
        for member in changed:
            member.instance.set_inputs()
            member.instance.get_outputs()
        for member in assembly.members:
            assembly.transfer(member)
        gap: Values = inputs - bus[self.slots]
        bus[self.slots] = inputs
        return gap


def _check_finite(assembly: Assembly) -> None:
    if not np.isfinite(assembly.bus).all():
        bad = [n for n, v in zip(assembly.names, assembly.record, strict=True) if not math.isfinite(v)]
        first = next((n for n in bad if n not in assembly.system.connections), bad[0])
        raise SimulationError(f"{first} is not finite at the start")
