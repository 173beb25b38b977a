"""One landing in one Python process, for tests and tools: the kernels, compiled by numba when they are first called,
behind a small object."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from . import constants, kernels, person
from .interface import MOVING, NO_EDGE, PERSON, PLACED
from .interface import PARAMETERS as OF_FMU

STARTS = {name: start for name, _, start, *_ in OF_FMU}


class SimulationError(RuntimeError):
    """The integration cannot go on; says when and why."""


@dataclass
class Landing:
    """The parameters of one landing; names, units, signs and zeros as in interface.py; `placed`, `moving` and `person`
    hold those of PLACED, MOVING and PERSON, in their order."""

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
    evertor_strength_scale: float = 1.0
    body_reflex_scale: float = 1.0
    initial_ankle_activation: float = 0.0
    internal_brace_angle_scale: float = 0.0
    platform_edge_distance: float = NO_EDGE
    platform_edge_direction: float = 0.0
    tolerance: float = 0.0025
    initial_pose: int = 0
    fibre_start: int = 0
    placed: tuple[float, ...] = tuple(STARTS[name] for name in PLACED.values())
    moving: tuple[float, ...] = tuple(STARTS[name] for name in MOVING.values())
    person: tuple[float, ...] = tuple(start for _, _, start, *_ in PERSON)

    TOUCHING, PUBLISHED, GIVEN = kernels.TOUCHING, kernels.PUBLISHED, kernels.GIVEN
    EQUILIBRIUM, AS_PUBLISHED = 0, 1


PARAMETERS = [field.name for field in fields(Landing)]


def person_with(**values: float) -> tuple[float, ...]:
    """The base person with other parameters of interface.PERSON by name, as Landing takes them. Raises KeyError."""
    names = [name for name, *_ in PERSON]
    unknown = set(values) - set(names)
    if unknown:
        raise KeyError(", ".join(sorted(unknown)))
    return tuple(values.get(name, STARTS[name]) for name in names)


class Plant:
    """`start(landing)`, then `advance(to)` any number of times; `observe()` gives the outputs of interface.py.

    Inputs are written to `state` (fields `excitation`, `torque`, `stiffness`, `damping`) and held by `advance`.
    `facets` (7, n) replaces the project's sole. Raises SimulationError when a step cannot be taken."""

    def __init__(self, facets: np.ndarray | None = None) -> None:
        self.skeleton, self.muscles, _ = constants.anatomy()
        self._base = constants.record()
        self._sole = self._base["sole"] if facets is None else constants.blocks(facets)
        self._own_model, self._own_sole = self._base["model"].copy(), self._sole.copy()
        self._scaled = np.zeros(1, person.SCALED)
        self._state = np.zeros(1, kernels.STATE)
        self.state = self._state[0]
        self.outputs = np.zeros(kernels.N_OUTPUTS)
        self.embody(person_with())
        self.ankle_muscles = constants.ankle_muscles(self.muscles)
        q, _ = self.skeleton.initial()
        q[kernels.TALOCRURAL] = q[kernels.SUBTALAR] = 0.0
        state = self.state
        state["plane"], state["l"], state["a"], state["strength"] = np.eye(3), self._model[0]["l_opt"], 0.05, 1.0
        state["q"], state["u"] = q, 0.0

    def embody(self, who: Sequence[float]) -> None:
        """Becomes the person of interface.PERSON; a landing that is started does so by itself."""
        person.embody(
            self._base[0],
            self._sole[0],
            self._own_model[0],
            self.state,
            self._scaled[0],
            self._own_sole[0]["facets"],
            self._own_sole[0]["blocks"],
            np.array(who),
        )
        own = self._scaled[0]["own"]
        self._model = self._own_model if own else self._base["model"]
        sole = self._own_sole if own else self._sole
        self._facets, self._blocks = sole[0]["facets"], sole[0]["blocks"]

    def start(self, landing: Landing) -> None:
        """Sets the state at contact. Excitations present in `state` give the ankle muscles their initial activation
        (floor 0.01) unless `initial_ankle_activation` is set. Raises SimulationError for a given pose whose foot is
        inside the platform."""
        self.embody(landing.person)
        chosen = np.zeros((), [(name, "f8", np.shape(getattr(landing, name))) for name in PARAMETERS])
        for name in PARAMETERS:
            chosen[name] = getattr(landing, name)
        kernels.prepare(self._model[0], self.state, chosen[()])
        status = kernels.initialise(
            self._model[0],
            self.state,
            self._facets,
            self._blocks,
            landing.initial_pose,
            landing.fibre_start == Landing.AS_PUBLISHED,
        )
        self.penetration = 1e-3 * self.state["depth_mm"]
        if status == kernels.FOOT_INSIDE:
            raise SimulationError(f"plant: the foot is {self.state['depth_mm']:.1f} mm inside the platform")
        if status == kernels.NO_FOOTHOLD:
            raise SimulationError("plant: no part of the sole is on this side of the platform's edge")

    def advance(self, to: float, fixed_step: float = 0.0) -> None:
        """Integrates to time `to` [s] with inputs held. `fixed_step` [s] > 0 switches the step control off (for
        convergence studies)."""
        status = kernels.advance(self._model[0], self.state, self._facets, self._blocks, to, fixed_step)
        if status != kernels.DONE:
            reason = {
                kernels.NOT_FINITE: "the state is no longer finite",
                kernels.STEP_TOO_SMALL: "the step fell below 1e-11 s",
                kernels.TOO_MANY_STEPS: f"{kernels.MAX_STEPS} steps were not enough; the parameters make the model "
                "too stiff",
            }[status]
            raise SimulationError(f"plant: the integration stopped at {self.state['time']:.6f} s: {reason}")

    def observe(self) -> np.ndarray:
        kernels.observe(self._model[0], self.state, self._facets, self._blocks, self.outputs)
        return self.outputs

    def take(self, inputs: np.ndarray) -> None:
        """All inputs of interface.py, in their order."""
        kernels.take(self.state, inputs)

    def respond(self, inputs: np.ndarray, moments: np.ndarray) -> None:
        """New inputs at the present state, and the outputs that follow them at once: the moments of the brace
        (n_axes,)."""
        kernels.respond(self._model[0], self.state, inputs, moments)

    def look(self, out: np.ndarray) -> None:
        """The local variables of interface.py, in their order."""
        kernels.look(self._model[0], self.state, self._facets, self._blocks, out)
