"""Marginals and the Gaussian copula: between physical values x and the standard space u.

A marginal is a frozen, strictly increasing map x(u) of a standard normal variable u. `JointDistribution`
joins d marginals by a Gaussian copula (Nataf transform): z = L·u is normal with correlation matrix R = L·Lᵀ
and xᵢ = xᵢ(zᵢ). R is found so that the x have the Pearson correlation asked for; a correlation that the
marginals cannot attain, or a matrix that is not positive definite, is refused.

Equations: A. Der Kiureghian and P.-L. Liu, Structural reliability under incomplete probability information,
J. Eng. Mech. 112 (1986) 85-104. Scores: H. Millwater, Universal properties of kernel functions for
probabilistic sensitivity analysis, Probabilistic Eng. Mech. 24 (2009) 89-99.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import log_ndtr, ndtr, ndtri

__all__ = ["Fixed", "JointDistribution", "LogNormal", "Marginal", "Normal", "Truncated", "Uniform"]

Array = NDArray[np.float64]

_SQRT3 = math.sqrt(3.0)


def _density(v: ArrayLike) -> Array:
    """Standard normal density; 0 at ±inf."""
    return np.exp(-0.5 * np.square(np.asarray(v, dtype=float))) / math.sqrt(2.0 * math.pi)


def _finite(owner: object, **values: float) -> None:
    for name, value in values.items():
        if not math.isfinite(value):
            raise ValueError(f"{type(owner).__name__}: {name} must be finite, got {value}")


class Marginal(ABC):
    """One random input: a strictly increasing function x(u) of a standard normal variable u.

    `mean` and `sd` are those of x. Units are the caller's; every method keeps the shape of its argument.
    """

    if TYPE_CHECKING:  # fields of some marginals, properties of others

        @property
        def mean(self) -> float: ...

        @property
        def sd(self) -> float: ...

    @property
    @abstractmethod
    def support(self) -> tuple[float, float]:
        """Lowest and highest possible x (±inf where unbounded)."""

    @abstractmethod
    def from_standard(self, u: ArrayLike) -> Array:
        """x(u)."""

    @abstractmethod
    def to_standard(self, x: ArrayLike) -> Array:
        """u(x); ∓inf at and beyond the ends of the support."""

    @abstractmethod
    def slope(self, u: ArrayLike) -> Array:
        """dx/du at u."""

    def score(self, x: ArrayLike) -> tuple[Array, Array]:
        """∂ ln f/∂mean and ∂ ln f/∂sd at x, f being the density: the score functions of the sensitivity
        factors.

        NaN where they do not exist (uniform: its ends move with the parameters; fixed: no density).
        """
        nan = np.full(np.shape(x), np.nan)
        return nan, nan

    def standard_shift(self, x: ArrayLike) -> tuple[Array, Array]:
        """∂u/∂mean and ∂u/∂sd at a held x; NaN where `score` is."""
        nan = np.full(np.shape(x), np.nan)
        return nan, nan

    @property
    def is_fixed(self) -> bool:
        return False

    def probability_outside(self, low: float, high: float) -> float:
        """P(x < low or x > high)."""
        below, above = self.to_standard(np.array([low, high], dtype=float))
        return float(ndtr(below) + ndtr(-above))


@dataclass(frozen=True)
class Normal(Marginal):
    """x = mean + sd·u."""

    mean: float
    sd: float

    def __post_init__(self) -> None:
        _finite(self, mean=self.mean, sd=self.sd)
        if self.sd <= 0:
            raise ValueError(f"Normal: sd must be positive, got {self.sd}; use Fixed for a constant")

    @property
    def support(self) -> tuple[float, float]:
        return -math.inf, math.inf

    def from_standard(self, u: ArrayLike) -> Array:
        return self.mean + self.sd * np.asarray(u, dtype=float)

    def to_standard(self, x: ArrayLike) -> Array:
        return (np.asarray(x, dtype=float) - self.mean) / self.sd

    def slope(self, u: ArrayLike) -> Array:
        return np.full(np.shape(u), self.sd)

    def score(self, x: ArrayLike) -> tuple[Array, Array]:
        u = self.to_standard(x)
        return u / self.sd, (u * u - 1.0) / self.sd

    def standard_shift(self, x: ArrayLike) -> tuple[Array, Array]:
        u = self.to_standard(x)
        return np.full(u.shape, -1.0 / self.sd), -u / self.sd

    def truncated_moments(self, a: float, b: float) -> tuple[float, float]:
        """Mean and standard deviation of x given a ≤ u ≤ b."""
        mass = _mass_between(a, b)
        first = (_density(a) - _density(b)) / mass
        second = 1.0 + (_times_density(a) - _times_density(b)) / mass
        return float(self.mean + self.sd * first), float(self.sd * math.sqrt(second - first * first))


@dataclass(frozen=True)
class LogNormal(Marginal):
    """x = exp(λ + ζ·u), given by the mean and standard deviation of x itself.

    With δ = sd/mean: ζ² = ln(1 + δ²), λ = ln(mean) − ζ²/2. The mean lies at u = ζ/2, the median exp(λ) at u =
    0.
    """

    mean: float
    sd: float

    def __post_init__(self) -> None:
        _finite(self, mean=self.mean, sd=self.sd)
        if self.mean <= 0 or self.sd <= 0:
            raise ValueError(
                f"LogNormal: mean and sd must be positive, got mean {self.mean}, sd {self.sd}; use Fixed for a "
                "constant, zero included"
            )

    @cached_property
    def zeta(self) -> float:
        """Standard deviation of ln x."""
        return math.sqrt(math.log1p((self.sd / self.mean) ** 2))

    @cached_property
    def lam(self) -> float:
        """Mean of ln x."""
        return math.log(self.mean) - 0.5 * self.zeta**2

    @property
    def support(self) -> tuple[float, float]:
        return 0.0, math.inf

    def from_standard(self, u: ArrayLike) -> Array:
        return np.exp(self.lam + self.zeta * np.asarray(u, dtype=float))

    def to_standard(self, x: ArrayLike) -> Array:
        values = np.asarray(x, dtype=float)
        with np.errstate(divide="ignore"):
            return (np.log(np.maximum(values, 0.0)) - self.lam) / self.zeta

    def slope(self, u: ArrayLike) -> Array:
        return self.zeta * self.from_standard(u)

    def _parameter_slopes(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """(∂λ/∂mean, ∂λ/∂sd) and (∂ζ/∂mean, ∂ζ/∂sd)."""
        delta = self.sd / self.mean
        scale = 1.0 / (self.mean * (1.0 + delta**2))
        return (
            ((1.0 + 2.0 * delta**2) * scale, -delta * scale),
            (-(delta**2) * scale / self.zeta, delta * scale / self.zeta),
        )

    def score(self, x: ArrayLike) -> tuple[Array, Array]:
        u = self.to_standard(x)
        (lam_mean, lam_sd), (zeta_mean, zeta_sd) = self._parameter_slopes()
        by_lam, by_zeta = u / self.zeta, (u * u - 1.0) / self.zeta
        return by_lam * lam_mean + by_zeta * zeta_mean, by_lam * lam_sd + by_zeta * zeta_sd

    def standard_shift(self, x: ArrayLike) -> tuple[Array, Array]:
        u = self.to_standard(x)
        (lam_mean, lam_sd), (zeta_mean, zeta_sd) = self._parameter_slopes()
        return -(lam_mean + u * zeta_mean) / self.zeta, -(lam_sd + u * zeta_sd) / self.zeta

    def truncated_moments(self, a: float, b: float) -> tuple[float, float]:
        """Mean and standard deviation of x given a ≤ u ≤ b."""
        mass, zeta = _mass_between(a, b), self.zeta
        ratio = _mass_between(a - zeta, b - zeta) / mass
        second = _mass_between(a - 2 * zeta, b - 2 * zeta) / mass * math.exp(zeta**2)
        return self.mean * ratio, self.mean * math.sqrt(max(second - ratio**2, 0.0))


@dataclass(frozen=True)
class Uniform(Marginal):
    """x between low and high, every value equally likely."""

    low: float
    high: float

    def __post_init__(self) -> None:
        _finite(self, low=self.low, high=self.high)
        if self.low >= self.high:
            raise ValueError(f"Uniform: low must be below high, got {self.low} and {self.high}")

    @property
    def mean(self) -> float:
        return 0.5 * (self.low + self.high)

    @property
    def sd(self) -> float:
        return (self.high - self.low) / (2.0 * _SQRT3)

    @property
    def support(self) -> tuple[float, float]:
        return self.low, self.high

    def from_standard(self, u: ArrayLike) -> Array:
        u = np.asarray(u, dtype=float)
        width = self.high - self.low
        return np.where(u < 0, self.low + width * ndtr(u), self.high - width * ndtr(-u))

    def to_standard(self, x: ArrayLike) -> Array:
        x = np.asarray(x, dtype=float)
        width = self.high - self.low
        from_low, from_high = np.clip((x - self.low) / width, 0, 1), np.clip((self.high - x) / width, 0, 1)
        return np.where(from_low < 0.5, ndtri(from_low), -ndtri(from_high))

    def slope(self, u: ArrayLike) -> Array:
        return (self.high - self.low) * _density(u)


@dataclass(frozen=True)
class Truncated(Marginal):
    """A normal or lognormal `parent` given that low ≤ x ≤ high.

    `mean` and `sd` are those of x, the truncated variable; `score` and `standard_shift` are taken with
    respect to the parent's mean and sd at held ends, since those are the parameters a study states.
    """

    parent: Normal | LogNormal
    low: float = -math.inf
    high: float = math.inf

    def __post_init__(self) -> None:
        if not isinstance(self.parent, Normal | LogNormal):
            raise ValueError(f"Truncated: the parent must be Normal or LogNormal, got {type(self.parent).__name__}")
        if math.isnan(self.low) or math.isnan(self.high) or self.low >= self.high:
            raise ValueError(f"Truncated: low must be below high, got {self.low} and {self.high}")
        if not _mass_between(*self._ends) > 1e-12:
            raise ValueError(
                f"Truncated: {self.parent} has no probability to speak of between {self.low} and {self.high}"
            )

    @cached_property
    def _ends(self) -> tuple[float, float]:
        """The ends of the support in the parent's standard space."""
        a, b = self.parent.to_standard(np.array([self.low, self.high]))
        return float(a), float(b)

    @cached_property
    def _mass(self) -> float:
        return _mass_between(*self._ends)

    @cached_property
    def _moments(self) -> tuple[float, float]:
        return self.parent.truncated_moments(*self._ends)

    @property
    def mean(self) -> float:
        return self._moments[0]

    @property
    def sd(self) -> float:
        return self._moments[1]

    @property
    def support(self) -> tuple[float, float]:
        low, high = self.parent.support
        return max(low, self.low), min(high, self.high)

    def _parent_standard(self, u: Array) -> Array:
        a, b = self._ends
        # Each half is counted from its own end, so that neither tail loses its digits.
        lower = ndtri(ndtr(a) + self._mass * ndtr(u))
        upper = -ndtri(ndtr(-b) + self._mass * ndtr(-u))
        return np.clip(np.where(lower < 0, lower, upper), a, b)

    def from_standard(self, u: ArrayLike) -> Array:
        return self.parent.from_standard(self._parent_standard(np.asarray(u, dtype=float)))

    def to_standard(self, x: ArrayLike) -> Array:
        a, b = self._ends
        v = np.clip(self.parent.to_standard(x), a, b)
        below = np.where(v < 0, ndtr(v) - ndtr(a), ndtr(-a) - ndtr(-v)) / self._mass
        above = np.where(v < 0, ndtr(b) - ndtr(v), ndtr(-v) - ndtr(-b)) / self._mass
        return np.where(below < 0.5, ndtri(np.clip(below, 0, 1)), -ndtri(np.clip(above, 0, 1)))

    def slope(self, u: ArrayLike) -> Array:
        u = np.asarray(u, dtype=float)
        v = self._parent_standard(u)
        dv_du = self._mass * np.exp(0.5 * (v * v - u * u))
        return self.parent.slope(v) * dv_du

    def _mass_moved(self, x: Array) -> tuple[Array, Array]:
        """Derivatives of the parent's P(low ≤ x' ≤ x) with respect to the parent's mean and sd."""
        moved = []
        for at_x, at_low in zip(self.parent.standard_shift(x), self._shift_at(self.low), strict=True):
            moved.append(_density(self.parent.to_standard(x)) * at_x - at_low)
        return moved[0], moved[1]

    def _shift_at(self, end: float) -> tuple[float, float]:
        v = float(self.parent.to_standard(end))
        if not math.isfinite(v):
            return 0.0, 0.0
        by_mean, by_sd = self.parent.standard_shift(end)
        return float(_density(v) * by_mean), float(_density(v) * by_sd)

    def _whole_mass_moved(self) -> list[float]:
        pairs = zip(self._shift_at(self.high), self._shift_at(self.low), strict=True)
        return [at_high - at_low for at_high, at_low in pairs]

    def score(self, x: ArrayLike) -> tuple[Array, Array]:
        by_mean, by_sd = self.parent.score(x)
        whole_mean, whole_sd = self._whole_mass_moved()
        return by_mean - whole_mean / self._mass, by_sd - whole_sd / self._mass

    def standard_shift(self, x: ArrayLike) -> tuple[Array, Array]:
        x = np.asarray(x, dtype=float)
        u = self.to_standard(x)
        shifts = []
        for moved, whole in zip(self._mass_moved(x), self._whole_mass_moved(), strict=True):
            shifts.append((moved - ndtr(u) * whole) / (self._mass * _density(u)))
        return shifts[0], shifts[1]


