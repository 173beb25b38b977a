"""P(Y > T) with its two doubts apart: what the sample of Y leaves open, and what is not known of the threshold T.

They are never averaged into one number: more trials narrow the first alone, more specimens the second alone. A
threshold is one of

    a number      known
    a Marginal    varies from person to person by a law that is taken as known
    Measured      such a law, estimated from n specimens
    Bounds        somewhere between two ends, with no law between them
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from .distributions import Array, LogNormal, Marginal, Normal, Weibull
from .distributions.marginal import as_array
from .measured import Measured
from .statistics import Estimate, clopper_pearson, exceedance

__all__ = [
    "SHAPES",
    "Bounds",
    "Exceedance",
    "ExceedanceCurve",
    "Threshold",
    "doubted_exceedance",
    "exceedance_curve",
    "input_interval",
    "of_shapes",
    "threshold_interval",
    "weighted_exceedance",
]

SHAPES: Mapping[str, Callable[[float, float], Marginal]] = {
    "normal": Normal,
    "lognormal": LogNormal,
    "weibull": Weibull,
}

_DOMINATES = 2.0  # times as wide
_ROWS = 2_000  # rows of the outer loop; a larger sample enters it as means of neighbours
_EFFECTIVE = 30.0  # rows that a reweighted sample must be worth


@dataclass(frozen=True)
class Bounds:
    """A threshold of which only the ends are known."""

    low: float
    high: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.low) and math.isfinite(self.high)):
            raise ValueError(f"bounds must be finite, got {self.low} and {self.high}")
        if self.low >= self.high:
            raise ValueError(f"bounds: low must be below high, got {self.low} and {self.high}")


Threshold = float | Marginal | Measured | Bounds
Dominance = Literal["sampling", "threshold", "both", "failures", "none"]
Sampler = Callable[[float | Marginal], Estimate]


@dataclass(frozen=True)
class Exceedance:
    """P(Y > T) and its doubts.

    value       at the stated threshold; NaN for bounds, which state none
    sampling    its interval from the finite sample of Y, the threshold's law held; for bounds: of the larger end
    threshold   its interval from the doubt about the threshold, the sample held; the ends' values for bounds; None for
                a number and for a law without a number of specimens behind it
    shapes      value with the threshold's mean and SD in another law, {"normal": …, "lognormal": …, "weibull": …} as
                far as they exist; empty for a number and for bounds
    specimens   n behind the threshold, or None
    more        threshold interval, had it come from four times as many specimens; None without n
    trials      rows of the sample
    failed      rows that are missing; `sampling` is as wide as whatever they could have been makes it
    """

    value: float
    sampling: Estimate
    threshold: Estimate | None
    shapes: Mapping[str, float]
    specimens: int | None
    more: Estimate | None
    trials: int
    failed: int = 0

    @property
    def _open(self) -> Estimate | None:
        """The interval of all that is not known of the threshold: parameters if n is stated, else the shapes."""
        if self.threshold is not None:
            return self.threshold
        if self.shapes:
            return Estimate(self.value, min(self.shapes.values()), max(self.shapes.values()))
        return None

    @property
    def dominates(self) -> Dominance:
        """Which doubt is at least twice as wide as the other; "failures" where more than half of the sample's, and no
        less than the threshold's, is what the missing rows could have been; "none" where neither has a width."""
        sample = self.sampling.high - self.sampling.low
        known = self._open
        other = 0.0 if known is None else known.high - known.low
        if not (sample > 0 or other > 0):
            return "none"
        if other >= _DOMINATES * sample:
            return "threshold"
        missing = self.failed / (self.trials + self.failed)
        if missing >= max(0.5 * sample, other):
            return "failures"
        return "sampling" if sample >= _DOMINATES * other else "both"

    def sentence(self) -> str:
        """Which doubt dominates, and what would narrow it."""
        known, sample = self._open, _range(self.sampling)
        match self.dominates:
            case "none":
                return "Neither sample nor threshold leaves a doubt that this sample can show."
            case "failures":
                return (
                    f"The {self.failed} failed landings dominate ({sample}): nobody knows on which side of the "
                    "threshold they would have ended, and more trials that fail as often narrow nothing."
                )
            case "sampling":
                beside = "the threshold is known" if known is None else f"the threshold {_range(known)}"
                return f"The sample dominates ({sample}; {beside}): more trials narrow it, by 1/√n."
            case "both":
                assert known is not None
                return (
                    f"Sample ({sample}) and threshold ({_range(known)}) leave about as much open: more trials and "
                    "more knowledge of the threshold are both needed."
                )
        assert known is not None
        begin = f"The threshold dominates ({_range(known)}; the sample only {sample}): more trials change nothing; "
        if self.more is not None and self.specimens is not None:
            return (
                f"{begin}from {4 * self.specimens} specimens of the same mean and SD instead of {self.specimens} it "
                f"would be {_range(self.more)}."
            )
        if self.threshold is None:
            return f"{begin}its law and the number of specimens behind it would have to be known (n is not stated)."
        return f"{begin}narrower bounds would."


