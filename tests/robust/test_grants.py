"""What the sandbox is told to let through, and what it cannot hold.

Devices that need more than the sandbox gives: a licence server of this machine, a server of their own on loopback, an
interpreter, a licence file. Each is refused without a grant, `check` prints the line of a mapping file that grants it,
and with that line it works and the summary says so. A kernel that lacks a part of the sandbox is one warning."""

from __future__ import annotations

import json
import os
import platform
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from sprain_cosim import check_brace
from sprain_cosim.cli import _run
from sprain_cosim.errors import SprainError
from sprain_cosim.fmu.cache import file_sha256
from sprain_cosim.sandbox.kernel import SIGNAL_ABI, offered
from sprain_cosim.sandbox.syscalls import COLUMNS
from tests.native import mischief

OFFER = offered()
pytestmark = pytest.mark.skipif(OFFER.landlock < SIGNAL_ABI or not OFFER.seccomp, reason=f"this kernel offers {OFFER}")
own_network = pytest.mark.skipif(not OFFER.namespaces, reason="no network namespaces")
NEEDS = {  # what a device needs, and what `check` says that it is
    "licence_server": ("network", "network"),
    "own_server": ("loopback", "network"),  # where to is not known of a socket that is refused
    "interpreter": ("exec", "exec"),
    "licence_file": ("read:{folder}/licence", "read:{folder}/licence"),
}


@pytest.fixture(scope="module")
def server() -> Iterator[int]:
    """The port of a licence server that answers everybody."""
    with socket.create_server(("127.0.0.1", 0)) as listening:

        def serve() -> None:
            while True:
                try:
                    wire = listening.accept()[0]
                except OSError:
                    return
                with wire:
                    wire.sendall(b"20\n")

        threading.Thread(target=serve, daemon=True).start()
        yield listening.getsockname()[1]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, server: int) -> Path:
    """Devices and the licence file."""
    place = tmp_path_factory.mktemp("grants")
    (place / "licence").write_text("20\n")
    for kind in NEEDS:
        mischief(place / f"{kind}.fmu", kind, place, server)
    return place


def run(
    folder: Path, kind: str, word: str, capsys: pytest.CaptureFixture[str], *options: str
) -> tuple[int, dict[str, object], str]:
    """Exit code, summary ({} for none) and stderr of a run; `word` is what its mapping file grants, "" for none."""
    table = folder / f"{kind}.map.toml"
    table.write_text(f"allow = {json.dumps([word] if word else [])}\n")
    devices = ["--fmu", f"brace={folder / kind}.fmu", "--map", f"brace={table}"]
    code = _run(["run", "incline30", *devices, "--stop", "2 ms", "--json", *options], [])
    out, err = capsys.readouterr()
    return code, json.loads(out) if code == 0 else {}, err


@pytest.mark.parametrize("kind", [pytest.param(k, marks=own_network) if k == "own_server" else k for k in NEEDS])
def test_refused_without_and_works_with(kind: str, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    word = NEEDS[kind][0].format(folder=folder)
    code, _, err = run(folder, kind, "", capsys)
    assert code == 3, err
    code, summary, err = run(folder, kind, word, capsys)
    assert code == 0, err
    assert (summary["isolation"], summary["granted"]) == ("sandbox", {"brace": [word]})
    assert f"may use {word} beyond the sandbox" in err


@own_network
def test_loopback_reaches_no_server_of_the_machine(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(folder, "licence_server", "loopback", capsys)[0] == 3


def test_a_grant_is_no_other_grant(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(folder, "interpreter", "network", capsys)[0] == 3
    assert run(folder, "licence_file", "exec", capsys)[0] == 3


@pytest.mark.parametrize("kind", NEEDS)
def test_check_prints_the_line(kind: str, folder: Path) -> None:
    """Whether it goes on or not."""
    word = NEEDS[kind][1].format(folder=folder)
    try:
        report = check_brace(folder / f"{kind}.fmu")
        said = report.text()
        assert file_sha256(folder / f"{kind}.fmu") in said
    except SprainError as problem:
        said = str(problem)
    assert f'allow = ["{word}"]' in said
    if kind == "own_server":
        assert '"loopback" in its place' in said


# a kernel that answers ENOSYS to calls that it does not know, for this program and all that it starts
OLD_KERNEL = """
import ctypes, os, platform, struct, sys
from sprain_cosim.sandbox import kernel, seccomp
assert kernel.prctl(38, 1) == 0
program = [(seccomp.LOAD, 0, 0, seccomp.NUMBER)]
for number in map(int, sys.argv[1].split(",")):
    program += [(seccomp.EQUAL, 0, 1, number), (seccomp.RETURN, 0, 0, seccomp.ERRNO | 38)]
program.append((seccomp.RETURN, 0, 0, seccomp.ALLOW))
seccomp.install(b"".join(struct.pack("<HBBI", *one) for one in program))
os.execv(sys.executable, [sys.executable, "-P", "-m", "sprain_cosim", *sys.argv[2:]])
"""
LANDLOCK = (444, 445, 446)


@pytest.mark.parametrize(
    ("lacks", "kind", "gaps"),
    [
        ("Landlock", "sandbox", ["files"]),
        ("Landlock and the filter", "process", ["files", "system calls", "network", "signals"]),
    ],
)
def test_an_old_kernel_is_one_warning(lacks: str, kind: str, gaps: list[str], tmp_path: Path) -> None:
    """A device that takes a file elsewhere: it succeeds, as the one line says that it may; the run says how it ran."""
    (tmp_path / "secret").write_text("what is not yours")
    fmu = mischief(tmp_path / "thief.fmu", "steal", tmp_path)
    unknown = LANDLOCK if lacks == "Landlock" else (*LANDLOCK, COLUMNS[platform.machine()]["seccomp"])
    command = ["run", "incline30", "--fmu", f"brace={fmu}", "--stop", "12 ms", "--json"]
    ran = subprocess.run(
        [sys.executable, "-c", OLD_KERNEL, ",".join(map(str, unknown)), *command],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        check=False,
    )
    assert ran.returncode == 0, ran.stderr
    assert json.loads(ran.stdout)["isolation"] == kind
    warnings = [line for line in ran.stderr.splitlines() if "this machine holds foreign FMUs only in part" in line]
    assert len(warnings) == 1
    assert [part.split(":")[0] for part in warnings[0].split("in part: ")[1].split("; ")] == gaps
    assert (tmp_path / "stolen").exists()
