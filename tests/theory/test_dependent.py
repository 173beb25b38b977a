"""Shares of the variance among dependent inputs: closed forms, the order of the inputs, intervals, OpenTURNS."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from sprain_cosim.uq.chaos import basis, multi_indices, orthonormal
from sprain_cosim.uq.dependent import dependent_shares
from sprain_cosim.uq.distributions import Array, Choices, Fixed, JointDistribution, LogNormal, Normal, Uniform
from sprain_cosim.uq.sampling import monte_carlo
from sprain_cosim.uq.sensitivity import given_data_indices

CORRELATION = np.array([[1.0, 0.5, 0.0, 0.2], [0.5, 1.0, -0.3, 0.0], [0.0, -0.3, 1.0, 0.4], [0.2, 0.0, 0.4, 1.0]])
NORMALS = [Normal(0.0, 1.0)] * 4
KINDS = ("first", "total", "shapley")


def rows(n: int, seed: int = 1) -> Array:
    return monte_carlo(JointDistribution(NORMALS, CORRELATION), n, seed)


@pytest.mark.parametrize("rho", [-0.9, 0.0, 0.6])
def test_two_inputs_of_a_linear_response(rho: float) -> None:
    """Closed forms of A. B. Owen, C. Prieur 2017, section 3; first and total of Mara and Tarantola 2012."""
    sds, correlation = np.array([1.5, 2.0]), np.array([[1.0, rho], [rho, 1.0]])
    inputs = [Normal(3.0, 1.5), Normal(-1.0, 2.0)]
    x = monte_carlo(JointDistribution(inputs, correlation), 60, seed=2)
    found = dependent_shares(x, x[:, 0] + x[:, 1], inputs, correlation)
    both = float(rho * sds[0] * sds[1])
    variance = float(sds @ sds) + 2.0 * both
    assert found.first * variance == pytest.approx((sds + rho * sds[::-1]) ** 2, abs=1e-9)
    assert found.total * variance == pytest.approx(sds**2 * (1.0 - rho**2), abs=1e-9)
    half = 0.5 * rho**2
    assert found.shapley * variance == pytest.approx(sds**2 * (1.0 - half) + both + half * sds[::-1] ** 2, abs=1e-9)


def known(slopes: Array, matrix: Array, chosen: list[int]) -> float:
    """Var E[b·z + z·Bz | z_A], from the conditional law of the other z."""
    others = [k for k in range(4) if k not in chosen]
    own = CORRELATION[np.ix_(chosen, chosen)]
    across = np.zeros((4, len(chosen)))
    across[chosen] = np.eye(len(chosen))
    across[others] = CORRELATION[np.ix_(others, chosen)] @ np.linalg.inv(own)
    linear, quadratic = across.T @ slopes, across.T @ matrix @ across
    return float(linear @ own @ linear + 2.0 * np.trace(quadratic @ own @ quadratic @ own))


def test_a_quadratic_response_has_the_shares_of_its_conditional_means() -> None:
    rng = np.random.default_rng(3)
    slopes, matrix = rng.standard_normal(4), rng.standard_normal((4, 4))
    matrix = 0.5 * (matrix + matrix.T)
    x = rows(200)
    found = dependent_shares(x, x @ slopes + np.einsum("ni,ij,nj->n", x, matrix, x), NORMALS, CORRELATION)
    variance = known(slopes, matrix, [0, 1, 2, 3])
    gains = np.zeros(4)
    for order in itertools.permutations(range(4)):
        steps = [known(slopes, matrix, sorted(order[:k])) if k else 0.0 for k in range(5)]
        gains[list(order)] += np.diff(steps) / math.factorial(4)
    rest = [[k for k in range(4) if k != i] for i in range(4)]
    assert found.degree == 2
    assert found.first * variance == pytest.approx([known(slopes, matrix, [i]) for i in range(4)], rel=1e-9)
    assert found.total == pytest.approx([1.0 - known(slopes, matrix, r) / variance for r in rest], abs=1e-9)
    assert found.shapley * variance == pytest.approx(gains, rel=1e-9)
    assert found.shapley.sum() == pytest.approx(1.0, abs=1e-12)


def test_a_cubic_response_by_quadrature() -> None:
    """E[y | z₀] of y = z₀z₁² + z₁³ on Gauss-Hermite nodes."""
    x = rows(200)[:, :2]
    inputs, correlation = NORMALS[:2], CORRELATION[:2, :2]
    found = dependent_shares(x, x[:, 0] * x[:, 1] ** 2 + x[:, 1] ** 3, inputs, correlation)
    nodes, weights = np.polynomial.hermite_e.hermegauss(12)
    weights = weights / weights.sum()
    second = 0.5 * nodes[:, np.newaxis] + math.sqrt(0.75) * nodes
    y = nodes[:, np.newaxis] * second**2 + second**3
    mean = y @ weights
    variance = weights @ (y**2 @ weights) - (weights @ mean) ** 2
    assert found.first[0] == pytest.approx((weights @ mean**2 - (weights @ mean) ** 2) / variance, abs=1e-9)
    assert found.total[1] == pytest.approx(1.0 - found.first[0], abs=1e-9)


def test_the_order_of_the_inputs_does_not_matter() -> None:
    inputs = [LogNormal(0.30, 0.05), Normal(0.0, 5.0), Uniform(1.0, 2.0), Fixed(3.0)]
    correlation = np.eye(4)
    correlation[:3, :3] = CORRELATION[:3, :3]
    x = monte_carlo(JointDistribution(inputs, correlation), 300, seed=4)
    y = 36.0 * x[:, 0] + 0.34 * x[:, 1] * x[:, 2] + np.sin(x[:, 1])
    found = dependent_shares(x, y, inputs, correlation)
    assert found.first[3] == found.total[3] == found.shapley[3] == 0.0
    for order in ([1, 3, 0, 2], [2, 1, 0, 3]):
        other = dependent_shares(x[:, order], y, [inputs[k] for k in order], correlation[np.ix_(order, order)])
        for kind, end in itertools.product(KINDS, ("", "_low", "_high")):
            assert getattr(other, kind + end) == pytest.approx(getattr(found, kind + end)[order], abs=1e-9)


def test_without_correlation_they_are_the_indices_of_independent_inputs() -> None:
    x = monte_carlo(JointDistribution(NORMALS), 200, seed=5)
    y = x[:, 0] + x[:, 0] * x[:, 1] + 0.5 * x[:, 2] ** 2 + 0.1 * np.random.default_rng(5).standard_normal(200)
    found, plain = dependent_shares(x, y, NORMALS), given_data_indices(x, y, NORMALS, 3)
    for kind in KINDS:
        assert getattr(found, kind) == pytest.approx(getattr(plain, kind), abs=1e-9)
        assert getattr(found, f"{kind}_high") == pytest.approx(getattr(plain, f"{kind}_high"), abs=0.02)
    assert np.all(plain.first <= plain.shapley + 1e-12)
    assert np.all(plain.shapley <= plain.total + 1e-12)


def held(n: int, studies: int, wave: float) -> dict[str, Array]:
    """Share of the intervals that hold the shares of a noisy polynomial, and of what a `wave` beside it adds."""

    def response(x: Array, rng: np.random.Generator, noise: float) -> Array:
        smooth = 2.0 * x[:, 0] + x[:, 1] * x[:, 2] - 0.7 * x[:, 3] ** 2
        return smooth + wave * np.sin(2.0 * x[:, 2] + 1.0) + noise * rng.standard_normal(len(x))

    rng = np.random.default_rng(6)
    x = rows(20_000 if wave else 500, 7)
    truth = dependent_shares(x, response(x, rng, 0.0), NORMALS, CORRELATION)
    found = {kind: np.zeros(4) for kind in KINDS}
    for seed in range(studies):
        x = rows(n, 100 + seed)
        one = dependent_shares(x, response(x, rng, 0.6), NORMALS, CORRELATION, seed=seed)
        for kind in KINDS:
            exact = getattr(truth, kind)
            found[kind] += (getattr(one, f"{kind}_low") <= exact) & (exact <= getattr(one, f"{kind}_high"))
    return {kind: count / studies for kind, count in found.items()}


def test_intervals_hold_the_shares() -> None:
    assert min(float(share.mean()) for share in held(200, 12, 0.0).values()) >= 0.85


@pytest.mark.long
def test_intervals_hold_the_shares_in_many_studies() -> None:
    """What no polynomial of low degree has is not in them: a wave, 3 % of the variance, costs some."""
    for share in held(200, 300, 0.0).values():
        assert share.mean() >= 0.93
        assert share.min() >= 0.90
    for share in held(200, 300, 0.5).values():
        assert share.mean() >= 0.90


def test_what_has_no_shares_is_refused() -> None:
    with pytest.raises(ValueError, match="is a choice"):
        dependent_shares(np.zeros((9, 1)), np.arange(9.0), [Choices((0.0, 1.0))])
    with pytest.raises(ValueError, match="does not vary"):
        dependent_shares(rows(50), np.ones(50), NORMALS, CORRELATION)
    with pytest.raises(ValueError, match="too few"):
        dependent_shares(rows(9), np.arange(9.0), NORMALS, CORRELATION)


def test_many_inputs_have_no_shapley_shares() -> None:
    inputs, correlation = [Normal(0.0, 1.0)] * 12, np.eye(12)
    correlation[0, 1] = correlation[1, 0] = 0.5
    x = monte_carlo(JointDistribution(inputs, correlation), 100, seed=8)
    found = dependent_shares(x, x[:, 0] + x[:, 2], inputs, correlation)
    assert np.isnan(found.shapley).all()
    assert found.first[0] == pytest.approx(0.5, abs=1e-9)
    assert found.total[0] == pytest.approx(0.375, abs=1e-9)


def test_openturns_has_the_same_indices_of_independent_inputs() -> None:
    ot = pytest.importorskip("openturns")
    x = monte_carlo(JointDistribution(NORMALS), 200, seed=9)
    y = x[:, 0] + x[:, 0] * x[:, 1] + 0.3 * x[:, 2] ** 3 - 0.5 * x[:, 3] ** 2
    marginals = [ot.Normal()] * 4
    basis = ot.OrthogonalProductPolynomialFactory([ot.HermiteFactory()] * 4)
    adaptive = ot.FixedStrategy(basis, basis.getEnumerateFunction().getBasisSizeFromTotalDegree(3))
    algorithm = ot.FunctionalChaosAlgorithm(
        ot.Sample(x), ot.Sample(y[:, np.newaxis]), ot.JointDistribution(marginals), adaptive, ot.LeastSquaresStrategy()
    )
    algorithm.run()
    theirs = ot.FunctionalChaosSobolIndices(algorithm.getResult())
    found = dependent_shares(x, y, NORMALS)
    assert found.first == pytest.approx([theirs.getSobolIndex(i) for i in range(4)], abs=1e-9)
    assert found.total == pytest.approx([theirs.getSobolTotalIndex(i) for i in range(4)], abs=1e-9)


@pytest.mark.parametrize("tie", [0.0, 1e-2, 1e-7])
def test_factors_of_a_basis_are_those_of_reflections(tie: float) -> None:
    """Of independent columns by their products, of nearly dependent ones by reflections: both to rounding."""
    u = np.random.default_rng(4).standard_normal((300, 4))
    if tie:
        u[:, 3] = u[:, 2] + tie * u[:, 3]
    columns = basis(u, np.array(multi_indices(4, 2)))
    q, r = orthonormal(columns)
    assert np.allclose(q @ r, columns, rtol=0, atol=1e-12 * np.abs(columns).max())
    assert np.allclose(q.T @ q, np.eye(15), rtol=0, atol=1e-9)
    assert np.allclose(np.abs(r), np.abs(np.linalg.qr(columns)[1]), rtol=0, atol=1e-9 * np.abs(r).max())
