"""What a coupling scheme is: how the components exchange values over one communication step. One file per scheme."""

from __future__ import annotations

from typing import Any, Protocol

from ..assembly import Assembly
from ..energy import Exchange, Values


class Scheme(Protocol):
    """One object for one run. Order of the calls: start - (step, or save - step - restore)*.

    name   as users write it
    lag    by how many steps a device's recorded torque is behind the angle recorded with it
    order  of convergence for a smooth device
    """

    name: str
    lag: int
    order: int

    def start(self, assembly: Assembly) -> None:
        """Once, on an assembly that has started; its values are consistent before and after."""
        ...

    def step(self, assembly: Assembly, time: float, step: float) -> None:
        """From consistent values at `time` to consistent values at `time + step` [s], inputs transferred. Raises
        SimulationError."""
        ...

    def applied(self, exchange: Exchange) -> Values:
        """Mean torque (n - 1, axes) [N.m] that the scheme let the plant apply over each step."""
        ...

    def save(self) -> Any:
        """The scheme's memory of the run, for `restore`; the components' states and the bus are the caller's."""
        ...

    def restore(self, memory: Any) -> None:
        """Undoes the steps since the `save` that gave `memory`."""
        ...
