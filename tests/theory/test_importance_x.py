"""Importance of dependent inputs: the same whatever their order, and the closed form of a linear response."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sprain_cosim.uq.distributions import Choices, Fixed, JointDistribution, LogNormal, Normal
from sprain_cosim.uq.sampling import monte_carlo
from sprain_cosim.uq.sensitivity import importance, importance_x

INPUTS = [LogNormal(0.30, 0.05), Normal(0.0, 5.0), Normal(1.0, 0.1)]
CORRELATION = np.array([[1.0, 0.5, 0.0], [0.5, 1.0, -0.3], [0.0, -0.3, 1.0]])


def respond(x: np.ndarray) -> np.ndarray:
    return 36.0 * x[:, 0] + 0.34 * x[:, 1] - 4.0 * x[:, 2] + 0.01 * x[:, 1] ** 2


def test_the_order_of_the_inputs_does_not_matter() -> None:
    """To 1e-9, where the importance of independent variables moves by tenths."""
    x = monte_carlo(JointDistribution(INPUTS, CORRELATION), 400, seed=1)
    y = respond(x)
    found, before = importance_x(x, y, INPUTS, CORRELATION), importance(x, y, INPUTS, CORRELATION)
    for order in ([1, 0, 2], [2, 1, 0], [1, 2, 0]):
        mixed = [INPUTS[k] for k in order], CORRELATION[np.ix_(order, order)]
        other = importance_x(x[:, order], y, *mixed)
        for name in ("alone", "alone_error", "with_companions"):
            assert getattr(other, name) == pytest.approx(getattr(found, name)[order], abs=1e-9)
    swapped = importance(x[:, [1, 0, 2]], y, [INPUTS[k] for k in (1, 0, 2)], CORRELATION[np.ix_([1, 0, 2], [1, 0, 2])])
    assert abs(swapped.alpha[1] - before.alpha[0]) > 0.1


def test_a_linear_response_of_normals_is_a_closed_form() -> None:
    normals, slopes = [Normal(0.0, 2.0), Normal(1.0, 3.0), Fixed(5.0)], np.array([1.5, -1.0, 2.0])
    correlation = np.array([[1.0, 0.6, 0.0], [0.6, 1.0, 0.0], [0.0, 0.0, 1.0]])
    x = monte_carlo(JointDistribution(normals, correlation), 200, seed=2)
    found = importance_x(x, x @ slopes, normals, correlation)
    own = np.array([3.0, -3.0, 0.0])
    assert found.alone == pytest.approx(own / math.hypot(3.0, 3.0), abs=1e-9)
    assert found.with_companions == pytest.approx(correlation @ own / math.sqrt(own @ correlation @ own), abs=1e-9)
    assert found.r2 == pytest.approx(1.0)
    assert np.all(found.alone_error < 1e-9)


def test_without_correlation_it_is_the_importance() -> None:
    x = monte_carlo(JointDistribution(INPUTS), 400, seed=3)
    found, plain = importance_x(x, respond(x), INPUTS), importance(x, respond(x), INPUTS)
    assert found.alone == pytest.approx(plain.alpha, abs=1e-12)
    assert found.alone_error == pytest.approx(plain.standard_error, abs=1e-12)
    assert found.with_companions == pytest.approx(found.alone, abs=1e-12)


def test_what_has_no_slope_or_too_few_rows_is_refused() -> None:
    with pytest.raises(ValueError, match="is a choice"):
        importance_x(np.zeros((9, 1)), np.arange(9.0), [Choices((0.0, 1.0))])
    with pytest.raises(ValueError, match="cannot determine"):
        importance_x(np.arange(12.0).reshape(4, 3), np.arange(4.0), INPUTS)
