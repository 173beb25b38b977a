"""The FMU of a model's folder, and all of a clone's."""

from __future__ import annotations

import platform as machine
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from ...errors import EnvironmentProblem, InputError, nearest
from ...shipped import FMI3, FMUS, SOURCES
from .compile import Compiled, compile_devices
from .description import (
    GUID_PLACE,
    Variables,
    load_interface,
    model_description,
    model_description_3,
    variables_of,
)
from .link import PLATFORMS, link, shim
from .packing import digest, tree, write_fmu

CONSTANTS = "resources/constants.bin"
HERE = {("Linux", "x86_64"): "linux64", ("Windows", "AMD64"): "win64"}


def build_all(names: Iterable[str] = (), platforms: Sequence[str] = ()) -> list[tuple[Path, str]]:
    """Builds the models of the clone's fmus/ folder (or those named) to where the package looks for them: (file, GUID)
    of each.

    Raises InputError outside a clone or for a name that is no model."""
    models = {
        p.parent.name: p.parent
        for p in sorted(SOURCES.glob("*/interface.py"))
        if not p.parent.name.startswith("brace_template_")
    }
    if not models:
        raise InputError(f"{SOURCES}: no models to build; an installed package ships its FMUs ready")
    for name in names:
        if name not in models:
            raise InputError(f"model {name!r} is not in {SOURCES}{nearest(name, models)}")
    chosen = [models[n] for n in list(names) or list(models)]
    faces = {folder: _face(folder) for folder in chosen}
    places = platforms or own_platform()
    built = []
    for folder, compiled in zip(chosen, compile_devices(chosen, places), strict=True):
        own = _archives(faces[folder], compiled, places)
        for ending, content in (("", own.fmi2), (FMI3, own.fmi3)):
            target = FMUS / f"{folder.name}{ending}.fmu"
            write_fmu(target, content)
            built.append((target, own.guid))
    return built


def build_fmu(folder: Path, target: Path, platforms: Sequence[str] = ()) -> str:
    """Writes `target` from the model in `folder`, for `platforms` (default: this machine's): FMI 2.0, or 3.0 where its
    name ends in _fmi3. Returns the GUID.

    Raises InputError where the folder is at fault, EnvironmentProblem where something to build with is missing."""
    face = _face(folder)
    places = platforms or own_platform()
    (compiled,) = compile_devices([folder], places)
    own = _archives(face, compiled, places)
    write_fmu(target, own.fmi3 if target.stem.endswith(FMI3) else own.fmi2)
    return own.guid


@dataclass(frozen=True)
class Face:
    """What interface.py of `folder` says; `fixed_step` [s] where the model cannot take another one."""

    folder: Path
    description: str
    variables: Variables
    fixed_step: float | None


def _face(folder: Path) -> Face:
    for needed in ("interface.py", "device.py"):
        if not (folder / needed).is_file():
            raise InputError(f"{folder}: no {needed}; a model's folder holds interface.py and device.py")
    path = folder / "interface.py"
    interface = load_interface(path)
    return Face(folder, interface.DESCRIPTION, variables_of(interface, path), getattr(interface, "FIXED_STEP", None))


def own_platform() -> tuple[str, ...]:
    """Raises EnvironmentProblem where devices cannot be compiled for this machine."""
    here = HERE.get((machine.system(), machine.machine()))
    if here is None:
        raise EnvironmentProblem(
            f"devices cannot be compiled for {machine.system()} on {machine.machine()}; "
            f"known are {', '.join(PLATFORMS)}"
        )
    return (here,)


@dataclass(frozen=True)
class Archives:
    """One model in both versions of FMI: {path: content}, with the same libraries and the same GUID."""

    guid: str
    fmi2: Mapping[str, bytes]
    fmi3: Mapping[str, bytes]


def _archives(face: Face, compiled: Compiled, platforms: Sequence[str]) -> Archives:
    told = (compiled.name, face.description, face.variables, face.fixed_step, "differentiate" in compiled.symbol)
    first, second = model_description(*told), model_description_3(*told)
    guid = _guid(compiled, first)
    common = {
        **{f"resources/{path}": data for path, data in tree(face.folder / "resources").items()},
        **{f"extra/{path}": data for path, data in tree(face.folder / "extra").items()},
        **{f"documentation/{path.name}": path.read_bytes() for path in sorted(face.folder.glob("*.md"))},
    }
    if compiled.constants_in_resources:
        common[CONSTANTS] = constants_file(guid, compiled.constants)
    fmi2 = {"modelDescription.xml": first.replace(GUID_PLACE, guid).encode(), **common}
    fmi3 = {"modelDescription.xml": second.replace(GUID_PLACE, guid).encode(), **common}
    for platform in platforms:
        place = PLATFORMS[platform]
        library = link(compiled, face.variables, guid, platform)
        fmi2[f"binaries/{place.folder2}/{compiled.name}{place.ending}"] = library
        fmi3[f"binaries/{place.folder3}/{compiled.name}{place.ending}"] = library
    return Archives(guid, fmi2, fmi3)


def constants_file(guid: str, constants: bytes) -> bytes:
    """What a device with CONSTANTS_IN_RESOURCES reads: its FMU's GUID and one record (device.c)."""
    return b"SPRAINC1" + guid.encode() + len(constants).to_bytes(8, "little") + constants


def _guid(compiled: Compiled, description: str) -> str:
    """SHA-256 of what the model is made from: the same on every platform and for every set of platforms."""
    sources: Mapping[str, bytes] = {
        "model": compiled.sources.encode(),
        **{f"shim/{path}": data for path, data in tree(shim()).items()},
        "constants": compiled.constants,
        "first_state": compiled.first_state,
        "description": description.encode(),
    }
    return digest(sources)
