"""The exceptions of the package; each message is one line that says what, where, and what to do next.

SprainError                exit code
├── InputError             2   bad input: file, option, archive, unit
├── SimulationError        3   a simulation failed: NaN, FMI error, crash, timeout
│   ├── SimulationStopped      an FMU asked to end it
│   └── StepDiscarded          an FMU refused a step that can be tried again in parts, from a saved state
└── EnvironmentProblem     4   the machine: missing library, full disk, no permission
"""

from __future__ import annotations

import re
import sys
import unicodedata
from collections.abc import Iterable
from types import TracebackType
from typing import Any

LINE_ENDS = re.compile(r"\s*\n\s*")
UNUSUAL = re.compile(r"[^\n\t -~]")


class SprainError(Exception):
    """Base of all errors a user can meet; `exit_code` is what the command line ends with.

    >>> import sprain_cosim as sc
    >>> try:
    ...     sc.load_scenario("incline33")
    ... except sc.SprainError as problem:
    ...     print(type(problem).__name__, problem.exit_code)
    InputError 2
    """

    exit_code = 1

    def __str__(self) -> str:
        """One line without control characters, whatever names it quotes."""
        return visible(LINE_ENDS.sub(" ", super().__str__()))

    def _render_traceback_(self) -> list[str]:
        """What IPython and notebooks show: the reader's own lines and the message. `%debug` has the whole stack."""
        own = _outside(self.__traceback__)
        shell = ipython_shell()
        if own is None or shell is None:
            return [f"{type(self).__name__}: {self}"]
        bare = type(self).__new__(type(self), *self.args)  # without what it was raised from
        return list(shell.InteractiveTB.structured_traceback(type(self), bare, own, tb_offset=0))


class InputError(SprainError):
    """Something the user gave cannot be used.

    >>> import sprain_cosim as sc
    >>> sc.load_scenario("incline30").override("plant.drop_height", 0.35)
    Traceback (most recent call last):
    sprain_cosim.errors.InputError: plant.drop_height = 0.35: needs a unit, for example "0.35 m"
    """

    exit_code = 2


class SimulationError(SprainError):
    """A run could not be finished. `Scenario.run` never raises it: the result's `status` and `message` say it.

    >>> import sprain_cosim as sc
    >>> loose = {"inputs": {}, "outputs": {"x": "1"}, "output": lambda state, values: {}}
    >>> with sc.Driver(sc.PythonComponent.define("part", **loose)) as driver:
    ...     driver.start()
    Traceback (most recent call last):
    sprain_cosim.errors.SimulationError: part: output gives no x
    """

    exit_code = 3


class SimulationStopped(SimulationError):
    """An FMU asked to end the run before its stop time."""


class StepDiscarded(SimulationError):
    """An FMU refused a step; a run whose instances save before steps can take it in parts."""


class EnvironmentProblem(SprainError):
    """The machine lacks something or refuses something.

    >>> import sprain_cosim as sc
    >>> try:
    ...     table = sc.open_folder("runs/s6").to_xarray()
    ... except sc.EnvironmentProblem as problem:  # to_xarray: needs xarray: pip install "sprain-cosim[xarray]"
    ...     table = None
    """

    exit_code = 4


def ipython_shell() -> Any:
    """The shell of the IPython or the notebook that this is a part of; None elsewhere. Nothing is imported."""
    return getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()


def _outside(stack: TracebackType | None) -> TracebackType | None:
    """The stack without the frames of this package and of IPython."""
    if stack is None:
        return None
    inner, module = _outside(stack.tb_next), stack.tb_frame.f_globals.get("__name__", "")
    if module.partition(".")[0] in (__package__, "IPython", "ipykernel"):
        return inner
    return TracebackType(inner, stack.tb_frame, stack.tb_lasti, stack.tb_lineno)


def problems_to_error(place: str, problems: Iterable[str]) -> None:
    """Raises one InputError in one line for all problems; nothing for none."""
    found = list(dict.fromkeys(problems))
    if len(found) == 1:
        raise InputError(f"{place}: {found[0]}")
    if found:
        raise InputError(f"{place}: {len(found)} problems: " + "; ".join(f"({k}) {p}" for k, p in enumerate(found, 1)))


def without_name(name: str, said: object) -> str:
    """What was said of a component that begins with its name, for a line that names it already."""
    return str(said).removeprefix(f"{name}: ")


def visible(text: str) -> str:
    """The text with control characters shown instead of sent to a terminal, a page, a figure or a table: all that is
    not printed, such as escape sequences and turns of the direction of writing; ends of lines and tabs remain."""
    return UNUSUAL.sub(_shown, text)


def _shown(found: re.Match[str]) -> str:
    c = found[0]
    return c if c.isprintable() or unicodedata.category(c) == "Zs" else ascii(c)[1:-1]


def nearest(name: str, known: Iterable[str]) -> str:
    """' (did you mean X?)' for the nearest of the known names, or the known names themselves if they are few."""
    known = list(known)
    import difflib

    close = difflib.get_close_matches(name, known, 1, 0.6)
    if close:
        return f" (did you mean {close[0]}?)"
    return f" (known: {', '.join(known)})" if 0 < len(known) <= 12 else ""
