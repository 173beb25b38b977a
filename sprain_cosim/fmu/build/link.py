"""Shared libraries of compiled devices: the shim in C (fmus/_native), a table made from the device's description, and
its object files, linked for each platform."""

from __future__ import annotations

import importlib.util
import math
import os
import shutil
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ...errors import EnvironmentProblem, InputError
from ...process import run_program
from ...shipped import template
from .compile import TARGETS, Compiled, prefix
from .description import Variables
from .device import FUNCTIONS

LIBRARIES = {  # (system, machine): folder of FMI 2.0 and ending of a shared library
    ("Linux", "x86_64"): ("linux64", ".so"),
    ("Linux", "aarch64"): ("linux64", ".so"),
    ("Darwin", "x86_64"): ("darwin64", ".dylib"),
    ("Darwin", "arm64"): ("darwin64", ".dylib"),
}
COMPILERS = ("cc", "gcc", "clang")
SHIM = ("device.c", "fmi2.c", "fmi3.c")  # one library speaks both versions
FIELDS = {  # of an argument of a device's function: its C type, and where Call has it
    "values": ("void *", "call->values"),
    "state": ("void *", "call->state"),
    "constants": ("const void *", "call->constants"),
    "seed": ("void *", "call->seed"),
    "result": ("void *", "call->result"),
    "time": ("double", "call->time"),
    "step": ("double", "call->step"),
}


@dataclass(frozen=True)
class Platform:
    """`folder2`, `folder3`: its name in archives of FMI 2 and 3; `ending` of a shared library; `options` of the
    linker."""

    folder2: str
    folder3: str
    ending: str
    options: tuple[str, ...]


PLATFORMS = {
    "linux64": Platform(
        "linux64",
        "x86_64-linux",
        ".so",
        ("-fPIC", "-s", "-Wl,--build-id=none", "-Wl,-z,defs", "-Wl,-z,noexecstack", "-Wl,--hash-style=gnu"),
    ),
    "win64": Platform("win64", "x86_64-windows", ".dll", ("-static", "-s", "-Wl,--no-insert-timestamp")),
}


def compiler_for(platform: str) -> str:
    """The C compiler that links for `platform`. Raises EnvironmentProblem, naming what to install."""
    if platform == "win64":
        found = shutil.which("x86_64-w64-mingw32-gcc")
        if found is None:
            raise EnvironmentProblem(
                "no compiler for win64: x86_64-w64-mingw32-gcc is not on the PATH; on Debian install "
                "gcc-mingw-w64-x86-64"
            )
        return found
    asked = os.environ.get("CC")
    if asked:
        found = shutil.which(asked)
        if found is None:
            raise EnvironmentProblem(f"the C compiler that CC names, {asked}, is not there")
        return found
    found = next((c for c in map(shutil.which, COMPILERS) if c), None)
    if found is None:
        raise EnvironmentProblem(
            f"no C compiler: none of {', '.join(COMPILERS)} on the PATH; install one, or name it in CC"
        )
    return found


def headers() -> Path:
    """The folder of the FMI headers, which fmpy ships."""
    found = importlib.util.find_spec("fmpy")
    assert found is not None and found.submodule_search_locations
    return Path(found.submodule_search_locations[0]) / "c-code"


def shim() -> Path:
    return template("native", "_native")


def link(compiled: Compiled, variables: Variables, guid: str, platform: str) -> bytes:
    """The library for `platform`. Raises EnvironmentProblem without a compiler for it, InputError where it fails."""
    compiler = compiler_for(platform)
    levels = TARGETS[platform].levels
    with tempfile.TemporaryDirectory() as work:
        folder = Path(work)
        (folder / "table.c").write_text(c_table(compiled, variables, guid, levels), "utf-8")
        for name in (*SHIM, "device.h"):
            shutil.copyfile(shim() / name, folder / name)
        for level in levels:
            (folder / f"{level}.o").write_bytes(compiled.objects[platform, level])
        options = [
            "-std=gnu11",
            "-O2",
            "-ffp-contract=off",
            "-shared",
            "-fvisibility=hidden",
            *PLATFORMS[platform].options,
        ]
        sources = [*SHIM, "table.c", *(f"{level}.o" for level in levels)]
        command = [compiler, *options, f"-I{headers()}", "-o", "library", *sources, "-lm"]
        ended = run_program(command, folder, environment={"SOURCE_DATE_EPOCH": "0", "LC_ALL": "C"})
        if ended.returncode:
            errors = [line for line in ended.stderr.splitlines() if "error" in line.lower() or "undefined" in line]
            raise InputError(f"{compiled.name}: {compiler} cannot link it: {(errors or ['no message'])[0]}")
        return (folder / "library").read_bytes()


