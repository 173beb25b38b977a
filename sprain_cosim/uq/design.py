"""The value of a parameter from which on P(Y > T) is small enough: the designer's question, in a few hundred rows.

Four steps. A Sobol' sample over (parameter, inputs) gives a polynomial of the response; its root in the parameter is
where further rows are evaluated, which mend the polynomial there; at the new root, fresh rows that it has never met say
what it leaves out. The reported probability is the polynomial's, over many points, plus that remainder:

    P = E[g(ŷ)] + E[F(y) - g(ŷ)],   F(y) = P(T < y),   g(ŷ) = E[F(ŷ + e)],   e the residual of rows left out of the fit

so the polynomial is a control variate and nothing rests on its being right. Some of the fresh rows follow the inputs'
own distribution, some are drawn in proportion to g(ŷ), where the exceedances are (V. Dubourg, B. Sudret, F. Deheeger,
Probab. Eng. Mech. 33 (2013) 47-57), some in proportion to the standard deviation of F(ŷ + e), where they are open; no
weight exceeds 2.5. With a second parameter the same is done at several of its values: a trade-off curve.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from .chaos import basis, hermite, multi_indices
from .distributions import Array, JointDistribution, Marginal, Normal, Uniform
from .distributions.marginal import as_array
from .exceedance import SHAPES, Bounds, Exceedance, Threshold
from .measured import Measured
from .sampling import Stream, generator, sobol
from .statistics import Estimate, skewed_interval

__all__ = ["FEWEST", "DesignResult", "GoalPoint", "design"]

Find = Literal["least", "largest"]
Status = Literal["met", "everywhere", "nowhere"]

FEWEST = 100  # evaluations
LEVELS = 5  # of a second parameter
GRID = 33  # values of the parameter on a curve
FAR = 10.0  # a curve says "less than" where P is smaller than the goal by this factor
FINEST = 0.005  # relative; what the points of the pool leave open
REFITS = 24  # of the polynomial, for the band of a curve
SPREAD = 0.02  # of the rows about the first root, in ranges of the parameter
WEIGHT = 3.0  # in the fit, of rows near the root
LARGEST_SCALE = 2.0  # from the moved rows to the curve, for a probability that is next to none
SHARES = (0.4, 0.3, 0.3)  # of the rows: by the inputs' own distribution, where exceedances are, where they are open
RIDGES = (0.03, 0.3, 3.0)
_NODES, _NODE_WEIGHTS = np.polynomial.hermite_e.hermegauss(9)
_NODE_WEIGHTS = _NODE_WEIGHTS / _NODE_WEIGHTS.sum()
Below = Callable[[ArrayLike], Array]


@dataclass(frozen=True)
class GoalCurve:
    """P(parameter): (m,) values, the corrected probability at each and its band, the 95 % of each value by itself."""

    parameter: Array
    probability: Array
    low: Array
    high: Array


@dataclass(frozen=True)
class GoalPoint:
    """What was found at one value of the second parameter, or at all where there is none.

    second        that value, or None
    status        met: `value` divides the range; everywhere: the goal holds at the whole range; nowhere: nowhere
    value         of the parameter; the end of the range for "everywhere", where P is smallest for "nowhere"
    low, high     95 % interval of it; NaN where it reaches beyond the range
    value_95      what holds with 95 % confidence; NaN where nothing in the range does
    probability   at `value`, corrected by the fresh rows, with both doubts; at most the goal unless "nowhere"
    surface       what the polynomial alone says there
    other_end     where the goal ceases to hold again, or None
    curve         over the whole range
    fresh, failed rows behind the remainder, and those of them without a response
    """

    second: float | None
    status: Status
    value: float
    low: float
    high: float
    value_95: float
    probability: Exceedance
    surface: float
    other_end: float | None
    curve: GoalCurve
    fresh: int
    failed: int


@dataclass(frozen=True)
class DesignResult:
    """find         whether the goal holds from a value on ("least") or up to one ("largest")
    points       one, or one for each value of the second parameter
    evaluations  rows
    failed       those without a response
    q2           share of the rows' variance that the polynomial predicts when they are left out
    residual     root mean square of what it leaves out near the root, in the response's unit
    """

    find: Find
    points: tuple[GoalPoint, ...]
    evaluations: int
    failed: int
    q2: float
    residual: float

    def __repr__(self) -> str:
        found = [f"{p.status} {p.value:.4g} (95 %: {p.low:.4g} ... {p.high:.4g})" for p in self.points[:3]]
        more = f", {len(self.points) - 3} more" if len(self.points) > 3 else ""
        return (
            f"DesignResult({self.find}: {', '.join(found)}{more}; {self.evaluations} evaluations, "
            f"{self.failed} failed, Q2 {self.q2:.2g})"
        )


def design(
    function: Callable[[Array], Array],
    marginals: Sequence[Marginal],
    ranges: Sequence[tuple[float, float]],
    threshold: Threshold,
    at_most: float,
    *,
    evaluations: int = 300,
    seed: int = 0,
    correlation: Array | None = None,
    find: Find | None = None,
    levels: int = LEVELS,
) -> DesignResult:
    """The least or largest value of a parameter for which P(Y > T) <= `at_most`.

    function     (n, d + k) rows, inputs and then the k parameters, to (n,) responses; NaN where there is none
    marginals    (d,) of the inputs
    ranges       (k,) of the parameters; k is 1, or 2: the first at `levels` values of the second
    threshold    T; for bounds the lower end counts
    at_most      0 ... 1
    find         None: by where the goal holds

    Raises ValueError for what cannot be a question."""
    _check(ranges, at_most, evaluations)
    first = 1 << int(math.log2(0.45 * evaluations))
    rest = evaluations - first
    seconds = [()] if len(ranges) == 1 else [(float(b),) for b in np.linspace(*ranges[1], levels)]
    near = [len(part) for part in np.array_split(np.arange(round(0.35 * rest)), len(seconds))]
    fresh = [len(part) for part in np.array_split(np.arange(rest - sum(near)), len(seconds))]
    search = _Search(function, JointDistribution(tuple(marginals), correlation), ranges, threshold, at_most, seed)

    search.begin(first)
    found = find or search.direction(seconds)
    search.refine(seconds, near, found)
    points = [search.point(second, n, found, k) for k, (second, n) in enumerate(zip(seconds, fresh, strict=True))]
    return DesignResult(
        found, tuple(points), search.evaluations, search.failed, search.surface.q2, search.surface.residual
    )


def _check(ranges: Sequence[tuple[float, float]], at_most: float, evaluations: int) -> None:
    if len(ranges) not in (1, 2):
        raise ValueError(f"{len(ranges)} parameters: one, or two for a trade-off")
    for low, high in ranges:
        if not (math.isfinite(low) and math.isfinite(high) and low < high):
            raise ValueError(f"range {low:g} ... {high:g}: must rise")
    if not 0.0 < at_most < 1.0:
        raise ValueError(f"P <= {at_most:g}: must lie between 0 and 1")
    if evaluations < FEWEST:
        raise ValueError(f"{evaluations} landings: at least {FEWEST} are needed")


class _Surface:
    """A polynomial of the response over standard inputs u (n, d) and scaled parameters v (n, k)."""

    def __init__(self, u: Array, v: Array, y: Array, weight: Array) -> None:
        self.d = u.shape[1]
        x = np.column_stack([u, v])
        fits = [
            _Fit(powers, basis(x, powers), y, weight, ridge)
            for powers in _terms(self.d, v.shape[1])
            for ridge in RIDGES
        ]
        best = min(fits, key=lambda fit: fit.error)
        self.powers, self.coefficients = best.powers, best.coefficients
        near = weight > 1
        chosen = best.left_out[near] if near.any() else best.left_out
        self.residual = float(np.sqrt(np.mean(chosen**2)))
        variance = float(np.var(y[~near]))
        self.q2 = 1.0 - float(np.mean(best.left_out[~near] ** 2)) / variance if variance > 0 else math.nan
        self.inputs, self.place = np.unique(self.powers[:, : self.d], axis=0, return_inverse=True)

    def over(self, columns: Array, v: Array) -> Array:
        """(n,) responses at rows with these `columns`, basis(u, inputs), and the parameters v."""
        table = hermite(v[np.newaxis], int(self.powers.max()))
        factor = self.coefficients.copy()
        for k, order in enumerate(self.powers[:, self.d :].T):
            factor *= np.array([level[0, k] for level in table])[order]
        return as_array(columns @ np.bincount(self.place.ravel(), factor, len(self.inputs)))


def _terms(d: int, k: int) -> list[np.ndarray]:
    """Exponents of two polynomials: linear in the inputs and quadratic in all; both cubic in the parameters."""
    alone = np.zeros((0, d + k), int)
    if k:
        pure = np.array([p for p in multi_indices(k, 3) if sum(p) > 1])
        alone = np.column_stack([np.zeros((len(pure), d), int), pure])
    quadratic = np.array(multi_indices(d + k, 2))
    mixed = [[*np.eye(d, dtype=int)[i], *p] for i in range(d) for p in multi_indices(k, 2) if sum(p) == 2]
    linear = np.array(multi_indices(d + k, 1))
    return [np.unique(np.vstack([linear, alone]), axis=0), np.unique(np.vstack([quadratic, alone, mixed]), axis=0)]


class _Fit:
    """Ridge least squares with weights; what each row leaves from a fit without it."""

    def __init__(self, powers: np.ndarray, columns: Array, y: Array, weight: Array, ridge: float) -> None:
        self.powers = powers
        penalty = np.where(powers.any(axis=1), ridge, 0.0)
        factor = np.linalg.cholesky((columns.T * weight) @ columns + np.diag(penalty))
        half = np.linalg.solve(factor, columns.T * np.sqrt(weight))
        self.coefficients = as_array(np.linalg.solve(factor.T, half @ (np.sqrt(weight) * y)))
        leverage = np.sum(half**2, axis=0)
        self.left_out = as_array((y - columns @ self.coefficients) / np.maximum(1.0 - leverage, 1e-9))
        self.error = float(weight @ self.left_out**2)


@dataclass
class _Pool:
    """(n, d) standard inputs, and the basis over them for the surface last used."""

    u: Array
    inputs: np.ndarray | None = None
    columns: Array | None = None

    def over(self, surface: _Surface, v: Array) -> Array:
        if self.columns is None or self.inputs is None or not np.array_equal(self.inputs, surface.inputs):
            self.inputs, self.columns = surface.inputs, basis(self.u, surface.inputs)
        return surface.over(self.columns, v)


class _Search:
    """The rows so far and the surface through them. Parameters in their own units; scaled, they have mean 0 and
    standard deviation 1 over their range."""

    def __init__(
        self,
        function: Callable[[Array], Array],
        joint: JointDistribution,
        ranges: Sequence[tuple[float, float]],
        threshold: Threshold,
        at_most: float,
        seed: int,
    ) -> None:
        self.function, self.joint, self.ranges = function, joint, ranges
        self.threshold, self.at_most, self.seed = threshold, at_most, seed
        self.middle = np.array([0.5 * (low + high) for low, high in ranges])
        self.scale = np.array([(high - low) / math.sqrt(12.0) for low, high in ranges])
        d, k = len(joint), len(ranges)
        self.u, self.v, self.y, self.weight = np.empty((0, d)), np.empty((0, k)), np.empty(0), np.empty(0)
        self.evaluations = self.failed = 0
        size = 1 << min(max(math.ceil(math.log2(160 / at_most)), 13), 17)
        standard = JointDistribution([Normal(0.0, 1.0)] * d)
        self.pool = _Pool(sobol(standard, size, seed + 1, replicates=1))
        self.training = _Pool(sobol(standard, 4096, seed + 2, replicates=1))
        self.grid = np.linspace(*ranges[0], GRID)

    # ---- rows

    def begin(self, n: int) -> None:
        sides = [Uniform(low, high) for low, high in self.ranges]
        normal = [Normal(0.0, 1.0)] * len(self.joint)
        rows = sobol(JointDistribution([*normal, *sides]), n, self.seed, replicates=1)
        d = len(self.joint)
        self._keep(rows[:, :d], rows[:, d:], self._evaluate(rows[:, :d], rows[:, d:]), 1.0)

    def refine(self, seconds: Sequence[tuple[float, ...]], near: Sequence[int], find: Find) -> None:
        """Rows about the root at each value of the second parameter."""
        rng = generator(self.seed, Stream.DESIGN)
        (low, high), rows, parameters = self.ranges[0], [], []
        for second, n in zip(seconds, near, strict=True):
            at, _ = self._target(second, find)
            chosen, _, _ = self._draw(self.training, (at, *second), n, rng)
            values = np.clip(at + SPREAD * (high - low) * rng.standard_normal(n), low, high)
            rows.append(self.training.u[chosen])
            parameters.append(np.column_stack([values, np.tile(second, (n, 1))]))
        u, p = np.vstack(rows), np.vstack(parameters)
        self._keep(u, p, self._evaluate(u, p), WEIGHT)

    def _evaluate(self, u: Array, parameters: Array) -> Array:
        y = as_array(self.function(np.column_stack([self.joint.from_standard(u), parameters])))
        self.evaluations += len(y)
        self.failed += int(np.isnan(y).sum())
        return y

    def _keep(self, u: Array, parameters: Array, y: Array, weight: float) -> None:
        done = ~np.isnan(y)
        self.u, self.v = np.vstack([self.u, u[done]]), np.vstack([self.v, self._scaled(parameters[done])])
        self.y = np.concatenate([self.y, y[done]])
        self.weight = np.concatenate([self.weight, np.full(int(done.sum()), weight)])
        if len(self.y) < 0.8 * self.evaluations:
            raise ValueError(f"{self.failed} of {self.evaluations} landings failed: too many to design with")
        self.surface = _Surface(self.u, self.v, self.y, self.weight)

    def _scaled(self, parameters: ArrayLike) -> Array:
        return as_array((np.asarray(parameters, float) - self.middle) / self.scale)

    # ---- what the surface says

    def _smooth(self, threshold: Threshold, y: Array) -> Array:
        """g(ŷ) = E[P(T < ŷ + e)]."""
        return _smoothed(threshold, self.surface.residual)(y)

    def probability(self, at: float, second: tuple[float, ...], pool: _Pool) -> float:
        return float(np.mean(self._smooth(self.threshold, pool.over(self.surface, self._scaled([at, *second])))))

    def logarithms(self, second: tuple[float, ...], pool: _Pool) -> Array:
        """(GRID,) ln P of the surface."""
        found = [self.probability(float(at), second, pool) for at in self.grid]
        return np.log(np.maximum(found, 1e-300))

    def direction(self, seconds: Sequence[tuple[float, ...]]) -> Find:
        """By the first curve that tells: where it meets the goal, else where it is smallest."""
        curves = [self.logarithms(second, self.training) for second in seconds]
        for curve in curves:
            held = curve <= math.log(self.at_most)
            if held[0] != held[-1]:
                return "least" if held[-1] else "largest"
        middle = curves[len(curves) // 2]
        return "least" if middle[-1] <= middle[0] else "largest"

    def _target(self, second: tuple[float, ...], find: Find) -> tuple[float, Status]:
        return _divide(self.grid, self.logarithms(second, self.training), math.log(self.at_most), find)

    def _draw(
        self, pool: _Pool, at: tuple[float, ...], n: int, rng: np.random.Generator
    ) -> tuple[np.ndarray, Array, Array]:
        """(n,) rows of the pool, the weights that lead back to the inputs' own distribution, and g(ŷ) of all."""
        g = self._smooth(self.threshold, pool.over(self.surface, self._scaled(at)))
        left = _scatter(self.threshold, self.surface.residual, pool.over(self.surface, self._scaled(at)), g)
        density = np.full(len(g), SHARES[0])
        for share, part in zip(SHARES[1:], (g, left), strict=True):
            density += share * part / max(float(part.mean()), 1e-300)
        order = np.argsort(g, kind="stable")
        steps = np.cumsum(density[order])
        chosen = order[np.searchsorted(steps / steps[-1], (np.arange(n) + rng.random(n)) / n).clip(max=len(g) - 1)]
        return chosen, as_array(density.mean() / density[chosen]), g

    # ---- the answer

    def point(self, second: tuple[float, ...], n: int, find: Find, item: int) -> GoalPoint:
        """Fresh rows at the root of the surface; the root of the corrected curve."""
        log_goal = math.log(self.at_most)
        curve = self.logarithms(second, self.pool)
        at, _ = _divide(self.grid, curve, log_goal, find)
        chosen, weights, g = self._draw(self.pool, (at, *second), n, generator(self.seed, Stream.DESIGN, 1 + item))
        u = self.pool.u[chosen]
        y = self._evaluate(u, np.tile([at, *second], (n, 1)))
        done = ~np.isnan(y)
        p = max(float(g.mean()), 1e-300)
        above = _smoothed(self.threshold, 0.0)
        remainder = weights[done] * (above(y[done]) - g[chosen][done])
        low95, high95 = _ends(p, remainder, weights[~done], g[chosen][~done], 0.95)
        _, sure = _ends(p, remainder, weights[~done], g[chosen][~done], 0.90)
        middle = max(p + float(remainder.mean()), low95, 1e-12)
        shift, down, up, safe = (math.log(max(q, 1e-12) / p) for q in (middle, low95, high95, sure))
        value, status = _divide(self.grid, curve + shift, log_goal, find, at)
        low, high = sorted(self._end(curve + s, log_goal, find, at) for s in (down, up))
        fits = _divide(self.grid, curve + safe, log_goal, find, at)
        measure = self._measure(value, at, second, chosen[done], y[done], weights[done] / n)
        said = self.probability(value, second, self.pool)
        there = self.at_most if status == "met" else min(said * math.exp(shift), 1.0)
        return GoalPoint(
            second[0] if second else None,
            status,
            value,
            low if math.isfinite(low) else math.nan,
            high if math.isfinite(high) else math.nan,
            fits[0] if fits[1] != "nowhere" else math.nan,
            _doubted(measure, self.threshold, there, (low95 / middle, high95 / middle), n, self.seed),
            said,
            _other_end(self.grid, curve + shift, log_goal, find, value) if status == "met" else None,
            self._curve(second, curve, at, shift, (down, up)),
            n,
            int((~done).sum()),
        )

    def _end(self, curve: Array, goal: float, find: Find, near: float) -> float:
        """The dividing value of one end of the interval; infinite where it lies beyond the range."""
        value, status = _divide(self.grid, curve, goal, find, near)
        beyond = math.inf if find == "least" else -math.inf
        return value if status == "met" else {"nowhere": beyond, "everywhere": -beyond}[status]

    def _measure(
        self, value: float, at: float, second: tuple[float, ...], chosen: np.ndarray, y: Array, weights: Array
    ) -> tuple[Array, Array]:
        """Responses and their signed weights, so that P(Y > T) = Σ weight·P(T < response): the surface over the pool,
        and each fresh row in place of what the surface says of it."""
        v, there = self._scaled([value, *second]), self._scaled([at, *second])
        whole = np.sort(self.pool.over(self.surface, v))
        joined = whole.reshape(2048, -1).mean(axis=1)
        assert self.pool.columns is not None
        said, then = (self.surface.over(self.pool.columns[chosen], place) for place in (v, there))
        spread = self.surface.residual * _NODES
        responses = [np.add.outer(joined, spread).ravel(), y + said - then, np.add.outer(said, spread).ravel()]
        shares = [
            np.tile(_NODE_WEIGHTS / len(joined), (len(joined), 1)).ravel(),
            weights,
            -np.multiply.outer(weights, _NODE_WEIGHTS).ravel(),
        ]
        return np.concatenate(responses), np.concatenate(shares)

    def _curve(
        self, second: tuple[float, ...], curve: Array, at: float, shift: float, ends: tuple[float, float]
    ) -> GoalCurve:
        """The corrected curve; its band joins the interval of the remainder with the spread of polynomials through rows
        drawn again."""
        rng, pool = generator(self.seed, Stream.DESIGN, 99), _Pool(self.training.u[:1024])
        kept, drawn = self.surface, []
        here = int(np.argmin(np.abs(self.grid - at)))
        for _ in range(REFITS):
            rows = rng.integers(0, len(self.y), len(self.y))
            self.surface = _Surface(self.u[rows], self.v[rows], self.y[rows], self.weight[rows])
            self.surface.residual = kept.residual
            found = self.logarithms(second, pool)
            drawn.append(found - found[here])
        self.surface = kept
        spread = 1.96 * np.std(drawn, axis=0)
        down, up = np.hypot(shift - ends[0], spread), np.hypot(ends[1] - shift, spread)
        middle = curve + shift
        p, low, high = (as_array(np.exp(np.minimum(c, 0.0))) for c in (middle, middle - down, middle + up))
        return GoalCurve(self.grid, p, as_array(np.where(p < self.at_most / FAR, 0.0, low)), high)


