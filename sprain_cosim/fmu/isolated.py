"""One FMU in a process of its own: what it does to its process ends the run with a message, not this process; what it
loads meets no other FMU's.

`Isolated` is a component whose instances live in a child each. The proxy here and the child exchange one message per
step: the inputs that were set since the last one go along with the step, the outputs come back with its answer.
Numbers travel as the shortest decimal that gives the same double back, so a run is the same to the bit."""

from __future__ import annotations

import contextlib
import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import partial
from time import monotonic
from typing import Any, ClassVar

import numpy as np

from ..errors import SimulationError, SprainError
from ..process import FIRST_RUN, FIRST_START, LEAST, Child, Handlers, Limits, Overrun, ProcessEnded, serve
from .component import Component
from .confine import confinement
from .instance import Instance, Values
from .messages import Messages
from .opener import import_libraries as _prepare  # noqa: F401 - before the process is copied
from .surroundings import Surroundings

START_LIMIT, STEP_LIMIT = FIRST_START, LEAST  # s of wall time: opening and initialising; any other call
CLOSE_LIMIT = 1.0
DOING = {
    "bind": "choosing its variables",
    "watch_locals": "choosing its variables",
    "set_parameters": "setting its parameters",
    "enter_initialization": "entering initialisation",
    "exit_initialization": "initialising",
    "get_outputs": "reading its outputs",
    "get_locals": "reading its variables",
    "save_state": "saving its state",
    "restore_state": "restoring its state",
    "free_state": "freeing a state",
    "reset": "resetting",
}


@dataclass(frozen=True, repr=False)
class Isolated(Component):
    """A component whose instances run in processes of their own. `limits` of those."""

    own_process: ClassVar[bool] = True
    limits: Limits = field(default_factory=Limits)

    def open(self) -> Instance:
        """Starts a process and opens the FMU there. Raises what the FMU's opening raises there, and SimulationError
        when the process ends or takes too long."""
        return Proxy(replace(Component(**_fields(self)), fmu=self.fmu.absolute()), self.limits)


def isolated(component: Component) -> Isolated:
    """The same component, in processes of its own."""
    return Isolated(**_fields(component))


def _fields(component: Component) -> dict[str, Any]:
    return {f.name: getattr(component, f.name) for f in fields(Component)}


class Proxy:
    """Implements Instance on the near side. Raises what the instance raises, and SimulationError when its process ends
    or overruns its limit: that of a run, as stated or learned from those before, and unless it is stated STEP_LIMIT of
    each call."""

    def __init__(self, component: Component, limits: Limits) -> None:
        self.name = component.name
        self._runs = limits.of_trials(FIRST_RUN)
        self._began = self._reached = math.inf  # of the run, by `monotonic`
        self._pending_inputs: list[float] | None = None
        self._outputs_current = False
        self._child = Child("sprain_cosim.fmu.isolated", limits)
        try:
            self._guarded(lambda: self._child.open(component, START_LIMIT, confinement([component])), "opening it")
        except SprainError:
            self._child.close()
            raise

    def bind(
        self,
        bus: Values,
        inputs: Sequence[str],
        first_input: int,
        outputs: Sequence[str],
        first_output: int,
        feedthrough: int,
    ) -> None:
        boundary = len(outputs) - feedthrough
        self._inputs = bus[first_input : first_input + len(inputs)]
        self._outputs = bus[first_output : first_output + len(outputs)]
        self._without_feedthrough, self._feedthrough = slice(0, boundary), slice(boundary, len(outputs))
        self._latest = np.zeros(len(outputs))
        self._call("bind", list(inputs), list(outputs))

    def watch_locals(self, names: Sequence[str], values: Values) -> None:
        self._locals = values
        self._call("watch_locals", list(names))

    def set_parameters(self, values: Mapping[str, float]) -> None:
        if values:
            self._call("set_parameters", dict(values))

    def enter_initialization(self, time: float, stop: float) -> None:
        self._began = self._reached = monotonic()
        self._call("enter_initialization", time, stop, limit=START_LIMIT)

    def exit_initialization(self) -> None:
        self._call("exit_initialization", limit=START_LIMIT)

    def set_inputs(self) -> None:
        self._pending_inputs, self._outputs_current = self._inputs.tolist(), False

    def do_step(self, time: float, step: float) -> None:
        doing = f"in the step from {time:.6g} s to {time + step:.6g} s"
        self._latest[:] = self._call("do_step", time, step, doing=doing)
        self._outputs_current = True

    def get_outputs(self) -> None:
        self._fetch()
        self._outputs[:] = self._latest

    def get_outputs_without_feedthrough(self) -> None:
        self._fetch()
        self._outputs[self._without_feedthrough] = self._latest[self._without_feedthrough]

    def get_feedthrough_outputs(self) -> None:
        self._fetch()
        self._outputs[self._feedthrough] = self._latest[self._feedthrough]

    def get_locals(self) -> None:
        self._locals[:] = self._call("get_locals")

    def save_before_steps(self) -> None:
        self._call("save_before_steps")

    def save_state(self) -> Any:
        return self._call("save_state")

    def restore_state(self, state: Any) -> None:
        self._call("restore_state", state)

    def free_state(self, state: Any) -> None:
        self._call("free_state", state)

    def messages(self) -> Messages | None:
        """None also when its process is gone."""
        try:
            return Messages.from_json(self._child.call("messages", None, limit=STEP_LIMIT), self.name)
        except (ProcessEnded, SprainError):
            return None

    def reset(self) -> None:
        if self._began < self._reached < math.inf:
            self._runs.note(self._reached - self._began)
        self._began = self._reached = math.inf
        self._call("reset", limit=START_LIMIT)

    def close(self) -> None:
        try:
            self._child.call("close", None, limit=CLOSE_LIMIT)
        except (ProcessEnded, SprainError):
            pass
        finally:
            self._child.close()

    def _fetch(self) -> None:
        if not self._outputs_current:
            self._latest[:] = self._call("get_outputs")
            self._outputs_current = True

    def _call(self, method: str, *arguments: Any, limit: float | None = None, doing: str = "") -> Any:
        self._outputs_current = False
        inputs, self._pending_inputs = self._pending_inputs, None
        seconds = STEP_LIMIT if limit is None else limit
        if self._began < math.inf:
            left = max(0.0, self._began + self._runs.seconds - monotonic())
            seconds = left if self._runs.stated is not None else min(seconds, left)
        value = self._guarded(
            lambda: self._child.call(method, inputs, *arguments, limit=seconds), doing or DOING.get(method, method)
        )
        if self._began < math.inf:
            self._reached = monotonic()
        return value

    def _guarded(self, request: Callable[[], Any], doing: str) -> Any:
        """Raises SimulationError when the process ends."""
        try:
            return request()
        except ProcessEnded as end:
            if isinstance(end, Overrun) and self._began < math.inf and self._runs.stated is not None:
                end = Overrun(self._runs.seconds, self._runs.origin)
            last_words = self._child.last_words()
            self._child.close()
            raise SimulationError(f"{self.name}: {doing}: its process {_past(str(end))}{last_words}") from None


