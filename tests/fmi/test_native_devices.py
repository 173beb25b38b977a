"""The shipped devices as compiled: the law of their Python source, saved states, what they say to their host, and hosts
that are not Python."""

from __future__ import annotations

import contextlib
import ctypes
import itertools
import subprocess
import sys
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave
from fmpy.validation import validate_fmu

from sprain_cosim.fmu.build.device import read_device
from sprain_cosim.fmu.build.interpreter import Interpreted
from sprain_cosim.fmu.component import Component
from sprain_cosim.fmu.driver import Driver
from sprain_cosim.fmu.messages import Log, loggers
from sprain_cosim.fmu.reference import experiments
from sprain_cosim.scenario import load_scenario
from sprain_cosim.shipped import FMI3, FMUS, SOURCES
from tests.native import SOURCES as C_SOURCES

DEVICES = sorted(p.parent.name for p in SOURCES.glob("*/device.py") if "template" not in p.parent.name)
_count = itertools.count(1)


class Host:
    """An instance driven through fmpy's plain wrapper, with what it logged; values by name."""

    def __init__(self, name: str | Path, folder: Path, guid: str | None = None) -> None:
        path = FMUS / f"{name}.fmu" if isinstance(name, str) else name
        self.description = read_model_description(path)
        self.reference = {v.name: v.valueReference for v in self.description.modelVariables}
        self.by = {
            c: [v.name for v in self.description.modelVariables if v.causality == c]
            for c in ("parameter", "input", "output")
        }
        self.folder = extract(path, str(folder / f"unpacked{next(_count)}"))
        self.log = Log("tested")  # all instances of a process share one logger
        self.fmu = FMU2Slave(
            guid=guid or self.description.guid,
            unzipDirectory=self.folder,
            modelIdentifier=self.description.coSimulation.modelIdentifier,
            instanceName=self.log.label,
        )
        self.fmu.instantiate(callbacks=loggers()[1])

    @property
    def messages(self) -> list[str]:
        return [text for _, text in self.log._recent]

    def __getitem__(self, names: str | list[str]) -> Any:
        many = [names] if isinstance(names, str) else names
        values = self.fmu.getReal([self.reference[n] for n in many])
        return values[0] if isinstance(names, str) else np.array(values)

    def __setitem__(self, names: str | list[str], values: Any) -> None:
        many = [names] if isinstance(names, str) else names
        self.fmu.setReal([self.reference[n] for n in many], list(np.atleast_1d(values)))

    def start(self, **parameters: float) -> None:
        self.fmu.setupExperiment(startTime=0.0)
        for name, value in parameters.items():
            self[name] = value
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()


class Host3:
    """The same in FMI 3.0; an error raises with fmpy's words, what was logged stands in `messages`."""

    def __init__(self, name: str, folder: Path, token: str | None = None) -> None:
        path = FMUS / f"{name}{FMI3}.fmu"
        self.description = read_model_description(path)
        self.reference = {v.name: v.valueReference for v in self.description.modelVariables}
        self.messages: list[str] = []
        self.fmu = FMU3Slave(
            guid=token or self.description.guid,
            unzipDirectory=extract(path, str(folder / f"unpacked{next(_count)}")),
            modelIdentifier=self.description.coSimulation.modelIdentifier,
            instanceName="tested",
        )
        self.fmu.instantiate(logMessage=lambda _, status, category, text: self.messages.append(text.decode()))

    def __getitem__(self, name: str) -> float:
        return float(self.fmu.getFloat64([self.reference[name]])[0])

    def __setitem__(self, name: str, value: float) -> None:
        self.fmu.setFloat64([self.reference[name]], [value])

    def start(self, **parameters: float) -> None:
        for name, value in parameters.items():
            self[name] = value
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()


def random_parameters(host: Host, rng: np.random.Generator) -> dict[str, float]:
    described = {v.name: v for v in host.description.modelVariables}
    drawn = {}
    for name in host.by["parameter"]:
        start, most = float(described[name].start), float(described[name].max)
        drawn[name] = min(most, start * (1 + rng.random()) if start else rng.random())
    return drawn | ({"reflex_delay": 0.013} if "reflex_delay" in drawn else {})


