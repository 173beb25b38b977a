"""An FMU in a process of its own: the same numbers to the bit, its faults end the run with a message, its modules meet
no other FMU's."""

from __future__ import annotations

import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import sprain_cosim as sc
from sprain_cosim.cli import _run, cli
from sprain_cosim.errors import EnvironmentProblem
from sprain_cosim.fmu import isolated as module
from sprain_cosim.fmu.component import Component
from sprain_cosim.fmu.driver import Driver
from sprain_cosim.fmu.isolated import Proxy, isolated
from sprain_cosim.process import Limits
from tests.native import compile_fmu, device
from tests.processes import alive_in, soon

SLAVE = """
from law import STIFFNESS
from pythonfmu import Fmi2Causality, Fmi2Slave, Real


class Brace(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.{axis}_angle = 0.0
        self.{axis}_torque = 0.0
        self.register_variable(Real("{axis}_angle", causality=Fmi2Causality.input))
        self.register_variable(Real("{axis}_torque", causality=Fmi2Causality.output))

    def do_step(self, current_time, step_size):
        self.{axis}_torque = -STIFFNESS * self.{axis}_angle
        return True
"""
EXPECTED = {
    "segfault": "SIGSEGV",
    "abort": "SIGABRT",
    "exit": "exit code 0",
    "hang_step": "overran its limit",
    "hang_start": "overran its limit",
    "error": "reported an error in the step",
    "fatal": "reported a fatal error in the step",
    "discard": "discarded the call in the step",
    "nan": "subtalar_torque = nan",
    "positive_infinity": "subtalar_torque = inf",
    "negative_infinity": "subtalar_torque = -inf",
}
QUICK = ("segfault", "exit", "hang_step", "error", "nan")


def pythonfmu(folder: Path, stiffness: float, axis: str = "subtalar") -> Path:
    """An FMU as `pythonfmu build` makes it: its modules are called slave and law, whatever they hold."""
    folder.mkdir()
    (folder / "slave.py").write_text(SLAVE.format(axis=axis))
    (folder / "law.py").write_text(f"STIFFNESS = {stiffness}\n")
    subprocess.run(
        [sys.executable, "-m", "pythonfmu", "build", "-f", "slave.py", "law.py", "-d", "."],
        cwd=folder,
        check=True,
        capture_output=True,
    )
    return folder / "Brace.fmu"


@pytest.mark.parametrize("scheme", ["auto", "iterative"])
def test_own_fmus_give_the_same_to_the_bit(scheme: str) -> None:
    scenario = sc.load_scenario("incline30_mixed").with_master(scheme, stop="40 ms").recording("plant.*")
    here, apart = scenario.run(), scenario.isolated().run()
    assert here.status == apart.status == "completed", apart.message
    assert apart.signals.equals(here.signals)


@pytest.mark.parametrize(("fmi", "model_exchange"), [(1, False), (2, False), (3, False), (2, True), (3, True)])
def test_every_version_gives_the_same_to_the_bit(fmi: int, model_exchange: bool, tmp_path: Path) -> None:
    """Two runs on the same instances: reset goes through as well."""
    scenario = (
        sc.load_scenario("incline30")
        .replace_fmu("brace", device(tmp_path / "device.fmu", fmi, model_exchange))
        .with_master(stop="20 ms")
    )
    with scenario.open() as here, scenario.isolated("brace").open() as apart:
        for _ in range(2):
            one, other = here.run(), apart.run()
            assert one.status == other.status == "completed", other.message
            assert other.signals.equals(one.signals)


def test_state(tmp_path: Path) -> None:
    """Saved, replayed, two states at once, as without isolation."""
    walks = []
    component = Component.read("brace", device(tmp_path / "device.fmu"))
    for opened in (component, isolated(component)):
        torques: list[float] = []
        with Driver(opened, ["subtalar_angle"], ["subtalar_torque"]) as driver:
            driver.start(stop=1.0)

            def walk(k: int, driver: Driver = driver, torques: list[float] = torques) -> None:
                driver.step(1e-3, {"subtalar_angle": 0.1 * k}, 1e-3 * k)
                torques.append(driver["subtalar_torque"])

            walk(0)
            first = driver.save_state()
            walk(1)
            second = driver.save_state()
            walk(2)
            driver.restore_state(first)
            walk(1)
            driver.restore_state(second)
            driver.free_state(first)
            walk(2)
            driver.free_state(second)
        assert torques[1:3] == torques[3:5]
        walks.append(torques)
    assert walks[0] == walks[1]


@pytest.mark.parametrize("fault", [f if f in QUICK else pytest.param(f, marks=pytest.mark.long) for f in EXPECTED])
def test_a_fault_ends_the_run_and_names_the_component(
    fault: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "STEP_LIMIT", 1.0 if fault == "hang_step" else 60.0)
    monkeypatch.setattr(module, "START_LIMIT", 6.0 if fault == "hang_start" else 60.0)
    scenario = (
        sc.load_scenario("incline30")
        .replace_fmu("brace", compile_fmu(tmp_path / "device.fmu", fault=fault))
        .isolated("brace")
        .with_master(stop="15 ms")
    )
    with scenario.open() as session:
        proxy = next(m.instance for m in session._assembly.members if m.name == "brace")  # type: ignore[union-attr]
        assert isinstance(proxy, Proxy)
        process = proxy._child._process
        result = session.run()
        assert result.status == "failed"
        assert result.message.startswith("brace: "), result.message
        assert EXPECTED[fault] in result.message
        assert len(result.time) == (0 if fault == "hang_start" else 21)  # the fault strikes in the step after 10 ms
        assert process.poll() is not None
        if fault == "segfault":
            assert session.run().message == result.message  # opened anew


