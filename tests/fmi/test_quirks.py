"""What exporters write that no run needs: said and passed over where what is used is sound, refused where it is not."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sprain_cosim import check_brace
from sprain_cosim.brace.fit import FitReport
from sprain_cosim.brace.names import contract_axes
from sprain_cosim.errors import InputError
from sprain_cosim.fmu import archive
from sprain_cosim.fmu.component import Component
from sprain_cosim.fmu.driver import Driver
from sprain_cosim.mapping import read_component
from tests.native import changed, device

Changes = dict[str, str]


@pytest.fixture(scope="module")
def devices(tmp_path_factory: pytest.TempPathFactory) -> dict[int, Path]:
    folder = tmp_path_factory.mktemp("devices")
    return {fmi: device(folder / f"{fmi}.fmu", fmi) for fmi in (1, 2, 3)}


END = "</ModelVariables>"
TWO = '<ScalarVariable name="{}" valueReference="77" {}>{}</ScalarVariable></ModelVariables>'
QUIRKS: dict[str, tuple[int, Changes, str]] = {  # what exporters do: (FMI, changes, a word of what is said)
    "attribute of an annotation": (
        3,
        {END: END.replace("</", '<String name="s" valueReference="9"><Annotations><Annotation type="t" order="1"/>'
                                "</Annotations></String></")},
        "attribute 'order'",
    ),
    "attribute of an input": (3, {'causality="input"': 'causality="input" order="1"'}, "variable subtalar_angle: "),
    "unit of a whole number": (2, {END: TWO.format("n", 'causality="parameter" variability="fixed"',
                                                   '<Integer start="1" unit="N.m"/>')}, "attribute 'unit'"),
    "attribute of the root": (2, {' modelName="device"': ' modelName="device" toolLicence="x"'}, "'toolLicence'"),
    "attribute of the structure": (2, {'<Unknown index="2"/>': '<Unknown index="2" cost="3"/>'}, "'cost'"),
    "content of vendor annotations": (2, {"<ModelVariables>": "<VendorAnnotations><x/></VendorAnnotations>"
                                          "<ModelVariables>"}, "VendorAnnotations"),
    "continuous enumeration": (2, {END: TWO.format("mode", 'causality="output"', '<Enumeration declaredType="E"/>'),
                                   "<ModelVariables>": '<TypeDefinitions><SimpleType name="E"><Enumeration><Item '
                                   'name="a" value="1"/></Enumeration></SimpleType></TypeDefinitions><ModelVariables>'},
                               'must have variability != "continuous"'),
    "continuous integer": (1, {END: TWO.format("count", "", '<Integer/>')}, "continuous"),
    "local that is fixed and exact": (2, {END: TWO.format("l", 'variability="fixed" initial="exact"',
                                                          '<Real start="1"/>')}, "is not allowed"),
    "parameter that is continuous": (2, {'causality="parameter" variability="fixed"':
                                         'causality="parameter" variability="continuous"'}, "illegal combination"),
    "local with a start in words": (2, {END: TWO.format("l", "", '<Real start="none"/>')}, "variable l cannot be used"),
    "local of an undefined type": (2, {END: TWO.format("l", "", '<Real declaredType="T"/>')}, "has not been defined"),
    "local without a reference": (2, {END: '<ScalarVariable name="l"><Real/></ScalarVariable></ModelVariables>'},
                                  "variable l cannot be used"),
    "local whose name stands twice": (2, {END: 2 * TWO.format("l", "", "<Real/>").removesuffix(END) + END},
                                      "is not unique"),
    "output of no use with a strange value": (2, {END: TWO.format("heat", 'causality="output"', '<Real max="warm"/>')},
                                              "variable heat cannot be used"),
    "undefined unit": (2, {END: TWO.format("l", "", '<Real unit="furlong"/>')}, 'unit "furlong"'),
    "undefined display unit": (2, {END: TWO.format("l", "", '<Real unit="x" displayUnit="y"/>')}, "x"),
    "broken unit of no use": (2, {"</UnitDefinitions>": '<Unit name="degF"><BaseUnit K="x"/></Unit></UnitDefinitions>'},
                              "unit degF, which no variable in use has"),
    "input without a start value": (2, {' start="0"': ""}, "has no start value"),
    "two clocks of an independent variable": (3, {'causality="independent"': 'causality="local"'}, "independent"),
}  # fmt: skip


@pytest.mark.parametrize("name", QUIRKS)
def test_passed_over(name: str, devices: dict[int, Path], tmp_path: Path) -> None:
    fmi, changes, words = QUIRKS[name]
    component = Component.read("brace", changed(devices[fmi], tmp_path / "d.fmu", changes))
    assert words in " ".join(component.quirks)
    assert all("\n" not in quirk for quirk in component.quirks)
    sound = Component.read("brace", devices[fmi])
    assert component.inputs.keys() == sound.inputs.keys()
    assert component.outputs.items() >= sound.outputs.items()
    assert component.capabilities == sound.capabilities
    assert component.parameters.keys() >= sound.parameters.keys()


BROKEN: dict[str, tuple[int, Changes]] = {
    "input of strange causality": (2, {'causality="input"': 'causality="in"'}),
    "torque with a limit in words": (2, {'unit="N.m"/>': 'unit="N.m" max="much"/>'}),
    "parameter with a start in words": (2, {'start="20"': 'start="twenty"'}),
    "torque of an undefined type": (2, {'unit="N.m"/>': 'unit="N.m" declaredType="T"/>'}),
    "unit of the torque": (2, {'kg="1" m="2" s="-2"': 'kg="one" m="2" s="-2"'}),
    "unknown attribute of an interface": (2, {"<CoSimulation ": '<CoSimulation mayFail="true" '}),
    "two variables of the name of the torque": (
        2,
        {END: TWO.format("subtalar_torque", 'causality="output"', "<Real/>")},
    ),
    "a local of the name of the torque": (2, {END: TWO.format("subtalar_torque", "", "<Real/>")}),
    "the angle's unit in other letters": (2, {'unit="rad" start="0"': 'Unit="rad" start="0"'}),
    "the torque's factor in other letters": (2, {'kg="1" m="2" s="-2" factor': 'kg="1" m="2" s="-2" Factor'}),
    "no structure": (2, {"<ModelStructure>": "<Structure>", "</ModelStructure>": "</Structure>"}),
}


@pytest.mark.parametrize("name", BROKEN)
def test_refused(name: str, devices: dict[int, Path], tmp_path: Path) -> None:
    fmi, changes = BROKEN[name]
    with pytest.raises(InputError, match=r"modelDescription\.xml is not valid: ") as caught:
        Component.read("brace", changed(devices[fmi], tmp_path / "d.fmu", changes))
    assert "\n" not in str(caught.value)


def test_check_says_it_and_the_verdict_stays(devices: dict[int, Path], tmp_path: Path) -> None:
    fmi, changes, _ = QUIRKS["attribute of an annotation"]
    binary = '<Binary name="blob" valueReference="20" causality="output"/></ModelVariables>'
    structure = '<ModelStructure><Output valueReference="20"/>'
    fmu = changed(devices[fmi], tmp_path / "d.fmu", {**changes, END: changes[END].replace(END, binary),
                                                     "<ModelStructure>": structure})  # fmt: skip
    report = check_brace(fmu)
    assert report.verdict == "fits"
    notes = "\n".join(report.notes)
    assert (
        "breaks the rules of FMI where nothing here looks: variable s: Element 'Annotation', attribute 'order'" in notes
    )
    assert "has binary variables (blob), which no run uses" in notes


def test_what_the_file_of_a_resource_may_be_called(devices: dict[int, Path], tmp_path: Path) -> None:
    """A dot at the end is kept; where Windows would lose it into another file's name it is refused."""
    fmu = changed(devices[2], tmp_path / "d.fmu", {}, {"resources/table.": "1"})
    assert Component.read("brace", fmu).quirks == ("'resources/table.' ends in a dot, which Windows does not keep",)
    assert check_brace(fmu).fits
    for names in (
        ("resources/a.", "resources/a"),
        ("resources/a./b", "resources/a/c"),
        ("extra/a.",),
        ("resources/..",),
    ):
        wrong = changed(devices[2], tmp_path / "w.fmu", {}, dict.fromkeys(names, "1"))
        with pytest.raises(InputError, match="refused"):
            archive.read(wrong)


