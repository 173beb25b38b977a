"""What systems do differently stays in one room, and nothing outside it is needed to import the package."""

from __future__ import annotations

import ast
import ctypes
import importlib.util
import math
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path, PureWindowsPath
from types import ModuleType
from typing import Any
from unittest.mock import MagicMock

import pytest

import sprain_cosim
from sprain_cosim import files
from sprain_cosim.brace import new
from sprain_cosim.brace.compare import compare_braces
from sprain_cosim.errors import InputError
from sprain_cosim.folders.read import read_folder
from sprain_cosim.folders.run import check_run_folder
from sprain_cosim.machine import here
from sprain_cosim.machine.posix import Posix
from sprain_cosim.process import python_command
from sprain_cosim.shipped import PACKAGE
from sprain_cosim.study.folder import check_study_folder
from sprain_cosim.study.ledger import Ledger
from sprain_cosim.validation.writers import check_targets

ABSENT = """
import asyncio, importlib, multiprocessing.connection, os, pkgutil, select, signal, socket, subprocess, sys, time
import numpy, warnings
warnings.simplefilter("ignore")
for name in "fcntl resource pwd grp termios tty pty syslog readline curses crypt nis spwd _posixshmem".split():
    sys.modules[name] = None
for module, names in (
    (select, "poll epoll POLLIN POLLOUT"),
    (os, "fork forkpty setsid killpg getuid geteuid getgid getegid getppid getpgid getgroups sched_getaffinity"),
    (os, "pread pwrite pidfd_open chown fchown statvfs sysconf getloadavg memfd_create nice wait wait3 wait4 waitid"),
    (os, "mkfifo pipe2 posix_spawn register_at_fork environb O_CLOEXEC O_NOFOLLOW O_DIRECTORY O_NONBLOCK WNOHANG"),
    (signal, "setitimer alarm pause pthread_sigmask SIG_BLOCK"),
    (signal, "SIGKILL SIGALRM SIGXCPU SIGHUP SIGUSR1 SIGCHLD SIGPIPE SIGSTOP"),
    (socket, "AF_UNIX recv_fds send_fds SCM_RIGHTS CMSG_LEN SO_PEERCRED SOCK_CLOEXEC"),
    (time, "tzset clock_gettime"),
):
    for name in names.split():
        if hasattr(module, name):
            delattr(module, name)
import sprain_cosim
failed = []
for found in pkgutil.walk_packages(sprain_cosim.__path__, "sprain_cosim."):
    if found.name.endswith(("__main__", "machine.windows")):
        continue
    try:
        importlib.import_module(found.name)
    except Exception as problem:
        if "distributed" not in str(problem):
            failed.append(f"{found.name}: {type(problem).__name__}: {problem}")
print(len(sys.modules))
sys.exit("\\n".join(failed) or 0)
"""
OF_ONE_SYSTEM = tuple(f"sprain_cosim/{place}" for place in ("fork_server.py", "sandbox/", "machine/posix.py"))
ASKING = {"sys.platform", "os.name"}
ALLOWED = {  # who asks besides: what a file of a platform is made of, and what the kernel of Linux holds
    "fmu/library.py",
    "fmu/surroundings.py",
    "processor.py",
    "sandbox/kernel.py",
}


def test_every_module_is_imported_without_calls_of_linux_alone() -> None:
    """As on macOS and Windows, where some of them are absent."""
    ended = subprocess.run(
        [sys.executable, "-c", ABSENT], capture_output=True, text=True, cwd=PACKAGE.parent, timeout=120
    )
    assert ended.returncode == 0, ended.stderr
    assert int(ended.stdout) > 300


@pytest.mark.long
@pytest.mark.parametrize("system", ["win32", "darwin"])
def test_no_call_is_missing_on_another_system(system: str, tmp_path: Path) -> None:
    """What mypy says of the whole package there, but for the rooms of one system; not only of what is imported."""
    command = [sys.executable, "-m", "mypy", "--platform", system, "--cache-dir", str(tmp_path), "--no-error-summary"]
    said = subprocess.run(command, capture_output=True, text=True, cwd=PACKAGE.parent).stdout
    found = [line for line in said.splitlines() if not line.startswith(OF_ONE_SYSTEM)]
    assert [line for line in found if "itimer" not in line.lower()] == []  # asked for before


