"""The terms of the plant one by one, against numbers computed with OpenSim 4.6 from the paper's own model."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pandas as pd
import pytest
from numba import njit
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from fmus.plant import kernels
from fmus.plant.plant import Landing, Plant
from sprain_cosim.fmu.build.device import read_device
from sprain_cosim.fmu.build.interpreter import Interpreted
from sprain_cosim.shipped import SOURCES
from tests.reference import needs_reference
from tools.direct import COLUMN, plant
from tools.reference import foot_surface, read

pytestmark = needs_reference
BODIES = ("pelvis", "femur_r", "tibia_r", "talus_r", "calcn_r", "patella_r", "torso")
POSE_B = dict(
    hip_flexion_r=50,
    knee_angle_r=-70,
    ankle_angle_r=-25,
    subtalar_angle_r=20,
    lumbar_extension=-15,
    lumbar_bending=5,
    pelvis_list=7,
    pelvis_rotation=-4,
)


@cache
def own() -> Plant:
    """A plant for this file alone: some tests switch its terms off."""
    return Plant(foot_surface())


def defaults(p: Plant) -> np.ndarray:
    table = read("model/coordinates.csv").set_index("coordinate").default_value_rad_or_m
    return np.array([table[name] for name in p.skeleton.coordinates])


def put(p: Plant, **degrees: float) -> np.ndarray:
    """The model's default pose with some coordinates changed [deg]; returns the outputs."""
    q = defaults(p)
    for name, angle in degrees.items():
        q[p.skeleton.coordinates.index(name)] = math.radians(angle)
    p.state["q"], p.state["u"], p.state["valid"] = q, 0.0, 0
    return p.observe().copy()


def body(p: Plant, name: str) -> tuple[np.ndarray, np.ndarray]:
    k = p.skeleton.names.index(name) + 1
    return p.state["xpos"][k].copy(), p.state["xmat"][k].reshape(3, 3).copy()


def masses(p: Plant) -> tuple[np.ndarray, np.ndarray]:
    """(7,) masses [kg] and (7, 3) centres of mass [m] of the moving bodies."""
    model, frames = p._model[0], p.state["xmat"][1:].reshape(-1, 3, 3)
    return model["body_mass"][1:], p.state["xpos"][1:] + np.einsum("bij,bj->bi", frames, model["body_com"][1:])


def close(ours: object, reference: object, relative: float = 1e-6) -> None:
    """Within `relative` of the largest reference value."""
    a, b = np.asarray(ours, dtype=float), np.asarray(reference, dtype=float)
    np.testing.assert_allclose(a, b, rtol=0, atol=relative * np.abs(b).max())


@pytest.mark.parametrize(("pose", "angles"), [("default", {}), ("pose_B", POSE_B)])
def test_body_frames(pose: str, angles: dict[str, float]) -> None:
    p = plant()
    put(p, **angles)
    table = read("elementary/e_body_frames.csv.gz").set_index(["pose", "body"])
    for name in BODIES:
        row = table.loc[(pose, name)]
        position, turn = body(p, name)
        close(position, row[["x_m", "y_m", "z_m"]])
        close(turn.ravel(), row[[f"R{i}{j}" for i in range(3) for j in range(3)]])


@pytest.mark.parametrize(("pose", "angles"), [("default", {}), ("pose_B", POSE_B)])
def test_mass_and_centre_of_mass(pose: str, angles: dict[str, float]) -> None:
    """The reference counts the platform; it is taken out here."""
    p = plant()
    put(p, **angles)
    table = read("elementary/e_mass_com.csv.gz")
    row = table[table.pose.str.startswith(pose)].iloc[0]
    bodies = read("model/bodies.csv").set_index("body")
    platform = bodies.loc["platform"]
    frames = read("elementary/e_body_frames.csv.gz").set_index(["pose", "body"]).loc[(pose, "platform")]
    at = frames[["x_m", "y_m", "z_m"]].to_numpy(float) + platform[
        [c for c in bodies.columns if c.startswith("com_")][:3]
    ].to_numpy(float)
    total = row["total_mass_kg_incl_0.1_platform"]
    mass = float(platform[next(c for c in bodies.columns if c.startswith("mass"))])
    own_masses, centres = masses(p)
    close(own_masses.sum(), total - mass)
    expected = (total * row[["com_x_m", "com_y_m", "com_z_m"]].to_numpy(float) - mass * at) / (total - mass)
    close(own_masses @ centres / own_masses.sum(), expected)