def _smoothed(threshold: Threshold, residual: float) -> Below:
    """y -> E[P(T < y + e)], e normal with that standard deviation."""
    match threshold:
        case Measured():
            return _smoothed(threshold.marginal, residual)
        case Bounds():
            return _smoothed(threshold.low, residual)
        case Normal():
            return Normal(threshold.mean, math.hypot(threshold.sd, residual)).cdf
        case Marginal():
            law = threshold
            if residual <= 0:
                return law.cdf
            return lambda y: as_array(law.cdf(np.add.outer(as_array(y), residual * _NODES)) @ _NODE_WEIGHTS)
        case number:
            if residual <= 0:
                return lambda y: as_array(as_array(y) > number).astype(float)
            return Normal(number, residual).cdf


def _scatter(threshold: Threshold, residual: float, y: Array, g: Array) -> Array:
    """(n,) standard deviation of P(T < ŷ + e): what a row is expected to leave of its g(ŷ)."""
    law = threshold.marginal if isinstance(threshold, Measured) else threshold
    if not isinstance(law, Marginal):
        return np.sqrt(g * (1.0 - g))
    above = as_array(law.cdf(np.add.outer(y, residual * _NODES)))
    return np.sqrt(np.maximum(above**2 @ _NODE_WEIGHTS - (above @ _NODE_WEIGHTS) ** 2, 0.0))


