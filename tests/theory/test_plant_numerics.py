"""The plant's integrator: its order, its error over the whole domain of the inputs, energy in free flight."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from numba import njit

from fmus.plant import constants, kernels, person
from fmus.plant.plant import Landing
from tools.direct import COLUMN, plant

DOMAIN = {
    "talocrural_angle_at_contact": (math.radians(-49), math.radians(-19)),
    "subtalar_angle_at_contact": (math.radians(-15), math.radians(15)),
    "drop_height": (0.1, 0.45),
    "contact_dissipation": (2.0, 8.0),
    "contact_modulus": (35e6, 65e6),
    "platform_incline": (0.0, math.radians(30)),
}


def inputs(count: int) -> list[Landing]:
    """16 corners (a half fraction of the first five, both ends of the incline), then seeded uniform points."""
    low, high = np.array(list(DOMAIN.values())).T
    corners = []
    for signs in itertools.product((0, 1), repeat=4):
        fifth = sum(signs) % 2
        corners.append([*signs, fifth, (signs[0] + signs[1]) % 2])
    unit = np.vstack([np.array(corners, dtype=float), np.random.default_rng(20211208).random((count - 16, 6))])
    pose = itertools.cycle((Landing.PUBLISHED, Landing.TOUCHING))
    return [
        Landing(**dict(zip(DOMAIN, (low + (high - low) * u).tolist(), strict=True)), initial_pose=p)
        for u, p in zip(unit, pose, strict=False)
    ]


def peak(landing: Landing, stop: float = 0.15) -> float:
    """Peak subtalar angle [deg] at communication points 0.5 ms apart."""
    p = plant()
    p.state["excitation"] = 0.0
    p.start(landing)
    best = -math.inf
    steps = round(stop / 5e-4)
    for k in range(steps + 1):
        best = max(best, p.observe()[COLUMN["subtalar_angle"]])
        if k < steps:
            p.advance((k + 1) * 5e-4)
    return math.degrees(best)


def worst(count: int) -> float:
    cases = inputs(count)
    default = Landing().tolerance
    return max(abs(peak(case) - peak(replace(case, tolerance=default / 100))) for case in cases)


def test_peaks_against_a_hundredfold_tighter_tolerance() -> None:
    """0.1° over 24 inputs, 16 of them corners (300 in the long run)."""
    assert worst(24) <= 0.1


@pytest.mark.long
def test_peaks_against_a_hundredfold_tighter_tolerance_300() -> None:
    assert worst(300) <= 0.1


def test_half_a_second_over_drops_and_inclines() -> None:
    """0.1° of the peak, drop 0 to 0.8 m, incline -15 to 45°."""
    for incline, drop in ((-15, 0.0), (45, 0.0), (45, 0.8), (15, 0.8), (0, 0.3)):
        case = Landing(platform_incline=math.radians(incline), drop_height=drop)
        assert abs(peak(case, 0.5) - peak(replace(case, tolerance=case.tolerance / 100), 0.5)) <= 0.1, (incline, drop)


@njit
def exponentials(x, out):
    for k in range(len(x)):
        out[k] = kernels.exponential(x[k])


def test_exponential_of_the_muscles() -> None:
    """9e-15 relative, and no number made of what is none."""
    x = np.concatenate([np.linspace(-700, 700, 20001), np.linspace(-5, 5, 20001), [-1e9, 1e9, math.nan]])
    out = np.empty_like(x)
    exponentials(x, out)
    np.testing.assert_allclose(out[:-3], np.exp(x[:-3]), rtol=9e-15)
    assert 0 < out[-3] < 1e-300 and out[-2] > 1e300 and math.isnan(out[-1])
    assert kernels.exponential.py_func(np.float64(1.0)) == pytest.approx(math.e, rel=9e-15)


def test_cosines_and_sines_of_the_joints() -> None:
    """3e-16, far beyond any joint's range too, and no number made of what is none."""
    x = np.concatenate([np.linspace(-10, 10, 160), np.linspace(-1e4, 1e4, 159), [math.nan]]).reshape(-1, kernels.WIDTH)
    for row in x:
        cosine, sine = np.empty_like(row), np.empty_like(row)
        kernels.cosines_and_sines(row, cosine, sine)
        np.testing.assert_allclose(cosine, np.cos(row), rtol=0, atol=3e-16)
        np.testing.assert_allclose(sine, np.sin(row), rtol=0, atol=3e-16)


def test_arrays_begin_at_whole_vectors() -> None:
    for record in (kernels.MODEL, kernels.STATE, person.SOLE, person.BASE):
        for name, (kind, offset, *_) in (record.fields or {}).items():
            assert offset % 32 == 0 or not kind.shape, name
    assert kernels.STATE.fields is not None and len(kernels.STATE.fields["tendon_force"][0].shape) == 2
    assert not any(8 * size % 32 for size in (kernels.WIDTH, kernels.ROW))


def test_facets_that_touch_are_all_there_and_few_besides() -> None:
    """Over tilted feet at several depths: what `place_facets` packs, against every facet looked at alone."""
    sole = constants.blocks(constants.sole())[0]
    x, y, elastic = np.zeros((3, kernels.MAX_FACETS))
    low, random = np.zeros(kernels.MAX_FACETS // kernels.BLOCK), np.random.default_rng(5)
    points = sole["facets"].transpose(1, 0, 2).reshape(4, -1)
    touched = looked_at = 0
    for _ in range(40):
        place = np.linalg.qr(np.eye(3) + 0.4 * random.normal(size=(3, 3)))[0]
        place = place[[0, 2, 1]] * np.sign(np.diag(place))[[0, 2, 1], None]
        origin = np.array([0.1, 0.2, 0.0])
        origin[2] = random.uniform(0.0, 0.02) - (place[2] @ points[:3]).min() - 0.02
        n = kernels.place_facets(sole["facets"], sole["blocks"], place, origin, 2.0, low, x, y, elastic)
        at = origin[:, None] + place @ points[:3]
        force = 2.0 * points[3] * np.maximum(-at[2], 0.0)
        expected = np.sort([at[0, force > 0], at[1, force > 0], force[force > 0]], axis=1)
        on = elastic[:n] > 0
        assert n % kernels.LANES == 0
        np.testing.assert_allclose(
            np.sort([x[:n][on], y[:n][on], elastic[:n][on]], axis=1), expected, rtol=0, atol=1e-15
        )
        touched, looked_at = touched + on.sum(), looked_at + n
    assert 0 < touched <= looked_at < 1.4 * touched


def test_order_two() -> None:
    """Fixed steps on the smooth part of a landing: halving the step divides the error by about four."""
    p = plant()
    landing = Landing(initial_pose=Landing.TOUCHING, tolerance=1e-7)

    def state(h: float) -> np.ndarray:
        p.state["excitation"] = 0.0
        p.start(landing)
        p.advance(0.060)  # past the impacts, by tight tolerance
        p.advance(0.070, fixed_step=h)
        return np.r_[p.state["q"], 0.01 * p.state["u"]].copy()

    exact = state(1e-6)
    steps = 1e-4 * 0.5 ** np.arange(4)
    errors = [np.linalg.norm(state(h) - exact) for h in steps]
    slope = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert 1.8 < slope < 2.3, (slope, errors)
