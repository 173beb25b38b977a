"""A landing as one FMU: in the hands of others it gives the master's numbers, says what went wrong, and what it cannot
carry is refused by name."""

from __future__ import annotations

import json
import os
import subprocess
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest
from fmpy.fmi2 import FMU2Slave

from sprain_cosim.cli import _run
from sprain_cosim.cosim import native_libraries
from sprain_cosim.errors import InputError, SimulationError
from sprain_cosim.export.container import export_container
from sprain_cosim.fmu.component import Component
from sprain_cosim.scenario import Scenario, load_scenario
from sprain_cosim.shipped import FMUS
from tests.fmi.test_libcosim import PYTHON as LIBCOSIM
from tests.fmi.test_ssp import ECOS
from tests.native import FAULTS, SOURCES, compile_fmu, device
from tests.systems import structure, system

STEP, STEPS = 5e-4, 300
SHORT = 60  # steps of tests that need no whole landing
NEAR = 1e-12


def written(scenario: Scenario, folder: Path, name: str = "landing") -> Path:
    export_container(scenario, folder / f"{name}.fmu")
    return folder / f"{name}.fmu"


@pytest.fixture(scope="module")
def mapped(tmp_path_factory: pytest.TempPathFactory) -> Scenario:
    """A foreign brace in degrees and N.mm, which it does not declare, pushing, under names of its own."""
    folder = tmp_path_factory.mktemp("mapped")
    fmu = device(folder / "vendor.fmu", sign=-1.0, angle="deg", torque="N.mm", names=("In1", "M"), declared=False)
    (folder / "map.toml").write_text(
        '[inputs]\nsubtalar_angle = { to = "In1", unit = "deg", offset = 1.5 }\n'
        '[outputs]\nsubtalar_torque = { from = "M", unit = "N.mm", factor = -1 }\n'
    )
    scenario = load_scenario("incline30").replace_fmu("brace", fmu, folder / "map.toml")
    return scenario.override("brace.stiffness", 30.0)


