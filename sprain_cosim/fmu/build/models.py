"""The FMU of a model's folder, and all of a clone's."""

from __future__ import annotations

import os
import platform as machine
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from time import monotonic

from ...errors import EnvironmentProblem, InputError, nearest
from ...shipped import FMI3, FMUS, SOURCES, shipped_fmus
from .built import BuildRecord, Built, sources
from .compile import Compiled, compile_devices
from .description import (
    GUID_PLACE,
    Variables,
    load_interface,
    model_description,
    model_description_3,
    variables_of,
)
from .link import FOLDERS_3, PLATFORMS, compiler_for, has_compiler, joined, link, shim
from .packing import digest, tree, write_fmu

CONSTANTS = "resources/constants.bin"
HERE = {("Linux", "x86_64"): "linux64", ("Windows", "AMD64"): "win64"}


def build_all(
    names: Iterable[str] = (),
    platforms: Sequence[str] = (),
    left_out: Collection[str] = (),
    tell: Callable[[str], None] = lambda _: None,
) -> list[Built]:
    """The FMUs of the clone's fmus/ folder (or of the models named) where the package looks for them, built where they
    are not what their sources give. `platforms`: default those of `usual_platforms`; `left_out`: models that are not
    built unless named; `tell` gets a line when compiling begins, and one when models are done. None outside a clone,
    where the FMUs ship with the package.

    Raises InputError for a name that is no model, EnvironmentProblem where something to build with is missing."""
    models = _models()
    known = models or shipped_fmus()
    for name in names:
        if name not in known:
            raise InputError(f"model {name!r} is not in {SOURCES if models else FMUS}{nearest(name, known)}")
    if not models:
        return []
    chosen = [models[n] for n in dict.fromkeys(names)] or [f for n, f in models.items() if n not in left_out]
    faces = {folder: _face(folder) for folder in chosen}
    places = known_platforms(platforms) or usual_platforms()
    record = BuildRecord.read(FMUS)
    built = {folder: record.current(folder, places) for folder in chosen}
    stale = [folder for folder in chosen if not built[folder]]
    if stale:
        _check_compilers(places)
        old = [folder.name for folder in stale]
        longest = "; the plant takes longest" if "plant" in old and len(old) > 1 else ""
        tell(f"compiling {', '.join(old)} for {', '.join(places)}{longest}")
        built |= _build([faces[folder] for folder in stale], places, record, tell)
    return [fmu for folder in chosen for fmu in built[folder]]


def _build(
    faces: Sequence[Face], platforms: Sequence[str], record: BuildRecord, tell: Callable[[str], None]
) -> dict[Path, list[Built]]:
    """{folder: its FMUs}, compiled side by side; those that can be built for one of the platforms."""
    built, began, count = {}, monotonic(), os.cpu_count() or 1
    digested = {face.folder: sources(face.folder) for face in faces}
    with ThreadPoolExecutor(count) as threads:
        shares = {threads.submit(_written, share, platforms): share for share in _shares(faces, count)}
        for done in as_completed(shares):
            for face, (own, files) in zip(shares[done], done.result(), strict=True):
                if own.platforms:
                    built[face.folder] = record.add(face.folder, digested[face.folder], platforms, own.guid, files)
            record.write()
            tell(f"{', '.join(f.folder.name for f in shares[done])}: done after {monotonic() - began:.0f} s")
    return built


def _shares(faces: Sequence[Face], count: int) -> list[list[Face]]:
    """At most `count` shares of about the same length of source, which says how long they compile."""
    length = {face.folder: sum(len(p.read_bytes()) for p in face.folder.glob("*.py")) for face in faces}
    shares: list[list[Face]] = [[] for _ in range(min(count, len(faces)))]
    for face in sorted(faces, key=lambda f: -length[f.folder]):
        min(shares, key=lambda share: sum(length[f.folder] for f in share)).append(face)
    return shares


def _written(faces: Sequence[Face], platforms: Sequence[str]) -> list[tuple[Archives, list[Path]]]:
    """Compiles devices one after the other and writes their FMUs: of each, archives and files."""
    out = []
    for face, compiled in zip(faces, compile_devices([f.folder for f in faces], slices(platforms)), strict=True):
        own = _archives(face, compiled, platforms)
        files = {FMUS / f"{face.folder.name}.fmu": own.fmi2, FMUS / f"{face.folder.name}{FMI3}.fmu": own.fmi3}
        for file, content in files.items() if own.platforms else ():
            write_fmu(file, content)
        out.append((own, list(files)))
    return out


def _models() -> dict[str, Path]:
    """{name: folder} of the clone; none in an installed package."""
    return {
        p.parent.name: p.parent
        for p in sorted(SOURCES.glob("*/interface.py"))
        if not p.parent.name.startswith("brace_template_")
    }


