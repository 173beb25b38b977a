"""Landings in one process, without FMI: the plant's kernels with a reflex controller of a few lines. An independent
check of what the FMUs do, and ten times faster to loop over."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from fmus.plant.interface import OUTPUTS
from fmus.plant.plant import Landing, Plant
from tools.reference import foot_surface

COLUMN = {name: k for k, name in enumerate(OUTPUTS)}
INVERTOR_RATIO = 0.9322


@lru_cache(maxsize=4)
def plant(own_sole: bool = True) -> Plant:
    return Plant() if own_sole else Plant(foot_surface())


def land(
    landing: Landing,
    coactivation: float = 0.0,
    gain: float = 0.0,
    delay: float = 0.060,
    invertor_ratio: float = INVERTOR_RATIO,
    stop: float = 0.150,
    step: float = 5e-4,
    every: int = 1,
    on: Plant | None = None,
    probe=None,
) -> np.ndarray:
    """(n, outputs) at multiples of `every` steps, t = 0 included. `probe(plant)` is called at the same instants."""
    p = on or plant()
    base = coactivation * np.array([1.0] * 4 + [invertor_ratio] * 4)
    p.state["excitation"] = base
    p.start(landing)
    stretch = slice(COLUMN["ext_dig_stretch_velocity"], COLUMN["tib_post_stretch_velocity"] + 1)
    count = round(stop / step)
    history, rows = np.zeros((count + 1, 8)), []
    for k in range(count + 1):
        out = p.observe()
        history[k] = np.maximum(0.0, out[stretch])
        if gain:
            back = min(k - delay / step + 0.5, float(k))  # the middle of the step over which the excitation is held
            low = math.floor(back + 1e-9)
            delayed = history[low] + (back - low) * (history[min(low + 1, k)] - history[low]) if back > -1e-9 else 0.0
            p.state["excitation"] = base + gain * delayed
            out = p.observe()
        if k % every == 0:
            rows.append(out.copy())
            if probe:
                probe(p)
        if k < count:
            p.advance((k + 1) * step)
    return np.array(rows)


def scale(shift: float) -> float:
    """Angle scale of the published records' shift: 1 + s for s >= 0, 1/(1 - s) below."""
    return 1.0 + shift if shift >= 0 else 1.0 / (1.0 - shift)
