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
STANCE = 0.15  # s after the fall over which the foot stands


@dataclass(frozen=True)
class FirstContact:
    """When the foot touches.

    - at: [s]
    - how: a sentence
    - level: [m] the height of the sole at which it stands; None where it was not needed
    """

    at: float
    how: str
    level: float | None = None


def sole_heights(scenario: Scenario, rows: Sequence[Mapping[str, float]]) -> Array:
    """(n,) [m] of the lowest point of the sole over the scenario's platform, along the vertical; `rows` are the plant's
    parameters of each instant. Raises SimulationError."""
    bare = scenario.override("plant.initial_pose", "touching").recording("plant.pelvis_ty")
    for name in tuple(bare.fmus):
        bare = bare.without(name) if name != "plant" else bare
    heights = np.empty(len(rows))
    with bare.with_master(stop="0.5 ms", communication_step="0.5 ms").open() as session:
        for k, row in enumerate(rows):
            result = session.run(row)
            if result.status != "completed":
                raise SimulationError(result.message)
            heights[k] = row["plant.pelvis_ty_at_contact"] - result["plant.pelvis_ty"][0]
    return heights


def first_contact(time: Array, heights: Array) -> FirstContact:
    """The last row before the sole comes down to the level at which it stands afterwards. `heights`: (n,) [m] of the
    sole over a level floor. Raises InputError where no landing is seen."""
    rate = np.gradient(heights, time) if len(time) > 2 else np.zeros(len(time))
    falling = int(np.argmin(rate))
    if rate[falling] > -FALL:
        raise InputError(
            f"no landing is seen: the foot never comes down faster than {FALL:g} m/s (most: {-rate[falling]:.2g}); say "
            "the instant with --at"
        )
    fast = rate < 0.5 * rate[falling]
    first = int(np.argmax(fast))  # of the first fall that is as fast as half the fastest
    end = first + int(np.argmax(rate[first:] > 0.2 * rate[falling]))
    stance = (time > time[end]) & (time <= time[end] + STANCE)
    if end == first or stance.sum() < 3:
        raise InputError("the file ends before the foot stands; say the instant with --at")
    level = float(np.median(heights[stance]))
    down = first + int(np.argmax(heights[first:] <= level))
    k = max(down - 1, 0)
    step = 1e3 * float(time[min(k + 1, len(time) - 1)] - time[k])
    return FirstContact(
        float(time[k]),
        f"found: the last row before the sole comes down to the level ({1e3 * level:.0f} mm in the file's height) at "
        f"which it stands in the {1e3 * STANCE:.0f} ms after the fall; the foot touches within the {step:.3g} ms that "
        "follow",
        level,
    )
