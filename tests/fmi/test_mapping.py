"""Mapping files: name, sign, unit, offset; what cannot be honoured is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sprain_cosim import load_scenario
from sprain_cosim.errors import InputError
from sprain_cosim.mapping import INSIDE, parse, read_component
from tests.fmi.test_versions import angles, baseline  # noqa: F401
from tests.native import device

NAMES = ("In1_InvAngle", "M_out")


def text(sign: float, angle: str = "", torque: str = "") -> str:
    units = [f', unit = "{u}"' if u else "" for u in (angle, torque)]
    return f"""
        [inputs]
        subtalar_angle = {{ to = "In1_InvAngle"{units[0]} }}
        [outputs]
        subtalar_torque = {{ from = "M_out", factor = {sign}{units[1]} }}
    """


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("angle", ["rad", "deg"])
@pytest.mark.parametrize("torque", ["N.m", "N.mm", "lbf.in"])
@pytest.mark.parametrize("declared", [True, False])
def test_same_trajectory(fmi: int, sign: float, angle: str, torque: str, declared: bool, baseline: np.ndarray, tmp_path: Path) -> None:  # noqa: F811
    """Other names, both signs, any units, declared in the FMU or in the mapping: the landing of the SI brace."""
    fmu = device(tmp_path / "vendor.fmu", fmi, sign=sign, angle=angle, torque=torque, names=NAMES, declared=declared)
    (tmp_path / "vendor.map.toml").write_text(text(sign) if declared else text(sign, angle, torque))
    scenario = load_scenario("incline30").replace_fmu("brace", fmu, tmp_path / "vendor.map.toml").with_master("gauss-seidel")
    result = scenario.run()
    assert result.status == "completed", result.message
    assert np.abs(np.asarray(result.signals["plant.subtalar_angle"]) - baseline).max() < 1e-9


def test_carried_inside(baseline: np.ndarray, tmp_path: Path) -> None:  # noqa: F811
    found = angles(device(tmp_path / "vendor.fmu", sign=-1.0, names=NAMES, extra={INSIDE: text(-1.0)}))
    assert np.abs(found - baseline).max() < 1e-9


def test_in_a_scenario_file(baseline: np.ndarray, tmp_path: Path) -> None:  # noqa: F811
    device(tmp_path / "vendor.fmu", sign=-1.0, names=NAMES)
    (tmp_path / "vendor.map.toml").write_text(text(-1.0))
    (tmp_path / "mine.toml").write_text(
        'base = "incline30"\n[components.brace]\nfmu = "vendor.fmu"\nmap = "vendor.map.toml"\n[master]\nscheme = "gauss-seidel"\n'
    )
    result = load_scenario(tmp_path / "mine.toml").run()
    assert np.abs(np.asarray(result.signals["plant.subtalar_angle"]) - baseline).max() < 1e-9


def test_offset(tmp_path: Path) -> None:
    """Factor and offset act in the FMU's unit: subtalar 0.1 rad arrives as -5.7296 + 3 deg; 20 N.mm leave as 20 * 0.5 + 4 = 14 N.mm."""
    mapping = parse(
        '[inputs]\nsubtalar_angle = { to = "subtalar_angle", factor = -1, offset = 3 }\n'
        '[outputs]\nsubtalar_torque = { from = "subtalar_torque", factor = 0.5, offset = 4 }',
        "here",
    )
    component = mapping.apply(read_component("brace", device(tmp_path / "d.fmu", angle="deg", torque="N.mm")))
    into, out = component.inputs["subtalar_angle"].unit, component.outputs["subtalar_torque"].unit
    assert into is not None
    assert out is not None
    assert into.from_base(0.1) == pytest.approx(-np.rad2deg(0.1) + 3)
    assert out.to_base(20.0) == pytest.approx(0.014)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ('[inputs]\nsubtalar_angel = { to = "In1_InvAngle" }', r"subtalar_angel: is no signal.*subtalar_angle"),
        ('[inputs]\nsubtalar_angle = { to = "In_InvAngle" }', r"no such variable \(did you mean In1_InvAngle"),
        ('[inputs]\nsubtalar_angle = { to = "M_out" }', r"causality output; only an input"),
        ('[inputs]\nsubtalar_angle = { to = "stiffness" }', r"causality parameter"),
        ('[inputs]\nsubtalar_angle = { to = "In1_InvAngle", unit = "N.m" }', r"dimension"),
        ('[inputs]\nsubtalar_angle = { to = "In1_InvAngle", gain = 2 }', r"unknown key 'gain'"),
        ('[inputs]\nsubtalar_angle = { to = "In1_InvAngle", factor = 0 }', r"factor must not be 0"),
        ('[inputs]\nsubtalar_angle = { to = "In1_InvAngle" }\ninversion_angle = { to = "In1_InvAngle" }', r"mapped to subtalar_angle already"),
        ("inputs = 3", r"must be a table"),
        ("[inputs", r"not valid TOML"),
    ],
)
def test_refused(content: str, message: str, tmp_path: Path) -> None:
    fmu = device(tmp_path / "vendor.fmu", names=NAMES)
    (tmp_path / "bad.toml").write_text(content)
    with pytest.raises(InputError, match=message) as caught:
        load_scenario("incline30").replace_fmu("brace", fmu, tmp_path / "bad.toml")
    assert "\n" not in str(caught.value)
