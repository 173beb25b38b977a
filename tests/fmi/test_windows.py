"""The FMUs for Windows under wine, in a C host: they give what the FMUs for this machine give. Skipped where wine or
mingw-w64 is not installed (`make wine`); SPRAIN_WINE=required fails instead. Wine is not Windows."""

from __future__ import annotations

import os
import shutil
import subprocess
import zipfile
from pathlib import Path

import numpy as np
import pytest

from sprain_cosim.cosim import native_libraries
from sprain_cosim.export.container import export_container
from sprain_cosim.fmu.build import build_fmu, link
from sprain_cosim.fmu.build.link import MINGW
from sprain_cosim.fmu.component import Component
from sprain_cosim.scenario import load_scenario
from sprain_cosim.shipped import FMUS, SOURCES, shipped_fmus

HOST = Path(__file__).parents[1] / "sources" / "landing_host.c"
MISSING = [name for name in ("wine", f"{MINGW}gcc") if shutil.which(name) is None]
REQUIRED = os.environ.get("SPRAIN_WINE") == "required"
STEPS, STEP = 300, 0.0005

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(bool(MISSING) and not REQUIRED, reason=f"no {', '.join(MISSING)} (make wine): nothing run"),
]


@pytest.fixture(scope="module")
def hosts(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("hosts")
    subprocess.run(["gcc", "-o", folder / "host", HOST, "-ldl"], check=True)
    subprocess.run([f"{MINGW}gcc", "-o", folder / "host.exe", HOST], check=True)
    return folder


def played(
    host: Path, model: str, output: str, inputs: dict[str, float], folder: Path, cpu: str = "", fmus: Path = FMUS
) -> np.ndarray:
    """(STEPS,) the output after each step, of the FMU's library that `host` can load."""
    component = Component.read(model, fmus / f"{model}.fmu")
    with zipfile.ZipFile(component.fmu) as archive:
        archive.extractall(folder / model)
    windows = host.suffix == ".exe"
    library = (
        folder / model / "binaries" / ("win64" if windows else "linux64") / f"{model}.{'dll' if windows else 'so'}"
    )
    assert library.is_file(), "built without mingw-w64: run `sprain-cosim build`"
    reference = {name: str(c.reference) for name, c in component.connectors.items()}
    resources = (folder / model / "resources").as_uri().replace("file:///", "file:///Z:/" if windows else "file:///")
    command = [*(["wine"] if windows else []), str(host), str(library), component.guid, resources, reference[output]]
    command += [str(STEP), str(STEPS), *(text for n, x in inputs.items() for text in (reference[n], repr(x)))]
    environment = os.environ | {"WINEPREFIX": str(folder / "wine"), "WINEDEBUG": "-all", "WINEDLLOVERRIDES": "mscoree="}
    ended = subprocess.run(
        command, capture_output=True, text=True, stdin=subprocess.DEVNULL, env=environment | {"SPRAIN_CPU": cpu}
    )
    assert ended.returncode == 0, ended.stdout[-500:] + ended.stderr[-500:]
    return np.array(ended.stdout.split(), dtype=float)


@pytest.mark.parametrize("cpu", ["x86-64-v2", "x86-64-v3"])
def test_a_landing_is_that_of_this_machine(hosts: Path, tmp_path_factory: pytest.TempPathFactory, cpu: str) -> None:
    folder = tmp_path_factory.getbasetemp()
    inputs = {"platform_incline": np.pi / 6}
    own, windows = (
        played(hosts / name, "plant", "subtalar_angle", inputs, folder, cpu) for name in ("host", "host.exe")
    )
    assert np.degrees(own.max()) == pytest.approx(
        load_scenario("incline30").run().metrics["peak_subtalar_angle_deg"], abs=1e-9
    )
    assert np.abs(np.degrees(windows - own)).max() < 1e-9


def test_a_container_is_that_of_this_machine(hosts: Path, tmp_path: Path) -> None:
    """Its FMUs and their resources found, loaded and stepped on the other system."""
    export_container(load_scenario("incline30_mixed"), tmp_path / "incline30_mixed.fmu")
    own, windows = (
        played(hosts / name, "incline30_mixed", "plant.subtalar_angle", {}, tmp_path, fmus=tmp_path)
        for name in ("host", "host.exe")
    )
    assert np.degrees(np.ptp(own)) > 20
    assert np.abs(np.degrees(windows - own)).max() < 1e-9


def test_the_master_s_own_library_is_built() -> None:
    assert link.link_source([native_libraries.FOLDER / "native_steps.c"], "win64", '-DSOURCE="none"').startswith(b"MZ")


def test_the_library_is_built_with_the_same_bytes(tmp_path: Path) -> None:
    for name in ("one.fmu", "two.fmu"):
        build_fmu(SOURCES / "brace_semi_rigid", tmp_path / name, ["win64"])
    assert (tmp_path / "one.fmu").read_bytes() == (tmp_path / "two.fmu").read_bytes()


@pytest.mark.parametrize("model", [name for name in shipped_fmus() if name.startswith("brace_")])
def test_a_brace_is_that_of_this_machine(hosts: Path, tmp_path_factory: pytest.TempPathFactory, model: str) -> None:
    folder = tmp_path_factory.getbasetemp()
    connectors = Component.read(model, FMUS / f"{model}.fmu").connectors
    angles = {name: 0.2 for name, c in connectors.items() if c.causality == "input" and name.endswith("_angle")}
    output = next(f"{axis}_torque" for axis in ("subtalar", "rotation_x") if f"{axis}_torque" in connectors)
    own, windows = (played(hosts / name, model, output, angles, folder) for name in ("host", "host.exe"))
    assert np.abs(own).max() > 0.1
    assert windows == pytest.approx(own, rel=1e-12)
