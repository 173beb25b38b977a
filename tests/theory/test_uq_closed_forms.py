"""Mean value, AMV, AMV+, HMV, FORM, sensitivities and percentile intervals on problems with closed forms."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy import stats

from sprain_cosim.uq import LogNormal, Normal, Uniform
from sprain_cosim.uq.distributions import JointDistribution
from sprain_cosim.uq.reliability import amv, amv_plus, form, hmv, mean_value, step_noise
from sprain_cosim.uq.sampling import monte_carlo, sobol
from sprain_cosim.uq.sensitivity import importance, pearson, sensitivity_factors, sobol_indices, spearman
from sprain_cosim.uq.statistics import (
    difference_of_means,
    mean,
    mean_of_largest,
    order_statistic_ranks,
    replicated_moments,
    replicated_percentile,
    standard_deviation,
)

A = np.array([3, -2, 1, 4, -1, 2, -3, 1, 2, -1], dtype=float)
TEN = [Normal(float(i), 0.1 * i) for i in range(1, 11)]
SPREAD = A * 0.1 * np.arange(1, 11)
MEAN, SD = float(A @ np.arange(1, 11)), float(np.linalg.norm(SPREAD))
LEVELS = (0.05, 0.5, 0.95)


def linear(x: np.ndarray) -> np.ndarray:
    return x @ A


@pytest.mark.parametrize("method", [mean_value, amv, amv_plus, hmv])
def test_a_linear_function_of_normals_is_exact(method) -> None:
    result = method(linear, TEN)
    for p in LEVELS:
        assert result.value[p] == pytest.approx(MEAN + SD * stats.norm.ppf(p), rel=1e-6)
    assert np.asarray(result.importance[0.95]) == pytest.approx(SPREAD / SD, abs=1e-6)
    assert result.status == "ok"


def test_form_of_a_linear_limit_state() -> None:
    """P(sum a x <= z): beta is the distance of z in standard deviations."""
    threshold = MEAN - 2.5 * SD
    result = form(linear, TEN, threshold)
    assert result.beta == pytest.approx(2.5, abs=1e-6)
    assert result.probability == pytest.approx(stats.norm.cdf(-2.5), rel=1e-5)


def product(x: np.ndarray) -> np.ndarray:
    return x[:, 0] ** 2 * x[:, 1] / x[:, 2]


def test_a_product_of_lognormals_is_linear_in_standard_space() -> None:
    """u-space AMV, AMV+ and FORM are exact for x1² x2 / x3; the lognormal's mean and SD are those of the variable."""
    marginals = [LogNormal(10.0, 1.0), LogNormal(5.0, 1.0), LogNormal(2.0, 0.5)]
    zeta2 = [math.log1p((sd / m) ** 2) for m, sd in ((10, 1), (5, 1), (2, 0.5))]
    location = [math.log(m) - z / 2 for m, z in zip((10, 5, 2), zeta2, strict=True)]
    mu = 2 * location[0] + location[1] - location[2]
    sigma = math.sqrt(4 * zeta2[0] + zeta2[1] + zeta2[2])
    plus = amv_plus(product, marginals)
    for p in LEVELS:
        assert plus.value[p] == pytest.approx(math.exp(mu + sigma * stats.norm.ppf(p)), rel=1e-5)
    result = form(product, marginals, math.exp(mu - 1.7 * sigma))
    assert result.beta == pytest.approx(1.7, abs=1e-5)


def test_amv_corrects_the_mean_value_of_a_square() -> None:
    """z = x², x ~ N(3, 0.5): AMV gives (3 + 0.5 beta)², mean value 9 + 3 beta."""
    square = [Normal(3.0, 0.5)]
    for p in LEVELS:
        beta = stats.norm.ppf(p)
        assert mean_value(lambda x: x[:, 0] ** 2, square, step=1e-4, difference="central").value[p] == pytest.approx(
            9 + 3 * beta, abs=1e-6
        )
        assert amv(lambda x: x[:, 0] ** 2, square, step=1e-4).value[p] == pytest.approx((3 + 0.5 * beta) ** 2, abs=1e-6)


def test_a_function_that_is_not_monotonic_is_rejected() -> None:
    result = amv(lambda x: (x[:, 0] - 0.01) ** 2, [Normal(0.0, 1.0)])
    assert result.status == "rejected"
    assert result.reasons


