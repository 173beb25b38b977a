"""The published Monte Carlo trials of Yoder, Petrella & Farrokhi 2021 (doi 10.3389/fbioe.2021.765331), each with its
own inputs."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
import pytest

from fmus.plant.plant import Landing
from tests.direct import COLUMN, land, plant, scale
from tests.reference import needs_reference, read

pytestmark = needs_reference
SAMPLE = 40


def errors(study: int, trials: pd.DataFrame) -> np.ndarray:
    """Simulated minus published peak subtalar angle [deg]."""
    found = []
    for row in trials.to_dict("records"):
        given = {k: v for k, v in row.items() if v == v}
        landing = Landing(
            platform_incline=math.radians(given["incline_deg"]),
            drop_height=given["drop_height_m"],
            contact_modulus=given["contact_modulus_Pa_m"],
            contact_dissipation=given["contact_dissipation_s_m"],
            passive_angle_scale=scale(given["ankle_stiffness_scale_fi"]),
            talocrural_angle_at_contact=math.radians(given["talocrural_at_contact_deg"]),
            subtalar_angle_at_contact=math.radians(given["subtalar_at_contact_deg"]),
            ankle_strength_scale=1.0 + given["strength_scale_m1i"],
            internal_brace_angle_scale=scale(given["brace_scale_bi"]) if "brace_scale_bi" in given else 0.0,
            initial_pose=Landing.PUBLISHED,
            fibre_start=Landing.AS_PUBLISHED,
        )
        out = land(landing, given.get("coactivation", 0.0), given.get("reflex_gain", 0.0), on=plant())
        found.append(math.degrees(out[:, COLUMN["subtalar_angle"]].max()) - given["peak_subtalar_deg"])
    return np.array(found)


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
    found = errors(study, trials)
    assert abs(found.mean()) <= 0.05 + 2 * 0.12 / math.sqrt(SAMPLE), bounds(found, study)
    assert np.sqrt(np.mean(found**2)) <= 0.12 * (1 + 2 / math.sqrt(2 * SAMPLE)), bounds(found, study)


@pytest.mark.long
@pytest.mark.parametrize("study", range(1, 7))
def test_all_trials(study: int) -> None:
    """RMS error at most 0.12°, bias at most 0.05°, no failure."""
    found = errors(study, read(f"paper/study{study}_trials.csv"))
    print(bounds(found, study))
    assert np.sqrt(np.mean(found**2)) <= 0.12, bounds(found, study)
    assert abs(found.mean()) <= 0.05, bounds(found, study)