@pytest.mark.parametrize(("pose", "angles"), [("default", {}), ("pose_B", POSE_B)])
def test_mass_matrix(pose: str, angles: dict[str, float]) -> None:
    """The 15 x 15 block that is left when locked coordinates are dropped and the patella follows the knee."""
    p = plant()
    put(p, **angles)
    table = read("elementary/e_mass_matrix.csv.gz")
    full = table[table.pose == pose].set_index("coordinate").drop(columns="pose")
    full["knee_angle_r"] += full["patella_r_constrained_knee_angle"]
    full.loc["knee_angle_r"] += full.loc["patella_r_constrained_knee_angle"]
    names = p.skeleton.coordinates
    close(p.state["mass"][0, :, :15], full.loc[names, names])


def lever(p: Plant, coordinate: str, muscle: int, **angles: float) -> tuple[float, float]:
    """Length [m] and moment arm -dL/dq [m] by central difference."""
    step = 1e-4
    put(p, **angles)
    length = p.state["mtu"][0, muscle]
    ends = []
    for sign in (1, -1):
        put(p, **{**angles, coordinate: angles[coordinate] + sign * math.degrees(step)})
        ends.append(p.state["mtu"][0, muscle])
    return length, -(ends[0] - ends[1]) / (2 * step)


def test_lengths_and_moment_arms_over_the_ankle() -> None:
    p = plant()
    table = read("elementary/b_moment_arms_ankle_subtalar.csv.gz")
    ours, expected = [], []
    for row in table.itertuples():
        k = p.muscles.names.index(row.muscle)
        angles = {"ankle_angle_r": row.ankle_angle_deg, "subtalar_angle_r": row.subtalar_angle_deg}
        length, ankle = lever(p, "ankle_angle_r", k, **angles)
        ours.append((length, ankle, lever(p, "subtalar_angle_r", k, **angles)[1]))
        expected.append((row.mtu_length_m, row.moment_arm_ankle_m, row.moment_arm_subtalar_m))
    close(ours, expected)


def test_lengths_and_moment_arms_of_knee_hip_and_back() -> None:
    """The reference's knee arms leave the conditional points where they are; a difference across a switch is
    skipped."""
    p = plant()
    table = read("elementary/b_moment_arms_knee_hip_back.csv.gz")
    lengths, arms = [], []
    for row in table.itertuples():
        k = p.muscles.names.index(row.muscle)
        length, arm = lever(p, row.coordinate, k, **{row.coordinate: row.angle_deg_others_at_default})
        lengths.append((length, row.mtu_length_m))
        arms.append((arm, row.moment_arm_m))
    close(*zip(*lengths, strict=True))
    ours, expected = np.array(arms).T
    good = np.abs(ours - expected) <= 1e-6 * np.abs(expected).max()
    assert good.mean() > 0.99, (ours[~good], expected[~good])


def test_knee_and_patella() -> None:
    p = plant()
    for row in read("elementary/k_knee_patella_transform.csv.gz").itertuples():
        put(p, knee_angle_r=row.knee_angle_deg)
        origin, turn = body(p, "femur_r")
        for name in ("tibia", "patella"):
            position, own_turn = body(p, f"{name}_r")
            close(turn.T @ (position - origin), [getattr(row, f"{name}_{c}_in_femur_m") for c in "xyz"])
            angle = math.degrees(math.atan2(*(turn.T @ own_turn)[[1, 0], [0, 0]]))
            assert angle == pytest.approx(getattr(row, f"{name}_rotz_deg"), abs=1e-4)
        for muscle in ("rect_fem", "vas_int", "vas_med", "vas_lat"):
            assert p.state["mtu"][0, p.muscles.names.index(f"{muscle}_r")] == pytest.approx(
                getattr(row, f"{muscle}_mtu_m"), rel=1e-6
            )


