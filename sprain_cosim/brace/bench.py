"""One brace on one plant, in a child process: a landing, and postures in which the brace is held.

The child opens the scenario it is sent and answers until the line closes, so that a device that crashes or hangs ends
the child alone."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ..cosim.result import HALVED_WITHIN, Result
from ..errors import InputError, SimulationError
from ..fmu.messages import Messages
from ..fmu.opener import import_libraries as _prepare  # noqa: F401 - before the process is copied
from ..folders.run import FILE, RunSummary
from ..machine.here import SYSTEM
from ..process import Child, Handlers, Limits, Overrun, ProcessEnded, serve
from ..scenario import Scenario
from ..scenario.apart import fetched, served
from ..scenario.postures import POSTURES, hold


class Bench:
    """One child process with the scenario, started when first asked. `messages`: {component: what its FMU said in the
    landing}. Raises SimulationError when the child ends or
    reports an error, such as the stability guard's refusal of this device."""

    def __init__(self, scenario: Scenario, limits: Limits) -> None:
        self.scenario, self.limits = scenario, limits
        self._landing, self._start = limits.of_trials().seconds, limits.of_starts().seconds
        self.messages: Mapping[str, Messages] = {}
        self._child: Child | None = None

    def land(self, folder: Path) -> Result:
        """The completed landing, beside itself at half the step; leaves the run's folder."""
        from ..figures.landings import leave_run

        SYSTEM.remove(folder / FILE)
        try:
            result = fetched(self._call)
        except ValueError:
            raise SimulationError("the process answered what is no result") from None
        self.messages = result.messages
        if self.scenario.refused(result):
            raise InputError(result.message)
        if result.status != "completed":
            raise SimulationError("; ".join(text for text in (result.warning, result.message) if text))
        result = self._halved(result)
        leave_run(folder, result, RunSummary.of(self.scenario, result))
        return result

    def _halved(self, result: Result) -> Result:
        """The result beside the same landing at half the step, where that is to be had in a moment."""
        if result.wall > HALVED_WITHIN:
            return result
        try:
            return self.scenario.compared(result, self._call("halved"))
        except SimulationError:
            self.close()
            return result

    def hold(self, values: Mapping[str, float] | None = None) -> dict[str, float] | None:
        """{posture: N.m that resist it}, with parameter `values` on top of the scenario's; None where the plant cannot
        be put into postures."""
        return self._call("hold", POSTURES, dict(values or {})) or None

    def _call(self, name: str, *arguments: Any) -> Any:
        try:
            if self._child is None:
                self._child = Child(__name__, self.limits)
                self._child.open(self.scenario.absolute(), self._start, self.scenario.confinement())
            return self._child.call(name, *arguments, limit=self._landing)
        except ProcessEnded as end:
            words = self._child.last_words() if self._child else ""
            cure = f"; {end.cure}" if isinstance(end, Overrun) else ""
            raise SimulationError(f"the process {end}{words}{cure}") from None
        except InputError as problem:  # of this device with this scenario: the comparison goes on without it
            raise SimulationError(str(problem)) from None

    def close(self) -> None:
        if self._child is not None:
            self._child.close()
            self._child = None

    def __enter__(self) -> Bench:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _at_half_the_step(scenario: Scenario) -> dict[str, float]:
    with scenario.open(in_process=True) as session:
        return session.at_half_the_step()


@contextmanager
def _handlers(scenario: Scenario) -> Iterator[Handlers]:
    """The child: lands, and holds postures."""
    landing = scenario.recording("plant.*")
    yield {
        **served(lambda: landing.run(in_process=True)),
        "halved": lambda: _at_half_the_step(scenario),
        "hold": lambda postures, values: hold(scenario, postures, values),
    }


if __name__ == "__main__":
    serve(_handlers)
