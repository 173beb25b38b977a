"""SSP packages: a landing written and read back is the same to the bit; systems of others are read right or refused by
name, element by element."""

from __future__ import annotations

import csv
import json
import os
import subprocess
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from lxml import etree

from sprain_cosim import load_scenario
from sprain_cosim.cli import _run
from sprain_cosim.errors import InputError
from sprain_cosim.export.container import export_container
from sprain_cosim.export.package import export_package
from sprain_cosim.scenario import Scenario
from sprain_cosim.scenario.inspection import inspected
from sprain_cosim.shipped import FMUS, shipped_scenarios
from sprain_cosim.ssp import flat
from sprain_cosim.ssp.elements import READ, SKIPPED, SUPPORT
from sprain_cosim.ssp.structure import structure as structure_of
from sprain_cosim.study.file import load_study
from tests.native import device
from tests.systems import (
    DEVICE,
    LINEAR,
    OUTSIDE,
    PLAIN,
    SPACES,
    STIFF,
    THROUGH,
    TO_DEG,
    UNITS,
    binding,
    component,
    inline_mapping,
    parameters,
    real,
    structure,
    system,
    value,
    wire,
)

ROOT = Path(__file__).parent.parent.parent
OMSIMULATOR = Path(os.environ.get("SPRAIN_OMSIMULATOR", ROOT / "build" / "peers" / "OMSimulator"))
ECOS = Path(os.environ.get("SPRAIN_ECOS", ROOT / "build" / "peers" / "ecos" / "bin" / "python"))


