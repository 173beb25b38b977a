"""Samples that may stop as soon as they tell enough, however often one looks.

**Paired comparisons, until they are decided** (`decide`).

Looking at a 95 % interval fifty times and stopping when it excludes zero decides falsely in a third of all comparisons.
Here the error α is spent over the looks, α_k = α·6/(π²k²) at look k, which sums to α for any number of looks; at each
look Student's test of the paired differences is made at that level, by Holm's procedure over the pairs still undecided.
By the union bound a true null is rejected at any look with at most probability α, for normal differences.

**Intervals, until they are narrow** (`look_confidence`). A sample that stops when the interval of a probability is
narrow stops when the probability looks small, and misses more often than stated. So the interval of every look is one
of a set that holds at all planned looks together: repeated confidence intervals with the error spread evenly (Pocock's
boundary), from the joint law of the looks. Means, percentiles and probabilities of n rows are sums over independent
rows in the limit; between looks at m < n rows they have the correlation √(m/n), so that the looks are a Markov chain.

Sources: K. K. G. Lan, D. L. DeMets, Biometrika 70 (1983) 659-663 (spending); S. Holm, Scand. J. Stat. 6 (1979) 65-70;
C. Jennison, B. W. Turnbull, J. R. Stat. Soc. B 51 (1989) 305-361 (repeated intervals); S. J. Pocock, Biometrika 64
(1977) 191-199; P. Armitage, C. K. McPherson, B. C. Rowe, J. R. Stat. Soc. A 132 (1969) 235-244 (the joint law).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtr, ndtri, stdtr, stdtrit

from .distributions import Array
from .distributions.marginal import as_array
from .statistics import Estimate

__all__ = ["MIN_PAIRS", "Look", "PairDecision", "decide", "look_confidence", "planned_looks", "spent"]

MIN_PAIRS = 5
_NODES, _NODE_WEIGHTS = np.polynomial.legendre.leggauss(160)
_CLOSEST = 0.1  # SD between two looks at nearly the same rows, where the nodes would miss a smaller one: errs safely


def planned_looks(most: int, first: int) -> list[int]:
    """Numbers of rows at which one looks: `first`, then each half as many again, in whole tens, and `most` at last."""
    found, n = list[int](), first
    while n < most:
        found.append(n)
        n = max(n + 10, 10 * math.ceil(0.15 * n))
    return [*found, most]


def look_confidence(looks: Sequence[int], confidence: float = 0.95) -> float:
    """The confidence that each look's interval must have by itself for all of them to hold together with `confidence`,
    whatever makes one stop.

    looks   numbers of rows, ascending, planned beforehand

    Raises ValueError for looks out of order."""
    from scipy.optimize import brentq  # slow to import

    if not looks or looks[0] < 1 or any(later <= earlier for earlier, later in itertools.pairwise(looks)):
        raise ValueError(f"the looks must ascend, got {list(looks)}")
    most = float(ndtri(1.0 - 0.5 * (1.0 - confidence) / len(looks)))  # the union bound
    alone = float(ndtri(0.5 * (1.0 + confidence)))
    if most - alone < 1e-9:
        return confidence
    boundary = brentq(lambda c: _within(c, looks) - confidence, alone, most, xtol=1e-6)
    return 2.0 * float(ndtr(boundary)) - 1.0


def _within(boundary: float, looks: Sequence[int]) -> float:
    """P(|Z| ≤ boundary at every look), Z the standardised sums."""
    z = boundary * _NODES
    mass = boundary * _NODE_WEIGHTS * np.exp(-0.5 * z**2) / math.sqrt(2.0 * math.pi)
    for m, n in itertools.pairwise(looks):
        spread = max(math.sqrt(1.0 - m / n), _CLOSEST)
        slope = math.sqrt(1.0 - spread**2)
        steps = (z[:, np.newaxis] - slope * z) / spread
        mass = boundary * _NODE_WEIGHTS * (np.exp(-0.5 * steps**2) @ mass) / (spread * math.sqrt(2.0 * math.pi))
    return float(mass.sum())


def spent(look: int, alpha: float = 0.05) -> float:
    """The error that look number `look`, from 1, may spend."""
    if look < 1 or not 0 < alpha < 1:
        raise ValueError(f"a look counts from 1 and alpha lies between 0 and 1, got {look} and {alpha}")
    return alpha * 6.0 / (math.pi * look) ** 2


@dataclass(frozen=True)
class Look:
    """One look at one pair.

    n           differences seen that are numbers
    p_value     of Student's test that their mean is zero; 1 of fewer than 5
    level       what it was compared with
    difference  mean with its interval at that level, which holds for all looks together
    """

    n: int
    p_value: float
    level: float
    difference: Estimate


@dataclass(frozen=True)
class PairDecision:
    """`sign` 1 or −1 of the difference once decided, 0 while it is not; `looks` all that were made."""

    sign: int
    looks: tuple[Look, ...]

    @property
    def decided(self) -> bool:
        return self.sign != 0

    @property
    def n(self) -> int:
        """Differences that it took, or has taken so far."""
        return self.looks[-1].n if self.looks else 0


def decide(differences: Mapping[str, ArrayLike], looks: Sequence[int], alpha: float = 0.05) -> dict[str, PairDecision]:
    """Replay the looks at paired differences and say which pairs are decided, and when.

    differences  {pair: (n,) differences in the order of the trials}, NaN where a trial failed; all pairs have been
                 looked at alike
    looks        numbers of trials at which one looked, ascending, the first at least 5. They must not depend on
                 what was seen; add looks at the end as trials come in, and earlier decisions stand

    Raises ValueError for looks out of order, too early, or beyond the differences of a pair that is undecided.
    """
    values = {name: as_array(d) for name, d in differences.items()}
    if any(later <= earlier for earlier, later in itertools.pairwise(looks)):
        raise ValueError(f"the looks must ascend, got {list(looks)}")
    if looks and looks[0] < MIN_PAIRS:
        raise ValueError(f"the first look comes at {MIN_PAIRS} pairs or later, got {looks[0]}")
    signs, history = dict.fromkeys(values, 0), {name: list[Look]() for name in values}
    for number, n in enumerate(looks, 1):
        open_pairs = [name for name in values if not signs[name]]
        short = [name for name in open_pairs if len(values[name]) < n]
        if short:
            raise ValueError(f"{short[0]}: a look at {n} differences, of which there are {len(values[short[0]])}")
        samples = {name: _numbers(values[name][:n]) for name in open_pairs}
        p_values = {name: _p_value(sample) for name, sample in samples.items()}
        rejecting, level = True, 0.0
        for rank, name in enumerate(sorted(open_pairs, key=lambda k: p_values[k])):
            if rejecting:  # those behind the first that is not rejected are held against its level
                level = spent(number, alpha) / (len(open_pairs) - rank)
            sample = samples[name]
            rejecting = rejecting and p_values[name] <= level
            history[name].append(Look(len(sample), p_values[name], level, _interval(sample, level)))
            if rejecting:
                signs[name] = int(np.sign(sample.mean()))
    return {name: PairDecision(signs[name], tuple(history[name])) for name in values}


def _numbers(d: Array) -> Array:
    return d[np.isfinite(d)]


def _p_value(d: Array) -> float:
    if len(d) < MIN_PAIRS:
        return 1.0
    deviation = float(np.std(d, ddof=1))
    if deviation == 0.0:
        return 1.0 if float(np.mean(d)) == 0.0 else 0.0
    t = abs(float(np.mean(d))) / deviation * math.sqrt(len(d))
    return 2.0 * float(stdtr(len(d) - 1, -t))


def _interval(d: Array, level: float) -> Estimate:
    if len(d) < MIN_PAIRS:
        return Estimate(math.nan, math.nan, math.nan)
    half = float(stdtrit(len(d) - 1, 1.0 - 0.5 * level)) * float(np.std(d, ddof=1)) / math.sqrt(len(d))
    return Estimate(float(np.mean(d)), float(np.mean(d)) - half, float(np.mean(d)) + half)