@pytest.mark.parametrize(
    ("file", "scale", "who"), [("anatomy", 1.0, "anatomy"), ("brace150", 1.5, "brace"), ("brace240", 2.4, "brace")]
)
def test_bushing_torques(file: str, scale: float, who: str) -> None:
    p = plant()
    p.start(Landing(internal_brace_angle_scale=scale if who == "brace" else 0.0))
    axes = {
        "talocrural": "gen_torque_talocrural_Nm",
        "subtalar": "gen_torque_subtalar_Nm",
        "dorsiflexion": "proj_jcs_e1_Nm",
    }
    axes |= {"inversion": "proj_jcs_e2_Nm", "internal_rotation": "proj_jcs_e3_Nm"}
    table = read(f"elementary/c_bushing_torque_{file}.csv.gz")
    ours = []
    for row in table.itertuples():
        out = put(p, ankle_angle_r=row.ankle_angle_deg, subtalar_angle_r=row.subtalar_angle_deg)
        ours.append(
            [-out[COLUMN[f"{who}_{axis}_moment"]] for axis in axes]
            + [math.degrees(out[COLUMN[f"rotation_{c}_angle"]]) for c in "xyz"]
        )
    close(np.array(ours)[:, :5], table[list(axes.values())])
    close(np.array(ours)[:, 5:], table[["theta_x_deg", "theta_y_deg", "theta_z_deg"]])


def test_limit_forces() -> None:
    limits = own()._model[0]["limit"]
    table = read("elementary/c_limit_forces.csv.gz")
    which = {"LumbarExtensionLimit": 0, "KneeLimit_r": 1}
    ours = [
        kernels.limit_force(limits[which[r.force]], math.radians(r.angle_deg), math.radians(r.velocity_deg_s))
        for r in table.itertuples()
    ]
    close(ours, table.torque_Nm)


def test_reflex_law() -> None:
    """From the muscle's lengthening speed to the excitation one delay later, through the controller itself."""
    p = plant()
    device = read_device(SOURCES / "reflex_controller")
    table = read("elementary/i_delayed_reflex_law.csv.gz")
    for muscle, lopt, top, speed, gain, clamped, raw in table.itertuples(index=False):
        k = p.muscles.names.index(muscle)
        assert p.muscles.optimal_length[k] == pytest.approx(lopt, rel=1e-6)
        assert top == kernels.V_MAX
        name = muscle.removesuffix("_r")
        controller = Interpreted(device)
        controller["reflex_gain"] = gain
        controller.initialise()
        for step in range(200):
            controller[f"{name}_stretch_velocity"] = speed / (p.muscles.optimal_length[k] * kernels.V_MAX)
            controller.step(step * 1e-3, 1e-3)
        assert controller[f"{name}_excitation"] == pytest.approx(raw, rel=1e-6, abs=1e-9)
        assert min(max(controller[f"{name}_excitation"], 0.0), 1.0) == pytest.approx(clamped, rel=1e-6, abs=1e-9)


def test_joint_coordinate_system() -> None:
    p = plant()
    table = read("elementary/f_jcs_grid.csv.gz")
    names = {"dorsiflexion": "dorsiflexion", "inversion": "inversion", "internal_rotation": "introt"}
    for row in table.to_dict("records"):
        out = put(p, ankle_angle_r=row["talocrural_deg"], subtalar_angle_r=row["subtalar_deg"])
        for axis, short in names.items():
            assert math.degrees(out[COLUMN[f"jcs_{axis}_raw_angle"]]) == pytest.approx(
                row[f"jcs_tc_{short}_deg_raw"], abs=5e-6
            )
            assert math.degrees(out[COLUMN[f"{axis}_angle"]]) == pytest.approx(
                row[f"jcs_tc_{short}_deg_zeroed"], abs=5e-6
            )
        for axis in "xyz":
            assert math.degrees(out[COLUMN[f"rotation_{axis}_angle"]]) == pytest.approx(
                row[f"bushing_euler_{axis}_deg"], abs=5e-6
            )


