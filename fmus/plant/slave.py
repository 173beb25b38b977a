"""The FMI face of the plant: moves values between the FMU's variables and the kernels' state."""

from __future__ import annotations

import pickle
import sys
from pathlib import Path
from typing import ClassVar

import numpy as np

from .._fmi import Fmi2Slave
from .interface import ANKLE_MUSCLES, AXES, FIBRE_STARTS, LOCALS, OUTPUTS, PARAMETERS, POSES, variables


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
        self._given = self.values[self.index[f"{ANKLE_MUSCLES[0]}_excitation"] : self.index[OUTPUTS[0]]]
        self._gives = self.values[self.slots(*OUTPUTS)]
        self._hidden = self.values[self.slots(*(name for name, _, _ in LOCALS))]
        self._moments = self.values[self.slots(*(f"brace_{axis}_moment" for axis in AXES))]
        if not self._idle:  # loading or compiling the kernels belongs to instantiation, not to the first run
            plant = Plant()
            plant.start(Landing())
            plant.advance(1e-5)
            plant.take(self._given)
            plant.respond(self._given, self._moments.copy())
            plant.look(self._hidden.copy())
            self._idle.append(plant)

    def initialise(self) -> None:
        if self._plant is None:
            self._plant = self._idle.pop() if self._idle else Plant()
        landing = Landing(**{name: self[name] for name, *_ in PARAMETERS})
        landing.initial_pose = Landing.TOUCHING if self["initial_pose"] == POSES["touching"] else Landing.PUBLISHED
        as_published = self["fibre_start"] == FIBRE_STARTS["as_published"]
        landing.fibre_start = Landing.AS_PUBLISHED if as_published else Landing.EQUILIBRIUM
        self._plant.take(self._given)  # the excitations give the initial activations
        self._plant.start(landing)
        self._plant.respond(self._given, self._moments)
        self._gives[:] = self._plant.observe()

    def refresh(self) -> None:
        self._plant.respond(self._given, self._moments)

    def step(self, time: float, step: float) -> None:
        self._plant.take(self._given)
        self._plant.advance(time + step)
        self._gives[:] = self._plant.observe()

    def reveal(self) -> None:
        self._plant.look(self._hidden)

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
        self._running, self.values[:] = running, values
        self._plant.take(self._given)

    def close(self) -> None:
        if getattr(self, "_plant", None) is not None:
            self._idle.append(self._plant)
            self._plant = None
