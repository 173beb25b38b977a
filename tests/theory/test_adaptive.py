"""Communication steps divided by the residual energy, on a light foot that runs into a hard stop."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from sprain_cosim.cosim.master import Master
from sprain_cosim.cosim.result import Result
from sprain_cosim.cosim.system import System, connect
from sprain_cosim.errors import InputError
from sprain_cosim.fmu.element import Capabilities
from tests.fake import FakeComponent, connector
from tests.theory.test_coupling import INERTIA, foot

STIFFNESS, STOP, DAMPING, EDGE = 20.0, 1500.0, 0.05, 0.08
SCHEMES = ("jacobi", "gauss-seidel", "gauss-seidel-extrapolated", "impedance")


def torque(x: float, w: float) -> float:
    return -STIFFNESS * x - STOP * max(0.0, abs(x) - EDGE) * np.sign(x) - DAMPING * w


def stop(**more) -> FakeComponent:
    """Soft up to 0.08 rad, then hard."""

    def output(state, inputs):
        x, w = inputs["subtalar_angle"], inputs["subtalar_velocity"]
        return [torque(x, w), STIFFNESS + (STOP if abs(x) > EDGE else 0.0), DAMPING]

    names = {
        "subtalar_angle": ("input", "rad"),
        "subtalar_velocity": ("input", "rad/s"),
        "subtalar_torque": ("output", "N.m"),
    }
    names |= {"subtalar_stiffness": ("output", "N.m/rad"), "subtalar_damping": ("output", "N.m.s/rad")}
    return FakeComponent("brace", {n: connector(n, c, u) for n, (c, u) in names.items()}, output=output, **more)


def run(scheme: str, step: float, adaptive: float = 0.0, brace: FakeComponent | None = None) -> Result:
    parts = (foot(0.1), brace or stop())
    result = Master(communication_step=step, stop=0.1, scheme=scheme, adaptive=adaptive).run(
        System(parts, connect(parts, {})[0]).open(), {}
    )
    assert result.status == "completed", result.message
    return result


def error(result: Result) -> float:
    truth = solve_ivp(
        lambda t, y: [y[1], (torque(*y) - 0.1 * y[1]) / INERTIA],
        (0, 0.1),
        (0.1, 0.0),
        t_eval=result.time,
        rtol=1e-8,
        atol=1e-10,
        max_step=5e-4,
    )
    return float(np.sqrt(np.mean((result["plant.subtalar_angle"] - truth.y[0]) ** 2)))


@pytest.mark.parametrize("scheme", SCHEMES)
def test_the_residual_stays_within_the_tolerance(scheme: str) -> None:
    tolerance = 0.05 if scheme == "jacobi" else 0.01
    plain, divided = run(scheme, 1e-3), run(scheme, 1e-3, tolerance)
    assert (divided.time == plain.time).all()
    assert divided.coupling_error <= tolerance < plain.coupling_error
    assert error(divided) < 0.5 * error(plain)
    assert divided.exchanges > plain.exchanges == 100
    assert divided.smallest_step < plain.smallest_step == 1e-3


@pytest.mark.parametrize("scheme", ["gauss-seidel", "impedance"])
def test_fewer_exchanges_for_the_same_error(scheme: str) -> None:
    """A fixed step with as many exchanges is less accurate: the stop is touched for a small part of the time."""
    divided = run(scheme, 2e-3, 0.01)
    fixed = run(scheme, 0.1 / divided.exchanges)
    assert error(divided) < 0.7 * error(fixed)


def test_a_tolerance_that_is_never_exceeded_changes_nothing() -> None:
    for scheme in SCHEMES:
        assert (run(scheme, 1e-3).values == run(scheme, 1e-3, 1e9).values).all()


@pytest.mark.parametrize("scheme", SCHEMES)
def test_without_saved_states_the_steps_are_chosen_with_care(scheme: str) -> None:
    """The tolerance is aimed at, not kept: nothing can be taken again."""
    brace = stop(capabilities=Capabilities("2.0", state=False))
    result = run(scheme, 1e-3, 0.02, brace)
    assert result.coupling_error <= 0.04
    assert result.coupling_error < 0.7 * run(scheme, 1e-3).coupling_error
    assert result.exchanges < 3200  # it does fall from the 16 parts it begins with


def test_a_device_with_a_step_of_its_own_is_divided_into_whole_multiples() -> None:
    result = run(
        "gauss-seidel",
        1e-3,
        1e-4,
        stop(capabilities=Capabilities("2.0", state=True, fixed_step=1.25e-4, variable_step=False)),
    )
    assert result.smallest_step == pytest.approx(1.25e-4)


def test_what_cannot_be_divided_is_refused() -> None:
    with pytest.raises(InputError, match="adaptive: the residual of scheme iterative"):
        run("iterative", 1e-3, 0.01)
    with pytest.raises(InputError, match="adaptive: brace cannot change the communication step"):
        run("gauss-seidel", 1e-3, 0.01, stop(capabilities=Capabilities("2.0", state=True, variable_step=False)))
