"""FMUs without a library that can be loaded here: what is there, where it is looked for, what to do."""

from __future__ import annotations

import os
import platform
import shutil
import struct
import subprocess
import sys
import zipfile
from pathlib import Path

import fmpy
import pytest

from sprain_cosim import check_brace
from sprain_cosim.errors import InputError
from sprain_cosim.fmu import library
from sprain_cosim.fmu.component import Component
from tests.docs_commands import ROOT, blocks
from tests.native import SOURCES, device

LISTED = '<CoSimulation modelIdentifier="device"><SourceFiles><File name="all.c"/></SourceFiles></CoSimulation>'


@pytest.fixture(scope="module")
def devices(tmp_path_factory: pytest.TempPathFactory) -> dict[int, Path]:
    folder = tmp_path_factory.mktemp("devices")
    return {fmi: device(folder / f"{fmi}.fmu", fmi) for fmi in (1, 2, 3)}


def with_files(fmu: Path, target: Path, *names: str, description: str | None = None, **content: str) -> Path:
    """The description, or another one, with these files in place of the library; `content` {name: text} of sources."""
    with zipfile.ZipFile(fmu) as old, zipfile.ZipFile(target, "w") as new:
        text = old.read("modelDescription.xml").decode()
        new.writestr("modelDescription.xml", description or text)
        for name in names:
            new.writestr(name, "x")
        for name, source in content.items():
            new.writestr(f"sources/{name}.c", source)
    return target


def listing_sources(fmu: Path) -> str:
    with zipfile.ZipFile(fmu) as archive:
        text = archive.read("modelDescription.xml").decode()
    start = text.index("<CoSimulation ")
    return text[:start] + LISTED + text[text.index("/>", start) + 2 :]


def dll(machine: int = 0x8664, size: int = 512) -> bytes:
    """The headers of a DLL with one section of `size` bytes, 512 of which are there."""
    header = b"MZ".ljust(60, b"\0") + struct.pack("<I", 64)
    kind = struct.pack("<4sHH12xHH", b"PE\0\0", machine, 1, 0, 0x2022)
    section = struct.pack("<8sIIII16x", b".text", size, 4096, size, 128)
    return (header + kind + section).ljust(128, b"\0") + bytes(512)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (dll(), ""),
        (dll(machine=0x014C), "is no 64-bit DLL for AMD64"),
        (dll(size=4096), "is cut off; export the FMU again"),
        (dll()[:70], "is no DLL; export the FMU again"),
        (b"\x7fELF", "is no shared library for this platform"),
    ],
)
def test_a_dll_is_judged_before_it_is_loaded(content: bytes, words: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "win32")
    monkeypatch.setattr(platform, "machine", lambda: "AMD64")
    found = library.problem(content)
    assert found.startswith(words)
    assert bool(found) == bool(words)


def test_an_fmu_for_linux_alone_is_refused_on_windows(
    devices: dict[int, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    """As `find` sees it, which goes by what fmpy says of the machine."""
    for name, value in (
        ("sharedLibraryExtension", ".dll"),
        ("platform", "win64"),
        ("platform_tuple", "x86_64-windows"),
    ):
        monkeypatch.setattr(fmpy, name, value)
    with pytest.raises(InputError) as caught:
        library.find(devices[2], "device", "2.0", ["binaries/linux64/device.so"], False)
    assert str(caught.value).endswith(
        'made for Linux only (linux64); ask its maker: "Please export this FMU as FMI 2.0 co-simulation for win64 as '
        'well, or with its C sources"'
    )


WINDOWS = (
    'made for Windows only (win64); ask its maker: "Please export this FMU as FMI 2.0 co-simulation for linux64 as '
    'well, or with its C sources"'
)
WASM = "only WebAssembly (wasm32-wasip2, draft FMI-LS-WASM), which nothing here runs; ask its maker"


@pytest.mark.parametrize(
    ("fmi", "names", "words"),
    [
        (2, ["binaries/linux64/Device.so"], "binaries/linux64/device.so is looked for, by its modelIdentifier"),
        (2, ["binaries/linux64/Device.so"], "but binaries/linux64/Device.so is there; ask its maker"),
        (3, ["binaries/linux64/device.so"], "but binaries/linux64/device.so is there"),
        (2, ["binaries/x86_64-linux/device.so"], "but binaries/x86_64-linux/device.so is there"),
        (2, ["binaries/win64/device.dll"], WINDOWS),
        (3, ["binaries/x86_64-windows/device.dll", "binaries/x86-windows/d.dll"], "for Windows only (x86-windows, "),
        (1, ["binaries/win32/device.dll"], "for Windows only (win32)"),
        (2, ["binaries/darwin64/device.dylib", "binaries/win64/device.dll"], "made for others (darwin64, win64)"),
        (3, ["binaries/aarch64-darwin/device.dylib"], "made for others (aarch64-darwin)"),
        (3, ["binaries/wasm32-wasip2/device.wasm"], WASM),
        (2, [], "made for no platform (no binaries)"),
        (2, ["sources/all.c"], "only its C sources; build the library from them: it does not list them, so by hand: "
                               "docs/exporting.md, From C sources"),
        (2, ["sources/all.c", "binaries/win64/device.dll"], "only its C sources"),
        (3, ["sources/all.c", "sources/buildDescription.xml"], "fmpy compile "),
    ],
)  # fmt: skip
def test_words(fmi: int, names: list[str], words: str, devices: dict[int, Path], tmp_path: Path) -> None:
    fmu = with_files(devices[fmi], tmp_path / "d.fmu", *names)
    with pytest.raises(InputError, match="no binary for this platform: ") as caught:
        Component.read("brace", fmu)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_command_is_quoted(devices: dict[int, Path], tmp_path: Path) -> None:
    fmu = with_files(devices[2], tmp_path / "my d.fmu", "sources/all.c", description=listing_sources(devices[2]))
    with pytest.raises(InputError) as caught:
        Component.read("brace", fmu)
    assert str(caught.value).endswith(
        f"build the library from them: fmpy compile '{fmu}' (needs CMake and a C compiler)"
    )


def sources() -> dict[str, str]:
    """device.c as the sources of an FMU that needs no macros."""
    names = {"all": "device.c", "more": "stubs.c"}
    return {name: f"#define FMI 2\n{(SOURCES / file).read_text()}" for name, file in names.items()}


def test_the_page_builds_the_library(devices: dict[int, Path], tmp_path: Path) -> None:
    """docs/exporting.md, From C sources, as it stands there."""
    with_files(devices[2], tmp_path / "device.fmu", **sources())
    (block,) = [b for b in blocks(ROOT / "docs" / "exporting.md") if "gcc -shared" in b.text]
    search = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    if not shutil.which("zip") or not shutil.which("unzip"):
        pytest.skip("needs zip and unzip")
    subprocess.run(["bash", "-e", "-c", block.text], cwd=tmp_path, env={**os.environ, "PATH": search}, check=True)
    assert check_brace(tmp_path / "device.fmu").fits


@pytest.mark.long
def test_fmpy_builds_the_library(devices: dict[int, Path], tmp_path: Path) -> None:
    listed = listing_sources(devices[2]).replace('<File name="all.c"/>', '<File name="all.c"/><File name="more.c"/>')
    fmu = with_files(devices[2], tmp_path / "device.fmu", description=listed, **sources())
    subprocess.run([Path(sys.executable).parent / "fmpy", "compile", fmu], check=True, capture_output=True)
    assert check_brace(fmu).fits