def c_table(compiled: Compiled, variables: Variables, guid: str, levels: Sequence[str]) -> str:
    """The C source of `model` (device.h)."""
    rows = []
    for v in variables:
        items = v.get("items", {}).values()
        low, high = v.get("min", min(items, default=-math.inf)), v.get("max", max(items, default=math.inf))
        numbers = ", ".join(_double(x) for x in (v.get("start", 0.0), low, high))
        kind = "ENUMERATION" if "items" in v else "REAL"
        rows.append(
            f"    {{{_text(v['name'])}, {_text(v.get('unit', ''))}, {numbers}, {v['causality'].upper()}, {kind}}},"
        )
    codes, wrappers = [], []
    for level in levels:
        names = {name: f"{prefix(level)}_{name}" for name in sorted(compiled.takes)}
        for name, symbol in names.items():
            wrappers.append(_wrapper(symbol, compiled.takes[name], compiled.returns[name]))
        calls = [f"call_{names[compiled.symbol[f]]}" if f in compiled.symbol else "0" for f in FUNCTIONS]
        codes.append(f"    {{{_text(level)}, {', '.join(calls)}}},")
    reasons = [f"    {{{_text(r.format)}, {r.offset}}}," for r in compiled.reasons]
    own = not compiled.constants_in_resources
    sizes = (
        f"{len(variables)}, {len(compiled.reasons)}, {len(levels)}, {len(compiled.constants)}, "
        f"{len(compiled.first_state)}, {compiled.saved}, {int(not own)}"
    )
    return "\n".join(
        [
            '#include "device.h"',
            "#include <math.h>",
            "static const Variable variables[] = {",
            *rows,
            "};",
            *wrappers,
            "static const Code codes[] = {",
            *codes,
            "};",
            "static const Reason reasons[] = {",
            *reasons,
            "};",
            _blob("constants", compiled.constants if own else b""),
            _blob("first_state", compiled.first_state if any(compiled.first_state) else b""),
            "const Model model = {",
            f"    {_text(compiled.name)}, {_text(guid)}, variables, reasons, codes, constants,",
            f"    {'first_state' if any(compiled.first_state) else '0'}, {sizes}",
            "};",
            "",
        ]
    )


def _wrapper(symbol: str, takes: Sequence[str], returns: bool) -> str:
    """From numba's calling convention (result and error by pointer) to `Function` of device.h."""
    declared = ", ".join(["void *returned", "const Raised **raised", *(f"{FIELDS[a][0]} {a}" for a in takes)])
    passed = ", ".join(["returned" if returns else "&nothing", "raised", *(FIELDS[a][1] for a in takes)])
    return (
        f"extern int32_t {symbol}({declared});\n"
        f"static int call_{symbol}(const Call *call, int64_t *returned, const Raised **raised) {{\n"
        f"    {'' if returns else 'void *nothing = 0; (void)returned; '}(void)call;\n"
        f"    return {symbol}({passed});\n}}"
    )


def _blob(name: str, data: bytes) -> str:
    return f"static const _Alignas(64) unsigned char {name}[] = {{{','.join(map(str, data)) or '0'}}};"


def _double(value: float) -> str:
    value = float(value)
    return value.hex() if math.isfinite(value) else "INFINITY" if value > 0 else "-INFINITY"


def _text(value: str) -> str:
    """A C string of the UTF-8 bytes."""
    plain = "".join(chr(b) if 32 <= b < 127 and chr(b) not in '"\\?' else f"\\{b:03o}" for b in value.encode())
    return f'"{plain}"'
