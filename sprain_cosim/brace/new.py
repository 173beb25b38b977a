"""A brace project from a template, and its FMU: Python through `fmu.build`, C with the compiler of each platform, or
CMake."""

from __future__ import annotations

import os
import re
import shutil
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from ..errors import EnvironmentProblem, InputError
from ..files import check_folder, write
from ..fmu.build import build_fmu, headers, pack
from ..fmu.build.link import COMPILERS, PLATFORMS, compiler_for, has_compiler, joined, library_command
from ..fmu.build.models import known_platforms, own_platform, usual_platforms
from ..machine.here import SYSTEM
from ..process import run_program
from ..shipped import template

LANGUAGES = {"python": ("interface.py", "device.py"), "c": ("brace.c", "modelDescription.xml", "CMakeLists.txt")}
BESIDES = {"python": ("test_device.py", "README.md"), "c": ("README.md",)}
HEADERS = ("fmi2Functions.h", "fmi2FunctionTypes.h", "fmi2TypesPlatform.h")
IDENTIFIER = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,62}")


def new_brace(folder: Path, language: str) -> list[Path]:
    """Writes the project; its model is named after the folder. Raises InputError, also for a folder that holds
    anything."""
    name = folder.resolve().name
    if not IDENTIFIER.fullmatch(name):
        raise InputError(
            f"{folder}: the model takes the folder's name; use letters, digits and _, beginning with a letter"
        )
    check_folder(folder)
    if folder.exists() and any(folder.iterdir()):
        raise InputError(f"{folder}: is not empty; name a new folder")
    source = template(language, f"brace_template_{language}")
    written = []
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for file in (*LANGUAGES[language], *BESIDES[language]):
            text = (source / file).read_text("utf-8").replace(f"brace_template_{language}", name)
            (folder / file).write_text(text, "utf-8")
            written.append(folder / file)
        if language == "c":
            (folder / "fmi").mkdir()
            for header in HEADERS:
                shutil.copyfile(headers() / header, folder / "fmi" / header)
    except OSError as problem:
        raise EnvironmentProblem(f"{folder}: cannot be written: {problem.strerror or problem}") from None
    return written


def build_brace(folder: Path, target: Path | None = None, platforms: Sequence[str] = ()) -> Path:
    """The project's FMU, `target` or NAME.fmu in the present folder, for `platforms` (default: this machine's, and
    win64 where a compiler for it is installed). Raises InputError where the project is at fault, EnvironmentProblem
    where there is no compiler."""
    language = next((k for k, files in LANGUAGES.items() if (folder / files[0]).is_file()), None)
    if language is None:
        raise InputError(f"{folder}: no interface.py and no brace.c, so no project of `sprain-cosim brace new`")
    for file in LANGUAGES[language]:
        if not (folder / file).is_file():
            old = "; slave.py is of an earlier version" if (folder / "slave.py").is_file() else ""
            raise InputError(f"{folder}: no {file}; a {language} project holds {', '.join(LANGUAGES[language])}{old}")
    target = target or Path(f"{folder.resolve().name}.fmu")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        build = build_fmu if language == "python" else _build_c
        build(folder, target, known_platforms(platforms))
    except OSError as problem:
        raise EnvironmentProblem(f"{target}: cannot be written: {problem.strerror or problem}") from None
    return target


def _build_c(folder: Path, target: Path, platforms: Sequence[str]) -> None:
    found = re.search(r'modelIdentifier="([^"]+)"', (folder / "modelDescription.xml").read_text("utf-8"))
    if found is None:
        raise InputError(f"{folder / 'modelDescription.xml'}: no modelIdentifier")
    if not platforms:
        known = own_platform()
        if known and os.environ.get("CC"):
            compiler_for(known)  # what CC names is there
        if not known or not has_compiler(known):
            write(target, _by_cmake(folder, found[1]))
            return
    files = {"modelDescription.xml": (folder / "modelDescription.xml").read_bytes()}
    files |= {f"documentation/{p.name}": p.read_bytes() for p in sorted(folder.glob("*.md"))}
    for name in platforms or usual_platforms():
        place, slices = PLATFORMS[name], {}
        for part in place.slices:
            with tempfile.TemporaryDirectory() as work:
                library = Path(work) / f"{found[1]}{place.ending}"
                _call(library_command(part, library, ["-O2", "-Ifmi", "brace.c", "-lm"]), folder)
                slices[part] = library.read_bytes()
        files[f"binaries/{place.folder}/{found[1]}{place.ending}"] = joined(slices)
    write(target, pack(files))


def _by_cmake(folder: Path, name: str) -> bytes:
    cmake = shutil.which("cmake", path=f"{Path(sys.executable).parent}{os.pathsep}{os.environ.get('PATH', os.defpath)}")
    if cmake is None:
        raise EnvironmentProblem(
            f"no C compiler: none of {', '.join(COMPILERS)} nor cmake on the PATH; {SYSTEM.compiler}, or name it in CC"
        )
    with tempfile.TemporaryDirectory() as work:
        _call([cmake, "-S", ".", "-B", work], folder)
        _call([cmake, "--build", work, "--config", "Release"], folder)
        return (Path(work) / f"{name}.fmu").read_bytes()


def _call(command: list[str], folder: Path) -> None:
    ended = run_program(command, folder)
    if ended.returncode == 0:
        return
    output = [line.strip() for line in (ended.stderr + ended.stdout).splitlines() if line.strip()]
    if any("CMAKE_C_COMPILER" in line or "CMAKE_MAKE_PROGRAM" in line for line in output):
        raise EnvironmentProblem(f"CMake finds no C compiler or build tool; {SYSTEM.compiler}")
    worst = next(
        (line for line in output if "error" in line.lower()), output[-1] if output else f"exit code {ended.returncode}"
    )
    raise InputError(f"{folder}: does not compile: {worst}")
