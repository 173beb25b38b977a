"""How large the coupling error of a run is: the residual of the energy that a device and the plant exchange.

Over a communication step the plant moves by d(angle) under the torque that the scheme applied, while the device, at the
ends of the step, gave other torques. The residual is (mean torque applied - mean torque of the device) d(angle); its
sum of magnitudes over the run, as a share of the sum of the magnitudes exchanged, is the run's coupling error: 0 where
the applied torque was the device's all along. After the residual energy of S. Sadjina, L. T. Kyllingstad, S. Skjong, E.
Pedersen, Energy conservation and power bonds in co-simulations, Eng. Comput. 33 (2017) 607-620.

What a sampled device holds between its calls is its torque, so the plant feels it without an error; how old it becomes
is stated apart (result.Held)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..contract import impedance_input, motion_output, torque_input
from .assembly import Assembly

Values = NDArray[np.floating]


@dataclass(frozen=True)
class Exchange:
    """What passed between devices and plant at n communication points, SI.

    torque             (n, axes) of the devices on the foot, as the plant was given it
    device             (n, axes) as the devices themselves give it
    angle, velocity    (n, axes) of the plant
    stiffness, damping (n, axes, axes) as handed over; zeros otherwise
    steps              (n - 1,) distances of the points, in any unit
    held               (axes,) about which a sampled device holds its torque
    lag                (axes,) by how many steps a device's torque is behind the angle recorded with it
    """

    torque: Values
    device: Values
    angle: Values
    velocity: Values
    stiffness: Values
    damping: Values
    steps: Values
    held: NDArray[np.bool_]
    lag: NDArray[np.intp]


class Applies(Protocol):
    """What `shares` asks of a coupling scheme (schemes/protocol.py)."""

    lag: int

    def applied(self, exchange: Exchange) -> Values: ...


def exchange(
    assembly: Assembly, values: Values, steps: Values, due: Mapping[int, Sequence[str]] | None = None
) -> Exchange | None:
    """From a record (n, slots) of the assembly's bus at points `steps` (n - 1,) apart, at which members with a rate of
    their own were `due`; None without a device that gives a torque about an axis of the plant."""
    axes = list(assembly.system.torques)
    if not axes:
        return None

    def columns(names: Iterable[str]) -> Values:
        return np.stack([_column(assembly, values, name) for name in names], axis=1)

    names = [source.partition(".")[0] for source in assembly.system.torques.values()]
    owners = [assembly.own_rate.get(name) for name in names]
    lag = {member.name: member.lag for member in assembly.members}
    torque = columns(torque_input(a) for a in axes)
    passed = Exchange(
        torque=torque,
        device=torque,
        angle=columns(motion_output(a, "stiffness") for a in axes),
        velocity=columns(motion_output(a, "damping") for a in axes),
        stiffness=_impedances(assembly, values, "stiffness"),
        damping=_impedances(assembly, values, "damping"),
        steps=steps,
        held=np.array([own is not None and own.rate.sampled for own in owners]),
        lag=np.array([lag[name] for name in names], dtype=np.intp),
    )
    carried = {k: own.member.name for k, own in enumerate(owners) if own is not None and not own.rate.sampled}
    return _with_calls(passed, carried, due or {}) if carried else passed


def _column(assembly: Assembly, values: Values, name: str) -> Values:
    """(n,) of a connector, SI."""
    unit = assembly.units[assembly.index[name]]
    raw = values[:, assembly.index[name]]
    return raw if unit is None else unit.factor * raw + unit.offset


def _impedances(assembly: Assembly, values: Values, kind: str) -> Values:
    """(n, d, d) stiffness or damping on the plant's inputs, SI."""
    axes = list(assembly.system.torques)
    matrix = np.zeros((len(values), len(axes), len(axes)))
    for i, a in enumerate(axes):
        for j, b in enumerate(axes):
            name = impedance_input(a, b, kind)
            if name in assembly.index:
                matrix[:, i, j] = _column(assembly, values, name)
    return matrix


def handed_over(passed: Exchange) -> Values:
    """(n - 1, axes) change of each torque over each step by stiffness and damping."""
    turned, quickened = np.diff(passed.angle, axis=0), np.diff(passed.velocity, axis=0)
    change: Values = np.einsum("nij,nj->ni", passed.stiffness[:-1], turned)
    change += np.einsum("nij,nj->ni", passed.damping[:-1], quickened)
    return -change


def _with_calls(passed: Exchange, carried: Mapping[int, str], due: Mapping[int, Sequence[str]]) -> Exchange:
    """Torques that are carried on between the calls of a device miss its own by what shows at the next call: the
    device's torque in between is taken to leave them in proportion to time."""
    time = np.concatenate([[0.0], np.cumsum(passed.steps)])
    device, change = passed.device.copy(), handed_over(passed)
    for axis, name in carried.items():
        last = 0
        for point in sorted(k for k, names in due.items() if name in names and k < len(time)):
            missed = passed.torque[point, axis] - (passed.torque[point - 1, axis] + change[point - 1, axis])
            span = slice(last + 1, point)
            device[span, axis] += missed * (time[span] - time[last]) / (time[point] - time[last])
            last = point
    return replace(passed, device=device)


def shares(scheme: Applies, passed: Exchange | None) -> tuple[Values, Values] | None:
    """Residual and exchanged energy [J] of each step, both (n - 1,) magnitudes."""
    if passed is None or len(passed.torque) < 2:
        return None
    moved = np.diff(passed.angle, axis=0)
    device = passed.device.copy()
    for axis, lag in enumerate((passed.lag + scheme.lag).tolist()):
        if lag:  # the last ones are not known yet: straight on
            late = passed.device[:, axis]
            ahead = late[-1] + np.arange(1, lag + 1) * (late[-1] - late[-2])
            device[:, axis] = np.concatenate([late, ahead])[lag:]
    mean, applied = 0.5 * (device[1:] + device[:-1]), scheme.applied(passed)
    if passed.held.any():
        for torque in (mean, applied):
            torque[:, passed.held] = passed.torque[:-1, passed.held]
    return np.abs(((applied - mean) * moved).sum(axis=1)), np.abs(mean * moved).sum(axis=1)


def residual(scheme: Applies, passed: Exchange | None) -> float | None:
    """The coupling error, a share of the energy exchanged; None where nothing was."""
    found = shares(scheme, passed)
    if found is None or not found[1].any():
        return None
    return float(found[0].sum()) / float(found[1].sum())
