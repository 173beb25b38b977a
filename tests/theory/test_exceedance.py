"""P(Y > T): the sample's interval on the unsafe side, the threshold's own doubt apart from it, and which dominates."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats
from scipy.special import ndtri

from sprain_cosim.uq.distributions import JointDistribution, LogNormal, Marginal, Normal, Uniform, Weibull
from sprain_cosim.uq.exceedance import (
    Bounds,
    doubted_exceedance,
    exceedance_curve,
    input_interval,
    of_shapes,
    threshold_interval,
    weighted_exceedance,
)
from sprain_cosim.uq.fitting import fit_family, fit_sample
from sprain_cosim.uq.measured import Measured
from sprain_cosim.uq.reliability import rare_event
from sprain_cosim.uq.sampling import sobol
from sprain_cosim.uq.statistics import Estimate, exceedance, replicated_exceedance

CADAVERS = Normal(35.0, 6.0)  # inversion of cadaver ankles at failure, as the literature states it [deg]
LANDINGS = 21.35 + 1.97 * np.random.default_rng(1).standard_normal(4065)


# the sample's interval


def _misses(law, threshold: Marginal, n: int, repeats: int) -> tuple[float, float]:
    """Share of intervals that lie below the truth (unsafe) and above it."""
    rng = np.random.default_rng(7)
    truth = float(np.mean(threshold.cdf(law(rng, 400_000))))
    found = [exceedance(law(rng, n), threshold) for _ in range(repeats)]
    return float(np.mean([e.high < truth for e in found])), float(np.mean([e.low > truth for e in found]))


def _normal(rng, n):
    return 21.5 + 2.0 * rng.standard_normal(n)


def _skewed(rng, n):
    return 18.0 + np.exp(1.1 + 0.45 * rng.standard_normal(n))


def _two_kinds(rng, n):
    return np.where(rng.random(n) < 0.2, 27.0, 20.0) + rng.standard_normal(n)


@pytest.mark.parametrize("n", [20, 50, 200])
def test_intervals_of_a_probability_seldom_miss_on_the_unsafe_side(n: int) -> None:
    """2.5 % are stated on either side; Student's interval misses 8, 6 and 4 % there."""
    unsafe, safe = _misses(_normal, CADAVERS, n, 400)
    assert unsafe <= 0.04
    assert safe <= 0.05


@pytest.mark.long
@pytest.mark.parametrize("law", [_normal, _skewed, _two_kinds])
@pytest.mark.parametrize("sd", [6.0, 4.0, 3.0])  # P from 2e-2 down to 1e-4
@pytest.mark.parametrize("n", [20, 50, 200, 1000])
def test_intervals_of_rare_events_of_skewed_responses(law, sd: float, n: int) -> None:
    unsafe, safe = _misses(law, Normal(35.0, sd), n, 1500)
    assert unsafe <= 0.06
    assert safe <= 0.04


def test_a_sample_that_never_comes_near_is_bounded_from_its_tail() -> None:
    """Few values carry the mean: the bound reaches the truth, where the spread alone stays below it in a third."""
    threshold, rng = Normal(35.0, 3.0), np.random.default_rng(3)
    truth = stats.norm.sf((35.0 - 21.5) / math.hypot(3.0, 2.0))
    short, bounded = 0, []
    for _ in range(200):
        y = _normal(rng, 50)
        f = threshold.cdf(y)
        short += f.mean() + 2.01 * f.std(ddof=1) / math.sqrt(50) < truth
        bounded.append(exceedance(y, threshold).high)
    assert short > 50
    assert np.sum(np.array(bounded) < truth) < 5
    assert np.median(bounded) < 100 * truth


# the threshold's interval


@pytest.mark.parametrize(("n", "low", "high"), [(10, 0.0008, 0.155), (20, 0.002, 0.08), (50, 0.005, 0.048)])
def test_the_cadaver_threshold_by_the_specimens_behind_it(n: int, low: float, high: float) -> None:
    """Beside a sampling interval of a few per cent; numbers of another implementation on other landings of study 6."""
    found = doubted_exceedance(LANDINGS, Measured(CADAVERS, n))
    assert found.threshold is not None
    assert found.threshold.low == pytest.approx(low, rel=0.2)
    assert found.threshold.high == pytest.approx(high, rel=0.1)
    assert found.sampling.high / found.sampling.low < 1.1
    assert found.dominates == "threshold"
    assert found.value == pytest.approx(0.0158, rel=0.05)


