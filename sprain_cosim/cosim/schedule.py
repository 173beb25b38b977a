"""When who is called: the rates of the components, the points of time at which they exchange values, and those at which
the run is recorded.

A component without a step of its own takes every step. One with a fixed step is called at its own rate: a *sampled*
one, and its outputs are held in between, because that is what the FMU does; a *continuous* one (the mapping file says
so: its law is continuous in truth, its exporter knows fixed steps only) takes several of its steps within one
communication step where they fit into it, and is otherwise called at its own rate, its torque carried on by its
stiffness and damping in between. Sampled at less than FINEST nothing can be told from continuous.

Values are exchanged at the communication points and wherever a component with a rate of its own is due. The record lies
on the smaller of the communication step and RECORD, whatever the components can do, so that no metric depends on a
device's rate."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from ..contract import PLANT
from ..errors import InputError
from ..fmu.element import Element, Same

RECORD = 5e-4  # s
FINEST = 5e-5  # s
SAME = 1e-6  # of the communication step: points of time that are nearer are one

MAX_POINTS = 10_000_000

Times = NDArray[np.floating]


@dataclass(frozen=True)
class Rate:
    """Of a component that is called at a rate of its own: every `period` [s]; `sampled`: its outputs are held in
    between."""

    period: float
    sampled: bool


@dataclass(frozen=True)
class Schedule:
    """Of one run.

    rates   {component: Rate} of those with a rate of their own
    time    (n + 1,) [s] the points at which values are exchanged, start and stop included
    step    (n,) [s] between them
    due     {point: names of the components that are due there}
    record  (m + 1,) [s] the points of the record, start and stop included
    row     (n + 1,) the record's row at each point; -1 where it has none
    """

    rates: Mapping[str, Rate]
    time: Times
    step: Times
    due: Mapping[int, tuple[str, ...]]
    record: Times
    row: NDArray[np.intp]

    @cached_property
    def regular(self) -> bool:
        """Every point of the record is a point of exchange, and the other way round."""
        return len(self.record) == len(self.time) and bool((self.row >= 0).all())

    @cached_property
    def near(self) -> float:
        """[s] Points of time that are nearer are one."""
        return SAME * float(self.step.max())

    @cached_property
    def between(self) -> tuple[Times, NDArray[np.intp]]:
        """Times [s] and rows of the points of the record that are none of exchange."""
        between = np.ones(len(self.record), dtype=bool)
        between[self.row[self.row >= 0]] = False
        return self.record[between], np.flatnonzero(between)


def schedule(components: Iterable[Element], start: float, step: float, steps: int) -> Schedule:
    """For `steps` communication steps of `step` [s], made once. Raises InputError where the plant cannot stop at a
    device's times."""
    return _schedule(tuple(map(Same, components)), start, step, steps)


@lru_cache(maxsize=16)
def _schedule(parts: tuple[Same, ...], start: float, step: float, steps: int) -> Schedule:
    components = [same.element for same in parts]
    rates = own_rates(components, step)
    plant = next((c for c in components if c.name == PLANT), None)
    fine = _record_step(plant) or step
    near, stop = SAME * step, start + step * steps
    points = start + step * np.arange(steps + 1)
    record = points if step <= fine * (1.0 + 1e-9) else _multiples(start, fine, stop, near)
    time, size, due = points, np.full(steps, step), dict[int, tuple[str, ...]]()
    if rates:
        time, due = _with_calls(points, rates, near)
        size = np.diff(time)
        regular = np.abs(size - step) <= near
        size[regular] = step
        if plant is not None and not _free(plant) and not regular.all():
            raise InputError(_off_the_grid(plant, rates, step))
    at = _nearest(time, record)
    here = np.abs(time[at] - record) <= near
    row = np.full(len(time), -1, dtype=np.intp)
    row[at[here]] = np.flatnonzero(here)
    for array in (time, size, record, row):
        array.flags.writeable = False  # kept for other runs
    return Schedule(rates, time, size, due, record, row)


