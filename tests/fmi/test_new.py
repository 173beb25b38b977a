"""`brace new` and `brace build`: projects that build, fit and run as they are, in both languages; what is at fault in
one line."""

from __future__ import annotations

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import fmpy
import fmpy.validation
import numpy as np
import pytest

from sprain_cosim import EnvironmentProblem, InputError, check_brace, load_scenario
from sprain_cosim.brace import new as project
from sprain_cosim.brace.probe import Rig
from sprain_cosim.fmu.build import link
from sprain_cosim.fmu.component import Component
from tests.docs_commands import play

LANGUAGES = ("python", "c")


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the projects python and c and their FMUs."""
    folder = tmp_path_factory.mktemp("projects")
    for language in LANGUAGES:
        project.new_brace(folder / language, language)
        project.build_brace(folder / language, folder / f"{language}.fmu")
    return folder


@pytest.mark.parametrize("language", LANGUAGES)
def test_fits_as_it_is(built: Path, language: str) -> None:
    fmu = built / f"{language}.fmu"
    report = check_brace(fmu)
    assert report.verdict == "fits", report.text()
    assert fmpy.validation.validate_fmu(str(fmu)) == []
    assert fmpy.read_model_description(str(fmu)).modelName == language
    assert not [p for p in (built / language).rglob("*") if p.is_file() and b"brace_template" in p.read_bytes()], (
        "its own name everywhere"
    )
    again = project.build_brace(built / language, built / "again.fmu")
    assert again.read_bytes() == fmu.read_bytes()


@pytest.mark.parametrize("language", LANGUAGES)
def test_the_commands_of_its_readme(language: str, tmp_path: Path) -> None:
    project.new_brace(tmp_path / "cuff", language)
    assert play(tmp_path / "cuff" / "README.md", tmp_path) == 3


def test_one_bushing_three_ways(built: Path) -> None:
    """The paper's brace as shipped, as C FMU from the template, and evaluated inside the plant: the same peak within
    0.05 degrees."""
    braced = load_scenario("incline30_brace")
    for scale in (1.5, 2.4):
        python = braced.override("brace.angle_scale", scale)
        results = {
            "python": python.run(),
            "c": python.replace_fmu("brace", built / "c.fmu").run(),
            "inside": python.override("brace.torque_scale", 0.0)
            .override("plant.internal_brace_angle_scale", scale)
            .run(),
        }
        peaks = {name: r.metrics["peak_subtalar_angle_deg"] for name, r in results.items()}
        assert peaks["c"] == pytest.approx(peaks["python"], abs=1e-6)
        assert peaks["inside"] == pytest.approx(peaks["python"], abs=0.05)
        assert np.abs(results["c"]["plant.subtalar_angle"] - results["python"]["plant.subtalar_angle"]).max() < 1e-9
        assert results["c"].scheme == "impedance"


def test_the_python_template_s_own_test(built: Path) -> None:
    outcome = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "python"], cwd=built, capture_output=True
    )
    assert outcome.returncode == 0, outcome.stdout
    assert b"3 passed" in outcome.stdout


def test_a_project_of_an_earlier_version(tmp_path: Path) -> None:
    project.new_brace(tmp_path / "cuff", "python")
    (tmp_path / "cuff" / "device.py").rename(tmp_path / "cuff" / "slave.py")
    with pytest.raises(InputError, match=r"no device\.py.*slave\.py is of an earlier version"):
        project.build_brace(tmp_path / "cuff", tmp_path / "cuff.fmu")


def test_law_of_the_python_template(built: Path) -> None:
    parameters = {"stiffness": 50.0, "damping": 0.5, "rest_angle": 0.1}
    rig = Rig(Component.read("brace", built / "python.fmu"), ("subtalar",), parameters)
    rig.begin()
    assert rig.step(np.array([0.3]), np.array([4.0]), 1e-3)[0] == pytest.approx(-50 * 0.2 - 0.5 * 4.0, rel=1e-12)
    rig.close()


def test_with_cmake_where_no_compiler_is_called_by_name(
    built: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(link, "COMPILERS", ())
    monkeypatch.delenv("CC", raising=False)
    fmu = project.build_brace(built / "c", tmp_path / "by_cmake.fmu")
    assert fmpy.validation.validate_fmu(str(fmu)) == []
    results = [load_scenario("incline30").replace_fmu("brace", f).run() for f in (fmu, built / "c.fmu")]
    assert results[0].metrics["peak_subtalar_angle_deg"] == pytest.approx(
        results[1].metrics["peak_subtalar_angle_deg"], abs=1e-6
    )


def test_a_library_for_windows_where_its_compiler_is(
    built: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The compiler is a stand-in that writes what it is asked for; a real one: test_windows.py."""
    compiler = tmp_path / "bin" / f"{link.MINGW}gcc"
    compiler.parent.mkdir()
    compiler.write_text('#!/bin/sh\nwhile [ "$1" != -o ]; do shift; done\necho MZ > "$2"\n')
    compiler.chmod(0o755)
    monkeypatch.setenv("PATH", f"{compiler.parent}{os.pathsep}{os.environ['PATH']}")

    def libraries(*platforms: str) -> list[str]:
        with zipfile.ZipFile(project.build_brace(built / "c", tmp_path / "c.fmu", platforms)) as archive:
            return sorted(name for name in archive.namelist() if name.startswith("binaries/"))

    assert libraries() == ["binaries/linux64/c.so", "binaries/win64/c.dll"]
    assert libraries("win64", "win64") == ["binaries/win64/c.dll"]
    with pytest.raises(InputError, match="platform 'win32' is not one of linux64, win64, darwin64"):
        libraries("win32")


