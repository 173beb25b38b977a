"""Sixty FMUs as exporters write them: ten quirks of each kind (FMI 1.0, 2.0, 3.0; co-simulation and model exchange) in
one brace. What FMPy can simulate with `validate=False` can be used here, with the same torques."""

from __future__ import annotations

from pathlib import Path

import fmpy
import numpy as np
import pytest

from sprain_cosim import check_brace
from sprain_cosim.fmu.driver import Driver
from sprain_cosim.mapping import read_component
from tests.native import changed, device

KINDS = [(fmi, exchange) for fmi in (1, 2, 3) for exchange in (False, True)]
END = "</ModelVariables>"
STEP, STOP, ANGLE = 1e-3, 0.02, 0.2
Parts = tuple[dict[str, str], dict[str, str], str]  # changes of the description, more files, the mapping file


def variable(fmi: int, name: str, kind: str, more: str = "", own: str = "", reference: int = 60) -> str:
    """An element of the version: `more` attributes of the variable, `own` of its type."""
    if fmi == 3:
        kind = {"Real": "Float64", "Integer": "Int32"}.get(kind, kind)
        return f'<{kind} name="{name}" valueReference="{reference}" {more} {own}/>'
    return f'<ScalarVariable name="{name}" valueReference="{reference}" {more}><{kind} {own}/></ScalarVariable>'


def added(fmi: int, *elements: str) -> dict[str, str]:
    return {END: "".join(elements) + END}


def quirk(name: str, fmi: int, exchange: bool) -> Parts:
    """What the exporter of that name does."""
    interface = "<ModelExchange " if exchange else "<CoSimulation "
    local = 'variability="continuous"' if fmi == 1 else 'causality="local" variability="continuous"'
    structure = {"<ModelStructure>": '<ModelStructure><Output valueReference="60"/>'} if fmi == 3 else {}
    match name:
        case "unknown attributes":
            return (
                {
                    ' modelName="device"': ' modelName="device" licensed="no"',
                    'causality="input"': 'causality="input" order="1"',
                },
                {},
                "",
            )
        case "a number of states that is continuous":
            return added(fmi, variable(fmi, "count", "Integer", local)), {}, ""
        case "a local in an undefined unit":
            return added(fmi, variable(fmi, "heat", "Real", local, 'unit="furlong"')), {}, ""
        case "a local with a limit in words":
            return added(fmi, variable(fmi, "heat", "Real", local, 'max="warm"')), {}, ""
        case "a text":
            more = 'causality="output" variability="discrete"'
            return {**added(fmi, variable(fmi, "name", "String", more)), **(structure if fmi == 3 else {})}, {}, ""
        case "annotations of its own":
            note = "<Annotations><Annotation type='t' order='1'/></Annotations>"
            if fmi == 3:
                element = variable(3, "s", "Float64", local).replace("/>", f">{note}</Float64>")
                return added(3, element), {}, ""
            tool = "<VendorAnnotations><mine/></VendorAnnotations>"
            return {"<ModelVariables>": f"{tool}<ModelVariables>"}, {}, ""
        case "resources that end in a dot":
            return {}, {"resources/table.": "1", "resources/data./a": "2"}, ""
        case "a tool that it says it needs":
            allowed = 'allow = ["exec"]'
            if fmi == 1:
                tool = 'Tool><Capabilities canHandleVariableCommunicationStepSize="true"/>'
                model = '<Model entryPoint="file://x" manualStart="false" type="text/x"/></CoSimulation_Tool>'
                wrong = (
                    'StandAlone><Capabilities canHandleVariableCommunicationStepSize="true"/></CoSimulation_StandAlone>'
                )
                return ({} if exchange else {wrong: tool + model}), {}, allowed
            return {interface: f'{interface}needsExecutionTool="true" '}, {}, allowed
        case "two locals of one name":
            one = variable(fmi, "heat", "Real", local)
            return added(fmi, one, one.replace('"60"', '"61"')), {}, ""
        case "no units, and a display unit of its own":
            return added(fmi, variable(fmi, "heat", "Real", local, 'unit="K" displayUnit="warmth"')), {}, ""
    raise ValueError(name)


QUIRKS = (
    "unknown attributes",
    "a number of states that is continuous",
    "a local in an undefined unit",
    "a local with a limit in words",
    "a text",
    "annotations of its own",
    "resources that end in a dot",
    "a tool that it says it needs",
    "two locals of one name",
    "no units, and a display unit of its own",
)
QUICK = {(name, KINDS[k % len(KINDS)]) for k, name in enumerate(QUIRKS)}
ALL = [
    pytest.param(name, *kind, marks=() if (name, kind) in QUICK else pytest.mark.long)
    for name in QUIRKS
    for kind in KINDS
]


@pytest.fixture(scope="module")
def devices(tmp_path_factory: pytest.TempPathFactory) -> dict[tuple[int, bool], Path]:
    folder = tmp_path_factory.mktemp("devices")
    return {(fmi, me): device(folder / f"{fmi}{me}.fmu", fmi, me) for fmi, me in KINDS}


def by_fmpy(fmu: Path) -> np.ndarray | None:
    """Torques at the communication points; None where FMPy does not simulate it."""
    inputs = np.array([(0.0, ANGLE), (STOP, ANGLE)], dtype=[("time", float), ("subtalar_angle", float)])
    try:
        found = fmpy.simulate_fmu(str(fmu), validate=False, stop_time=STOP, output_interval=STEP, input=inputs,
                                  output=["subtalar_torque"], relative_tolerance=1e-9)  # fmt: skip
    except Exception:
        return None
    return np.asarray(found["subtalar_torque"], dtype=float)


def by_us(fmu: Path, mapping: Path | None) -> np.ndarray:
    with Driver(read_component("brace", fmu, mapping), ["subtalar_angle"], ["subtalar_torque"]) as driver:
        driver.start({}, {"subtalar_angle": ANGLE}, 0.0, STOP)
        torques = [driver["subtalar_torque"]]
        for k in range(round(STOP / STEP)):
            driver.step(STEP, time=k * STEP)
            torques.append(driver["subtalar_torque"])
    return np.array(torques)


@pytest.mark.parametrize(("name", "fmi", "exchange"), ALL)
def test_what_fmpy_simulates_can_be_used(
    name: str, fmi: int, exchange: bool, devices: dict[tuple[int, bool], Path], tmp_path: Path
) -> None:
    changes, files, mapping = quirk(name, fmi, exchange)
    fmu = changed(devices[fmi, exchange], tmp_path / "device.fmu", changes, files)
    path = None
    if mapping:
        path = tmp_path / "map.toml"
        path.write_text(mapping)
    expected = by_fmpy(fmu)
    if expected is None:
        pytest.skip("FMPy does not simulate it either")
    found = by_us(fmu, path)
    assert np.abs(found - expected).max() < 1e-6 * np.abs(expected).max()


@pytest.mark.long
@pytest.mark.parametrize(("fmi", "exchange"), KINDS)
@pytest.mark.parametrize("name", QUIRKS)
def test_check_lets_it_fit(
    name: str, fmi: int, exchange: bool, devices: dict[tuple[int, bool], Path], tmp_path: Path
) -> None:
    changes, files, mapping = quirk(name, fmi, exchange)
    fmu = changed(devices[fmi, exchange], tmp_path / "device.fmu", changes, files)
    (tmp_path / "map.toml").write_text(mapping)
    report = check_brace(fmu, tmp_path / "map.toml")
    assert report.fits, report.text()