@pytest.mark.parametrize("family", ["normal", "lognormal", "weibull"])
@pytest.mark.parametrize(
    ("n", "repeats"),
    [(8, 100), pytest.param(5, 1000, marks=pytest.mark.long), pytest.param(30, 1000, marks=pytest.mark.long)],
)
def test_threshold_intervals_cover(family, n: int, repeats: int) -> None:
    """Specimens drawn, fitted, and P(T < 26) asked again and again: 95 % hold the truth."""
    rng, truth = np.random.default_rng(n), {"normal": CADAVERS, "lognormal": LogNormal(35.0, 6.0)}.get(family)
    truth = truth or Weibull(35.0, 6.0)
    exact, hits = float(truth.cdf(26.0)), 0
    for k in range(repeats):
        specimens = truth.from_standard(rng.standard_normal(n))
        law = Measured(fit_family(specimens, family).marginal, n)
        found = threshold_interval(np.array([26.0]), law, seed=k)
        hits += found.low <= exact <= found.high
    assert abs(hits / repeats - 0.95) <= 4 * math.sqrt(0.05 * 0.95 / repeats)


def test_the_posterior_of_a_normal_is_students_and_chi_squared() -> None:
    draws = Measured(CADAVERS, 8).draws(seed=1)
    t = (draws.location - 35.0) / (6.0 / math.sqrt(8))
    chi = 7 * 36.0 / draws.scale**2
    for p in (0.05, 0.5, 0.95):
        assert np.mean(t <= stats.t.ppf(p, 7)) == pytest.approx(p, abs=0.01)
        assert np.mean(chi <= stats.chi2.ppf(p, 7)) == pytest.approx(p, abs=0.01)


def test_the_stated_law_is_among_the_draws() -> None:
    y = np.linspace(20.0, 50.0, 7)
    for marginal in (CADAVERS, LogNormal(35.0, 6.0), Weibull(35.0, 6.0)):
        stated = Measured(marginal, 10).stated()
        assert stated.cdf(y)[0] == pytest.approx(marginal.cdf(y), rel=1e-10)
        density = np.exp(stated.log_density(y)[0])
        slope = np.gradient(marginal.cdf(np.linspace(34.99, 35.01, 3)), 0.01)[1]
        middle = float(np.exp(stated.log_density(np.array([35.0]))[0, 0]))
        assert middle / (1.0 if isinstance(marginal, Normal) else 35.0) == pytest.approx(slope, rel=1e-5)
        assert np.all(density > 0)


def test_shapes_of_the_same_mean_and_sd() -> None:
    """One threshold, three laws: a factor of four lies between them."""
    found = of_shapes(LANDINGS, CADAVERS)
    assert found["normal"] == pytest.approx(0.0158, rel=0.05)
    assert found["lognormal"] == pytest.approx(0.0057, rel=0.1)
    assert found["weibull"] == pytest.approx(0.0246, rel=0.05)
    assert set(of_shapes(LANDINGS, Uniform(-1.0, 1.0))) == {"normal"}


def test_bounds_are_a_box_without_a_value() -> None:
    found = doubted_exceedance(LANDINGS, Bounds(23.0, 25.0))
    assert math.isnan(found.value)
    assert found.threshold is not None
    assert found.threshold.low == np.mean(LANDINGS > 25.0)
    assert found.threshold.high == np.mean(LANDINGS > 23.0)
    assert found.sampling.low < found.threshold.high < found.sampling.high
    assert "narrower bounds" in found.sentence()


# which dominates


def test_the_sentence_says_what_dominates_and_what_would_narrow_it() -> None:
    many = doubted_exceedance(LANDINGS, Measured(CADAVERS, 10))
    assert "from 40 specimens" in many.sentence()
    assert many.more is not None
    assert many.threshold is not None
    assert many.more.half_width < 0.6 * many.threshold.half_width
    known = doubted_exceedance(LANDINGS[:100], 24.0)
    assert known.threshold is None
    assert not known.shapes
    assert known.dominates == "sampling"
    assert "the threshold is known" in known.sentence()
    unstated = doubted_exceedance(LANDINGS, CADAVERS)
    assert unstated.threshold is None
    assert "n is not stated" in unstated.sentence()
    alike = doubted_exceedance(LANDINGS[:25], Measured(CADAVERS, 200))
    assert alike.dominates == "both"
    assert "both needed" in alike.sentence()
    assert doubted_exceedance(np.ones(30), 5.0).dominates == "sampling"


