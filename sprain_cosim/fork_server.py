"""Children as copies of a process that has loaded what they need: none begins with the imports, which take 0.3 s.

    this process              server: one thread, libraries loaded, no foreign code      child
    server.start(module, ..)  -- what, and its descriptors -->  fork  -->                module, as `python -m` runs it
    copy.wait()               <-- its number, how it ended --

The server holds nothing but what it has imported, so that a child finds no data of this program in its memory. It is a
fresh Python; or, where this process is the command line, of one thread and without foreign code, a copy of it, which
costs next to nothing. It ends with the process that it serves, and its children end with it.

Linux only: elsewhere a copy of a process that has loaded system libraries is not safe."""

from __future__ import annotations

import atexit
import contextlib
import ctypes
import faulthandler
import gc
import importlib
import json
import os
import select
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from functools import cache, partial
from pathlib import Path
from typing import IO, Any, NoReturn

LARGEST = 1 << 17  # B of a request: module, arguments, environment
DESCRIPTORS = 4  # of a child at most: its output, and what it talks with
PATIENCE, ANSWER = 60.0, 10.0  # s for the first answer of a server, which may be starting; for any other
SET_DEATH_SIGNAL = 1
SELDOM = 20_000  # objects more than before, between two collections of a child
LOOK = 1000  # ms between two looks whether the process that is served is still there
AT_START = (  # of variables that a process reads when it starts, or a library when it is loaded
    *("LD_", "PYTHON", "GLIBC_", "MALLOC_", "LC_", "LANG", "OMP_", "OPENBLAS_", "GOTO_", "MKL_", "KMP_", "NPY_"),
)

_foreign = False  # foreign code has been loaded into this process
_server: ForkServer | None = None
_choosing = threading.Lock()
_streams: tuple[Any, ...] = ()  # of the process that was copied


def foreign_code_loads() -> None:
    """This process is not copied from here on."""
    global _foreign
    _foreign = True


def server_for(environment: Mapping[str, str], command: Sequence[str], package: Path) -> ForkServer | None:
    """The server of this process, made at first; None where children start by themselves: on other systems, and where
    what a process reads at its start differs from what the server read.

    environment  of the children
    command      runs this module in a fresh Python, which imports nothing from the current folder
    package      the folder that this package lies in
    """
    global _server
    if not _handles_processes():
        return None
    with _choosing:
        if _server is not None and not _server.serves_this_process:
            _server = None
        if _server is None:
            _server = copied(environment, package) or ForkServer.fresh(environment, command)
        return _server if _server is not None and _server.read == _at_start(environment) else None


def copy_now(environment: Mapping[str, str], package: Path) -> None:
    """Makes the server of this process, if it can be a copy of it."""
    global _server
    if _handles_processes():
        with _choosing:
            _server = _server or copied(environment, package)


def copied(environment: Mapping[str, str], package: Path) -> ForkServer | None:
    """A server that is a copy of this process; None where that might go wrong, or show a child what is not for it."""
    return ForkServer.copy(environment, package) if _may_be_copied(environment) else None


def _may_be_copied(environment: Mapping[str, str]) -> bool:
    """For a child with that environment."""
    if not can_be_copied() or not _is_command_line() or _imported_from_here():
        return False
    own, theirs = _at_start(os.environ), _at_start(environment)
    return all(own[name] == theirs[name] for name in own.keys() & theirs.keys())


def copy_of_this(
    module: str,
    subject: Any,
    arguments: Sequence[str],
    descriptors: Sequence[int],
    folder: str,
    environment: Mapping[str, str],
    package: Path,
) -> Copy | None:
    """A child that is a copy of this process as it is and has the `subject` already; the rest as in `ForkServer.start`.
    For a process that has one child. None where it has a server, or can have no copy."""
    if _server is not None or not _may_be_copied(environment):
        return None
    found: Any = importlib.import_module(module)
    request = _request(module, arguments, folder, environment)
    source, output = os.pipe()

    def begin() -> NoReturn:
        sys.path[:] = _own_path(package)
        _begin_as_child(partial(found.serve, found._handlers, subject), request, [output, *descriptors])

    try:
        return Copy(_leading(lambda: forked(begin)), source, _ending)
    except BaseException:
        os.close(source)
        raise
    finally:
        os.close(output)