@pytest.fixture(scope="module")
def brace(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return device(tmp_path_factory.mktemp("ssp") / "brace.fmu")


@pytest.fixture(scope="module")
def vendor(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Degrees and N.mm that it does not declare, the wrong sign, names of its own."""
    folder = tmp_path_factory.mktemp("ssp")
    return device(folder / "vendor.fmu", sign=-1.0, angle="deg", torque="N.mm", names=("In1", "M_out"), declared=False)


@pytest.fixture(scope="module")
def pack(tmp_path_factory: pytest.TempPathFactory, brace: Path, vendor: Path) -> Callable[..., Path]:
    def made(content: str, files: dict[str, str | bytes | Path] | None = None, name: str = "device") -> Path:
        target = tmp_path_factory.mktemp("ssp") / f"{name}.ssp"
        with zipfile.ZipFile(target, "w") as archive:
            archive.writestr("SystemStructure.ssd", content)
            archive.write(brace, "resources/brace.fmu")
            archive.write(vendor, "resources/vendor.fmu")
            for entry, data in (files or {}).items():
                archive.writestr(entry, data.read_bytes() if isinstance(data, Path) else data)
        return target

    return made


def angles(scenario: Scenario) -> np.ndarray:
    result = scenario.run(in_process=True)
    assert result.status == "completed", result.message
    return np.asarray(result["plant.subtalar_angle"])


def landed(package: Path) -> np.ndarray:
    return angles(load_scenario("incline30").replace_fmu("brace", package))


@pytest.fixture(scope="module")
def braced(brace: Path) -> np.ndarray:
    """The landing with the C brace as a component of its own."""
    return angles(load_scenario("incline30").replace_fmu("brace", brace))


# ---- out and in again


@pytest.mark.parametrize("version", ["1.0", "2.0"])
@pytest.mark.parametrize("name", shipped_scenarios())
def test_a_landing_returns_to_the_bit(name: str, version: str, tmp_path: Path) -> None:
    scenario = load_scenario(name)
    export_package(scenario, tmp_path / "landing.ssp", version)
    again = load_scenario(tmp_path / "landing.ssp")
    assert again.master == scenario.master
    assert not again.warnings
    one, other = scenario.run(), again.run()
    assert one.names == other.names
    assert np.array_equal(one.values, other.values)


@pytest.mark.parametrize("case", ["person", "study", "mujoco", "fmi3"])
def test_what_stands_on_a_landing_returns_to_the_bit(case: str, tmp_path: Path) -> None:
    """A person, the base of a study, another plant, FMI 3."""
    scenario = {
        "person": lambda: load_scenario("incline30_brace").with_subject("female, 1.63 m, 62 kg"),
        "study": lambda: load_study("population_mixed").scenario,
        "mujoco": lambda: load_scenario("incline30_mixed").replace_fmu("plant", "plant_mujoco"),
        "fmi3": lambda: load_scenario("incline30").replace_fmu("plant", FMUS / "plant_fmi3.fmu"),
    }[case]().with_master(stop="20 ms")
    export_package(scenario, tmp_path / "landing.ssp")
    assert np.array_equal(angles(load_scenario(tmp_path / "landing.ssp")), angles(scenario))


@pytest.mark.parametrize("scheme", ["auto", "jacobi"])
def test_a_mapped_foreign_brace_returns_to_the_bit(scheme: str, vendor: Path, tmp_path: Path) -> None:
    (tmp_path / "map.toml").write_text(
        'active = true\n[inputs]\nsubtalar_angle = { to = "In1", unit = "deg", offset = 1.5 }\n'
        '[outputs]\nsubtalar_torque = { from = "M_out", unit = "N.mm", factor = -1 }\n'
    )
    scenario = load_scenario("incline30").replace_fmu("brace", vendor, tmp_path / "map.toml").with_master(scheme)
    export_package(scenario, tmp_path / "landing.ssp")
    again = load_scenario(tmp_path / "landing.ssp")
    assert np.array_equal(angles(again), angles(scenario))
    link = again.wiring and again.wiring.links["brace.In1"]
    assert link == pytest.approx((180 / np.pi, 1.5), rel=1e-12)
    assert "active = true" in again.maps["brace"].read_text()


@pytest.mark.parametrize("scheme", ["auto", "gauss-seidel"])
def test_a_foreign_brace_in_its_own_units_returns_to_the_bit(scheme: str, tmp_path: Path) -> None:
    """The connection is left to the tool's conversion, and the export says so."""
    fmu = device(tmp_path / "brace.fmu", angle="deg", torque="N.mm")
    scenario = load_scenario("incline30").replace_fmu("brace", fmu).with_master(scheme)
    notes = export_package(scenario, tmp_path / "landing.ssp")
    assert any(
        "brace.subtalar_angle, plant.brace_subtalar_torque: the tool has to convert the unit" in n for n in notes
    )
    again = load_scenario(tmp_path / "landing.ssp")
    assert not again.warnings
    one, other = scenario.run(in_process=True), again.run(in_process=True)
    assert (one.names, one.units) == (other.names, other.units)
    assert np.array_equal(one.values, other.values)


def test_a_package_is_as_omsimulator_opens_it(tmp_path: Path) -> None:
    """Names that are identifiers, no annotations but in the outermost system, its own the first of them: without these
    it opens nothing."""
    vendor = device(tmp_path / "vendor.fmu", names=("a", "b"))
    (tmp_path / "map.toml").write_text(
        'active = true\n[inputs]\nsubtalar_angle = "a"\n[outputs]\nsubtalar_torque = "b"\n'
    )
    scenario = load_scenario("incline30_brace").replace_fmu("brace", vendor, tmp_path / "map.toml")
    export_package(scenario, tmp_path / "landing.ssp")
    with zipfile.ZipFile(tmp_path / "landing.ssp") as archive:
        root = etree.fromstring(archive.read("SystemStructure.ssd"))
    assert root.get("name") == root[0].get("name") == "landing"
    assert root.get("description") == scenario.heading
    assert [etree.QName(child).localname for child in root] == ["System", "Units", "DefaultExperiment"]
    found = list(root.iter("{*}Annotations"))
    assert found[0].getparent() is root[0]
    assert found[0][0].get("type") == "org.openmodelica"
    assert [step.get("stepSize") for step in root.iter("{*}FixedStepMaster")] == ["0.0005"]
    assert load_scenario(tmp_path / "landing.ssp").maps["brace"].read_text() == "active = true\n"


def test_a_package_is_written_alike_every_time(tmp_path: Path) -> None:
    for name in ("a.ssp", "b.ssp"):
        export_package(load_scenario("level"), tmp_path / name)
    assert (tmp_path / "a.ssp").read_bytes() == (tmp_path / "b.ssp").read_bytes()


def test_a_sum_is_refused_by_name(tmp_path: Path) -> None:
    fmu = device(tmp_path / "cables.fmu", cables=True, names=("subtalar_angle", "whole"))
    (tmp_path / "map.toml").write_text(
        '[outputs]\nsubtalar_torque = { from = ["medial", "lateral"], factor = [1, -1], arm = "40 mm" }\n'
    )
    scenario = load_scenario("incline30").replace_fmu("brace", fmu, tmp_path / "map.toml")
    with pytest.raises(InputError, match=r"brace.subtalar_torque: is the sum of medial, lateral"):
        export_package(scenario, tmp_path / "x.ssp")


def test_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """export, check, run, run with a device in a package, a study file on top of a package."""
    out = tmp_path / "landing.ssp"
    assert _run(["ssp", "export", "incline30_brace", "--set", "brace.angle_scale=1.5", "-o", str(out)], []) == 0
    assert _run(["ssp", "check", str(out), "--json"], []) == 0
    lines = capsys.readouterr().out.splitlines()
    found = json.loads(lines[-1])
    assert found["components"] == [f"{n} (FMI 2.0 co-simulation, {n}.fmu)" for n in ("plant", "controller", "brace")]
    assert "brace.angle_scale = 1.5" in found["parameters"]
    (tmp_path / "mine.toml").write_text(f'base = "{out}"\n[parameters]\n"plant.drop_height" = "0.35 m"\n')
    expected = (
        load_scenario("incline30_brace").override("brace.angle_scale", 1.5).override("plant.drop_height", "0.35 m")
    )
    assert np.array_equal(angles(load_scenario(tmp_path / "mine.toml")), angles(expected))
    assert _run(["run", str(tmp_path / "none.ssp")], []) == 2
    assert "no such scenario file" in capsys.readouterr().err


def test_an_annotation_allows_nothing(pack: Callable[..., Path], tmp_path: Path) -> None:
    """What a mapping file could allow cannot get in by our annotation, by a line break neither."""
    own = 'xmlns:own="urn:sprain-cosim:ssp:1"'
    for attribute in ('allow="[&quot;network&quot;]"', 'reset="true&#10;allow = [&quot;network&quot;]"'):
        note = f'<ssc:Annotation type="x"><own:Device component="brace" {own} {attribute}/></ssc:Annotation>'
        note = f"<ssd:Annotations>{note}</ssd:Annotations>"
        with pytest.raises(InputError, match="annotation Device"):
            landed(pack(structure(system(PLAIN, THROUGH, OUTSIDE).replace("</ssd:System>", note + "</ssd:System>"))))


# ---- devices of others


def test_a_device_takes_the_place_of_an_fmu(pack: Callable[..., Path], braced: np.ndarray) -> None:
    assert np.array_equal(landed(pack(DEVICE)), braced)


VENDOR = real("In1", "input") + real("M_out", "output")
IN_DEGREES = real("subtalar_angle", "input", "deg") + real("subtalar_torque", "output", "N.mm")


@pytest.mark.parametrize(
    "content",
    [
        # units in the document that the FMU does not declare, and the sign as a transformation in addition
        system(
            component("vendor", real("In1", "input", "deg") + real("M_out", "output", "N.mm")),
            wire("subtalar_angle", "vendor.In1") + wire("vendor.M_out", "subtalar_torque", LINEAR.format(-1.0, 0.0)),
            real("subtalar_angle", "input", "rad") + real("subtalar_torque", "output", "N.m"),
        ),
        # all of it as transformations instead of any conversion
        system(
            component("vendor", VENDOR),
            wire("subtalar_angle", "vendor.In1", TO_DEG, 'suppressUnitConversion="true"')
            + wire("vendor.M_out", "subtalar_torque", LINEAR.format(-0.001, 0.0), 'suppressUnitConversion="true"'),
            OUTSIDE,
        ),
        # in two steps, on the borders of two systems, one of them in the other
        system(
            system(
                component("vendor", VENDOR),
                wire("x", "vendor.In1", TO_DEG) + wire("vendor.M_out", "y", LINEAR.format(-1.0, 0.0)),
                real("x", "input") + real("y", "output"),
                name="inner",
            ),
            wire("subtalar_angle", "inner.x", LINEAR.format(2.0, 0.25))
            + wire("inner.y", "subtalar_torque", LINEAR.format(0.001, 0.0)),
            OUTSIDE,
        ).replace(TO_DEG, LINEAR.format(57.29577951308232 / 2, -0.125 * 57.29577951308232)),
        # the units of the device's own connectors, which its FMU does not declare
        system(
            component("vendor", VENDOR),
            wire("subtalar_angle", "vendor.In1") + wire("vendor.M_out", "subtalar_torque", LINEAR.format(-1.0, 0.0)),
            IN_DEGREES,
        ),
        # the same, each number handed over as it is
        system(
            component("vendor", VENDOR),
            wire("subtalar_angle", "vendor.In1", more='suppressUnitConversion="true"')
            + wire("vendor.M_out", "subtalar_torque", LINEAR.format(-1.0, 0.0), 'suppressUnitConversion="true"'),
            IN_DEGREES,
        ),
        # without units outside: those of the contract; the inner system's are the first that are stated
        system(
            system(
                component("vendor", VENDOR),
                wire("x", "vendor.In1", LINEAR.format(1.0, 0.0)) + wire("vendor.M_out", "y", LINEAR.format(-1.0, 0.0)),
                real("x", "input", "deg") + real("y", "output", "N.mm"),
                name="inner",
            ),
            wire("subtalar_angle", "inner.x") + wire("inner.y", "subtalar_torque"),
            OUTSIDE,
        ),
        # a connector without a unit, after a transformation instead of the conversion: no other conversion follows
        system(
            system(
                component("vendor", real("In1", "input", "deg") + real("M_out", "output", "N.mm")),
                wire("x", "vendor.In1") + wire("vendor.M_out", "y"),
                real("x", "input") + real("y", "output"),
                name="inner",
            ),
            wire("subtalar_angle", "inner.x", TO_DEG, 'suppressUnitConversion="true"')
            + wire("inner.y", "subtalar_torque", LINEAR.format(-0.001, 0.0), 'suppressUnitConversion="true"'),
            real("subtalar_angle", "input", "rad") + real("subtalar_torque", "output", "N.m"),
        ),
    ],
)
def test_transformations_are_carried(content: str, pack: Callable[..., Path], braced: np.ndarray) -> None:
    """A device in degrees and N.mm, pushing instead of resisting: the landing of the SI one."""
    assert np.abs(landed(pack(structure(content))) - braced).max() < 1e-12


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (
            system(
                component("vendor", real("In1", "input", "deg") + real("M_out", "output")),
                wire("subtalar_angle", "vendor.In1", TO_DEG) + wire("vendor.M_out", "subtalar_torque"),
                OUTSIDE,
            ),
            "subtalar_angle states no unit, and a transformation stands between it and deg; state its unit",
        ),
        (
            system(
                component("vendor", real("In1", "input") + real("M_out", "output", "N.mm")),
                wire("subtalar_angle", "vendor.In1")
                + wire("vendor.M_out", "subtalar_torque", LINEAR.format(-1.0, 0.0)),
                OUTSIDE,
            ),
            "subtalar_torque states no unit, and a transformation stands between it and N.mm; state its unit",
        ),
        (
            system(
                system(
                    component("vendor", real("In1", "input", "deg") + real("M_out", "output")),
                    wire("x", "vendor.In1") + wire("vendor.M_out", "y"),
                    real("x", "input") + real("y", "output"),
                    name="inner",
                ),
                wire("subtalar_angle", "inner.x", TO_DEG) + wire("inner.y", "subtalar_torque"),
                real("subtalar_angle", "input", "rad") + real("subtalar_torque", "output"),
            ),
            "inner.x states no unit, and a transformation stands between it and rad",
        ),
        (
            system(
                component("vendor", VENDOR),
                wire("subtalar_angle", "vendor.In1") + wire("vendor.M_out", "subtalar_torque"),
                real("subtalar_angle", "input", "N.m") + real("subtalar_torque", "output"),
            ),
            "its input subtalar_angle: the units do not match: rad (rad) and N.m",
        ),
        (
            system(
                PLAIN,
                THROUGH + wire("brace.subtalar_torque", "SubtalarTorque"),
                OUTSIDE + real("SubtalarTorque", "output"),
            ),
            "its output SubtalarTorque: another output means plant.brace_subtalar_torque as well",
        ),
    ],
)
def test_units_that_cannot_be_known_are_refused(content: str, words: str, pack: Callable[..., Path]) -> None:
    with pytest.raises(InputError) as problem:
        landed(pack(structure(content)))
    assert words in str(problem.value)
    assert "\n" not in str(problem.value)