def test_a_unit_that_nobody_knows_is_not_taken_for_si(devices: dict[int, Path], tmp_path: Path) -> None:
    """FMI 1 has no definitions; others may leave them out. Units are read by name, or asked for."""
    fmu = changed(devices[2], tmp_path / "d.fmu", {'unit="N.m"/>': 'unit="lbf.in"/>'})
    unit = Component.read("brace", fmu).outputs["subtalar_torque"].unit
    assert unit is not None
    assert unit.factor == pytest.approx(0.45359237 * 9.80665 * 0.0254)
    for fmi in (1, 2, 3):
        text = 'unit="N.m"/>' if fmi == 3 else '<Real unit="N.m"/>'
        report = check_brace(changed(devices[fmi], tmp_path / "w.fmu", {text: text.replace("N.m", "pull")}))
        assert not report.fits
        assert "subtalar_torque: unit pull has the dimension 1, expected" in report.problems[0]


def test_a_tool_at_run_time(devices: dict[int, Path], tmp_path: Path) -> None:
    """Only where the user's own file lets the FMU start programs; the other interface where that needs no tool."""
    needs = {"<CoSimulation ": '<CoSimulation needsExecutionTool="true" '}
    fmu = changed(devices[2], tmp_path / "d.fmu", needs)
    (tmp_path / "map.toml").write_text('allow = ["exec"]')
    for read in (lambda: check_brace(fmu), lambda: read_component("brace", fmu)):
        with pytest.raises(InputError, match=r"needs its authoring tool \(unnamed\).*allow = \[\"exec\"\]"):
            read()
    report = check_brace(fmu, tmp_path / "map.toml")
    assert report.fits
    assert "needs its authoring tool" in report.warnings[0]
    both = {"<CoSimulation ": '<ModelExchange modelIdentifier="device"/><CoSimulation needsExecutionTool="true" '}
    assert Component.read("brace", changed(devices[2], tmp_path / "both.fmu", both)).capabilities.model_exchange


