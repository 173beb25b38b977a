"""Where the foot is over the course of a motion, and when it first touches: the plant itself says at which height its
sole would touch (`initial_pose = touching`)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, SimulationError
from ..scenario import Scenario

Array = NDArray[np.float64]
TOUCH = 1e-4  # m, within which the first row stands on the platform: as much as the plant forgives
FALL = 0.5  # m/s, slower than which no foot comes down from a jump or a step
WINDOW = 0.01  # s over which the speed of the sole is taken, or one row
UNBRAKED, BRAKED = 0.8, 0.2  # of the fastest: still falling, standing
FASTER = 1.25  # times the fall that was taken: one that rather is the landing


@dataclass(frozen=True)
class FirstContact:
    """When [s] the foot touches, a sentence about how that is known, and what speaks for another instant."""

    at: float
    how: str
    doubts: tuple[str, ...] = ()


def sole_heights(scenario: Scenario, rows: Sequence[Mapping[str, float]]) -> Array:
    """(n,) [m] of the lowest point of the sole over the scenario's platform, along the vertical; `rows` are the plant's
    parameters of each instant. Raises SimulationError."""
    bare = scenario.override("plant.initial_pose", "touching").recording("plant.pelvis_ty")
    for name in tuple(bare.fmus):
        bare = bare.without(name) if name != "plant" else bare
    heights = np.empty(len(rows))
    with bare.with_master(stop="0.5 ms", communication_step="0.5 ms").open() as session:
        for k, row in enumerate(rows):
            try:
                result = session.run(row)
            except InputError as problem:  # a pose outside what the plant takes
                raise SimulationError(str(problem)) from None
            if result.status != "completed":
                raise SimulationError(result.message)
            heights[k] = row["plant.pelvis_ty_at_contact"] - result["plant.pelvis_ty"][0]
    return heights


def first_contact(time: Array, heights: Array) -> FirstContact:
    """The last row at which the sole still comes down unbraked, of the first fall that is half as fast as the fastest.
    `heights`: (n,) [m] of the sole over a level floor: only their change counts, so that the size of the person and
    the place of the floor do not. Raises InputError where no landing is seen."""
    if len(time) < 3:
        raise InputError(f"{len(time)} rows do not show a landing; say the instant with --at")
    row = float(time[-1] - time[0]) / (len(time) - 1)
    back = max(1, round(WINDOW / row))
    rate = np.zeros(len(time))
    rate[back:] = (heights[back:] - heights[:-back]) / (time[back:] - time[:-back])
    fastest = float(rate.min())
    if fastest > -FALL:
        raise InputError(
            f"no landing is seen: the foot never comes down faster than {FALL:g} m/s (most: {-fastest:.2g}); say the "
            "instant with --at"
        )
    start = int(np.argmax(rate < 0.5 * fastest))
    after = np.flatnonzero(rate[start:] > BRAKED * fastest)
    if not len(after):
        raise InputError("the file ends before the foot stands; say the instant with --at")
    stands = start + int(after[0])
    fall = rate[start:stands]
    k = start + int(np.flatnonzero(fall <= UNBRAKED * fall.min())[-1])
    doubts = []
    if k <= 2 * back:
        doubts.append(
            "the file begins just before the instant that was found: the foot may touch already in its first row"
        )
    later = stands + int(np.argmin(rate[stands:]))
    if rate[later] < FASTER * fall.min():
        doubts.append(
            f"the sole comes down faster later ({-rate[later]:z.2f} m/s at {time[later]:.4g} s against "
            f"{-fall.min():z.2f} m/s): if that is the landing, say the instant with --at"
        )
    return FirstContact(
        float(time[k]),
        f"found: the last row at which the sole comes down unbraked (with {100 * UNBRAKED:g} % of its fastest "
        f"{-fall.min():z.2f} m/s or more); the foot touches within about {1e3 * max(row, WINDOW):.0f} ms of it",
        tuple(doubts),
    )
