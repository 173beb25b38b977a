"""One component alone, driven by the names of its variables."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

import sprain_cosim as sc
from sprain_cosim.fmu.component import Component
from sprain_cosim.fmu.driver import Driver
from sprain_cosim.fmu.isolated import isolated
from sprain_cosim.shipped import FMUS
from tests.native import device

KINDS = [(1, False), (2, False), (3, False), (2, True), (3, True)]


@pytest.fixture(scope="module")
def linear() -> Component:
    return Component.read("brace", FMUS / "brace_linear.fmu")


@pytest.mark.parametrize(("fmi", "model_exchange"), KINDS)
def test_every_kind_of_fmu(fmi: int, model_exchange: bool, tmp_path: Path) -> None:
    """tests/sources/device.c: a spring that stiffens, and one behind a damper that gives way in 10 ms."""

    def spring(x: float) -> float:
        return -20.0 * x * (1 + 4 * x * x)

    with Driver(Component.read("brace", device(tmp_path / "device.fmu", fmi, model_exchange))) as driver:
        for _ in range(2):
            driver.start(inputs={"subtalar_angle": 0.1})
            assert driver["subtalar_torque"] == pytest.approx(spring(0.1) - 5 * 0.1, rel=1e-12)
            driver.step(1e-3, {"subtalar_angle": 0.2})
            assert driver["subtalar_torque"] == pytest.approx(spring(0.2) - 5 * 0.2 * math.exp(-0.1), rel=1e-6)
            assert driver.time == 1e-3


def test_all_variables_by_name(linear: Component) -> None:
    with Driver(linear) as driver:
        assert set(driver.inputs) == set(linear.inputs)
        assert set(driver.outputs) == set(linear.outputs)
        driver.start({"subtalar_stiffness_coefficient": 50.0, "subtalar_damping_coefficient": 0.0})
        driver.step(1e-3, {"subtalar_angle": 0.1})
        assert driver["subtalar_angle"] == 0.1
        assert driver["subtalar_torque"] == pytest.approx(-5.0)
        driver.step(1e-3)
        assert driver["subtalar_torque"] == pytest.approx(-5.0), "inputs hold"
        driver.set_inputs({"subtalar_angle": 0.2})
        assert driver["subtalar_torque"] == pytest.approx(-5.0), "as it was read last"
        assert driver.get_outputs()["subtalar_torque"] == pytest.approx(-10.0)
        driver.start()
        assert driver["subtalar_angle"] == 0.0, "a new run has start values"


def test_a_choice_of_variables(linear: Component) -> None:
    with Driver(linear, ["subtalar_angle"], ["subtalar_torque"]) as driver:
        driver.start()
        assert driver.get_outputs().keys() == {"subtalar_torque"}
        with pytest.raises(sc.InputError, match=r"brace: no input 'subtalar_velocity' is fed"):
            driver.set_inputs({"subtalar_velocity": 1.0})
        with pytest.raises(sc.InputError, match=r"'stored_energy' is neither fed nor read"):
            driver["stored_energy"]


def test_unknown_names(linear: Component) -> None:
    with pytest.raises(
        sc.InputError, match=r"no input 'subtalar_angel' that is a number \(did you mean subtalar_angle"
    ):
        Driver(linear, ["subtalar_angel"])
    with pytest.raises(sc.InputError, match="no output 'subtalar_angle' that is a number"):
        Driver(linear, None, ["subtalar_angle"])
    with (
        Driver(linear) as driver,
        pytest.raises(
            sc.InputError, match=r"no parameter 'subtalar_stiffness' \(did you mean subtalar_stiffness_coeff"
        ),
    ):
        driver.start({"subtalar_stiffness": 50.0})


def test_a_state_takes_time_and_values_back(tmp_path: Path) -> None:
    """Here and in a process of its own: the same to the bit."""
    walks = []
    component = Component.read("brace", device(tmp_path / "device.fmu"))
    for opened in (component, isolated(component)):
        with Driver(opened) as driver:
            driver.start()
            driver.step(1e-3, {"subtalar_angle": 0.1})
            state = driver.save_state()
            before = driver.time, driver["subtalar_angle"], driver["subtalar_torque"]
            first = [driver.step(1e-3, {"subtalar_angle": x}) or driver["subtalar_torque"] for x in (0.2, 0.3)]
            driver.restore_state(state)
            assert (driver.time, driver["subtalar_angle"], driver["subtalar_torque"]) == before
            second = [driver.step(1e-3, {"subtalar_angle": x}) or driver["subtalar_torque"] for x in (0.2, 0.3)]
            driver.free_state(state)
            assert first == second
            walks.append(first)
    assert walks[0] == walks[1]


def test_an_error_names_component_and_step(tmp_path: Path) -> None:
    refusing = device(tmp_path / "device.fmu", behaviour={"REFUSES": 3e-4}, saves=False)
    with Driver(Component.read("brace", refusing)) as driver:
        driver.start()
        with pytest.raises(sc.SimulationError, match=r"brace: discarded the call in the step from 0 s to 0\.001 s"):
            driver.step(1e-3)
