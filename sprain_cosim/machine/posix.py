"""Linux, macOS and their like. What only some of them have is imported where it is used."""

from __future__ import annotations

import contextlib
import math
import os
import select
import shlex
import signal
import sys
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .face import Ending, Pipe

if TYPE_CHECKING:
    import subprocess

SET_DEATH_SIGNAL = 1  # PR_SET_PDEATHSIG


class Posix:
    """Implements System: a child leads a session and a process group, which is killed as a whole."""

    stops = ("SIGINT", "SIGTERM")
    patience = None
    compiler = "install gcc or clang, and make or ninja"
    mingw = "on Debian install gcc-mingw-w64-x86-64"

    def options(self, passed: Sequence[int] = ()) -> dict[str, Any]:
        return {"pass_fds": tuple(passed), "start_new_session": True}

    def variables(self, scratch: str) -> dict[str, str]:
        return {"TMPDIR": scratch}

    def name_of(self, descriptor: int) -> int:
        return descriptor

    def group(self, process: subprocess.Popen[bytes], memory: int = 0) -> Callable[[], None]:
        def end() -> None:
            try:
                os.killpg(process.pid, signal.SIGKILL)
            except ProcessLookupError:  # it leads no group: not yet, or not any more
                with contextlib.suppress(ProcessLookupError):
                    os.kill(process.pid, signal.SIGKILL)
            except PermissionError:
                pass
            process.wait()

        return end

    def ending(self, code: int) -> Ending:
        if code == -signal.SIGXCPU:
            return Ending("timeout", "overran its limit of processor time and was ended")
        if code < 0:
            words = f"ended by signal {signal.Signals(-code).name}"
            return Ending("crashed", words, killed=code == -signal.SIGKILL)
        return Ending("crashed", f"ended its process with exit code {code}")

    def pipe(self, descriptor: int) -> Pipe:
        return _Pipe(descriptor)

    def opened(self, name: int, writes: bool) -> int:
        return name

    def confine(self, memory: int) -> None:
        _resource().setrlimit(_resource().RLIMIT_CORE, (0, 0))
        with contextlib.suppress(ValueError, OSError):
            _resource().setrlimit(_resource().RLIMIT_AS, (memory, memory))

    def die_with(self, parent: int) -> None:
        if sys.platform == "linux":
            import ctypes

            ctypes.CDLL(None).prctl(SET_DEATH_SIGNAL, signal.SIGKILL)
        if os.getppid() != parent:
            os._exit(1)

    def end_by(self, problem: OSError) -> None:
        pass  # a fault is a signal

    def allow_processor_time(self, seconds: float) -> None:
        used, limit = sum(os.times()[:2]), _resource().RLIMIT_CPU
        with contextlib.suppress(ValueError, OSError):
            hard = _resource().getrlimit(limit)[1]
            _resource().setrlimit(limit, (math.ceil(used + seconds), hard))

    def resident(self) -> int:
        most = int(_resource().getrusage(_resource().RUSAGE_SELF).ru_maxrss)
        return most if sys.platform == "darwin" else 1024 * most

    def cores(self) -> int:
        return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1

    def quoted(self, word: str) -> str:
        return shlex.quote(word)

    def lock(self, descriptor: int) -> bool:
        import fcntl

        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        return True

    def refusal(self, path: Path, inside: int = 0) -> str:
        return ""

    def rename(self, source: Path, target: Path) -> None:
        os.replace(source, target)

    def remove(self, file: Path) -> None:
        file.unlink(missing_ok=True)

    def remove_tree(self, folder: Path | str) -> None:
        import shutil

        shutil.rmtree(folder, ignore_errors=True)

    def caches(self) -> Path:
        return Path.home() / ".cache"


@cache
def _resource() -> Any:
    import resource

    return resource


class _Pipe:
    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._poll = select.poll()
        self._poll.register(descriptor, select.POLLIN)

    def read(self, count: int, seconds: float) -> bytes:
        if seconds < math.inf and (seconds <= 0 or not self._poll.poll(1e3 * seconds)):
            raise TimeoutError
        return os.read(self._descriptor, count)

    def close(self) -> None:
        os.close(self._descriptor)