def test_there_are_devices() -> None:
    assert {"brace_bushing", "brace_table", "reflex_controller"} <= set(DEVICES)


@pytest.mark.parametrize("name", DEVICES)
def test_compiled_and_interpreted_are_the_same_law(name: str, tmp_path: Path) -> None:
    """Random parameters, inputs and steps, with steps that are taken back in between."""
    if name.startswith("plant"):
        pytest.skip("as plain Python the plant takes minutes; the landings of tests/paper hold it")
    host, device = Host(name, tmp_path), read_device(SOURCES / name)
    inputs, outputs = host.by["input"], host.by["output"]
    for seed in range(3):
        rng = np.random.default_rng(seed)
        run = Interpreted(device)
        host.fmu.reset()
        parameters, first = random_parameters(host, rng), 0.4 * rng.normal(size=len(inputs))
        for key, value in [*parameters.items(), *zip(inputs, first, strict=True)]:
            run[key] = value
        run.initialise()
        host[inputs] = first
        host.start(**parameters)
        time = 0.0
        for k in range(150):
            step, given = 1e-3 * rng.random(), 0.4 * rng.normal(size=len(inputs))
            for key, value in zip(inputs, given, strict=True):
                run[key] = value
            host[inputs] = given
            run.refresh()
            expected = np.array([run[n] for n in outputs])
            assert np.allclose(host[outputs], expected, rtol=1e-14, atol=1e-14)
            if k % 7 == 3:
                state = host.fmu.getFMUstate()
                host.fmu.doStep(time, 2 * step)
                host[inputs] = -given
                host.fmu.setFMUstate(state)
                host.fmu.freeFMUstate(state)
            host.fmu.doStep(time, step)
            run.step(time, step)
            time += step
            assert np.allclose(host[outputs], [run[n] for n in outputs], rtol=1e-14, atol=1e-14)


@pytest.mark.parametrize("name", [n for n in DEVICES if n.startswith("brace_")])
def test_directional_derivatives_are_difference_quotients(name: str, tmp_path: Path) -> None:
    host = Host(name, tmp_path)
    assert host.description.coSimulation.providesDirectionalDerivative
    inputs, outputs = host.by["input"], host.by["output"]
    unknowns, knowns = [host.reference[n] for n in outputs], [host.reference[n] for n in inputs]
    rng = np.random.default_rng(4)
    host.start(**random_parameters(host, rng))
    compared = 0
    for k in range(60):
        host[inputs] = given = 0.3 * rng.normal(size=len(inputs))
        host.fmu.doStep(1e-3 * k, 1e-3)
        way = rng.normal(size=len(inputs))
        host[inputs] = given = given + 0.01 * rng.normal(size=len(inputs))  # away from where the step ended
        found = np.array(host.fmu.getDirectionalDerivative(unknowns, knowns, list(way)))
        sides = []
        for h in (-1e-6, 0.0, 1e-6):
            host[inputs] = given + h * way
            sides.append(host[outputs])
        left, right = (sides[1] - sides[0]) / 1e-6, (sides[2] - sides[1]) / 1e-6
        smooth = np.abs(left - right) < 1e-3 * (1 + np.abs(left))  # not over a corner
        assert np.allclose(found[smooth], 0.5 * (left + right)[smooth], rtol=1e-5, atol=1e-4)
        compared += smooth.sum()
    assert compared > 0.8 * 60 * len(outputs)
    with pytest.raises(Exception, match="fmi2GetDirectionalDerivative failed"):
        host.fmu.getDirectionalDerivative(knowns[:1], knowns[:1], [1.0])
    assert "is no output, so it has no derivative" in host.messages[-1]