def test_systems_are_told_apart_in_one_room() -> None:
    asking = set()
    for path in PACKAGE.rglob("*.py"):
        tree = ast.parse(path.read_text("utf-8"))
        names = (n for n in ast.walk(tree) if isinstance(n, ast.Attribute) and isinstance(n.value, ast.Name))
        if any(ast.unparse(name) in ASKING for name in names):
            asking.add(path.relative_to(PACKAGE).as_posix())
    assert {name for name in asking if not name.startswith("machine/")} == ALLOWED


def test_every_system_shows_the_same_face() -> None:
    """Names of what `System` asks for, read without running the module for Windows."""
    faces = {
        name: {
            item.name if isinstance(item, ast.FunctionDef) else ast.unparse(item.targets[0])
            for node in ast.parse((PACKAGE / "machine" / f"{name}.py").read_text("utf-8")).body
            if isinstance(node, ast.ClassDef) and node.name == cls
            for item in node.body
            if isinstance(item, ast.FunctionDef | ast.Assign) and not ast.unparse(item).startswith("def _")
        }
        for name, cls in (("face", "OperatingSystem"), ("posix", "Posix"), ("windows", "Windows"))
    }
    assert faces["face"] == faces["posix"] == faces["windows"]
    assert len(faces["face"]) > 15


def test_a_lock_keeps_a_second_holder_out(tmp_path: Path) -> None:
    with (tmp_path / "lock").open("w") as first, (tmp_path / "lock").open("w") as second:
        assert here.SYSTEM.lock(first.fileno())
        assert not here.SYSTEM.lock(second.fileno())


@pytest.mark.parametrize(
    ("code", "status", "words"),
    [(-11, "crashed", "SIGSEGV"), (-24, "timeout", "processor time"), (3, "crashed", "exit code 3")],
)
def test_an_exit_code_is_put_into_words(code: int, status: str, words: str) -> None:
    ending = Posix().ending(code)
    assert ending.status == status
    assert words in ending.words


def test_a_child_does_not_import_from_the_current_folder() -> None:
    assert "-P" in python_command("sprain_cosim.fmu.isolated")


