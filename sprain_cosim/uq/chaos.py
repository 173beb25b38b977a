"""Polynomials of a total degree in the standard space, fitted to rows of a response by (ridge) least squares.

Hermite polynomials, orthonormal under the standard normal law: their squared coefficients are shares of the variance
(polynomial chaos). A small ridge on all but the constant keeps a fit with nearly as many terms as rows from swinging.
Leave-one-out residuals follow from the leverages, without fitting anew.

Sources: D. Xiu, G. E. Karniadakis, SIAM J. Sci. Comput. 24 (2002) 619-644; B. Sudret, Reliab. Eng. Syst. Saf. 93 (2008)
964-979; A. E. Hoerl, R. W. Kennard, Technometrics 12 (1970) 55-67 (ridge).
"""

from __future__ import annotations

import contextlib
import math
from dataclasses import dataclass
from itertools import combinations_with_replacement

import numpy as np

from .distributions import Array
from .distributions.marginal import as_array

__all__ = ["Chaos", "basis", "fit_chaos", "hermite", "multi_indices", "orthonormal", "redrawn", "terms_of"]

_BLOCK = 4_000_000  # numbers of a basis held at a time
_WELL_APART = 1e-3  # ratio of diagonal elements down to which columns may be orthonormalised by their products


def multi_indices(d: int, degree: int) -> list[tuple[int, ...]]:
    """(terms) exponents of all monomials in d variables up to a total degree, by degree."""
    rows = []
    for total in range(degree + 1):
        for chosen in combinations_with_replacement(range(d), total):
            rows.append(tuple(chosen.count(k) for k in range(d)))
    return rows


def terms_of(d: int, degree: int) -> int:
    """Their number."""
    return math.comb(d + degree, degree)


@dataclass(frozen=True)
class Chaos:
    """y ≈ Σ coefficients[t]·Π Hₑ(uₖ), e = powers[t, k].

    powers        (terms, d) exponents
    coefficients  (terms,)
    left_out      (n,) residuals of the rows fitted, each from a fit without it
    q2            share of the rows' variance that such fits predict
    """

    degree: int
    powers: np.ndarray
    coefficients: Array
    left_out: Array
    q2: float

    def __call__(self, u: Array) -> Array:
        """(n,) values at u (n, d)."""
        block = max(1, _BLOCK // len(self.coefficients))
        parts = [basis(u[k : k + block], self.powers) @ self.coefficients for k in range(0, len(u), block)]
        return np.concatenate(parts) if parts else np.empty(0)


def fit_chaos(u: Array, y: Array, degree: int, ridge: float = 0.0) -> Chaos:
    """The expansion of y (n,) over u (n, d). Raises ValueError for fewer rows than terms without a ridge."""
    powers = np.array(multi_indices(u.shape[1], degree))
    if len(y) < len(powers) and not ridge:
        raise ValueError(f"{len(y)} rows cannot determine the {len(powers)} terms of degree {degree}")
    columns = basis(u, powers)
    if ridge:
        penalty = np.full(len(powers), ridge)
        penalty[0] = 0.0
        factor = np.linalg.cholesky(columns.T @ columns + np.diag(penalty))
        half = np.linalg.solve(factor, columns.T)
        coefficients = np.linalg.solve(factor.T, half @ y)
        leverage = np.sum(half**2, axis=0)
    else:
        q, r = orthonormal(columns)
        coefficients = np.linalg.solve(r, q.T @ y)
        leverage = np.sum(q**2, axis=1)
    left_out = (y - columns @ coefficients) / np.maximum(1.0 - leverage, 1e-9)
    variance = float(np.var(y))
    q2 = 1.0 - float(np.mean(left_out**2)) / variance if variance > 0 else math.nan
    return Chaos(degree, powers, as_array(coefficients), as_array(left_out), q2)


def orthonormal(columns: Array) -> tuple[Array, Array]:
    """The factors q (n, terms), r (terms, terms) of many rows: orthonormal columns times an upper triangle.

    By Cholesky's factor of the products of the columns, in a third of the time of Householder's reflections, which
    columns get that depend on each other more than those of a polynomial basis do."""
    from scipy.linalg import solve_triangular  # slow to import

    with contextlib.suppress(np.linalg.LinAlgError):
        lower = np.linalg.cholesky(columns.T @ columns)
        diagonal = np.diag(lower)
        if float(diagonal.min()) > _WELL_APART * float(diagonal.max()):
            return as_array(solve_triangular(lower, columns.T, lower=True).T), as_array(lower.T)
    q, r = np.linalg.qr(columns)
    return as_array(q), as_array(r)


def redrawn(columns: Array, coefficients: Array, left_out: Array, draws: int, rng: np.random.Generator) -> Array:
    """(1 + draws, terms): the coefficients of a least squares fit, then as the rows leave them open (wild bootstrap: C.
    F. J. Wu, Ann. Stat. 14 (1986) 1261-1295).

    columns   (n, terms) of the fit
    left_out  (n,) residuals of rows left out
    """
    q, r = orthonormal(columns)
    signs = rng.standard_normal((draws, len(left_out)))
    moved = np.linalg.solve(r, q.T @ (signs * left_out).T).T
    return np.vstack([coefficients, coefficients + moved])


def basis(u: Array, powers: np.ndarray) -> Array:
    """(n, terms) products of orthonormal Hermite polynomials of u (n, d)."""
    table = hermite(u, int(powers.max()))
    columns = np.ones((len(u), len(powers)))
    for variable in range(u.shape[1]):
        order = powers[:, variable]
        for k in range(1, len(table)):
            columns[:, order == k] *= table[k][:, variable, np.newaxis]
    return columns


def hermite(u: Array, degree: int) -> list[Array]:
    """[(n, d) orthonormal Hermite polynomials of order 0, 1, …, degree]."""
    table = [np.ones_like(u), u]
    for order in range(1, degree):
        table.append((u * table[order] - math.sqrt(order) * table[order - 1]) / math.sqrt(order + 1.0))
    return table[: degree + 1]