def test_a_device_of_two_fmus(pack: Callable[..., Path], braced: np.ndarray, tmp_path: Path) -> None:
    """The actuator's supply comes from the sensor: 48 V and next to nothing of its output; it gives what the brace
    gives at 48 V."""
    actuator = device(tmp_path / "actuator.fmu", supply=True)
    angle, torque = real("subtalar_angle", "input"), real("subtalar_torque", "output")
    exposed = (
        '<ssd:Connection startElement="actuator" startConnector="subtalar_torque" endConnector="Subtalar.Torque"/>'
    )
    nearly_48 = LINEAR.format(1e-30, 48.0)
    content = system(
        component("brace", angle + torque) + component("actuator", angle + torque + real("supply", "input")),
        wire("subtalar_angle", "brace.subtalar_angle")
        + wire("subtalar_angle", "actuator.subtalar_angle")
        + wire("brace.subtalar_torque", "actuator.supply", nearly_48, 'suppressUnitConversion="true"')
        + exposed,
        angle + real("Subtalar.Torque", "output"),
    )
    package = pack(structure(content), {"resources/actuator.fmu": actuator})
    scenario = load_scenario("incline30").replace_fmu("brace", package)
    assert list(scenario.fmus) == ["plant", "controller", "brace_brace", "brace"]
    assert np.abs(angles(scenario) - braced).max() < 1e-12
    assert "brace = device.ssp" in scenario.changes
    with pytest.raises(InputError, match="a mapping file belongs to one FMU"):
        load_scenario("incline30").replace_fmu("brace", package, tmp_path / "map.toml")


