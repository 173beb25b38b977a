"""The compiler of devices: what it refuses and in which words, what of numba it relies on, the same bytes from
everywhere."""

from __future__ import annotations

import ctypes
import shutil
import textwrap
import zipfile
from pathlib import Path

import llvmlite
import numba
import pytest

from sprain_cosim import EnvironmentProblem, InputError
from sprain_cosim.fmu.build import build_fmu, compile, link
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
    module, _ = compile.lower(device)
    monkeypatch.setattr(compile, "ALLOWED", ALLOWED - {"sin"})
    monkeypatch.setattr(compile, "_gates", gates := compile._gates)
    with pytest.raises(InputError, match=r"probe.device\.py: sin: no function that every host has"):
        gates(device, "declare double @sin(double)")
    with pytest.raises(InputError, match="an address of the building process"):
        gates(device, "store ptr inttoptr (i64 140214188845936 to ptr), ptr %x")
    assert "define" in module


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
    module, returns = compile.lower(device)
    assert returns == {"refresh": False}, "initialise, step and refresh are one function"
    defined = [line for line in module.splitlines() if line.startswith("define")]
    assert ["hidden" in line for line in defined if "@device_refresh(" in line] == [True], "seen by the linker alone"
    assert all("internal" in line for line in defined if "@device_" not in line)
    # the calling convention that the table's wrappers rely on: result, error, then the arguments
    entry = next(line for line in defined if "@device_refresh(" in line)
    assert [word for word in ("%retptr", "%excinfo", "%arg.values") if word in entry] == [
        "%retptr",
        "%excinfo",
        "%arg.values",
    ]
    assert 'c"ValueError: text (device.py, line 6)"' in module, "errors stand in .const.pickledata globals"
    for level in TARGETS["linux64"].levels:
        assert compile.emit(device, module, TARGETS["linux64"].triple, level).startswith(b"\x7fELF")


def test_without_numba_the_cure_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "hidden").mkdir()
    (tmp_path / "hidden" / "numba.py").write_text("raise ImportError('no', name='numba')")
    folder = project(tmp_path / "probe", "def refresh(values):\n    pass")
    monkeypatch.syspath_prepend(str(tmp_path / "hidden"))
    with pytest.raises(EnvironmentProblem, match=r"numba is not installed; to compile devices, .*\[build\]"):
        compile_devices([folder], ["linux64"])


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
