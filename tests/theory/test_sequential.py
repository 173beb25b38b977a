"""Samples that stop when they tell enough: false decisions and missed intervals stay below what was stated, however
many looks."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.special import ndtr, ndtri

from sprain_cosim.study.until import FIRST_LOOK, Until
from sprain_cosim.uq.distributions import Normal
from sprain_cosim.uq.sequential import decide, look_confidence, planned_looks, spent
from tests.theory import standin

LOOKS = list(range(20, 1001, 20))  # fifty


def test_fifty_looks_decide_falsely_in_less_than_five_per_cent() -> None:
    """2000 comparisons without a difference; looking at plain 95 % intervals decides falsely in a third of them."""
    rng = np.random.default_rng(1)
    false = peeked = 0
    for _ in range(2000):
        d = rng.standard_normal(1000)
        n = np.array(LOOKS)
        mean = np.cumsum(d)[n - 1] / n
        peeked += bool(np.any(np.abs(mean) * np.sqrt(n) > 1.96))
        false += decide({"a": d}, LOOKS)["a"].decided
    assert peeked / 2000 > 0.25
    assert false / 2000 <= 0.05


def test_three_pairs_without_a_difference_are_decided_falsely_as_seldom() -> None:
    rng, looks = np.random.default_rng(2), list(range(10, 101, 10))
    wrong = 0
    for _ in range(400):
        found = decide({k: rng.standard_normal(100) for k in "abc"}, looks)
        wrong += any(d.decided for d in found.values())
    assert wrong / 400 <= 0.05


def test_a_brace_of_scale_1_5_against_1_6_is_decided_in_twenty_pairs() -> None:
    """On the stand-in for a landing, the same landings with each; nineteen times in twenty, and never the wrong way."""
    early = 0
    for seed in range(100):
        u = np.random.default_rng(seed).standard_normal((60, standin.INPUTS))
        found = decide({"1.6": standin.inversion(u, 1.5) - standin.inversion(u, 1.6)}, list(range(10, 61, 5)))["1.6"]
        assert found.sign == 1
        early += found.n <= 20
    assert early >= 95


def test_the_spent_error_sums_to_alpha() -> None:
    assert sum(spent(k) for k in range(1, 100_000)) == pytest.approx(0.05, rel=1e-4)


def test_earlier_decisions_stand_as_looks_are_added() -> None:
    rng = np.random.default_rng(3)
    d = {"large": 2.0 + rng.standard_normal(100), "none": rng.standard_normal(100)}
    first, later = decide(d, [10, 20]), decide(d, [10, 20, 40, 80])
    assert first["large"] == later["large"]
    assert later["large"].n == 10
    assert later["none"].looks[:2] == first["none"].looks
    assert not later["none"].decided
    low, high = later["none"].looks[-1].difference.low, later["none"].looks[-1].difference.high
    assert low < 0.0 < high


def test_differences_that_do_not_vary() -> None:
    found = decide({"same": np.zeros(10), "always": np.ones(10)}, [10])
    assert not found["same"].decided
    assert found["always"].sign == 1


def test_trials_that_failed_are_no_differences() -> None:
    d = np.where(np.arange(40) % 2, np.nan, 3.0 + np.random.default_rng(4).standard_normal(40))
    found = decide({"half": d, "all": np.full(40, np.nan)}, [8, 20])
    assert [look.n for look in found["half"].looks] == [4, 10]
    assert found["half"].looks[0].p_value == 1.0
    assert found["half"].sign == 1
    assert not found["all"].decided


def test_an_interval_excludes_zero_where_its_pair_is_decided_and_nowhere_else() -> None:
    """Three pairs of about the same evidence: those behind the first that is not rejected keep its level."""
    rng = np.random.default_rng(5)
    for _ in range(50):
        found = decide({k: 0.9 + rng.standard_normal(10) for k in "abc"}, [10])
        for pair in found.values():
            (look,) = pair.looks
            assert pair.decided == (look.difference.low * look.difference.high > 0.0)


def test_looks_out_of_order_are_refused() -> None:
    for looks, message in (([10, 10], "must ascend"), ([3], "at 5 pairs or later"), ([30], "of which there are 20")):
        with pytest.raises(ValueError, match=message):
            decide({"a": np.arange(20.0)}, looks)
    with pytest.raises(ValueError, match="counts from 1"):
        spent(0)


@pytest.mark.parametrize(("looks", "boundary"), [([7], 1.960), ([1, 2], 2.178), ([1, 2, 3, 4, 5], 2.413)])
def test_the_boundary_of_evenly_spread_looks_is_pocock_s(looks: list[int], boundary: float) -> None:
    """S. J. Pocock, Biometrika 64 (1977) 191, table 1."""
    assert ndtri(0.5 * (1.0 + look_confidence(looks))) == pytest.approx(boundary, abs=6e-4)


def test_looks_at_nearly_the_same_rows_cost_little_and_more_looks_never_less() -> None:
    each = [look_confidence(planned_looks(most, FIRST_LOOK)) for most in (50, 100, 931, 1000, 100_000)]
    assert each == sorted(each)
    assert each[3] - each[2] < 1e-3
    with pytest.raises(ValueError, match="must ascend"):
        look_confidence([10, 10])


Y = 20.0, 3.0  # a response, normal, against a threshold of 35 ± 6
DRAWS: dict[str, tuple[Callable[[np.random.Generator], np.ndarray], Until, float]] = {
    "mean": (lambda r: r.standard_normal(1000), Until("", 0.2), 0.0),
    "mean of a skewed response": (lambda r: np.exp(r.standard_normal(1000)), Until("", 0.4), math.exp(0.5)),
    "95 % level": (lambda r: r.standard_normal(1000), Until("", 0.3, level=0.95), float(ndtri(0.95))),
    "P of 5 %": (lambda r: r.standard_normal(1000), Until("", 0.04, threshold=float(ndtri(0.95))), 0.05),
    "P at an uncertain threshold": (
        lambda r: Y[0] + Y[1] * r.standard_normal(1000),
        Until("", 0.005, threshold=Normal(35.0, 6.0)),
        float(ndtr((Y[0] - 35.0) / math.hypot(Y[1], 6.0))),
    ),
}


def stopped_studies(name: str, studies: int) -> tuple[float, float, float]:
    """Share of studies that stop early whose interval holds the truth, the same for plain 95 % intervals at every look,
    and the mean number of trials of the former."""
    draw, until, truth = DRAWS[name]
    looks, rng = planned_looks(1000, FIRST_LOOK), np.random.default_rng(8)
    each, held, taken = (look_confidence(looks), 0.95), [0, 0], 0
    for _ in range(studies):
        y = draw(rng)
        for k, confidence in enumerate(each):
            for n in looks:
                found = until.estimate(y[:n], 0, confidence)
                if until.known(found):
                    break
            held[k] += found.low <= truth <= found.high
            taken += n if k == 0 else 0
    return held[0] / studies, held[1] / studies, taken / studies


@pytest.mark.parametrize("name", DRAWS)
def test_the_interval_at_which_a_study_stops_holds_as_often_as_stated(name: str) -> None:
    held, _, taken = stopped_studies(name, 150)
    assert held >= 0.95 - 2.0 * math.sqrt(0.95 * 0.05 / 150)
    assert taken < 700


@pytest.mark.long
@pytest.mark.parametrize("name", DRAWS)
def test_the_interval_of_2000_stopped_studies_holds_as_often_as_stated(name: str) -> None:
    held, _, _ = stopped_studies(name, 2000)
    assert held >= 0.95 - 2.0 * math.sqrt(0.95 * 0.05 / 2000)


@pytest.mark.long
def test_plain_intervals_at_every_look_hold_less_often_than_stated() -> None:
    """What the correction is for."""
    assert stopped_studies("mean", 2000)[1] < 0.95
