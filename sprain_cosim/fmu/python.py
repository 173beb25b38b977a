"""A law in Python as an element of a system, without an FMU: for experiments, tests and known solutions. It runs in
this process."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Self

from ..errors import InputError, SimulationError, SprainError, nearest
from ..units import split, unit
from .element import Capabilities, Connector, Element
from .instance import Values
from .messages import Messages

Numbers = Mapping[str, float]
Output = Callable[[Any, Numbers], Numbers | Sequence[float]]
Advance = Callable[[Any, Numbers, float, float], Any]


CAPABILITIES = Capabilities("", state=True, reusable=True)


def _start(name: str, entry: tuple[float, str] | str) -> tuple[float, str]:
    """A start value and its unit."""
    if not isinstance(entry, str):
        return entry
    found = split(entry)
    if found is None:
        raise InputError(f'{name} = {entry!r}: expected a number with its unit, such as "40 N.m/rad"')
    return found[0], found[1] or "1"


def _nothing(state: Any, values: Numbers) -> Sequence[float]:
    return ()


def _unchanged(state: Any, values: Numbers, time: float, step: float) -> Any:
    return state


@dataclass(frozen=True, repr=False)
class PythonComponent(Element):
    """An element whose law is two functions. `values` holds its inputs and parameters by name, in their own units.

    output   (state, values) -> {output: value}, or the values in the order of the outputs
    advance  (state, values, time, step) -> the state at `time + step` [s]; by default the state never changes
    initial  the state at the beginning of a run, or a function of `values` that gives it

    `advance` returns a new state and leaves the old one as it was: a run may go back to it. Picklable when the
    functions are those of a module. Failure policy: an exception of a function ends the run as a SimulationError that
    names the function.

    >>> import sprain_cosim as sc
    >>> spring = sc.PythonComponent.define(
    ...     "brace",
    ...     inputs={"subtalar_angle": "rad"},
    ...     outputs={"subtalar_torque": "N.m"},
    ...     parameters={"stiffness": "40 N.m/rad"},
    ...     output=lambda state, values: {"subtalar_torque": -values["stiffness"] * values["subtalar_angle"]},
    ... )
    >>> with sc.Driver(spring) as driver:
    ...     driver.start()
    ...     driver.step("1 ms", {"subtalar_angle": 0.5})
    ...     driver["subtalar_torque"]
    -20.0
    """

    capabilities: Capabilities = CAPABILITIES
    output: Output = _nothing
    advance: Advance = _unchanged
    initial: Any = None

    @classmethod
    def define(
        cls,
        name: str,
        *,
        inputs: Mapping[str, str],
        outputs: Mapping[str, str],
        parameters: Mapping[str, tuple[float, str] | str] | None = None,
        output: Output,
        advance: Advance = _unchanged,
        initial: Any = None,
        direct: Mapping[str, Sequence[str]] | None = None,
    ) -> Self:
        """From names and units.

        name        in the system
        inputs      {input: unit}, such as {"subtalar_angle": "rad"}; "1" for none
        outputs     {output: unit}
        parameters  {parameter: its start value with its unit}, such as {"stiffness": "40 N.m/rad"} or (40.0, "N.m/rad")
        direct      {output: inputs that act on it within the same instant}; outputs that are not named follow the state
                    alone. None: every input may act on every output

        Raises InputError for an unknown unit, a name twice or a name in `direct` that is none."""
        known = [*inputs, *outputs, *(parameters or {})]
        double = next((n for n in known if known.count(n) > 1), None)
        if double is not None:
            raise InputError(f"{name}: two variables named {double!r}")
        connectors = {n: Connector(n, 0, "input", "real", unit(text)) for n, text in inputs.items()}
        for n, text in outputs.items():
            acting = None if direct is None else tuple(direct.get(n, ()))
            connectors[n] = Connector(n, 0, "output", "real", unit(text), depends_on=acting)
        for n, entry in (parameters or {}).items():
            start, text = _start(f"{name}.{n}", entry)
            connectors[n] = Connector(n, 0, "parameter", "real", unit(text), start)
        for n, acting_inputs in (direct or {}).items():
            for other, among, kind in ((n, outputs, "output"), *((i, inputs, "input") for i in acting_inputs)):
                if other not in among:
                    raise InputError(f"{name}: direct names {other!r}, which is no {kind}{nearest(other, among)}")
        return cls(name, connectors, output=output, advance=advance, initial=initial)

    def open(self) -> PythonInstance:
        """A new instance in this process; nothing is loaded."""
        return PythonInstance(self)


class PythonInstance:
    """Implements Instance for a law in Python."""

    def __init__(self, component: PythonComponent) -> None:
        self.component = component
        self._values: dict[str, float] = {}
        self._law_values = MappingProxyType(self._values)
        self._state: Any = None
        self.reset()

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
        self._inputs, self._outputs = tuple(inputs), tuple(outputs)
        self._input_slots = bus[first_input : first_input + len(inputs)]
        self._output_slots = bus[first_output : first_output + len(outputs)]
        self._without_feedthrough, self._feedthrough = slice(0, boundary), slice(boundary, len(outputs))

    def watch_locals(self, names: Sequence[str], values: Values) -> None:
        self._locals, self._local_slots = tuple(names), values

    def set_parameters(self, values: Mapping[str, float]) -> None:
        self._values.update(values)

    def enter_initialization(self, time: float, stop: float) -> None:
        initial = self.component.initial
        self._state = self._call("initial", initial, self._law_values) if callable(initial) else initial

    def exit_initialization(self) -> None:
        pass

    def set_inputs(self) -> None:
        self._values.update(zip(self._inputs, self._input_slots.tolist(), strict=True))

    def get_outputs(self) -> None:
        self._fetch(slice(None))

    def get_outputs_without_feedthrough(self) -> None:
        self._fetch(self._without_feedthrough)

    def get_feedthrough_outputs(self) -> None:
        self._fetch(self._feedthrough)

    def get_locals(self) -> None:
        self._local_slots[:] = self._evaluated(self._locals)

    def do_step(self, time: float, step: float) -> None:
        self._state = self._call("advance", self.component.advance, self._state, self._law_values, time, step)

    def save_before_steps(self) -> None:
        pass

    def save_state(self) -> Any:
        return self._state

    def restore_state(self, state: Any) -> None:
        self._state = state

    def free_state(self, state: Any) -> None:
        pass

    def messages(self) -> Messages | None:
        return None

    def reset(self) -> None:
        self._state = None
        self._values.clear()
        for name, connector in (*self.component.inputs.items(), *self.component.parameters.items()):
            self._values[name] = connector.start or 0.0

    def close(self) -> None:
        pass

    def _fetch(self, part: slice) -> None:
        self._output_slots[part] = self._evaluated(self._outputs[part])

    def _evaluated(self, names: Sequence[str]) -> list[float]:
        """What `output` gives for these names. Raises SimulationError when it gives none."""
        values = self._call("output", self.component.output, self._state, self._law_values)
        if not isinstance(values, Mapping):
            outputs, values = self.component.outputs, list(values)
            if len(values) != len(outputs):
                raise SimulationError(
                    f"{self.component.name}: output gives {len(values)} values for {len(outputs)} outputs"
                )
            values = dict(zip(outputs, values, strict=True))
        missing = [name for name in names if name not in values]
        if missing:
            raise SimulationError(f"{self.component.name}: output gives no {', '.join(missing)}")
        return [values[name] for name in names]

    def _call(self, name: str, function: Callable[..., Any], *arguments: Any) -> Any:
        try:
            return function(*arguments)
        except SprainError:
            raise
        except Exception as problem:
            raise SimulationError(
                f"{self.component.name}: {name} failed: {type(problem).__name__}: {problem}"
            ) from problem
