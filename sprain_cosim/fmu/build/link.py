"""Shared libraries of compiled devices: the shim in C (fmus/_native), a table made from the device's description, and
its object files, linked for each platform."""

from __future__ import annotations

import importlib.util
import math
import os
import shutil
import struct
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from ...errors import EnvironmentProblem, InputError
from ...machine.here import SYSTEM
from ...process import run_program
from ...shipped import template
from .compile import TARGETS, Compiled, prefix
from .description import Variables
from .device import FUNCTIONS

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
    """`folder`: its name in archives of FMI 2.0; `ending` of a shared library; `slices`: the processors whose code it
    holds, by their names in TARGETS."""

    folder: str
    ending: str
    slices: tuple[str, ...]


PLATFORMS = {
    "linux64": Platform("linux64", ".so", ("linux64",)),
    "win64": Platform("win64", ".dll", ("win64",)),
    "darwin64": Platform("darwin64", ".dylib", ("darwin64", "aarch64-darwin")),
}
FOLDERS_3 = {  # of a slice in archives of FMI 3.0
    "linux64": "x86_64-linux",
    "win64": "x86_64-windows",
    "darwin64": "x86_64-darwin",
    "aarch64-darwin": "aarch64-darwin",
}
WINDOWS_BASE = "-Wl,--image-base=0x180000000"  # else a hash of the path that is written
OPTIONS = {  # of a slice
    "linux64": ("-fPIC", "-s", "-Wl,--build-id=none", "-Wl,-z,defs", "-Wl,-z,noexecstack", "-Wl,--hash-style=gnu"),
    "win64": ("-static", "-s", "-Wl,--no-insert-timestamp", WINDOWS_BASE, "-fno-builtin-sin", "-fno-builtin-cos"),
    "darwin64": ("-fPIC", "-s"),
    "aarch64-darwin": ("-fPIC", "-s"),
}
C_OPTIONS = ("-std=gnu11", "-O2", "-ffp-contract=off", "-fvisibility=hidden")
WINDOWS = "windows.c"
MINGW = "x86_64-w64-mingw32-"
ZIG = {"darwin64": "x86_64-macos.11.0", "aarch64-darwin": "aarch64-macos.11.0"}
# what the C library of Windows exports; mingw-w64's own are of the x87 unit, with which a landing takes twice the time
MATH_OF_WINDOWS = (
    *("acos", "asin", "atan", "atan2", "ceil", "cos", "cosh", "exp", "floor", "fmod", "log", "log10", "pow", "sin"),
    *("sinh", "sqrt", "tan", "tanh", "cosf", "expf", "logf", "powf", "sinf", "sqrtf"),
)


def compiler_for(platform: str) -> list[str]:
    """The command that compiles C for a platform or one of its slices and links it. Raises EnvironmentProblem, naming
    what to install."""
    if platform == "win64":
        found = shutil.which(f"{MINGW}gcc")
        if found is None:
            raise EnvironmentProblem(f"no compiler for win64: {MINGW}gcc is not on the PATH; {SYSTEM.mingw}")
        return [found]
    if platform in ZIG:
        if importlib.util.find_spec("ziglang") is None:
            raise EnvironmentProblem("no compiler for darwin64: ziglang is not installed; pip install ziglang")
        return [sys.executable, "-P", "-m", "ziglang", "cc", "-target", ZIG[platform]]
    asked = os.environ.get("CC")
    if asked:
        found = shutil.which(asked)
        if found is None:
            raise EnvironmentProblem(f"the C compiler that CC names, {asked}, is not there")
        return [found]
    found = next((c for c in map(shutil.which, COMPILERS) if c), None)
    if found is None:
        raise EnvironmentProblem(
            f"no C compiler: none of {', '.join(COMPILERS)} on the PATH; {SYSTEM.compiler}, or name it in CC"
        )
    return [found]


def has_compiler(platform: str) -> bool:
    try:
        return bool(compiler_for(platform))
    except EnvironmentProblem:
        return False


def headers() -> Path:
    """The folder of the FMI headers, which fmpy ships."""
    found = importlib.util.find_spec("fmpy")
    assert found is not None and found.submodule_search_locations
    return Path(found.submodule_search_locations[0]) / "c-code"


def shim() -> Path:
    return template("native", "_native")


