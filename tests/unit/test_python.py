"""A law in Python takes part like an FMU: the same calls, the same failures, the same numbers."""

from __future__ import annotations

import math
import pickle
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sprain_cosim as sc
from sprain_cosim.cosim.system import connect
from sprain_cosim.fmu.driver import Driver
from sprain_cosim.fmu.python import PythonComponent
from tests.native import device


def decay(state: float, values: Mapping[str, float], time: float, step: float) -> float:
    """dx/dt = rate (u - x), exactly for a held u."""
    return float(values["u"] + (state - values["u"]) * np.exp(-values["rate"] * step))


def level(state: float, values: Mapping[str, float]) -> dict[str, float]:
    return {"x": state, "gap": values["u"] - state}


def from_level(values: Mapping[str, float]) -> float:
    return values["level"]


LAG = PythonComponent.define(
    "lag",
    inputs={"u": "1"},
    outputs={"x": "1", "gap": "1"},
    parameters={"rate": (2.0, "1"), "level": (1.0, "m")},
    output=level,
    advance=decay,
    initial=from_level,
    direct={"gap": ["u"]},
)


def component(**laws: Any) -> PythonComponent:
    return PythonComponent.define("brace", inputs={"u": "rad"}, outputs={"y": "N.m"}, **laws)


def test_the_definition_becomes_connectors() -> None:
    assert (list(LAG.inputs), list(LAG.outputs), list(LAG.parameters)) == (["u"], ["x", "gap"], ["rate", "level"])
    assert LAG.parameters["level"].start == 1.0
    assert LAG.parameters["level"].unit.name == "m"  # type: ignore[union-attr]
    assert [LAG.outputs[n].depends_on for n in ("x", "gap")] == [(), ("u",)]
    assert component(output=level).outputs["y"].depends_on is None
    assert pickle.loads(pickle.dumps(LAG)) == LAG


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"inputs": {"u": "furlong"}}, "furlong"),
        ({"outputs": {"u": "N.m"}}, "brace: two variables named 'u'"),
        ({"direct": {"z": ["u"]}}, r"brace: direct names 'z', which is no output \(known: y\)"),
        ({"direct": {"y": ["v"]}}, r"brace: direct names 'v', which is no input \(known: u\)"),
    ],
)
def test_a_wrong_definition_is_refused(changed: dict[str, Any], message: str) -> None:
    with pytest.raises(sc.InputError, match=message):
        PythonComponent.define(
            "brace", **({"inputs": {"u": "rad"}, "outputs": {"y": "N.m"}, "output": level} | changed)
        )


def test_state_parameters_and_start() -> None:
    """Against the closed form; a second run begins anew, a saved state goes on where it was."""
    with Driver(LAG) as driver:
        for rate, start in ((3.0, 0.5), (2.0, 1.0)):
            driver.start({"rate": rate, "level": start} if rate == 3.0 else {}, {"u": 2.0})
            assert (driver["x"], driver["gap"]) == (start, 2.0 - start)
            for _ in range(10):
                driver.step(0.01)
            assert driver["x"] == pytest.approx(2.0 + (start - 2.0) * np.exp(-rate * 0.1), rel=1e-12)
        state = driver.save_state()
        ahead = [driver.step(0.01) or driver["x"] for _ in range(5)]
        driver.restore_state(state)
        assert [driver.step(0.01) or driver["x"] for _ in range(5)] == ahead
        driver.set_inputs({"u": 7.0})
        assert driver.get_outputs() == {"x": ahead[-1], "gap": 7.0 - ahead[-1]}