def test_a_study_takes_a_package(pack: Callable[..., Path], tmp_path: Path) -> None:
    package = pack(DEVICE)
    arguments = [
        "study",
        "study6",
        "--fmu",
        f"brace={package}",
        "--trials",
        "2",
        "--workers",
        "1",
        "--progress",
        "none",
    ]
    assert _run([*arguments, "-o", str(tmp_path / "s")], []) == 0
    assert _run([*arguments, "-o", str(tmp_path / "s"), "--resume"], []) == 0


# ---- systems in files of their own

PACKAGE, DEFINITION = 'type="application/x-ssp-package"', 'type="application/x-ssp-definition"'
INNER = system(
    component("vendor", VENDOR),
    wire("x", "vendor.In1", TO_DEG, 'suppressUnitConversion="true"')
    + wire("vendor.M_out", "y", LINEAR.format(-1.0, 0.0)),
    real("x", "input", "rad") + real("y", "output"),
    name="inner",
)
BORDER = real("x", "input", "rad") + real("y", "output")
AROUND = wire("subtalar_angle", "inner.x") + wire("inner.y", "subtalar_torque", LINEAR.format(0.001, 0.0))


def around(connectors: str = BORDER, source: str = "inner.ssp", more: str = PACKAGE, inside: str = "") -> str:
    return structure(system(component("inner", connectors, inside, f"resources/{source}", more), AROUND, OUTSIDE))


def test_a_package_in_a_package(pack: Callable[..., Path], braced: np.ndarray) -> None:
    """The same landing as with its FMU alone: two levels deep, and from a structure beside the first, whose paths are
    relative to itself."""
    files = {
        "inner.ssp": pack(structure(INNER)),
        "deeper.ssp": pack(
            structure(
                system(
                    component("vendor", BORDER, "", "resources/vendor.ssp", PACKAGE),
                    wire("x", "vendor.x") + wire("vendor.y", "y"),
                    BORDER,
                )
            ),
            {"resources/vendor.ssp": pack(structure(INNER))},
        ),
        "inner/device.ssd": structure(INNER).replace("resources/vendor.fmu", "../vendor.fmu"),
    }
    for file, inside in files.items():
        kind = DEFINITION if file.endswith(".ssd") else PACKAGE
        package = pack(around(source=file, more=kind), {f"resources/{file}": inside})
        scenario = load_scenario("incline30").replace_fmu("brace", package)
        assert np.abs(angles(scenario) - braced).max() < 1e-12
    assert any("component inner.vendor is called inner_vendor here" in warning for warning in scenario.warnings)


@pytest.mark.parametrize(
    ("outer", "expected"),
    [
        ("", "31.0 N.m/rad"),
        (binding(parameters(value("brace.stiffness", '<ssv:Real value="32"/>'))), "32.0 N.m/rad"),
        (
            binding(parameters(value("brace.stiffness", '<ssv:Real value="32"/>')), more='prefix="brace."'),
            "31.0 N.m/rad",
        ),
        (binding(more='source="resources/soft.ssv" sourceBase="component"'), "33.0 N.m/rad"),
        (
            binding(
                parameters(value("k", '<ssv:Real value="2"/>')),
                inline_mapping(
                    f'<ssm:MappingEntry source="k" target="brace.stiffness">{LINEAR.format(17.0, 0.0)}'
                    "</ssm:MappingEntry>"
                ),
            ),
            "34.0 N.m/rad",
        ),
    ],
)
def test_parameters_of_a_package_in_a_package(outer: str, expected: str, pack: Callable[..., Path]) -> None:
    """The inner one's own sets with their files and mappings; what the outer one says goes before them, by the names
    of the inner system."""
    own = binding(more='source="resources/own.ssv"', mapping='<ssd:ParameterMapping source="resources/own.ssm"/>')
    inner = structure(system(PLAIN, THROUGH, OUTSIDE, own))
    entry = f'<ssm:MappingEntry source="k" target="brace.stiffness">{LINEAR.format(1.0, 1.0)}</ssm:MappingEntry>'
    files = {
        "resources/own.ssv": parameters(value("k", '<ssv:Real value="30"/>')),
        "resources/own.ssm": f'<ssm:ParameterMapping{SPACES} version="1.0">{entry}</ssm:ParameterMapping>',
        "resources/soft.ssv": parameters(value("brace.stiffness", '<ssv:Real value="33"/>')),
    }
    content = structure(
        system(
            component("inner", OUTSIDE, outer, "resources/inner.ssp", PACKAGE),
            THROUGH.replace("brace", "inner"),
            OUTSIDE,
        )
    )
    package = pack(content, {"resources/inner.ssp": pack(inner, files)})
    assert load_scenario("incline30").replace_fmu("brace", package).parameters["brace.stiffness"] == expected


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (around(real("x", "input", "deg") + real("y", "output")), "its unit is deg, and rad in the system inside"),
        (around(real("x", "output", "rad") + real("y", "output")), "is of kind output, and input in the system inside"),
        (around(real("z", "input") + BORDER), "connector z: the system inside has none of that name"),
        (around(more=f'{PACKAGE} implementation="CoSimulation"'), "implementation belongs to an FMU"),
        (around(source="none.ssp"), "has no resources/none.ssp"),
        (around(source="broken.ssp"), "device.ssp:resources/broken.ssp:SystemStructure.ssd: no readable XML"),
        (around(source="../SystemStructure.ssd", more=DEFINITION), "contains itself (SystemStructure.ssd -> SystemStr"),
        (around(source="a.ssd", more=DEFINITION), "resources/a.ssd -> resources/b.ssd -> resources/a.ssd"),
        (around(source="0.ssd", more=DEFINITION), "more than 8 packages in each other"),
        (around(source="wide0.ssd", more=DEFINITION), "more than 1000 elements in all systems together"),
    ],
)
def test_packages_in_packages_that_are_refused(content: str, words: str, pack: Callable[..., Path]) -> None:
    def leading(*files: str) -> str:
        inside = [component(f"c{k}", BORDER, "", file, DEFINITION) for k, file in enumerate(files)]
        return structure(system("".join(inside)))

    files: dict[str, str | bytes | Path] = {
        "resources/inner.ssp": pack(structure(INNER)),
        "resources/broken.ssp": pack("<"),
        "resources/a.ssd": leading("b.ssd"),
        "resources/b.ssd": leading("a.ssd"),
        **{f"resources/{k}.ssd": leading(f"{k + 1}.ssd") for k in range(12)},
        **{f"resources/wide{k}.ssd": leading(*[f"wide{k + 1}.ssd"] * 40) for k in range(2)},
        "resources/12.ssd": structure(INNER),
        "resources/wide2.ssd": structure(INNER),
    }
    with pytest.raises(InputError) as problem:
        landed(pack(content, files))
    assert words in str(problem.value)
    assert ".cache" not in str(problem.value)


