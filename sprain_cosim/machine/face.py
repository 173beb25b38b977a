"""The face that all systems show."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

if TYPE_CHECKING:
    import subprocess

PARENTS_TEMPORARY = "SPRAIN_COSIM_TEMPORARY"  # where a child finds what its parent keeps among temporary files


class Ending(NamedTuple):
    """How a process came to its end: `status` crashed or timeout, `words` for it, `killed` by somebody else."""

    status: str
    words: str
    killed: bool = False


class Pipe(Protocol):
    """The end of a pipe that is read."""

    def read(self, count: int, seconds: float) -> bytes:
        """`count` bytes at most; none when the other end is closed. Raises TimeoutError when there are none within
        `seconds`."""

    def close(self) -> None: ...


class OperatingSystem(Protocol):
    """What a system offers."""

    @property
    def stops(self) -> Sequence[str]:
        """Names of the signals that ask to stop."""

    @property
    def patience(self) -> float | None:
        """How long [s] a wait of the main thread may last before it looks for signals; None: they interrupt it."""

    @property
    def compiler(self) -> str:
        """How a compiler of C is got here, as an advice."""

    @property
    def mingw(self) -> str:
        """The same of mingw-w64."""

    # ---- processes, from outside

    def options(self, passed: Sequence[int] = ()) -> dict[str, Any]:
        """Of subprocess.Popen: for a process apart, which is not met by what the terminal sends to this one, and
        inherits the descriptors `passed`."""

    def variables(self, scratch: str) -> dict[str, str]:
        """Of the environment of a child in Python that works in `scratch`."""

    def name_of(self, descriptor: int) -> int:
        """What the process that inherits it knows a descriptor by."""

    def group(self, process: subprocess.Popen[bytes], memory: int = 0) -> Callable[[], None]:
        """Takes hold of a process just started, with all that it will start, of `memory` [B] each where that is not 0;
        the function that ends them all and waits for the first."""

    def ending(self, code: int) -> Ending:
        """What the exit code of a process says."""

    def pipe(self, descriptor: int) -> Pipe: ...

    # ---- processes, from inside

    def opened(self, name: int, writes: bool) -> int:
        """The descriptor of what was inherited as `name`."""

    def confine(self, memory: int) -> None:
        """What this process may use from here on: `memory` [B], no core file."""

    def die_with(self, parent: int) -> None:
        """This process ends when `parent` does; at once when it is gone already."""

    def end_by(self, problem: OSError) -> None:
        """Ends this process by the fault of foreign code that Python has turned into `problem`; else nothing."""

    def allow_processor_time(self, seconds: float) -> None:
        """From here on; then this process is ended."""

    def resident(self) -> int:
        """The most memory that this process has had [B]; 0 where the system does not say."""

    def cores(self) -> int:
        """That this process may use."""

    # ---- what people type

    def quoted(self, word: str) -> str:
        """As one word at a prompt of this system."""

    # ---- files

    def lock(self, descriptor: int) -> bool:
        """Locks a file until it is closed or this process ends; whether nobody else has."""

    def refusal(self, path: Path, inside: int = 0) -> str:
        """Why no file can have this path, nor one with a path of `inside` characters in it; empty when they can."""

    def rename(self, source: Path, target: Path) -> None:
        """One step; a file that is there is replaced. Raises OSError."""

    def remove(self, file: Path) -> None:
        """Also one that is protected from writing; where there is none, nothing. Raises OSError."""

    def remove_tree(self, folder: Path | str) -> None:
        """As much of it as can be."""

    def caches(self) -> Path:
        """The user's folder for what can be made again. Raises RuntimeError where there is none."""