def _past(text: str) -> str:
    """How a process ended, as the end of a sentence about it."""
    return text.replace("ended by signal", "was ended by signal").replace("ended its process with", "ended with")


class Host:
    """The far side: the instance on a bus of its own. Its methods take and give what travels as JSON."""

    def __init__(self, component: Component) -> None:
        self._surroundings = Surroundings()
        self.instance = component.open()
        self._states: dict[int, Any] = {}
        self._keys = itertools.count()

    def handlers(self) -> Handlers:
        """The methods of the instance by name. Their first argument: inputs to be set before the call, or None."""
        passed_on = ("set_parameters", "enter_initialization", "exit_initialization", "save_before_steps", "close")
        methods = [getattr(self.instance, name) for name in passed_on] + [
            self.bind,
            self.watch_locals,
            self.get_locals,
            self.get_outputs,
            self.do_step,
            self.messages,
            self.reset,
            self.save_state,
            self.restore_state,
            self.free_state,
        ]
        return {method.__name__: partial(self._call, method) for method in methods}

    def _call(self, method: Callable[..., Any], inputs: list[float] | None, *arguments: Any) -> Any:
        if inputs is not None:
            self._bus[: self._split] = inputs
            self.instance.set_inputs()
        return method(*arguments)

    def bind(self, inputs: list[str], outputs: list[str]) -> None:
        self._split = len(inputs)
        self._bus = np.zeros(len(inputs) + len(outputs))
        self.instance.bind(self._bus, inputs, 0, outputs, self._split, 0)

    def watch_locals(self, names: list[str]) -> None:
        self._locals = np.zeros(len(names))
        self.instance.watch_locals(names, self._locals)

    def get_locals(self) -> list[float]:
        self.instance.get_locals()
        return list(self._locals.tolist())

    def get_outputs(self) -> list[float]:
        self.instance.get_outputs()
        return list(self._bus[self._split :].tolist())

    def do_step(self, time: float, step: float) -> list[float]:
        self.instance.do_step(time, step)
        return self.get_outputs()

    def messages(self) -> dict[str, Any] | None:
        found = self.instance.messages()
        return found.to_json() if found is not None else None

    def reset(self) -> None:
        self._surroundings.restore()
        self.instance.reset()
        self._bus[:] = 0.0
        self._states.clear()

    def save_state(self) -> int:
        key = next(self._keys)
        self._states[key] = self.instance.save_state()
        return key

    def restore_state(self, key: int) -> None:
        self.instance.restore_state(self._states[key])

    def free_state(self, key: int) -> None:
        self.instance.free_state(self._states.pop(key))


@contextlib.contextmanager
def _handlers(component: Component) -> Iterator[Handlers]:
    """The child: opens the FMU, then answers for its instance."""
    yield Host(component).handlers()


if __name__ == "__main__":
    serve(_handlers)
