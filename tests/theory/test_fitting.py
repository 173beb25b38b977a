"""Fits of measured samples against scipy and against the laws that simulated samples obey."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from sprain_cosim.uq.distributions import LogNormal, Normal, Weibull
from sprain_cosim.uq.fitting import _simulated_statistics, extreme_estimates, fit_family, fit_sample

SAMPLE = np.random.default_rng(1).weibull(3.0, 30) * 5.0


def test_parameters_and_aicc_are_those_of_maximum_likelihood() -> None:
    found = fit_sample(SAMPLE)
    shape, _, scale = stats.weibull_min.fit(SAMPLE, floc=0)
    weibull = found.families["weibull"].marginal
    assert isinstance(weibull, Weibull)
    assert (weibull.shape, weibull.scale) == pytest.approx((shape, scale), rel=1e-4)
    normal, lognormal = found.families["normal"].marginal, found.families["lognormal"].marginal
    assert isinstance(normal, Normal)
    assert isinstance(lognormal, LogNormal)
    assert (normal.mean, normal.sd) == pytest.approx((SAMPLE.mean(), SAMPLE.std(ddof=1)))
    assert (lognormal.lam, lognormal.zeta) == pytest.approx((np.log(SAMPLE).mean(), np.log(SAMPLE).std(ddof=1)))
    correction = 4.0 + 12.0 / (len(SAMPLE) - 3)
    likelihoods = {
        "normal": stats.norm.logpdf(SAMPLE, *stats.norm.fit(SAMPLE)).sum(),
        "lognormal": stats.lognorm.logpdf(SAMPLE, *stats.lognorm.fit(SAMPLE, floc=0)).sum(),
        "weibull": stats.weibull_min.logpdf(SAMPLE, shape, 0, scale).sum(),
    }
    for name, likelihood in likelihoods.items():
        assert found.families[name].aicc == pytest.approx(correction - 2.0 * likelihood, abs=1e-5)
    assert found.best.aicc == min(fit.aicc for fit in found.families.values())


@pytest.mark.filterwarnings("ignore:.*:FutureWarning")
def test_anderson_darling_is_scipys() -> None:
    found = fit_sample(SAMPLE)
    assert found.families["normal"].anderson_darling == pytest.approx(stats.anderson(SAMPLE, "norm").statistic)
    logs = np.log(SAMPLE)
    assert found.families["weibull"].anderson_darling == pytest.approx(
        stats.anderson(logs, "gumbel_l").statistic, rel=1e-6
    )


@pytest.mark.parametrize(("extreme", "ten", "five"), [(False, 0.631, 0.752), (True, 0.637, 0.757)])
@pytest.mark.parametrize("n", [10, 30])
def test_simulated_critical_values_are_the_published_ones(extreme: bool, ten: float, five: float, n: int) -> None:
    """Stephens' modified statistic: 10 % and 5 % points of normal and Weibull, both parameters estimated."""
    factor = 1.0 + 0.2 / math.sqrt(n) if extreme else 1.0 + 0.75 / n + 2.25 / n**2
    found = np.quantile(_simulated_statistics(n, extreme), [0.9, 0.95]) * factor
    assert found == pytest.approx([ten, five], abs=0.05)


def test_a_p_value_is_uniform_under_its_own_family() -> None:
    rng = np.random.default_rng(2)
    p = [fit_family(rng.normal(3.0, 2.0, 20), "normal").p_value for _ in range(300)]
    assert stats.kstest(p, "uniform").pvalue > 0.001


def test_the_family_behind_a_large_sample_is_found() -> None:
    rng = np.random.default_rng(3)
    for family, sample in (
        ("normal", rng.normal(10.0, 3.0, 400)),
        ("lognormal", rng.lognormal(1.0, 0.5, 400)),
        ("weibull", rng.weibull(1.5, 400)),
    ):
        found = fit_sample(sample)
        assert found.best.family == family
        assert not found.warnings


def test_what_a_sample_cannot_tell_is_said() -> None:
    few = fit_sample([4.1, 4.4, 5.0, 5.2, 5.9, 6.3])
    assert any("cannot tell" in w for w in few.warnings)
    assert few.alternatives
    three = fit_sample([1.0, 2.0, 3.0])
    assert three.best.family == "normal"
    assert "cannot choose" in three.warnings[0]
    two_humps = np.concatenate([np.random.default_rng(4).normal(m, 0.3, 30) for m in (2.0, 8.0)])
    assert any("fits badly" in w for w in fit_sample(two_humps).warnings)
    assert set(fit_sample([-1.0, 2.0, 3.0, 4.0]).families) == {"normal"}


@pytest.mark.parametrize(
    ("sample", "message"),
    [
        ([], "is empty"),
        ([1.0, 2.0], "too few"),
        ([2.0, 2.0, 2.0, 2.0], "nothing varies"),
        ([1.0, 2.0, math.nan], "not finite"),
    ],
)
def test_samples_that_say_nothing_are_refused(sample: list[float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        fit_sample(sample)


def test_families_that_need_positive_values_say_so() -> None:
    for absurd in (1e-300, 1e300):
        with pytest.raises(ValueError, match="what is their unit"):
            fit_sample(np.array([0.2, 0.21, 0.25, absurd]))
    with pytest.raises(ValueError, match="need positive values"):
        fit_sample([-1.0, 2.0, 3.0, 4.0], ("lognormal", "weibull"))
    with pytest.raises(ValueError, match="needs positive values"):
        fit_family([-1.0, 2.0, 3.0, 4.0], "weibull")


def test_many_samples_are_fitted_at_once_as_one_by_one() -> None:
    logs = np.log(np.random.default_rng(6).weibull(2.0, (5, 12)))
    location, scale = extreme_estimates(logs)
    for k in range(5):
        assert extreme_estimates(logs[k : k + 1])[0][0] == pytest.approx(location[k], rel=1e-12)
        shape, _, width = stats.weibull_min.fit(np.exp(logs[k]), floc=0)
        assert (1.0 / scale[k], math.exp(location[k])) == pytest.approx((shape, width), rel=1e-3)
