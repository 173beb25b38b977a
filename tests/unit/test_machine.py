"""What systems do differently stays in one room, and nothing outside it is needed to import the package."""

from __future__ import annotations

import ast
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from sprain_cosim import files
from sprain_cosim.brace import new
from sprain_cosim.errors import InputError
from sprain_cosim.folders.run import check_run_folder
from sprain_cosim.machine import here
from sprain_cosim.machine.posix import Posix
from sprain_cosim.process import python_command
from sprain_cosim.shipped import PACKAGE
from sprain_cosim.study.ledger import Ledger

ABSENT = """
import sys, os, select, importlib, pkgutil, signal, socket, warnings
warnings.simplefilter("ignore")
for name in ("fcntl", "resource", "pwd", "grp", "termios"):
    sys.modules[name] = None
for module, names in (
    (select, ("poll", "epoll")),
    (os, ("fork", "setsid", "killpg", "getuid", "geteuid", "getppid", "sched_getaffinity", "pread")),
    (signal, ("setitimer", "SIGALRM", "SIGXCPU")),
    (socket, ("AF_UNIX", "recv_fds", "send_fds")),
):
    for name in names:
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
ASKING = {"sys.platform", "os.name"}
ALLOWED = {  # who asks besides: what a file of a platform is made of, and what the kernel of Linux holds
    "fmu/library.py",
    "fmu/surroundings.py",
    "processor.py",
    "sandbox/kernel.py",
    "validation/laboratory.py",
}


def test_every_module_is_imported_without_calls_of_linux_alone() -> None:
    """As on macOS and Windows, where some of them are absent."""
    ended = subprocess.run(
        [sys.executable, "-c", ABSENT], capture_output=True, text=True, cwd=PACKAGE.parent, timeout=120
    )
    assert ended.returncode == 0, ended.stderr
    assert int(ended.stdout) > 300


def test_systems_are_told_apart_in_one_room() -> None:
    asking = set()
    for path in PACKAGE.rglob("*.py"):
        tree = ast.parse(path.read_text("utf-8"))
        if any(ast.unparse(node) in ASKING for node in ast.walk(tree) if isinstance(node, ast.Attribute)):
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


def test_a_name_that_the_system_does_not_have_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Posix, "refusal", lambda _, path: "is the name of a device" if path.name == "aux" else "")
    for refused in (
        lambda: files.write(tmp_path / "aux", "text"),
        lambda: check_run_folder(tmp_path / "aux"),
        lambda: Ledger(tmp_path / "aux", "", {}),
        lambda: new.new_brace(tmp_path / "aux", "c"),
    ):
        with pytest.raises(InputError, match="aux: is the name of a device"):
            refused()
    assert not any(tmp_path.iterdir())


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
