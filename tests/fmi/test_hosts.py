"""Hosts that are not Python, as oracles: the shipped plant, controller and brace under a master in C of our own
and under libcosim's C API, equal to scheme jacobi; and what such a host is told when it errs."""

from __future__ import annotations

import os
import subprocess
import zipfile
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path

import numpy as np
import pytest

from sprain_cosim.contract import is_impedance
from sprain_cosim.cosim.master import Master
from sprain_cosim.cosim.system import System
from sprain_cosim.fmu.build.link import headers, shim
from sprain_cosim.fmu.component import Component
from sprain_cosim.scenario import load_scenario
from sprain_cosim.shipped import FMI3, FMUS
from tests.fmi.test_libcosim import PYTHON
from tests.native import SOURCES

STEP, STEPS = 5e-4, 300
WATCHED = ("plant.subtalar_angle", "plant.talocrural_velocity", "brace.rotation_x_torque")


class Landing:
    """The system of a shipped scenario, and the commands of its task for a host in C."""

    def __init__(self) -> None:
        scenario = load_scenario("incline30_mixed").replace_fmu("brace", FMUS / "brace_bushing.fmu")
        for name, value in (("controller.reflex_gain", 2.0), ("brace.angle_scale", 1.5)):
            scenario = scenario.override(name, value)
        self.system: System = scenario.system()
        # what is known before anything moved, the excitations, goes first; stiffness and damping are not handed over
        connected = [(s, t) for t, s in self.system.connections.items() if not is_impedance(t)]
        self.connections = sorted(connected, key=lambda ends: not ends[0].startswith("controller."))

    @cached_property
    def ours(self) -> np.ndarray:
        assembly = self.system.open()
        result = Master(STEP, STEP * STEPS, scheme="jacobi", guard=False).run(assembly, self.system.parameters)
        assembly.close()
        assert result.status == "completed", result.message
        return np.column_stack([result[name][1:] for name in WATCHED])

    def end(self, name: str) -> str:
        return f"{name.partition('.')[0]} {self.system.find(name).reference}"

    def commands(self, settings: Mapping[str, float] | None = None) -> list[str]:
        lines = []
        for name, value in {**self.system.parameters, **(settings or {})}.items():
            kind = "choose" if self.system.find(name).items else "set"
            lines.append(f"{kind} {self.end(name)} {int(value) if kind == 'choose' else repr(float(value))}")
        lines += [f"connect {self.end(source)} {self.end(target)}" for source, target in self.connections]
        return [*lines, *(f"watch {self.end(name)}" for name in WATCHED), f"run {STEP!r} {STEPS}"]


@pytest.fixture(scope="module")
def landing() -> Landing:
    return Landing()


@pytest.fixture(scope="module")
def host(tmp_path_factory: pytest.TempPathFactory) -> Path:
    program = tmp_path_factory.mktemp("host") / "master"
    subprocess.run(["gcc", "-O1", "-o", program, SOURCES / "master.c", "-ldl"], check=True)
    return program


