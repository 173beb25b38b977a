"""How large the coupling error of a run is: the residual of the energy that a device and the plant exchange.

Over a communication step the plant moves by d(angle) under the torque that the scheme applied, while the device, at the
ends of the step, gave other torques. The residual is (mean torque applied - mean torque of the device) d(angle); its
sum of magnitudes over the run, as a share of the sum of the magnitudes exchanged, is the run's coupling error: 0 where
the applied torque was the device's all along. After the residual energy of S. Sadjina, L. T. Kyllingstad, S. Skjong, E.
Pedersen, Energy conservation and power bonds in co-simulations, Eng. Comput. 33 (2017) 607-620.

What a sampled device holds between its calls is its torque, so the plant feels it without an error; how old it becomes
is stated apart (result.Held)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

from ..contract import impedance_input, motion_output, torque_input
from .assembly import Assembly
from .layout import Layout, Slots

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
    site = _site(assembly.layout)
    if site is None:
        return None
    owners = [assembly.own_rate.get(name) for name in site.devices]
    lag = {member.name: member.lag for member in assembly.members}
    torque = site.torque.of(values)
    passed = Exchange(
        torque=torque,
        device=torque,
        angle=site.angle.of(values),
        velocity=site.velocity.of(values),
        stiffness=site.stiffness.of(values),
        damping=site.damping.of(values),
        steps=steps,
        held=np.array([own is not None and own.rate.sampled for own in owners]),
        lag=np.array([lag[name] for name in site.devices], dtype=np.intp),
    )
    carried = {k: own.member.name for k, own in enumerate(owners) if own is not None and not own.rate.sampled}
    return _with_calls(passed, carried, due or {}) if carried else passed


@dataclass(frozen=True, eq=False)
class _Columns:
    """Some columns of a record, in SI: slots, factor and offset to SI, and their places in an array of `shape` for each
    row, which is 0 elsewhere."""

    slots: Slots
    factor: Values
    offset: Values
    places: Slots
    shape: tuple[int, ...]

    @classmethod
    def named(cls, layout: Layout, names: Sequence[str], shape: tuple[int, ...]) -> Self:
        """Of these connectors, in the order of the array; names that there are not are 0."""
        places = [k for k, name in enumerate(names) if name in layout.index]
        slots = [layout.index[names[k]] for k in places]
        units = [layout.units[slot] for slot in slots]
        return cls(
            np.array(slots, dtype=np.intp),
            np.array([1.0 if unit is None else unit.factor for unit in units]),
            np.array([0.0 if unit is None else unit.offset for unit in units]),
            np.array(places, dtype=np.intp),
            shape,
        )

    def of(self, values: Values) -> Values:
        """(n, *shape) from a record (n, slots)."""
        found: Values = values.take(self.slots, axis=1)
        found *= self.factor
        found += self.offset
        if len(self.slots) < math.prod(self.shape):
            whole = np.zeros((len(values), math.prod(self.shape)))
            whole[:, self.places] = found
            found = whole
        return found.reshape(len(values), *self.shape)


@dataclass(frozen=True, eq=False)
class _Site:
    """Where on the bus devices and plant meet; `devices` their names, by axis."""

    devices: list[str]
    torque: _Columns
    angle: _Columns
    velocity: _Columns
    stiffness: _Columns
    damping: _Columns


@lru_cache(maxsize=16)
def _site(layout: Layout) -> _Site | None:
    axes = list(layout.torques)
    if not axes:
        return None
    d = len(axes)

    def impedances(kind: str) -> _Columns:
        return _Columns.named(layout, [impedance_input(a, b, kind) for a in axes for b in axes], (d, d))

    return _Site(
        [source.partition(".")[0] for source in layout.torques.values()],
        _Columns.named(layout, [torque_input(a) for a in axes], (d,)),
        _Columns.named(layout, [motion_output(a, "stiffness") for a in axes], (d,)),
        _Columns.named(layout, [motion_output(a, "damping") for a in axes], (d,)),
        impedances("stiffness"),
        impedances("damping"),
    )


def row_changes(values: Values) -> Values:
    """From each row to the next; np.diff takes longer to begin than to do it."""
    found: Values = values[1:] - values[:-1]
    return found


def handed_over(passed: Exchange) -> Values:
    """(n - 1, axes) change of each torque over each step by stiffness and damping."""
    turned, quickened = row_changes(passed.angle), row_changes(passed.velocity)
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
    moved = row_changes(passed.angle)
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