def _range(e: Estimate) -> str:
    return f"{e.low:.3g} ... {e.high:.3g}"


def doubted_exceedance(
    y: ArrayLike,
    threshold: Threshold,
    confidence: float = 0.95,
    *,
    failed: int = 0,
    sampler: Sampler | None = None,
    seed: int = 0,
) -> Exceedance:
    """P(Y > T) from a sample of Y, with both doubts.

    y        (n,) responses
    sampler  gives the sampling interval for a number or a marginal, for samples that are not independent rows (such as
             `replicated_exceedance`); by default `exceedance` with `failed`
    failed   rows that are missing, of which the sampling interval must take account
    """
    values = as_array(y)

    def independent(of: float | Marginal) -> Estimate:
        return exceedance(values, of, confidence, failed)

    sampled = sampler or independent
    if isinstance(threshold, Bounds):
        least, most = sampled(threshold.high), sampled(threshold.low)
        box = Estimate(math.nan, least.value, most.value)
        return Exceedance(math.nan, most, box, {}, None, None, len(values), failed)
    if isinstance(threshold, Measured):
        found = sampled(threshold.marginal)
        interval = threshold_interval(values, threshold, confidence, seed)
        more = threshold_interval(values, threshold.with_specimens(4 * threshold.n), confidence, seed)
        shapes = of_shapes(values, threshold.marginal)
        return Exceedance(found.value, found, interval, shapes, threshold.n, more, len(values), failed)
    found = sampled(threshold)
    shapes = of_shapes(values, threshold) if isinstance(threshold, Marginal) else {}
    return Exceedance(found.value, found, None, shapes, None, None, len(values), failed)


