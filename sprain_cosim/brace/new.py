"""A brace project from a template, and its FMU: Python through the exporter, C with the platform's compiler or
CMake."""

from __future__ import annotations

import os
import platform
import re
import shutil
import sys
import tempfile
from pathlib import Path

from ..errors import EnvironmentProblem, InputError
from ..files import write
from ..fmu.build import LIBRARIES, build_fmu, headers, pack
from ..process import run_program
from ..shipped import template

LANGUAGES = {"python": ("interface.py", "device.py"), "c": ("brace.c", "modelDescription.xml", "CMakeLists.txt")}
BESIDES = {"python": ("test_device.py", "README.md"), "c": ("README.md",)}
HEADERS = ("fmi2Functions.h", "fmi2FunctionTypes.h", "fmi2TypesPlatform.h")
IDENTIFIER = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,62}")
COMPILERS = ("cc", "gcc", "clang")


def new_brace(folder: Path, language: str) -> list[Path]:
    """Writes the project; its model is named after the folder. Raises InputError, also for a folder that holds
    anything."""
    name = folder.resolve().name
    if not IDENTIFIER.fullmatch(name):
        raise InputError(
            f"{folder}: the model takes the folder's name; use letters, digits and _, beginning with a letter"
        )
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError(f"{folder}: {'is not empty' if folder.is_dir() else 'is a file'}; name a new folder")
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


def build_brace(folder: Path, target: Path | None = None) -> Path:
    """The project's FMU, `target` or NAME.fmu in the present folder. Raises InputError where the project is at fault,
    EnvironmentProblem where there is no compiler."""
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
        build_fmu(folder, target) if language == "python" else _build_c(folder, target)
    except OSError as problem:
        raise EnvironmentProblem(f"{target}: cannot be written: {problem.strerror or problem}") from None
    return target


def _build_c(folder: Path, target: Path) -> None:
    found = re.search(r'modelIdentifier="([^"]+)"', (folder / "modelDescription.xml").read_text("utf-8"))
    if found is None:
        raise InputError(f"{folder / 'modelDescription.xml'}: no modelIdentifier")
    asked = os.environ.get("CC")
    compiler = shutil.which(asked) if asked else next((c for c in map(shutil.which, COMPILERS) if c), None)
    if asked and compiler is None:
        raise EnvironmentProblem(f"the C compiler that CC names, {asked}, is not there")
    place = LIBRARIES.get((platform.system(), platform.machine()))
    with tempfile.TemporaryDirectory() as work:
        if compiler is not None and place is not None:
            library = Path(work) / f"{found[1]}{place[1]}"
            _call([compiler, "-shared", "-fPIC", "-O2", "-Ifmi", "-o", str(library), "brace.c", "-lm"], folder)
            files = {
                "modelDescription.xml": (folder / "modelDescription.xml").read_bytes(),
                f"binaries/{place[0]}/{library.name}": library.read_bytes(),
            }
            files |= {f"documentation/{p.name}": p.read_bytes() for p in sorted(folder.glob("*.md"))}
            content = pack(files)
        else:
            cmake = shutil.which(
                "cmake", path=f"{Path(sys.executable).parent}{os.pathsep}{os.environ.get('PATH', os.defpath)}"
            )
            if cmake is None:
                raise EnvironmentProblem(
                    f"no C compiler: none of {', '.join(COMPILERS)} nor cmake on the PATH; install one, or name it in "
                    "CC"
                )
            _call([cmake, "-S", ".", "-B", work], folder)
            _call([cmake, "--build", work, "--config", "Release"], folder)
            content = (Path(work) / f"{found[1]}.fmu").read_bytes()
    write(target, content)


def _call(command: list[str], folder: Path) -> None:
    ended = run_program(command, folder)
    if ended.returncode == 0:
        return
    output = [line.strip() for line in (ended.stderr + ended.stdout).splitlines() if line.strip()]
    if any("CMAKE_C_COMPILER" in line or "CMAKE_MAKE_PROGRAM" in line for line in output):
        raise EnvironmentProblem(
            f"CMake finds no C compiler or build tool; install one of {', '.join(COMPILERS)} and make or ninja"
        )
    worst = next(
        (line for line in output if "error" in line.lower()), output[-1] if output else f"exit code {ended.returncode}"
    )
    raise InputError(f"{folder}: does not compile: {worst}")