def test_sensitivity_factors_of_a_linear_function() -> None:
    """d(mean z)/d(mean i) = a_i, d(sd z)/d(sd i) = a_i² s_i / sd, normalised by s_i/sd; within four standard errors."""
    joint = JointDistribution(TEN)
    x = monte_carlo(joint, 20_000, seed=4)
    factors = sensitivity_factors(x, linear(x), TEN)
    share = SPREAD / SD
    for found, expected in (
        (factors.dmean_dmean, share),
        (factors.dsd_dsd, share**2),
        (factors.dmean_dsd, 0 * share),
        (factors.dsd_dmean, 0 * share),
    ):
        assert np.abs(found - expected).max() < 0.05
    assert np.asarray(pearson(x, linear(x)).value) == pytest.approx(share, abs=0.03)


PAIRS = {
    "linear": (lambda x, z: (x, x + z), math.sqrt(0.5), 0.93),
    "bent": (lambda x, z: (1.0 + x, (1.0 + x) ** 2 + 0.3 * z), 2.0 / math.sqrt(6.09), 0.88),
    "interaction": (lambda x, z: (x, x * (0.5 + z)), math.sqrt(0.2), 0.91),
    "lognormal": (lambda x, z: (np.exp(0.8 * x), np.exp(0.8 * x) + np.exp(0.8 * z)), math.sqrt(0.5), 0.88),
}


@pytest.mark.parametrize("pair", PAIRS)
def test_intervals_of_a_correlation_hold_for_responses_that_are_not_normal(pair: str) -> None:
    """By Fisher's error alone, which is that of two normal variables, they hold the truth in 0.75, 0.77 and 0.58 of the
    samples of the last three."""
    draw, truth, covers = PAIRS[pair]
    rng = np.random.default_rng(8)
    found = [pearson(*draw(*rng.standard_normal((2, 200)))) for _ in range(400)]
    assert np.mean([r.low[0] <= truth <= r.high[0] for r in found]) >= covers


def test_intervals_of_a_rank_correlation_hold_for_a_response_that_is_bent() -> None:
    """By Bonett and Wright's error alone in 0.75; the truth is that of a million rows."""
    draw = PAIRS["bent"][0]
    rng = np.random.default_rng(9)
    truth = float(spearman(*draw(*rng.standard_normal((2, 1_000_000)))).value[0])
    found = [spearman(*draw(*rng.standard_normal((2, 100)))) for _ in range(400)]
    assert np.mean([r.low[0] <= truth <= r.high[0] for r in found]) >= 0.89


def test_correlations_that_are_perfect_or_of_what_does_not_vary() -> None:
    x = np.arange(6.0)
    for found in (pearson(x, 2.0 * x), spearman(x, x**3)):
        assert (found.value[0], found.high[0]) == (pytest.approx(1.0), 1.0)
    for kind in (pearson, spearman):
        assert np.isnan(kind(x, np.ones(6)).low[0])


@pytest.mark.parametrize(("noise", "n"), [(False, 20), (False, 40), (True, 24)])
def test_errors_of_importance_hold_where_many_slopes_are_fitted_to_few_rows(noise: bool, n: int) -> None:
    """White's errors from the residuals as they are held in 0.60 to 0.80; the r2 of pure noise was 0.43."""
    rng, weights = np.random.default_rng(5), np.linspace(1.0, 0.2, 10)
    truth = np.eye(10)[0] if noise else weights / np.linalg.norm(weights)
    hits, r2 = np.zeros(10), []
    for _ in range(200):
        x = rng.standard_normal((n, 10))
        bent = 0.5 * (x[:, 0] ** 2 - 1.0) + 0.5 * x[:, 1] * x[:, 2]
        y = 0.05 * x[:, 0] + rng.standard_normal(n) if noise else x @ weights + bent
        found = importance(x, y, [Normal(0.0, 1.0)] * 10)
        hits += np.abs(found.alpha - truth) <= 1.96 * found.standard_error
        r2.append(found.r2)
    assert hits.min() / 200 >= 0.90
    assert abs(np.mean(r2) - (0.0025 if noise else 0.85)) < 0.12


