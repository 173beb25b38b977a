"""One landing in one process: the compiled kernels behind a small object. The FMU's slave is a thin face over it."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from functools import lru_cache

import mujoco
import numpy as np

from . import kernels
from .interface import ANKLE_MUSCLES
from .model import GRAVITY, Muscles, Skeleton, load_muscles, load_skeleton, table

PLATFORM_PIVOT = (-0.2, 0.015, 0.35)
MAX_PENNATION = math.acos(0.1)


class SimulationError(RuntimeError):
    """The integration cannot go on; says when and why."""


@dataclass
class Landing:
    """The parameters of one landing; names, units, signs and zeros as in interface.py."""

    platform_incline: float = math.radians(30.0)
    drop_height: float = 0.30
    contact_modulus: float = 5e7
    contact_dissipation: float = 5.0
    contact_friction: float = 0.9
    contact_viscous_friction: float = 0.9
    talocrural_angle_at_contact: float = math.radians(-34.0)
    subtalar_angle_at_contact: float = 0.0
    talocrural_velocity_at_contact: float = 13.69543
    subtalar_velocity_at_contact: float = 0.0
    pelvis_vertical_velocity: float = 0.0
    passive_angle_scale: float = 1.0
    ankle_strength_scale: float = 1.0
    body_reflex_scale: float = 1.0
    initial_ankle_activation: float = 0.0
    internal_brace_angle_scale: float = 0.0
    tolerance: float = 0.0025
    initial_pose: int = 0
    fibre_start: int = 0

    TOUCHING, PUBLISHED = 0, 1
    EQUILIBRIUM, AS_PUBLISHED = 0, 1


PARAMETERS = [field.name for field in fields(Landing)]


@lru_cache(maxsize=1)
def anatomy() -> tuple[Skeleton, Muscles, mujoco.MjModel]:
    skeleton = load_skeleton()
    return skeleton, load_muscles(skeleton), mujoco.MjModel.from_xml_string(skeleton.mjcf())


@lru_cache(maxsize=1)
def sole() -> np.ndarray:
    """(4, n): x, y, z in the calcaneus frame [m] and area [m^2] of each facet."""
    rows = table("sole")
    return np.array([[float(row[c]) for row in rows] for c in ("x_m", "y_m", "z_m", "area_m2")])


def blocks(facets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sorts (4, n) facets into m spatial blocks: (m, 4, BLOCK), padded with repeated facets of no area, and the (6, m)
    centres and half extents of their bounding boxes."""
    if facets.shape[1] > kernels.MAX_FACETS // 2:
        raise ValueError(f"a sole of {facets.shape[1]} facets; at most {kernels.MAX_FACETS // 2} are supported")

    def split(members: np.ndarray) -> list[np.ndarray]:
        if len(members) <= kernels.BLOCK:
            return [members]
        here = facets[:3, members]
        members = members[np.argsort(here[np.argmax(np.ptp(here, axis=1))], kind="stable")]
        half = math.ceil(len(members) / 2 / kernels.BLOCK) * kernels.BLOCK
        return split(members[:half]) + split(members[half:])

    groups = split(np.arange(facets.shape[1]))
    padded = np.array([np.resize(members, kernels.BLOCK) for members in groups])
    ordered = np.ascontiguousarray(facets[:, padded].transpose(1, 0, 2))
    for block, members in zip(ordered, groups, strict=True):
        block[3, len(members) :] = 0.0
    low, high = ordered[:, :3].min(axis=2), ordered[:, :3].max(axis=2)
    return ordered, np.ascontiguousarray(np.hstack([(low + high) / 2, (high - low) / 2]).T)


