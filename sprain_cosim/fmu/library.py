"""A shared library before it is loaded: where it lies in the FMU, or what to do where there is none; judged by its
file: of this kind of machine, complete, and with the functions of FMI."""

from __future__ import annotations

import platform
import struct
import sys
import threading
from collections.abc import Collection
from functools import lru_cache
from pathlib import Path
from typing import Any

from ..errors import InputError
from ..machine.here import SYSTEM

MACHINES = {
    "x86_64": 62,
    "AMD64": 62,
    "aarch64": 183,
    "arm64": 183,
    "i686": 3,
    "riscv64": 243,
}  # e_machine of the ELF specification

OWN_PE = {"AMD64": 0x8664, "ARM64": 0xAA64, "x86": 0x14C}  # Machine of the PE format, by platform.machine()
SYSTEMS = {"win": "Windows", "x86-win": "Windows", "x86_64-win": "Windows", "darwin": "macOS", "linux": "Linux"}
SOURCES = (".c", ".cc", ".cpp", ".cxx")
FROM_SOURCES = "docs/exporting.md, From C sources"


@lru_cache(maxsize=1)
def load_fmpy() -> None:
    """Imports it. It asks where the C library lies, and Python starts a program to find out; on Linux it takes the one
    of this process instead, unless another thread could miss an answer meanwhile."""
    import ctypes.util

    asked = ctypes.util.find_library
    if sys.platform == "linux" and threading.active_count() == 1:
        ctypes.util.find_library = lambda name: None
    try:
        import fmpy  # noqa: F401
    finally:
        ctypes.util.find_library = asked


def find(fmu: Path, identifier: str, version: str, names: Collection[str], sources_listed: bool) -> str:
    """The path of this platform's library in the archive `fmu`, which holds `names`. `sources_listed`: its description
    says which source files make the library.

    Raises InputError where there is none: what is there in its place, and the command or the sentence that cures it."""
    import fmpy

    end = str(fmpy.sharedLibraryExtension)
    right, other = (str(fmpy.platform_tuple), str(fmpy.platform))[:: 1 if version == "3.0" else -1]
    library = f"binaries/{right}/{identifier}{end}"
    if library in names:
        return library
    looked_for = f"no binary for this platform: {library} is looked for"
    others = sorted(n for n in names if n.startswith((f"binaries/{right}/", f"binaries/{other}/")) and n.endswith(end))
    if others:
        raise InputError(
            f"{looked_for}, by its modelIdentifier and FMI {version}, but {others[0]} is there; ask its maker to "
            "export it with the library in that place, under that name"
        )
    if any(n.startswith("sources/") and n.lower().endswith(SOURCES) for n in names):
        build = f"fmpy compile {SYSTEM.quoted(str(fmu))} (needs CMake and a C compiler)"
        build = build if sources_listed else f"it does not list them, so by hand: {FROM_SOURCES}"
        raise InputError(f"{looked_for}, but it has only its C sources; build the library from them: {build}")
    there = sorted({n.split("/")[1] for n in names if n.startswith("binaries/") and n.count("/") >= 2})
    if there and all(folder.startswith("wasm") for folder in there):
        raise InputError(
            f"{looked_for}, but it has only WebAssembly ({', '.join(there)}, draft FMI-LS-WASM), which nothing here "
            f"runs; {_wish(right, version)}"
        )
    systems = {name for folder in there for start, name in SYSTEMS.items() if folder.startswith(start)}
    made = f"for {systems.pop()} only" if len(systems) == 1 else "for others" if there else "for no platform"
    raise InputError(
        f"{looked_for}, but it is made {made} ({', '.join(there) or 'no binaries'}); {_wish(right, version)}"
    )


def _wish(right: str, version: str) -> str:
    return (
        f'ask its maker: "Please export this FMU as FMI {version} co-simulation for {right} as well, or with its C '
        'sources"'
    )


def problem(data: bytes) -> str:
    """Why `data` cannot be a library for this machine; empty when it may be one."""
    magic = {"linux": (b"\x7fELF",), "win32": (b"MZ",), "darwin": (b"\xcf\xfa\xed\xfe", b"\xca\xfe\xba\xbe")}.get(
        sys.platform, ()
    )
    if magic and not data.startswith(magic):
        return "is no shared library for this platform; export the FMU for it"
    judge = {"linux": _elf, "win32": _pe}.get(sys.platform)
    return judge(data) if judge else ""


def missing_functions(data: bytes, fmi_version: str, model_exchange: bool, identifier: str) -> list[str]:
    """Functions of FMI that the library `data` does not name."""
    from fmpy import fmi1, fmi2, fmi3

    interfaces: dict[tuple[str, bool], Any] = {
        ("1.0", False): fmi1.FMU1Slave,
        ("1.0", True): fmi1.FMU1Model,
        ("2.0", False): fmi2.FMU2Slave,
        ("2.0", True): fmi2.FMU2Model,
        ("3.0", False): fmi3.FMU3Slave,
        ("3.0", True): fmi3.FMU3Model,
    }
    prefix = f"fmi{fmi_version[0]}"
    functions = [n for n in dir(interfaces[fmi_version, model_exchange]) if n.startswith(prefix)]
    if prefix == "fmi1":
        functions = [f"{identifier}_{n.replace('fmi1', 'fmi')}" for n in functions]
    return [n for n in functions if n.encode() not in data]


def _pe(data: bytes) -> str:
    """Of a DLL."""
    place = struct.unpack_from("<I", data, 60)[0] if len(data) >= 64 else 0
    if len(data) < place + 24 or data[place : place + 4] != b"PE\0\0":
        return "is no DLL; export the FMU again"
    machine, sections, options = (struct.unpack_from("<H", data, place + at)[0] for at in (4, 6, 20))
    wide, own = sys.maxsize > 2**32, OWN_PE.get(platform.machine())
    if own is not None and machine != own:
        return f"is no {64 if wide else 32}-bit DLL for {platform.machine()}; export the FMU for this platform"
    table = place + 24 + options
    if len(data) < table + 40 * sections:
        return "is cut off; export the FMU again"
    parts = [struct.unpack_from("<II", data, table + 40 * k + 16) for k in range(sections)]
    cut = any(place and place + size > len(data) for size, place in parts)
    return "is cut off; export the FMU again" if cut else ""


def _elf(data: bytes) -> str:
    wide = sys.maxsize > 2**32
    if len(data) < 64 or (data[4], data[5]) != (2 if wide else 1, 1):
        return f"is no {64 if wide else 32}-bit library; export the FMU for this platform"
    kind, machine = struct.unpack_from("<HH", data, 16)
    own = MACHINES.get(platform.machine())
    if kind != 3 or (own is not None and machine != own):
        return f"is no shared library for {platform.machine()}; export the FMU for this platform"
    if not wide:
        return ""
    segments, sections = struct.unpack_from("<QQ", data, 32)
    size, count, section_size, section_count = struct.unpack_from("<HHHH", data, 54)
    ends = [segments + size * count, sections + section_size * section_count]
    if ends[0] <= len(data) and size >= 56:
        ends += [sum(struct.unpack_from("<Q16xQ", data, segments + k * size + 8)) for k in range(count)]
    return "is cut off; export the FMU again" if max(ends) > len(data) else ""