def test_intervals_of_sensitivity_factors_hold_from_few_rows() -> None:
    """BCa's alone held 0.78 to 0.92; what the SD does to the SD is not known from 24 rows, and has no error."""
    rng, laws = np.random.default_rng(6), [LogNormal(1.0, 0.5), Normal(0.0, 1.0), Normal(0.0, 1.0)]
    joint, names = JointDistribution(laws), ("dmean_dmean", "dmean_dsd", "dsd_dmean")

    def factors(n: int, resamples: int = 0):
        x = joint.from_standard(rng.standard_normal((n, 3)))
        return sensitivity_factors(x, x @ [2.0, 0.7, 0.4], laws, resamples=resamples)

    truth, hits = factors(1_000_000), dict.fromkeys(names, 0.0)
    for _ in range(150):
        found = factors(24, 300)
        for name in names:
            low, high = getattr(found.low, name), getattr(found.high, name)
            hits[name] += np.mean((low <= getattr(truth, name)) & (getattr(truth, name) <= high)) / 150
    assert min(hits.values()) >= 0.90
    assert np.isnan(found.low.dsd_dsd).all()
    assert np.isnan(found.standard_error.dsd_dsd).all()


def test_sobol_indices_of_ishigami() -> None:
    """First-order 0.3139, 0.4424, 0 and total 0.5576, 0.4424, 0.2437 for a = 7, b = 0.1."""
    from sprain_cosim.uq import Uniform

    def ishigami(x: np.ndarray) -> np.ndarray:
        return np.sin(x[:, 0]) + 7 * np.sin(x[:, 1]) ** 2 + 0.1 * x[:, 2] ** 4 * np.sin(x[:, 0])

    result = sobol_indices(ishigami, [Uniform(-math.pi, math.pi)] * 3, 4096, seed=3)
    assert np.asarray(result.first) == pytest.approx([0.3139, 0.4424, 0.0], abs=0.02)
    assert np.asarray(result.total) == pytest.approx([0.5576, 0.4424, 0.2437], abs=0.02)


def test_sobol_indices_of_few_points_have_no_intervals() -> None:
    """Of 16 points those of the totals held the truth in one of two seeds."""
    for n, known in ((16, False), (32, True)):
        found = sobol_indices(lambda x: x @ [2.0, 1.0], [Normal(0.0, 1.0)] * 2, n, seed=1)
        ends = (found.first_low, found.first_high, found.total_low, found.total_high)
        assert np.isfinite(ends).all() == known and np.isfinite(found.total).all()
        assert known or np.isnan(ends).all()


def test_an_input_that_seldom_switches_a_response_keeps_its_upper_ends_open() -> None:
    """A response that is 0 or 1: of one seed in four the index of an input that moved it at no point was 0 ± 0."""
    weights = np.array([2.0, 1.8, -1.2, 0.5, 0.3])

    def found(n: int, seed: int):
        return sobol_indices(lambda x: (x @ weights > 1.5).astype(float), [Normal(0.0, 1.0)] * 5, n, seed)

    truth = found(2**15, 99).total
    few = [found(32, seed) for seed in range(60)]
    assert any(np.any(r.total == 0.0) for r in few)
    assert all(np.all(r.total_high > 0.0) and np.all(r.first_high > 0.0) for r in few)
    assert np.all(np.mean([r.total_high >= truth for r in few], axis=0) >= 0.93)


def test_enlarging_a_sample_keeps_its_rows_and_columns() -> None:
    joint = JointDistribution(TEN)
    assert (monte_carlo(joint, 1024, seed=7)[:128] == monte_carlo(joint, 128, seed=7)).all()
    other = JointDistribution([Normal(1.0, 9.0), *TEN[1:]])
    assert (monte_carlo(joint, 64, seed=7)[:, 1:] == monte_carlo(other, 64, seed=7)[:, 1:]).all()
    assert sobol(joint, 1024, seed=7).shape == (1024, 10)


@pytest.mark.parametrize(("n", "p"), [(1000, 0.05), (1000, 0.5), (1000, 0.95), (200, 0.9)])
def test_order_statistic_intervals_cover(n: int, p: float) -> None:
    """The binomial probability between the two ranks (counted from 1) is at least 95 %."""
    low, high = order_statistic_ranks(n, p)
    assert stats.binom.cdf(high - 1, n, p) - stats.binom.cdf(low - 1, n, p) >= 0.95


@pytest.mark.parametrize("method", [amv_plus, hmv])
def test_slopes_near_the_end_of_a_law_are_taken_within_it(method) -> None:
    """At the outer levels of a uniform input a step of 0.1 SD left its range: the landing was refused, and the search
    with it."""

    def response(x: np.ndarray) -> np.ndarray:
        return np.where((x[:, 0] >= 0.0) & (x[:, 0] <= 1.0), x[:, 0] + 0.2 * x[:, 0] ** 2 + 1e-3 * x[:, 1], np.nan)

    found = method(response, [Uniform(0.0, 1.0), Normal(0.0, 1.0)], levels=(0.01, 0.5, 0.99))
    for level, value in found.value.items():
        assert value == pytest.approx(level + 0.2 * level**2, abs=0.005)


