"""One open element driven by the names of its variables, apart from any system: for measurements on a device, for
tests, for experiments of users."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Self

import numpy as np

from ..errors import InputError, nearest
from ..units import seconds
from .element import Element
from .instance import Instance

STEP = 0.5e-3  # s, of measurements on a device


def own_step(element: Element) -> float:
    """A step that the element takes: STEP, or the multiple of its own that is next above."""
    own = element.capabilities.fixed_step
    return STEP if own is None else own * max(1, math.ceil(STEP / own - 1e-9))


class Driver:
    """Opens an element and drives it.

    >>> import sprain_cosim as sc
    >>> with sc.Driver(sc.Component.read("brace", "my_brace.fmu")) as driver:
    ...     driver.start({"angle_scale": 1.5})
    ...     driver.step("1 ms", {"rotation_x_angle": "10 deg"})
    ...     pushes_back = driver["rotation_x_torque"] < 0.0
    >>> pushes_back
    True

    element        what is driven
    inputs         names of the inputs that are fed
    outputs        names of the outputs that are read
    input_values   (len(inputs),) what was set last; they hold until they are set again
    output_values  (len(outputs),) what was read last
    time           [s], where the element is
    instance       the running element, for what this class does not offer

    Numbers are in the unit that the variable declares, times in seconds; a text such as "50 N.m/rad" or "1 ms" has its
    unit. Failure policy: after a SimulationError only `close` may be
    called."""

    def __init__(
        self, element: Element, inputs: Sequence[str] | None = None, outputs: Sequence[str] | None = None
    ) -> None:
        """`inputs`, `outputs`: names; default: all that are scalar numbers. Raises InputError for an unknown name,
        SimulationError or EnvironmentProblem when the element cannot be opened."""
        self.element = element
        self.inputs = _names(element, "input", inputs)
        self.outputs = _names(element, "output", outputs)
        split = len(self.inputs)
        bus = np.zeros(split + len(self.outputs))
        self.input_values, self.output_values = bus[:split], bus[split:]
        self.time = 0.0
        self._values = bus
        self._slots = {name: k for k, name in enumerate((*self.inputs, *self.outputs))}
        self._started = False
        self.instance: Instance = element.open()
        try:
            self.instance.bind(bus, self.inputs, 0, self.outputs, split, 0)
        except BaseException:
            self.instance.close()
            raise

    def start(
        self,
        parameters: Mapping[str, float | str] | None = None,
        inputs: Mapping[str, float | str] | None = None,
        time: float | str = 0.0,
        stop: float | str = 10.0,
    ) -> None:
        """A new run from `time` to `stop` [s]. Parameters and inputs that are not named have their start values (inputs
        without one: 0). Outputs are read before and after the initialisation. `parameters` may name inputs that are not
        fed, which hold their value. Raises InputError for a name that is no parameter or no input that is fed, and for
        a value that does not fit: its kind, its declared range."""
        settable = self.element.parameters | {n: c for n, c in self.element.inputs.items() if n not in self._slots}
        for name in parameters or {}:
            if name not in settable:
                raise InputError(f"{self.element.name}: no parameter {name!r}{nearest(name, settable)}")
        values = {n: settable[n].number(v, f"{self.element.name}.{n}") for n, v in (parameters or {}).items()}
        begin, end = seconds(time, "time"), seconds(stop, "stop")
        if self._started:
            self.instance.reset()
        self._started, self.time = True, begin
        self.input_values[:] = [self.element.connectors[name].start or 0.0 for name in self.inputs]
        self.instance.set_parameters(values)
        self.instance.enter_initialization(begin, end)
        self.set_inputs(inputs or {})
        self.instance.get_outputs()
        self.instance.exit_initialization()
        self.instance.get_outputs()

    def set_inputs(self, values: Mapping[str, float | str]) -> None:
        """Sets these inputs and sends all. Raises InputError for a name that is not among `inputs`."""
        for name, value in values.items():
            slot = self._slots.get(name, len(self.inputs))
            if slot >= len(self.inputs):
                raise InputError(f"{self.element.name}: no input {name!r} is fed{nearest(name, self.inputs)}")
            if not isinstance(value, float):  # which it is in a loop that steps
                value = self.element.connectors[name].number(value, f"{self.element.name}.{name}")
            self.input_values[slot] = value
        self.instance.set_inputs()

    def step(
        self, step: float | str, inputs: Mapping[str, float | str] | None = None, time: float | None = None
    ) -> None:
        """Sets `inputs`, takes one step of `step` [s] and reads the outputs. `time`: where the step begins, when the
        caller counts otherwise than by adding up steps."""
        start = self.time if time is None else time
        length = seconds(step, "step") if isinstance(step, str) else step
        self.set_inputs(inputs or {})
        self.instance.do_step(start, length)
        self.time = start + length
        self.instance.get_outputs()

    def get_outputs(self) -> dict[str, float]:
        """{output: value}, fetched anew: outputs may follow inputs that were set since the last step."""
        self.instance.get_outputs()
        return dict(zip(self.outputs, self.output_values.tolist(), strict=True))

    def __getitem__(self, name: str) -> float:
        """An input as it was set or an output as it was read last. Raises InputError for an unknown name."""
        if name not in self._slots:
            raise InputError(f"{self.element.name}: {name!r} is neither fed nor read{nearest(name, self._slots)}")
        return float(self._values[self._slots[name]])

    def save_state(self) -> Any:
        """All that `restore_state` needs to go on from here. Raises SimulationError when the element cannot."""
        return self.instance.save_state(), self.time, self._values.copy()

    def restore_state(self, state: Any) -> None:
        """Goes back to a saved state, time and values included; the state stays valid."""
        self.instance.restore_state(state[0])
        self.time, self._values[:] = state[1:]

    def free_state(self, state: Any) -> None:
        """Frees a saved state."""
        self.instance.free_state(state[0])

    def close(self) -> None:
        """Frees the instance."""
        self.instance.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _names(element: Element, causality: str, names: Sequence[str] | None) -> tuple[str, ...]:
    known = [name for name, connector in element.select(causality).items() if connector.scalar_number]
    for name in names or ():
        if name not in known:
            raise InputError(f"{element.name}: no {causality} {name!r} that is a number{nearest(name, known)}")
    return tuple(known if names is None else names)