def _with_calls(points: Times, rates: Mapping[str, Rate], near: float) -> tuple[Times, dict[int, tuple[str, ...]]]:
    """The points of time at which values are exchanged, and who is due at which of them."""
    start, span = points[0], points[-1] - points[0]
    calls = {n: start + rate.period * np.arange(1, _count(rate.period, span) + 1) for n, rate in rates.items()}
    if len(points) + sum(map(len, calls.values())) > MAX_POINTS:
        names = ", ".join(f"{n} every {1e3 * rate.period:g} ms" for n, rate in rates.items())
        raise InputError(f"{names}: too many calls until the stop; at most 10 000 000 exchanges")
    time = _merged(points, list(calls.values()), near)
    found: dict[int, list[str]] = {}
    for name, times in calls.items():
        for k in _nearest(time, times).tolist():
            found.setdefault(k, []).append(name)
    return time, {k: tuple(names) for k, names in found.items()}


def own_rates(components: Sequence[Element], step: float) -> dict[str, Rate]:
    """{component: Rate} at a communication step [s]; components that take every step are left out."""
    rates: dict[str, Rate] = {}
    nested: list[Element] = []
    for component in components:
        able = component.capabilities
        if component.name == PLANT or able.fixed_step is None:
            continue
        sampled = not able.continuous and able.fixed_step > FINEST * (1.0 + 1e-9)
        if sampled or not is_multiple(step, able.fixed_step):
            rates[component.name] = Rate(able.fixed_step, sampled)
        else:
            nested.append(component)
    if any(not is_multiple(rate.period, step) for rate in rates.values()):  # the points of exchange are not regular
        rigid = [c for c in components if c.capabilities.fixed_step is None and not c.capabilities.variable_step]
        rates |= {c.name: Rate(c.capabilities.fixed_step, False) for c in nested if c.capabilities.fixed_step}
        rates |= {c.name: Rate(step, False) for c in rigid if c.name != PLANT}
    return rates


def is_multiple(step: float, of: float) -> bool:
    """Whether `step` is a whole number of steps `of`, one or more."""
    ratio = step / of
    return ratio > 0.999 and abs(ratio - round(ratio)) <= 1e-6 * ratio


def _record_step(plant: Element | None) -> float | None:
    """The largest step [s] of the record on which this plant can stop; None where it is the communication step."""
    if plant is None or (not plant.capabilities.variable_step and plant.capabilities.fixed_step is None):
        return None
    own = plant.capabilities.fixed_step
    return own * max(1, math.floor(RECORD / own * (1.0 + 1e-9))) if own else RECORD


def _free(component: Element) -> bool:
    """It can take a step of any length."""
    return component.capabilities.fixed_step is None and component.capabilities.variable_step


def _count(period: float, span: float) -> int:
    return math.floor(span / period * (1.0 + 1e-9))


def _multiples(start: float, period: float, stop: float, near: float) -> Times:
    """Start, the multiples of the period, and the stop."""
    times = start + period * np.arange(_count(period, stop - start) + 1)
    return times if stop - times[-1] <= near else np.append(times, stop)


def _merged(first: Times, others: Sequence[Times], near: float) -> Times:
    """Sorted; of times that are `near` each other one stays, that of `first` where it has one."""
    rest = np.sort(np.concatenate(others))
    rest = rest[np.abs(first[_nearest(first, rest)] - rest) > near]
    rest = rest[np.concatenate([[True], np.diff(rest) > near])] if len(rest) else rest
    return np.sort(np.concatenate([first, rest]))


def _nearest(times: Times, targets: Times) -> NDArray[np.intp]:
    """Of each `wanted`, the position of the nearest in `times`, both sorted."""
    right = np.clip(np.searchsorted(times, targets), 1, len(times) - 1)
    return right - (targets - times[right - 1] < times[right] - targets)


def _off_the_grid(plant: Element, rates: Mapping[str, Rate], step: float) -> str:
    names = ", ".join(f"{n} every {1e3 * r.period:g} ms" for n, r in rates.items() if not is_multiple(r.period, step))
    return (
        f"{plant.name} takes only steps of {1e3 * step:g} ms, but {names} is due between them; take a communication "
        "step that divides both"
    )