@dataclass(frozen=True)
class Fixed(Marginal):
    """A constant, zero allowed. It has no place in the standard space: its u is 0 and moves nothing."""

    value: float

    def __post_init__(self) -> None:
        _finite(self, value=self.value)

    @property
    def mean(self) -> float:
        return self.value

    @property
    def sd(self) -> float:
        return 0.0

    @property
    def support(self) -> tuple[float, float]:
        return self.value, self.value

    def from_standard(self, u: ArrayLike) -> Array:
        return np.full(np.shape(u), self.value)

    def to_standard(self, x: ArrayLike) -> Array:
        return np.zeros(np.shape(x))

    def slope(self, u: ArrayLike) -> Array:
        return np.zeros(np.shape(u))

    @property
    def is_fixed(self) -> bool:
        return True

    def probability_outside(self, low: float, high: float) -> float:
        return 0.0 if low <= self.value <= high else 1.0


class JointDistribution:
    """d marginals joined by a Gaussian copula (Nataf).

    Parameters: `marginals`, d of them; `correlation`, a (d, d) matrix of the Pearson correlations of x, or
    None for independent inputs. A fixed input must have no correlation.

    Raises ValueError: the matrix is not symmetric with unit diagonal, a correlation lies outside what the two
    marginals can attain, or the matrix is not positive definite (of x or, after Nataf, of z).
    """

    def __init__(self, marginals: Sequence[Marginal], correlation: ArrayLike | None = None):
        self.marginals = tuple(marginals)
        if not self.marginals:
            raise ValueError("a joint distribution needs at least one marginal")
        for marginal in self.marginals:
            if not isinstance(marginal, Marginal):
                raise ValueError(f"expected a marginal such as Normal(mean, sd), got {marginal!r}")
        d = len(self.marginals)
        self.correlation: Array | None = None
        self.normal_correlation: Array = np.eye(d)
        self.cholesky: Array = np.eye(d)
        if correlation is not None:
            matrix = np.array(correlation, dtype=float)
            self._check_shape(matrix)
            if np.any(matrix != np.eye(d)):
                self.correlation = matrix
                self._join(matrix)

    def _check_shape(self, matrix: Array) -> None:
        d = len(self.marginals)
        if matrix.shape != (d, d):
            raise ValueError(f"the correlation matrix must be {d} by {d}, got {matrix.shape}")
        if not np.all(np.isfinite(matrix)) or not np.array_equal(matrix, matrix.T):
            raise ValueError("the correlation matrix must be finite and symmetric")
        if not np.array_equal(np.diag(matrix), np.ones(d)):
            raise ValueError("the correlation matrix must have ones on its diagonal")
        if np.max(np.abs(matrix)) > 1:
            raise ValueError("correlations must lie between -1 and 1")

    def _join(self, matrix: Array) -> None:
        _require_positive_definite(matrix, "the correlation matrix")
        normal = np.eye(len(matrix))
        for i, j in zip(*np.nonzero(np.triu(matrix, 1)), strict=True):
            normal[i, j] = normal[j, i] = _normal_correlation(
                self.marginals[i], self.marginals[j], float(matrix[i, j]), f"inputs {i} and {j}"
            )
        _require_positive_definite(normal, "the correlation matrix of the underlying normal variables (Nataf)")
        self.normal_correlation = normal
        self.cholesky = np.asarray(np.linalg.cholesky(normal), dtype=float)

    def __len__(self) -> int:
        return len(self.marginals)

    @property
    def is_independent(self) -> bool:
        return self.correlation is None

    @cached_property
    def means(self) -> Array:
        """(d,) means of x."""
        return np.array([m.mean for m in self.marginals], dtype=float)

    @cached_property
    def sds(self) -> Array:
        """(d,) standard deviations of x."""
        return np.array([m.sd for m in self.marginals], dtype=float)

    @cached_property
    def active(self) -> NDArray[np.intp]:
        """Indices of the inputs that are not fixed."""
        return np.flatnonzero([not m.is_fixed for m in self.marginals])

    @cached_property
    def covariance(self) -> Array:
        """(d, d) covariance of x."""
        correlation = np.eye(len(self)) if self.correlation is None else self.correlation
        return correlation * np.outer(self.sds, self.sds)

    def from_standard(self, u: ArrayLike) -> Array:
        """(n, d) or (d,) independent standard normal values u to x."""
        u = np.asarray(u, dtype=float)
        z = u if self.is_independent else u @ self.cholesky.T
        x = np.empty_like(z)
        for i, marginal in enumerate(self.marginals):
            x[..., i] = marginal.from_standard(z[..., i])
        return x

    def to_normal(self, x: ArrayLike) -> Array:
        """(n, d) or (d,) values x to the correlated standard normal z of the copula."""
        x = np.asarray(x, dtype=float)
        z = np.empty_like(x)
        for i, marginal in enumerate(self.marginals):
            z[..., i] = marginal.to_standard(x[..., i])
        return z

    def to_standard(self, x: ArrayLike) -> Array:
        """(n, d) or (d,) values x to independent standard normal u; a fixed input has u = 0."""
        z = self.to_normal(x)
        if self.is_independent:
            return z
        return np.asarray(np.linalg.solve(self.cholesky, z[..., np.newaxis])[..., 0], dtype=float)

    def jacobian(self, u: ArrayLike) -> Array:
        """(d, d) matrix ∂xᵢ/∂uⱼ at one point u (d,)."""
        z = self.cholesky @ np.asarray(u, dtype=float)
        slopes = np.array([float(m.slope(v)) for m, v in zip(self.marginals, z, strict=True)])
        return slopes[:, np.newaxis] * self.cholesky