def test_ten_thousand_faults_take_no_time(devices: dict[int, Path], tmp_path: Path) -> None:
    many = "".join(
        f'<ScalarVariable name="l{k}" valueReference="{k}" order="1"><Real/></ScalarVariable>' for k in range(3000)
    )
    component = Component.read("brace", changed(devices[2], tmp_path / "d.fmu", {END: many + END}))
    assert component.quirks[-1] == "and 2997 more of the kind"
    assert re.match("variable l0: ", component.quirks[0])
    assert np.isfinite(component.parameters["stiffness"].start or np.nan)


def test_negated_aliases_of_fmi_1(devices: dict[int, Path], tmp_path: Path) -> None:
    """Their values come, and are sent, with the other sign: a torque and an angle so written are the same brace."""
    turned = {f'causality="{c}"': f'causality="{c}" alias="negatedAlias"' for c in ("input", "output")}
    found = []
    for fmu in (devices[1], changed(devices[1], tmp_path / "d.fmu", turned)):
        component = Component.read("brace", fmu)
        with Driver(component, ["subtalar_angle"], ["subtalar_torque"]) as driver:
            driver.start({}, {"subtalar_angle": 0.3})
            driver.step(1e-3, {"subtalar_angle": 0.2})
            found.append(driver["subtalar_torque"])
    assert found[0] == found[1] < 0
    one = {old: new for old, new in turned.items() if "output" in old}
    report = check_brace(changed(devices[1], tmp_path / "one.fmu", one))
    assert not report.fits
    assert "sign" in report.problems[0]


def test_what_a_type_declares_holds_for_its_variables(devices: dict[int, Path], tmp_path: Path) -> None:
    types = (
        '<TypeDefinitions><SimpleType name="T"><Real unit="N.m/rad" min="1" max="50"/></SimpleType></TypeDefinitions>'
    )
    fmu = changed(
        devices[2],
        tmp_path / "d.fmu",
        {"<ModelVariables>": f"{types}<ModelVariables>", 'unit="N.m/rad" start="20"': 'declaredType="T" start="20"'},
    )
    stiffness = Component.read("brace", fmu).parameters["stiffness"]
    assert (stiffness.minimum, stiffness.maximum) == (1.0, 50.0)
    assert stiffness.unit is not None
    with pytest.raises(InputError, match="outside its range"):
        stiffness.value("60 N.m/rad", "stiffness")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({'unit="rad" start="0"': 'unit="rad" min="-0.2" max="0.6" start="0"'}, "is declared for -11.46 ... 34.38 deg"),
        ({'unit="rad" start="0"': 'unit="rad" min="-1" max="1" start="0"'}, ""),
    ],
)
def test_a_range_that_a_landing_leaves(
    changes: dict[str, str], words: str, devices: dict[int, Path], tmp_path: Path
) -> None:
    report = FitReport("d.fmu")
    contract_axes(Component.read("brace", changed(devices[2], tmp_path / "d.fmu", changes)), report)
    assert words in " ".join(report.warnings)
    assert bool(report.warnings) == bool(words)


def test_whole_numbers_are_no_torques(devices: dict[int, Path], tmp_path: Path) -> None:
    component = Component.read("brace", devices[2])
    whole = {n: replace(c, kind="integer") if n == "subtalar_torque" else c for n, c in component.connectors.items()}
    report = FitReport("d.fmu")
    contract_axes(replace(component, connectors=whole), report)
    assert "subtalar_torque: is of type integer, so its values are whole numbers of N.m" in report.warnings[0]