class Plant:
    """`start(landing)`, then `advance(to)` any number of times; `observe()` gives the outputs of interface.py.

    Inputs are written to `state` (fields `excitation`, `torque`, `stiffness`, `damping`) and held by `advance`.
    `facets` (4, n) replaces the project's sole. Raises SimulationError when a step cannot be taken."""

    def __init__(self, facets: np.ndarray | None = None) -> None:
        self.skeleton, self.muscles, self._mj_model = anatomy()
        self._mj_data = mujoco.MjData(self._mj_model)
        self._facets, self._blocks = blocks(sole() if facets is None else facets)
        self._model = np.zeros(1, kernels.MODEL)
        self._state = np.zeros(1, kernels.STATE)
        self.state = self._state[0]
        self.outputs = np.zeros(kernels.N_OUTPUTS)
        self._fill_model()

    def _fill_model(self) -> None:
        m, d, model = self._mj_model, self._mj_data, self._model[0]
        model["mj_model"], model["mj_data"] = m._address, d._address
        for name in ("qpos", "qvel", "qacc", "xpos", "xmat", "xanchor", "xaxis"):
            model[name] = getattr(d, name).ctypes.data
        model["mass"] = d.M.ctypes.data
        n = model["n_mass"] = d.M.size
        model["mass_row"][:n] = np.repeat(np.arange(m.nv), m.M_rownnz)
        model["mass_column"][:n] = m.M_colind

        coupled = [v for v in self.skeleton.movements if v.spline is not None]
        for j, movement in enumerate(coupled):
            assert movement.spline is not None
            size = len(movement.spline.knots)
            model["spline_size"][j], model["spline_scale"][j] = size, movement.scale
            model["spline_knot"][j, :size] = movement.spline.knots
            model["spline_coefficient"][j, : size - 1] = movement.spline.coefficients

        muscles = self.muscles
        model["max_force"], model["l_opt"], model["l_slack"] = (
            muscles.max_force,
            muscles.optimal_length,
            muscles.slack_length,
        )
        model["height"] = muscles.optimal_length * np.sin(muscles.pennation)
        model["l_min"] = np.maximum(0.01 * muscles.optimal_length, model["height"] / math.sin(MAX_PENNATION))
        for name in (
            "length_gain",
            "velocity_gain",
            "rest_length",
            "point_muscle",
            "point_body",
            "point",
            "point_coordinate",
        ):
            model[name] = getattr(muscles, name)
        model["point_low"], model["point_high"] = muscles.point_range.T
        self.ankle_muscles = [muscles.names.index(f"{name}_r") for name in ANKLE_MUSCLES]
        model["ankle_muscle"] = self.ankle_muscles
        model["ankle_index"] = -1
        model["ankle_index"][self.ankle_muscles] = np.arange(len(ANKLE_MUSCLES))

        bushings = {(r["bushing"], r["axis"]): r for r in table("bushings")}
        columns = ("linear_Nm", "quadratic_Nm", "cubic_Nm", "damping_Nm_s")
        for i, axis in enumerate("xyz"):
            model["ankle_bushing"][i] = [float(bushings["ankle", axis][c]) for c in columns[:3]]
            model["lumbar_bushing"][i] = [float(bushings["lumbar", axis][c]) for c in columns]
        limits = {row["coordinate"]: row for row in table("limits")}
        turn = math.degrees(1.0)
        for i, name in enumerate(("lumbar_extension", "knee_angle_r")):
            row = limits[name]
            model["limit"][i] = [
                math.radians(float(row["upper_deg"])),
                math.radians(float(row["lower_deg"])),
                float(row["upper_stiffness_Nm_per_deg"]) * turn,
                float(row["lower_stiffness_Nm_per_deg"]) * turn,
                float(row["damping_Nm_s_per_deg"]) * turn,
                math.radians(float(row["transition_deg"])),
            ]
        model["pivot"] = PLATFORM_PIVOT
        q, _ = self.skeleton.initial()
        state = self.state
        state["plane"], state["l"], state["a"], state["strength"] = np.eye(3), model["l_opt"], 0.05, 1.0
        q[kernels.TALOCRURAL] = q[kernels.SUBTALAR] = 0.0
        state["q"], state["u"] = q, 0.0
        kernels.observe(self._model, self._state, self._facets, self._blocks, self.outputs)
        model["jcs_zero"] = state["angle"][2:5].copy()

    def start(self, landing: Landing) -> None:
        """Sets the state at contact. Excitations present in `state` give the ankle muscles their initial activation
        (floor 0.01) unless `initial_ankle_activation` is set."""
        s = self.state
        sine, cosine = math.sin(landing.platform_incline), math.cos(landing.platform_incline)
        s["plane"] = [[1.0, 0.0, 0.0], [0.0, sine, -cosine], [0.0, cosine, sine]]
        s["modulus"], s["dissipation"] = landing.contact_modulus, landing.contact_dissipation
        s["friction"], s["viscous_friction"], s["transition"] = (
            landing.contact_friction,
            landing.contact_viscous_friction,
            0.1,
        )
        s["passive_scale"], s["internal_brace_scale"] = landing.passive_angle_scale, landing.internal_brace_angle_scale
        s["reflex_scale"], s["tolerance"] = landing.body_reflex_scale, landing.tolerance
        s["excitation_floor"] = kernels.MIN_ACTIVATION if landing.fibre_start == Landing.AS_PUBLISHED else 0.0
        s["strength"] = 1.0
        s["strength"][self.ankle_muscles] = landing.ankle_strength_scale
        q, u = self.skeleton.initial()
        q[kernels.TALOCRURAL], q[kernels.SUBTALAR] = (
            landing.talocrural_angle_at_contact,
            landing.subtalar_angle_at_contact,
        )
        u[kernels.TALOCRURAL], u[kernels.SUBTALAR] = (
            landing.talocrural_velocity_at_contact,
            landing.subtalar_velocity_at_contact,
        )
        u[1] = landing.pelvis_vertical_velocity or -math.sqrt(2.0 * GRAVITY * landing.drop_height)
        s["q"], s["u"], s["a"] = q, u, 0.05
        ankle = landing.initial_ankle_activation or s["excitation"]
        s["a"][self.ankle_muscles] = np.clip(ankle, kernels.MIN_ACTIVATION, 1.0)
        s["braced"], s["yielding"] = landing.internal_brace_angle_scale != 0.0, 0
        s["torque"] = s["stiffness"] = s["damping"] = s["held_angle"] = s["held_velocity"] = 0.0
        self.penetration = kernels.initialise(
            self._model,
            self._state,
            self._facets,
            self._blocks,
            landing.initial_pose == Landing.TOUCHING,
            landing.fibre_start == Landing.AS_PUBLISHED,
        )

    def advance(self, to: float, fixed_step: float = 0.0) -> None:
        """Integrates to time `to` [s] with inputs held. `fixed_step` [s] > 0 switches the step control off (for
        convergence studies)."""
        status = kernels.advance(self._model, self._state, self._facets, self._blocks, to, fixed_step)
        if status != kernels.DONE:
            reason = {
                kernels.NOT_FINITE: "the state is no longer finite",
                kernels.STEP_TOO_SMALL: "the step fell below 1e-11 s",
                kernels.TOO_MANY_STEPS: f"{kernels.MAX_STEPS} steps were not enough; the parameters make the model "
                "too stiff",
            }[status]
            raise SimulationError(f"plant: the integration stopped at {self.state['time']:.6f} s: {reason}")

    def observe(self) -> np.ndarray:
        kernels.observe(self._model, self._state, self._facets, self._blocks, self.outputs)
        return self.outputs

    def take(self, inputs: np.ndarray) -> None:
        """All inputs of interface.py, in their order."""
        kernels.take(self._state, inputs)

    def respond(self, inputs: np.ndarray, moments: np.ndarray) -> None:
        """New inputs at the present state, and the outputs that follow them at once: the moments of the brace
        (n_axes,)."""
        kernels.respond(self._model, self._state, inputs, moments)

    def look(self, out: np.ndarray) -> None:
        """The local variables of interface.py, in their order."""
        kernels.look(self._model, self._state, self._facets, self._blocks, out)
