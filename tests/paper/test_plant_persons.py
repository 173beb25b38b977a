"""Scaled persons against OpenSim 4.6's own scaled models (reference/subjects), the plant driven in one process."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from fmus.plant import constants, kernels, person
from fmus.plant.interface import BASE_MASS, PERSON, SEGMENTS
from fmus.plant.model import load_bodies
from fmus.plant.plant import Landing, Plant, person_with
from tests.reference import needs_reference
from tools.direct import COLUMN, land, scale
from tools.published import HOLD, number, rms
from tools.reference import FOLDER, foot_surface, read

SUBJECTS = FOLDER / "subjects" / "index.csv"
CASES = list(pd.read_csv(SUBJECTS).case) if SUBJECTS.is_file() else []
FACTORS = tuple(f"{segment}_scale_{axis}" for segment in SEGMENTS for axis in "xyz")


@cache
def plant() -> Plant:
    return Plant()


def who(row: pd.Series) -> tuple[float, ...]:
    factors = {name: row[name] for name in FACTORS}
    return person_with(body_mass=row.mass_kg, muscle_force_scale=row.force_scale, **factors)


@cache
def landed(case: str) -> SimpleNamespace:
    """Every millisecond: outputs, tendon forces [N]; the constants of the person."""
    row = read("subjects/index.csv").set_index("case").loc[case]
    brace = 0.0 if math.isnan(row.brace_scale_shift) else scale(row.brace_scale_shift)
    landing = Landing(person=who(row), internal_brace_angle_scale=brace)
    forces: list[np.ndarray] = []
    out = land(
        landing,
        number(row.coactivation),
        number(row.reflex_gain),
        step=HOLD,
        every=round(1e-3 / HOLD),
        on=plant(),
        probe=lambda p: forces.append(p.state["tendon_force"][0, :49].copy()),
    )
    unequal = any(len({row[f"{segment}_scale_{axis}"] for axis in "xyz"}) > 1 for segment in SEGMENTS)
    constants_of = plant()._model[0].copy(), plant()._scaled[0].copy()
    return SimpleNamespace(row=row, out=out, forces=np.array(forces), unequal=unequal, constants=constants_of)


@needs_reference
@pytest.mark.parametrize("case", CASES)
def test_landings(case: str) -> None:
    """Subtalar peak and trajectory within 0.06 deg (0.12 where factors are unequal: the reference then takes another
    inertia); ground reaction after 5 ms within 1 % of its peak; tendons within 10 N RMS."""
    found, reference = landed(case), read(f"subjects/{case}.csv.gz")
    limit = 0.12 if found.unequal else 0.06
    angle = np.degrees(found.out[:, COLUMN["subtalar_angle"]])
    assert abs(angle.max() - reference.subtalar_angle_deg.max()) <= limit
    assert rms(angle, reference.subtalar_angle_deg) <= limit
    late = (reference.time_s > 0.005).to_numpy()
    expected = reference.grf_vertical_N.to_numpy()[late]
    ours = found.out[late, COLUMN["ground_force_y"]]
    assert rms(ours, expected) <= 0.01 * expected.max()
    assert abs(ours.max() - expected.max()) <= 0.01 * expected.max()
    compared = [name for name in plant().muscles.names if f"force_N_{name}" in reference]
    assert len(compared) == 11
    for name in compared:
        k = plant().muscles.names.index(name)
        assert rms(found.forces[:, k], reference[f"force_N_{name}"]) <= 10.0, name


@needs_reference
@pytest.mark.parametrize("case", [case for case in CASES if case.endswith("_bare")])
def test_masses_lengths_and_inertias(case: str) -> None:
    """To 1e-6 of the table of the scaled model: masses and mass centres of the moving bodies with what is fused to
    them, inertias for equal factors, forces, fibres, tendons and muscle lengths."""
    found = landed(case)
    model, scaled = found.constants
    bodies = read(f"subjects/{found.row.subject}_bodies.csv").set_index("body")
    base = plant()._base[0]
    for moving, carrier in enumerate(plant().skeleton.names, start=1):
        whole = None
        for k, own in enumerate(load_bodies()):
            if base["carrier"][k] != moving:
                continue
            row = bodies.loc[own.name]
            own = replace(
                own,
                mass=row.mass_kg,
                com=row[["com_x_m", "com_y_m", "com_z_m"]].to_numpy(float),
                inertia=np.diag(row[["Ixx_kg_m2", "Iyy_kg_m2", "Izz_kg_m2"]].to_numpy(float)),
            )
            whole = own if whole is None else whole.with_load(own, scaled["place"][k], base["turn"][k])
        assert whole is not None and whole.name == carrier
        assert model["body_mass"][moving] == pytest.approx(whole.mass, rel=1e-6), carrier
        assert model["body_com"][moving] == pytest.approx(whole.com, abs=1e-6), carrier
        if not found.unequal:
            ours = model["body_inertia"][moving].reshape(3, 3)
            assert np.abs(ours - whole.inertia).max() <= 1e-6 * np.abs(whole.inertia).max(), carrier
    muscles = read(f"subjects/{found.row.subject}_muscles.csv").set_index("muscle").loc[plant().muscles.names]
    assert model["max_force"] == pytest.approx(muscles.max_isometric_force_N.to_numpy(), rel=1e-6)
    assert model["l_opt"] == pytest.approx(muscles.optimal_fibre_length_m.to_numpy(), rel=1e-6)
    assert model["l_slack"] == pytest.approx(muscles.tendon_slack_length_m.to_numpy(), rel=1e-6)
    if any(found.row[name] != 1.0 for name in FACTORS):
        assert scaled["length"][1] == pytest.approx(muscles.mtu_length_default_m.to_numpy(), rel=1e-6)


@needs_reference
def test_the_sole_scales_as_the_surface_it_was_made_from() -> None:
    """Wetted-area moments of the own sole and of the paper's facets, both scaled unequally, each facet of the latter by
    its own normal."""
    factors = dict(foot_scale_x=1.2, foot_scale_y=0.8, foot_scale_z=1.1)
    p = Plant()
    p.embody(person_with(**factors))
    surface = foot_surface()
    f = np.array(list(factors.values()))
    areas = surface[3] * np.sqrt(((np.prod(f) / f) ** 2) @ surface[4:])
    low = surface[1] < 0.0  # what touches the ground in every landing
    facets = p._facets.transpose(0, 2, 1).reshape(-1, 4)
    own = facets[facets[:, 1] < 0.0]
    assert own[:, 3].sum() == pytest.approx(areas[low].sum(), rel=0.01)
    expected = (f[:, None] * surface[:3, low]) @ areas[low] / areas[low].sum()
    assert own[:, :3].T @ own[:, 3] / own[:, 3].sum() == pytest.approx(expected, abs=5e-4)


def test_mass_of_the_base_person_is_that_of_its_bodies() -> None:
    assert sum(body.mass for body in load_bodies()) == BASE_MASS


def test_another_person_and_back_is_the_base_person_to_the_bit() -> None:
    p, fresh = Plant(), Plant()
    p.start(Landing(person=person_with(body_mass=90.0, thigh_scale_y=1.1, foot_scale_x=0.9, passive_x_cubic=10.0)))
    p.advance(0.01)
    for each in (p, fresh):
        each.start(Landing())
        each.advance(0.02)
    assert np.array_equal(p.observe(), fresh.observe())


def test_the_scaling_has_no_step_at_one() -> None:
    """The way of a scaled person, at factors of 1 and the least that is more: the base person's constants."""
    p = Plant()
    p.embody(person_with(pelvis_scale_z=1.0 + 1e-15))
    base = p._base["model"][0]
    for name in kernels.MODEL.names or ():
        if name != "scaled":
            assert p._model[0][name] == pytest.approx(base[name], rel=1e-12, abs=1e-14), name