def test_values_and_times_with_units() -> None:
    """A text has its unit, a number is in the variable's own; in a run of a system as well."""
    spring = PythonComponent.define(
        "brace",
        inputs={"u": "rad"},
        outputs={"y": "N.m"},
        parameters={"stiffness": "4 N.m/deg", "bare": "3"},
        output=lambda state, values: {"y": -values["stiffness"] * values["u"]},
    )
    assert (spring.parameters["stiffness"].start, spring.parameters["bare"].start) == (4.0, 3.0)
    with Driver(spring) as driver:
        for stiffness, angle, step in ((2.0, np.float32(0.5), 1e-3), ("2 N.m/deg", "0.5 rad", "1 ms")):
            driver.start({"stiffness": stiffness}, time="2 s", stop=3)
            driver.step(step, {"u": angle})
            assert (driver.time, driver["y"]) == (2.001, -1.0)
        driver.start({"stiffness": "2 N.m/rad"}, {"u": "180 deg"})
        assert driver["y"] == pytest.approx(-2.0 * np.pi * np.pi / 180.0)
        for call, words in (
            (lambda: driver.start({"stiffness": "2 kg"}), "brace.stiffness = '2 kg': kg has the dimension"),
            (lambda: driver.step("1 kg"), "step = '1 kg': kg has the dimension"),
            (lambda: driver.step("1"), 'needs a unit, for example "1 ms"'),
            (lambda: driver.step(1e-3, {"u": "1 m"}), "brace.u = '1 m': m has the dimension"),
            (lambda: driver.step(1e-3, {"u": None}), "brace.u = None: expected a number in rad"),  # type: ignore[dict-item]
        ):
            with pytest.raises(sc.InputError, match=words):
                call()
    with pytest.raises(sc.InputError, match="'stiff': expected a number with its unit"):
        PythonComponent.define("brace", inputs={}, outputs={"y": "1"}, parameters={"k": "stiff"}, output=level)


@pytest.mark.parametrize(
    ("name", "words"),
    [("lga.rate", "no component 'lga'"), ("lag.rat", "did you mean rate"), ("lag.x", "is an output, not a parameter")],
)
def test_a_run_refuses_what_cannot_be_set(name: str, words: str) -> None:
    assembly = sc.System((LAG,), {}).open()
    master = sc.Master(stop="2 ms")  # type: ignore[arg-type]
    assert master.run(assembly, {"lag.level": "20 cm"})["lag.x"][0] == 0.2
    with pytest.raises(sc.InputError, match=words):
        master.run(assembly, {name: 1.0})
    assembly.close()


@pytest.mark.parametrize(
    ("laws", "message"),
    [
        ({"output": lambda state, values: {}}, "brace: output gives no y"),
        ({"output": lambda state, values: [1.0, 2.0]}, "brace: output gives 2 values for 1 outputs"),
        ({"output": lambda state, values: {"y": 1.0 / values["u"]}}, "brace: output failed: ZeroDivisionError"),
        ({"output": lambda state, values: {"y": values["w"]}}, "brace: output failed: KeyError: 'w'"),
        (
            {"output": lambda state, values: [0.0], "advance": lambda s, v, t, h: s + h},
            "brace: advance failed: Type",
        ),
        ({"output": lambda state, values: [0.0], "initial": lambda v: v["w"]}, "brace: initial failed: KeyError: 'w'"),
    ],
)
def test_a_law_that_fails_is_named(laws: dict[str, Any], message: str) -> None:
    with Driver(component(**laws)) as driver, pytest.raises(sc.SimulationError, match=message):
        [driver.start(), driver.step(0.01)]


def test_a_law_cannot_change_its_inputs() -> None:
    def output(state: None, values: Any) -> list[float]:
        values["u"] = 1.0
        return [0.0]

    with (
        Driver(component(output=output)) as driver,
        pytest.raises(sc.SimulationError, match="output failed: TypeError"),
    ):
        driver.start()


def test_a_landing_with_it_is_that_with_the_fmu(tmp_path: Path) -> None:
    """The law of tests/sources/device.c, with its state, coupled to the plant as the FMU is."""

    def torque(state: float, values: Mapping[str, float]) -> list[float]:
        x = values["subtalar_angle"]
        return [-20.0 * x * (1 + 4 * x * x) - 5.0 * (x - state)]

    def relaxed(state: float, values: Mapping[str, float], time: float, step: float) -> float:
        return values["subtalar_angle"] + (state - values["subtalar_angle"]) * math.exp(-step / 0.01)

    fmu = sc.load_scenario("incline30").replace_fmu("brace", device(tmp_path / "device.fmu")).run()
    brace = PythonComponent.define(
        "brace",
        inputs={"subtalar_angle": "rad"},
        outputs={"subtalar_torque": "N.m"},
        output=torque,
        advance=relaxed,
        initial=0.0,
    )
    parts = (*sc.load_scenario("incline30").components(), brace)
    assembly = sc.System(parts, connect(parts, {})[0]).open()
    law = sc.Master().run(assembly, {})
    assembly.close()
    assert (law.status, law.scheme) == (fmu.status, fmu.scheme) == ("completed", "impedance")
    assert law["plant.subtalar_angle"] == pytest.approx(fmu["plant.subtalar_angle"], abs=1e-9)
