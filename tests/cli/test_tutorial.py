"""The road of docs/vendor-tutorial.md, section 2, with a device that nobody described: sampled, in degrees, without a
unit, positive when it resists."""

from __future__ import annotations

from pathlib import Path

import pytest

from sprain_cosim.cli import _run
from tests.campaign import Device, fmu, library


def test_three_commands_and_one_edit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    device = Device(("subtalar",), 60.0, 0.2, 0.1, 0.005, "deg", "N.m", "map", "sign")
    fmu(Path("motor.fmu"), device, library(tmp_path))
    assert _run(["check", "motor.fmu"], []) == 1
    said = capsys.readouterr().out
    assert "only as degrees is plausible" in said
    assert "which pushes it further" in said
    proposed = Path("motor.map.toml")
    edited = proposed.read_text().replace('"angle0", unit = "?"', '"angle0", unit = "deg"')
    edited = edited.replace('"velocity0", unit = "?"', '"velocity0", unit = "deg/s"')
    proposed.write_text(edited.replace('"torque0", unit = "?"', '"torque0", unit = "N.m", factor = -1'))
    assert _run(["check", "motor.fmu", "--map", "motor.map.toml"], []) == 0
    said = capsys.readouterr().out
    assert "motor.fmu: fits\n" in said
    assert "sampled every 5 ms" in said
    braces = ["--brace", "motor=motor.fmu", "--map", "motor=motor.map.toml", "--out", "out"]
    assert _run(["compare", "incline30", *braces], []) == 0
    assert Path("out/figures/compare.png").stat().st_size > 20_000