def test_axes_are_consistent_in_power() -> None:
    """Sum of moment times velocity is the same about the axes of every profile."""
    p = plant()
    rng = np.random.default_rng(3)
    p.start(Landing(internal_brace_angle_scale=2.0))
    for _ in range(20):
        p.state["q"] = p.skeleton.initial()[0]
        p.state["q"][10:12], p.state["u"] = rng.uniform(-0.5, 0.5, 2), rng.normal(size=15)
        p.state["valid"] = 0
        out = p.observe()
        jcs, anatomic = ("dorsiflexion", "inversion", "internal_rotation"), ("talocrural", "subtalar")
        power = [
            sum(out[COLUMN[f"brace_{a}_moment"]] * out[COLUMN[f"{a}_velocity"]] for a in axes)
            for axes in (jcs, anatomic)
        ]
        assert power[0] == pytest.approx(power[1], rel=1e-9)


def test_initial_penetration() -> None:
    p = own()
    for row in read("elementary/initial_penetration.csv.gz").itertuples():
        p.state["excitation"] = 0.0
        angles = {
            "talocrural_angle_at_contact": math.radians(row.talocrural_deg),
            "subtalar_angle_at_contact": math.radians(row.subtalar_deg),
        }
        p.start(Landing(platform_incline=math.radians(row.incline_deg), initial_pose=Landing.PUBLISHED, **angles))
        assert p.penetration == pytest.approx(row[4], abs=1e-7)


@njit
def contact_alone(model, state, facets, blocks):
    state[0].wrench[:] = 0.0
    kernels.contact(model[0], state[0], facets, blocks, 0)


@pytest.mark.parametrize("incline", [0.0, 0.4])
@pytest.mark.parametrize(("direction", "distance"), [(0.0, 0.12), (1.57, -0.02), (-1.2, 0.01), (3.1, 0.0)])
def test_beyond_its_edge_the_platform_carries_nothing(incline: float, direction: float, distance: float) -> None:
    """The wrench on the foot is that of a sole without the facets beyond the line, which stands in the platform where
    it was at contact."""
    p = Plant()
    p.start(Landing(platform_incline=incline, platform_edge_direction=direction, platform_edge_distance=distance))
    lateral = np.array([0.0, -math.sin(incline), math.cos(incline)])
    normal = math.cos(direction) * np.array([1.0, 0.0, 0.0]) + math.sin(direction) * lateral
    heel = p.state["xpos"][kernels.CALCN].copy()
    p.advance(0.03)
    p.observe()
    place, turn = p.state["xpos"][kernels.CALCN], p.state["xmat"][kernels.CALCN].reshape(3, 3)
    facets = p._facets.copy()
    beyond = np.einsum("i,nij->nj", turn.T @ normal, facets[:, :3]) + (place - heel) @ normal > distance
    assert 0 < beyond.sum() < beyond.size
    found = []
    for edged, sole in ((1, p._facets), (0, facets)):
        p.state["edged"] = edged
        contact_alone(p._model, p._state, sole, p._blocks)
        found.append(p.state["contact"].copy())
        facets[:, 3][beyond] = 0.0
    assert found[0][1] != 0.0
    assert found[0] == pytest.approx(found[1], rel=1e-9, abs=1e-6)


