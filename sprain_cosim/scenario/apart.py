"""A session whose FMUs run in one process of its own, together: a scenario with foreign FMUs. What they do to their
process ends the run with a message, not this program; nothing is exchanged but parameters and results."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from ..cosim import native_members
from ..cosim.result import HALVED_WITHIN, Result
from ..cosim.transport import packed, pieces, unpacked
from ..errors import SimulationError, SprainError
from ..fmu.opener import import_libraries
from ..fmu.surroundings import Surroundings
from ..process import FIRST_RUN, Child, Handlers, Limits, Overrun, ProcessEnded, serve

if TYPE_CHECKING:
    from ..cosim.system import System
    from ..sandbox.confinement import Confinement
    from .scenario import Scenario

HINT = "it ran in a sandbox: `sprain-cosim check FMU` says what it needs, --in-process runs it without"


class Apart:
    """Runs a scenario many times in a child process, with the same instances; a new child after one that ended. Use as
    a context manager.

    Raises what the opening of the FMUs raises, SimulationError when their process ends or takes too long meanwhile."""

    def __init__(self, scenario: Scenario, limits: Limits | None = None) -> None:
        self.limits = limits or Limits()
        self._runs, self._starts = self.limits.of_trials(FIRST_RUN), self.limits.of_starts()
        self.scenario, self.system = scenario, scenario.system()
        self._child: Child | None = self._fresh()

    def run(self, parameters: Mapping[str, float | str] | None = None) -> Result:
        """`parameters` as in Session.run."""
        values = self.system.in_own_units(parameters or {})
        self._child = child = self._child or self._fresh()
        try:
            result = fetched(partial(child.call, limit=self._runs.seconds), values)
        except Overrun as end:
            late = Overrun(end.limit, self._runs.origin)
            return self._failed(
                f"the FMUs' process {late}{child.last_words()}; {late.cure}; --isolate tells which FMU it is"
            )
        except ProcessEnded as end:
            return self._failed(f"the FMUs' process {end}{child.last_words()}; --isolate tells which FMU it is")
        except SprainError:
            self.close()
            raise
        except ValueError:
            return self._failed("the FMUs' process answered what is no result")
        if result.status == "completed":
            self._runs.note(result.wall)
        if result.status == "failed" and not len(result.time) and self._confined:
            return replace(result, message=f"{result.message}; {HINT}")
        return result

    def at_half_the_step(self, parameters: Mapping[str, float | str] | None = None) -> dict[str, float]:
        """As in Session; empty where the FMUs' process ends meanwhile, too."""
        if self._child is None:
            return {}
        try:
            return dict(self._child.call("halved", dict(parameters or {}), limit=10.0 * HALVED_WITHIN))
        except (ProcessEnded, SprainError, ValueError, TypeError):
            self.close()
            return {}

    def close(self) -> None:
        child, self._child = getattr(self, "_child", None), None
        if child is not None:
            child.close()

    def _fresh(self) -> Child:
        placed = self.scenario.absolute()
        subject = placed, placed.system()
        confinement = self.scenario.confinement()
        self._confined = confinement is not None
        child = Child(__name__, self.limits, subject=subject)
        try:
            self._open(child, subject, confinement)
        except BaseException:
            child.close()
            raise
        return child

    def _open(self, child: Child, subject: tuple[Scenario, System], confinement: Confinement | None) -> None:
        hint = f"; {HINT}" if self._confined else ""
        try:
            child.open(subject, self._starts.seconds, confinement)
        except ProcessEnded as end:
            hint = f"; {end.cure}" if isinstance(end, Overrun) else hint
            raise SimulationError(f"the system cannot be opened: its process {end}{child.last_words()}{hint}") from None
        except SimulationError as problem:
            raise type(problem)(f"{problem}{hint}") from None

    def _failed(self, message: str) -> Result:
        self.close()
        nothing = np.empty((0, 0))
        return Result(nothing[:, :0].reshape(0), nothing, (), (), "failed", message, self.scenario.master.scheme)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def fetched(call: Callable[..., Any], *arguments: Any) -> Result:
    """The result of `served` handlers in another process. Raises what `call` raises, ValueError for what is no
    result."""
    content = call("run", *arguments)
    try:
        return unpacked(content, [call("piece", k) for k in range(int(content["pieces"]))])
    except (KeyError, TypeError) as problem:
        raise ValueError(str(problem)) from None


def served(run: Callable[..., Result]) -> Handlers:
    """Handlers for `fetched`: one runs, the other hands the numbers of the last run over piece by piece."""
    waiting: list[bytes] = []

    def answer(*arguments: Any) -> dict[str, Any]:
        result = run(*arguments)
        waiting[:] = pieces(result)
        return packed(result, len(waiting))

    return {"run": answer, "piece": waiting.__getitem__}


def _prepare() -> None:
    """Before the process is copied."""
    import_libraries()
    native_members.loaded()


@contextlib.contextmanager
def _handlers(subject: tuple[Scenario, System]) -> Iterator[Handlers]:
    """The child: runs the scenario."""
    scenario, system = subject

    with scenario.open(in_process=True, system=system) as session:
        put_back = Surroundings().after
        yield {**served(put_back(session.run)), "halved": put_back(session.at_half_the_step)}


if __name__ == "__main__":
    serve(_handlers)
