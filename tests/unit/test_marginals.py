"""Distributions as a study file writes them."""

from __future__ import annotations

import math
from typing import Any

import pytest

from sprain_cosim.errors import InputError
from sprain_cosim.study.marginals import FAMILIES, marginal
from sprain_cosim.units import unit
from sprain_cosim.uq import distributions
from sprain_cosim.uq.distributions import Fixed, Truncated

RAD = unit("rad")
DEGREE = math.pi / 180


@pytest.mark.parametrize(
    ("spec", "mean", "sd"),
    [
        ({"normal": {"mean": "30 deg", "sd": "5 deg"}}, 30, 5),
        ({"lognormal": {"mean": "30 deg", "sd": "5 deg"}}, 30, 5),
        ({"weibull": {"mean": "30 deg", "sd": "5 deg"}}, 30, 5),
        ({"exponential": {"mean": "30 deg"}}, 30, 30),
        ({"uniform": {"low": "0 deg", "high": "12 deg"}}, 6, 12 / math.sqrt(12)),
        ({"triangular": {"low": "0 deg", "mode": "6 deg", "high": "12 deg"}}, 6, 6 / math.sqrt(6)),
        ({"beta": {"alpha": 1, "beta": 1, "low": "0 deg", "high": "12 deg"}}, 6, 12 / math.sqrt(12)),
        ({"empirical": ["1 deg", "2 deg", "3 deg"]}, 2, math.sqrt(1 / 3)),
        ({"fixed": "7 deg"}, 7, 0),
        ({"choices": ["3 deg", "1 deg"]}, 2, 1),
        ({"choices": {"3 deg": 1, "1 deg": 3}}, 1.5, math.sqrt(0.75)),
        ({"triangular": {"low": "0 deg", "mode": "6 deg", "high": "12 deg"}, "low": "6 deg"}, 8, math.sqrt(2)),
        ({"empirical": ["1 deg", "2 deg", "3 deg"], "high": "2 deg"}, 1.5, math.sqrt(1 / 12)),
    ],
    ids=lambda v: next(iter(v)) if isinstance(v, dict) else "",
)
def test_families_have_the_moments_of_their_numbers(spec: dict[str, Any], mean: float, sd: float) -> None:
    found = marginal(spec, RAD, "here")
    assert found.mean == pytest.approx(mean * DEGREE)
    assert found.sd == pytest.approx(sd * DEGREE)


def test_a_spread_in_a_unit_with_a_zero_of_its_own_is_a_difference() -> None:
    """5 degC of standard deviation were 278.15 K."""
    found = marginal({"normal": {"mean": "20 degC", "sd": "5 degC"}}, unit("K"), "here")
    assert (found.mean, found.sd) == (293.15, 5.0)


def test_every_distribution_has_a_name() -> None:
    """But for `Truncated`, which low and high make, and for mixtures, which [population] makes."""
    made = {family.make for family in FAMILIES.values()}
    known = {getattr(distributions, name) for name in distributions.__all__} - {
        distributions.Array,
        distributions.JointDistribution,
        distributions.JointMixture,
        distributions.Marginal,
        distributions.Mixture,
        Truncated,
    }
    assert made == known
    assert isinstance(marginal({"normal": {"mean": 1, "sd": 1}, "low": 0}, None, "here"), Truncated)
    assert isinstance(marginal({"fixed": 1}, None, "here"), Fixed)


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        (3, "must be a distribution, such as"),
        ({"nromal": {}}, "unknown 'nromal' (did you mean normal?)"),
        ({}, "needs exactly one of normal, lognormal"),
        ({"normal": {"mean": "1 deg", "sd": "1 deg"}, "fixed": "1 deg"}, "needs exactly one of"),
        ({"normal": {"mean": "1 deg"}}, "normal = { mean = ..., sd = ... }"),
        ({"normal": {"mean": 1, "sd": "1 deg"}}, "here.mean = 1: needs a unit, for example"),
        ({"triangular": {"low": "1 deg"}}, "triangular = { low = ..., mode = ..., high = ... }"),
        ({"uniform": {"low": "1 deg", "high": "2 deg"}, "low": "1 deg"}, "low and high belong inside uniform"),
        ({"fixed": "1 deg", "high": "1 deg"}, "a fixed value has no low or high"),
        ({"choices": ["1 deg", "2 deg"], "high": "1 deg"}, "choices have no low or high"),
        ({"choices": ["1 deg", "1 deg"]}, "a value stands twice"),
        ({"choices": "1 deg"}, "choices must be a list"),
        ({"choices": {"1 deg": "a"}}, "weights must be numbers"),
        ({"samples": "bench.csv"}, "samples stand in a study file"),
        ({"empirical": "1 deg"}, "empirical must be a list of values"),
        ({"beta": {"alpha": "1 deg", "beta": 1, "low": "1 deg", "high": "2 deg"}}, "here.alpha"),
        ({"lognormal": {"mean": "0 deg", "sd": "0 deg"}}, "write { fixed = 0 }"),
    ],
)
def test_mistakes_name_their_place(spec: Any, message: str) -> None:
    with pytest.raises(InputError, match="here") as refused:
        marginal(spec, RAD, "here")
    assert message in str(refused.value)