# ---- parameters


def with_binding(binding_: str, above: str = "", prefix: str = "") -> str:
    return structure(system(PLAIN.replace("</ssd:Component>", binding_ + "</ssd:Component>"), THROUGH, OUTSIDE, above))


@pytest.mark.parametrize(
    ("binding_", "above", "stiffness"),
    [
        (binding(parameters(STIFF)), "", "30.0 N.m/rad"),
        (binding(more='source="resources/p.ssv"'), "", "31.0 N.m/rad"),
        ("", binding(parameters(value("brace.stiffness", '<ssv:Real value="32"/>'))), "32.0 N.m/rad"),
        ("", binding(parameters(STIFF), more='prefix="brace."'), "30.0 N.m/rad"),
        (
            binding(parameters(STIFF)),
            binding(parameters(value("brace.stiffness", '<ssv:Real value="32"/>'))),
            "32.0 N.m/rad",
        ),
        (
            binding(
                parameters(
                    value("stiffness", '<ssv:Real value="0.03" unit="kN.m/rad"/>'), UNITS.replace("ssd:U", "ssv:U")
                )
            ),
            "",
            "30.0 N.m/rad",
        ),
        (
            binding(
                parameters(value("k", '<ssv:Real value="15"/>')),
                inline_mapping(
                    f'<ssm:MappingEntry source="k" target="stiffness">{LINEAR.format(2.0, 1.0)}</ssm:MappingEntry>'
                ),
            ),
            "",
            "31.0 N.m/rad",
        ),
        (
            binding(
                parameters(value("k", '<ssv:Real value="15"/>')),
                '<ssd:ParameterMapping source="resources/m.ssm"/>',
            ),
            "",
            "45.0 N.m/rad",
        ),
    ],
)
def test_parameters(binding_: str, above: str, stiffness: str, pack: Callable[..., Path]) -> None:
    """Inline, from a file, of a system around, with a prefix, with a unit, mapped: the higher level goes before."""
    files = {
        "resources/p.ssv": parameters(value("stiffness", '<ssv:Real value="31"/>')),
        "resources/m.ssm": f'<ssm:ParameterMapping{SPACES} version="1.0">'
        '<ssm:MappingEntry source="k" target="stiffness">'
        f"{LINEAR.format(3.0, 0.0)}</ssm:MappingEntry></ssm:ParameterMapping>",
    }
    package = pack(with_binding(binding_, above), files)
    assert load_scenario("incline30").replace_fmu("brace", package).parameters["brace.stiffness"] == stiffness


def test_a_value_without_a_unit_is_in_that_of_its_connector(pack: Callable[..., Path]) -> None:
    """A parameter of a system in kN.m/rad, which leads to one of an FMU in N.m/rad, through two levels."""
    k = real("k", "parameter", "kN.m/rad")
    inner = system(PLAIN, THROUGH + wire("q", "brace.stiffness"), OUTSIDE + k.replace('"k"', '"q"'), name="inner")
    for given in ('value="0.03"', 'value="30" unit="N.m/rad"'):
        values = parameters(value("k", f"<ssv:Real {given}/>"), UNITS.replace("ssd:U", "ssv:U"))
        content = system(inner, THROUGH.replace("brace", "inner") + wire("k", "inner.q"), OUTSIDE + k, binding(values))
        scenario = load_scenario("incline30").replace_fmu("brace", pack(structure(content)))
        assert scenario.parameters["brace.stiffness"] == "30.0 N.m/rad"
    content = system(
        PLAIN, THROUGH + wire("k", "brace.stiffness"), OUTSIDE + k.replace("kN.m/rad", "N.m"), binding(values)
    )
    with pytest.raises(InputError, match=r"N.m/rad .* is not N.m "):
        landed(pack(structure(content)))


def test_a_start_value_of_what_the_plant_feeds_is_left_out(pack: Callable[..., Path], braced: np.ndarray) -> None:
    """Others write one for every input. An output that is no signal of the contract, and one that nothing feeds, are
    said as well."""
    package = pack(
        structure(
            system(
                PLAIN,
                THROUGH + wire("brace.subtalar_torque", "ankle_torqe"),
                OUTSIDE + real("ankle_torqe", "output") + real("talocrural_torque", "output"),
                binding(parameters(value("subtalar_angle", '<ssv:Real value="0.5"/>'))),
            )
        )
    )
    scenario = load_scenario("incline30").replace_fmu("brace", package)
    assert np.array_equal(angles(scenario), braced)
    for words in (
        "brace.subtalar_angle: is fed by plant.subtalar_angle; its start value is left out",
        "output ankle_torqe of the system is no signal of the contract; left out",
        "output talocrural_torque of the system is fed by nothing",
    ):
        assert any(words in warning for warning in scenario.warnings)


def test_what_is_left_out_is_said(pack: Callable[..., Path]) -> None:
    """The standard ignores values without a parameter; here a warning names them."""
    package = pack(with_binding(binding(parameters(value("stifness", '<ssv:Real value="30"/>')))))
    scenario = load_scenario("incline30").replace_fmu("brace", package)
    assert any("stifness: there is no such parameter" in warning for warning in scenario.warnings)