def _times_density(v: float) -> float:
    return 0.0 if math.isinf(v) else float(v * _density(v))


def _mass_between(a: float, b: float) -> float:
    """Φ(b) − Φ(a), counted in the tail where both lie."""
    if a > 0:
        a, b = -b, -a
    return math.exp(log_ndtr(b)) - math.exp(log_ndtr(a)) if b < 0 else float(ndtr(b) - ndtr(a))


def _require_positive_definite(matrix: Array, name: str) -> None:
    lowest = float(np.linalg.eigvalsh(matrix)[0])
    if lowest <= 1e-12:
        raise ValueError(
            f"{name} is not positive definite (smallest eigenvalue {lowest:.3g}); the correlations contradict each "
            "other"
        )


def _normal_correlation(first: Marginal, second: Marginal, wanted: float, names: str) -> float:
    """Correlation of the underlying normal pair that gives x the correlation `wanted` (Nataf)."""
    if first.is_fixed or second.is_fixed:
        raise ValueError(f"{names}: a fixed input cannot be correlated")
    lowest, highest = _pair_correlation(first, second, -1.0), _pair_correlation(first, second, 1.0)
    if not lowest < wanted < highest:
        raise ValueError(
            f"{names}: correlation {wanted:g} cannot be attained by these marginals; it must lie strictly between "
            f"{lowest:.4f} and {highest:.4f}"
        )
    match first, second:
        case Normal(), Normal():
            return wanted
        case LogNormal(), LogNormal():
            deltas = first.sd / first.mean * second.sd / second.mean
            return math.log1p(wanted * deltas) / (first.zeta * second.zeta)
        case (Normal(), LogNormal() as skew) | (LogNormal() as skew, Normal()):
            return wanted * skew.sd / skew.mean / skew.zeta
    low, high = -1.0, 1.0
    while high - low > 1e-15:
        middle = 0.5 * (low + high)
        if middle in (low, high):
            break
        if _pair_correlation(first, second, middle) < wanted:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


_NODES, _WEIGHTS = np.polynomial.hermite_e.hermegauss(64)
_WEIGHTS = _WEIGHTS / _WEIGHTS.sum()


def _pair_correlation(first: Marginal, second: Marginal, rho: float) -> float:
    """Pearson correlation of (x₁(z₁), x₂(z₂)) for normal z of correlation rho (Gauss-Hermite)."""
    z1, e = _NODES[:, np.newaxis], _NODES[np.newaxis, :]
    z2 = rho * z1 + math.sqrt(max(1.0 - rho * rho, 0.0)) * e
    a = (first.from_standard(z1) - first.mean) / first.sd
    b = (second.from_standard(z2) - second.mean) / second.sd
    return float(np.einsum("i,j,ij->", _WEIGHTS, _WEIGHTS, a * b))
