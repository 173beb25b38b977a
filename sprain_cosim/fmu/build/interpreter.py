"""A device run as plain Python, nothing compiled: for tests of its law, and for a debugger."""

from __future__ import annotations

from typing import Any

from ...errors import SimulationError
from .device import Device, arguments


class Interpreted:
    """One instance. Call order as in FMI: set values - `initialise` - (set inputs, `refresh` or `step`, read)*.

    Values are read and written by name: `run["subtalar_angle"] = 0.1` [unit of interface.py]. Raises SimulationError
    with the device's own text where a function returns a position in REASONS; what a function raises passes."""

    def __init__(self, device: Device) -> None:
        self.device = device
        self.values, self.state, self.constants = device.records()

    def __getitem__(self, name: str) -> float:
        return float(self.values[name])

    def __setitem__(self, name: str, value: float) -> None:
        self.values[name] = value

    def initialise(self, time: float = 0.0) -> None:
        self._call("initialise", time, 0.0)

    def step(self, time: float, step: float) -> None:
        self._call("step", time, step)

    def refresh(self, time: float = 0.0) -> None:
        self._call("refresh", time, 0.0)

    def derivatives(self, seed: dict[str, float]) -> dict[str, float]:
        """Directional derivative of every output for `seed` of the inputs."""
        way, result, _ = self.device.records()
        for record in (way, result):
            for variable in self.device.variables:
                record[variable["name"]] = seed.get(variable["name"], 0.0) if record is way else 0.0
        self._call("differentiate", 0.0, 0.0, seed=way, result=result)
        outputs = [v["name"] for v in self.device.variables if v["causality"] == "output"]
        return {name: float(result[name]) for name in outputs}

    def _call(self, name: str, time: float, step: float, **more: Any) -> None:
        function = self.device.functions.get(name)
        if function is None:
            return
        record = dict(values=self.values, state=self.state, constants=self.constants, time=time, step=step, **more)
        code = function(**{a: record[a] for a in arguments(function)})
        if code:
            raise SimulationError(f"{self.device.name}: {self._reason(code)}")

    def _reason(self, code: int) -> str:
        reason = self.device.reasons[code]
        if reason.offset < 0:
            return reason.format
        name = next(n for n, field in (self.device.state.fields or {}).items() if field[1] == reason.offset)
        return reason.format % float(self.state[name])
