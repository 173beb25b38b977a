"""The project's own devices against their equations, and braces from tables."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.interpolate import PchipInterpolator

import sprain_cosim as sc
from sprain_cosim import InputError, check_brace, load_scenario
from sprain_cosim.brace.from_csv import brace_from_csv, from_csv
from sprain_cosim.brace.probe import Rig, landing
from sprain_cosim.cli import cli
from sprain_cosim.fmu.component import Component
from sprain_cosim.shipped import fmu_path, shipped_fmus

DEVICES = [n for n in shipped_fmus() if n.startswith("brace_")]


def bench(name: str | Path, *axes: str, **parameters: float) -> Rig:
    path = fmu_path(name, Path.cwd(), name) if isinstance(name, str) else name
    made = Rig(Component.read("brace", path), axes, parameters)
    made.begin()
    return made


@pytest.mark.parametrize("name", DEVICES)
def test_declared_stiffness_and_damping(name: str) -> None:
    """Along a landing, the declared values are the difference quotients of the torque by its direct inputs."""
    component = Component.read("brace", fmu_path(name, Path.cwd(), name))
    axes = tuple(n.removesuffix("_torque") for n in component.outputs if n.endswith("_torque"))
    device = bench(name, *axes)
    angles, velocities = landing(axes, 0.5e-3)
    seen = 0
    for k, (a, v) in enumerate(zip(angles, velocities, strict=True)):
        device.step(a, v, 0.5e-3)
        if k % 40 != 20:
            continue
        said = device.outputs()
        for i, axis in enumerate(axes):
            for kind, base, other in (("stiffness", a, v), ("damping", v, a)):
                if f"{axis}_{kind}" not in said:
                    continue
                torques = []
                for e in (1e-6, 0.0, -1e-6):
                    moved = base.copy()
                    moved[i] += e
                    torques.append(device.place(*((moved, other) if kind == "stiffness" else (other, moved)))[i])
                device.place(a, v)
                sides = [
                    -(torques[0] - torques[1]) / 1e-6,
                    -(torques[1] - torques[2]) / 1e-6,
                ]  # they differ where a hysteresis turns
                assert any(said[f"{axis}_{kind}"] == pytest.approx(side, rel=2e-4, abs=1e-5) for side in sides), (
                    k,
                    axis,
                    kind,
                )
                seen += 1
    assert seen
    device.close()


def test_linear() -> None:
    device = bench(
        "brace_linear",
        "subtalar",
        subtalar_slack=0.1,
        subtalar_rest_angle=0.05,
        subtalar_stiffness_coefficient=40.0,
        subtalar_damping_coefficient=0.5,
    )
    for angle, velocity, expected in (
        (0.1, 3.0, 0.0),
        (0.25, 0.0, -4.0),
        (0.25, 2.0, -5.0),
        (0.25, -20.0, 0.0),
        (-0.15, -1.0, 4.5),
    ):
        assert device.step(np.array([angle]), np.array([velocity]), 1e-3)[0] == pytest.approx(expected, abs=1e-12)
    device.close()


def test_semi_rigid() -> None:
    """Liner between the stops, shell beyond; torque is minus the slope of the stored energy."""
    device = bench("brace_semi_rigid", "subtalar")
    assert device.step(np.array([0.1]), np.zeros(1), 1e-3)[0] == pytest.approx(-0.8, abs=1e-12)
    assert device.step(np.array([0.4]), np.zeros(1), 1e-3)[0] == pytest.approx(
        -(3.2 + 300 * (0.4 - math.radians(15))), abs=1e-9
    )
    reference = device.component.connectors["stored_energy"].reference
    for angle in (-0.4, -0.27, 0.05, 0.25, 0.28, 0.5):
        energies = []
        for e in (1e-6, -1e-6):
            device.step(np.array([angle + e]), np.zeros(1), 1e-3)
            energies.append(device.driver.instance.fmu.getReal([reference])[0])  # type: ignore[attr-defined]
        torque = device.step(np.array([angle]), np.zeros(1), 1e-3)[0]
        assert torque == pytest.approx(-(energies[0] - energies[1]) / 2e-6, rel=1e-5)
    device.close()


def test_rate_dependent() -> None:
    """Held at a velocity, the stiffness goes to its value there with the lag; slow and fast limits."""
    device = bench("brace_rate_dependent", "subtalar", damping_coefficient=0.0)
    fast = 2 * math.radians(300)
    for k in range(1, 7):
        torque = device.step(np.array([0.1]), np.array([fast]), 1e-3)[0]
        a = 16 / 17 * (1 - math.exp(-k / 3))
        assert torque == pytest.approx(-(10 + 110 * a) * 0.1, rel=1e-9)
    for _ in range(100):
        torque = device.step(np.array([0.1]), np.zeros(1), 1e-3)[0]
    assert torque == pytest.approx(-1.0, rel=1e-9)
    device.close()


def test_active() -> None:
    """No trigger when slow; after it, the actuator approaches its limit with its lag; below the threshold it lets
    go."""
    device = bench("brace_active", "subtalar", passive_stiffness=0.0)
    assert device.step(np.array([0.5]), np.array([1.0]), 1e-3)[0] == 0.0
    for k in range(1, 9):
        torque = device.step(np.array([0.5]), np.array([10.0]), 1e-3)[0]
        assert torque == pytest.approx(-25 * (1 - math.exp(-k / 8)), rel=1e-12)
    held = torque
    assert device.step(np.array([0.1]), np.array([10.0]), 1e-3)[0] == pytest.approx(held * math.exp(-1 / 8), rel=1e-12)
    device.close()


TABLE = """angle [deg],subtalar_resistance_loading [lbf.in],subtalar_resistance_unloading [lbf.in]
-30,-60,-40
-10,-15,-10
0,0,0
10,12,8
20,30,24
40,120,90
"""


def test_from_csv(tmp_path: Path) -> None:
    """Loading on the way out, unloading on the way back, in another unit; straight on outside; fits, runs, and is its
    own FMU."""
    (tmp_path / "cuff.csv").write_text(TABLE)
    told = CliRunner().invoke(cli, ["brace", "from-csv", str(tmp_path / "cuff.csv")], standalone_mode=False)
    assert told.exception is None, told.exception
    assert "-30 ... 40 deg" in told.output
    fmu = tmp_path / "cuff.fmu"
    report = check_brace(fmu)
    assert report.fits, report.text()
    assert report.warnings == ["subtalar_angle: is declared for -30 ... 40 deg; a landing may go to -40 ... 45 deg"]
    x, loading, unloading = np.array(
        [[-30, -10, 0, 10, 20, 40], [-60, -15, 0, 12, 30, 120], [-40, -10, 0, 8, 24, 90]], float
    )
    factor = 0.45359237 * 9.80665 * 0.0254
    device = bench(fmu, "subtalar")
    for turned, values in ((1, loading), (-1, unloading)):
        curve = PchipInterpolator(x, -factor * values)
        for angle in sorted((4.0, 15.0, 33.0), reverse=turned < 0):
            assert device.step(np.deg2rad([angle]), np.zeros(1), 1e-3)[0] == pytest.approx(
                float(curve(angle)), rel=1e-9
            )
        if turned > 0:
            at = device.step(np.deg2rad([50.0]), np.zeros(1), 1e-3)[0]
            assert at == pytest.approx(float(curve(40) + 10 * curve.derivative()(40)), rel=1e-9)
    device.close()
    result = load_scenario("incline30").replace_fmu("brace", fmu).run()
    assert result.status == "completed"
    assert Component.read("b", fmu).guid != Component.read("b", fmu_path("brace_table", Path.cwd(), "")).guid


def test_a_landing_beyond_a_table_says_so(tmp_path: Path) -> None:
    """A table of 10 degrees gives its straight continuation at 39 as surely as what was measured."""
    scenario = load_scenario("incline30")
    for reach, told in ((10, True), (60, False)):
        table = tmp_path / f"to{reach}.csv"
        table.write_text(f"angle [deg],subtalar_resistance [N.m]\n-{reach},-{reach}\n0,0\n{reach},{reach}\n")
        brace_from_csv(table)
        braced = scenario.replace_fmu("brace", table.with_suffix(".fmu"))
        result = braced.run()
        assert ("outside what its FMU is declared for" in result.warning) == told
        if told:
            peak = result.metrics["peak_subtalar_angle_deg"]
            assert result.warning.startswith("brace.subtalar_angle goes over ")
            assert f" ... {peak:.4g} deg, outside what its FMU is declared for, -10 ... 10 deg" in result.warning
    campaign = sc.load_study("study2").replace_fmu("brace", tmp_path / "to10.fmu").run(trials=20, out=tmp_path / "s")
    messages = campaign.trials["message"].astype(str)
    outside = campaign.trials["peak_subtalar_angle_deg"] > 10.0
    assert messages.str.contains("brace.subtalar_angle goes over").sum() >= outside.sum() > 10
    assert any("brace.subtalar_angle went outside what its FMU is declared for" in n for n in campaign.summary["notes"])


def test_from_csv_gives_back_what_was_measured(tmp_path: Path) -> None:
    """Two axes in other units, each with its own angles, blank lines between: every measured torque comes out of the
    FMU, in the contract's sign."""
    rows = [
        (-0.5, 9000.0, None),
        (-0.2, 2000.0, 2.5),
        (0.0, 0.0, 0.1),
        (0.15, None, -2.0),
        (0.4, -5000.0, -9.5),
        (0.6, -9000.0, None),
    ]
    text = "\n\n".join(f"{x},{'' if t is None else t},{'' if s is None else s}" for x, t, s in rows)
    (tmp_path / "shell.csv").write_text(f"angle [rad], talocrural_torque [N.mm], subtalar_torque [N.m]\n{text}\n")
    spans = from_csv(tmp_path / "shell.csv", tmp_path / "shell.fmu", fmu_path("brace_table", Path.cwd(), ""))
    assert spans == {"talocrural": (-0.5, 0.6), "subtalar": (-0.2, 0.4)}
    device = bench(tmp_path / "shell.fmu", "talocrural", "subtalar")
    for x, t, s in rows:
        talocrural, subtalar = device.step(np.array([x, x]), np.zeros(2), 1e-3)
        if t is not None:
            assert talocrural == pytest.approx(1e-3 * t, rel=1e-12, abs=1e-12)
        if s is not None:
            assert subtalar == pytest.approx(s, rel=1e-12)
    device.close()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ((",", ";"), "separated by semicolons; save it with commas"),
        (("\n10,12,8", "\n\n\n10,zwölf,8"), r"row 7, column 2 .*'zwölf' is not a number"),
        (("0,0,0", ",0,0"), r"row 4, column 1 \(angle \[deg\]\): '' is not a number"),
        (
            ("10,12,8", "10,zwölf,8"),
            r"row 5, column 2 \(subtalar_resistance_loading \[lbf.in\]\): 'zwölf' is not a number",
        ),
        (("10,12,8", "-12,12,8"), r"row 5, column 1 \(angle\): -12 does not rise \(row 4 has 0\)"),
        (("10,12,8", "10,12"), r"row 5: 2 cells, the header has 3"),
        (("10,12,8", "10,nan,8"), r"row 5, column 2 .*not finite"),
        (("angle [deg]", "angle"), r"column 1 'angle': must read name \[unit\]"),
        (("loading [lbf.in]", "loading [deg]"), r"deg is not a unit of torque"),
        (
            ("subtalar_resistance_unloading", "subtaler_resistance_unloading"),
            r"did you mean subtalar_resistance_unloading",
        ),
        (("subtalar_resistance_unloading", "talocrural_resistance"), r"give one column, or both"),
        (("_resistance_", "_torque_"), r"pushes the foot further.*subtalar_resistance_loading"),
        (("40,120,90", "40,120,290"), r"unloading resists more than loading"),
    ],
)
def test_from_csv_refuses(change: tuple[str, str], message: str, tmp_path: Path) -> None:
    (tmp_path / "cuff.csv").write_text(TABLE.replace(*change))
    with pytest.raises(InputError, match=message) as caught:
        from_csv(tmp_path / "cuff.csv", tmp_path / "cuff.fmu", fmu_path("brace_table", Path.cwd(), ""))
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "cuff.fmu").exists()
