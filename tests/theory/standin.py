"""A stand-in for a landing: peak inversion from neutral [deg] over study 6's ten inputs and the brace's scale.

A polynomial of third degree fitted to 3800 landings of the shipped plant (48 terms of 286; it leaves 0.32°), and waves
of that size in place of what it leaves, so that no surrogate of low degree can be exact. Inputs are in the standard
space but for the last, the brace's angle scale itself.
"""

from __future__ import annotations

import numpy as np
from scipy.special import ndtr

from sprain_cosim.uq.distributions import Array, Normal

INPUTS = 9  # standard normal; the brace's scale comes last
STUDY6 = Normal(1.5, 0.0625)  # the brace's scale in study 6
TERMS = {
    (): 20.809, (0,): 1.243, (1,): 0.313, (2,): -0.086, (3,): -0.097, (4,): -0.272, (5,): 0.455, (6,): 1.04,
    (7,): -0.74, (9,): -3.517, (0, 0): -0.059, (0, 6): -0.181, (0, 9): -0.165, (1, 6): -0.048, (1, 9): -0.07,
    (2, 5): 0.07, (2, 6): -0.085, (2, 9): 0.115, (3, 6): -0.032, (3, 9): 0.066, (4, 6): 0.063, (4, 7): -0.046,
    (4, 9): 0.078, (5, 5): -0.147, (5, 6): 0.249, (6, 6): -0.227, (6, 7): 0.144, (6, 9): -0.76, (7, 7): -0.094,
    (7, 9): 0.101, (9, 9): -0.12, (0, 5, 6): -0.052, (0, 5, 9): -0.054, (0, 6, 9): 0.1, (0, 9, 9): -0.042,
    (2, 5, 9): -0.053, (2, 6, 9): 0.065, (5, 5, 6): 0.033, (5, 5, 9): 0.077, (5, 6, 6): -0.045, (5, 6, 7): 0.04,
    (5, 6, 9): -0.11, (5, 7, 9): 0.058, (5, 9, 9): -0.126, (6, 6, 6): -0.047, (6, 6, 9): 0.232, (6, 7, 9): -0.065,
    (6, 9, 9): 0.139, (9, 9, 9): 0.242,
}  # fmt: skip
WAVES = np.random.default_rng(6).standard_normal((3, 10)) * 0.3


def inversion(u: Array, scale: Array | float) -> Array:
    """(n,) peak inversion [deg] at u (n, 9), standard normal inputs, and the brace's scale (n,) or one."""
    v = np.column_stack([u, (np.broadcast_to(scale, len(u)) - 1.75) / 0.72])
    total = 0.26 * np.sum(np.sin(v @ WAVES.T + 1.0), axis=1)
    for factors, weight in TERMS.items():
        term = np.full(len(v), weight)
        for k in factors:
            term *= v[:, k]
        total += term
    return np.asarray(total, dtype=float)


def landing(x: Array) -> Array:
    """(n,) peak inversion [deg] at x (n, 10): nine standard normal inputs and the scale."""
    return inversion(x[:, :INPUTS], x[:, INPUTS])


MARGINALS = [*[Normal(0.0, 1.0)] * INPUTS, STUDY6]


def exceedance(threshold: float, scale: Array | float | None = None, n: int = 400_000, seed: int = 1) -> float:
    """P(inversion > threshold) by plain Monte Carlo; the scale as in study 6 unless one is given."""
    rng = np.random.default_rng(seed)
    u = rng.standard_normal((n, INPUTS))
    at = STUDY6.from_standard(rng.standard_normal(n)) if scale is None else scale
    return float(np.mean(inversion(u, at) > threshold))


def injury(scale: float | None = None, n: int = 200_000, seed: int = 1) -> float:
    """P(inversion > T) for T ~ N(35°, 6°)."""
    rng = np.random.default_rng(seed)
    u = rng.standard_normal((n, INPUTS))
    at = STUDY6.from_standard(rng.standard_normal(n)) if scale is None else scale
    return float(np.mean(ndtr((inversion(u, at) - 35.0) / 6.0)))
