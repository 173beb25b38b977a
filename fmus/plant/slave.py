"""The FMI face of the plant: moves values between the FMU's variables and the kernels' state."""

from __future__ import annotations

import pickle
import sys
from pathlib import Path
from typing import ClassVar

import numpy as np

from .._fmi import Fmi2Slave
from .interface import ANKLE_MUSCLES, AXES, FIBRE_STARTS, IMPEDANCES, OUTPUTS, PARAMETERS, POSES, variables


def _say_if_compiling() -> None:
    if not any((Path(__file__).parent / "__pycache__").glob("kernels.*.nbi")):
        print("plant: compiling its kernels for this machine, once; this takes about 20 s", file=sys.stderr, flush=True)


_say_if_compiling()

from .plant import Landing, Plant  # noqa: E402

_STATE = ("time", "h", "q", "u", "a", "l", "evaluations", "steps", "rejected", "held_angle", "held_velocity")


class Slave(Fmi2Slave):
    variables: ClassVar[list[dict]] = variables()
    _idle: ClassVar[list[Plant]] = []

    def __init__(self, **keywords: str) -> None:
        super().__init__(**keywords)
        self._plant: Plant | None = None
        self._outputs = self.slots(*OUTPUTS)
        self._excitations = self.slots(*(f"{m}_excitation" for m in ANKLE_MUSCLES))
        self._torques = self.slots(*(f"brace_{a}_torque" for a in AXES))
        first = self.index[f"brace_{AXES[0]}_stiffness"]
        self._stiffness, self._damping = slice(first, first + len(IMPEDANCES)), slice(first + len(IMPEDANCES), first + 2 * len(IMPEDANCES))
        self._rows = np.array([AXES.index(a) for a, _ in IMPEDANCES])
        self._columns = np.array([AXES.index(b) for _, b in IMPEDANCES])
        if not self._idle:  # loading or compiling the kernels belongs to instantiation, not to the first run
            plant = Plant()
            plant.start(Landing())
            plant.advance(1e-5)
            self._idle.append(plant)

    def initialise(self) -> None:
        if self._plant is None:
            self._plant = self._idle.pop() if self._idle else Plant()
        landing = Landing(**{name: self[name] for name, *_ in PARAMETERS})
        landing.initial_pose = Landing.TOUCHING if self["initial_pose"] == POSES["touching"] else Landing.PUBLISHED
        as_published = self["fibre_start"] == FIBRE_STARTS["as_published"]
        landing.fibre_start = Landing.AS_PUBLISHED if as_published else Landing.EQUILIBRIUM
        self._plant.state["excitation"] = self.values[self._excitations]
        self._plant.start(landing)
        self.refresh()

    def refresh(self) -> None:
        self._write_inputs()
        state = self._plant.state
        state["held_angle"], state["held_velocity"] = state["angle"], state["velocity"]
        self.values[self._outputs] = self._plant.observe()

    def step(self, time: float, step: float) -> None:
        self._write_inputs()
        self._plant.advance(time + step)
        self.values[self._outputs] = self._plant.observe()

    def save(self) -> bytes:
        if self._plant is None:
            return b""
        return pickle.dumps([np.array(self._plant.state[name]) for name in _STATE])

    def restore(self, state: bytes) -> None:
        if not state:
            self.close()
            return
        running, values = self._running, self.values.copy()
        self.initialise()  # parameters back into the kernels
        for name, value in zip(_STATE, pickle.loads(state), strict=True):
            self._plant.state[name] = value
        self._plant.state["valid"] = 0
        self._write_inputs()
        self._running, self.values[:] = running, values

    def close(self) -> None:
        if getattr(self, "_plant", None) is not None:
            self._idle.append(self._plant)
            self._plant = None

    def _write_inputs(self) -> None:
        state, values = self._plant.state, self.values
        state["excitation"] = values[self._excitations]
        torques = values[self._torques]
        stiffness, damping = values[self._stiffness], values[self._damping]
        yielding = bool(stiffness.any() or damping.any())
        if yielding:
            state["stiffness"][self._rows, self._columns] = stiffness
            state["damping"][self._rows, self._columns] = damping
        state["torque"], state["yielding"] = torques, yielding
        state["braced"] = yielding or self._plant.internal_brace or bool(torques.any())