def _request(module: str, arguments: Sequence[str], folder: str, environment: Mapping[str, str]) -> dict[str, Any]:
    return {"module": module, "arguments": list(arguments), "folder": folder, "environment": dict(environment)}


def can_be_copied() -> bool:
    """This process is Linux's, has one thread, and no foreign code is in it."""
    return _handles_processes() and not _foreign and len(os.listdir("/proc/self/task")) == 1


def forked(life: Callable[[], NoReturn]) -> int:
    """The number of a copy of this process that does nothing but live: no signal handler of this program works in it,
    nothing that the program has left over is written or finalised."""
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError, AttributeError):
            stream.flush()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, signal.valid_signals())
    try:
        process = os.fork()
        if not process:
            try:
                gc.freeze()  # its descriptors are others' from now on
                _usual_signals()
                life()
            finally:
                os._exit(1)
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
    return process


def end(process: int) -> None:
    """Of a child of this process."""
    with contextlib.suppress(ProcessLookupError, ChildProcessError):
        os.kill(process, signal.SIGKILL)
        os.waitpid(process, 0)


def _is_command_line() -> bool:
    """This process does what was typed and holds nobody's data besides."""
    main, line = sys.modules.get("__main__"), sys.modules.get("sprain_cosim.cli")
    return line is not None and getattr(main, "main", None) is vars(line).get("main")


def _imported_from_here() -> bool:
    """A module of the current folder, which no child imports, is loaded."""
    here = os.getcwd()
    files = [(name, getattr(module, "__file__", None)) for name, module in list(sys.modules.items())]
    return any(
        file in (os.path.join(here, f"{name}.py"), os.path.join(here, name, "__init__.py"))
        for name, file in files
        if name != "sprain_cosim"
    )


def drop_server(server: ForkServer) -> None:
    """It has not answered: the next child finds another one."""
    global _server
    with _choosing:
        if _server is server:
            _server = None
    server.end()


def _handles_processes() -> bool:
    try:
        os.close(os.pidfd_open(os.getpid()))
    except (OSError, AttributeError):  # another system, an old kernel, or a container that forbids it
        return False
    return True


def _at_start(environment: Mapping[str, str]) -> dict[str, str]:
    return {name: value for name, value in environment.items() if name.startswith(AT_START)}


class ServerGone(Exception):
    """The server gave no answer."""


class ForkServer:
    """The near side. `process` is its number, `read` the variables that it has read."""

    def __init__(self, process: int, wire: socket.socket, read: Mapping[str, str]) -> None:
        self.process, self.read = process, dict(read)
        self._wire, self._owner, self._number = wire, os.getpid(), 0
        self._asking = threading.Lock()
        wire.settimeout(PATIENCE)
        atexit.register(self.end)

    @classmethod
    def fresh(cls, environment: Mapping[str, str], command: Sequence[str]) -> ForkServer | None:
        """A Python of its own; None where none can be started."""
        near, far = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        lasting = threading.current_thread() is threading.main_thread()
        with far:
            try:
                started = subprocess.Popen(
                    [*command, str(far.fileno()), str(os.getpid()), str(int(lasting))],
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.DEVNULL,
                    stderr=subprocess.DEVNULL,
                    pass_fds=(far.fileno(),),
                    start_new_session=True,
                    cwd="/",
                    env=environment,
                )
            except OSError:
                near.close()
                return None
        started.returncode = 0  # its end is waited for by number
        return cls(started.pid, near, _at_start(environment))

    @classmethod
    def copy(cls, environment: Mapping[str, str], package: Path) -> ForkServer:
        """A copy of this process, which has one thread."""
        near, far = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        parent = os.getpid()
        process = forked(lambda: _begin_as_copy(far, parent, package))
        far.close()
        return cls(process, near, _at_start(environment))

    @property
    def serves_this_process(self) -> bool:
        """Not a process that was copied from the one it serves."""
        return os.getpid() == self._owner

    def start(
        self,
        module: str,
        arguments: Sequence[str],
        descriptors: Sequence[int],
        folder: str,
        environment: Mapping[str, str],
    ) -> Copy:
        """A child that runs `module` in `folder`. In the `arguments` "{0}" stands for the first of the descriptors as
        the child has them. Raises ServerGone."""
        source, output = os.pipe()
        try:
            request = _request(module, arguments, folder, environment)
            process = int(self._ask(request, [output, *descriptors])["process"])
            return Copy(process, source, self.ending)
        except BaseException:
            os.close(source)
            raise
        finally:
            os.close(output)

    def ending(self, process: int) -> int:
        """How a child ended, as Popen.returncode says it; the child has ended."""
        try:
            return int(self._ask({"ended": process}, [])["code"])
        except ServerGone:
            return -signal.SIGKILL  # its children end with it

    def end(self) -> None:
        """With its children."""
        if self.serves_this_process and self.process:
            process, self.process = self.process, 0
            atexit.unregister(self.end)
            self._wire.close()
            end(process)

    def _ask(self, request: Mapping[str, Any], descriptors: Sequence[int]) -> Mapping[str, Any]:
        """An answer to an earlier question, whose asker was interrupted, is passed over."""
        with self._asking:
            self._number += 1
            content = json.dumps({"number": self._number, **request}).encode()
            if len(content) > LARGEST:
                raise ServerGone("more than a message holds")
            reply: Mapping[str, Any] = {}
            try:
                socket.send_fds(self._wire, [content], list(descriptors))
                while reply.get("number") != self._number:
                    reply = json.loads(self._wire.recv(LARGEST))
                self._wire.settimeout(ANSWER)
            except (OSError, ValueError) as problem:
                raise ServerGone(str(problem)) from None
        if "error" in reply:
            raise ServerGone(str(reply["error"]))
        return reply


