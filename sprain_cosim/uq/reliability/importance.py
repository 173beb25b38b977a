"""The probability of an event from samples drawn about its design points.

Rows come from a mixture of unit normals about the design points, and of a wide one about the origin, which bounds the
weights and may meet what no search found. Two kinds of control variates, whose means are known, narrow the estimate:
the half-spaces of first order, and the event of a quadratic fitted to the other rows (each fifth of the rows by a fit
to the other four). An uncertain threshold is not sampled: each row counts with its probability of the event.

The centres stay where the design points are. Moving them to where a pilot finds the event (cross-entropy) gained
nothing in trials with a few hundred rows and ten or twenty inputs, and weighting the pilots in biased the estimate low.

Sources: R. E. Melchers, Struct. Saf. 6 (1989) 3-10 (sampling about the design point); A. Owen, Y. Zhou, J. Am. Stat.
Assoc. 95 (2000) 135-143 (mixtures, control variates).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtr, stdtrit

from ..chaos import basis, fit_chaos, multi_indices, terms_of
from ..distributions import JointDistribution, Marginal
from ..distributions.marginal import as_array
from ..sampling import Stream, generator
from ..statistics import Estimate, clopper_pearson
from .first_order import FormResult
from .limit_state import Event, LimitState
from .points import Array, Evaluations, Function, PointLedger, Status

__all__ = ["ImportanceSampling", "importance_sampling", "sample_event"]

_WIDE = 0.1, 1.5  # share and standard deviation of the component about the origin
_LEAST_SHARE = 0.1  # of a design point's component
_COV_LIMIT = 0.3
_FEWEST = 20  # rows' worth in the event
_LEAST = 100
_FOLDS = 5
_FAR, _FAR_NUMBERS = 40_000, 8_000_000  # rows of the surrogate alone, for the mean of its event
_RIDGE = 0.1


@dataclass(frozen=True)
class ImportanceSampling:
    """Probability of an event, with the interval of its sampling error.

    cov     coefficient of variation of the estimate
    inside  rows in the event (for an uncertain threshold the sum of their probabilities of it)
    worth   how many equal rows the weighted ones in the event amount to
    trials  rows drawn
    y       (trials,) their responses, and `weights`, the inputs' own density over that of the rows
    """

    probability: Estimate
    cov: float
    inside: float
    worth: float
    trials: int
    evaluations: Evaluations
    status: Status
    reasons: tuple[str, ...]
    y: Array = field(repr=False, compare=False, default_factory=lambda: np.empty(0))
    weights: Array = field(repr=False, compare=False, default_factory=lambda: np.empty(0))


def importance_sampling(
    function: Function,
    marginals: Sequence[Marginal],
    threshold: float | Marginal,
    points: FormResult | Sequence[FormResult],
    correlation: ArrayLike | None = None,
    *,
    above: bool = False,
    n: int = 400,
    cov: float | None = None,
    seed: int = 0,
    confidence: float = 0.95,
) -> ImportanceSampling:
    """P(function <= threshold), or with `above` P(function > threshold), sampled about the event's design points.

    points  results of `form` or `form_exceedance` for the same event, or `design_points(...).points`
    n       evaluations at most, at least 100
    cov     coefficient of variation at which to stop earlier; missing it makes the result suspect

    Raises ValueError for arguments out of range.
    """
    state = LimitState(PointLedger(function), JointDistribution(marginals, correlation), Event(threshold, above))
    found = [points] if isinstance(points, FormResult) else list(points)
    return sample_event(state, found, n, cov, seed, confidence)


def sample_event(
    state: LimitState, points: Sequence[FormResult], n: int, cov: float | None, seed: int, confidence: float
) -> ImportanceSampling:
    """The same on a limit state, whose ledger keeps every evaluation."""
    if n < _LEAST:
        raise ValueError(f"importance sampling needs at least {_LEAST} evaluations, got {n}")
    if not points:
        raise ValueError("importance sampling needs a design point")
    if cov is not None and not cov > 0:
        raise ValueError(f"the coefficient of variation wanted must be positive, got {cov}")
    sample = _Sample(state, _Mixture.about(points, state.inputs), points[0].beta < 0, seed)
    while sample.trials < n:
        sample.draw(n if cov is None else min(n - sample.trials, max(_LEAST, n // 8)))
        value, low, high, error = sample.estimate(confidence)
        if cov is not None and value > 0 and error <= cov * value:
            break
    achieved = error / value if value > 0 else math.inf
    worth = _worth(sample.terms)
    reasons = _doubts(value, achieved, worth, sample.trials, cov)
    estimate = Estimate(value, low, high)
    if sample.complement:
        estimate = Estimate(1.0 - value, 1.0 - high, 1.0 - low)
    return ImportanceSampling(
        estimate,
        achieved,
        float(np.sum(sample.share)),
        worth,
        sample.trials,
        state.ledger.evaluations(),
        "suspect" if reasons else "ok",
        reasons,
        sample.y,
        sample.weights,
    )


class _Sample:
    """Rows from a mixture with their shares of the event; `complement`: the rare side of the event is the other one."""

    def __init__(self, state: LimitState, mixture: _Mixture, complement: bool, seed: int):
        self.state, self.mixture, self.complement = state, mixture, complement
        self.rng, self.far = generator(seed, Stream.RARE_EVENT), generator(seed, Stream.RARE_EVENT, 1)
        d = len(state.inputs)
        self.u, self.y, self.weights = np.empty((0, d)), np.empty(0), np.empty(0)

    @property
    def trials(self) -> int:
        return len(self.y)

    def draw(self, size: int) -> None:
        u = self.mixture.draw(size, self.rng)
        self.u = np.concatenate([self.u, u])
        self.y = np.concatenate([self.y, self.state.ledger(self.state.inputs.from_standard(u))])
        self.weights = self.mixture.weights(self.u)

    def event(self, y: Array) -> Array:
        """(n,) probability of the rare side given each response."""
        share = self.state.event.given(y)
        return as_array(1.0 - share) if self.complement else share

    @property
    def share(self) -> Array:
        return self.event(self.y)

    @property
    def terms(self) -> Array:
        return as_array(self.share * self.weights)

    def estimate(self, confidence: float) -> tuple[float, float, float, float]:
        """Value, ends of its interval, standard error.

        The interval is symmetric in the logarithm, by Student's quantile at the freedom that the rows have. Where the
        controls explain every row, one that they would not may still be next: the standard error is at least the value
        over the rows' worth in the event.
        """
        terms, worth = self.terms, _worth(self.terms)
        if not worth:  # which tells no more than so many plain rows without the event
            return 0.0, 0.0, float(clopper_pearson([0], _worth(self.weights), confidence)[1][0]), 0.0
        residual, far_error = self._residual(terms)
        value, n = float(np.mean(residual)), len(residual)
        error, least = math.hypot(float(np.std(residual, ddof=1)) / math.sqrt(n), far_error), abs(value) / worth
        freedom = _freedom(residual) if error > least else n - 1
        error = max(error, least)
        if value <= 0:
            return value, 0.0, float(np.max(terms)), error
        reach = math.exp(float(stdtrit(freedom, 0.5 * (1.0 + confidence))) * error / value)
        return value, value / reach, min(value * reach, 1.0), error

    def _residual(self, terms: Array) -> tuple[Array, float]:
        """(n,) terms with the controls regressed out, and the standard error of the controls' own means.

        Each fifth of the rows has its coefficients from the other four, so that the residuals do not flatter.
        """
        controls, fold = self._half_spaces(), np.arange(len(terms)) % _FOLDS
        active = self.mixture.active
        fitted = len(terms) * (1.0 - 1.0 / _FOLDS) > 1.2 * terms_of(len(active), 2)
        residual, spread = terms.copy(), 0.0
        for part in range(_FOLDS):
            own, other = fold == part, fold != part
            columns, error = controls, 0.0
            if fitted:
                surrogate = fit_chaos(self.u[other][:, active], self.y[other], 2, ridge=_RIDGE)
                far, weights = self._far
                beyond = weights * self.event(far @ surrogate.coefficients)
                error = float(np.std(beyond)) / math.sqrt(len(beyond))
                extra = self.weights * self.event(surrogate(self.u[:, active])) - float(np.mean(beyond))
                columns = np.column_stack([controls, extra])
            design = np.column_stack([np.ones(len(terms)), columns])
            coefficients, *_ = np.linalg.lstsq(design[other], terms[other], rcond=None)
            residual[own] -= columns[own] @ coefficients[1:]
            spread += error * abs(float(coefficients[-1])) / _FOLDS
        return residual, spread

    @cached_property
    def _far(self) -> tuple[Array, Array]:
        """Basis (m, terms) and weights (m,) of rows at which only the surrogate is asked."""
        powers = np.array(multi_indices(len(self.mixture.active), 2))
        u = self.mixture.draw(min(_FAR, _FAR_NUMBERS // len(powers)), self.far)
        return basis(u[:, self.mixture.active], powers), self.mixture.weights(u)

    def _half_spaces(self) -> Array:
        """(n, k) weighted indicators of the first-order half-spaces minus their probabilities."""
        columns = []
        for centre in self.mixture.centres:
            norm = float(np.linalg.norm(centre))
            if norm > 0:
                columns.append(self.weights * (self.u @ centre >= norm**2) - float(ndtr(-norm)))
        return np.column_stack(columns) if columns else np.empty((self.trials, 0))


def _freedom(values: Array) -> float:
    """Degrees of freedom of the variance of values, by their kurtosis: a few large ones say little of their spread."""
    away = (values - values.mean()) ** 2
    kurtosis = float(np.mean(away**2)) / float(np.mean(away)) ** 2 if np.any(away) else 3.0
    return max(2.0 * len(values) / max(kurtosis - 1.0, 2.0) - 1.0, 1.0)


def _worth(terms: Array) -> float:
    """How many equal terms these amount to."""
    return float(terms.sum() ** 2 / np.sum(terms**2)) if np.any(terms) else 0.0


def _doubts(value: float, cov: float, worth: float, n: int, asked: float | None) -> tuple[str, ...]:
    if not value > 0:
        return (f"none of {n} rows about the design points lies in the event: these are not its design points",)
    reasons = []
    if cov > _COV_LIMIT or worth < _FEWEST:
        reasons.append(
            f"the estimate's coefficient of variation is {cov:.0%}, its rows are worth {worth:.0f}: the event is not "
            "about the design points alone"
        )
    if asked is not None and cov > asked:
        reasons.append(
            f"the coefficient of variation is {cov:.1%}, {asked:.1%} was wanted: some "
            f"{math.ceil(n * (cov / asked) ** 2)} rows are needed"
        )
    return tuple(reasons)


@dataclass(frozen=True)
class _Mixture:
    """Unit normals about `centres` (k, d) with `shares` (k,), and a wide one about the origin; fixed inputs stay 0."""

    centres: Array
    shares: Array
    active: np.ndarray

    @classmethod
    def about(cls, points: Sequence[FormResult], inputs: JointDistribution) -> _Mixture:
        shares = as_array([ndtr(-abs(p.beta)) for p in points])
        shares = np.maximum(shares / shares.sum(), _LEAST_SHARE / len(shares))
        centres = np.array([p.standard_point[: len(inputs)] for p in points])
        return cls(centres, as_array(shares / shares.sum()), inputs.active)

    def draw(self, n: int, rng: np.random.Generator) -> Array:
        """(n, d) rows, in as even numbers from each component as the shares allow."""
        wide, spread = _WIDE
        edges = np.round(np.cumsum(np.append(self.shares * (1.0 - wide), wide)) * n + rng.uniform(-0.5, 0.5))
        edges = np.clip(edges, 0, n)
        edges[-1] = n
        which = rng.permutation(np.searchsorted(edges, np.arange(n), side="right"))
        centres = np.vstack([self.centres, np.zeros_like(self.centres[0])])[which]
        scale = np.append(np.ones(len(self.centres)), spread)[which]
        u = np.zeros_like(centres)
        z = rng.standard_normal((n, len(self.active)))
        u[:, self.active] = centres[:, self.active] + scale[:, np.newaxis] * z
        return as_array(u)

    def weights(self, u: Array) -> Array:
        """(n,) density of the standard space over that of the mixture."""
        wide, spread = _WIDE
        own = np.exp(u @ self.centres.T - 0.5 * np.sum(self.centres**2, axis=1)) @ (self.shares * (1.0 - wide))
        d, norm = len(self.active), np.sum(u**2, axis=1)
        return as_array(1.0 / (own + wide * spread**-d * np.exp(0.5 * norm * (1.0 - spread**-2))))
