"""One brace as FMI 1.0, 2.0 and 3.0, co-simulation and model exchange: the same landing."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from sprain_cosim import load_scenario
from sprain_cosim.fmu.component import Component
from sprain_cosim.fmu.driver import Driver
from tests.native import device

KINDS = [(1, False), (1, True), (2, False), (3, False), (2, True), (3, True)]


def angles(fmu: Path) -> np.ndarray:
    scenario = load_scenario("incline30").replace_fmu("brace", fmu).with_master("gauss-seidel")
    with scenario.open() as session:
        first, second = session.run(), session.run()
    assert first.status == "completed", first.message
    assert first.signals.equals(second.signals), "a run leaves something behind"
    return np.asarray(first.signals["plant.subtalar_angle"])


@pytest.fixture(scope="module")
def baseline(tmp_path_factory: pytest.TempPathFactory) -> np.ndarray:
    return angles(device(tmp_path_factory.mktemp("device") / "device.fmu"))


@pytest.mark.parametrize(("fmi", "model_exchange"), KINDS)
def test_versions_agree(fmi: int, model_exchange: bool, baseline: np.ndarray, tmp_path: Path) -> None:
    """Co-simulation to rounding; CVode integrates the state to its tolerance."""
    found = angles(device(tmp_path / "device.fmu", fmi, model_exchange))
    assert np.abs(found - baseline).max() < (1e-6 if model_exchange else 1e-12)


@pytest.mark.parametrize(("fmi", "model_exchange"), KINDS)
def test_description(fmi: int, model_exchange: bool, tmp_path: Path) -> None:
    component = Component.read("brace", device(tmp_path / "device.fmu", fmi, model_exchange, angle="deg"))
    assert (component.capabilities.fmi_version, component.capabilities.model_exchange) == (f"{fmi}.0", model_exchange)
    assert list(component.inputs) == ["subtalar_angle"]
    assert list(component.outputs) == ["subtalar_torque"]
    assert component.parameters["stiffness"].start == 20.0
    unit = component.inputs["subtalar_angle"].unit
    assert unit is not None
    assert unit.factor == pytest.approx(math.pi / 180)


@pytest.mark.parametrize("torque", ["N.m", "N.mm", "lbf.in"])
@pytest.mark.parametrize("angle", ["rad", "deg"])
@pytest.mark.parametrize("fmi", [2, 3])
def test_units_are_converted(fmi: int, angle: str, torque: str, baseline: np.ndarray, tmp_path: Path) -> None:
    found = angles(device(tmp_path / "device.fmu", fmi, angle=angle, torque=torque))
    assert np.abs(found - baseline).max() < 1e-9


@pytest.mark.parametrize(("fmi", "model_exchange"), [k for k in KINDS if k[0] > 1])
def test_state(fmi: int, model_exchange: bool, tmp_path: Path) -> None:
    """Save, two steps, restore, the same two steps: the same torque."""
    component = Component.read("brace", device(tmp_path / "device.fmu", fmi, model_exchange))
    with Driver(component, ["subtalar_angle"], ["subtalar_torque"]) as driver:
        driver.start(stop=1.0)

        def walk() -> list[float]:
            torques = []
            for k in range(2, 6):
                driver.step(1e-3, {"subtalar_angle": 0.1 * k}, 1e-3 * k)
                torques.append(driver["subtalar_torque"])
            return torques

        driver.step(1e-3)
        driver.step(1e-3)
        state = driver.save_state()
        first = walk()
        driver.restore_state(state)
        driver.free_state(state)
        assert walk() == pytest.approx(first, rel=1e-7 if model_exchange else 1e-15)