def _divide(grid: Array, curve: Array, goal: float, find: Find, near: float | None = None) -> tuple[float, Status]:
    """Where a curve of ln P over the grid divides what meets the goal from what does not: the first value on the side
    of `find`, or the one nearest to `near`."""
    if find == "largest":
        value, status = _divide(-grid[::-1], curve[::-1], goal, "least", None if near is None else -near)
        return -value, status
    from scipy.interpolate import PchipInterpolator  # slow to import, used here alone

    fine = np.linspace(grid[0], grid[-1], 32 * (len(grid) - 1) + 1)
    grid, curve = fine, as_array(PchipInterpolator(grid, curve)(fine))
    held = curve <= goal
    starts = np.flatnonzero(held[1:] & ~held[:-1])
    if len(starts):
        k = int(starts[0] if near is None else starts[np.argmin(np.abs(grid[starts] - near))])
        return float(grid[k] + (grid[k + 1] - grid[k]) * (curve[k] - goal) / (curve[k] - curve[k + 1])), "met"
    if held[0]:
        return float(grid[0]), "everywhere"
    return float(grid[np.argmin(curve)]), "nowhere"


def _other_end(grid: Array, curve: Array, goal: float, find: Find, value: float) -> float | None:
    """Where the goal ceases to hold again beyond `value`."""
    if find == "largest":
        found = _other_end(-grid[::-1], curve[::-1], goal, "least", -value)
        return None if found is None else -found
    broken = np.flatnonzero((grid > value) & (curve > goal))
    return float(grid[broken[0]]) if len(broken) else None


