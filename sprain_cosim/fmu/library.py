"""A shared library judged by its file, before it is loaded: of this kind of machine, complete, and with the functions
of FMI."""

from __future__ import annotations

import platform
import struct
import sys
from typing import Any

MACHINES = {
    "x86_64": 62,
    "AMD64": 62,
    "aarch64": 183,
    "arm64": 183,
    "i686": 3,
    "riscv64": 243,
}  # e_machine of the ELF specification


def problem(data: bytes) -> str:
    """Why `data` cannot be a library for this machine; empty when it may be one."""
    magic = {"linux": (b"\x7fELF",), "win32": (b"MZ",), "darwin": (b"\xcf\xfa\xed\xfe", b"\xca\xfe\xba\xbe")}.get(
        sys.platform, ()
    )
    if magic and not data.startswith(magic):
        return "is no shared library for this platform; export the FMU for it"
    return _elf(data) if sys.platform == "linux" else ""


def missing_functions(data: bytes, fmi_version: str, model_exchange: bool, identifier: str) -> list[str]:
    """Functions of FMI that the library `data` does not name."""
    from fmpy import fmi1, fmi2, fmi3

    interfaces: dict[tuple[str, bool], Any] = {
        ("1.0", False): fmi1.FMU1Slave,
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