def test_a_hang_ends_within_the_stated_limit_of_the_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Not after STEP_LIMIT of the call; a limit that suffices changes nothing."""
    monkeypatch.setattr(module, "STEP_LIMIT", 600.0)
    chosen = sc.load_scenario("incline30").isolated("controller").with_master(stop="15 ms")
    assert chosen.run(limits=Limits(trial=60.0)).metrics == chosen.run().metrics
    hanging = compile_fmu(tmp_path / "device.fmu", fault="hang_step")
    scenario = sc.load_scenario("incline30").replace_fmu("brace", hanging).isolated("brace").with_master(stop="15 ms")
    with scenario.open(limits=Limits(trial=2.0)) as session:
        began = time.monotonic()
        result = session.run()
    assert time.monotonic() - began < 0.2 * module.STEP_LIMIT
    assert result.message == (
        "brace: in the step from 0.01 s to 0.0105 s: its process overran its limit of wall time (2 s: as stated) and "
        "was ended"
    )


def test_the_command_survives_a_crash(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    fmu = compile_fmu(tmp_path / "device.fmu", fault="segfault")
    assert _run(["run", "incline30", "--fmu", f"brace={fmu}", "--isolate"], []) == 3
    assert (
        capsys.readouterr().err
        == "error: brace: in the step from 0.01 s to 0.0105 s: its process was ended by signal SIGSEGV\n"
    )


def test_what_cannot_be_opened_is_one_message(tmp_path: Path) -> None:
    """A module that is not there: the reason is PythonFMU's last line."""
    fmu = pythonfmu(tmp_path / "a", 20.0)
    import zipfile

    with zipfile.ZipFile(fmu) as archive:
        files = {n: archive.read(n) for n in archive.namelist() if n != "resources/law.py"}
    with zipfile.ZipFile(fmu, "w") as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    with pytest.raises((sc.SimulationError, EnvironmentProblem), match=r"brace: .*No module named 'law'"):
        sc.load_scenario("incline30").replace_fmu("brace", fmu).run()


def test_python_fmus_of_others_do_not_mix(tmp_path: Path) -> None:
    """Two FMUs of `pythonfmu build` whose modules have the same names, in one system: each follows its own law, and
    neither reaches this process."""
    first, second = pythonfmu(tmp_path / "a", 20.0), pythonfmu(tmp_path / "b", 5.0, "inversion")
    (tmp_path / "two.toml").write_text(
        f'base = "incline30"\n[components.brace]\nfmu = "{first}"\n[components.insole]\nfmu = "{second}"\n'
    )
    scenario = sc.load_scenario(tmp_path / "two.toml").with_master("gauss-seidel")
    result = scenario.run()
    assert result.status == "completed", result.message
    for device_name, axis, stiffness in (("brace", "subtalar", 20.0), ("insole", "inversion", 5.0)):
        angle, torque = result[f"{device_name}.{axis}_angle"], result[f"{device_name}.{axis}_torque"]
        assert np.abs(angle).max() > 0.1
        assert torque[1:] == pytest.approx(-stiffness * angle[1:], abs=1e-12)
    assert not {"slave", "law"} & set(sys.modules)


def test_a_python_fmu_of_another_is_the_same_as_in_c(tmp_path: Path) -> None:
    """The law of faulty.c, k = 20: the same landing, checked and run."""
    fmu = pythonfmu(tmp_path / "a", 20.0)
    told = CliRunner().invoke(cli, ["check", str(fmu)], standalone_mode=False)
    assert told.return_value == 0, told.output
    assert "process of its own" in told.output
    runs = [
        sc.load_scenario("incline30").replace_fmu("brace", f).with_master("gauss-seidel").run()
        for f in (fmu, compile_fmu(tmp_path / "c.fmu"))
    ]
    assert runs[0]["plant.subtalar_angle"] == pytest.approx(runs[1]["plant.subtalar_angle"], abs=1e-12)


def test_a_study_in_isolation_is_the_same(tmp_path: Path) -> None:
    study = sc.load_study("study2").replace_fmu("brace", device(tmp_path / "device.fmu"))
    trials = [
        s.run(trials=3, workers=1, out=tmp_path / str(k)).trials
        for k, s in enumerate((study, replace(study, scenario=study.scenario.isolated("brace"))))
    ]
    assert trials[0].equals(trials[1])


def test_nothing_stays_behind(tmp_path: Path) -> None:
    """The processes of a session are gone after it, those that a device forked included."""
    scenario = (
        sc.load_scenario("incline30")
        .replace_fmu("brace", compile_fmu(tmp_path / "device.fmu", fault="fork"))
        .isolated("brace")
        .with_master(stop="20 ms")
    )
    with scenario.open() as session:
        groups = [m.instance._child._process.pid for m in session._assembly.members if m.name == "brace"]  # type: ignore[union-attr]
        assert session.run().status == "completed"
    assert groups
    assert soon(lambda: not any(map(alive_in, groups)), 5.0)
