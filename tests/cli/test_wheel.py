"""The wheel, installed without a compiler, numba or MuJoCo beside nothing but what it asks for: it carries its FMUs and
does its work outside the clone."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import venv
import zipfile
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from sprain_cosim.cosim.native_libraries import SOURCES
from sprain_cosim.fmu.build.link import PLATFORMS
from sprain_cosim.shipped import shipped_fmus, shipped_scenarios

ROOT = Path(__file__).parents[2]
LARGEST = 1_000_000  # B of an FMU

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    options = ["--quiet", "--no-deps", "--no-index", "--no-build-isolation", "--wheel-dir", str(folder)]
    subprocess.run([sys.executable, "-m", "pip", "wheel", *options, str(ROOT)], check=True)
    return next(folder.glob("*.whl"))


def needed(wheel: Path) -> set[str]:
    """The distributions that the wheel asks for, and those that they ask for."""
    with zipfile.ZipFile(wheel) as archive:
        name = next(n for n in archive.namelist() if n.endswith(".dist-info/METADATA"))
        lines = archive.read(name).decode().splitlines()
    left = [line.removeprefix("Requires-Dist: ") for line in lines if line.startswith("Requires-Dist: ")]
    found: set[str] = set()
    while left:
        wanted = Requirement(left.pop())
        if (wanted.marker is None or wanted.marker.evaluate({"extra": ""})) and wanted.name.lower() not in found:
            found.add(wanted.name.lower())
            left += metadata.requires(wanted.name) or []
    return found


def _link_or_copy(source: Path, target: Path) -> None:
    """No symbolic link: the sandbox of foreign FMUs reads what lies in its own environment."""
    if source.is_file():
        try:
            os.link(source, target)
        except OSError:
            shutil.copyfile(source, target)


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An environment with the wheel and what it needs, taken from this one, so that no network is asked."""
    folder = tmp_path_factory.mktemp("environment")
    venv.create(folder, symlinks=True, with_pip=False)
    site = next((folder / "lib").glob("python*")) / "site-packages"
    for name in needed(wheel):
        distribution = metadata.distribution(name)
        for file in distribution.files or ():
            if file.parts[0] != ".." and file.suffix != ".pyc":
                (site / file).parent.mkdir(parents=True, exist_ok=True)
                _link_or_copy(Path(str(distribution.locate_file(file))), site / file)
    options = ["--quiet", "--no-deps", "--no-index", "--target", str(site)]
    subprocess.run([sys.executable, "-m", "pip", "install", *options, str(wheel)], check=True)
    return folder


def test_one_wheel_for_every_machine(wheel: Path) -> None:
    assert wheel.name.endswith("-py3-none-any.whl")
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
        fmus = {info.filename: info.file_size for info in archive.infolist() if info.filename.endswith(".fmu")}
    assert {f"sprain_cosim/_fmus/{name}.fmu" for name in shipped_fmus()} <= set(fmus)
    assert {f"sprain_cosim/_scenarios/{name}.toml" for name in shipped_scenarios()} <= names
    libraries = {name for name in names if name.endswith((".so", ".dll", ".dylib", ".pyd"))}
    own = tuple(f"sprain_cosim/_fmus/{name}-" for name in SOURCES)
    assert {f"{start}linux64.so" for start in own} <= libraries
    assert {name for name in libraries if not name.startswith(own)} == set()
    assert not [name for name in names if name.endswith("built.json")]
    assert {name: size for name, size in fmus.items() if size > LARGEST and "mujoco" not in name} == {}
    places = {place for name in fmus for place in platforms(wheel, name)}
    assert places <= {platform.folder for platform in PLATFORMS.values()}
    assert "linux64" in places


def platforms(wheel: Path, fmu: str) -> Iterator[str]:
    """Of an FMU of FMI 2.0 in the wheel."""
    if fmu.endswith("_fmi3.fmu"):
        return
    with zipfile.ZipFile(wheel) as archive, archive.open(fmu) as file, zipfile.ZipFile(file) as content:
        for name in content.namelist():
            if name.startswith("binaries/"):
                yield name.split("/")[1]


def test_it_works_without_the_clone(installed: Path, tmp_path: Path) -> None:
    (tmp_path / "table.csv").write_text("angle [deg],subtalar_resistance [N.m]\n-20,-8\n0,0\n20,8\n")
    environment = {"PATH": str(installed / "bin"), "HOME": str(tmp_path), "SPRAIN_COSIM_CACHE": str(tmp_path / "cache")}
    environment |= {key: os.environ[key] for key in ("PYTHONDONTWRITEBYTECODE",) if key in os.environ}

    def call(*arguments: str) -> str:
        command = [str(installed / "bin" / "python"), "-W", "error", "-m", "sprain_cosim", *arguments]
        ended = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
        assert ended.returncode == 0, f"{arguments}: {ended.stdout[-300:]}{ended.stderr[-600:]}"
        return ended.stdout

    absent = ("numba", "llvmlite", "mujoco", "pythonfmu")
    code = f"import importlib.util as util; print([name for name in {absent} if util.find_spec(name)])"
    python = [str(installed / "bin" / "python"), "-c", code]
    assert subprocess.run(python, env=environment, capture_output=True, text=True).stdout.strip() == "[]"
    assert "nothing to build" in call("build")
    assert "not installed: FMUs run" in call("doctor")
    call("run", "incline30_brace", "--out", "braced")
    peak = json.loads((tmp_path / "braced" / "summary.json").read_text())["metrics"]["peak_subtalar_angle_deg"]
    assert peak == pytest.approx(29.84, abs=0.01)
    call("brace", "from-csv", "table.csv", "-o", "cuff.fmu")
    call("check", "cuff.fmu")
    call("compare", "incline30", "--brace", "cuff=cuff.fmu", "--brace", "paper=brace_bushing", "--out", "compared")
    call("study", "study6", "--trials", "4", "--workers", "2", "--progress", "none", "--out", "study")
    call("report", "braced", "study", "compared", "--out", "report.html")
    call("animate", "braced", "--out", "film.png")
    assert (tmp_path / "report.html").stat().st_size > 100_000
    assert (tmp_path / "film.png").stat().st_size > 20_000
