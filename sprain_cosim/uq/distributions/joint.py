"""Marginals joined by a Gaussian copula.

z = L·u is normal with correlation matrix R = L·Lᵀ and xᵢ = xᵢ(zᵢ). R is found so that the x have the correlation asked
for (Nataf); a correlation that the marginals cannot attain, or a matrix that is not positive definite, is refused.

Equations: A. Der Kiureghian and P.-L. Liu, Structural reliability under incomplete probability information,
J. Eng. Mech. 112 (1986) 85-104.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property, lru_cache
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .marginal import Array, Marginal
from .normal import LogNormal, Normal

__all__ = ["CorrelationKind", "JointDistribution"]

CorrelationKind = Literal["pearson", "spearman"]


class JointDistribution:
    """d marginals joined by a Gaussian copula (Nataf).

    marginals    d of them
    correlation  (d, d) matrix of correlations of x, or None for independent inputs; a fixed input and a choice must
                 have none
    kind         "pearson" (of the values) or "spearman" (of the ranks) says what `correlation` states

    The attribute `correlation` holds Pearson's, whichever was stated, or None.

    Raises ValueError: the matrix is not symmetric with unit diagonal, a correlation lies outside what the two
    marginals can attain, or the matrix is not positive definite (of x or, after Nataf, of z).
    """

    def __init__(
        self, marginals: Sequence[Marginal], correlation: ArrayLike | None = None, kind: CorrelationKind = "pearson"
    ):
        if kind not in ("pearson", "spearman"):
            raise ValueError(f"the kind of correlation must be 'pearson' or 'spearman', got {kind!r}")
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
                self._join(matrix, kind)

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

    def _join(self, matrix: Array, kind: CorrelationKind) -> None:
        _require_positive_definite(matrix, "the correlation matrix")
        normal, pearson = np.eye(len(matrix)), matrix.copy()
        for i, j in zip(*np.nonzero(np.triu(matrix, 1)), strict=True):
            pair = self.marginals[i], self.marginals[j]
            _require_correlatable(*pair, f"inputs {i} and {j}")
            if kind == "spearman":  # W. H. Kruskal, J. Am. Stat. Assoc. 53 (1958) 814-861
                normal[i, j] = normal[j, i] = 2.0 * math.sin(math.pi / 6.0 * float(matrix[i, j]))
                pearson[i, j] = pearson[j, i] = _pair_correlation(*pair, float(normal[i, j]))
            else:
                normal[i, j] = normal[j, i] = _normal_correlation(*pair, float(matrix[i, j]), f"inputs {i} and {j}")
        self.correlation = pearson
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

    def require_slopes(self) -> None:
        """Raises ValueError unless a search can follow slopes: something varies, and nothing by steps."""
        if not len(self.active):
            raise ValueError("every input is fixed: there is nothing to vary")
        steps = [i for i, m in enumerate(self.marginals) if m.is_discrete]
        if steps:
            raise ValueError(f"input {steps[0]} is a choice, which has no slope to follow; sample instead")

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


def _require_positive_definite(matrix: Array, name: str) -> None:
    lowest = float(np.linalg.eigvalsh(matrix)[0])
    if lowest <= 1e-12:
        raise ValueError(
            f"{name} is not positive definite (smallest eigenvalue {lowest:.3g}); the correlations contradict each "
            "other"
        )


def _require_correlatable(first: Marginal, second: Marginal, names: str) -> None:
    if first.is_fixed or second.is_fixed:
        raise ValueError(f"{names}: a fixed input cannot be correlated")
    if first.is_discrete or second.is_discrete:
        raise ValueError(f"{names}: a choice cannot be correlated")


def _normal_correlation(first: Marginal, second: Marginal, target: float, names: str) -> float:
    """Correlation of the underlying normal pair that gives x the correlation `wanted` (Nataf)."""
    lowest, highest = _pair_correlation(first, second, -1.0), _pair_correlation(first, second, 1.0)
    if not lowest < target < highest:
        raise ValueError(
            f"{names}: correlation {target:g} cannot be attained by these marginals; it must lie strictly between "
            f"{lowest:.4f} and {highest:.4f}"
        )
    match first, second:
        case Normal(), Normal():
            return target
        case LogNormal(), LogNormal():
            deltas = first.sd / first.mean * second.sd / second.mean
            return math.log1p(target * deltas) / (first.zeta * second.zeta)
        case (Normal(), LogNormal() as skew) | (LogNormal() as skew, Normal()):
            return target * skew.sd / skew.mean / skew.zeta
    low, high = -1.0, 1.0
    while high - low > 1e-15:
        middle = 0.5 * (low + high)
        if middle in (low, high):
            break
        if _pair_correlation(first, second, middle) < target:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


_NODES, _WEIGHTS = np.polynomial.hermite_e.hermegauss(64)
_WEIGHTS = _WEIGHTS / _WEIGHTS.sum()


def _pair_correlation(first: Marginal, second: Marginal, rho: float) -> float:
    """Pearson correlation of (x₁(z₁), x₂(z₂)) for normal z of correlation rho (Gauss-Hermite)."""
    if first.has_kinks or second.has_kinks:
        return _series_correlation(first, second, rho)
    z1, e = _NODES[:, np.newaxis], _NODES[np.newaxis, :]
    z2 = rho * z1 + math.sqrt(max(1.0 - rho * rho, 0.0)) * e
    a = (first.from_standard(z1) - first.mean) / first.sd
    b = (second.from_standard(z2) - second.mean) / second.sd
    return float(np.einsum("i,j,ij->", _WEIGHTS, _WEIGHTS, a * b))


_ORDERS = 80
_GRID = np.linspace(-8.5, 8.5, 8001)
_GRID_WEIGHTS = np.exp(-0.5 * _GRID**2)
_GRID_WEIGHTS = _GRID_WEIGHTS / _GRID_WEIGHTS.sum()


def _series_correlation(first: Marginal, second: Marginal, rho: float) -> float:
    """The same by Mehler's series Σ aₖ bₖ ρᵏ over Hermite coefficients, which kinks do not disturb."""
    if abs(rho) == 1.0:
        a = (first.from_standard(_GRID) - first.mean) / first.sd
        b = (second.from_standard(rho * _GRID) - second.mean) / second.sd
        return float(_GRID_WEIGHTS @ (a * b))
    powers = rho ** np.arange(1, _ORDERS + 1)
    return float(np.sum(_hermite_coefficients(first) * _hermite_coefficients(second) * powers))


@lru_cache(maxsize=64)
def _hermite_coefficients(marginal: Marginal) -> Array:
    """(orders,) coefficients of (x − mean)/sd by the orthonormal Hermite polynomials of order 1, 2, …"""
    x = _GRID_WEIGHTS * (marginal.from_standard(_GRID) - marginal.mean) / marginal.sd
    before, polynomial = np.ones_like(_GRID), _GRID.copy()
    found = np.empty(_ORDERS)
    for order in range(1, _ORDERS + 1):
        found[order - 1] = x @ polynomial
        following = (_GRID * polynomial - math.sqrt(order) * before) / math.sqrt(order + 1)
        before, polynomial = polynomial, following
    return found