def threshold_interval(y: ArrayLike, threshold: Measured, confidence: float = 0.95, seed: int = 0) -> Estimate:
    """What P(Y > T) may be as far as n specimens know the law of T; the sample of Y held. No further evaluation."""
    values = _thinned(as_array(y))
    value = float(np.mean(threshold.marginal.cdf(y)))
    draws = threshold.draws(seed)
    block = max(1, 4_000_000 // len(values))
    found = np.concatenate(
        [
            type(draws)(draws.location[k : k + block], draws.scale[k : k + block], draws.logarithmic, draws.extreme)
            .cdf(values)
            .mean(axis=1)
            for k in range(0, len(draws.scale), block)
        ]
    )
    tail = 0.5 * (1.0 - confidence)
    low, high = np.quantile(found, [tail, 1.0 - tail])
    return Estimate(value, float(low), float(high))


def weighted_exceedance(
    y: ArrayLike,
    weights: ArrayLike,
    threshold: float | Marginal | Measured,
    sampling: Estimate,
    confidence: float = 0.95,
    seed: int = 0,
) -> Exceedance:
    """P(Y > T) from rows that were drawn where exceedances are, with both doubts; no further evaluation.

    y, weights  (n,) responses, and the density of the inputs over that of the rows
    sampling    the estimate at the stated threshold, with its interval

    Other laws of the threshold are asked of the same rows, as ratios to the stated one. Raises ValueError where the
    rows do not reach what the specimens leave possible.
    """
    values, density = as_array(y), as_array(weights)
    if not isinstance(threshold, Marginal | Measured):
        return Exceedance(sampling.value, sampling, None, {}, None, None, len(values))
    law = threshold.marginal if isinstance(threshold, Measured) else threshold
    rare = sampling.value <= 0.5

    def probability(below: Array) -> Array:
        """From (b, n) P(T < y) under each law, by the rarer side, which the rows were drawn for."""
        sides = np.stack([below, as_array(law.cdf(values))[np.newaxis].repeat(len(below), 0)])
        terms = (sides if rare else 1.0 - sides) * density
        share = sampling.value if rare else 1.0 - sampling.value
        found = np.minimum(share * terms[0].sum(axis=1) / terms[1].sum(axis=1), 1.0)
        return as_array(found if rare else 1.0 - found)

    shapes = {
        name: float(probability(as_array(shape.cdf(values))[np.newaxis])[0])
        for name, shape in _same_moments(law).items()
    }
    if not isinstance(threshold, Measured):
        return Exceedance(sampling.value, sampling, None, shapes, None, None, len(values))
    tail = 0.5 * (1.0 - confidence)

    def interval(of: Measured) -> Estimate:
        below = of.draws(seed).cdf(values)
        terms = (below if rare else 1.0 - below) * density
        worth = terms.sum(axis=1) ** 2 / np.maximum(np.sum(terms**2, axis=1), 1e-300)
        if float(np.quantile(worth, tail)) < _EFFECTIVE:
            raise ValueError(
                f"the landings about the design points reach too little of where {of.n} specimens allow the threshold "
                "to lie; a sample's answer has it"
            )
        low, high = np.quantile(probability(below), [tail, 1.0 - tail])
        return Estimate(sampling.value, float(low), float(high))

    more = interval(threshold.with_specimens(4 * threshold.n))
    return Exceedance(sampling.value, sampling, interval(threshold), shapes, threshold.n, more, len(values))


def _thinned(values: Array) -> Array:
    """The sorted sample, neighbours joined into their mean so that some 2000 values remain."""
    ordered = np.sort(values)
    size = -(-len(ordered) // _ROWS)
    if size == 1:
        return ordered
    whole = len(ordered) // size * size
    return np.concatenate([ordered[:whole].reshape(-1, size).mean(axis=1), ordered[whole:]])


def of_shapes(y: ArrayLike, threshold: Marginal) -> dict[str, float]:
    """P(Y > T) for T of the threshold's mean and SD as normal, lognormal and Weibull; positive means only for the last
    two."""
    values = as_array(y)
    return {name: float(np.mean(law.cdf(values))) for name, law in _same_moments(threshold).items()}


def _same_moments(threshold: Marginal) -> dict[str, Marginal]:
    """The shapes that have its mean and SD."""
    found = dict[str, Marginal]()
    for name, shape in SHAPES.items():
        if name == "normal" or threshold.mean > 0:
            with contextlib.suppress(ValueError):
                found[name] = shape(threshold.mean, threshold.sd)
    return found


@dataclass(frozen=True)
class ExceedanceCurve:
    """P(Y > threshold[k]) = value[k] at fixed thresholds, with the ends of its interval at each."""

    threshold: Array
    value: Array
    low: Array
    high: Array


def exceedance_curve(y: ArrayLike, thresholds: ArrayLike, confidence: float = 0.95) -> ExceedanceCurve:
    """The exceedance of independent rows at each threshold, Clopper-Pearson intervals (each by itself)."""
    ordered, at = np.sort(as_array(y)), as_array(thresholds)
    above = len(ordered) - np.searchsorted(ordered, at, side="right")
    low, high = clopper_pearson(above, len(ordered), confidence)
    return ExceedanceCurve(at, as_array(above / len(ordered)), low, high)


def input_interval(
    x: ArrayLike,
    y: ArrayLike,
    threshold: float | Marginal,
    inputs: Mapping[int, Measured],
    confidence: float = 0.95,
    seed: int = 0,
) -> Estimate:
    """What P(Y > T) may be as far as specimens know the laws of some inputs; no further evaluation.

    x       (n, d) inputs, independent in these columns of all others
    inputs  {column: the law that the column was drawn from, with the specimens behind it}

    The rows are weighted anew by ratios of densities. Its value is the sample's own share. Raises ValueError when the
    sample does not reach where the specimens allow the inputs to lie (the weights leave fewer than 30 rows' worth).
    """
    rows, values = as_array(x), as_array(y)
    above = as_array(threshold.cdf(values)) if isinstance(threshold, Marginal) else (values > threshold).astype(float)
    log_weights = np.zeros((1024, len(values)))
    for k, (column, law) in enumerate(sorted(inputs.items())):
        drawn, stated = law.draws(seed + k, 1024), law.stated()
        log_weights += drawn.log_density(rows[:, column]) - stated.log_density(rows[:, column])
    weights = np.exp(log_weights - log_weights.max(axis=1, keepdims=True))
    worth = weights.sum(axis=1) ** 2 / np.sum(weights**2, axis=1)
    tail = 0.5 * (1.0 - confidence)
    if float(np.quantile(worth, tail)) < _EFFECTIVE:
        raise ValueError(
            f"the sample reaches too little of where the specimens allow the inputs to lie (weights leave "
            f"{float(np.quantile(worth, tail)):.0f} of {len(values)} rows): more trials, or more specimens"
        )
    found = weights @ above / weights.sum(axis=1)
    low, high = np.quantile(found, [tail, 1.0 - tail])
    return Estimate(float(above.mean()), float(low), float(high))
