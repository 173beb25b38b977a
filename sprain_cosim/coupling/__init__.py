"""Coupling schemes: how the components exchange values over one communication step. One file per scheme."""

from __future__ import annotations

from typing import Protocol

from ..errors import InputError, nearest
from ..system import Assembly
from .gauss_seidel import GaussSeidel
from .impedance import Impedance


class Scheme(Protocol):
    """`start` runs once before initialisation. `step` takes the assembly from consistent values at `time` to consistent values at
    `time + step` [s], inputs transferred. A scheme may keep memory of a run; every run makes a new one."""

    name: str

    def start(self, assembly: Assembly) -> None: ...

    def step(self, assembly: Assembly, time: float, step: float) -> None: ...


SCHEMES = {"auto": Impedance, "gauss-seidel": GaussSeidel, "impedance": Impedance}


def scheme(name: str) -> Scheme:
    """Raises InputError for an unknown name."""
    if name not in SCHEMES:
        raise InputError(f"scheme {name!r} is unknown{nearest(name, SCHEMES)}")
    return SCHEMES[name]()