def test_a_sampler_of_its_own_for_samples_that_are_not_independent() -> None:
    found = doubted_exceedance(
        LANDINGS[:4064],
        Measured(CADAVERS, 10),
        sampler=lambda threshold: replicated_exceedance(LANDINGS[:4064], 8, threshold),
    )
    assert found.sampling == replicated_exceedance(LANDINGS[:4064], 8, CADAVERS)


@pytest.mark.parametrize("rows", [1.0, 2.0])
def test_a_replicated_sample_that_has_not_met_the_tail_keeps_its_upper_end_open(rows: float) -> None:
    """Events of which a sample has one or two, behind a threshold that varies: by the replicates' spread alone the
    intervals of 0.22 and 0.12 of the samples ended below the truth."""
    n, spread = 128, 0.3
    threshold = Normal(float(ndtri(1.0 - rows / n)) * math.hypot(1.0, spread), spread)
    joint, weights = JointDistribution([Normal(0.0, 1.0)] * 3), np.array([3.0, 2.0, 1.0]) / math.sqrt(14.0)
    found = [replicated_exceedance(sobol(joint, n, seed) @ weights, 8, threshold) for seed in range(100)]
    assert np.mean([e.high < rows / n for e in found]) <= 0.05


@pytest.mark.parametrize("n", [64, 128])
def test_the_upper_end_allows_for_a_lognormal_tail_that_the_rows_have_not_met(n: int) -> None:
    """P = 0.6 % of a response with SD 1 in its logs: with an exponential tail alone two or three of ten samples ended
    below the truth."""
    threshold, rng = Normal(12.6, 0.6), np.random.default_rng(3)
    truth = float(np.mean(threshold.cdf(np.exp(rng.standard_normal(2_000_000)))))
    found = [exceedance(np.exp(rng.standard_normal(n)), threshold) for _ in range(150)]
    assert truth == pytest.approx(0.0057, rel=0.03)
    assert np.mean([e.high < truth for e in found]) <= 0.10


@pytest.mark.parametrize("at", [50.0, 60.0, 62.5, 80.0])
def test_a_threshold_that_no_row_comes_near_leaves_an_upper_end_above_what_the_rows_show(at: float) -> None:
    """Terms of 1e-120 have no third power, those of 1e-200 no square: one was a division by zero, the other an upper
    end of 1e-254."""
    y = 24.0 + np.random.default_rng(0).standard_normal(100)
    found = exceedance(y, Normal(at, 1.0))
    assert 0.0 <= found.low <= found.value < 1e-100
    assert 1e-30 < found.high < 0.04


def test_failed_trials_widen_the_sampling_interval_alone() -> None:
    found = doubted_exceedance(LANDINGS, Measured(CADAVERS, 10), failed=100)
    whole = doubted_exceedance(LANDINGS, Measured(CADAVERS, 10))
    assert found.sampling.high > whole.sampling.high
    assert found.threshold == whole.threshold


def test_a_large_sample_enters_the_outer_loop_thinned() -> None:
    rng = np.random.default_rng(2)
    y = 21.35 + 1.97 * rng.standard_normal(50_000)
    many, few = (threshold_interval(v, Measured(CADAVERS, 10)) for v in (y, y[:2000]))
    exact = float(np.mean(CADAVERS.cdf(y)))
    assert many.value == pytest.approx(exact, rel=1e-12)
    assert many.low == pytest.approx(few.low, rel=0.1)


def test_the_curve_over_fixed_thresholds() -> None:
    found = exceedance_curve(LANDINGS, [15.0, 21.35, 40.0])
    assert found.value == pytest.approx([np.mean(t < LANDINGS) for t in (15.0, 21.35, 40.0)])
    assert np.all((found.low <= found.value) & (found.value <= found.high))
    assert found.high[2] == pytest.approx(exceedance(LANDINGS, 40.0).high)


# specimens behind an input


