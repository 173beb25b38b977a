"""How large the coupling error of a run is: the residual of the energy that a device and the plant exchange.

Over a communication step the plant moves by d(angle) under the torque that the scheme applied, while the device, at the
ends of the step, gave other torques. The residual is (mean torque applied - mean torque of the device) d(angle); its
sum of magnitudes over the run, as a share of the sum of the magnitudes exchanged, is the run's coupling error: 0 where
the applied torque was the device's all along. After the residual energy of S. Sadjina, L. T. Kyllingstad, S. Skjong, E.
Pedersen, Energy conservation and power bonds in co-simulations, Eng. Comput. 33 (2017) 607-620."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..contract import MOTION, impedance_input, motion_output, torque_input
from .assembly import Assembly

Values = NDArray[np.float64]


@dataclass(frozen=True)
class Exchange:
    """What passed between devices and plant at n communication points, SI.

    torque             (n, axes) of the devices on the foot
    angle, velocity    (n, axes) of the plant
    stiffness, damping (n, axes, axes) as handed over; zeros otherwise
    steps              (n - 1,) distances of the points, in any unit
    """

    torque: Values
    angle: Values
    velocity: Values
    stiffness: Values
    damping: Values
    steps: Values


class Applies(Protocol):
    """What `shares` asks of a coupling scheme (schemes/protocol.py)."""

    lag: int

    def applied(self, exchange: Exchange) -> Values: ...


def exchange(assembly: Assembly, values: Values, steps: Values | None = None) -> Exchange | None:
    """From a record (n, slots) of the assembly's bus at points `steps` (n - 1,) apart (equal ones if left out); None
    without a device that gives a torque about an axis of the plant."""
    axes = list(assembly.system.torques)
    if not axes:
        return None

    def column(name: str) -> Values:
        unit = assembly.units[assembly.index[name]]
        raw = values[:, assembly.index[name]]
        return raw if unit is None else unit.factor * raw + unit.offset

    def columns(names: Iterable[str]) -> Values:
        return np.stack([column(name) for name in names], axis=1)

    n, d = len(values), len(axes)
    matrices = {kind: np.zeros((n, d, d)) for kind in MOTION}
    for kind, matrix in matrices.items():
        for i, a in enumerate(axes):
            for j, b in enumerate(axes):
                name = impedance_input(a, b, kind)
                if name in assembly.index:
                    matrix[:, i, j] = column(name)
    return Exchange(
        columns(torque_input(a) for a in axes),
        columns(motion_output(a, "stiffness") for a in axes),
        columns(motion_output(a, "damping") for a in axes),
        matrices["stiffness"],
        matrices["damping"],
        np.ones(n - 1) if steps is None else steps,
    )


def shares(scheme: Applies, passed: Exchange | None) -> tuple[Values, Values] | None:
    """Residual and exchanged energy [J] of each step, both (n - 1,) magnitudes."""
    if passed is None or len(passed.torque) < 2:
        return None
    moved = np.diff(passed.angle, axis=0)
    device = passed.torque
    if scheme.lag:  # the last ones are not known yet: straight on
        slope = passed.torque[-1] - passed.torque[-2]
        device = np.vstack(
            [passed.torque[scheme.lag :], [passed.torque[-1] + (k + 1) * slope for k in range(scheme.lag)]]
        )
    mean = 0.5 * (device[1:] + device[:-1])
    return np.abs(((scheme.applied(passed) - mean) * moved).sum(axis=1)), np.abs(mean * moved).sum(axis=1)


def residual(scheme: Applies, passed: Exchange | None) -> float | None:
    """The coupling error, a share of the energy exchanged; None where nothing was."""
    found = shares(scheme, passed)
    if found is None or not found[1].any():
        return None
    return float(found[0].sum()) / float(found[1].sum())
