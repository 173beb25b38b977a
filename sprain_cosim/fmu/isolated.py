"""One FMU in a process of its own: what it does to its process ends the run with a message, not ours; what it loads
meets no other FMU's.

`Isolated` is a component whose instances live in a child each. The proxy here and the child exchange one message per
step: the inputs that were pushed since the last one go along with the step, the outputs come back with its answer.
Numbers travel as the shortest decimal that gives the same double back, so a run is the same to the bit."""

from __future__ import annotations

import itertools
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from typing import Any

import numpy as np

from ..errors import EnvironmentProblem, InputError, SimulationError, SimulationStopped, SprainError, StepDiscarded
from ..process import Child, Gone, Limits, listen
from .component import Component
from .instance import Instance

START_LIMIT, STEP_LIMIT = 120.0, 10.0  # s of wall time: opening and initialising; any other call
CLOSE_LIMIT = 1.0
ERRORS: dict[str, type[SprainError]] = {
    kind.__name__: kind for kind in (SimulationError, SimulationStopped, StepDiscarded, EnvironmentProblem, InputError)
}


class Isolated(Component):
    """A component whose instances run in processes of their own."""

    def open(self) -> Instance:
        return Proxy(self)


def isolated(component: Component) -> Isolated:
    return Isolated(**_fields(component))


def _fields(component: Component) -> dict[str, Any]:
    return {f.name: getattr(component, f.name) for f in fields(component)}


class Proxy:
    """Implements component.Instance on the near side. Raises what the instance raises, and SimulationError when its
    process ends or overruns its limit."""

    def __init__(self, component: Component) -> None:
        self.name = component.name
        self._pushed: list[float] | None = None
        self._current = False
        self._child = Child(Limits(), "sprain_cosim.fmu.isolated")
        try:
            self._answer(lambda: self._child.open(Component(**_fields(component)), START_LIMIT), "opening it")
        except SprainError:
            self._child.close()
            raise

    def bind(
        self,
        bus: np.ndarray,
        inputs: Sequence[str],
        first_input: int,
        outputs: Sequence[str],
        first_output: int,
        feedthrough: int,
    ) -> None:
        self._given = bus[first_input : first_input + len(inputs)]
        boundary = len(outputs) - feedthrough
        self._gives = bus[first_output : first_output + len(outputs)]
        self._states, self._echoes = slice(0, boundary), slice(boundary, len(outputs))
        self._outputs = np.zeros(len(outputs))
        self._call("bind", list(inputs), list(outputs))

    def watch_locals(self, names: Sequence[str], seen: np.ndarray) -> None:
        self._seen = seen
        self._call("watch_locals", list(names))

    def set_parameters(self, values: Mapping[str, float]) -> None:
        if values:
            self._call("set_parameters", dict(values))

    def enter_initialization(self, time: float, stop: float) -> None:
        self._call("enter_initialization", time, stop, limit=START_LIMIT)

    def exit_initialization(self) -> None:
        self._call("exit_initialization", limit=START_LIMIT)

    def set_inputs(self) -> None:
        self._pushed, self._current = self._given.tolist(), False

    def do_step(self, time: float, step: float) -> None:
        self._outputs[:] = self._call(
            "do_step", time, step, doing=f"in the step from {time:.6g} s to {time + step:.6g} s"
        )
        self._current = True

    def get_outputs(self) -> None:
        self._refresh()
        self._gives[:] = self._outputs

    def get_outputs_without_feedthrough(self) -> None:
        self._refresh()
        self._gives[self._states] = self._outputs[self._states]

    def get_feedthrough_outputs(self) -> None:
        self._refresh()
        self._gives[self._echoes] = self._outputs[self._echoes]

    def get_locals(self) -> None:
        self._seen[:] = self._call("get_locals")

    def save_before_steps(self) -> None:
        self._call("save_before_steps")

    def save_state(self) -> Any:
        return self._call("save_state")

    def restore_state(self, state: Any) -> None:
        self._call("restore_state", state)

    def free_state(self, state: Any) -> None:
        self._call("free_state", state)

    def reset(self) -> None:
        self._call("reset", limit=START_LIMIT)

    def close(self) -> None:
        try:
            self._child.ask({"do": "close", "with": [], "inputs": None}, CLOSE_LIMIT)
        except Gone:
            pass
        finally:
            self._child.close()

    def _refresh(self) -> None:
        if not self._current:
            self._outputs[:] = self._call("get_outputs")
            self._current = True

    def _call(self, do: str, *arguments: Any, limit: float = STEP_LIMIT, doing: str = "") -> Any:
        self._current = False
        request = {"do": do, "with": arguments, "inputs": self._pushed}
        self._pushed = None
        return self._answer(lambda: self._child.ask(request, limit), doing or f"in {do.replace('_', ' ')}")

    def _answer(self, ask: Callable[[], dict[str, Any]], doing: str) -> Any:
        try:
            answer = ask()
        except Gone as gone:
            said = self._child.log().splitlines()
            self._child.close()
            raise SimulationError(
                f"{self.name}: {doing}: its process "
                f"{_past(str(gone))}{f'; it said: {said[-1].strip()}' if said else ''}"
            ) from None
        if "error" in answer:
            raise ERRORS[answer["kind"]](answer["error"])
        return answer["value"]