def test_a_state_travels_to_a_fresh_instance_and_to_no_other_model(tmp_path: Path) -> None:
    one, two, other = Host("brace_active", tmp_path), Host("brace_active", tmp_path), Host("brace_linear", tmp_path)
    one.start(lag=0.02)
    for k in range(20):
        one[one.by["input"]] = [0.4, 9.0]
        one.fmu.doStep(1e-3 * k, 1e-3)
    state = one.fmu.getFMUstate()
    data = one.fmu.serializeFMUstate(state)
    received = two.fmu.deSerializeFMUstate(data)
    two.fmu.setFMUstate(received)
    for host in (one, two):
        host.fmu.doStep(0.02, 1e-3)
    assert one["strap_tension"] == two["strap_tension"] > 10.0
    with pytest.raises(Exception, match="fmi2DeSerializeFMUstate failed"):
        other.fmu.deSerializeFMUstate(data)
    assert other.messages[-1] == f"brace_linear: these {len(data)} bytes are no state of this model"
    with pytest.raises(Exception, match="fmi2SetFMUstate failed"):
        other.fmu.setFMUstate(state)
    assert other.messages[-1] == "brace_linear: this is a state of another model"


@pytest.mark.parametrize("name", DEVICES)
def test_fmi_2_and_3_are_one_model(name: str) -> None:
    """The same library, the same identity, the same variables; fmpy finds nothing to complain about."""
    described = []
    libraries = []
    for suffix in ("", FMI3):
        path = FMUS / f"{name}{suffix}.fmu"
        assert validate_fmu(str(path)) == []
        component = Component.read(name, path)
        described.append(component)
        with zipfile.ZipFile(path) as archive:
            libraries.append(archive.read(component.library))
    two, three = described
    assert libraries[0] == libraries[1]
    assert (two.guid, two.identifier) == (three.guid, three.identifier)
    assert (two.capabilities.fmi_version, three.capabilities.fmi_version) == ("2.0", "3.0")
    assert two.capabilities.state and three.capabilities.state
    same = {n: replace(c, fmi_type="") for n, c in three.connectors.items() if n != "time"}
    assert same == {n: replace(c, fmi_type="") for n, c in two.connectors.items()}


def test_a_landing_is_the_same_to_the_bit_in_fmi_2_and_3() -> None:
    """With saved states and directional derivatives in use, and a landing before in the same session."""
    scenario = load_scenario("incline30_mixed").replace_fmu("brace", FMUS / "brace_active.fmu")
    other = scenario
    for part, fmu in scenario.fmus.items():
        other = other.replace_fmu(part, FMUS / f"{fmu.stem}{FMI3}.fmu")
    here = scenario.run()
    with other.open() as session:
        session.run({"plant.drop_height": 0.4})
        there = session.run()
    assert here.status == there.status == "completed", there.message
    assert (here.values == there.values).all()
    assert here.values.shape == there.values.shape


def test_fmi_3_saves_differentiates_and_tells_its_host(tmp_path: Path) -> None:
    two, three = Host("brace_active", tmp_path), Host3("brace_active", tmp_path)
    for host in (two, three):
        host.start(lag=0.02)
        for k in range(20):
            host["subtalar_angle"], host["subtalar_velocity"] = 0.4, 9.0
            host.fmu.doStep(1e-3 * k, 1e-3)
    assert two["strap_tension"] == three["strap_tension"] > 10.0
    assert three["time"] == pytest.approx(0.02)
    ends = [three.reference["subtalar_torque"]], [three.reference["subtalar_angle"]]
    found = three.fmu.getDirectionalDerivative(*ends, [1.0])
    assert list(found) == list(two.fmu.getDirectionalDerivative(*ends, [1.0]))
    # a state goes from one version to the other, for it is that of the model; and to no other model
    state = two.fmu.getFMUstate()
    data = bytes(two.fmu.serializeFMUstate(state))
    received = three.fmu.deserializeFMUState(data)
    for host in (two, three):
        host.fmu.doStep(0.02, 1e-3)
    after = two["strap_tension"]
    three.fmu.doStep(0.021, 1e-3)
    three.fmu.setFMUState(received)
    three.fmu.doStep(0.02, 1e-3)
    assert three["strap_tension"] == after
    other = Host3("brace_linear", tmp_path)
    for host, doing, said in (
        (other, lambda: other.fmu.deserializeFMUState(data), f"these {len(data)} bytes are no state of this model"),
        (three, lambda: three.fmu.setFloat64([99], [1.0]), "there is no variable with value reference 99"),
        (three, lambda: three.fmu.getFloat32([0]), "there are no numbers of single precision"),
        (three, three.fmu.enterEventMode, "fmi3EnterEventMode belongs to a mode that is not offered"),
        (three, lambda: three.__setitem__("lag", 0.1), "parameter lag can only be set before initialisation"),
        (three, lambda: three.fmu.doStep(0.021, -1.0), "a step from 0.021 s over -1 s"),
        (other, lambda: other.start(talocrural_slack=float("nan")), "talocrural_slack = nan rad: must lie between"),
    ):
        with pytest.raises(Exception, match="failed with status 3"):
            doing()
        assert said in host.messages[-1]
    with pytest.raises(Exception, match="Failed to instantiate"):
        Host3("brace_linear", tmp_path, token="0" * 64)