def test_no_compiler_is_an_environment_problem(built: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(project.sys, "executable", str(tmp_path / "python"))
    with pytest.raises(EnvironmentProblem, match="no C compiler: none of cc, gcc, clang nor cmake"):
        project.build_brace(built / "c", tmp_path / "c.fmu")
    monkeypatch.setenv("CC", "no-such-cc")
    with pytest.raises(EnvironmentProblem, match="CC names, no-such-cc, is not there"):
        project.build_brace(built / "c", tmp_path / "c.fmu")
    assert list(tmp_path.iterdir()) == []


def test_cmake_without_a_compiler(built: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(link, "COMPILERS", ())
    fake = tmp_path / "cmake"
    fake.write_text('#!/bin/sh\necho "CMake Error: CMAKE_C_COMPILER not set, after EnableLanguage" >&2\nexit 1\n')
    fake.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(project.sys, "executable", str(tmp_path / "python"))
    with pytest.raises(EnvironmentProblem, match="CMake finds no C compiler"):
        project.build_brace(built / "c", tmp_path / "c.fmu")


@pytest.mark.parametrize(
    ("language", "file", "change", "message"),
    [
        ("c", "brace.c", ("double f = v[", "double f = w["), r"does not compile: brace\.c:\d+:\d+: error: .*w"),
        ("c", "modelDescription.xml", ('modelIdentifier="cuff"', ""), "no modelIdentifier"),
        (
            "python",
            "device.py",
            ("def refresh(values)", "def refresh(values"),
            r"device\.py: .* in line \d+",
        ),
        ("python", "interface.py", ("N.m/rad", "N.m/deg"), r"interface\.py: .*'N.m/deg'"),
        ("python", "interface.py", ("import annotations", "import annotation"), r"interface\.py: .* in line \d+"),
        ("python", "interface.py", ("OUTPUTS", "OUTPUT"), r"interface\.py: no OUTPUTS"),
        ("python", "interface.py", ('"of the angle"', '"of the angle", 0'), r"INPUTS, row 2: 4 entries; its columns"),
        (
            "python",
            "device.py",
            ("values.stiffness", "values.stifness"),
            r"line \d+: values has no stifness \(did you mean stiffness\?\).*--lang c",
        ),
        ("python", "device.py", ('"""Outputs', 'print(1)\n    """Outputs'), r"line \d+: print cannot be compiled"),
    ],
)
def test_a_project_at_fault(language: str, file: str, change: tuple[str, str], message: str, tmp_path: Path) -> None:
    folder = tmp_path / "cuff"
    project.new_brace(folder, language)
    text = (folder / file).read_text()
    assert change[0] in text
    (folder / file).write_text(text.replace(*change))
    with pytest.raises(InputError, match=message) as caught:
        project.build_brace(folder, tmp_path / "cuff.fmu")
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "cuff.fmu").exists()
    (folder / file).unlink()
    with pytest.raises(InputError, match=f"no {file}|no interface.py and no brace.c"):
        project.build_brace(folder, tmp_path / "cuff.fmu")


def test_a_folder_in_use_or_without_a_name(tmp_path: Path) -> None:
    (tmp_path / "used").mkdir()
    (tmp_path / "used" / "thesis.tex").write_text("precious")
    for folder, words in (
        ("used", "is not empty"),
        ("used/thesis.tex", "letters, digits and _"),
        ("my-brace", "letters, digits and _"),
    ):
        with pytest.raises(InputError, match=words):
            project.new_brace(tmp_path / folder, "c")
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="is a file"):
        project.new_brace(tmp_path / "file", "python")
    assert sorted(p.name for p in tmp_path.rglob("*")) == ["file", "thesis.tex", "used"]
    (tmp_path / "empty").mkdir()
    assert project.new_brace(tmp_path / "empty", "python")
