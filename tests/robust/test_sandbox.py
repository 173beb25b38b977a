"""The sandbox: what code in it may not reach, what it may, what is granted, what is seen from outside. Attempts are
those of tests/sources/intruder.c, each of which succeeds without the sandbox."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from sprain_cosim.errors import InputError
from sprain_cosim.sandbox.allowed import Allowed, allowed
from sprain_cosim.sandbox.confinement import Confinement
from sprain_cosim.sandbox.kernel import NETWORK_ABI, SIGNAL_ABI, Offer, offered
from sprain_cosim.sandbox.syscalls import ARCHITECTURES, COLUMNS, NEWEST, refusals
from sprain_cosim.sandbox.watch import Attempt, Watch
from tests.native import SOURCES

OFFER = offered()
FULL = OFFER.landlock >= SIGNAL_ABI and OFFER.seccomp
needs_all = pytest.mark.skipif(not FULL, reason=f"this kernel offers {OFFER}")
HARNESS = """
import ctypes, json, os, socket, sys
from sprain_cosim.sandbox.allowed import allowed
from sprain_cosim.sandbox.confinement import Confinement, enter
closed, library, scratch, report, words, code = json.loads(sys.argv[1])
os.chdir(scratch)
wire = socket.socket(fileno=report) if report else None
gaps = enter(Confinement((library,), scratch, allowed(words)), wire) if closed else []
loaded = ctypes.CDLL(library)
loaded.attempt_name.restype = ctypes.c_char_p
if code:
    exec(code)
    sys.exit()
own = os.getpid()
done = {}
for k in range(loaded.attempts()):
    done[loaded.attempt_name(k).decode()] = loaded.attempt(k)
    assert os.getpid() == own
print(json.dumps([gaps, [name for name, succeeded in done.items() if succeeded], list(done)]))
"""


@pytest.fixture(scope="module")
def intruder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Path, Path]]:
    """(library, folder that it is after)"""
    folder = tmp_path_factory.mktemp("intruder")
    target = folder / "target"
    target.mkdir()
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield build(folder / "intruder.so", target, server.getsockname()[1]), target


def build(library: Path, target: Path, port: int) -> Path:
    macros = [f'-DTARGET="{target}"', f"-DPORT={port}"]
    source = SOURCES / "intruder.c"
    subprocess.run(["gcc", "-shared", "-fPIC", "-O1", "-w", *macros, "-o", library, source, "-lm"], check=True)
    return library


def harness(
    intruder: tuple[Path, Path],
    scratch: Path,
    closed: bool = True,
    words: tuple[str, ...] = (),
    code: str = "",
    report: int = 0,
) -> str:
    library, target = intruder
    for left in target.iterdir():
        left.unlink()
    for name in ("secret", "victim"):
        (target / name).write_text("what is not yours")
    scratch.mkdir(exist_ok=True)
    arguments = json.dumps([closed, str(library), str(scratch), report, words, code])
    ran = subprocess.run(
        [sys.executable, "-c", HARNESS, arguments],
        capture_output=True,
        text=True,
        check=False,
        pass_fds=(report,) if report else (),
        start_new_session=True,
        timeout=120,
    )
    assert ran.returncode == 0, ran.stderr
    return ran.stdout


def succeeded(intruder: tuple[Path, Path], scratch: Path, **options: object) -> set[str]:
    return set(json.loads(harness(intruder, scratch, **options))[1])  # type: ignore[arg-type]


def test_the_attempts_succeed_without_a_sandbox(intruder: tuple[Path, Path], tmp_path: Path) -> None:
    """Else the next test would show nothing. Some need rights that a container or a plain user may lack."""
    _, done, tried = json.loads(harness(intruder, tmp_path / "scratch", closed=False))
    assert len(tried) >= 70
    assert len(done) >= 45, set(tried) - set(done)


@needs_all
def test_none_succeeds_in_it(intruder: tuple[Path, Path], tmp_path: Path) -> None:
    library = intruder[0].read_bytes()
    gaps, done, tried = json.loads(harness(intruder, tmp_path / "scratch"))
    assert (gaps, done) == ([], [])
    assert len(tried) >= 70
    assert intruder[0].read_bytes() == library
    assert {f.name: f.read_text() for f in intruder[1].iterdir()} == dict.fromkeys(
        ("secret", "victim"), "what is not yours"
    )


PROCESSES = {"forked", "vforked", "raw_clone", "shell", "spawned", "executed_from_memory"}


@needs_all
@pytest.mark.parametrize(
    ("words", "granted", "perhaps"),
    [
        (("network",), {"tcp", "udp", "listening"}, set()),
        (("exec",), PROCESSES, {"parent_files"}),  # root may list, not read, the descriptors of its processes
        (("read:{target}/secret",), {"secret_read", "link_read", "dot_dot_read", "openat2_read", "mapped_read"}, set()),
        pytest.param(
            ("loopback",),
            {"udp", "listening"},
            set(),
            marks=pytest.mark.skipif(not OFFER.namespaces, reason="no network namespaces"),
        ),
    ],
)
def test_what_is_granted_and_nothing_else(
    words: tuple[str, ...], granted: set[str], perhaps: set[str], intruder: tuple[Path, Path], tmp_path: Path
) -> None:
    """With loopback, UDP can be sent into a network that is empty; the test's own port is not reached."""
    named = tuple(word.format(target=intruder[1]) for word in words)
    assert granted <= succeeded(intruder, tmp_path / "scratch", words=named) <= granted | perhaps


