"""The compiler of devices: what it refuses and in which words, what of numba it relies on, the same bytes from
everywhere."""

from __future__ import annotations

import ctypes
import dataclasses
import os
import re
import shutil
import struct
import subprocess
import sys
import textwrap
import zipfile
from pathlib import Path
from typing import Any

import llvmlite
import numba
import pytest
from click.testing import CliRunner

from sprain_cosim import EnvironmentProblem, InputError
from sprain_cosim.cli import cli
from sprain_cosim.fmu.build import build_fmu, compile, link, models
from sprain_cosim.fmu.build.built import BuildRecord
from sprain_cosim.fmu.build.compile import ALLOWED, TARGETS, compile_devices
from sprain_cosim.fmu.build.device import read_device
from sprain_cosim.shipped import SOURCES

INTERFACE = """
MODEL = "probe"
DESCRIPTION = "made by a test"
PARAMETERS = (("k", "N.m/rad", 50.0, 0.0, 1000.0, "stiffness"),)
INPUTS = (("subtalar_angle", "rad", "angle"),)
OUTPUTS = (("subtalar_torque", "N.m", "torque", ("subtalar_angle",)),)
"""


def project(folder: Path, law: str, interface: str = INTERFACE) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "interface.py").write_text(interface)
    (folder / "device.py").write_text(textwrap.dedent(law).lstrip())
    return folder


def compiled_library(folder: Path, tmp_path: Path) -> ctypes.CDLL:
    build_fmu(folder, tmp_path / "probe.fmu")
    with zipfile.ZipFile(tmp_path / "probe.fmu") as archive:
        return ctypes.CDLL(archive.extract("binaries/linux64/probe.so", tmp_path))


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("print(values.k)", r"probe: device\.py, line 9: print cannot be compiled; .*--lang c"),
        ("table = {1: 2.0}", r"line 9: a dict cannot be compiled"),
        (
            "with open('x') as f: pass",
            r"line 9: a file cannot be compiled; device\.py, line 9: with cannot be compiled",
        ),
        ("values.k = math.gamma(values.k)", r"line 9: math\.gamma cannot be compiled"),
        ("values.k = random.random()", r"line 9: random numbers cannot be compiled"),
        ("values.k = np.linalg.norm(A)", r"line 9: numpy\.linalg cannot be compiled"),
        ("values.k = (A @ A)[0]", r"line 9: the matrix product @ cannot be compiled"),
        ("global A", r"line 9: a global variable that changes cannot be compiled"),
        ("values.k = helper(values.k)", r"line 5: a list cannot be compiled"),
        ("values.torque = 1.0", r"line 9: values has no torque \(known: "),
        ("values.k = undefined(1.0)", r"line 9: undefined is not defined"),
        ("values.k = 'text'", r"refresh cannot be compiled: device\.py, line 9: Cannot cast Literal"),
        ("A[0] = values.k", r"refresh cannot be compiled: device\.py, line 9: Cannot modify readonly array"),
        ("return 1.5", r"refresh returns float64; it may return nothing, or on every way a whole number"),
    ],
)
def test_what_cannot_be_compiled_is_named_with_its_line(body: str, message: str, tmp_path: Path) -> None:
    law = f"""
        import math, random
        import numpy as np
        A = np.zeros(3)
        def helper(x):
            return sum([x, x])


        def refresh(values):
            {body}
    """
    with pytest.raises(InputError, match=message) as caught:
        build_fmu(project(tmp_path / "probe", law), tmp_path / "probe.fmu")
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "probe.fmu").exists()


@pytest.mark.parametrize(
    ("law", "message"),
    [
        ("x = 1", r"device\.py: none of the functions initialise, step, refresh"),
        ("def refresh(v):\n    pass", r"refresh has an argument 'v'; it may have values, state, constants, time, step"),
        ("def refresh(values, constants):\n    pass", r"refresh has an argument 'constants'"),
        ("STATE = {'a': 'text'}\ndef refresh(values): pass", r"STATE: a: must be numbers or arrays of numbers"),
        ("GROUPS = {'a': ['k', 'z']}\ndef refresh(values): pass", r"GROUPS: group 'a': z is no variable"),
        ("GROUPS = {'a': ['k', 'subtalar_torque']}\ndef refresh(values): pass", r"do not stand next to each other"),
        ("REASONS = ('', 'at {a:.3f}')\ndef refresh(values): pass", r"may show one number of STATE"),
        ("SAVED_BEFORE = 'b'\ndef refresh(values): pass", r"SAVED_BEFORE = 'b' is no field of STATE"),
        ("import no_such_module", r"device\.py, line 1: ModuleNotFoundError: No module named 'no_such_module'"),
        ("def refresh(values) pass", r"device\.py: .* in line 1"),
    ],
)
def test_what_device_py_must_hold(law: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=message) as caught:
        build_fmu(project(tmp_path / "probe", law), tmp_path / "probe.fmu")
    assert "\n" not in str(caught.value)


