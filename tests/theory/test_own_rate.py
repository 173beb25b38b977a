"""Devices with a rate of their own on a foot (inertia I): a sampled device against the exact solution of the sampled
system, one that is continuous in truth against that of the continuous one."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from sprain_cosim.cosim.coupling import SCHEMES
from sprain_cosim.cosim.master import Master
from sprain_cosim.cosim.result import Result
from sprain_cosim.cosim.system import System, connect
from sprain_cosim.errors import InputError
from sprain_cosim.fmu.element import Capabilities
from tests.fake import FakeComponent, connector
from tests.theory.test_coupling import INERTIA, START, device, exact, foot, light_foot, silent

FOOT_DAMPING = 0.2


def sampled(k: float, c: float, period: float, cubic: float = 0.0, continuous: bool = False, **more) -> FakeComponent:
    """A law that is evaluated at its own times only, undeclared; its torque before the first is that at the start."""

    def torque(inputs):
        angle, velocity = inputs["subtalar_angle"], inputs["subtalar_velocity"]
        return -k * angle - cubic * angle**3 - c * velocity

    units = {"subtalar_angle": "rad", "subtalar_velocity": "rad/s", "subtalar_torque": "N.m"}
    connectors = {n: connector(n, "output" if n.endswith("torque") else "input", u) for n, u in units.items()}
    connectors["subtalar_torque"] = connector("subtalar_torque", "output", "N.m", depends_on=())
    return FakeComponent(
        "brace",
        connectors,
        advance=lambda s, i, t, h: torque(i),
        output=lambda s, i: [s],
        initial=torque(dict(zip(units, START, strict=False))),
        capabilities=Capabilities("2.0", state=True, fixed_step=period, variable_step=False, continuous=continuous),
        **more,
    )


def run(brace: FakeComponent, step: float = 5e-4, scheme: str = "auto", stop: float = 0.1, **settings) -> Result:
    parts = (settings.pop("plant", None) or foot(FOOT_DAMPING), brace)
    system = System(parts, connect(parts, {})[0])
    assert system.check(step) == []
    result = Master(communication_step=step, stop=stop, scheme=scheme, **settings).run(system.open(), {})
    assert result.status == "completed", result.message
    return result


def truth(times: np.ndarray, k: float, c: float, period: float) -> np.ndarray:
    """(n,) angle under a torque that is sampled every period and held."""
    matrix = np.array([[0, 1, 0], [0, -FOOT_DAMPING / INERTIA, 1 / INERTIA], [0, 0, 0]])
    angles, state, n, whole = [], START.copy(), 0, expm(period * matrix)
    torque = -k * state[0] - c * state[1]
    for t in times:
        while (n + 1) * period <= t + 1e-12:
            state = (whole @ [*state, torque])[:2]
            torque, n = -k * state[0] - c * state[1], n + 1
        angles.append((expm((t - n * period) * matrix) @ [*state, torque])[0])
    return np.array(angles)


@pytest.mark.parametrize("scheme", ["auto", *SCHEMES])
@pytest.mark.parametrize(("period", "step"), [(1e-2, 5e-4), (1e-2, 1e-2), (1e-3, 5e-4), (7e-4, 5e-4), (3e-3, 2e-3)])
def test_a_sampled_device_is_coupled_exactly(scheme: str, period: float, step: float) -> None:
    """Under every scheme and step, the record on its own grid; nothing is handed over and nothing misstated."""
    k, c = 60.0, 0.05
    result = run(sampled(k, c, period), step, scheme)
    assert np.diff(result.time) == pytest.approx(min(step, 5e-4))
    assert result["plant.subtalar_angle"] == pytest.approx(truth(result.time, k, c, period), abs=1e-12)
    assert not result["plant.brace_subtalar_stiffness"].any()
    assert result.coupling_error == pytest.approx(0.0, abs=1e-12)
    if scheme == "auto":
        assert result.scheme == "gauss-seidel"
        assert result.scheme_reason == f"every torque is sampled, every {1e3 * period:g} ms, and held in between"


def test_a_declared_stiffness_is_not_handed_over_between_the_calls() -> None:
    able = Capabilities("2.0", fixed_step=5e-3)
    declared = device(60.0, 0.05, capabilities=able)
    result = run(declared, scheme="impedance")
    assert result["brace.subtalar_stiffness"][0] == 60.0
    assert not result["plant.brace_subtalar_stiffness"].any()
    assert result["plant.subtalar_angle"] == pytest.approx(truth(result.time, 60.0, 0.05, 5e-3), abs=1e-12)


def test_the_device_is_called_at_its_own_times_only() -> None:
    brace = sampled(60.0, 0.0, 7e-3, journal=[])
    run(brace, guard=False, scheme="gauss-seidel")
    calls = [float(line.split()[1]) for line in brace.journal if line.startswith("do_step")]
    assert calls == [k * 7e-3 for k in range(14)]


@pytest.mark.parametrize("period", [1e-2, 1e-3])
def test_how_old_the_torque_becomes_is_stated(period: float) -> None:
    """The largest change from one call to the next, and its share of the largest torque."""
    result = run(sampled(60.0, 0.05, period))
    torque = result["brace.subtalar_torque"]
    held = result.held["brace"]
    calls = torque[:: round(period / 5e-4)]
    assert (held.period, held.axis) == (period, "subtalar")
    assert held.largest_change == pytest.approx(np.abs(np.diff(calls)).max(), rel=1e-9)
    assert held.share == pytest.approx(held.largest_change / np.abs(torque).max(), rel=1e-9)
    assert run(device(60.0, 0.05)).held == {}


@pytest.mark.parametrize("declares", [True, False])
@pytest.mark.parametrize(("period", "step"), [(4e-3, 5e-4), (4e-3, 1e-2), (7e-4, 5e-4), (1e-4, 5e-4), (3e-3, 2e-3)])
def test_a_continuous_law_with_a_fixed_step_is_handed_over(declares: bool, period: float, step: float) -> None:
    """Linear, so exact between its calls as well, from the motion at its own last call."""
    able = Capabilities("2.0", state=True, fixed_step=period, variable_step=False, continuous=True)
    brace = device(300.0, 0.1, capabilities=able) if declares else sampled(300.0, 0.1, period, continuous=True)
    result = run(brace, step)
    assert result.scheme == "impedance"
    assert result["plant.subtalar_angle"] == pytest.approx(exact(result.time, 300.0, 0.1 + FOOT_DAMPING), abs=1e-9)
    assert result.coupling_error == pytest.approx(0.0, abs=1e-8)
    assert result.held == {}


@pytest.mark.parametrize("declares", [True, False])
def test_a_curved_continuous_law_is_coupled_as_a_free_device_at_that_step(declares: bool) -> None:
    """Its error and the stated one, whatever the communication step; declared, it is of second order in its period."""
    k, c, cubic, stop = 50.0, 0.1, 8e3, 0.05
    errors, periods = [], (2e-3, 1e-3, 5e-4)
    for period in periods:
        able = Capabilities("2.0", state=True, fixed_step=period, variable_step=False, continuous=True)
        brace = device(k, c, cubic, capabilities=able)
        if not declares:
            brace = sampled(k, c, period, cubic, continuous=True)
        free = device(k, c, cubic) if declares else silent(device(k, c, cubic))
        own, other = run(brace, 2.5e-4, stop=stop), run(free, period, stop=stop)
        motion = solve_ivp(
            lambda t, y: [y[1], (-k * y[0] - cubic * y[0] ** 3 - (c + FOOT_DAMPING) * y[1]) / INERTIA],
            (0, stop),
            START,
            t_eval=own.time,
            rtol=1e-10,
            atol=1e-12,
        )
        missed = own["plant.subtalar_angle"] - motion.y[0]
        points = other["plant.subtalar_angle"] - motion.y[0][:: len(own.time) // (len(other.time) - 1)]
        errors.append(float(np.sqrt(np.mean(missed**2))))
        assert errors[-1] == pytest.approx(float(np.sqrt(np.mean(points**2))), rel=0.03)
        assert own.coupling_error == pytest.approx(other.coupling_error, rel=0.1)
    if declares:
        assert math.log2(errors[0] / errors[2]) / 2 == pytest.approx(2.0, abs=0.15)


def test_a_divided_step_leaves_a_sampled_device_at_its_rate() -> None:
    """Adaptive parts lie between its calls; the record is the same to rounding."""
    brace = sampled(60.0, 0.05, 3e-3, journal=[])
    result = run(brace, 1e-3, "gauss-seidel", adaptive=1e-3, guard=False)
    assert result["plant.subtalar_angle"] == pytest.approx(truth(result.time, 60.0, 0.05, 3e-3), abs=1e-12)
    assert sum(line.startswith("do_step") for line in brace.journal) == 33


def test_two_devices_each_at_its_own_rate() -> None:
    """A sampled torque about one axis, a free one about another: the free one is handed over as ever."""
    k, c, period = 60.0, 0.05, 4e-3
    slow = sampled(k, c, period)
    axes = ("subtalar", "talocrural")
    plants = [foot(FOOT_DAMPING) for _ in axes]

    def renamed(part: FakeComponent, axis: str) -> dict:
        return {
            name: connector(name, v.causality, v.unit.name, depends_on=v.depends_on)
            for n, v in part.connectors.items()
            if (name := n.replace("subtalar", axis))
        }

    connectors = {n: v for part, axis in zip(plants, axes, strict=True) for n, v in renamed(part, axis).items()}

    def law(state, inputs, time, step):
        halves = []
        for j, axis in enumerate(axes):
            own = {n.replace(axis, "subtalar"): v for n, v in inputs.items() if f"{axis}_" in n}
            halves.append(plants[j].advance(state[2 * j : 2 * j + 2], own, time, step))
        return np.concatenate(halves)

    both = FakeComponent(
        "plant", connectors, advance=law, output=lambda s, i: s, initial=np.concatenate([START, START])
    )
    quick = device(300.0, 0.1)
    fast = FakeComponent(
        "second",
        renamed(quick, "talocrural"),
        output=lambda s, i: quick.output(s, {n.replace("talocrural", "subtalar"): v for n, v in i.items()}),
    )
    parts = (both, slow, fast)
    result = Master(stop=0.1).run(System(parts, connect(parts, {})[0]).open(), {})
    assert (result.status, result.scheme) == ("completed", "impedance")
    assert result["plant.subtalar_angle"] == pytest.approx(truth(result.time, k, c, period), abs=1e-12)
    assert result["plant.talocrural_angle"] == pytest.approx(exact(result.time, 300.0, 0.1 + FOOT_DAMPING), abs=1e-11)


def test_what_a_sampled_device_does_by_its_own_hold_is_said_and_not_refused() -> None:
    """k = 100 N.m/rad held for 10 ms grows, in truth as in the run; no step or scheme is advised."""
    brace = sampled(100.0, 0.0, 1e-2)
    result = run(brace, plant=light_foot(), stop=0.15)
    assert np.abs(result["plant.subtalar_angle"]).max() > 10 * START[0]
    assert "the device holds its torque for 10 ms (stiffness 100 N.m/rad" in result.warning
    assert "by itself, whatever the coupling" in result.warning
    assert "use --" not in result.warning
    calm = run(sampled(100.0, 0.0, 5e-4), plant=light_foot(), stop=0.15)
    assert calm.warning == ""


def test_an_iteration_asks_no_saved_state_of_a_sampled_device() -> None:
    unable = sampled(60.0, 0.05, 5e-3)
    able = Capabilities("2.0", fixed_step=5e-3, variable_step=False)
    unable = replace(unable, capabilities=able)
    result = run(unable, scheme="iterative")
    assert result["plant.subtalar_angle"] == pytest.approx(truth(result.time, 60.0, 0.05, 5e-3), abs=1e-12)


def test_a_device_between_two_steps_of_a_plant_that_cannot_stop_there() -> None:
    fixed = foot(FOOT_DAMPING)
    plant = FakeComponent(
        "plant", fixed.connectors, Capabilities("2.0", fixed_step=1e-3), fixed.output, fixed.advance, fixed.initial
    )
    with pytest.raises(InputError, match=r"brace every 2.5 ms is due between them"):
        run(sampled(60.0, 0.0, 2.5e-3), 1e-3, plant=plant)