@needs_all
def test_what_an_honest_library_needs_works(intruder: tuple[Path, Path], tmp_path: Path) -> None:
    """Scratch folder, temporary files, threads, memory, clocks, random numbers, its own signals, imports."""
    code = """
import json, pathlib, random, secrets, signal, tempfile, threading, time, zoneinfo
import numpy, scipy.linalg
pathlib.Path("made").write_text("1"); pathlib.Path("made").rename("moved"); pathlib.Path("moved").unlink()
os.mkdir("folder"); os.rmdir("folder")
tempfile.tempdir = scratch
tempfile.TemporaryFile().write(b"x")
seen = []
thread = threading.Thread(target=seen.append, args=(1,)); thread.start(); thread.join()
signal.signal(signal.SIGUSR1, lambda *_: seen.append(2)); os.kill(os.getpid(), signal.SIGUSR1)
time.sleep(0.001); secrets.token_bytes(8)
near, far = socket.socketpair(); near.send(b"x"); assert far.recv(1) == b"x"
assert abs(scipy.linalg.det(numpy.eye(3)) - 1) < 1e-12
open(os.devnull, "w").write("x")
os.cpu_count(), os.times(), os.getloadavg(), open("/proc/self/status").read()
print(json.dumps(seen))
"""
    assert json.loads(harness(intruder, tmp_path / "scratch", code=code)) == [1, 2]