def pressed(p: Plant, row: pd.Series) -> tuple[np.ndarray, np.ndarray]:
    """Force [N] and moment [N m] about the calcaneus origin on a foot of given orientation, depth and velocity over the
    level floor."""
    surface = foot_surface()
    turn = Rotation.from_euler("XYZ", [row.foot_rx_deg, 0.0, row.foot_rz_deg], degrees=True).as_matrix()
    pivot = p._model[0]["pivot"]
    lowest = (turn @ surface[:3])[1].min()
    origin = np.array([0.0, pivot[1] - lowest - row.max_penetration_of_lowest_centroid_m, 0.0])
    p.state["xpos"][kernels.CALCN], p.state["xmat"][kernels.CALCN] = origin, turn.ravel()
    p.state["twist"][kernels.CALCN] = [0, 0, 0, row.vx_m_s, row.vy_m_s, row.vz_m_s]
    contact_alone(p._model, p._state, p._facets, p._blocks)
    wrench = p.state["wrench"][kernels.CALCN].copy()
    return wrench[3:], wrench[:3] - np.cross(origin, wrench[3:])


def law(row: pd.Series) -> np.ndarray:
    """The elastic foundation written down once more: force and moment about the calcaneus origin."""
    surface = foot_surface()
    turn = Rotation.from_euler("XYZ", [row.foot_rx_deg, 0.0, row.foot_rz_deg], degrees=True).as_matrix()
    points = (turn @ surface[:3]).T
    depth = points[:, 1].min() + row.max_penetration_of_lowest_centroid_m - points[:, 1]
    wet = depth > 0
    at = points[wet] + np.outer(depth[wet], [0, 1, 0])  # the nearest points of the plane
    velocity = np.array([row.vx_m_s, row.vy_m_s, row.vz_m_s])
    normal = 5e7 * surface[3, wet] * depth[wet] * max(0.0, 1 - 5.0 * velocity[1])
    slip = np.array([velocity[0], 0.0, velocity[2]])
    speed = np.linalg.norm(slip)
    friction = (0.9 * min(speed / 0.1, 1.0) + 0.9 * speed) * slip / speed if speed else slip
    force = np.outer(normal, [0, 1, 0] - friction)
    return np.concatenate([force.sum(axis=0), np.cross(at, force).sum(axis=0)])


def test_contact_law_on_the_reference_facets() -> None:
    """To 1e-9 of the law written down in numpy, and to the nine digits of the reference's facets."""
    p = own()
    p.start(Landing(platform_incline=0.0))
    table = read("elementary/g_contact_elastic_foundation.csv.gz")
    for _, row in table.iterrows():
        ours, expected = np.concatenate(pressed(p, row)), law(row)
        close(ours[:3], expected[:3], 1e-9)
        close(ours[3:], expected[3:], 1e-9)
        close(ours[:3], row[["closed_Fx_N", "closed_Fy_N", "closed_Fz_N"]], 1e-6)
        close(ours[3:], row[["closed_Mx_Nm", "closed_My_Nm", "closed_Mz_Nm"]], 1e-6)


def test_own_sole_against_the_reference_facets() -> None:
    """Within 1 % of force and 1 mm of centre of pressure wherever the deepest point is at least 5 mm in."""
    p = Plant()
    p.start(Landing(platform_incline=0.0))
    table = read("elementary/g_contact_elastic_foundation.csv.gz")
    deep = table[(table.max_penetration_of_lowest_centroid_m >= 0.005) & (table.closed_Fy_N > 0)]
    assert len(deep) > 30
    for _, row in deep.iterrows():
        force, moment = pressed(p, row)
        expected = row[["closed_Fx_N", "closed_Fy_N", "closed_Fz_N"]].to_numpy(float)
        assert np.linalg.norm(force - expected) <= 0.01 * np.linalg.norm(expected)
        ours, theirs = (
            np.array([moment[2], -moment[0]]) / force[1],
            np.array([row.closed_Mz_Nm, -row.closed_Mx_Nm]) / expected[1],
        )
        assert np.linalg.norm(ours - theirs) <= 1e-3