class Copy:
    """A child; what Popen offers, as far as it is needed. `stdout` gives what it prints."""

    def __init__(self, process: int, output: int, ending: Callable[[int], int]) -> None:
        """`ending`: how a process that has ended did so, as Popen.returncode says it."""
        self.pid, self._ending = process, ending
        self.returncode: int | None = None
        self._handle = os.pidfd_open(process)  # it is not buried before `wait`, so the number is still its own
        self.stdout: IO[bytes] = open(output, "rb")  # noqa: SIM115 - its reader closes it
        self._waiting = threading.Lock()

    def wait(self, timeout: float | None = None) -> int:
        """Raises subprocess.TimeoutExpired."""
        with self._waiting:
            if self.returncode is None:
                poll = select.poll()
                poll.register(self._handle, select.POLLIN)
                if not poll.poll(None if timeout is None else 1e3 * timeout):
                    raise subprocess.TimeoutExpired([], timeout or 0.0)
                self.returncode = self._ending(self.pid)
                os.close(self._handle)
            return self.returncode

    def poll(self) -> int | None:
        """The exit code; None while it runs."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            return self.wait(0.0)
        return None


# ---- the server's side


def _begin_as_copy(wire: socket.socket, parent: int, package: Path) -> NoReturn:
    """Nothing of the program that was copied goes on here: no descriptor, no current folder."""
    os.setsid()
    _close_all_but([wire.fileno()])
    null = os.open(os.devnull, os.O_RDWR)
    for descriptor in (0, 1, 2):
        os.dup2(null, descriptor)
    sys.path[:] = _own_path(package)
    os.chdir("/")
    _serve(wire, parent)


def _own_path(package: Path) -> list[str]:
    """Without the folder that the program was started in or lies in, which Python puts first."""
    found = sys.path if sys.flags.safe_path else sys.path[1:]
    here = os.getcwd()
    stated = [os.path.abspath(p) for p in os.environ.get("PYTHONPATH", "").split(os.pathsep) if p]
    kept = [p for p in found if p and (os.path.abspath(p) != here or p in stated)]
    return kept if str(package) in kept else [*kept, str(package)]


def _serve(wire: socket.socket, parent: int) -> NoReturn:
    poll = select.poll()
    poll.register(wire, select.POLLIN)
    while True:
        ready = poll.poll(LOOK)
        if os.getppid() != parent:
            os._exit(0)
        if not ready:
            continue
        content, descriptors, _, _ = socket.recv_fds(wire, LARGEST, DESCRIPTORS)
        if not content:
            os._exit(0)
        request = json.loads(content)
        try:
            reply = {"code": _ending(request["ended"])} if "ended" in request else _start(request, descriptors)
        except Exception as problem:
            reply = {"error": f"{type(problem).__name__}: {problem}"}
        for descriptor in descriptors:
            os.close(descriptor)
        wire.send(json.dumps({"number": request["number"], **reply}).encode())


def _ending(process: int) -> int:
    return os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])


def _start(request: Mapping[str, Any], descriptors: list[int]) -> dict[str, Any]:
    life = _life_of(request["module"])

    def fork() -> int:
        return os.fork() or _begin_as_child(life, request, descriptors)

    return {"process": _leading(fork)}


def _leading(fork: Callable[[], int]) -> int:
    """The number of the child that is forked, once it leads a group of its own, by which it can be ended."""
    leads, begins = os.pipe()  # the child closes it with all that is not its own
    try:
        process = fork()
    finally:
        os.close(begins)
    os.read(leads, 1)
    os.close(leads)
    return process


@cache
def _life_of(name: str) -> Callable[[], NoReturn]:
    """What a child does that runs the module of that name, which ends in `serve(_handlers)`; what it imports is
    imported here, also by its `_prepare`, where it has one. Raises what that raises."""
    module = importlib.import_module(name)
    getattr(module, "_prepare", lambda: None)()
    gc.collect()
    gc.freeze()  # a collection in a child would write to what it shares with the others
    gc.set_threshold(SELDOM)
    return partial(module.serve, module._handlers)


def _begin_as_child(life: Callable[[], NoReturn], request: Mapping[str, Any], descriptors: list[int]) -> NoReturn:
    """As a fresh Python would: what it prints goes to the first descriptor."""
    try:
        os.setsid()
        output, *own = descriptors
        os.dup2(output, 1)
        os.dup2(output, 2)
        _close_all_but(own)
        for descriptor in own:
            os.set_inheritable(descriptor, False)
        _own_streams()
        os.chdir(request["folder"])
        os.environ.clear()
        os.environ.update(request["environment"])
        time.tzset()
        tempfile.tempdir = None
        faulthandler.disable()
        if (random := sys.modules.get("numpy.random")) is not None:
            random.seed()  # Python's own does so by itself
        sys.argv = [request["module"], *(text.format(*own) for text in request["arguments"])]
        life()
    except SystemExit as end:
        os._exit(end.code if isinstance(end.code, int) else int(end.code is not None))
    except BaseException:
        with contextlib.suppress(Exception):
            traceback.print_exc()
            sys.stderr.flush()
    os._exit(1)


def _own_streams() -> None:
    """Those of the process that was copied may hold text that it has written itself meanwhile; they are never closed,
    which would write it again."""
    global _streams
    _streams = (sys.stdin, sys.stdout, sys.stderr, sys.__stdin__, sys.__stdout__, sys.__stderr__)
    own = {
        "stdin": open(0, closefd=False),  # noqa: SIM115 - for as long as the process lives
        "stdout": open(1, "w", closefd=False),  # noqa: SIM115
        "stderr": open(2, "w", errors="backslashreplace", buffering=1, closefd=False),  # noqa: SIM115
    }
    for name, stream in own.items():
        setattr(sys, name, stream)
        setattr(sys, f"__{name}__", stream)


def _usual_signals() -> None:
    for number in signal.valid_signals():
        if number in (signal.SIGKILL, signal.SIGSTOP):
            continue
        handler = signal.getsignal(number)
        if number == signal.SIGINT:
            signal.signal(number, signal.default_int_handler)
        elif number == signal.SIGCHLD or callable(handler):
            signal.signal(number, signal.SIG_DFL)
    signal.set_wakeup_fd(-1)
    signal.pthread_sigmask(signal.SIG_SETMASK, ())


def _close_all_but(kept: Sequence[int]) -> None:
    for name in os.listdir("/proc/self/fd"):
        descriptor = int(name)
        if descriptor > 2 and descriptor not in kept:
            with contextlib.suppress(OSError):
                os.close(descriptor)


def _main() -> NoReturn:
    wire, parent, lasting = socket.socket(fileno=int(sys.argv[1])), int(sys.argv[2]), int(sys.argv[3])
    if lasting:  # the kernel goes by the thread that started this process; others end before their process does
        ctypes.CDLL(None).prctl(SET_DEATH_SIGNAL, signal.SIGKILL)
    _usual_signals()
    _serve(wire, parent)


if __name__ == "__main__":  # the module that others import, not the one that is run
    importlib.import_module("sprain_cosim.fork_server")._main()