@pytest.mark.parametrize("name", [n for n in DEVICES if n != "plant_mujoco"])
@pytest.mark.parametrize("suffix", ["", FMI3])
def test_the_reference_experiment_is_what_the_fmu_gives(name: str, suffix: str) -> None:
    """It was computed by plain Python; plant_mujoco has functions in C, and so carries none."""
    path = FMUS / f"{name}{suffix}.fmu"
    (found,), problems = experiments(path)
    assert problems == []
    component, stimuli, references = Component.read(name, path), found.stimuli, found.references
    assert stimuli is not None
    assert list(stimuli.values) == list(component.inputs)
    assert list(references.values) == list(component.outputs)
    with Driver(component) as driver:
        moves = [dict(zip(stimuli.values, row, strict=True)) for row in zip(*stimuli.values.values(), strict=True)]
        driver.start({n: float(v) for n, v in found.parameters.items()}, moves[0])
        rows = [driver.output_values.copy()]
        for k, step in enumerate(np.diff(references.time)):
            driver.step(float(step), moves[k], float(references.time[k]))
            rows.append(driver.output_values.copy())
    expected = np.column_stack(list(references.values.values()))
    assert np.ptp(expected, axis=0).max() > 0.1, "something moves"
    assert (np.abs(rows - expected) <= 1e-9 * np.maximum(1e-3, np.abs(expected).max(axis=0))).all()


def test_the_plant_with_mujoco_is_the_plant() -> None:
    """To rounding, which a landing amplifies to 1e-12; `validate` compares 1000 states and all reference landings."""
    ours = load_scenario("incline30_mixed")
    theirs = ours.replace_fmu("plant", FMUS / "plant_mujoco.fmu").run()
    assert theirs.status == "completed", theirs.message
    values = ours.run().values
    assert (np.abs(values - theirs.values) <= 1e-9 * np.abs(values).max(axis=0)).all()
    assert not (values == theirs.values).all(), "MuJoCo's operations come in another order"
    assert (FMUS / "plant_mujoco.fmu").stat().st_size <= 9e6


@pytest.mark.parametrize(
    ("member", "change", "said"),
    [
        ("landing.xml", lambda data: data[:50], "plant_mujoco: XML"),
        ("landing.xml", lambda data: data.replace(b"torso", b"tors", 1)[:-1], "plant_mujoco: "),
        ("libmujoco.so", lambda data: data[:40], "file too short"),
        (
            "landing.xml",  # memory that no machine has: MuJoCo's own error, which would end the process
            lambda data: data.replace(b"<worldbody>", b'<size memory="900P"/><worldbody>'),
            "plant_mujoco: Error: engine error: Could not allocate memory",
        ),
    ],
)
def test_mujoco_does_not_end_its_host(member: str, change: Any, said: str, tmp_path: Path) -> None:
    with zipfile.ZipFile(FMUS / "plant_mujoco.fmu") as packed, zipfile.ZipFile(tmp_path / "x.fmu", "w") as other:
        for name in packed.namelist():
            data = packed.read(name)
            other.writestr(name, change(data) if name == f"resources/{member}" else data)
    host = Host.__new__(Host)
    with contextlib.suppress(Exception):  # at the latest its initialisation fails
        host.__init__(tmp_path / "x.fmu", tmp_path)  # type: ignore[misc]
        host.start()
    assert said in host.messages[-1]