@pytest.mark.parametrize("case", ["base", "study1_centre", "study3_centre", "study4_centre"])
def test_initial_fibre_lengths(case: str) -> None:
    row = read("landing/index.csv").set_index("case").loc[case]
    first = read(f"landing/{case}_muscles.csv.gz").iloc[0]
    p = plant()
    p.state["excitation"] = row.coactivation * np.array([1.0] * 4 + [row.inv_ratio] * 4)
    p.start(Landing(platform_incline=math.radians(row.incline_deg), initial_pose=Landing.PUBLISHED))
    p.observe()
    for k, name in enumerate(p.muscles.names):
        assert p.state["l"][k] == pytest.approx(first[f"lf_m_{name}"], rel=1e-6), name


@njit
def equilibrium_alone(model, k, mtu, a):
    return kernels.fibre_equilibrium(model[0], k, mtu, 0.0, a, False)


@njit
def muscles_alone(model, state, mtu, a, length):
    s = state[0]
    s.mtu[0, : kernels.NM] = mtu
    kernels.muscles(model[0], s, 0, a, length)
    kernels.activations(model[0], s, 0, a)


class SingleMuscle:
    """One muscle between two points of given distance."""

    def __init__(self, name: str) -> None:
        self.plant = own()
        self.plant.start(Landing(body_reflex_scale=0.0))
        self.k = self.plant.muscles.names.index(name)
        self.peak = self.plant.muscles.max_force[self.k]

    def rates(self, mtu: float, a: float, length: float) -> tuple[float, float, float]:
        """Fibre speed [m/s], rate of activation [1/s], tendon force [N]."""
        p, n = self.plant, kernels.NM
        full = p._model[0]["l_opt"].copy()
        full[self.k] = length
        muscles_alone(
            p._model,
            p._state,
            np.where(np.arange(n) == self.k, mtu, p._model[0]["l_opt"] + p._model[0]["l_slack"]),
            np.full(n, a),
            full,
        )
        return p.state["l_rate"][0, self.k], p.state["a_rate"][0, self.k], p.state["tendon_force"][0, self.k]

    def follow(self, times: np.ndarray, mtu: np.ndarray, excitation: np.ndarray, a: float, length: float) -> np.ndarray:
        """Tendon force [N] at `times`, length of the muscle linear between them, excitation held."""
        out = [self.rates(mtu[0], a, length)[2]]
        state = np.array([a, length])
        for k in range(len(times) - 1):
            self.plant.state["excitation_floor"] = excitation[k]
            speed = (mtu[k + 1] - mtu[k]) / (times[k + 1] - times[k])

            def slope(t: float, y: np.ndarray, k: int = k, speed: float = speed) -> list[float]:
                rate = self.rates(mtu[k] + speed * (t - times[k]), y[0], y[1])
                return [rate[1], rate[0]]

            state = solve_ivp(slope, (times[k], times[k + 1]), state, method="LSODA", rtol=1e-6, atol=1e-9).y[:, -1]
            out.append(self.rates(mtu[k + 1], state[0], state[1])[2])
        return np.array(out)


def test_isometric_force() -> None:
    table = read("elementary/d_isometric_force_length.csv.gz")
    for name, rows in table.groupby("muscle"):
        muscle = SingleMuscle(name)
        for row in rows.itertuples():
            length = equilibrium_alone(muscle.plant._model, muscle.k, row.mtu_length_m, row.activation)
            assert muscle.rates(row.mtu_length_m, row.activation, length)[2] == pytest.approx(
                row.tendon_force_N, abs=1e-6 * muscle.peak
            )


def test_force_velocity() -> None:
    """Fibre speed for a given tendon strain, within 0.5 % of the maximal speed."""
    table = read("elementary/d_force_velocity.csv.gz")
    for name, rows in table.groupby("muscle"):
        muscle = SingleMuscle(name)
        top = kernels.V_MAX * muscle.plant.muscles.optimal_length[muscle.k]
        for row in rows.itertuples():
            speed, _, force = muscle.rates(row.mtu_length_m, row.activation, row.fiber_length_m)
            assert force == pytest.approx(row.tendon_force_N, abs=1e-6 * muscle.peak)
            assert speed == pytest.approx(row.fiber_velocity_m_s, abs=0.005 * top)