def test_a_child_imports_this_package_whichever_else_is_installed(tmp_path: Path) -> None:
    """Else parent and child are of two versions: a clone's landing is run by another release."""
    (tmp_path / "sprain_cosim").mkdir()
    (tmp_path / "sprain_cosim" / "__init__.py").write_text("raise SystemExit('another version')")
    command = [*python_command("sprain_cosim"), "--version"]
    said = subprocess.run(
        command,
        env=os.environ | {"PYTHONPATH": str(tmp_path)},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    assert sprain_cosim.__version__ in said.stdout


def test_a_name_that_the_system_does_not_have_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By that line, also where the system shows a file of that name."""
    monkeypatch.setattr(
        Posix, "refusal", lambda _, path, inside=0: "is the name of a device" if path.name == "aux" else ""
    )
    aux = tmp_path / "aux"
    aux.touch()
    for refused in (
        lambda: files.write(aux, "text"),
        lambda: files.read_text(aux),
        lambda: list(files.read_csv(aux)),
        lambda: files.read_frame(aux),
        lambda: read_folder(aux),
        lambda: check_run_folder(aux),
        lambda: check_study_folder(aux, resume=True),
        lambda: check_targets(aux, None),
        lambda: compare_braces("incline30", {"linear": "brace_linear"}, out=aux),
        lambda: Ledger(aux, "", {}),
        lambda: new.new_brace(aux, "c"),
    ):
        with pytest.raises(InputError, match="aux: is the name of a device"):
            refused()
    assert list(tmp_path.iterdir()) == [aux]
    assert not aux.read_bytes()


# ---- the room for Windows, as far as it asks nothing of Windows


class WindowsPath(PureWindowsPath):
    def absolute(self) -> PureWindowsPath:
        return PureWindowsPath("C:/Users/Jo") / self


@pytest.fixture(scope="module")
def windows() -> Iterator[ModuleType]:
    """The module as it is, in a world of two doubles: the calls of Windows themselves are tried under wine."""
    path = PACKAGE / "machine" / "windows.py"
    specification = importlib.util.spec_from_file_location("sprain_cosim.machine.windows_here", path)
    assert specification is not None and specification.loader is not None
    module = importlib.util.module_from_spec(specification)
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(sys.modules, "msvcrt", MagicMock())
        patch.setattr(ctypes, "WinDLL", MagicMock(), raising=False)
        patch.setattr(sys, "platform", "win32")
        specification.loader.exec_module(module)
        patch.setattr(sys, "platform", "linux")
        patch.setattr(module, "_long_paths", lambda: False)
        patch.setattr(module, "sleep", lambda _: None)
        yield module


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("aux", "the name of a device"),
        ("out/NUL", "the name of a device"),
        ("Con.toml", "the name of a device"),
        ("lpt1 .x/y", "the name of a device"),
        ("COM¹", "the name of a device"),
        ("what?", "a character that Windows has in no name"),
        ("out:stream", "a character that Windows has in no name"),
        ("end.", "ends with a point or a blank"),
        ("a/b /c", "ends with a point or a blank"),
        ("x" * 260, "characters, more than the 259"),
        ("../auxiliary/com10/null.toml", ""),
        ("D:/out/Jörg Müller", ""),
        ("//server/share/out", ""),
        ("//?/C:/" + "long/" * 80, ""),
    ],
)
def test_a_path_that_windows_does_not_have(windows: ModuleType, name: str, words: str) -> None:
    refusal = windows.Windows().refusal(WindowsPath(name))
    assert words in refusal if words else refusal == ""


def test_a_folder_needs_room_for_its_files(windows: ModuleType) -> None:
    path = WindowsPath("x" * 200)
    assert windows.Windows().refusal(path) == ""
    assert "292 characters with the files in it" in windows.Windows().refusal(path, inside=80)


def test_a_word_is_quoted_as_the_prompt_takes_it(windows: ModuleType) -> None:
    quoted = windows.Windows().quoted
    assert quoted(r"out\my_brace.fmu") == r"out\my_brace.fmu"
    assert quoted(r"C:\My braces\new.fmu") == r'"C:\My braces\new.fmu"'
    assert quoted("goal <= 2 %") == '"goal <= 2 %"'
    assert quoted("") == '""'
    assert here.SYSTEM.quoted("My braces/new.fmu") == "'My braces/new.fmu'"


@pytest.mark.parametrize(
    ("code", "status", "words"),
    [
        (-1073741819, "crashed", "an access violation (0xC0000005)"),
        (0xC0000409, "crashed", "a call of abort (0xC0000409)"),
        (0xC0FFEE00, "crashed", "condition 0xC0FFEE00"),
        (0xE0000002, "timeout", "processor time"),
        (3, "crashed", "exit code 3"),
    ],
)
def test_an_exit_code_of_windows_is_put_into_words(windows: ModuleType, code: int, status: str, words: str) -> None:
    ending = windows.Windows().ending(code)
    assert ending.status == status
    assert words in ending.words


def test_a_pipe_without_a_poll_is_read_with_a_limit(windows: ModuleType) -> None:
    source, sink = os.pipe()
    pipe = windows.Windows().pipe(source)
    with pytest.raises(TimeoutError):
        pipe.read(10, 0.0)
    os.write(sink, b"what comes late is kept")
    assert pipe.read(9, 5.0) == b"what come"
    assert pipe.read(100, math.inf) == b"s late is kept"
    os.close(sink)
    assert pipe.read(1, 5.0) == b""
    assert pipe.read(1, 0.5) == b""
    pipe.close()
    with pytest.raises(OSError, match="Bad file"):
        os.fstat(source)


def test_a_file_in_use_is_tried_again(windows: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "new").write_text("new")
    (tmp_path / "old").write_text("old")
    tries: list[Any] = []

    def held(source: Path, target: Path, replace: Any = os.replace) -> None:
        tries.append(target)
        if len(tries) < 3:
            raise PermissionError(13, "in use")
        replace(source, target)

    monkeypatch.setattr(windows.os, "replace", held)
    windows.Windows().rename(tmp_path / "new", tmp_path / "old")
    assert (len(tries), (tmp_path / "old").read_text()) == (3, "new")
    (tmp_path / "new").write_text("newer")
    monkeypatch.setattr(windows.os, "replace", lambda *_: (_ for _ in ()).throw(PermissionError(13, "in use")))
    with pytest.raises(PermissionError):
        windows.Windows().rename(tmp_path / "new", tmp_path / "old")
    assert (tmp_path / "old").read_text() == "new"


@pytest.mark.skipif(sys.platform == "win32", reason="process groups of POSIX")
def test_a_process_that_leads_no_group_is_ended() -> None:
    """A child that is ended before it has a group of its own must not be waited for in vain."""
    process = subprocess.Popen(["sleep", "600"])
    end = here.SYSTEM.group(process)
    ending = threading.Thread(target=end, daemon=True)
    ending.start()
    ending.join(30.0)
    code = process.poll()
    process.kill()
    assert code == -signal.SIGKILL