def _past(text: str) -> str:
    """What isolation says of a process, as the end of a sentence about it."""
    return text.replace("ended by signal", "was ended by signal").replace("ended its process with", "ended with")


class Host:
    """The far side: the instance on a bus of its own."""

    def __init__(self, component: Component) -> None:
        self.instance = component.open()
        self.states: dict[int, Any] = {}
        self.keys = itertools.count()

    def answer(self, request: Mapping[str, Any]) -> Any:
        if request["inputs"] is not None:
            self.bus[: self.split] = request["inputs"]
            self.instance.set_inputs()
        own: Callable[..., Any] = getattr(self, request["do"], None) or getattr(self.instance, request["do"])
        return own(*request["with"])

    def bind(self, inputs: list[str], outputs: list[str]) -> None:
        self.split = len(inputs)
        self.bus = np.zeros(len(inputs) + len(outputs))
        self.instance.bind(self.bus, inputs, 0, outputs, self.split, 0)

    def watch_locals(self, names: list[str]) -> None:
        self.seen = np.zeros(len(names))
        self.instance.watch_locals(names, self.seen)

    def get_locals(self) -> list[float]:
        self.instance.get_locals()
        return self.seen.tolist()

    def get_outputs(self) -> list[float]:
        self.instance.get_outputs()
        return self.bus[self.split :].tolist()

    def do_step(self, time: float, step: float) -> list[float]:
        self.instance.do_step(time, step)
        return self.get_outputs()

    def reset(self) -> None:
        self.instance.reset()
        self.bus[:] = 0.0
        self.states.clear()

    def save_state(self) -> int:
        key = next(self.keys)
        self.states[key] = self.instance.save_state()
        return key

    def restore_state(self, key: int) -> None:
        self.instance.restore_state(self.states[key])

    def free_state(self, key: int) -> None:
        self.instance.free_state(self.states.pop(key))


def serve(*arguments: int) -> None:
    component, requests, answer = listen(*arguments)
    if component is None:
        return
    try:
        host = Host(component)
    except SprainError as problem:
        answer({"error": str(problem), "kind": type(problem).__name__})
        return
    answer({"value": None})
    for request in requests:
        try:
            answer({"value": host.answer(request)})
        except SprainError as problem:
            answer({"error": str(problem), "kind": type(problem).__name__})
        if request["do"] == "close":
            return


if __name__ == "__main__":
    serve(*(int(argument) for argument in sys.argv[1:5]))
    os._exit(0)