def test_activation_transients() -> None:
    for (name, _), rows in read("elementary/d_activation_transient.csv.gz").groupby(["muscle", "excitation_protocol"]):
        muscle = SingleMuscle(name)
        rows = rows.iloc[::3]
        force = muscle.follow(
            *(rows[c].to_numpy() for c in ("time_s", "mtu_length_m_constant", "excitation")),
            rows.activation.iloc[0],
            rows.fiber_length_m.iloc[0],
        )
        assert np.abs(force - rows.tendon_force_N).max() <= 0.005 * rows.tendon_force_N.max()


def test_ramp_stretches() -> None:
    for (name, _, _), rows in read("elementary/d_ramp_stretch.csv.gz").groupby(
        ["muscle", "stretch_rate_m_s", "excitation"]
    ):
        muscle = SingleMuscle(name)
        force = muscle.follow(
            *(rows[c].to_numpy() for c in ("time_s", "mtu_length_m", "excitation")),
            rows.activation.iloc[0],
            rows.fiber_length_m.iloc[0],
        )
        assert np.abs(force - rows.tendon_force_N).max() <= 0.005 * rows.tendon_force_N.max()


def fly(case: str) -> tuple[np.ndarray, pd.DataFrame, Plant]:
    """The free coordinates every millisecond of a flight far above the floor."""
    p = Plant()
    table = read(f"elementary/{case}.csv.gz")
    names = p.skeleton.coordinates
    p.start(Landing(tolerance=1e-5, body_reflex_scale=0.0))
    p._model["pivot"] = (0.0, -100.0, 0.0)
    if "muscles" not in case:
        p.state["strength"] = 0.0
    if "no_forces" in case:
        p.state["passive_scale"] = 0.0
        p._model["lumbar_bushing"], p._model["limit"][0, :, 2:5] = 0.0, 0.0
    p.state["excitation_floor"] = 0.0  # no controls: activations drain from 0.05, below their least effective value
    p.state["q"], p.state["u"], p.state["a"] = (
        table[[f"{n}_rad_or_m" for n in names]].iloc[0],
        table[[f"{n}_speed" for n in names]].iloc[0],
        0.05,
    )
    kernels.initialise(p._model[0], p.state, p._facets, p._blocks, Landing.PUBLISHED, False)
    history = [p.state["q"].copy()]
    for t in table.time_s.to_numpy()[1:]:
        p.advance(t)
        history.append(p.state["q"].copy())
    return np.array(history), table, p


@pytest.mark.parametrize(
    "case", ["a_flight_no_forces", "a_flight_passive_bushing_limits", "a_flight_muscles_act0.05_no_reflex"]
)
def test_flight(case: str) -> None:
    """Every free coordinate within 1e-4 rad (or m) after 150 ms."""
    ours, table, p = fly(case)
    expected = table[[f"{n}_rad_or_m" for n in p.skeleton.coordinates]].to_numpy()
    np.testing.assert_allclose(ours, expected, rtol=0, atol=1e-4)


def test_energy_of_a_flight_without_forces() -> None:
    """Kinetic plus potential energy keeps to 1e-5 of the kinetic energy."""
    _, table, p = fly("a_flight_no_forces")
    names = p.skeleton.coordinates
    ends = [
        (p.state["q"].copy(), p.state["u"].copy()),
        (table[[f"{n}_rad_or_m" for n in names]].iloc[0], table[[f"{n}_speed" for n in names]].iloc[0]),
    ]
    energies = []
    for q, u in ends:
        p.state["q"], p.state["u"], p.state["valid"] = q, u, 0
        p.observe()
        kinetic = 0.5 * p.state["u"] @ p.state["mass"][0, :, :15] @ p.state["u"]
        own_masses, centres = masses(p)
        energies.append((kinetic, 9.80665 * own_masses @ centres[:, 1]))
    (k1, v1), (k0, v0) = energies
    assert abs(k1 - k0) > 1.0
    assert abs(k1 + v1 - k0 - v0) <= 1e-5 * k0, (k1 + v1 - k0 - v0) / k0
