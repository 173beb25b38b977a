"""Co-activation and delayed stretch reflex of the eight ankle-controlled muscles (equations and sources: README.md)."""

from __future__ import annotations

import pickle
from typing import ClassVar

import numpy as np

from .._fmi import Fmi2Slave
from .interface import EVERTORS, INVERTORS, MUSCLES, variables


class Slave(Fmi2Slave):
    variables: ClassVar[list[dict]] = variables()

    def __init__(self, **keywords: str) -> None:
        super().__init__(**keywords)
        self._inputs = self.slots(*(f"{m}_stretch_velocity" for m in MUSCLES))
        self._outputs = self.slots(*(f"{m}_excitation" for m in MUSCLES))
        self._times: list[float] = []
        self._stretch: list[np.ndarray] = []
        self._step = 0.0

    def initialise(self) -> None:
        self._base = self["coactivation"] * np.array([1.0] * len(EVERTORS) + [self["invertor_ratio"]] * len(INVERTORS))
        self._gain, self._delay = self["reflex_gain"], self["reflex_delay"]
        self._times, self._stretch, self._step = [0.0], [np.maximum(0.0, self.values[self._inputs])], 0.0
        self._write()

    def step(self, time: float, step: float) -> None:
        """The inputs are those at `time + step`: the controller takes its step after the plant."""
        if self._gain:
            self._times.append(time + step)
            self._stretch.append(np.maximum(0.0, self.values[self._inputs]))
            self._step = step
        self._write()

    def refresh(self) -> None:
        if self._gain:
            self._stretch[-1] = np.maximum(0.0, self.values[self._inputs])
        self._write()

    def save(self) -> bytes:
        return pickle.dumps((self._times, self._stretch, self._step)) if self._times else b""

    def restore(self, state: bytes) -> None:
        if not state:
            self._times, self._stretch = [], []
            return
        values = self.values.copy()
        self.initialise()
        self._times, self._stretch, self._step = pickle.loads(state)
        self.values[:] = values

    def _write(self) -> None:
        self.values[self._outputs] = self._base + self._gain * self._delayed() if self._gain else self._base

    def _delayed(self) -> np.ndarray | float:
        """Stretch velocity one delay before the middle of the coming step, over which the plant will hold the
        excitation; 0 before the start of the run. The newest sample stands for what is not known yet."""
        times = self._times
        wanted = min(times[-1] + 0.5 * self._step - self._delay, times[-1])
        if wanted < times[0]:
            return 0.0
        while len(times) > 2 and times[1] <= wanted:
            del times[0], self._stretch[0]
        if len(times) == 1:
            return self._stretch[0]
        k = 0
        weight = (wanted - times[k]) / (times[k + 1] - times[k])
        return self._stretch[k] + weight * (self._stretch[k + 1] - self._stretch[k])
