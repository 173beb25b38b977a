"""Coupling schemes: how the components exchange values over one communication step. One file per scheme."""

from __future__ import annotations

from typing import Protocol

from ..errors import InputError, nearest
from ..system import Assembly, System
from .energy import Exchange, exchange, residual
from .extrapolated import Extrapolated
from .gauss_seidel import GaussSeidel
from .guard import verdict
from .impedance import Impedance
from .iterative import Iterative
from .jacobi import Jacobi

__all__ = ["SCHEMES", "Scheme", "check_scheme", "exchange", "residual", "scheme", "verdict"]


class Scheme(Protocol):
    """`start` runs once before initialisation. `step` takes the assembly from consistent values at `time` to consistent values at
    `time + step` [s], inputs transferred. `applied` says which torque it let the plant apply over each step, `lag`
    by how many steps a recorded device torque is behind. A scheme may keep memory of a run;
    every run makes a new one."""

    name: str
    lag: int

    def start(self, assembly: Assembly) -> None: ...

    def step(self, assembly: Assembly, time: float, step: float) -> None: ...

    def applied(self, exchange: Exchange) -> Exchange.Torques: ...


SCHEMES: dict[str, type[Scheme]] = {s.name: s for s in (Jacobi, GaussSeidel, Extrapolated, Iterative, Impedance)}


def check_scheme(name: str) -> None:
    """Raises InputError for an unknown name."""
    known = ["auto", *SCHEMES]
    if name not in known:
        raise InputError(f"scheme {name!r} is unknown{nearest(name, known)}")


def scheme(name: str, system: System) -> tuple[Scheme, str]:
    """The scheme of that name and why it was taken. `auto`: impedance hand-over where a device declares stiffness or damping, else Gauss-Seidel."""
    check_scheme(name)
    if name != "auto":
        return SCHEMES[name](), "asked for"
    handed_over = system.handed_over
    if handed_over:
        return Impedance(), f"the device declares {', '.join(sorted({system.connections[t] for t in handed_over}))}"
    return GaussSeidel(), "no device declares stiffness or damping"
