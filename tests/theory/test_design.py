"""The least value of a parameter for which a goal holds: against the truth of functions that cost nothing."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import ndtr

from sprain_cosim.uq.design import DesignResult, design
from sprain_cosim.uq.distributions import Array, JointDistribution, Normal, Uniform
from sprain_cosim.uq.exceedance import Bounds
from sprain_cosim.uq.measured import Measured
from sprain_cosim.uq.sampling import sobol

from .standin import INPUTS, inversion, landing

INPUTS_OF_STUDY_6 = [Normal(0.0, 1.0)] * INPUTS
CADAVERS = Normal(35.0, 6.0)
ROWS = sobol(JointDistribution(INPUTS_OF_STUDY_6), 1 << 15, 99, replicates=1)
TRUTHS = {0.02: 1.453, 0.005: 2.125}
TWO = [Normal(0.0, 1.0)] * 2


def stiff(x: Array) -> Array:
    """(n,) u₁, u₂, s -> a response normal given s: mean 30 - 4 s, SD √(2² + 0.6²)."""
    return np.asarray(30.0 - 4.0 * x[:, 2] + 2.0 * x[:, 0] + 0.6 * x[:, 1], float)


SD = math.hypot(2.0, 0.6)


def probability(s: float, threshold: float = 24.0, sd: float = 0.0) -> float:
    """P(stiff > T), T ~ N(threshold, sd)."""
    return float(ndtr((30.0 - 4.0 * s - threshold) / math.hypot(SD, sd)))


def repeated(goal: float, repeats: int) -> tuple[float, float, float]:
    """RMS relative error of P, share of intervals that hold the truth, share of values that hold with confidence."""
    found = [
        design(landing, INPUTS_OF_STUDY_6, [(0.5, 3.0)], CADAVERS, goal, seed=seed).points[0] for seed in range(repeats)
    ]
    near = TRUTHS[goal] + np.linspace(-0.1, 0.1, 5)
    curve = np.log([float(np.mean(CADAVERS.cdf(inversion(ROWS, s)))) for s in near])
    truth = float(np.interp(-math.log(goal), -curve, near))
    errors = np.exp(np.interp([point.value for point in found], near, curve)) / goal - 1.0
    covered = [point.low <= truth <= point.high for point in found]
    holds = [not point.value_95 < truth for point in found]
    return float(np.sqrt(np.mean(errors**2))), float(np.mean(covered)), float(np.mean(holds))


def test_the_designer_s_question_in_300_landings() -> None:
    error, covered, holds = repeated(0.02, 1)
    assert error <= 0.04 and covered == holds == 1.0


@pytest.mark.long
@pytest.mark.parametrize("goal", [0.02, 0.005])
def test_error_and_coverage_over_400_repeats(goal: float) -> None:
    error, covered, holds = repeated(goal, 400)
    assert error <= 0.04 and covered >= 0.93 and holds >= 0.92


def test_two_doubts_stand_apart_and_the_curve_is_the_truth_s() -> None:
    found = design(stiff, TWO, [(0.0, 4.0)], Measured(Normal(24.0, 1.5), 10), 0.02, evaluations=150)
    (point,) = found.points
    truth = brentq(lambda s: probability(s, sd=1.5) - 0.02, 0.0, 4.0)
    assert (found.find, point.status, found.evaluations) == ("least", "met", 150)
    assert point.value == pytest.approx(truth, abs=0.01) and point.low <= truth + 1e-3 and truth - 1e-3 <= point.high
    assert point.probability.value == pytest.approx(0.02, rel=0.02)
    threshold = point.probability.threshold
    assert threshold is not None and threshold.low < 0.01 < 0.04 < threshold.high
    assert set(point.probability.shapes) == {"normal", "lognormal", "weibull"} and point.probability.specimens == 10
    near = point.curve.probability > 0.002
    exact = [probability(s, sd=1.5) for s in point.curve.parameter[near]]
    assert point.curve.probability[near] == pytest.approx(exact, rel=0.03)
    assert point.curve.low[-1] == 0.0  # less than a tenth of the goal


def test_a_fixed_threshold_and_bounds_take_the_lower_end() -> None:
    truth = brentq(lambda s: probability(s) - 0.05, 0.0, 4.0)
    (fixed,) = design(stiff, TWO, [(0.0, 4.0)], 24.0, 0.05, evaluations=150).points
    (box,) = design(stiff, TWO, [(0.0, 4.0)], Bounds(24.0, 26.0), 0.05, evaluations=150).points
    assert fixed.value == pytest.approx(truth, abs=0.03) and box.value == fixed.value
    assert math.isnan(box.probability.value) and box.probability.threshold is not None
    assert box.probability.threshold.high == pytest.approx(0.05, rel=0.1)
    assert box.probability.threshold.low < 0.01


def test_the_largest_value_where_the_goal_holds_below() -> None:
    found = design(lambda x: stiff(x * [1, 1, -1]), TWO, [(-4.0, 0.0)], 24.0, 0.05, evaluations=150)
    truth = -brentq(lambda s: probability(s) - 0.05, 0.0, 4.0)
    (point,) = found.points
    assert found.find == "largest" and point.value == pytest.approx(truth, abs=0.03)
    assert point.value_95 <= point.value


def test_a_goal_that_nothing_or_everything_meets_says_so() -> None:
    (never,) = design(stiff, TWO, [(0.0, 0.5)], 24.0, 0.01, evaluations=100).points
    assert never.status == "nowhere" and never.value == 0.5 and math.isnan(never.value_95)
    assert never.probability.value == pytest.approx(probability(0.5), rel=0.1)
    (always,) = design(stiff, TWO, [(3.5, 5.0)], 24.0, 0.05, evaluations=100).points
    assert (always.status, always.value, always.value_95) == ("everywhere", 3.5, 3.5)


def test_a_threshold_that_no_row_comes_near_to_is_answered() -> None:
    found = design(stiff, TWO, [(1.0, 3.0)], 1e18, 0.02, evaluations=100).points[0]
    assert (found.status, found.probability.value) == ("everywhere", 0.0)
    assert found.probability.sampling.high < 0.02


def test_the_probability_beside_a_value_is_what_its_status_says() -> None:
    """Rows moved along the surface would say 0.0501 of a value that divides at 0.05; what the polynomial says stands
    apart."""
    apart = 0
    for seed in range(4):
        (point,) = design(landing, INPUTS_OF_STUDY_6, [(0.5, 3.0)], CADAVERS, 0.05, evaluations=150, seed=seed).points
        sampled = point.probability.sampling
        assert point.status == "met" and 0.05 - 1e-12 < point.probability.value <= 0.05
        assert sampled.low < 0.05 < sampled.high
        apart += abs(point.surface - 0.05) > 1e-4
    assert apart >= 3


def test_where_the_goal_ceases_to_hold_again() -> None:
    def valley(x: Array) -> Array:
        return np.asarray(20.0 + 3.0 * (x[:, 2] - 2.0) ** 2 + x[:, 0], float)

    (point,) = design(valley, TWO, [(0.0, 4.0)], 24.0, 0.02, evaluations=150).points
    truth = math.sqrt((4.0 - 2.0537) / 3.0)
    assert point.status == "met" and point.value == pytest.approx(2.0 - truth, abs=0.05)
    assert point.other_end == pytest.approx(2.0 + truth, abs=0.15)


def test_a_second_parameter_gives_a_trade_off_curve() -> None:
    def both(x: Array) -> Array:
        return stiff(x[:, :3]) - 2.0 * x[:, 3]

    found = design(both, TWO, [(0.0, 4.0), (0.0, 1.0)], 24.0, 0.05, evaluations=300)
    truth = brentq(lambda s: probability(s) - 0.05, 0.0, 4.0)
    assert [point.second for point in found.points] == [0.0, 0.25, 0.5, 0.75, 1.0]
    for point in found.points:
        assert point.second is not None and point.value == pytest.approx(truth - 0.5 * point.second, abs=0.05)


def test_rows_that_fail_widen_the_interval() -> None:
    def failing(x: Array) -> Array:
        return np.where(np.arange(len(x)) % 20 == 0, np.nan, stiff(x))

    (whole,) = design(stiff, TWO, [(0.0, 4.0)], Normal(24.0, 1.0), 0.05, evaluations=200).points
    found = design(failing, TWO, [(0.0, 4.0)], Normal(24.0, 1.0), 0.05, evaluations=200)
    (point,) = found.points
    assert found.failed == 12 and point.failed == 5
    assert point.value_95 - point.value > 3 * (whole.value_95 - whole.value)
    with pytest.raises(ValueError, match="landings failed"):
        design(lambda x: np.where(x[:, 0] > 0, np.nan, stiff(x)), TWO, [(0.0, 4.0)], 24.0, 0.05)


@pytest.mark.parametrize(
    ("ranges", "goal", "evaluations", "text"),
    [
        ([(3.0, 1.0)], 0.02, 300, "must rise"),
        ([(0.0, 1.0)] * 3, 0.02, 300, "one, or two"),
        ([(0.0, 1.0)], 1.0, 300, "between 0 and 1"),
        ([(0.0, 1.0)], 0.02, 99, "at least 100"),
    ],
)
def test_what_cannot_be_a_question(ranges: list[tuple[float, float]], goal: float, evaluations: int, text: str) -> None:
    with pytest.raises(ValueError, match=text):
        design(stiff, TWO, ranges, 24.0, goal, evaluations=evaluations)


def test_every_law_of_a_threshold_is_smoothed_alike() -> None:
    """A uniform threshold, whose smoothing has no closed form, against its own truth."""
    (point,) = design(stiff, TWO, [(0.0, 4.0)], Uniform(22.0, 26.0), 0.05, evaluations=150).points
    t = np.linspace(22.0, 26.0, 2001)
    truth = brentq(lambda s: float(np.mean([probability(s, v) for v in t])) - 0.05, 0.0, 4.0)
    assert point.value == pytest.approx(truth, abs=0.03)


def test_the_same_seed_gives_the_same_answer() -> None:
    def once(seed: int) -> DesignResult:
        return design(stiff, TWO, [(0.0, 4.0)], 24.0, 0.05, evaluations=100, seed=seed)

    assert once(1).points[0].value == once(1).points[0].value != once(2).points[0].value