@pytest.fixture(scope="module")
def unpacked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The FMUs of the landing in both versions of FMI, each in its own folder."""
    folder = tmp_path_factory.mktemp("unpacked")
    for name in ("plant", "reflex_controller", "brace_bushing"):
        for suffix in ("", FMI3):
            with zipfile.ZipFile(FMUS / f"{name}{suffix}.fmu") as archive:
                archive.extractall(folder / f"{name}{suffix}")
    return folder


def fmu(name: str, model: str, version: int, folder: Path, guid: str | None = None) -> str:
    suffix = FMI3 if version == 3 else ""
    component = Component.read(name, FMUS / f"{model}{suffix}.fmu")
    place = folder / f"{model}{suffix}"
    (place / "resources").mkdir(exist_ok=True)
    resources = (place / "resources").as_uri() if version == 2 else f"{place / 'resources'}/"
    return f"fmu {name} {version} {place / component.library} {guid or component.guid} {resources}"


def played(host: Path, lines: list[str], environment: Mapping[str, str] | None = None) -> tuple[int, list[str]]:
    done = subprocess.run(
        [host],
        input="\n".join(lines),
        capture_output=True,
        text=True,
        timeout=120,
        env=os.environ | (environment or {}),
    )
    assert done.stderr == ""
    return done.returncode, done.stdout.splitlines()


@pytest.mark.parametrize("versions", [(2, 2, 2), (3, 3, 3), (2, 3, 2)])
def test_a_landing_without_python_is_ours(
    versions: tuple[int, int, int], landing: Landing, host: Path, unpacked: Path
) -> None:
    models = {"plant": "plant", "controller": "reflex_controller", "brace": "brace_bushing"}
    fmus = [fmu(n, m, v, unpacked) for (n, m), v in zip(models.items(), versions, strict=True)]
    code, lines = played(host, [*fmus, *landing.commands()])
    assert code == 0, lines[-1]
    theirs = np.array([line.split() for line in lines], float)
    assert np.ptp(landing.ours, axis=0).min() > 0.1
    assert np.abs(theirs - landing.ours).max() <= 1e-12 * np.abs(landing.ours).max()


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize(
    ("settings", "said"),
    [
        (
            {"plant.drop_height": -1.0, "plant.tolerance": float("nan")},
            "drop_height = -1 m: must lie between 0 and 5; tolerance = nan: must lie between 1e-09 and 1",
        ),
        ({"plant.initial_pose": 7}, "initial_pose = 7: must lie between 0 and 2"),
        ({"plant.initial_pose": 2}, "plant: initial_pose = given: the foot is 34.6 mm inside the platform; raise "),
        (
            {"plant.tolerance": 1e-8},
            "50000 steps were not enough; the parameters make the model too stiff",
        ),
        ({"plant.brace_subtalar_torque": float("nan")}, "the state is no longer finite"),
    ],
)
def test_a_host_is_told_what_is_at_fault_and_lives(
    version: int, settings: dict[str, float], said: str, landing: Landing, host: Path, unpacked: Path
) -> None:
    task = [line for line in landing.commands(settings) if line.startswith(("set plant", "choose plant"))]
    code, lines = played(host, [fmu("plant", "plant", version, unpacked), *task, "run 0.15 1"])
    assert code == 3
    assert lines[-2].startswith("plant says (status 3): ")
    assert said in lines[-2]
    assert lines[-1].endswith("failed with status 3; the host goes on")


@pytest.mark.parametrize("version", [2, 3])
def test_a_wrong_identity_and_an_unknown_processor_are_refused(version: int, host: Path, unpacked: Path) -> None:
    code, lines = played(host, [fmu("brace", "brace_bushing", version, unpacked, guid="f00")])
    assert (code, lines[-1]) == (3, "instantiation of brace failed with status -1; the host goes on")
    assert "brace_bushing: the GUID f00 is not that of this library, " in lines[-2]
    code, lines = played(host, [fmu("brace", "brace_bushing", version, unpacked)], {"SPRAIN_CPU": "6502"})
    assert code == 3
    assert "brace_bushing: SPRAIN_CPU is 6502; this FMU is compiled for x86-64-v2, x86-64-v3" in lines[-2]


def test_a_processor_that_is_too_old_is_told_so(host: Path, tmp_path: Path) -> None:
    """The shim as on a processor without any of the flags that it asks for."""
    (tmp_path / "model.c").write_text(
        """
        #include "device.h"
        static const Variable variables[] = {{"angle", "rad", 0, -9, 9, INPUT, REAL}};
        static const Reason reasons[] = {{"", -1}};
        static const Code codes[] = {{"x86-64-v2"}, {"x86-64-v3"}};
        const Model model = {"old", "f00", variables, reasons, codes, 0, 0, 1, 1, 2};
        """
    )
    shared = ["-shared", "-fPIC", f"-I{headers()}", f"-I{shim()}", "-D__builtin_cpu_supports(flag)=0"]
    sources = [*(shim() / name for name in ("device.c", "fmi2.c", "fmi3.c")), tmp_path / "model.c"]
    subprocess.run(["gcc", *shared, "-o", tmp_path / "old.so", *sources], check=True)
    for version in (2, 3):
        for asked, said in (
            ("", "old: this processor is older than x86-64-v2, for which the FMU is compiled"),
            ("x86-64-v3", "old: this processor cannot run code for x86-64-v3, which SPRAIN_CPU names"),
        ):
            task = [f"fmu m {version} {tmp_path / 'old.so'} f00 file:///nowhere"]
            code, lines = played(host, task, {"SPRAIN_CPU": asked})
            assert (code, lines[0]) == (3, f"m says (status 3): {said}")


def test_a_library_of_another_platform_is_the_host_s_own_matter(host: Path, tmp_path: Path) -> None:
    """Nothing of ours runs; the host's loader says so."""
    (tmp_path / "x.so").write_bytes(b"MZ" + bytes(200))
    code, lines = played(host, [f"fmu m 2 {tmp_path / 'x.so'} f00 file:///nowhere"])
    assert code == 3
    assert "invalid ELF header" in lines[0]


@pytest.mark.long
@pytest.mark.skipif(not PYTHON.exists(), reason=f"no environment with libcosimpy ({PYTHON}), which has its C library")
def test_a_landing_under_libcosim_without_python_is_ours(landing: Landing, tmp_path: Path) -> None:
    """libcosim's fixed-step algorithm, driven by a C program."""
    library = next(PYTHON.parent.parent.rglob("libcosimc.so"))
    program = tmp_path / "libcosim_host"
    subprocess.run(["gcc", "-O1", "-o", program, SOURCES / "libcosim_host.c", "-ldl"], check=True)
    fmus = [f"fmu {c.name} {c.fmu}" for c in landing.system.components]
    done = subprocess.run(
        [program, library], input="\n".join([*fmus, *landing.commands()]), capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stdout[-500:] + done.stderr[-500:]
    theirs = np.array([line.split() for line in done.stdout.splitlines()], float)
    assert np.abs(theirs - landing.ours).max() <= 1e-12 * np.abs(landing.ours).max()
