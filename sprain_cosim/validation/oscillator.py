"""A foot (inertia I) and a spring-damper that hold each other, as two components in Python under the master: a split
oscillator whose motion is known.

I dw/dt = -k x - kappa x³ - c w - d w, the terms in k, kappa and c from the device, d in the foot.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from ..cosim.master import Master
from ..cosim.result import Result
from ..cosim.system import System, connect
from ..errors import SimulationError
from ..fmu.python import Numbers, PythonComponent

INERTIA = 0.005  # kg·m²
START = np.array([0.1, 0.0])  # rad, rad/s
DAMPING = 0.2  # N·m·s/rad in the foot
UNITS = {"angle": "rad", "velocity": "rad/s", "torque": "N.m", "stiffness": "N.m/rad", "damping": "N.m.s/rad"}
Array = NDArray[np.float64]
UNIT, TERMS = np.eye(3), 40  # terms for a step times rates below 10


@dataclass(frozen=True)
class SpringDevice:
    """k [N·m/rad], c [N·m·s/rad], kappa [N·m/rad³]."""

    stiffness: float
    damping: float = 0.0
    cubic: float = 0.0

    def torque(self, angle: Any, velocity: Any) -> Any:
        return -self.stiffness * angle - self.cubic * angle**3 - self.damping * velocity


@lru_cache(maxsize=256)
def _transition(k: float, c: float, step: float) -> Array:
    """(2, 3): angle, velocity and a constant torque to angle and velocity one step later."""
    matrix, total = step * np.array([[0, 1, 0], [-k / INERTIA, -c / INERTIA, 1 / INERTIA], [0, 0, 0]]), UNIT
    for n in range(
        TERMS, 0, -1
    ):  # the exponential's series; a library's general one takes a hundred times as long for so small a matrix
        total = UNIT + matrix @ total / n
    transition: Array = total[:2]
    return transition


def _foot(damping: float) -> PythonComponent:
    """Solves its own equation exactly over every step, the torque and its hand-over as they are at the step's start."""

    def advance(state: Array, values: Numbers, time: float, step: float) -> Array:
        k, c = values["brace_subtalar_stiffness"], values["brace_subtalar_damping"]
        force = values["brace_subtalar_torque"] + k * state[0] + c * state[1]
        later: Array = _transition(k, c + damping, step) @ np.array([*state, force])
        return later

    return PythonComponent.define(
        "plant",
        inputs={f"brace_subtalar_{kind}": UNITS[kind] for kind in ("torque", "stiffness", "damping")},
        outputs={f"subtalar_{kind}": UNITS[kind] for kind in ("angle", "velocity")},
        output=lambda state, values: state.tolist(),
        advance=advance,
        initial=START,
        direct={},
    )


def _device(device: SpringDevice) -> PythonComponent:
    def output(state: None, values: Numbers) -> Sequence[float]:
        x, w = values["subtalar_angle"], values["subtalar_velocity"]
        return [device.torque(x, w), device.stiffness + 3 * device.cubic * x * x, device.damping]

    return PythonComponent.define(
        "brace",
        inputs={f"subtalar_{kind}": UNITS[kind] for kind in ("angle", "velocity")},
        outputs={f"subtalar_{kind}": UNITS[kind] for kind in ("torque", "stiffness", "damping")},
        output=output,
    )


def swing(scheme: str, step: float, device: SpringDevice, damping: float = DAMPING, stop: float = 0.1) -> Result:
    """The coupled motion. Raises SimulationError when the run fails."""
    parts = (_foot(damping), _device(device))
    result = Master(communication_step=step, stop=stop, scheme=scheme).run(
        System(parts, connect(parts, {})[0]).open(), {}
    )
    if result.status != "completed":
        raise SimulationError(result.message)
    return result


def exact(times: Array, device: SpringDevice, damping: float = DAMPING) -> Array:
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
    angle: Array = solve_ivp(
        lambda t, y: [y[1], (device.torque(y[0], y[1]) - damping * y[1]) / INERTIA],
        (0, times[-1]),
        START,
        t_eval=times,
        rtol=1e-11,
        atol=1e-13,
    ).y[0]
    return angle


def order(scheme: str, steps: NDArray[np.floating[Any]], device: SpringDevice) -> float:
    """Order of convergence of the angle's RMS error over `steps` [s]."""
    errors = []
    for h in steps:
        result = swing(scheme, h, device)
        errors.append(np.sqrt(np.mean((result["plant.subtalar_angle"] - exact(result.time, device)) ** 2)))
    return float(np.polyfit(np.log(steps), np.log(errors), 1)[0])