def test_second_moments_of_unequal_factors() -> None:
    """A cloud of mass points, scaled: mass centre, inertia about it."""
    random = np.random.default_rng(4)
    points, f = random.normal(size=(50, 3)), np.array([0.7, 1.1, 1.6])

    def inertia(cloud: np.ndarray) -> np.ndarray:
        r = cloud - cloud.mean(axis=0)
        return np.asarray((r * r).sum() * np.eye(3) - r.T @ r)

    base, scaled = np.zeros(1, person.BASE), np.zeros(1, person.SCALED)
    base[0]["inertia"][3], scaled[0]["factor"][3] = inertia(points), f
    person.scale_inertia(base[0], scaled[0], 3)
    assert scaled[0]["inertia"] == pytest.approx(inertia(points * f), rel=1e-12)


def test_segments_take_every_body_of_the_table_both_sides_alike() -> None:
    groups: dict[str, set[str]] = {}
    for body in load_bodies():
        groups.setdefault(constants.segment(body.name), set()).add(body.name.removesuffix("_r").removesuffix("_l"))
    assert groups == {
        "pelvis": {"pelvis"},
        "thigh": {"femur"},
        "shank": {"tibia", "patella"},
        "foot": {"talus", "calcn", "toes"},
        "torso": {"torso", "humerus", "ulna", "radius", "hand"},
    }


def test_a_measured_law_of_the_passive_ankle() -> None:
    """Coefficients scaled by 1, s, s^2 ... are the law of angles scaled by s, with the factor s for its torque."""
    s = 1.3
    law = {
        name: start * s ** {"linear": 1, "quadratic": 2, "cubic": 3}[name.rpartition("_")[2]]
        for name, _, start, *_ in PERSON
        if name.startswith("passive_")
    }
    p = Plant()
    outcomes = []
    for landing in (Landing(passive_angle_scale=s), Landing(person=person_with(**law))):
        p.start(landing)
        p.advance(0.05)
        outcomes.append(p.observe().copy())
    assert outcomes[0] == pytest.approx(outcomes[1], rel=1e-6, abs=1e-9)


def random_persons(count: int) -> list[tuple[float, ...]]:
    """Factors 0.5 to 2 each on its own, 40 to 150 kg, forces halved to doubled."""
    random = np.random.default_rng(20)
    out = []
    for _ in range(count):
        factors = dict(zip(FACTORS, np.exp(random.uniform(math.log(0.5), math.log(2.0), len(FACTORS))), strict=True))
        mass, force = random.uniform(40.0, 150.0), random.uniform(0.5, 2.0)
        out.append(person_with(body_mass=mass, muscle_force_scale=force, **factors))
    return out


def land_all(persons: list[tuple[float, ...]]) -> None:
    for each in persons:
        out = land(Landing(person=each), 0.2, 5.0, on=plant())
        assert np.isfinite(out).all()
        assert out[:, COLUMN["in_contact"]].any()


def test_random_persons_land() -> None:
    land_all(random_persons(5))


@pytest.mark.long
def test_two_hundred_random_persons_land() -> None:
    land_all(random_persons(200))