def _ends(p: float, remainder: Array, weights: Array, g: Array, confidence: float) -> tuple[float, float]:
    """Ends of p + mean(remainder); rows that failed, with their `weights` and `g`, may have been anything."""
    low, high = skewed_interval(remainder, confidence) if np.std(remainder) > 1e-12 else (float(remainder.mean()),) * 2
    n, m = len(remainder), len(weights)
    least, most = (n * low - float(weights @ g)) / (n + m), (n * high + float(weights @ (1.0 - g))) / (n + m)
    return max(p + min(least, -FINEST * p), 0.0), min(p + max(most, FINEST * p), 1.0)


def _doubted(
    measure: tuple[Array, Array], threshold: Threshold, p: float, ends: tuple[float, float], rows: int, seed: int
) -> Exceedance:
    """The probability of a signed measure of responses with both doubts, scaled so that it is `p`, which the corrected
    curve says: the rows were moved along the surface, and what is printed must not differ from it in the last figure.
    `ends`: of its sampling interval, as shares of the value."""
    y, weights = measure

    def of(law: float | Marginal) -> float:
        return float(np.clip(weights @ _smoothed(law, 0.0)(y), 0.0, 1.0))

    unscaled = float(weights @ _smoothed(threshold, 0.0)(y))
    weights = weights * (min(p / unscaled, LARGEST_SCALE) if unscaled > 0 else 1.0)

    def sampled(value: float) -> Estimate:
        return Estimate(value, value * ends[0], min(value * ends[1], 1.0))

    if isinstance(threshold, Bounds):
        least, most = of(threshold.high), of(threshold.low)
        return Exceedance(math.nan, sampled(most), Estimate(math.nan, least, most), {}, None, None, rows)
    law = threshold.marginal if isinstance(threshold, Measured) else threshold
    value = min(of(law), p)  # equal but for rounding
    shapes = _shapes(of, law) if isinstance(law, Marginal) else {}
    if not isinstance(threshold, Measured):
        return Exceedance(value, sampled(value), None, shapes, None, None, rows)
    interval = _threshold_interval((y, weights), threshold, seed)
    more = _threshold_interval((y, weights), threshold.with_specimens(4 * threshold.n), seed)
    return Exceedance(value, sampled(value), interval, shapes, threshold.n, more, rows)


def _shapes(of: Callable[[Marginal], float], law: Marginal) -> dict[str, float]:
    found: dict[str, float] = {}
    for name, shape in SHAPES.items():
        if name == "normal" or law.mean > 0:
            try:
                found[name] = of(shape(law.mean, law.sd))
            except ValueError:
                continue
    return found


def _threshold_interval(measure: tuple[Array, Array], threshold: Measured, seed: int) -> Estimate:
    """As exceedance.threshold_interval, of a signed measure; responses joined into 2000 steps."""
    y, weights = measure
    order = np.argsort(y)
    parts = np.array_split(order, min(2000, len(y)))
    at = np.array([float(y[part].mean()) for part in parts])
    share = np.array([float(weights[part].sum()) for part in parts])
    draws = threshold.draws(seed, 2048)
    found = np.concatenate(
        [
            type(draws)(draws.location[k : k + 512], draws.scale[k : k + 512], draws.logarithmic, draws.extreme).cdf(at)
            @ share
            for k in range(0, len(draws.scale), 512)
        ]
    )
    low, high = np.quantile(np.clip(found, 0.0, 1.0), [0.025, 0.975])
    return Estimate(float(weights @ threshold.marginal.cdf(y)), float(low), float(high))