def test_errors_and_warnings_of_mujoco_come_to_the_fmu(tmp_path: Path) -> None:
    """Its own would end the process and write a file where the host runs."""
    host = Host("plant_mujoco", tmp_path)
    packed = ctypes.CDLL(str(Path(host.folder) / "resources" / "libmujoco.so"))
    assert ctypes.c_void_p.in_dll(packed, "mju_user_error").value
    assert ctypes.c_void_p.in_dll(packed, "mju_user_warning").value


def test_freeing_no_state_is_no_matter(tmp_path: Path) -> None:
    two, three = Host("brace_active", tmp_path), Host3("brace_active", tmp_path)
    assert two.fmu.fmi2FreeFMUstate(two.fmu.component, None) == 0
    assert three.fmu.fmi3FreeFMUState(three.fmu.component, None) == 0


def test_every_parameter_out_of_range_is_named_at_once(tmp_path: Path) -> None:
    host = Host("brace_bushing", tmp_path)
    with pytest.raises(Exception, match="fmi2ExitInitializationMode failed"):
        host.start(angle_scale=-1.0, torque_scale=float("nan"))
    assert host.messages == [
        "angle_scale = -1: must lie between 0 and 100; torque_scale = nan: must lie between 0 and 100"
    ]


@pytest.mark.parametrize(
    ("doing", "said"),
    [
        (lambda h: h.fmu.doStep(0.0, 1e-3), "brace_active: a step before the end of the initialisation"),
        (lambda h: (h.start(), h.fmu.doStep(0.0, -1e-3)), "brace_active: a step from 0 s over -0.001 s"),
        (
            lambda h: (h.start(), h.__setitem__("lag", 0.1)),
            "brace_active: parameter lag can only be set before initialisation",
        ),
        (lambda h: h.__setitem__("strap_tension", 1.0), "brace_active: strap_tension is computed, it cannot be set"),
        (lambda h: h.fmu.getReal([99]), "brace_active: there is no variable with value reference 99"),
        (lambda h: h.fmu.getInteger([0]), "brace_active: angle_threshold is a real number"),
        (lambda h: h.fmu.getBoolean([0]), "brace_active: there are no booleans"),
        (lambda h: (h.start(), h.start()), "brace_active: a running instance is initialised; reset it first"),
    ],
)
def test_a_host_that_errs_is_told_so(doing: Any, said: str, tmp_path: Path) -> None:
    host = Host("brace_active", tmp_path)
    with pytest.raises(Exception, match="failed with status 3"):
        doing(host)
    assert host.messages == [said]


def test_a_wrong_guid_and_a_wrong_table_are_refused(tmp_path: Path) -> None:
    with pytest.raises(Exception, match="Failed to instantiate"):
        Host("brace_linear", tmp_path, guid="0" * 64)
    archive = {}
    with zipfile.ZipFile(FMUS / "brace_table.fmu") as packed:
        archive = {n: packed.read(n) for n in packed.namelist()}
    for change, text in (
        (lambda b: b[:-8], "is not a table of this model"),
        (lambda b: b"X" + b[1:], "is not a table of this model"),
        (lambda b: b[:8] + b"0" * 64 + b[72:], "is not that of this library, 000"),
        (None, "constants.bin cannot be read: No such file"),
    ):
        member = "resources/constants.bin"
        other = tmp_path / "other.fmu"
        with zipfile.ZipFile(other, "w") as packed:
            for name, data in archive.items():
                if name != member or change is not None:
                    packed.writestr(name, change(data) if change and name == member else data)
        host = Host.__new__(Host)
        with pytest.raises(Exception, match="Failed to instantiate"):
            host.__init__(other, tmp_path)  # type: ignore[misc]
        assert text in host.messages[-1]