def test_a_function_of_the_c_library_that_not_every_host_has_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    device = read_device(
        project(tmp_path / "probe", "import math\ndef refresh(values):\n    values.k = math.sin(values.k)")
    )
    code, _ = compile.lower(device)
    monkeypatch.setattr(compile, "ALLOWED", ALLOWED - {"sin"})
    monkeypatch.setattr(compile, "_gates", gates := compile._gates)
    with pytest.raises(InputError, match=r"probe.device\.py: sin: no function that every host has"):
        gates(code, "declare double @sin(double)")
    with pytest.raises(InputError, match="an address of the building process"):
        gates(code, "store ptr inttoptr (i64 140214188845936 to ptr), ptr %x")
    assert "define" in code.ir


def test_what_a_function_raises_reaches_the_host_with_its_line(tmp_path: Path) -> None:
    from tests.fmi.test_native_devices import Host

    law = """
        def refresh(values):
            if values.subtalar_angle > 0.5:
                raise ValueError("the strap is off")
            values.subtalar_torque = 1.0 / values.subtalar_angle
    """
    build_fmu(project(tmp_path / "probe", law), tmp_path / "probe.fmu")
    host = Host(tmp_path / "probe.fmu", tmp_path)
    host["subtalar_angle"] = 0.2
    host.start()
    assert host["subtalar_torque"] == 5.0
    for angle, said in (
        (0.6, "probe: at 0.003 s ValueError: the strap is off (device.py, line 3)"),
        (0.0, "probe: at 0.003 s ZeroDivisionError: division by zero"),
    ):
        host.fmu.reset()
        host["subtalar_angle"] = 0.2
        host.start()
        host["subtalar_angle"] = angle
        with pytest.raises(Exception, match="fmi2DoStep failed with status 3"):
            host.fmu.doStep(0.002, 0.001)
        assert host.messages[-1] == said


def test_a_reason_shows_a_number_of_the_state(tmp_path: Path) -> None:
    from tests.fmi.test_native_devices import Host

    law = """
        STATE = {"wear": 0.25}
        REASONS = ("", "100 % worn out at {wear:.3f}")
        def refresh(values):
            pass
        def step(values, state, time, step):
            state.wear += 0.5
            return 1 if state.wear > 1.0 else 0
    """
    build_fmu(project(tmp_path / "probe", law), tmp_path / "probe.fmu")
    host = Host(tmp_path / "probe.fmu", tmp_path)
    host.start()
    host.fmu.doStep(0.0, 0.001)
    with pytest.raises(Exception, match="failed with status 3"):
        host.fmu.doStep(0.001, 0.001)
    assert host.messages == ["probe: 100 % worn out at 1.250"]


def test_the_same_bytes_from_every_folder_and_process(tmp_path: Path) -> None:
    for name in ("a", "b/deeper"):
        shutil.copytree(SOURCES / "brace_rate_dependent", tmp_path / name)
        build_fmu(tmp_path / name, tmp_path / f"{Path(name).name}.fmu")
    assert (tmp_path / "a.fmu").read_bytes() == (tmp_path / "deeper.fmu").read_bytes()
    (tmp_path / "a" / "device.py").write_text((tmp_path / "a" / "device.py").read_text().replace("1.0 +", "1.5 +"))
    assert build_fmu(tmp_path / "a", tmp_path / "c.fmu") != build_fmu(tmp_path / "b" / "deeper", tmp_path / "d.fmu")


