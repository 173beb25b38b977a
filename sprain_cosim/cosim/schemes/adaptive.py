"""Communication steps divided by the residual energy: every step of the regular grid, on which the run is recorded, is
taken in 1, 2, 4 ... 64 equal parts, as many as keep its residual within the tolerance. The residual of a part falls
with the order of the scheme, which gives the next number.

With saved states a step whose residual is too large is taken again; without, the number for the next step is chosen
with a wider margin, it falls slowly, and the first step is taken in 16 parts. After S. Sadjina et al. 2017 (energy.py),
whose controller chooses the step itself."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ...errors import InputError
from ..assembly import Assembly
from ..energy import Exchange, Values, exchange, shares
from ..schedule import is_multiple
from .iterative import Iterative

if TYPE_CHECKING:
    from .protocol import Scheme

PARTS = (1, 2, 4, 8, 16, 32, 64)
FIRST_UNSAVED = 16
AIM, AIM_UNSAVED = 0.7, 0.25  # of the residual that is allowed


class Adaptive:
    """Implements Scheme around another one.

    tolerance  the share of the exchanged energy that the run's residual may reach
    exchanges  steps of the scheme so far, over all parts
    smallest   of those [s]

    A step's residual is held against the mean of what it exchanges itself and what the steps before it exchanged on
    average, so that steps around a turning point, which exchange nothing, are not divided without end."""

    def __init__(self, scheme: Scheme, assembly: Assembly, step: float, tolerance: float) -> None:
        """Raises InputError where the scheme or a component cannot do it."""
        if scheme.name == Iterative.name:
            raise InputError(
                "adaptive: the residual of scheme iterative is that of its iteration and says nothing of the step; "
                "use auto or another scheme"
            )
        rigid = [
            m.name
            for m in assembly.stepping
            if not m.component.capabilities.variable_step and m.component.capabilities.fixed_step is None
        ]
        if rigid:
            raise InputError(
                f"adaptive: {', '.join(rigid)} cannot change the communication step during a run; leave adaptive out"
            )
        self.scheme, self.tolerance = scheme, tolerance
        self.name, self.lag, self.order = scheme.name, scheme.lag, scheme.order
        self.saves = all(m.component.capabilities.state for m in assembly.stepping)
        own = [s for m in assembly.stepping if (s := m.component.capabilities.fixed_step) is not None]
        self.allowed = [n for n in PARTS if all(is_multiple(step / n, s) for s in own)]
        self.parts = 1 if self.saves else max(n for n in self.allowed if n <= FIRST_UNSAVED)
        self.exchanges, self.smallest = 0, step
        self._residual = self._exchanged = 0.0
        self._steps = 0
        self._before: tuple[Values, float] | None = None

    @property
    def error(self) -> float | None:
        """The coupling error of the run so far, as in energy.residual but over the steps that were taken."""
        return self._residual / self._exchanged if self._exchanged else None

    def start(self, assembly: Assembly) -> None:
        self.scheme.start(assembly)

    def step(self, assembly: Assembly, time: float, step: float) -> None:
        states = [(m, m.instance.save_state()) for m in assembly.stepping] if self.saves else []
        bus, memory = assembly.bus.copy(), self.scheme.save()
        try:
            while True:
                n = self.parts
                residual, exchanged, last = self._divided(assembly, time, step, n)
                usual = self._exchanged / self._steps if self._steps else exchanged
                allowed = self.tolerance * 0.5 * (exchanged + usual)
                if not (residual > allowed and self.saves and n < self.allowed[-1]):
                    break
                self.parts = self._number(n, residual, allowed, least=n + 1)
                for member, state in states:
                    member.instance.restore_state(state)
                    member.inputs_set = False
                assembly.bus[:] = bus
                self.scheme.restore(memory)
        finally:
            for member, state in states:
                member.instance.free_state(state)
        self._before = last, step / n
        self._residual += residual
        self._exchanged += exchanged
        self._steps += 1
        self.exchanges, self.smallest = self.exchanges + n, min(self.smallest, step / n)
        self.parts = self._number(n, residual, allowed, least=(n + 1) // 2)

    def applied(self, exchange: Exchange) -> Values:
        return self.scheme.applied(exchange)

    def save(self) -> Any:
        counts = self.parts, self.exchanges, self.smallest
        return self.scheme.save(), counts, (self._residual, self._exchanged, self._steps, self._before)

    def restore(self, memory: Any) -> None:
        inner, (self.parts, self.exchanges, self.smallest), sums = memory
        self.scheme.restore(inner)
        self._residual, self._exchanged, self._steps, self._before = sums

    def _divided(self, assembly: Assembly, time: float, step: float, n: int) -> tuple[float, float, Values]:
        """Takes the step in `n` parts: its residual and exchanged energy [J], and the record before the last part."""
        rows: list[Values] = [assembly.record.copy()]
        sizes: list[float] = []
        if self._before is not None:
            rows, sizes = [self._before[0], *rows], [self._before[1]]
        for k in range(n):
            self.scheme.step(assembly, time + k * step / n, step / n)
            if assembly.recorder is not None:
                assembly.recorder.write_at(time + (k + 1) * step / n)
            rows.append(assembly.record.copy())
            sizes.append(step / n)
        found = shares(self.scheme, exchange(assembly, np.array(rows), np.array(sizes)))
        residual, exchanged = (float(f[-n:].sum()) for f in found) if found else (0.0, 0.0)
        return residual, exchanged, rows[-2]

    def _number(self, n: int, residual: float, allowed: float, least: int) -> int:
        """Parts that should do, from what `n` gave."""
        aim = (AIM if self.saves else AIM_UNSAVED) * allowed
        needed = n * (residual / aim) ** (1.0 / self.order) if aim > 0.0 else n
        return next((p for p in self.allowed if p >= max(least, needed)), self.allowed[-1])
