"""Where the FMUs, scenarios and templates that ship lie: inside the installed package, or in the clone beside it."""

from __future__ import annotations

import platform as machine
from pathlib import Path

from .errors import EnvironmentProblem, InputError, nearest

PACKAGE = Path(__file__).parent
FMUS = PACKAGE / "_fmus"
FMI3 = "_fmi3"  # NAME.fmu speaks FMI 2.0, NAME_fmi3.fmu the same model in FMI 3.0
LIBRARIES = {  # what a library of the package's own ends in, by system and machine
    ("Linux", "x86_64"): "linux64.so",
    ("Windows", "AMD64"): "win64.dll",
    ("Darwin", "x86_64"): "darwin64.dylib",
    ("Darwin", "arm64"): "darwin64.dylib",
}
FOR_LINUX = ("plant_mujoco",)  # MuJoCo's library is part of it
PACKAGES = (".ssp", ".ssd")  # of systems; the second is answered with what it lacks
SOURCES = PACKAGE.parent / "fmus"  # the models' sources, in a clone only


def scenario_folder() -> Path:
    """Holds the shipped scenarios, and the studies in its folder `studies`."""
    inside = PACKAGE / "_scenarios"
    return inside if inside.is_dir() else PACKAGE.parent / "scenarios"


def shipped_scenarios() -> list[str]:
    return sorted(p.stem for p in scenario_folder().glob("*.toml"))


def shipped_studies() -> list[str]:
    return sorted(p.stem for p in (scenario_folder() / "studies").glob("*.toml"))


def shipped_fmus() -> list[str]:
    """Names of the models that ship, as FMI 2.0."""
    return sorted(p.stem for p in FMUS.glob("*.fmu") if not p.stem.endswith(FMI3))


def has_library_here(name: str) -> bool:
    """Whether a shipped FMU has a library for this system."""
    return name not in FOR_LINUX or machine.system() == "Linux"


def library(name: str) -> Path | None:
    """The package's own library of that name for this machine; None where there is none."""
    platform = LIBRARIES.get((machine.system(), machine.machine()))
    path = FMUS / f"{name}-{platform}" if platform else None
    return path if path is not None and path.is_file() else None


def template(name: str, source: str) -> Path:
    """A template of a brace project: `name` in the installed package, `source` below fmus/ in a clone."""
    inside = PACKAGE / "_templates" / name
    return inside if inside.exists() else SOURCES / source


def is_file(path: Path) -> bool:
    """Whether there is such a file; a name that no file can have is none."""
    try:
        return path.is_file()
    except OSError:
        return False


def is_package(name: Path | str) -> bool:
    """Whether it is called as a system in the SSP standard is."""
    return str(name).lower().endswith(PACKAGES)


def names_a_place(name: str) -> bool:
    """With a folder in it, as Linux or as Windows writes it."""
    return "/" in name or "\\" in name


def fmu_path(name: str, beside: Path, what: str) -> Path:
    """The file of a shipped FMU's name, or of a path relative to `beside`; `what` begins the message.

    Raises InputError where there is none, EnvironmentProblem for a shipped one that is not built."""
    if not names_a_place(name) and not name.endswith(".fmu"):
        built = FMUS / f"{name}.fmu"
        if is_file(built):
            return built
        if is_file(SOURCES / name.removesuffix(FMI3) / "interface.py"):
            raise EnvironmentProblem(f"{what}: not built yet; run `sprain-cosim build`")
        if not is_file(beside / name):
            raise InputError(f"{what}: no such FMU file, and none of that name ships{nearest(name, shipped_fmus())}")
    path = beside / name
    if not is_file(path):
        raise InputError(f"{what}: no such FMU file")
    return path
