"""Marginals and their copula against closed forms, quadrature and OpenTURNS."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats
from scipy.special import ndtr

from sprain_cosim.uq.distributions import (
    Beta,
    Choices,
    Empirical,
    Exponential,
    Fixed,
    JointDistribution,
    LogNormal,
    Marginal,
    Normal,
    Triangular,
    Truncated,
    Uniform,
    Weibull,
)
from sprain_cosim.uq.reliability import amv, form
from sprain_cosim.uq.sampling import monte_carlo

SAMPLE = Empirical(tuple(np.random.default_rng(5).normal(5.0, 1.0, 30).round(2)))
SMOOTH = [Weibull(5.0, 1.0), Weibull(1.0, 2.0), Beta(2.0, 3.0, 1.0, 4.0), Beta.of_moments(0.4, 0.1), Exponential(2.0)]
KINKED = [Triangular(0.0, 1.0, 3.0), Triangular(0.0, 0.0, 3.0), Triangular(-2.0, 1.0, 1.0), SAMPLE]
CUT = [
    Truncated(Weibull(5.0, 1.0), 4.0, 7.0),
    Truncated(Beta(2.0, 3.0), 0.1, 0.9),
    Truncated(SAMPLE, 4.5, 5.5),
    Truncated(Exponential(2.0), 20.0),
    Truncated(Triangular(0.0, 1.0, 3.0), 0.5, 2.0),
    Truncated(Uniform(0.0, 1.0), 0.2, 0.5),
]
U = np.linspace(-4.0, 4.0, 33)


def name(marginal: Marginal) -> str:
    return f"{type(marginal).__name__} {marginal.mean:.3g}"


@pytest.mark.parametrize("marginal", [*SMOOTH, *KINKED, *CUT, Choices((0.0, 1.0, 3.0), (1.0, 2.0, 1.0))], ids=name)
def test_moments_are_those_of_the_map(marginal: Marginal) -> None:
    grid = np.linspace(-9.0, 9.0, 200_001)
    weights = np.exp(-0.5 * grid**2)
    weights /= weights.sum()
    x = marginal.from_standard(grid)
    near = 1e-4 if marginal.is_discrete else 1e-8
    assert np.all(np.diff(x) >= -1e-14 * np.abs(x[1:]))  # but for rounding
    assert marginal.mean == pytest.approx(weights @ x, rel=near)
    assert marginal.sd == pytest.approx(math.sqrt(weights @ (x - weights @ x) ** 2), rel=near)


@pytest.mark.parametrize("marginal", [*SMOOTH, *KINKED, *CUT], ids=name)
def test_the_map_and_its_inverse_and_its_slope(marginal: Marginal) -> None:
    x = marginal.from_standard(U)
    inner = np.diff(x, prepend=-np.inf) > 0
    assert marginal.to_standard(x)[inner][1:-1] == pytest.approx(U[inner][1:-1], abs=1e-5)
    step = 1e-6
    slope = (marginal.from_standard(U + step) - marginal.from_standard(U - step)) / (2.0 * step)
    assert marginal.slope(U) == pytest.approx(slope, rel=1e-4, abs=1e-7)
    assert marginal.cdf(x)[inner][1:-1] == pytest.approx(ndtr(U)[inner][1:-1], rel=1e-4)


@pytest.mark.parametrize("marginal", [Weibull(5.0, 1.0), Exponential(2.0)], ids=name)
def test_both_tails_keep_their_digits(marginal: Marginal) -> None:
    u = np.array([-30.0, -10.0, 10.0, 30.0])
    assert marginal.to_standard(marginal.from_standard(u)) == pytest.approx(u, rel=1e-12)


def with_moments(marginal: Marginal, mean: float, sd: float) -> Marginal:
    match marginal:
        case Beta():
            return Beta.of_moments(mean, sd, marginal.low, marginal.high)
        case Truncated():
            return Truncated(with_moments(marginal.parent, mean, sd), marginal.low, marginal.high)
        case _:
            return type(marginal)(mean, sd)  # type: ignore[call-arg]


def log_density(marginal: Marginal, x: np.ndarray) -> np.ndarray:
    u = marginal.to_standard(x)
    return -0.5 * u**2 - np.log(marginal.slope(u))


@pytest.mark.parametrize(
    "marginal",
    [
        Weibull(5.0, 1.0),
        Weibull(1.0, 2.0),
        Beta(2.0, 3.0, 1.0, 4.0),
        CUT[0],
        Truncated(Beta(2.0, 3.0, 1.0, 4.0), 1.5, 3.0),
    ],
    ids=name,
)
def test_scores_are_derivatives_of_the_log_density(marginal: Marginal) -> None:
    """And `standard_shift` those of u at a held x; both by central differences of the parameters."""
    x = marginal.from_standard(np.linspace(-2.5, 2.5, 11))
    parent = marginal.parent if isinstance(marginal, Truncated) else marginal
    for of, exact in (
        (log_density, marginal.score(x)),
        (lambda m, v: m.to_standard(v), marginal.standard_shift(x)),
    ):
        for k in range(2):
            step = np.array([1e-5, 0.0] if k == 0 else [0.0, 1e-5])
            up, down = (with_moments(marginal, *(np.array([parent.mean, parent.sd]) + s * step)) for s in (1, -1))
            assert exact[k] == pytest.approx((of(up, x) - of(down, x)) / 2e-5, abs=2e-6)


def test_weibull_by_its_formula_parameters() -> None:
    marginal = Weibull.of_shape(2.5, 3.0)
    assert marginal.shape == pytest.approx(2.5, rel=1e-10)
    assert marginal.scale == pytest.approx(3.0, rel=1e-10)
    x = np.linspace(0.1, 8.0, 20)
    assert marginal.cdf(x) == pytest.approx(stats.weibull_min.cdf(x, 2.5, scale=3.0), rel=1e-9)


def test_an_empirical_marginal_has_the_percentiles_of_its_sample_and_never_leaves_it() -> None:
    values = np.array(SAMPLE.values)
    for p in (0.05, 0.31, 0.5, 0.95):
        assert SAMPLE.from_standard(stats.norm.ppf(p)) == pytest.approx(np.quantile(values, p))
    assert SAMPLE.from_standard(np.array([-20.0, 20.0])) == pytest.approx([values.min(), values.max()])
    assert SAMPLE.sd < values.std(ddof=1)
    tied = Empirical((1.0, 2.0, 2.0, 2.0, 3.0))
    assert tied.to_standard(np.array([2.0]))[0] == pytest.approx(0.0, abs=1e-12)


def test_choices_come_with_their_weights() -> None:
    marginal = Choices((0.0, 1.0, 3.0), (1.0, 2.0, 1.0))
    x = monte_carlo(JointDistribution([marginal]), 4000, seed=1)[:, 0]
    for value, p in zip(marginal.values, (0.25, 0.5, 0.25), strict=True):
        assert np.mean(x == value) == pytest.approx(p, abs=4 * math.sqrt(p * (1 - p) / len(x)))
    assert marginal.cdf([-1.0, 0.0, 0.5, 1.0, 3.0]) == pytest.approx([0.0, 0.25, 0.25, 0.75, 1.0])
    assert marginal.probability_outside(0.0, 1.0) == pytest.approx(0.25)
    assert marginal.from_standard(marginal.to_standard(np.array(marginal.values))) == pytest.approx(marginal.values)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Weibull(-1.0, 1.0), "must be positive"),
        (lambda: Weibull(1.0, 0.0), "must be positive"),
        (lambda: Weibull(1.0, 1e-6), "out of range"),
        (lambda: Weibull.of_shape(0.0, 1.0), "must be positive"),
        (lambda: Exponential(0.0), "must be positive"),
        (lambda: Triangular(0.0, 4.0, 3.0), "mode must lie between"),
        (lambda: Triangular(3.0, 3.0, 3.0), "low must be below high"),
        (lambda: Beta(0.0, 1.0), "must be positive"),
        (lambda: Beta.of_moments(0.5, 0.5), "sd must lie between"),
        (lambda: Beta.of_moments(2.0, 0.1), "mean must lie between"),
        (lambda: Choices((1.0,)), "at least two different values"),
        (lambda: Choices((1.0, 1.0)), "at least two different values"),
        (lambda: Choices((0.0, 1.0), (1.0, -1.0)), "weights must be positive"),
        (lambda: Choices((0.0, 1.0), (1.0,)), "1 weights for 2 values"),
        (lambda: Empirical((1.0, 2.0)), "at least three"),
        (lambda: Empirical((2.0, 2.0, 2.0)), "use Fixed"),
        (lambda: Truncated(Fixed(1.0), 0.0, 2.0), "Fixed cannot be truncated"),
        (lambda: Truncated(Choices((0.0, 1.0)), 0.0, 2.0), "Choices cannot be truncated"),
        (lambda: Truncated(CUT[0], 0.0, 2.0), "Truncated cannot be truncated"),
        (lambda: Truncated(SAMPLE, 50.0), "no probability to speak of"),
    ],
)
def test_impossible_parameters_are_refused(make, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()


def test_a_search_refuses_choices() -> None:
    inputs = [Normal(0.0, 1.0), Choices((0.0, 1.0))]
    for search in (lambda: amv(lambda x: x[:, 0], inputs), lambda: form(lambda x: x[:, 0], inputs, -3.0)):
        with pytest.raises(ValueError, match="input 1 is a choice"):
            search()


# correlations


@pytest.mark.parametrize("kind", ["pearson", "spearman"])
def test_a_sample_has_the_correlation_asked_for(kind) -> None:
    """Of every pair of kinds of marginals, within four standard errors."""
    marginals = [Normal(0.0, 1.0), Weibull(1.0, 0.7), Triangular(0.0, 1.0, 3.0), SAMPLE, LogNormal(1.0, 0.5)]
    wanted = np.full((5, 5), 0.45) + 0.55 * np.eye(5)
    joint = JointDistribution(marginals, wanted, kind)
    x = monte_carlo(joint, 20_000, seed=3)
    found = stats.spearmanr(x).statistic if kind == "spearman" else np.corrcoef(x.T)
    assert found == pytest.approx(wanted, abs=4 / math.sqrt(len(x)))
    assert joint.correlation == pytest.approx(np.corrcoef(x.T), abs=4 / math.sqrt(len(x)))


def test_spearman_of_two_normals_is_a_closed_form() -> None:
    joint = JointDistribution([Normal(0.0, 1.0), Normal(5.0, 2.0)], [[1.0, 0.5], [0.5, 1.0]], "spearman")
    assert joint.normal_correlation[0, 1] == pytest.approx(2.0 * math.sin(math.pi / 12.0), rel=1e-14)
    assert joint.correlation is not None
    assert joint.correlation[0, 1] == pytest.approx(joint.normal_correlation[0, 1], rel=1e-12)


def test_a_series_and_a_gauss_rule_agree_where_both_hold() -> None:
    from sprain_cosim.uq.distributions.joint import _pair_correlation, _series_correlation

    for pair in ((LogNormal(1.0, 0.5), Normal(0.0, 1.0)), (Uniform(0.0, 1.0), LogNormal(1.0, 0.3))):
        for rho in (-0.8, 0.3, 0.6):
            assert _series_correlation(*pair, rho) == pytest.approx(_pair_correlation(*pair, rho), abs=1e-9)


def test_impossible_correlations_are_refused() -> None:
    half = [[1.0, 0.5], [0.5, 1.0]]
    with pytest.raises(ValueError, match="a choice cannot be correlated"):
        JointDistribution([Normal(0.0, 1.0), Choices((0.0, 1.0))], half)
    with pytest.raises(ValueError, match="must lie strictly between"):
        JointDistribution([Weibull(1.0, 2.0), Normal(0.0, 1.0)], [[1.0, 0.99], [0.99, 1.0]])
    with pytest.raises(ValueError, match="'pearson' or 'spearman'"):
        JointDistribution([Normal(0.0, 1.0)] * 2, half, "kendall")  # type: ignore[arg-type]


# OpenTURNS


@pytest.mark.parametrize("marginal", [*SMOOTH, *KINKED[:3], *CUT[:2], CUT[3], CUT[4]], ids=name)
def test_marginals_agree_with_openturns(marginal: Marginal) -> None:
    ot = pytest.importorskip("openturns")

    def theirs(of: Marginal):
        match of:
            case Weibull():
                return ot.WeibullMin(of.scale, of.shape)
            case Beta():
                return ot.Beta(of.alpha, of.beta, of.low, of.high)
            case Exponential():
                return ot.Exponential(1.0 / of.mean)
            case Triangular():
                return ot.Triangular(of.low, of.mode, of.high)
            case Truncated() if math.isinf(of.high):
                return ot.TruncatedDistribution(theirs(of.parent), of.low)
            case Truncated():
                return ot.TruncatedDistribution(theirs(of.parent), of.low, of.high)

    other = theirs(marginal)
    assert marginal.mean == pytest.approx(other.getMean()[0], rel=1e-6)
    assert marginal.sd == pytest.approx(other.getStandardDeviation()[0], rel=1e-6)
    assert marginal.from_standard(U) == pytest.approx(
        [other.computeQuantile(p)[0] for p in ndtr(U)], rel=1e-6, abs=1e-7
    )
