"""`check`: every wrong sign is caught, no false alarm on devices that are right, broken ones end in one line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from sprain_cosim import InputError, check_brace
from sprain_cosim.brace import check as module
from sprain_cosim.cli import cli
from sprain_cosim.scenario import shipped_fmus
from tests.native import FAULTS, SUBTALAR, compile_fmu, device

OWN = [n for n in shipped_fmus() if n.startswith("brace_")]
HARMLESS = ("none", "leak", "flood", "change_folder", "change_locale", "fork", "huge")


@pytest.mark.parametrize(("fmi", "model_exchange"), [(1, False), (2, False), (3, False), (2, True), (3, True)])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_sign(fmi: int, model_exchange: bool, sign: float, tmp_path: Path) -> None:
    report = check_brace(device(tmp_path / "device.fmu", fmi, model_exchange, sign=sign))
    assert report.fits == (sign > 0), report.text()
    assert report.profile == "subtalar"
    if sign > 0:
        assert not report.warnings
        assert "pushes it back with 4.03 N.m" in report.text()  # 20 x (1 + 4 x^2) + 5 (x - z) at 10 deg held for 20 ms
    else:
        assert len(report.problems) == 1
        assert "sign" in report.problems[0]
        assert "factor = -1" in report.problems[0]


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("angle", "torque"), [("deg", "N.mm"), ("rad", "lbf.in")])
def test_wrong_sign_in_a_mapping(sign: float, angle: str, torque: str, tmp_path: Path) -> None:
    fmu = device(tmp_path / "device.fmu", 3, sign=-1.0, angle=angle, torque=torque, names=("In1_InvAngle", "M_out"))
    (tmp_path / "map.toml").write_text(f'[inputs]\nsubtalar_angle = "In1_InvAngle"\n[outputs]\nsubtalar_torque = {{ from = "M_out", factor = {sign} }}')
    report = check_brace(fmu, tmp_path / "map.toml")
    assert report.fits == (sign < 0), report.text()
    assert sign < 0 or "change that of factor in outputs.subtalar_torque" in report.problems[0]


def test_active_devices_may_push(tmp_path: Path) -> None:
    (tmp_path / "map.toml").write_text("active = true")
    report = check_brace(device(tmp_path / "device.fmu", sign=-1.0), tmp_path / "map.toml")
    assert report.fits
    assert "sign" in report.warnings[0]


@pytest.mark.parametrize("name", OWN)
def test_own_braces_fit(name: str) -> None:
    report = check_brace(Path(module.__file__).parent.parent / "_fmus" / f"{name}.fmu")
    assert report.fits, report.text()
    assert not report.warnings, report.text()


@pytest.mark.parametrize("fault", [f for f in FAULTS if f not in ("hang_step", "hang_start", "hang_reset")])
def test_faults(fault: str, tmp_path: Path) -> None:
    report = check_brace(compile_fmu(tmp_path / "device.fmu", fault=fault))
    assert report.fits == (fault in HARMLESS), report.text()
    assert all("\n" not in line for line in (*report.problems, *report.warnings))


@pytest.mark.parametrize("fault", ["hang_step", "hang_start", "hang_reset"])
def test_hangs(fault: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "PROBE_LIMIT", 1.0)
    report = check_brace(compile_fmu(tmp_path / "device.fmu", fault=fault))
    assert report.fits == (fault == "hang_reset")
    assert "overran its limit" in report.text()


def test_no_brace(tmp_path: Path) -> None:
    """A model without angles and torques is told so."""
    variables = SUBTALAR.replace("subtalar_angle", "u").replace("subtalar_torque", "h").replace('unit="N.m"', 'unit="rad"')
    report = check_brace(compile_fmu(tmp_path / "ball.fmu", variables=variables))
    assert not report.fits
    assert "no brace" in report.problems[0]


def test_proposal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Names differ: a mapping is written, with what is uncertain marked, and completes the check."""
    monkeypatch.chdir(tmp_path)
    device(Path("vendor.fmu"), names=("In1_InvAngle", "M_out"))
    told = CliRunner().invoke(cli, ["check", "vendor.fmu"], standalone_mode=False)
    assert told.return_value == 1
    text = Path("vendor.map.toml").read_text()
    assert 'subtalar_angle = { to = "In1_InvAngle" }\n' in text
    assert 'subtalar_torque = { from = "M_out" }   # review' in text
    told = CliRunner().invoke(cli, ["check", "vendor.fmu", "--map", "vendor.map.toml", "--json"], standalone_mode=False)
    assert told.return_value == 0
    content = json.loads(told.output)
    assert content["verdict"].startswith("fits")
    assert content["facts"]["subtalar"]["torque_Nm"]["10deg"] == pytest.approx(-4.03, abs=0.01)


def test_missing_functions(tmp_path: Path) -> None:
    import zipfile

    fmu = device(tmp_path / "device.fmu")
    with zipfile.ZipFile(fmu) as archive:
        files = {n: archive.read(n) for n in archive.namelist()}
    with zipfile.ZipFile(tmp_path / "cut.fmu", "w") as archive:
        for name, data in files.items():
            archive.writestr(name, data.replace(b"fmi2DoStep", b"fmi2NoStep"))
    with pytest.raises(InputError, match="lacks the FMI functions fmi2DoStep"):
        check_brace(tmp_path / "cut.fmu")


def test_cannot_be_instantiated(tmp_path: Path) -> None:
    import zipfile

    fmu = device(tmp_path / "device.fmu")
    with zipfile.ZipFile(fmu) as archive:
        files = {n: archive.read(n) for n in archive.namelist()}
    with zipfile.ZipFile(tmp_path / "cut.fmu", "w") as archive:
        for name, data in files.items():
            archive.writestr(name, data.replace(b"\0exp\0", b"\0exq\0"))
    with pytest.raises(InputError, match=r"cannot be instantiated: .*exq"):
        check_brace(tmp_path / "cut.fmu")
