"""A shared library judged by its file, before it is loaded: of this kind of machine, and complete."""

from __future__ import annotations

import platform
import struct
import sys

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