@pytest.fixture(scope="module")
def faulty(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A container with a brace that has the fault which its parameter `fault` names, with the number of FAULTS."""
    folder = tmp_path_factory.mktemp("faulty")
    scenario = load_scenario("incline30").replace_fmu("brace", compile_fmu(folder / "brace.fmu"))
    return written(scenario.with_master("gauss-seidel"), folder)


class Host:
    """One instance in the hands of fmpy's plain interface; `said` is what its logger got."""

    def __init__(self, fmu: Path, folder: Path) -> None:
        self.md = fmpy.read_model_description(str(fmu), validate=True)
        self.vr = {v.name: v.valueReference for v in self.md.modelVariables}
        place = fmpy.extract(str(fmu), str(folder))
        identifier = self.md.coSimulation.modelIdentifier
        self.fmu = FMU2Slave(guid=self.md.guid, unzipDirectory=place, modelIdentifier=identifier, instanceName="it")
        self.said: list[str] = []
        kind = fmpy.fmi2.fmi2CallbackLoggerTYPE
        logger = kind(lambda env, name, status, category, text: self.said.append(f"{status} {text.decode()}"))
        self.callbacks = fmpy.fmi2.fmi2CallbackFunctions()
        self.callbacks.logger = logger
        self.callbacks.allocateMemory = fmpy.fmi2.fmi2CallbackAllocateMemoryTYPE(fmpy.calloc)
        self.callbacks.freeMemory = fmpy.fmi2.fmi2CallbackFreeMemoryTYPE(fmpy.free)
        self.fmu.instantiate(callbacks=self.callbacks)

    def start(self, values: Mapping[str, float] | None = None) -> None:
        self.fmu.setupExperiment(startTime=0.0)
        self.fmu.enterInitializationMode()
        for name, value in (values or {}).items():
            (self.fmu.setReal if isinstance(value, float) else self.fmu.setInteger)([self.vr[name]], [value])
        self.fmu.exitInitializationMode()

    def angle(self) -> float:
        return float(self.fmu.getReal([self.vr["plant.subtalar_angle"]])[0])

    def run(self, steps: int = SHORT, size: int = 1) -> list[float]:
        found = [self.angle()]
        for k in range(0, steps, size):
            self.fmu.doStep(k * STEP, size * STEP)
            found.append(self.angle())
        return found

    def refused(self, call: Any, *arguments: Any) -> str:
        """What is said when a call does not succeed."""
        before = len(self.said)
        with pytest.raises(Exception, match="status"):
            call(*arguments)
        (line,) = self.said[before:][:1]
        return line


@pytest.fixture
def brought(tmp_path: Path) -> Iterator[Any]:
    hosts: list[Host] = []

    def bring(fmu: Path) -> Host:
        hosts.append(Host(fmu, tmp_path / f"unpacked{len(hosts)}"))
        return hosts[-1]

    yield bring
    for host in hosts:
        host.fmu.freeInstance()


def ours(scenario: Scenario, scheme: str | None = None) -> Any:
    result = scenario.with_master(scheme).run(in_process=True)
    assert result.status == "completed", result.message
    return result


@pytest.mark.parametrize(
    ("name", "scheme"),
    [
        ("incline30_mixed", "auto"),  # impedance hand-over
        ("incline30_reflex", "auto"),  # gauss-seidel, excitations at rest, outputs with direct feed-through
        ("incline30_brace", "jacobi"),
        ("step_edge", "auto"),
        ("mapped", "gauss-seidel"),
        ("mapped", "jacobi"),
        ("fmi3", "auto"),
    ],
)
def test_every_output_is_the_master_s(name: str, scheme: str, mapped: Scenario, tmp_path: Path) -> None:
    """In fmpy's own simulation, with its validation; an FMU's variables under its own names, in its own units."""
    if name == "fmi3":
        scenario = load_scenario("incline30_mixed").replace_fmu("plant", FMUS / "plant_fmi3.fmu")
        scenario = scenario.replace_fmu("brace", FMUS / "brace_bushing_fmi3.fmu")
    else:
        scenario = mapped if name == "mapped" else load_scenario(name)
    scenario = scenario.with_master(scheme, stop="60 ms")
    fmu, result = written(scenario, tmp_path), ours(scenario)
    described = fmpy.read_model_description(str(fmu), validate=True)
    names = [v.name for v in described.modelVariables if v.causality == "output"]
    theirs = fmpy.simulate_fmu(str(fmu), stop_time=0.06, step_size=STEP, output_interval=STEP, output=names)
    for full in names:
        expected = result["brace.subtalar_torque" if full == "brace.M" else full]
        assert np.abs(theirs[full] - expected).max() <= NEAR * max(1.0, np.abs(expected).max()), full
    assert len(names) > 50


def test_parameters_are_the_landing_s(tmp_path: Path, brought: Any) -> None:
    """Set by the host, numbers and names: the master's landing with them; a reset brings back those of the export."""
    scenario = load_scenario("incline30_mixed").with_master(stop="30 ms")
    host = brought(written(scenario, tmp_path))
    host.start()
    first = host.run()
    assert first == ours(scenario)["plant.subtalar_angle"].tolist()
    host.fmu.reset()
    choice = next(v for v in host.md.modelVariables if v.name == "plant.initial_pose")
    pose = next(item for item in choice.declaredType.items if item.name == "published")
    values = {"plant.drop_height": 0.35, "brace.angle_scale": 2.0, "plant.initial_pose": int(pose.value)}
    assert choice.start != str(pose.value)
    host.start(values)
    changed = scenario.override("plant.drop_height", "0.35 m").override("brace.angle_scale", 2.0)
    changed = changed.override("plant.initial_pose", "published")
    assert host.run() == ours(changed)["plant.subtalar_angle"].tolist()
    host.fmu.reset()
    host.start()
    assert host.run(size=4) == first[::4]


def test_two_instances_do_not_disturb_each_other(tmp_path: Path, brought: Any) -> None:
    fmu = written(load_scenario("incline30_reflex"), tmp_path)
    one, other = brought(fmu), brought(fmu)
    one.start()
    other.start({"plant.drop_height": 0.2})
    mixed = []
    for k in range(SHORT):
        for host in (one, other):
            host.fmu.doStep(k * STEP, STEP)
        mixed.append((one.angle(), other.angle()))
    alone = brought(fmu)
    alone.start()
    assert [a for a, _ in mixed] == alone.run()[1:]
    assert mixed[-1][0] != mixed[-1][1]


def test_values_at_the_start_follow_what_is_set(tmp_path: Path, brought: Any) -> None:
    """Also between the entry of the initialisation and its end, where a host may look and set again."""
    host = brought(written(load_scenario("incline30"), tmp_path))
    host.fmu.setupExperiment(startTime=0.0)
    host.fmu.enterInitializationMode()
    seen = []
    for degrees in (0.0, 5.0):
        host.fmu.setReal([host.vr["plant.subtalar_angle_at_contact"]], [np.radians(degrees)])
        seen.append(np.degrees(host.angle()))
    assert seen == pytest.approx([0.0, 5.0], abs=1e-12)
    host.fmu.exitInitializationMode()
    assert np.degrees(host.run(10)[0]) == pytest.approx(5.0)


def test_what_a_host_is_told(tmp_path: Path, brought: Any) -> None:
    """Every mistake of a host, and an error of an FMU inside in that FMU's own words."""
    host = brought(written(load_scenario("incline30_brace"), tmp_path))
    reference = host.vr["plant.drop_height"]
    assert "a step before the end of the initialisation" in host.refused(host.fmu.doStep, 0.0, STEP)
    assert "no parameter with value reference" in host.refused(host.fmu.setReal, [10**6], [1.0])
    assert "is of another type" in host.refused(host.fmu.setInteger, [reference], [1])
    assert "drop_height = -9 m: must lie between" in host.refused(host.start, {"plant.drop_height": -9.0})
    assert "after an error" in host.refused(host.fmu.exitInitializationMode)
    host.fmu.reset()
    host.start()
    assert "no whole multiple of its own, 0.0005 s" in host.refused(host.fmu.doStep, 0.0, 7e-4)
    assert "a step from 0.5 s, and it is at 0 s" in host.refused(host.fmu.doStep, 0.5, STEP)
    assert "only be set before the run" in host.refused(host.fmu.setReal, [reference], [0.2])
    assert "saved states are not offered" in host.refused(host.fmu.getFMUState)
    assert host.run() == ours(load_scenario("incline30_brace"))["plant.subtalar_angle"][: SHORT + 1].tolist()
    host.fmu.guid = "another"
    with pytest.raises(Exception, match="nstantiate"):
        host.fmu.instantiate(callbacks=host.callbacks)
    assert "the GUID another is not that of this plan" in host.said[-1] + host.said[-2]


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("error", "brace: reported an error in the step from"),
        ("discard", "brace: discarded the call in the step from"),
        ("nan", "brace: an output is not finite at"),
        ("fatal", "brace: reported a fatal error in the step from"),
    ],
)
def test_a_fault_of_an_fmu_inside_reaches_the_host(fault: str, words: str, faulty: Path, brought: Any) -> None:
    host = brought(faulty)
    host.start({"brace.fault": float(FAULTS.index(fault))})
    with pytest.raises(fmpy.fmi1.FMICallException):
        host.run()
    assert any(words in line for line in host.said)
    assert "after an error" in host.refused(host.fmu.doStep, 0.0, STEP)