def test_noise_of_a_response_is_measured_and_asks_for_a_larger_step() -> None:
    """Independent noise of 0.01 on a linear function: found within a factor of two; with it, steps of 0.1 sd are named
    as too small."""
    rng = np.random.default_rng(1)

    def noisy(x: np.ndarray) -> np.ndarray:
        return x[:, 0] + 0.01 * rng.standard_normal(len(x))

    one = [Normal(0.0, 1.0)]
    found = float(np.median([step_noise(noisy, one) for _ in range(20)]))
    assert 0.005 < found < 0.02
    assert step_noise(lambda x: np.sin(x[:, 0]), one) < 1e-12
    assert amv(lambda x: x[:, 0], one, noise=0.001).status == "ok"
    warned = amv(lambda x: x[:, 0], one, noise=0.05)
    assert warned.status == "suspect"
    assert "a step above" in warned.reasons[0]


@pytest.mark.parametrize(
    ("function", "options", "status", "reason"),
    [
        (
            lambda x: x[:, 0] + 0.4 * x[:, 0] ** 2 + 0.8 * x[:, 1],
            {"difference": "central"},
            "suspect",
            "curvature ratio",
        ),
        (lambda x: x[:, 0] - 0.9 * x[:, 0] ** 2, {"difference": "central"}, "rejected", "one-sided slopes change sign"),
        (lambda x: -np.abs(x[:, 0] - 0.2), {}, "rejected", "percentiles do not increase"),
        (lambda x: np.sinh(2 * x[:, 0]), {}, "suspect", "departs from the linearisation"),
        (
            lambda x: x[:, 0] + 0.7 * x[:, 0] * x[:, 1] + 1 / 3,
            {"levels": (0.05, 0.95), "plus": True},
            "suspect",
            "turned by",
        ),
        (lambda x: x[:, 0], {"variance": 4.0}, "suspect", "25% of the sampled variance"),
        (lambda x: 0 * x[:, 0] + 1.0, {}, "rejected", "every slope"),
        (lambda x: np.round(x[:, 0] + 0.01 * x[:, 1], 1), {}, "suspect", "comes in steps of 0.1"),
        (lambda x: x[:, 0] + 0 * x[:, 1], {"step": 0.1234567}, "ok", None),
    ],
    ids=["curvature", "sign", "order", "departure", "turn", "variance", "flat", "resolution", "inert input"],
)
def test_each_signal_of_the_gate(function, options: dict, status: str, reason: str | None) -> None:
    options = dict(options)
    method = amv_plus if options.pop("plus", False) else amv
    found = method(function, [Normal(0.0, 1.0)] * 2, **options)
    assert found.status == status, found.reasons
    assert reason is None or any(reason in r for r in found.reasons), found.reasons


def test_a_budget_ends_a_search_with_what_it_has() -> None:
    for method in (amv_plus, hmv):
        found = method(lambda x: np.exp(x[:, 0]) - 0.2 * x[:, 1] ** 3, [Normal(0.0, 1.0)] * 2, budget=11)
        assert found.evaluations.executed <= 11
        assert found.status != "ok"
        assert any("budget of 11" in r for r in found.reasons)


LAWS: dict[str, tuple[Callable[[np.random.Generator, int], np.ndarray], float]] = {
    "normal": (lambda rng, n: rng.standard_normal(n), 1.0),
    "exponential": (lambda rng, n: rng.exponential(size=n), 1.0),
    "lognormal": (lambda rng, n: np.exp(rng.standard_normal(n)), math.sqrt(math.e * math.expm1(1.0))),
}


@pytest.mark.parametrize(
    ("law", "n", "covers"),
    [
        ("normal", 24, 0.95),
        ("exponential", 24, 0.94),
        ("lognormal", 24, 0.89),
        ("normal", 100, 0.95),
        ("exponential", 100, 0.95),
        ("lognormal", 100, 0.94),
    ],
)
def test_intervals_of_a_standard_deviation(law: str, n: int, covers: float) -> None:
    """By the kurtosis alone those of the lognormal hold the truth in 0.75 at n = 100: its tail has not been met."""
    draw, truth = LAWS[law]
    rng = np.random.default_rng(5)
    found = [standard_deviation(draw(rng, n)) for _ in range(600)]
    assert np.mean([e.low <= truth <= e.high for e in found]) >= covers


