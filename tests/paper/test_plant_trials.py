"""The published Monte Carlo trials of Yoder, Petrella & Farrokhi 2021 (doi 10.3389/fbioe.2021.765331), each with its
own inputs."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.reference import needs_reference
from tools.published import errors
from tools.reference import read

pytestmark = needs_reference
SAMPLE = 40


def bounds(found: np.ndarray, study: int) -> str:
    return (
        f"study {study}: n {len(found)}, bias {found.mean():+.3f}, RMS {np.sqrt(np.mean(found**2)):.3f}, largest "
        f"{np.abs(found).max():.2f} deg"
    )


@pytest.mark.parametrize("study", range(1, 7))
def test_a_seeded_sample(study: int) -> None:
    """Forty trials; the bounds are those of the whole set plus two standard errors of so small a sample (trial SD
    0.12°)."""
    trials = read(f"paper/study{study}_trials.csv").sample(SAMPLE, random_state=20211208 + study)
    found = errors(trials)
    assert abs(found.mean()) <= 0.05 + 2 * 0.12 / math.sqrt(SAMPLE), bounds(found, study)
    assert np.sqrt(np.mean(found**2)) <= 0.12 * (1 + 2 / math.sqrt(2 * SAMPLE)), bounds(found, study)


LATE = pytest.mark.xfail(strict=True, reason="bias +0.06°: a reflex 0.1 ms earlier would remove most of it")


@pytest.mark.long
@pytest.mark.parametrize("study", [1, 2, pytest.param(3, marks=LATE), 4, 5, 6])
def test_all_trials(study: int) -> None:
    """RMS error at most 0.12°, less where the record explains the rest; bias at most 0.05°, no failure."""
    found = errors(read(f"paper/study{study}_trials.csv"))
    print(bounds(found, study))
    assert np.sqrt(np.mean(found**2)) <= {1: 0.04, 4: 0.075, 6: 0.045}.get(study, 0.12), bounds(found, study)
    assert abs(found.mean()) <= 0.05, bounds(found, study)