def test_the_package_that_builds_compiles_whatever_lies_where_it_is_called(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Called with `python -m` or from a script in another clone's folder, that clone would compile."""
    caller = tmp_path / "clone"
    for other in ("sprain_cosim", "numba", "numpy"):
        (caller / other).mkdir(parents=True)
        (caller / other / "__init__.py").write_text(f"raise SystemExit('the {other} beside the caller')")
    device = project(tmp_path / "probe", "def refresh(values):\n    values.subtalar_torque = values.k")
    build_fmu(device, tmp_path / "here.fmu")
    monkeypatch.chdir(caller)
    monkeypatch.setattr(sys, "path", [str(caller), *sys.path])
    build_fmu(device, tmp_path / "there.fmu")
    assert (tmp_path / "there.fmu").read_bytes() == (tmp_path / "here.fmu").read_bytes()
    shutil.rmtree(caller / "numba"), shutil.rmtree(caller / "numpy")
    monkeypatch.setenv("PYTHONPATH", str(caller))  # of a clone's user; what it names beside the package is meant
    build_fmu(device, tmp_path / "path.fmu")
    assert (tmp_path / "path.fmu").read_bytes() == (tmp_path / "here.fmu").read_bytes()


def test_what_the_compiler_uses_of_numba_that_is_no_api(tmp_path: Path) -> None:
    """Pinned in pyproject.toml; where a new version changes it, this says what."""
    assert numba.__version__.startswith("0.68."), "read this test, then pyproject.toml, before another version"
    assert llvmlite.__version__.startswith("0.50.")
    law = """
        import math
        def refresh(values):
            values.subtalar_torque = other(values.subtalar_angle)
        def other(x):
            if x > 1.0:
                raise ValueError("text")
            return math.exp(x)
    """
    device = read_device(project(tmp_path / "probe", law))
    code, returns = compile.lower(device)
    assert returns == {"refresh": False}, "initialise, step and refresh are one function"
    defined = [line for line in code.ir.splitlines() if line.startswith("define")]
    assert ["hidden" in line for line in defined if "@device_refresh(" in line] == [True], "seen by the linker alone"
    assert all("internal" in line for line in defined if "@device_" not in line)
    # the calling convention that the table's wrappers rely on: result, error, then the arguments
    entry = next(line for line in defined if "@device_refresh(" in line)
    assert [word for word in ("%retptr", "%excinfo", "%arg.values") if word in entry] == [
        "%retptr",
        "%excinfo",
        "%arg.values",
    ]
    assert 'c"ValueError: text (device.py, line 6)"' in code.ir, "errors stand in .const.pickledata globals"
    for level in TARGETS["linux64"].levels:
        assert compile.emit(code, TARGETS["linux64"].triple, level).startswith(b"\x7fELF")


@pytest.fixture
def without_numba(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As where the extra [build] is not installed: neither this process nor one that compiles has numba."""
    (tmp_path / "hidden").mkdir()
    (tmp_path / "hidden" / "numba.py").write_text("raise ModuleNotFoundError('no', name='numba')")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path / "hidden"), prepend=os.pathsep)
    monkeypatch.setitem(sys.modules, "numba", None)


def test_without_numba_the_cure_is_named(tmp_path: Path, without_numba: None) -> None:
    folder = project(tmp_path / "probe", "def refresh(values):\n    pass")
    importing = project(tmp_path / "other", "import numba\n\ndef refresh(values):\n    pass")
    for at_fault in (folder, importing):
        with pytest.raises(EnvironmentProblem, match=r"numba is not installed; to compile devices, .*\[build\]"):
            compile_devices([at_fault], ["linux64"])


def test_a_build_without_a_change_compiles_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(models, "SOURCES", tmp_path / "fmus")
    monkeypatch.setattr(models, "FMUS", tmp_path / "built")
    monkeypatch.setattr(models, "usual_platforms", lambda: ("linux64",))
    one, two = (
        project(tmp_path / "fmus" / name, f"def refresh(values):\n    values.subtalar_torque = {k}.0")
        for k, name in enumerate(("one", "two"))
    )
    first = models.build_all()
    assert [(b.file.name, b.new) for b in first] == [
        ("one.fmu", True), ("one_fmi3.fmu", True), ("two.fmu", True), ("two_fmi3.fmu", True),
    ]  # fmt: skip
    with monkeypatch.context() as bare:
        bare.setenv("PATH", "")
        outcome = CliRunner().invoke(cli, ["build"])
        assert outcome.exit_code == 0, outcome.output
        assert {line.split()[-1] for line in outcome.output.splitlines()} == {"current"}
    asked: list[Path] = []
    compiler = models.compile_devices

    def watched(folders: list[Path], slices: list[str]) -> list[compile.Compiled]:
        asked.extend(folders)
        return compiler(folders, slices)

    monkeypatch.setattr(models, "compile_devices", watched)
    assert [(b.file, b.guid) for b in models.build_all()] == [(b.file, b.guid) for b in first]
    assert asked == [], "current: what compiles is not asked"
    (two / "device.py").write_text("def refresh(values):\n    values.subtalar_torque = 5.0\n")
    told: list[str] = []
    assert [b.new for b in models.build_all(tell=told.append)] == [False, False, True, True]
    assert asked == [two] and told[0] == "compiling two for linux64", "the plant is not among them"
    record = BuildRecord.read(tmp_path / "built")
    assert record.current(one, ["linux64"])
    assert not record.current(one, ["linux64", "win64"])
    (tmp_path / "built" / "one.fmu").write_bytes(b"damaged")
    assert not record.current(one, ["linux64"])
    (tmp_path / "built" / "built.json").write_text("[]")
    assert not BuildRecord.read(tmp_path / "built").current(two, ["linux64"])
    with pytest.raises(InputError, match=r"'tow' is not in .*did you mean two"):
        models.build_all(["tow"])
    with pytest.raises(InputError, match=r"'linux' is not one of linux64, win64, darwin64 \(did you mean linux64"):
        models.build_all(platforms=["linux"])


def test_a_quick_build_makes_what_landings_on_this_machine_need(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(models, "SOURCES", tmp_path / "fmus")
    monkeypatch.setattr(models, "FMUS", tmp_path / "built")
    for name in ("one", "plant_mujoco"):
        project(tmp_path / "fmus" / name, "def refresh(values):\n    values.subtalar_torque = 1.0")
    outcome = CliRunner().invoke(cli, ["build", "--quick"])
    assert outcome.exit_code == 0, outcome.output
    assert outcome.stderr.splitlines()[0] == "compiling one for linux64", "a minute is not silent"
    assert outcome.stderr.splitlines()[1].startswith("one: done after ")
    assert "win64" not in outcome.output
    assert sorted(p.name for p in (tmp_path / "built").iterdir()) == ["built.json", "one.fmu", "one_fmi3.fmu"]
    quick = (tmp_path / "built" / "one.fmu").read_bytes()
    named = CliRunner().invoke(cli, ["build", "--quick", "plant_mujoco"])
    assert "plant_mujoco.fmu" in named.stdout, "what is named is built"
    monkeypatch.setattr(models, "usual_platforms", lambda: ("linux64",))
    assert [b.new for b in models.build_all()] == [False] * 4, "what is there is not built again"
    assert (tmp_path / "built" / "one.fmu").read_bytes() == quick


def test_the_longest_device_is_compiled_beside_the_others(tmp_path: Path) -> None:
    long, middle, *short = (
        models.Face(project(tmp_path / f"device_{k}", "x = 0\n" * lines), "", [], None)
        for k, lines in enumerate((900, 300, 100, 100, 50))
    )
    assert models._shares([*short, middle, long], 2) == [[long], [middle, *short]]
    assert models._shares([long], 8) == [[long]]
    assert models._shares([], 2) == []


def test_an_object_from_a_process_of_its_own_is_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    device = read_device(project(tmp_path / "probe", "def refresh(values):\n    values.subtalar_torque = values.k"))
    code, _ = compile.lower(device)
    for target in ("linux64", "win64"):
        goal = TARGETS[target].triple, TARGETS[target].levels[-1]
        assert compile._emitted_apart(code, *goal) == compile.emit(code, *goal)
    head = re.compile(r"(define .*@device_refresh\(.*\n(?:\w+:.*\n)?)")
    ir = head.sub(r"\1  call void @foreign()\n", code.ir) + "\ndeclare void @foreign()\n"
    at_fault = dataclasses.replace(code, ir=ir)
    with pytest.raises(InputError, match=r"probe.device\.py: foreign: no function that every host has"):
        compile._emitted_apart(at_fault, *goal)


def test_the_library_for_macos_has_both_processors_and_every_function(tmp_path: Path) -> None:
    """Linked and never run: what its file says (mach-o/loader.h, nlist.h)."""
    pytest.importorskip("ziglang", reason="ziglang is not installed: no linker for macOS")
    build_fmu(SOURCES / "brace_linear", tmp_path / "brace.fmu", ["linux64", "darwin64"])
    with zipfile.ZipFile(tmp_path / "brace.fmu") as archive:
        both = archive.read("binaries/darwin64/brace_linear.dylib")
        linux = tmp_path / archive.extract("binaries/linux64/brace_linear.so", tmp_path)
    functions = {name for name in exported(linux) if name.startswith("fmi")}
    assert len(functions) > 100
    count = struct.unpack_from(">2I", both)[1]
    found = {}
    for k in range(count):
        kind, _, start, length, _ = struct.unpack_from(">5I", both, 8 + 20 * k)
        found[kind] = of_macos(both[start : start + length])
    assert set(found) == {0x01000007, 0x0100000C}, "x86-64 and arm64"
    assert found[0x0100000C]["signed"], "arm64 loads nothing that is not signed"
    for here in found.values():
        assert here["filetype"] == 6, "a dynamic library"
        assert here["libraries"] == ["/usr/lib/libSystem.B.dylib"]
        assert here["name"] == "@rpath/brace_linear.dylib"
        assert functions == {name.removeprefix("_") for name in here["exported"] if name.startswith("_fmi")}


def exported(library: Path) -> list[str]:
    ended = subprocess.run(["nm", "-D", "--defined-only", str(library)], capture_output=True, text=True, check=True)
    return [line.split()[-1] for line in ended.stdout.splitlines()]


def of_macos(slice_: bytes) -> dict[str, Any]:
    """Of one processor's part: its kind, libraries, own name, whether it is signed, the symbols it shows."""
    assert struct.unpack_from("<I", slice_)[0] == 0xFEEDFACF
    kind, commands = struct.unpack_from("<2I", slice_, 12)
    found: dict[str, Any] = {"filetype": kind, "libraries": [], "signed": False, "exported": []}
    at = 32
    for _ in range(commands):
        command, size = struct.unpack_from("<2I", slice_, at)
        if command in (0x0C, 0x0D):  # LC_LOAD_DYLIB, LC_ID_DYLIB
            text = slice_[at + struct.unpack_from("<I", slice_, at + 8)[0] : at + size].split(b"\0")[0].decode()
            if command == 0x0C:
                found["libraries"].append(text)
            else:
                found["name"] = text
        elif command == 0x1D:  # LC_CODE_SIGNATURE
            start, length = struct.unpack_from("<2I", slice_, at + 8)
            found["signed"] = slice_[start : start + 4] == bytes.fromhex("fade0cc0") and start + length <= len(slice_)
        elif command == 0x02:  # LC_SYMTAB
            table, symbols, texts, _ = struct.unpack_from("<4I", slice_, at + 8)
            for k in range(symbols):
                name, mark = struct.unpack_from("<IB", slice_, table + 16 * k)
                if mark & 0x0F == 0x0F:  # external, and defined in a section
                    found["exported"].append(slice_[texts + name :].split(b"\0", 1)[0].decode())
        at += size
    return found


def test_an_installed_package_has_nothing_to_build(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(models, "SOURCES", tmp_path)
    assert models.build_all() == models.build_all(["plant"]) == []
    with pytest.raises(InputError, match=r"'plnat' is not in .*did you mean plant"):
        models.build_all(["plnat"])


def test_the_file_of_two_processors_is_apple_s() -> None:
    """A table of big-endian words, then each slice at a page of 16 KiB."""
    slices = {
        "darwin64": struct.pack("<III", 0xFEEDFACF, 0x01000007, 3) + b"intel",
        "aarch64-darwin": struct.pack("<III", 0xFEEDFACF, 0x0100000C, 0) + b"arm",
    }
    whole = link.joined(slices)
    assert struct.unpack_from(">II", whole) == (0xCAFEBABE, 2)
    for k, content in enumerate(slices.values()):
        kind, subtype, offset, size, align = struct.unpack_from(">5I", whole, 8 + 20 * k)
        assert (kind, subtype) == struct.unpack_from("<II", content, 4)
        assert offset % (1 << align) == 0
        assert whole[offset : offset + size] == content
    assert link.joined({"linux64": b"elf"}) == b"elf"


def test_without_a_c_compiler_the_cure_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(EnvironmentProblem, match="no C compiler: none of cc, gcc, clang on the PATH"):
        link.compiler_for("linux64")
    with pytest.raises(EnvironmentProblem, match="on Debian install gcc-mingw-w64-x86-64"):
        link.compiler_for("win64")
    monkeypatch.setenv("CC", "no-such-cc")
    with pytest.raises(EnvironmentProblem, match="CC names, no-such-cc, is not there"):
        link.compiler_for("linux64")