@pytest.mark.parametrize("n", [128, 256])
def test_moments_of_a_replicated_sample_of_a_long_tail_cover(n: int) -> None:
    """A product of lognormals: by the spread of the replicates alone the mean held in 0.87 and 0.92, the SD in 0.68 and
    0.74. A normal response keeps what the sequence gains."""
    joint, weights = JointDistribution([Normal(0.0, 1.0)] * 3), np.array([0.8, 0.5, 0.3])
    truth, hits = (math.exp(0.49), math.exp(0.49) * math.sqrt(math.expm1(0.98))), np.zeros(2)
    for seed in range(120):
        logs = sobol(joint, n, seed) @ weights
        hits += [e.low <= t <= e.high for e, t in zip(replicated_moments(np.exp(logs), 8), truth, strict=True)]
    assert hits.min() / 120 >= 0.91
    assert replicated_moments(logs, 8)[0].half_width < 0.4 * mean(logs).half_width


def test_percentiles_of_small_replicated_samples_cover() -> None:
    """Percentiles of each replicate by itself hold the truth in 0.74 to 0.87 at 64 to 256 points; the replicates'
    shares below the pooled one do as stated."""
    joint = JointDistribution([Normal(0.0, 1.0)] * 3)

    def response(x: np.ndarray) -> np.ndarray:
        return np.maximum(x[:, 0], -0.3) + 0.5 * x[:, 1] * x[:, 2]

    exact = np.quantile(response(sobol(joint, 2**16, 99, 1)), [0.05, 0.5, 0.95])
    for n in (64, 256):
        samples = [response(sobol(joint, n, seed)) for seed in range(120)]
        for p, truth in zip((0.05, 0.5, 0.95), exact, strict=True):
            found = [replicated_percentile(y, 8, p) for y in samples]
            assert np.mean([e.low <= truth <= e.high for e in found]) >= 0.90
    assert math.isinf(replicated_percentile(samples[0][:16], 8, 0.95).high)


def test_one_sequence_gives_sobol_indices_of_less_error_and_intervals_that_hold() -> None:
    weights = np.array([2.0, 1.8, -1.2, 0.5, 0.3])
    exact = weights**2 / (weights @ weights)

    def found(replicates: int) -> tuple[float, float]:
        results = [
            sobol_indices(lambda x: x @ weights, [Normal(0.0, 1.0)] * 5, 256, seed, replicates=replicates)
            for seed in range(12)
        ]
        error = np.sqrt(np.mean([(r.first - exact) ** 2 for r in results]))
        return float(error), float(np.mean([(r.first_low <= exact) & (exact <= r.first_high) for r in results]))

    (alone, covered), (divided, _) = found(1), found(8)
    assert alone < 0.7 * divided
    assert covered >= 0.93


def test_difference_of_means_is_welchs() -> None:
    """Against SciPy's; few values are known badly."""
    rng = np.random.default_rng(4)
    one, other = rng.normal(2.0, 3.0, 4), rng.normal(0.0, 1.0, 36)
    found = difference_of_means(one, other)
    expected = stats.ttest_ind(one, other, equal_var=False).confidence_interval(0.95)
    assert (found.low, found.high) == pytest.approx(tuple(expected), rel=1e-10)
    assert found.value == one.mean() - other.mean()
    assert difference_of_means([1.0, 1.0], [0.5, 0.5]).half_width == 0.0


@pytest.mark.parametrize("n", [60, 400])
def test_interval_of_the_mean_of_the_largest_tenth_covers(n: int) -> None:
    """Of a normal variable: density over share at the border. That of a plain sample of the tenth covers 0.82."""
    rng, true = np.random.default_rng(8), stats.norm.pdf(stats.norm.ppf(0.9)) / 0.1
    samples = rng.standard_normal((1500, n))
    found = [mean_of_largest(y, y, n // 10) for y in samples]
    covered = np.mean([e.low <= true <= e.high for e in found])
    assert 0.91 <= covered <= 0.97
    assert found[0].value == np.sort(samples[0])[-(n // 10) :].mean()
    with pytest.raises(ValueError, match="expected between 2 and"):
        mean_of_largest(samples[0], samples[0], n)
