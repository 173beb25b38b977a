"""Reference experiments that an FMU carries (FMI-LS-REF 1.0.0-beta.1): run and compared, never taken on trust."""

from __future__ import annotations

import json
import math
import zipfile
from dataclasses import replace
from pathlib import Path

import pytest

from sprain_cosim.brace.fit import FitReport
from sprain_cosim.brace.reference import compare_references
from sprain_cosim.cli import _run
from sprain_cosim.fmu.component import Component
from sprain_cosim.fmu.reference import MANIFEST, experiments, read_series
from tests.native import device

FOLDER = MANIFEST.rpartition("/")[0]
STEP, COUNT, SPEED = 1e-3, 20, 10.0  # s, rad/s: a ramp
LISTED = """<?xml version="1.0" encoding="UTF-8"?>
<fmiReferences xmlns:fmi-ls="http://fmi-standard.org/fmi-ls-manifest" fmi-ls:fmi-ls-name="org.fmi-standard.fmi-ls-ref"
  fmi-ls:fmi-ls-version="1.0.0-beta.1" fmi-ls:fmi-ls-description="d">
  <Related type="text/modelica" source="../../documentation/m.mo" role="model"/>
  <Related type="application/x-ma-hs-experiments" source="exp/smoke.exp" role="experiment/smoke-test"/>
</fmiReferences>"""
ONE = """<Experiments name="set"><Experiment name="ramp" stopTime="0.02" stepSize="0.001">
  <Stimuli source="../in.csv"/><References source="../out.csv"/></Experiment></Experiments>"""
RAMP = f"time,subtalar_angle\n0,0\n{STEP * COUNT},{SPEED * STEP * COUNT}\n"


def outcome(stiffness: float = 20.0, at_end: bool = False, factor: float = 1.0, column: str = "subtalar_torque") -> str:
    """The table that the maker of tests/sources/device.c would write: inputs of the step's beginning, or of its end."""
    rows, z = [f"time,{column}", "0,0"], 0.0
    for k in range(1, COUNT + 1):
        x = SPEED * STEP * (k if at_end else k - 1)
        z = x + (z - x) * math.exp(-STEP / 0.01)
        rows.append(f"{k * STEP!r},{factor * (-stiffness * x * (1 + 4 * x * x) - 5.0 * (x - z))!r}")
    return "\n".join(rows) + "\n"


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return device(tmp_path_factory.mktemp("plain") / "plain.fmu")


def carrying(plain: Path, target: Path, **changed: str | None) -> Path:
    """The FMU with an experiment inside; `changed`: other texts by name, None for none."""
    files: dict[str, str | None] = {"manifest": LISTED, "smoke": ONE, "stimuli": RAMP, "out": outcome(), **changed}
    places = {"manifest": MANIFEST, "smoke": f"{FOLDER}/exp/smoke.exp", "stimuli": f"{FOLDER}/in.csv",
              "out": f"{FOLDER}/out.csv", "parameters": f"{FOLDER}/exp/p.ssv"}  # fmt: skip
    target.write_bytes(plain.read_bytes())
    with zipfile.ZipFile(target, "a") as archive:
        for name, text in files.items():
            if text is not None:
                archive.writestr(places[name], text)
    return target


def compared(fmu: Path) -> FitReport:
    report = FitReport(str(fmu))
    compare_references(Component.read("brace", fmu), report)
    return report


SSV = """<ssv:ParameterSet xmlns:ssv="http://ssp-standard.org/SSP1/ParameterValues" version="1.0" name="p">
  <ssv:Parameters>
  <ssv:Parameter name="stiffness"><ssv:Real value="{}"/></ssv:Parameter></ssv:Parameters></ssv:ParameterSet>"""
WITH_SET = ONE.replace("<Stimuli", '<Parameters source="p.ssv"/><Stimuli')


@pytest.mark.parametrize(
    "changed",
    [
        {},
        {"out": outcome(at_end=True)},
        {"out": outcome(factor=1e3, column="subtalar_torque [N.mm]")},
        {"smoke": ONE.replace(' stepSize="0.001"', "")},
        {
            "smoke": ONE.replace(' stopTime="0.02" stepSize="0.001"', "").replace(
                "<Stimuli", '<TransientSimulation startTime="0" stopTime="0.02" stepSize="1e-3"/><Stimuli'
            )
        },
        {"smoke": WITH_SET, "parameters": SSV.format(35.0), "out": outcome(35.0)},
        {"smoke": WITH_SET, "parameters": SSV.format('0.035" unit="kN.m/rad'), "out": outcome(35.0)},
        {"manifest": LISTED.replace("x-ma-hs-", "x-ma-ls-").replace("/smoke-test", "")},
    ],
)
def test_reproduced(changed: dict[str, str], plain: Path, tmp_path: Path) -> None:
    report = compared(carrying(plain, tmp_path / "d.fmu", **changed))
    assert report.fits, report.problems
    assert not report.warnings
    (note,) = report.notes
    assert (
        "reference experiment ramp (FMI-LS-REF 1.0.0-beta.1) is reproduced: 1 output at 21 times, to rounding" in note
    )
    assert report.references[0]["fits"]
    assert report.references[0]["difference"] < 1e-9


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"out": outcome(factor=1e-3)}, "-4.75303 at 0.02 s, -0.00475303 in the table"),
        ({"out": outcome(factor=1.002)}, "0.2 % of its largest value apart, 0.1 % allowed"),
        ({"out": outcome(35.0)}, "at 0.02 s"),
        ({"smoke": WITH_SET, "parameters": SSV.format(35.0)}, "is not reproduced"),
    ],
)
def test_not_reproduced(changed: dict[str, str], words: str, plain: Path, tmp_path: Path) -> None:
    report = compared(carrying(plain, tmp_path / "d.fmu", **changed))
    assert not report.fits
    assert "reference experiment ramp is not reproduced: subtalar_torque is" in report.problems[0]
    assert words in report.problems[0]
    assert not report.references[0]["fits"]