def test_a_parameter_set_inside_an_fmu(brace: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """--set brace=@NAME: by the set's own name or its file's; a name that is none is answered with those there are."""
    fmu = tmp_path / "with_sets.fmu"
    fmu.write_bytes(brace.read_bytes())
    with zipfile.ZipFile(fmu, "a") as archive:
        archive.writestr("resources/stiff.ssv", parameters(STIFF))
    run = ["run", "incline30", "--fmu", f"brace={fmu}", "--json", "--set"]
    found = []
    for setting in ("brace=@stiff", "brace=@p", "brace.stiffness=30 N.m/rad"):
        assert _run([*run, setting], []) == 0
        found.append(json.loads(capsys.readouterr().out)["metrics"])
    assert found[0] == found[1] == found[2]
    assert _run([*run, "brace=@soft"], []) == 2
    assert "has no parameter set of that name; it has p, stiff" in capsys.readouterr().err
    with zipfile.ZipFile(fmu, "a") as archive:
        archive.writestr("resources/old/stiff.ssv", parameters(STIFF.replace("30", "3")))
    assert _run([*run, "brace=@stiff"], []) == 2
    assert "has several of that name: resources/stiff.ssv, resources/old/stiff.ssv" in capsys.readouterr().err


# ---- what is supported, row by row


def _skipped() -> dict[str, str]:
    line = 'x1="0" y1="0" x2="1" y2="1"'
    return {
        "ElementGeometry": DEVICE.replace(
            "</ssd:Connectors></ssd:Component>", f"</ssd:Connectors><ssd:ElementGeometry {line}/></ssd:Component>"
        ),
        "ConnectorGeometry": DEVICE.replace(
            '<ssc:Real unit="rad"/>', '<ssc:Real unit="rad"/><ssd:ConnectorGeometry x="0" y="0.5"/>'
        ),
        "ConnectionGeometry": DEVICE.replace(
            "></ssd:Connection>", '><ssd:ConnectionGeometry pointsX="0" pointsY="0"/></ssd:Connection>'
        ),
        "SystemGeometry": DEVICE.replace(
            "</ssd:Connections></ssd:System>", f"</ssd:Connections><ssd:SystemGeometry {line}/></ssd:System>"
        ),
        "GraphicalElements": DEVICE.replace(
            "</ssd:Connections></ssd:System>",
            f'</ssd:Connections><ssd:GraphicalElements><ssd:Note {line} text=""/></ssd:GraphicalElements></ssd:System>',
        ),
        "Note": DEVICE.replace(
            "</ssd:Connections></ssd:System>",
            f'</ssd:Connections><ssd:GraphicalElements><ssd:Note {line} text=""/></ssd:GraphicalElements></ssd:System>',
        ),
        "MetaData": DEVICE.replace('version="1.0"', 'version="2.0"').replace(
            "<ssd:Units>", '<ssd:MetaData kind="general"/><ssd:Units>'
        ),
    }


@pytest.mark.parametrize("element", [name for name, (treatment, _) in SUPPORT.items() if treatment == SKIPPED])
def test_a_drawing_changes_nothing(element: str, pack: Callable[..., Path]) -> None:
    assert list(load_scenario("incline30").replace_fmu("brace", pack(_skipped()[element])).fmus)[-1] == "brace"


@pytest.mark.parametrize("element", [name for name, (treatment, _) in SUPPORT.items() if treatment == "refused"])
def test_what_is_refused_is_named(element: str, pack: Callable[..., Path]) -> None:
    content = DEVICE.replace("<ssd:Units>", f"<ssd:{element}/><ssd:Units>")
    with pytest.raises(InputError, match=f"{element}: .*not supported"):
        landed(pack(content))


def test_the_table_of_the_docs_is_the_code_s() -> None:
    text = (ROOT / "docs" / "ssp.md").read_text()
    for name, (treatment, _) in SUPPORT.items():
        assert f"`{name}`" in text, name
        line = next(line for line in text.splitlines() if f"`{name}`" in line and line.startswith("|"))
        assert {READ: "read", SKIPPED: "skipped"}.get(treatment, "refused") in line, name


SUBTALAR_IN = real("subtalar_angle", "input", "rad")
MALFORMED = {  # what is changed in DEVICE: the words of the message
    ("<ssd:Units>", "<ssd:Unites>"): "XML",
    ('version="1.0"', ""): "version ''",
    ('version="1.0"', 'version="3.0"'): "version '3.0'",
    ('version="1.0"', 'version="1.1"'): "version '1.1'",
    ('version="1.0" name="test"', 'version="1.0"'): "name",
    ("SystemStructureDescription", "SystemStructure"): "expected SystemStructureDescription",
    (SPACES, SPACES.replace("SSP1", "SSP0")): "expected SystemStructureDescription",
    ('source="resources/brace.fmu"', 'source="resources/brase.fmu"'): "has no resources/brase.fmu",
    ('source="resources/brace.fmu"', 'source="../brace.fmu"'): "leads out of the package",
    ('source="resources/brace.fmu"', 'source="file:///etc/passwd"'): "no path inside the package",
    ('source="resources/brace.fmu"', 'source="http://example.org/brace.fmu"'): "no path inside the package",
    ('source="resources/brace.fmu"', 'source="SystemStructure.ssd"'): "not a readable zip archive",
    ('source="resources/brace.fmu"', 'source=""'): "leads out of the package",
    ('source="resources/brace.fmu"', ""): "source",
    (
        'source="resources/brace.fmu"',
        'source="resources/brace.fmu" type="application/x-ssp-package"',
    ): "is an FMU, not an SSP package",
    ('source="resources/brace.fmu"', 'source="resources/brace.fmu" type="text/xml"'): "of type text/xml",
    ('source="resources/brace.fmu"', 'source="resources/brace.fmu" implementation="Both"'): "implementation",
    (
        'source="resources/brace.fmu"',
        'source="resources/brace.fmu" implementation="ModelExchange"',
    ): "implementation ModelExchange is asked for",
    (
        real("subtalar_angle", "input", "rad"),
        real("subtalar_angle", "output", "rad"),
    ): "output in the document and input",
    ('endConnector="subtalar_torque"', 'endConnector="torque"'): "no connector torque",
    ('startElement="brace"', 'startElement="brase"'): "there is no element brase",
    ('kind="output"', 'kind="inout"'): "inout is not supported",
    ('kind="output"', 'kind="sideways"'): "sideways",
    ('unit="rad"', 'unit="grad"'): "unit 'grad' is not defined",
    ('unit="rad"', 'unit="deg"'): "deg in the document and rad in the FMU",
    ('rad="1"', 'rad="one"'): "one",
    ('factor="0.001"', 'factor="0"'): "must be positive",
    ('factor="0.001"', 'factor="INF"'): "must be finite",
    ('kg="1" m="2"', 'kg="1.5" m="2"'): "1.5",
    (SUBTALAR_IN, real("angle", "input", "rad")): "has no such variable",
    (THROUGH, THROUGH * 2): "is fed twice",
    (
        wire("subtalar_angle", "brace.subtalar_angle"),
        wire("subtalar_torque", "brace.subtalar_angle"),
    ): "joins two that take",
    (THROUGH, wire("subtalar_angle", "brace.subtalar_angle")): "none of the system's own outputs is a torque",
    (PLAIN, PLAIN * 2): "two elements are named brace",
    ("></ssd:Connection>", ">" + LINEAR.format("x", 0) + "</ssd:Connection>"): "x",
    ("></ssd:Connection>", ">" + LINEAR.format(0, 0) + "</ssd:Connection>"): "its factor is 0",
    ("></ssd:Connection>", ">" + LINEAR.format("NaN", 0) + "</ssd:Connection>"): "must be finite",
    (
        "></ssd:Connection>",
        '><ssc:BooleanMappingTransformation><ssc:MapEntry source="true" target="false"/>'
        "</ssc:BooleanMappingTransformation></ssd:Connection>",
    ): "supported for parameters only",
    (OUTSIDE, real("other", "input") + OUTSIDE): "",
    (
        PLAIN,
        PLAIN.replace("</ssd:Component>", binding() + "</ssd:Component>"),
    ): "needs a source",
    (PLAIN, PLAIN.replace("</ssd:Component>", binding(more='source="p.ssv"') + "</ssd:Component>")): "has no p.ssv",
    (
        PLAIN,
        PLAIN.replace("</ssd:Component>", binding(more='source="p" type="text/csv"') + "</ssd:Component>"),
    ): "type text/csv are not supported",
    (
        PLAIN,
        PLAIN.replace(
            "</ssd:Component>", binding(parameters(value("stiffness", '<ssv:Real value="x"/>'))) + "</ssd:Component>"
        ),
    ): "x",
    (
        PLAIN,
        PLAIN.replace(
            "</ssd:Component>", binding(parameters(value("stiffness", '<ssv:Real value="NaN"/>'))) + "</ssd:Component>"
        ),
    ): "must be finite",
    (
        PLAIN,
        PLAIN.replace(
            "</ssd:Component>",
            binding(parameters(value("stiffness", '<ssv:Boolean value="true"/>'))) + "</ssd:Component>",
        ),
    ): "is Boolean in the parameter set",
    (
        PLAIN,
        PLAIN.replace(
            "</ssd:Component>",
            binding(parameters(value("stiffness", '<ssv:Real value="1" unit="m"/>'))) + "</ssd:Component>",
        ),
    ): "unit 'm' is not defined",
    (
        PLAIN,
        PLAIN.replace("</ssd:Component>", binding(parameters(STIFF), inline_mapping("")) + "</ssd:Component>"),
    ): "",
    (
        PLAIN,
        PLAIN.replace(
            "</ssd:Component>",
            binding(parameters(STIFF), inline_mapping('<ssm:MappingEntry source="k" target="stiffness"/>'))
            + "</ssd:Component>",
        ),
    ): "maps k, which the parameter set does not have",
    (
        PLAIN,
        PLAIN.replace(
            "</ssd:Component>",
            binding(parameters(STIFF), inline_mapping('<ssm:MappingEntry source="stiffness" target="stiffness"/>' * 2))
            + "</ssd:Component>",
        ),
    ): "two entries map to stiffness",
    (
        PLAIN,
        PLAIN.replace(
            "</ssd:Component>",
            binding(parameters(value("subtalar_torque", '<ssv:Real value="1"/>'))) + "</ssd:Component>",
        ),
    ): "is of causality output",
    ("<ssd:Units>", "<ssd:Wheels/><ssd:Units>"): "Wheels: no element of SSP",
    ("<ssd:Units>", '<wheels xmlns="urn:x"/><ssd:Units>'): "of another namespace",
    ("<ssd:SystemStructureDescription", "<!DOCTYPE x []><ssd:SystemStructureDescription"): "DOCTYPE",
    (' version="1.0"', ' version="1.0" speed="3"'): "speed",
    ('name="test"', 'name="test" generationDateAndTime="yesterday"'): "yesterday",
}


@pytest.mark.parametrize("number", range(len(MALFORMED)))
def test_malformed(number: int, pack: Callable[..., Path], capsys: pytest.CaptureFixture[str]) -> None:
    """One line, exit code 2; what the standard allows though it looks odd is read."""
    (before, after), words = list(MALFORMED.items())[number]
    assert before in DEVICE
    package = pack(DEVICE.replace(before, after))
    code = _run(["ssp", "check", str(package)], [])
    said = capsys.readouterr().err
    if not words:
        assert code in (0, 2)
        assert "internal" not in said
        return
    assert code == 2
    assert words in said
    assert len(said.splitlines()) == 1


def test_files_that_are_none(pack: Callable[..., Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Each is called what it is, in one line, with what to type instead."""
    for name, content in (("empty.ssp", b""), ("text.ssp", b"hello"), ("a.toml", b"[components]"), ("a.ssd", b"<")):
        (tmp_path / name).write_bytes(content)
    (tmp_path / "folder.ssp").mkdir()
    (tmp_path / "deep.ssp").write_bytes(b"")
    with zipfile.ZipFile(tmp_path / "deep.ssp", "w") as archive:
        archive.writestr("landing/SystemStructure.ssd", DEVICE)
    (tmp_path / "package.fmu").write_bytes(pack(DEVICE).read_bytes())
    plant = str(FMUS / "plant.fmu")
    (tmp_path / "fmu.ssp").write_bytes((FMUS / "plant.fmu").read_bytes())
    for command, name, words in (
        ("ssp check", "empty.ssp", "is empty"),
        ("ssp check", "text.ssp", "no readable zip archive"),
        ("ssp check", "a.toml", "no readable zip archive"),
        ("ssp check", "a.ssd", "zip it as SystemStructure.ssd with the files it names"),
        ("run", "a.ssd", "zip it as SystemStructure.ssd with the files it names"),
        ("ssp check", "folder.ssp", "is a folder, not an SSP package"),
        ("ssp check", "none.ssp", "no such file"),
        ("ssp check", "deep.ssp", "it lies in its folder landing"),
        ("ssp check", "fmu.ssp", f"is an FMU, not an SSP package; `sprain-cosim check {tmp_path / 'fmu.ssp'}`"),
        ("ssp check", plant, f"is an FMU, not an SSP package; `sprain-cosim check {plant}`"),
        ("check", "package.fmu", "is an SSP package, not an FMU; `sprain-cosim ssp check` takes it"),
        ("check", "folder.ssp", "is a folder, not an FMU"),
        ("run incline30 --fmu", f"brace={tmp_path / 'package.fmu'}", "is an SSP package, not an FMU"),
    ):
        file = name if "=" in name else str(tmp_path / name)
        assert _run([*command.split(), file], []) == 2
        (said,) = capsys.readouterr().err.splitlines()
        assert words in said


def test_a_check_reads_a_package_once(pack: Callable[..., Path], monkeypatch: pytest.MonkeyPatch) -> None:
    read = []
    monkeypatch.setattr(flat, "structure", lambda package: read.append(package.path) or structure_of(package))
    package = pack(DEVICE)
    inspected(package)
    assert read == [package]


# ---- an oracle that nobody here wrote

ORACLE = """
import json, os, sys
from ecospy import EcosSimulation
path, steps, *names = sys.argv[1:]
simulation = EcosSimulation(0.0005, ssp_path=path)
simulation.init(parameter_set="landing")
rows = [[simulation.get_real(name) for name in names]]
for _ in range(int(steps)):
    simulation.step(1)
    rows.append([simulation.get_real(name) for name in names])
print("ROWS" + json.dumps(rows), flush=True)
os._exit(0)  # once in some forty runs ecos crashes as it takes itself down
"""


@pytest.mark.skipif(
    not ECOS.exists(), reason=f"no environment with ecospy and tbb ({ECOS}); make one and set SPRAIN_ECOS to its Python"
)
@pytest.mark.parametrize("name", ["level", "incline30", "incline30_brace"])
def test_ecos_runs_the_package(name: str, tmp_path: Path) -> None:
    """Fixed-step Jacobi in ecos: our scheme jacobi to rounding."""
    export_package(load_scenario(name), tmp_path / "landing.ssp")
    library = str(ECOS.parent.parent / "lib")
    run = subprocess.run(
        [ECOS, "-c", ORACLE, tmp_path / "landing.ssp", "300", "plant::subtalar_angle"],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "LD_LIBRARY_PATH": library},
        timeout=300,
    )
    assert run.returncode == 0, run.stderr[-2000:]
    line = next(line for line in run.stdout.splitlines() if line.startswith("ROWS"))
    theirs = np.array(json.loads(line.removeprefix("ROWS")))[:, 0]
    scenario = load_scenario(tmp_path / "landing.ssp").with_master("jacobi", identify=0)
    ours = angles(replace(scenario, master=replace(scenario.master, guard=False)))
    assert np.ptp(ours) > 0.1
    assert np.abs(ours - theirs).max() < 1e-12


def by_omsimulator(file: Path) -> np.ndarray:
    """plant.subtalar_angle (301,) [rad] as OMSimulator's command line runs a package or an FMU."""
    out = file.with_suffix(".csv")
    options = ["--stripRoot=true", "--mode=cs", "--stepSize=0.0005", "--stopTime=0.15", f"--resultFile={out.name}"]
    command = [OMSIMULATOR, *options, f"--tempDir={file.parent}", file.name]
    run = subprocess.run(command, cwd=file.parent, capture_output=True, text=True, check=False, timeout=300)
    assert run.returncode == 0, run.stdout[-2000:] + run.stderr[-2000:]
    head, *rows = list(csv.reader(out.read_text().splitlines()))
    column = head.index("plant.subtalar_angle")
    last = {round(float(row[0]) / 0.0005): float(row[column]) for row in rows}  # of several rows of one time
    return np.array([last[k] for k in range(301)])


@pytest.mark.skipif(not OMSIMULATOR.exists(), reason=f"no OMSimulator ({OMSIMULATOR}); set SPRAIN_OMSIMULATOR")
@pytest.mark.parametrize(
    "name", ["level", "incline30", "incline30_reflex", "incline30_coactivation", "incline30_brace", "incline30_mixed"]
)
def test_omsimulator_runs_the_package(name: str, tmp_path: Path) -> None:
    """Its master is our scheme gauss-seidel; its result file has 12 digits."""
    scenario = load_scenario(name).with_master("gauss-seidel")
    export_package(scenario, tmp_path / "landing.ssp")
    assert np.abs(by_omsimulator(tmp_path / "landing.ssp") - angles(scenario)).max() < 1e-11


@pytest.mark.skipif(not OMSIMULATOR.exists(), reason=f"no OMSimulator ({OMSIMULATOR}); set SPRAIN_OMSIMULATOR")
def test_omsimulator_runs_a_container(tmp_path: Path) -> None:
    scenario = load_scenario("incline30_mixed")
    export_container(scenario, tmp_path / "landing.fmu")
    assert np.abs(by_omsimulator(tmp_path / "landing.fmu") - angles(scenario)).max() < 1e-11
