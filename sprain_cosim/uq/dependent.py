"""Shares of a response's variance among inputs that depend on each other, from the rows of any sample of them.

The response becomes a polynomial of the inputs' standard scores z (normal, of correlation R: a Gaussian copula). Of any
set A of inputs, what is known of the response when they are known has the variance V_A = Var E[y | z_A]. From it follow
what people ask for, whatever the order in which the inputs are listed:

    first    V_i / V           an input with all that goes along with it when it is seen
    total    1 - V_{-i} / V    what is left of it when all others are known: its own, uncorrelated part
    shapley  its mean gain V_{A+i} - V_A over all orders in which inputs become known: adds up to 1

Of independent inputs first <= shapley <= total; dependent inputs may have totals far below their firsts.

V_A is exact for the polynomial. In independent variables u (z = Lu) its part of degree k is a symmetric tensor S_k over
Wick powers, of variance k! |S_k|²; knowing z_A projects u onto the rows of L in A, so that V_A = Σ k! |P_A S_k|².

Sources: A. B. Owen, SIAM/ASA J. Uncertain. Quantif. 2 (2014) 245-251; A. B. Owen, C. Prieur, ibid. 5 (2017) 986-1002
(Shapley, dependent inputs); T. A. Mara, S. Tarantola, Reliab. Eng. Syst. Saf. 107 (2012) 115-121 (first and total of
dependent inputs); S. Janson, Gaussian Hilbert Spaces, 1997, ch. 3 (projections of Wick powers).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .chaos import Chaos, basis, fit_chaos, redrawn, terms_of
from .distributions import Array, JointDistribution, Marginal
from .distributions.marginal import as_array
from .sampling import Stream, generator
from .sensitivity import GivenDataIndices

__all__ = ["dependent_shares"]

MOST = 10  # inputs of which all sets are asked
_TERMS_PER_ROW = 0.4  # an expansion with more terms than this share of the rows overfits
_DRAWS = 100  # of the coefficients, for the intervals


def dependent_shares(
    x: ArrayLike,
    y: ArrayLike,
    marginals: Sequence[Marginal],
    correlation: ArrayLike | None = None,
    *,
    max_degree: int = 3,
    confidence: float = 0.95,
    seed: int = 0,
) -> GivenDataIndices:
    """From rows x (n, d) and responses y (n,): the polynomial of the total degree <= max_degree that predicts left-out
    rows best, its shares, and how far the rows leave its coefficients open. Of more than 10 inputs that vary Shapley
    shares are NaN.

    Raises ValueError for too few rows, a response that does not vary, or a choice among the inputs."""
    xs, ys = as_array(x), as_array(y)
    joint = JointDistribution(marginals, correlation)
    joint.require_slopes()
    active = joint.active
    if not float(np.var(ys)) > 0.0:
        raise ValueError("the response does not vary: it has no shares")
    u = joint.to_standard(xs)[:, active]
    found = _best(u, ys, max_degree)
    rows = joint.cholesky[np.ix_(active, active)]
    rng = generator(seed, Stream.BOOTSTRAP, 2)
    coefficients = redrawn(basis(u, found.powers), found.coefficients, found.left_out, _DRAWS, rng)
    shares = _shares(_tensors(found, coefficients), rows)
    return GivenDataIndices.of(shares, joint, (found.degree, len(found.powers), found.q2), confidence)


def _best(u: Array, y: Array, max_degree: int) -> Chaos:
    fits = [
        fit_chaos(u, y, degree)
        for degree in range(1, max_degree + 1)
        if terms_of(u.shape[1], degree) <= _TERMS_PER_ROW * len(y)
    ]
    if not fits:
        raise ValueError(f"{len(y)} rows are too few for an expansion in {u.shape[1]} inputs")
    return max(fits, key=lambda fit: fit.q2)


def _tensors(found: Chaos, coefficients: Array) -> list[Array]:
    """[(b, d, …, d) symmetric tensor of Wick powers of degree 1, 2, …], scaled so that squares add up to variances."""
    d = found.powers.shape[1]
    tensors = []
    for degree in range(1, found.degree + 1):
        tensor = np.zeros((len(coefficients), *[d] * degree))
        for term, powers in enumerate(found.powers):
            if powers.sum() == degree:
                where = [k for k, power in enumerate(powers) for _ in range(power)]
                orders = np.array(sorted(set(itertools.permutations(where))))
                places: tuple[Any, ...] = (slice(None), *orders.T)
                tensor[places] = coefficients[:, [term]] / math.sqrt(len(orders))
        tensors.append(tensor)
    return tensors


def _known(tensors: Sequence[Array], rows: Array) -> Array:
    """(b,) variance that is known when `rows` · u is known."""
    across = np.linalg.qr(rows.T)[0]
    total = np.zeros(len(tensors[0]))
    for tensor in tensors:
        for _ in range(tensor.ndim - 1):
            tensor = np.moveaxis(np.tensordot(tensor, across, axes=(1, 0)), -1, tensor.ndim - 1)
        total += np.sum(tensor.reshape(len(tensor), -1) ** 2, axis=1)
    return total


def _shares(tensors: Sequence[Array], rows: Array) -> dict[str, Array]:
    """{name: (b, d)}."""
    d, b = len(rows), len(tensors[0])
    whole = sum((np.sum(t.reshape(b, -1) ** 2, axis=1) for t in tensors), np.zeros(b))
    everything = range(d)
    first = np.stack([_known(tensors, rows[[i]]) for i in everything], axis=1)
    others = [[k for k in everything if k != i] for i in everything]
    without = np.stack([_known(tensors, rows[rest]) if rest else np.zeros(b) for rest in others], axis=1)
    found = {"first": first, "total": whole[:, np.newaxis] - without, "shapley": np.full((b, d), math.nan)}
    if d <= MOST:
        found["shapley"] = _gains(tensors, rows, whole)
    return {name: values / whole[:, np.newaxis] for name, values in found.items()}


def _gains(tensors: Sequence[Array], rows: Array, whole: Array) -> Array:
    """(b, d) mean gain of each input over all orders."""
    d, b = len(rows), len(whole)
    known = np.zeros((2**d, b))
    sizes = np.array([bits.bit_count() for bits in range(2**d)])
    for bits in range(1, 2**d - 1):
        known[bits] = _known(tensors, rows[[k for k in range(d) if bits >> k & 1]])
    known[-1] = whole
    weight = np.array([1.0 / (d * math.comb(d - 1, size)) for size in range(d)])
    gains = np.zeros((b, d))
    for i in range(d):
        before = np.flatnonzero(~(np.arange(2**d) >> i) & 1)
        gains[:, i] = weight[sizes[before]] @ (known[before | 1 << i] - known[before])
    return gains