def test_the_files_tolerance_may_be_wider(plain: Path, tmp_path: Path) -> None:
    smoke = ONE.replace('name="ramp"', 'name="ramp" tolerance="0.01"')
    report = compared(carrying(plain, tmp_path / "d.fmu", smoke=smoke, out=outcome(factor=1.002)))
    assert report.fits
    assert "at most 0.2 % of its largest value apart" in report.notes[0]
    assert "1 % allowed" in report.notes[0]


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"manifest": "<fmiReferences"}, "not valid XML"),
        ({"manifest": "<!DOCTYPE x>" + LISTED}, "DOCTYPE"),
        ({"smoke": None}, "exp/smoke.exp is not in the FMU"),
        ({"smoke": ONE.replace("../out.csv", "../../../../../etc/passwd")}, "is not in the FMU"),
        ({"smoke": ONE.replace("../out.csv", "http://x.example/out.csv")}, "no file inside the FMU"),
        ({"smoke": ONE.replace('<References source="../out.csv"/>', "")}, "no reference results"),
        ({"smoke": ONE.replace("out.csv", 'out.csv" type="application/hdf5')}, "application/hdf5; only text/csv"),
        ({"smoke": ONE.replace("<Stimuli", "<SteadyState/><Stimuli")}, "a SteadyState, not a simulation over time"),
        ({"smoke": ONE.replace("0.001", "often")}, "stepSize = 'often'"),
        ({"smoke": ONE.replace("0.001", "-1")}, "must be above 0"),
        ({"out": "angle\n"}, "must be time, in s"),
        ({"out": "time,subtalar_torque\n"}, "no rows"),
        ({"out": "time,subtalar_torque\n0,zero\n"}, "row 2, subtalar_torque: 'zero' is not a number"),
        ({"out": "time;subtalar_torque\n0;0\n"}, "semicolons"),
        ({"out": "time,subtalar_torque\n1,0\n0,0\n"}, "its times fall"),
    ],
)
def test_what_cannot_be_read_is_said(changed: dict[str, str | None], words: str, plain: Path, tmp_path: Path) -> None:
    report = compared(carrying(plain, tmp_path / "d.fmu", **changed))
    assert not report.references
    assert words in "\n".join(report.notes)
    assert "\n" not in report.notes[0]


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"out": "time,torque\n0,0\n1,0\n"}, "name no output of the FMU (torque)"),
        ({"stimuli": "time,angle\n0,0\n"}, "set angle, which is no input"),
        ({"smoke": WITH_SET, "parameters": SSV.replace("stiffness", "stiff").format(1)}, "sets stiff, which is no"),
        ({"out": outcome(column="subtalar_torque [deg]")}, "is in deg, the FMU's variable in N.m"),
        ({"smoke": ONE.replace("0.02", "0")}, "ends at 0 s"),
        ({"smoke": ONE.replace("0.001", "1e-9")}, "20000000 steps"),
    ],
)  # fmt: skip
def test_what_cannot_be_compared_is_a_warning(changed: dict[str, str], words: str, plain: Path, tmp_path: Path) -> None:
    report = compared(carrying(plain, tmp_path / "d.fmu", **changed))
    assert not report.references
    assert words in report.warnings[0]


def test_check_says_it(
    plain: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where the names do not match, and in the JSON."""
    monkeypatch.chdir(tmp_path)  # where the proposed mapping goes
    fmu = carrying(plain, tmp_path / "d.fmu", out=outcome(factor=-1.0))
    assert _run(["check", str(fmu), "--json"], []) == 1
    found = json.loads(capsys.readouterr().out)
    assert found["references"][0]["name"] == "ramp"
    assert found["references"][0]["difference"] == pytest.approx(2.0)
    assert "is not reproduced" in " ".join(found["problems"])

    other = device(tmp_path / "other.fmu", names=("phi", "M"))
    fmu = carrying(other, tmp_path / "e.fmu", stimuli=RAMP.replace("subtalar_angle", "phi"), out=outcome(column="M"))
    assert _run(["check", str(fmu), "--json"], []) == 1
    assert json.loads(capsys.readouterr().out)["references"][0]["fits"]


def test_a_device_that_fails_in_it(plain: Path, tmp_path: Path) -> None:
    component = Component.read("brace", carrying(plain, tmp_path / "d.fmu"))
    report = FitReport("d.fmu")
    compare_references(replace(component, guid="{another}", identifier="nothing"), report)
    assert "ran where the FMU was made, but here" in report.problems[0]


def test_series() -> None:
    """Linear between rows, held for what is no real; after a jump at its time."""
    series = read_series('time,"u"\n0,0\n1,1\n1,3\n2,3\n', "x")
    assert [series.at("u", t, True) for t in (-1, 0, 0.5, 1, 1.5, 9)] == [0, 0, 0.5, 3, 3, 3]
    assert [series.at("u", t, False) for t in (0.5, 1)] == [0, 3]
    assert read_series("time,u[1] [deg],ok\n0,1,true\n", "x").units == {"u[1]": "deg"}


def test_an_fmu_without_any(plain: Path) -> None:
    assert experiments(plain) == ([], [])