def link(compiled: Compiled, variables: Variables, guid: str, platform: str) -> dict[str, bytes]:
    """{slice of the platform: library}. Raises EnvironmentProblem without a compiler for it, InputError where it
    fails."""
    place = PLATFORMS[platform]
    return {part: _linked(compiled, variables, guid, part, place.ending) for part in place.slices}


def _linked(compiled: Compiled, variables: Variables, guid: str, part: str, ending: str) -> bytes:
    levels = TARGETS[part].levels
    with tempfile.TemporaryDirectory() as work:
        folder = Path(work)
        (folder / "table.c").write_text(c_table(compiled, variables, guid, levels), "utf-8")
        for name in (*SHIM, "device.h"):
            shutil.copyfile(shim() / name, folder / name)
        own = []
        if compiled.native:
            (folder / "native.c").write_text(compiled.native, "utf-8")
            own = ["native.c", *([f"-I{compiled.include}"] if compiled.include else [])]
        for level in levels:
            (folder / f"{level}.o").write_bytes(compiled.objects[part, level])
        sources = [*SHIM, *own, "table.c", *(f"{level}.o" for level in levels)]
        if part == "win64":
            shutil.copyfile(shim() / WINDOWS, folder / WINDOWS)
            sources += [WINDOWS, _math_of_windows(folder)]
        options = [*C_OPTIONS, f"-I{headers()}"]
        library = folder / f"{compiled.name}{ending}"
        _run(compiled.name, library_command(part, library, [*options, *sources, "-lm"]), folder)
        return library.read_bytes()


def link_source(sources: Sequence[Path], platform: str, *options: str) -> bytes:
    """The library for `platform` of one C source, the first, that needs nothing but C, the headers of FMI and the
    others, which it includes. Raises as `link` does."""
    place, first = PLATFORMS[platform], sources[0]
    with tempfile.TemporaryDirectory() as work:
        for source in sources:
            shutil.copyfile(source, Path(work) / source.name)
        found = {}
        for part in place.slices:
            library = Path(work) / f"{first.stem}{place.ending}"
            arguments = [*C_OPTIONS, *options, f"-I{headers()}", first.name, "-lm"]
            _run(first.name, library_command(part, library, arguments), Path(work))
            found[part] = library.read_bytes()
    return joined(found)


def library_command(part: str, library: Path, arguments: Sequence[str]) -> list[str]:
    """What makes `library` of one slice; `arguments`: sources, and options before and after them."""
    place = ["-Wl,-install_name", f"-Wl,@rpath/{library.name}"] if part in ZIG else []
    return [*compiler_for(part), "-shared", *OPTIONS[part], *place, "-o", str(library), *arguments]


def _math_of_windows(folder: Path) -> str:
    (folder / "math.def").write_text("LIBRARY msvcrt.dll\nEXPORTS\n" + "\n".join(MATH_OF_WINDOWS) + "\n")
    beside = str(Path(compiler_for("win64")[0]).parent)
    tool = next((t for n in (f"{MINGW}dlltool", "dlltool") if (t := shutil.which(n, path=beside))), f"{MINGW}dlltool")
    _run("msvcrt", [tool, "--deterministic-libraries", "-d", "math.def", "-l", "libmsmath.a"], folder)
    return "libmsmath.a"


def _run(name: str, command: Sequence[str], folder: Path) -> None:
    ended = run_program(command, folder, environment={"SOURCE_DATE_EPOCH": "0", "LC_ALL": "C"})
    if ended.returncode:
        said = [line.strip() for line in (ended.stderr + ended.stdout).splitlines() if line.strip()]
        worst = [line for line in said if "error" in line.lower() or "undefined" in line] or said or ["no message"]
        raise InputError(f"{name}: {command[0]} cannot link it: {worst[0]}")


def joined(slices: Mapping[str, bytes]) -> bytes:
    """One library of all slices: Apple's universal file, a table of slices in front of them (mach-o/fat.h)."""
    if len(slices) == 1:
        return next(iter(slices.values()))
    align, head, body = 14, [], b""
    start = 1 << align
    for content in slices.values():
        kind, subtype = struct.unpack_from("<II", content, 4)
        head.append(struct.pack(">5I", kind, subtype, start + len(body), len(content), align))
        body += content + bytes(-len(content) % (1 << align))
    return (struct.pack(">2I", 0xCAFEBABE, len(slices)) + b"".join(head)).ljust(start, b"\0") + body


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
        f"{len(compiled.first_state)}, {compiled.saved}, {int(not own)}, {'device_attach' if compiled.native else '0'}"
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