@needs_all
def test_packages_that_are_linked_into_the_search_path_are_read(
    intruder: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """File by file, as uv does it in its link mode, or as a whole; a link to what is no package of theirs is none."""
    cache, packages = tmp_path / "cache", tmp_path / "lib" / "site-packages"
    for name in ("by_file/by_file/__init__.py", "by_file/by_file-1.dist-info/METADATA", "whole/__init__.py"):
        (cache / name).parent.mkdir(parents=True, exist_ok=True)
        (cache / name).write_text("FOUND = 1\n")
    (cache / "other.py").write_text("FOUND = 1\n")
    for name in ("by_file/__init__.py", "by_file-1.dist-info/METADATA"):
        (packages / name).parent.mkdir(parents=True)
        (packages / name).symlink_to(cache / "by_file" / name)
    (packages / "whole").symlink_to(cache / "whole")
    monkeypatch.setenv("PYTHONPATH", str(packages))
    code = f"""
import by_file, whole
try:
    read = open({str(cache / "other.py")!r}).read()
except PermissionError:
    read = ""
print(json.dumps([by_file.FOUND, whole.FOUND, read]))
"""
    assert json.loads(harness(intruder, tmp_path / "scratch", code=code)) == [1, 1, ""]


@needs_all
def test_programs_that_are_granted_stay_in_the_sandbox(intruder: tuple[Path, Path], tmp_path: Path) -> None:
    code = f"""
import subprocess
script = "cat {intruder[1]}/secret; echo x > {intruder[1]}/victim; setsid true; kill -0 {os.getpid()}; "
script += "echo there; echo y > own"
ran = subprocess.run(["/bin/sh", "-c", script], capture_output=True, text=True)
print(ran.stdout, open("own").read(), sep="")
"""
    assert harness(intruder, tmp_path / "scratch", words=("exec",), code=code) == "there\ny\n\n"
    assert (intruder[1] / "victim").read_text() == "what is not yours"


@needs_all
@pytest.mark.skipif(not OFFER.namespaces, reason="no network namespaces")
def test_a_server_of_its_own_on_loopback(intruder: tuple[Path, Path], tmp_path: Path) -> None:
    """Bound, found, answered, from a thread and from a process; the machine's loopback is another one."""
    code = """
import subprocess, threading
server = socket.create_server(("127.0.0.1", 0))
threading.Thread(target=lambda: server.accept()[0].sendall(b"there"), daemon=True).start()
print(socket.create_connection(server.getsockname()).recv(5).decode())
threading.Thread(target=lambda: server.accept()[0].sendall(b"again"), daemon=True).start()
program = f"import socket; print(socket.create_connection({server.getsockname()!r}).recv(5).decode())"
print(subprocess.run([sys.executable, "-c", program], capture_output=True, text=True).stdout, end="")
"""
    assert harness(intruder, tmp_path / "scratch", words=("loopback", "exec"), code=code) == "there\nagain\n"


@needs_all
def test_limits(intruder: tuple[Path, Path], tmp_path: Path) -> None:
    code = """
import resource
print([resource.getrlimit(k)[1] for k in (resource.RLIMIT_FSIZE, resource.RLIMIT_CORE)], end=" ")
print(resource.getrlimit(resource.RLIMIT_NOFILE)[1] <= 1024)
"""
    assert harness(intruder, tmp_path / "scratch", code=code) == f"[{1 << 30}, 0] True\n"


@needs_all
def test_attempts_are_seen_from_outside(intruder: tuple[Path, Path], tmp_path: Path) -> None:
    """The same 70 attempts with a supervisor: none succeeds, and what each was after is known."""
    library, target = intruder
    confinement = Confinement((str(library),), str(tmp_path / "scratch"))
    with Watch(confinement) as watch:
        os.set_inheritable(watch.far.fileno(), True)
        done = json.loads(harness(intruder, tmp_path / "scratch", report=watch.far.fileno()))[1]
    assert done == []
    refused = {(a.topic, a.detail) for a in watch.attempts if a.refused}
    assert ("files", f"{target}/secret") in refused
    assert ("processes", "") in refused
    assert ("programs", "") in refused
    assert ("signals", "") in refused
    assert {"sockets", "other processes", "process groups", "keys", "the machine"} <= {topic for topic, _ in refused}
    assert Attempt("files", "openat", f"{target}/victim", True, True) in watch.attempts
    assert not [a for a in watch.attempts if a.topic == "files" and str(library) in a.detail and not a.writes]


@needs_all
def test_what_is_allowed_is_seen_too(intruder: tuple[Path, Path], tmp_path: Path) -> None:
    code = """
import threading
os.umask(0o27); os.chdir("/"); open(scratch + "/log.txt", "w").write("x")
thread = threading.Thread(target=print); thread.start(); thread.join()
"""
    with Watch(Confinement((str(intruder[0]),), str(tmp_path / "scratch"))) as watch:
        os.set_inheritable(watch.far.fileno(), True)
        harness(intruder, tmp_path / "scratch", code=code, report=watch.far.fileno())
    seen = {(a.topic, a.detail, a.writes) for a in watch.attempts if not a.refused}
    assert {("umask", "", False), ("folder", "/", False), ("threads", "", False)} <= seen
    assert ("files", str(tmp_path / "scratch" / "log.txt"), True) in seen
    assert not [a for a in watch.attempts if a.refused]


@needs_all
def test_addresses_are_seen(intruder: tuple[Path, Path], tmp_path: Path) -> None:
    code = "socket.socket().connect_ex(('127.0.0.1', 27000)); socket.socket(socket.AF_INET6).connect_ex(('::1', 27001))"
    confinement = Confinement((str(intruder[0]),), str(tmp_path / "scratch"), Allowed(network=True))
    with Watch(confinement) as watch:
        os.set_inheritable(watch.far.fileno(), True)
        harness(intruder, tmp_path / "scratch", words=("network",), code=code, report=watch.far.fileno())
    assert {a.detail for a in watch.attempts if a.name == "connect"} == {"127.0.0.1 port 27000", "::1 port 27001"}


def test_the_words_of_a_mapping_file() -> None:
    found = allowed(["loopback", "read:/opt/licence/", "exec"])
    assert found == Allowed(loopback=True, execute=True, read=("/opt/licence",))
    assert found.words() == ["loopback", "exec", "read:/opt/licence"]
    assert (found | allowed(["network"])).words() == ["loopback", "network", "exec", "read:/opt/licence"]
    assert not Allowed()
    for wrong, words in (("netwrk", "did you mean network"), ("read:etc", "absolute path"), (3, "must be text")):
        with pytest.raises(InputError, match=words):
            allowed([wrong])


def test_what_a_kernel_lacks_is_said() -> None:
    assert Offer(7, True, True).gaps() == []
    assert [g.split(":")[0] for g in Offer(0, True).gaps()] == ["files"]
    assert [g.split(":")[0] for g in Offer().gaps()] == ["files", "system calls", "network", "signals"]
    assert [g.split(":")[0] for g in Offer(NETWORK_ABI, False).gaps()] == ["system calls", "signals"]
    assert str(Offer()) == "nothing"
    free = Confinement((), "/tmp", Allowed(execute=True))
    assert [g.split(":")[0] for g in free.gaps(Offer(5, True))] == ["signals"]


@pytest.mark.parametrize("system", ["win32", "darwin"])
def test_no_other_system_is_measured_by_what_linux_calls_its_own(system: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", system)
    gap = "files, network, processes: there is a sandbox on Linux alone, so an FMU may do what you may"
    assert offered.__wrapped__() == Offer()
    assert Offer().gaps() == [gap]


def test_numbers_of_system_calls() -> None:
    """Every refused call has a number on every machine, but for old ones that newer machines never had."""
    names = set(refusals(1, truncate=True))
    assert names <= set(COLUMNS["x86_64"])
    old = set(COLUMNS["x86_64"]) - set(COLUMNS["aarch64"])
    assert old == {
        *("chmod", "chown", "creat", "fork", "futimesat", "inotify_init", "ioperm", "iopl", "lchown", "modify_ldt"),
        *("open", "uselib", "utime", "utimes", "vfork"),
    }
    assert set(ARCHITECTURES) == set(COLUMNS)
    assert all(0 <= number <= NEWEST for column in COLUMNS.values() for number in column.values())
    assert all(len(set(column.values())) == len(column) for column in COLUMNS.values())
