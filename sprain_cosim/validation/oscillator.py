"""A foot (inertia I) and a spring-damper that hold each other, as two components of the master: a split oscillator
whose motion is known.

I dw/dt = -k x - kappa x³ - c w - d w, the terms in k, kappa and c from the device, d in the foot.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from ..cosim.master import Master
from ..cosim.result import Result
from ..cosim.system import System, connect
from ..errors import SimulationError
from ..fmu.element import Capabilities, Connector, Element
from ..units import unit

INERTIA = 0.005  # kg·m²
START = np.array([0.1, 0.0])  # rad, rad/s
DAMPING = 0.2  # N·m·s/rad in the foot
UNITS = {"angle": "rad", "velocity": "rad/s", "torque": "N.m", "stiffness": "N.m/rad", "damping": "N.m.s/rad"}
Numbers = dict[str, float]
UNIT, TERMS = np.eye(3), 40  # terms for a step times rates below 10


@dataclass(frozen=True)
class SpringDevice:
    """k [N·m/rad], c [N·m·s/rad], kappa [N·m/rad³]."""

    stiffness: float
    damping: float = 0.0
    cubic: float = 0.0

    def torque(self, angle: Any, velocity: Any) -> Any:
        return -self.stiffness * angle - self.cubic * angle**3 - self.damping * velocity


@dataclass(frozen=True)
class Part(Element):
    """An element that lives in this process: `advance(state, inputs, step)` and `output(state, inputs)` in place of a
    library."""

    advance: Callable[[np.ndarray, Numbers, float], np.ndarray] = lambda state, inputs, step: state
    output: Callable[[np.ndarray, Numbers], Sequence[float]] = lambda state, inputs: state.tolist()

    def open(self) -> Running:
        return Running(self)


def _part(name: str, inputs: Sequence[str], outputs: Sequence[str], direct: bool, **laws: Any) -> Part:
    """`direct`: the outputs follow the inputs at once."""
    connectors = {n: Connector(n, 0, "input", "real", unit(UNITS[n.rpartition("_")[2]])) for n in inputs}
    connectors |= {
        n: Connector(n, 0, "output", "real", unit(UNITS[n.rpartition("_")[2]]), depends_on=None if direct else ())
        for n in outputs
    }
    return Part(name, connectors, Capabilities("", state=True, reusable=True), **laws)


class Running:
    """Implements component.Instance; a part has no parameters, nothing to free, and nothing else to look at."""

    def __init__(self, part: Part) -> None:
        self.part = part
        self.reset()

    def bind(
        self,
        bus: np.ndarray,
        inputs: Sequence[str],
        first_input: int,
        outputs: Sequence[str],
        first_output: int,
        feedthrough: int,
    ) -> None:
        self.bus, self.names, self.wanted = bus, list(inputs), list(outputs)
        self.given, self.gives = (
            slice(first_input, first_input + len(inputs)),
            slice(first_output, first_output + len(outputs)),
        )

    def set_parameters(self, values: Mapping[str, float]) -> None: ...
    def enter_initialization(self, time: float, stop: float) -> None: ...
    def exit_initialization(self) -> None: ...
    def watch_locals(self, names: Sequence[str], seen: np.ndarray) -> None: ...
    def get_locals(self) -> None: ...
    def free_state(self, state: Any) -> None: ...
    def save_before_steps(self) -> None: ...
    def close(self) -> None: ...

    def reset(self) -> None:
        self.state, self.inputs = START.copy(), dict.fromkeys(self.part.inputs, 0.0)

    def set_inputs(self) -> None:
        self.inputs.update(zip(self.names, self.bus[self.given].tolist(), strict=True))

    def get_outputs(self) -> None:
        values = dict(zip(self.part.outputs, self.part.output(self.state, self.inputs), strict=True))
        self.bus[self.gives] = [values[name] for name in self.wanted]

    get_outputs_without_feedthrough = get_feedthrough_outputs = get_outputs

    def do_step(self, time: float, step: float) -> None:
        self.state = self.part.advance(self.state, self.inputs, step)

    def save_state(self) -> Any:
        return self.state.copy()

    def restore_state(self, state: Any) -> None:
        self.state = state.copy()


@lru_cache(maxsize=256)
def _transition(k: float, c: float, step: float) -> np.ndarray:
    """(2, 3): angle, velocity and a constant torque to angle and velocity one step later."""
    matrix, total = step * np.array([[0, 1, 0], [-k / INERTIA, -c / INERTIA, 1 / INERTIA], [0, 0, 0]]), UNIT
    for n in range(
        TERMS, 0, -1
    ):  # the exponential's series; a library's general one takes a hundred times as long for so small a matrix
        total = UNIT + matrix @ total / n
    rows: np.ndarray = total[:2]
    return rows


def _foot(damping: float) -> Part:
    """Solves its own equation exactly over every step, the torque and its hand-over as given at the step's start."""

    def advance(state: np.ndarray, inputs: Numbers, step: float) -> np.ndarray:
        k, c = inputs["brace_subtalar_stiffness"], inputs["brace_subtalar_damping"]
        force = inputs["brace_subtalar_torque"] + k * state[0] + c * state[1]
        after: np.ndarray = _transition(k, c + damping, step) @ np.array([*state, force])
        return after

    inputs = [f"brace_subtalar_{kind}" for kind in ("torque", "stiffness", "damping")]
    return _part("plant", inputs, ["subtalar_angle", "subtalar_velocity"], False, advance=advance)


def _device(device: SpringDevice) -> Part:
    def output(state: np.ndarray, inputs: Numbers) -> Sequence[float]:
        x, w = inputs["subtalar_angle"], inputs["subtalar_velocity"]
        return [device.torque(x, w), device.stiffness + 3 * device.cubic * x * x, device.damping]

    outputs = [f"subtalar_{kind}" for kind in ("torque", "stiffness", "damping")]
    return _part("brace", ["subtalar_angle", "subtalar_velocity"], outputs, True, output=output)


def swing(scheme: str, step: float, device: SpringDevice, damping: float = DAMPING, stop: float = 0.1) -> Result:
    """The coupled motion. Raises SimulationError when the run fails."""
    parts = (_foot(damping), _device(device))
    result = Master(communication_step=step, stop=stop, scheme=scheme).run(
        System(parts, connect(parts, {})[0]).open(), {}
    )
    if result.status != "completed":
        raise SimulationError(result.message)
    return result


def exact(times: np.ndarray, device: SpringDevice, damping: float = DAMPING) -> np.ndarray:
    """(n,) angle [rad] at the evenly spaced `times`: matrix exponential for a linear device, else an integration with
    tolerance 1e-11."""
    if not device.cubic:
        onward, state, angles = (
            _transition(device.stiffness, device.damping + damping, times[1])[:, :2],
            START,
            [START[0]],
        )
        for _ in times[1:]:
            state = onward @ state
            angles.append(state[0])
        return np.array(angles)
    angle: np.ndarray = solve_ivp(
        lambda t, y: [y[1], (device.torque(y[0], y[1]) - damping * y[1]) / INERTIA],
        (0, times[-1]),
        START,
        t_eval=times,
        rtol=1e-11,
        atol=1e-13,
    ).y[0]
    return angle


def order(scheme: str, steps: np.ndarray, device: SpringDevice) -> float:
    """Order of convergence of the angle's RMS error over `steps` [s]."""
    errors = []
    for h in steps:
        result = swing(scheme, h, device)
        errors.append(np.sqrt(np.mean((result["plant.subtalar_angle"] - exact(result.time, device)) ** 2)))
    return float(np.polyfit(np.log(steps), np.log(errors), 1)[0])