def test_the_level_of_the_processor_can_be_chosen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen = {}
    for level in ("x86-64-v2", "x86-64-v3"):
        monkeypatch.setenv("SPRAIN_CPU", level)
        try:
            host = Host("brace_semi_rigid", tmp_path)
        except Exception:
            pytest.skip(f"this processor has no {level}")
        host.fmu.dll.sprain_cosim_cpu.restype = ctypes.c_char_p
        assert host.fmu.dll.sprain_cosim_cpu(ctypes.c_void_p(host.fmu.component)) == level.encode()
        host[host.by["input"]] = [0.3, 5.0]
        host.start()
        seen[level] = host[host.by["output"]]
    assert np.allclose(seen["x86-64-v2"], seen["x86-64-v3"], rtol=1e-14, atol=0)
    monkeypatch.setenv("SPRAIN_CPU", "z80")
    host = Host.__new__(Host)
    with pytest.raises(Exception, match="Failed to instantiate"):
        host.__init__("brace_semi_rigid", tmp_path)  # type: ignore[misc]
    assert host.messages == ["brace_semi_rigid: SPRAIN_CPU is z80; this FMU is compiled for x86-64-v2, x86-64-v3"]


def test_a_delay_line_that_is_full_says_so(tmp_path: Path) -> None:
    host = Host("reflex_controller", tmp_path)
    host.start(reflex_gain=1.0, reflex_delay=10.0)
    for k in range(4095):
        host.fmu.doStep(1e-3 * k, 1e-3)
    with pytest.raises(Exception, match="fmi2DoStep failed with status 3"):
        host.fmu.doStep(4.095, 1e-3)
    assert "the reflex delay spans more than 4096 communication steps; take larger ones" in host.messages[-1]
    with pytest.raises(Exception, match="failed"):
        host.fmu.doStep(5.0, 1e-3)
    assert host.messages[-1].endswith("after an error the instance may only be reset or freed")
    host.fmu.reset()
    host.start()
    host.fmu.doStep(0.0, 1e-3)


@pytest.mark.parametrize("name", DEVICES)
def test_the_library_needs_the_c_library_alone_and_tells_no_path(name: str, tmp_path: Path) -> None:
    component = Component.read(name, FMUS / f"{name}.fmu")
    with zipfile.ZipFile(component.fmu) as archive:
        library = Path(archive.extract(component.library, tmp_path))
        assert not [n for n in archive.namelist() if n.endswith((".py", ".c", ".o"))]
        assert all(i.date_time == (1980, 1, 1, 0, 0, 0) for i in archive.infolist())
    assert library.stat().st_size < 1e6
    needed = subprocess.run(["readelf", "-dW", library], capture_output=True, text=True).stdout
    libraries = {line.split("[")[1].rstrip("]\n") for line in needed.splitlines() if "(NEEDED)" in line}
    of_threads = {"ld-linux-x86-64.so.2"} if name == "plant_mujoco" else set()  # part of the C library
    assert libraries <= {"libc.so.6", "libm.so.6"} | of_threads
    content = library.read_bytes()
    for path in (str(SOURCES), sys.prefix, "/tmp/", "numba"):
        assert path.encode() not in content, path
    stack = subprocess.run(["readelf", "-lW", library], capture_output=True, text=True).stdout
    assert next(line for line in stack.splitlines() if "GNU_STACK" in line).split()[-2] == "RW"


def test_a_host_that_is_not_python_runs_it(tmp_path: Path) -> None:
    """A C program of a few lines: same torque as the law in Python."""
    component = Component.read("brace", FMUS / "brace_semi_rigid.fmu")
    with zipfile.ZipFile(component.fmu) as archive:
        library = archive.extract(component.library, tmp_path)
    subprocess.run(["gcc", "-o", tmp_path / "host", C_SOURCES / "step_host.c", "-ldl"], check=True)
    references = [component.connectors[n].reference for n in ("subtalar_angle", "subtalar_torque")]
    command = [tmp_path / "host", library, component.guid, *map(str, references), "0.3"]
    outcome = subprocess.run(command, capture_output=True, text=True)
    assert outcome.returncode == 0, outcome.stdout
    run = Interpreted(read_device(SOURCES / "brace_semi_rigid"))
    run["subtalar_angle"] = 0.3
    run.initialise()
    assert float(outcome.stdout) == pytest.approx(run["subtalar_torque"], rel=1e-15)
    wrong = subprocess.run([*command[:2], "wrong", *command[3:]], capture_output=True, text=True)
    assert wrong.returncode == 3
    assert "the GUID wrong is not that of this library" in wrong.stdout