def build_fmu(folder: Path, target: Path, platforms: Sequence[str] = ()) -> str:
    """Writes `target` from the model in `folder`, for `platforms` (default: those of `usual_platforms`): FMI 2.0, or
    3.0 where its name ends in _fmi3. Returns the GUID.

    Raises InputError where the folder is at fault, EnvironmentProblem where something to build with is missing."""
    face = _face(folder)
    places = known_platforms(platforms) or usual_platforms()
    _check_compilers(places)
    (compiled,) = compile_devices([folder], slices(places))
    own = _archives(face, compiled, places)
    if not own.platforms:
        raise InputError(f"{folder}: this device cannot be built for {', '.join(places)}")
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


def own_platform() -> str | None:
    return HERE.get((machine.system(), machine.machine()))


def usual_platforms() -> tuple[str, ...]:
    """This machine's, and win64 where a compiler for it is installed. Raises EnvironmentProblem where devices cannot be
    compiled for this machine."""
    here = own_platform()
    if here is None:
        raise EnvironmentProblem(
            f"devices cannot be compiled for {machine.system()} on {machine.machine()}; "
            f"known are {', '.join(PLATFORMS)}"
        )
    return tuple(dict.fromkeys((here, *(("win64",) if has_compiler("win64") else ()))))


def known_platforms(platforms: Sequence[str]) -> tuple[str, ...]:
    for name in platforms:
        if name not in PLATFORMS:
            raise InputError(f"platform {name!r} is not one of {', '.join(PLATFORMS)}{nearest(name, PLATFORMS)}")
    return tuple(dict.fromkeys(platforms))


def slices(platforms: Iterable[str]) -> list[str]:
    return [part for platform in platforms for part in PLATFORMS[platform].slices]


def _check_compilers(platforms: Iterable[str]) -> None:
    """Before the first device is compiled, not after the last one."""
    for part in slices(platforms):
        compiler_for(part)


@dataclass(frozen=True)
class Archives:
    """One model in both versions of FMI: {path: content}, with the same libraries and the same GUID."""

    guid: str
    platforms: tuple[str, ...]
    fmi2: Mapping[str, bytes]
    fmi3: Mapping[str, bytes]


def _archives(face: Face, compiled: Compiled, platforms: Sequence[str]) -> Archives:
    """For those of the platforms that the device can be built for."""
    told = (compiled.name, face.description, face.variables, face.fixed_step, "differentiate" in compiled.symbol)
    first, second = model_description(*told), model_description_3(*told)
    guid = _guid(compiled, first)
    common = {
        **{f"resources/{path}": data for path, data in tree(face.folder / "resources").items()},
        **{f"extra/{path}": data for path, data in tree(face.folder / "extra").items()},
        **{f"documentation/{path.name}": path.read_bytes() for path in sorted(face.folder.glob("*.md"))},
    }
    common.update(compiled.files)
    common.update(compiled.experiment)
    if compiled.constants_in_resources:
        common[CONSTANTS] = constants_file(guid, compiled.constants)
    fmi2 = {"modelDescription.xml": first.replace(GUID_PLACE, guid).encode(), **common}
    fmi3 = {"modelDescription.xml": second.replace(GUID_PLACE, guid).encode(), **common}
    able = tuple(p for p in platforms if compiled.slices.issuperset(PLATFORMS[p].slices))
    for platform in able:
        place = PLATFORMS[platform]
        libraries = link(compiled, face.variables, guid, platform)
        fmi2[f"binaries/{place.folder}/{compiled.name}{place.ending}"] = joined(libraries)
        for part, library in libraries.items():
            fmi3[f"binaries/{FOLDERS_3[part]}/{compiled.name}{place.ending}"] = library
    return Archives(guid, able, fmi2, fmi3)


def constants_file(guid: str, constants: bytes) -> bytes:
    """What a device with CONSTANTS_IN_RESOURCES reads: its FMU's GUID and one record (device.c)."""
    return b"SPRAINC1" + guid.encode() + len(constants).to_bytes(8, "little") + constants


def _guid(compiled: Compiled, description: str) -> str:
    """SHA-256 of what the model is made from: the same on every platform and for every set of platforms."""
    parts: Mapping[str, bytes] = {
        "model": compiled.sources.encode(),
        **{f"shim/{path}": data for path, data in tree(shim()).items()},
        "constants": compiled.constants,
        "first_state": compiled.first_state,
        "native": compiled.native.encode(),
        **{f"files/{path}": data for path, data in compiled.files.items()},
        "description": description.encode(),
    }
    return digest(parts)