def test_specimens_behind_an_input_move_the_probability() -> None:
    """A stiffness known from n samples: the range of P by weights is the range that new landings would give."""
    rng = np.random.default_rng(5)
    stiffness, noise = Normal(1.5, 0.15), rng.standard_normal(20_000)

    def respond(x: np.ndarray, e: np.ndarray) -> np.ndarray:
        return 24.0 - 5.0 * (x - 1.5) + 1.5 * e

    x = stiffness.from_standard(rng.standard_normal(20_000))
    law = Measured(stiffness, 30)
    found = input_interval(x[:, None], respond(x, noise), CADAVERS, {0: law})
    draws = law.draws(seed=9, size=256)
    again = [
        float(np.mean(CADAVERS.cdf(respond(m + s * rng.standard_normal(20_000), noise))))
        for m, s in zip(draws.location, draws.scale, strict=True)
    ]
    low, high = np.quantile(again, [0.025, 0.975])
    assert found.low == pytest.approx(low, rel=0.03)
    assert found.high == pytest.approx(high, rel=0.03)
    assert found.low < found.value < found.high


def test_a_sample_that_does_not_reach_is_refused() -> None:
    rng = np.random.default_rng(6)
    x = rng.normal(1.5, 0.15, (200, 1))
    with pytest.raises(ValueError, match="reaches too little"):
        input_interval(x, 24.0 - x[:, 0], CADAVERS, {0: Measured(Normal(1.5, 0.15), 3)})


# what is refused


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Measured(CADAVERS, 2), "n = 2: at least 3 specimens"),
        (lambda: Measured(Uniform(0.0, 1.0), 10), "goes with normal, lognormal or weibull, not with Uniform"),
        (lambda: Bounds(3.0, 3.0), "low must be below high"),
        (lambda: Bounds(3.0, math.inf), "must be finite"),
    ],
)
def test_thresholds_that_cannot_be(make, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()


def test_a_fit_carries_its_specimens() -> None:
    law = Measured.of_fit(fit_sample(np.random.default_rng(1).normal(35.0, 6.0, 12)))
    assert law.n == 12


# rows drawn where exceedances are


@pytest.mark.parametrize("specimens", [10, 50])
def test_landings_about_the_design_points_know_what_specimens_leave_open(specimens: int) -> None:
    """A linear response, sampled about its design point: the same range as 100 000 plain landings, from 450."""
    threshold = Measured(CADAVERS, specimens)
    found = rare_event(
        lambda x: 21.35 + 1.97 * (0.6 * x[:, 0] + 0.8 * x[:, 1]),
        [Normal(0.0, 1.0)] * 2,
        CADAVERS,
        above=True,
        n=450,
    )
    weighted = weighted_exceedance(found.sampling.y, found.sampling.weights, threshold, found.probability)
    plain = 21.35 + 1.97 * np.random.default_rng(2).standard_normal(100_000)
    expected = doubted_exceedance(plain, threshold)
    assert weighted.value == pytest.approx(expected.value, rel=0.03)
    for known, wanted in ((weighted.threshold, expected.threshold), (weighted.more, expected.more)):
        assert known is not None
        assert wanted is not None
        assert (known.low, known.high) == pytest.approx((wanted.low, wanted.high), rel=0.1)
    assert weighted.shapes == pytest.approx(expected.shapes, rel=0.06)
    assert weighted.dominates == "threshold"


def test_landings_that_do_not_reach_what_specimens_leave_open_say_so() -> None:
    rng = np.random.default_rng(3)
    y, weights = 60.0 + rng.standard_normal(200), np.exp(rng.standard_normal(200) * 3.0)
    with pytest.raises(ValueError, match="reach too little"):
        weighted_exceedance(y, weights, Measured(CADAVERS, 5), Estimate(1e-3, 5e-4, 2e-3))


def test_a_probable_event_is_asked_from_its_other_side() -> None:
    """Rows without weights are a plain sample: the same answer."""
    y = 40.0 + 2.0 * np.random.default_rng(4).standard_normal(300)
    expected = doubted_exceedance(y, Measured(CADAVERS, 20))
    weighted = weighted_exceedance(y, np.ones(len(y)), Measured(CADAVERS, 20), expected.sampling)
    assert weighted.threshold is not None
    assert expected.threshold is not None
    assert weighted.threshold.low == pytest.approx(expected.threshold.low, rel=1e-9)
    assert weighted.threshold.high == pytest.approx(expected.threshold.high, rel=1e-9)