def sampled(folder: Path) -> Scenario:
    fmu = compile_fmu(folder / "slow.fmu")
    (folder / "slow.toml").write_text('step = "10 ms"\n')
    return load_scenario("incline30").replace_fmu("brace", fmu, folder / "slow.toml")


def cables(folder: Path) -> Scenario:
    fmu = device(folder / "cables.fmu", cables=True, names=("subtalar_angle", "whole"))
    (folder / "cables.toml").write_text(
        '[outputs]\nsubtalar_torque = { from = ["medial", "lateral"], factor = [1, -1], arm = "40 mm" }\n'
    )
    return load_scenario("incline30").replace_fmu("brace", fmu, folder / "cables.toml")


def undeclared(folder: Path) -> Scenario:
    return load_scenario("incline30").replace_fmu("brace", compile_fmu(folder / "brace.fmu")).with_master("impedance")


REFUSED = {
    "adaptive": (lambda folder: load_scenario("incline30_brace").with_master(adaptive="0.1 %"), "leave adaptive out"),
    "coarse": (
        lambda folder: load_scenario("incline30_brace").with_master(communication_step="1 ms"),
        "communication step 1 ms: the master stops the plant within it to record; leave it at 0.5 ms",
    ),
    "iterative": (lambda folder: load_scenario("incline30_brace").with_master("iterative"), "choose one with --scheme"),
    "sampled": (sampled, "brace: is called at a rate of its own, every 10 ms; a container has one rate"),
    "sum": (cables, "brace.subtalar_torque: is the sum of several outputs"),
    "stiffness to be found": (undeclared, "brace.subtalar_torque declares no stiffness or damping"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_it_cannot_carry_is_refused_by_name(name: str, tmp_path: Path) -> None:
    make, words = REFUSED[name]
    with pytest.raises(InputError) as problem:
        export_container(make(tmp_path), tmp_path / "x.fmu")
    assert words in str(problem.value)
    assert not (tmp_path / "x.fmu").exists()


def test_a_landing_that_does_not_run_is_not_written(tmp_path: Path) -> None:
    fmu = compile_fmu(tmp_path / "brace.fmu", fault="error")
    scenario = load_scenario("incline30").replace_fmu("brace", fmu).with_master("gauss-seidel")
    with pytest.raises(SimulationError, match="brace: reported an error"):
        export_container(scenario, tmp_path / "x.fmu")


def test_bytes_and_words(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """The same bytes every time; the command line with its endings; an FMU by our own reader; a library that is of
    another source is not packed."""
    for name in ("a", "b"):
        command = ["ssp", "export", "level", "--container", "--scheme", "jacobi", "-o", str(tmp_path / f"{name}.fmu")]
        assert _run(command, []) == 0
    said = capsys.readouterr().out
    assert "steps by jacobi; the host's communication step must be 0.5 ms or a whole multiple" in said
    assert "peak_subtalar_angle_deg is 1.04055 in the same landing" in said
    assert (tmp_path / "a.fmu").read_bytes() == (tmp_path / "b.fmu").read_bytes()
    read = Component.read("a", tmp_path / "a.fmu")
    assert not read.library_problem()
    assert not read.complaints()
    plant = Component.read("plant", FMUS / "plant.fmu")
    for name, own in {**plant.parameters, **plant.outputs}.items():
        other = read.connectors[f"plant.{name}"]
        assert (other.unit, other.minimum, other.maximum) == (own.unit, own.minimum, own.maximum)
        assert (other.items, other.description) == (own.items, own.description)
    assert _run(["check", str(tmp_path / "a.fmu")], []) == 1
    assert "is a landing with its plant inside" in capsys.readouterr().out
    for options, words in (
        (["-o", "x.ssp", "--container"], "must end in .fmu"),
        (["-o", "x.fmu"], "must end in .ssp"),
        (["-o", "x.fmu", "--container", "--version", "2.0"], "a container is an FMU of FMI 2.0"),
    ):
        assert _run(["ssp", "export", "level", *options], []) == 2
        assert words in capsys.readouterr().err
    monkeypatch.setattr(native_libraries, "source_digest", lambda name: "0" * 64)
    assert _run(["ssp", "export", "level", "--container", "-o", str(tmp_path / "c.fmu")], []) != 0
    assert "is not built for this source" in capsys.readouterr().err


def test_a_host_in_c(tmp_path: Path) -> None:
    program = tmp_path / "host"
    subprocess.run(["gcc", "-o", program, SOURCES / "landing_host.c", "-ldl"], check=True)
    scenario = load_scenario("incline30_brace")
    fmu = written(scenario, tmp_path)
    described = fmpy.read_model_description(str(fmu))
    place = tmp_path / "with space"
    with zipfile.ZipFile(fmu) as archive:
        archive.extractall(place)
    reference = {v.name: str(v.valueReference) for v in described.modelVariables}
    command = [program, place / "binaries/linux64" / f"{described.modelName}.so", described.guid]
    command += [(place / "resources").as_uri(), reference["plant.subtalar_angle"], str(STEP), str(STEPS)]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stdout[-500:]
    assert np.array(ended.stdout.split(), dtype=float).tolist() == ours(scenario)["plant.subtalar_angle"][1:].tolist()


def near(theirs: list[float], scenario: Scenario) -> None:
    assert np.abs(np.array(theirs) - ours(scenario)["plant.subtalar_angle"][1:]).max() <= NEAR


ORACLE = """
import json, os, sys
from ecospy import EcosSimulation
simulation = EcosSimulation(0.0005, ssp_path=sys.argv[1])
simulation.init()
rows = []
for _ in range(int(sys.argv[2])):
    simulation.step(1)
    rows.append(simulation.get_real("landing::plant.subtalar_angle"))
print("ROWS" + json.dumps(rows), flush=True)
os._exit(0)  # once in some forty runs ecos crashes as it takes itself down
"""


@pytest.mark.skipif(not ECOS.exists(), reason=f"no environment with ecospy and tbb ({ECOS}); see test_ssp.py")
def test_ecos_runs_a_container(tmp_path: Path) -> None:
    """A co-simulation engine in C++, to which it is one FMU among others."""
    scenario = load_scenario("incline30_mixed")
    alone = '<ssd:Component name="landing" source="resources/landing.fmu"/>'
    with zipfile.ZipFile(tmp_path / "one.ssp", "w") as archive:
        archive.writestr("SystemStructure.ssd", structure(system(alone)))
        archive.write(written(scenario, tmp_path), "resources/landing.fmu")
    environment = {**os.environ, "LD_LIBRARY_PATH": str(ECOS.parent.parent / "lib")}
    command = [ECOS, "-c", ORACLE, tmp_path / "one.ssp", str(STEPS)]
    run = subprocess.run(command, capture_output=True, text=True, check=False, env=environment, timeout=300)
    assert run.returncode == 0, run.stderr[-2000:]
    near(json.loads(next(line for line in run.stdout.splitlines() if line.startswith("ROWS"))[4:]), scenario)


@pytest.mark.skipif(not LIBCOSIM.exists(), reason=f"no environment with libcosimpy ({LIBCOSIM}); see test_libcosim.py")
def test_libcosim_runs_a_container(tmp_path: Path) -> None:
    scenario = load_scenario("incline30_mixed")
    fmu = written(scenario, tmp_path)
    reference = Component.read("landing", fmu).outputs["plant.subtalar_angle"].reference
    task = {"step_ns": 500_000, "steps": STEPS, "fmus": {"landing": str(fmu)}, "connections": []}
    run = subprocess.run(
        [LIBCOSIM, Path(__file__).with_name("libcosim_run.py")],
        input=json.dumps({**task, "watch": [("landing", reference)]}),
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert run.returncode == 0, run.stderr
    near([row[0] for row in json.loads(run.stdout)], scenario)
