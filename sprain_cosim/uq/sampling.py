"""Samples of a joint distribution: Monte Carlo, Latin hypercube, scrambled Sobol', full factorial.

Randomness enters as one integer seed. `Stream` names what a draw is for, so that no two uses of a seed share
numbers.

| Sample          | row i depends on              | enlarging keeps rows | interval of a percentile    |
|-----------------|-------------------------------|----------------------|-----------------------------|
| Monte Carlo     | seed, i                       | yes                  | order statistics            |
| Sobol'          | seed, i, number of replicates | yes                  | spread over the replicates  |
| Latin hypercube | seed, i, n                    | no                   | none                        |
| full factorial  | the levels                    | no                   | none                        |

A column takes its numbers by its position, never by its marginal: changing one marginal (a fixed value
included) that is correlated with no other leaves the other columns as they were.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from .distributions import JointDistribution

__all__ = [
    "Stream",
    "full_factorial",
    "generator",
    "latin_hypercube",
    "monte_carlo",
    "monte_carlo_blocks",
    "sobol",
]

Array = NDArray[np.float64]

_BLOCK = 65536  # rows drawn at a time


class Stream(IntEnum):
    """First entry of the spawn key of every seed sequence."""

    MONTE_CARLO = 0
    LATIN_HYPERCUBE = 1
    SOBOL = 2
    BOOTSTRAP = 3
    FIT = 4
    THRESHOLD = 5
    CHECK = 6
    RARE_EVENT = 7
    DESIGN = 8


def _sequence(seed: int, *key: int) -> np.random.SeedSequence:
    if seed < 0:
        raise ValueError(f"the seed must be zero or positive, got {seed}")
    return np.random.SeedSequence(seed, spawn_key=key)


def generator(seed: int, stream: Stream, item: int = 0) -> np.random.Generator:
    """The generator of one item of a stream."""
    return np.random.Generator(np.random.PCG64(_sequence(seed, stream, item)))


def _open_unit(raw: NDArray[np.uint64]) -> Array:
    """64 random bits to (0, 1), both ends excluded."""
    return ((raw >> np.uint64(11)).astype(float) + 0.5) * 2.0**-53


def monte_carlo(joint: JointDistribution, n: int, seed: int, first: int = 0) -> Array:
    """(n, d) independent rows number first … first + n − 1; row i comes from SeedSequence(seed, (0, i))."""
    _require_rows(n)
    d = len(joint)
    raw = np.empty((n, d), dtype=np.uint64)
    for row in range(n):
        raw[row] = np.random.PCG64(_sequence(seed, Stream.MONTE_CARLO, first + row)).random_raw(d)
    return joint.from_standard(ndtri(_open_unit(raw)))


def monte_carlo_blocks(joint: JointDistribution, n: int, seed: int) -> Iterator[tuple[int, Array]]:
    """The rows of `monte_carlo` as (number of the first row, block), in constant memory."""
    for first in range(0, n, _BLOCK):
        yield first, monte_carlo(joint, min(_BLOCK, n - first), seed, first)


def latin_hypercube(joint: JointDistribution, n: int, seed: int) -> Array:
    """(n, d) rows; each column has exactly one value in each of n intervals of equal probability."""
    _require_rows(n)
    p = np.empty((n, len(joint)))
    for column in range(len(joint)):
        rng = generator(seed, Stream.LATIN_HYPERCUBE, column)
        p[:, column] = (rng.permutation(n) + rng.uniform(size=n)) / n
    return joint.from_standard(ndtri(_inside(p)))


def sobol(joint: JointDistribution, n: int, seed: int, replicates: int = 8) -> Array:
    """(n, d) rows of `replicates` independently scrambled Sobol' sequences, taken in turn.

    Row i is point i // replicates of sequence i % replicates, so that every prefix is balanced over the
    sequences. n must be a multiple of `replicates`; n / replicates should be a power of two, which is where
    the sequence is balanced. The spread over the replicates gives intervals (at least 8 are needed for that).
    """
    from scipy.stats import qmc  # slow to import, used here alone

    _require_rows(n)
    if replicates < 1 or n % replicates:
        raise ValueError(f"{n} Sobol' points cannot be shared by {replicates} replicates evenly")
    points = n // replicates
    p = np.empty((n, len(joint)))
    for r in range(replicates):
        engine = qmc.Sobol(len(joint), scramble=True, bits=53, rng=generator(seed, Stream.SOBOL, r))
        # Whole powers of two are drawn, which a prefix does not notice, to spare the caller a warning on
        # balance.
        p[r::replicates] = engine.random_base2(max(points - 1, 0).bit_length())[:points]
    return joint.from_standard(ndtri(_inside(p)))


def full_factorial(levels: Sequence[Sequence[float]]) -> Array:
    """(n, d) all combinations of the levels of d inputs; the last input changes fastest."""
    if not levels or any(len(values) == 0 for values in levels):
        raise ValueError("a grid needs at least one value for every input")
    grids = np.meshgrid(*[np.asarray(values, dtype=float) for values in levels], indexing="ij")
    return np.stack([grid.ravel() for grid in grids], axis=1)


def _inside(p: Array) -> Array:
    """Keep probabilities off 0 and 1, where a normal value would be infinite."""
    return np.clip(p, 2.0**-54, 1.0 - 2.0**-53)


def _require_rows(n: int) -> None:
    if n < 1:
        raise ValueError(f"a sample needs at least one row, got {n}")
