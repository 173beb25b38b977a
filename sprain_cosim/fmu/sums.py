"""Outputs that are sums of an FMU's own outputs: two cables that pull on one axis are one torque."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..units import Unit
from .element import Connector
from .instance import Instance, Values
from .messages import Messages

SI = Unit("1")


def part_name(name: str, part: Connector) -> str:
    """What the inner instance calls a part of the output `name`."""
    return f"{name} {part.name}"


class Summed:
    """Implements Instance around one that knows the parts as `part_name` gives them; everything else is passed on.

    A sum is in SI: each part's value, taken to SI by the unit of the part."""

    def __init__(self, inner: Instance, sums: Mapping[str, Sequence[Connector]]) -> None:
        """`sums` {output: its parts}."""
        self.inner, self.sums = inner, sums

    def bind(
        self,
        bus: Values,
        inputs: Sequence[str],
        first_input: int,
        outputs: Sequence[str],
        first_output: int,
        feedthrough: int,
    ) -> None:
        split, self._boundary = len(inputs), len(outputs) - feedthrough
        self._inputs = bus[first_input : first_input + split]
        self._outputs = bus[first_output : first_output + len(outputs)]
        names: list[str] = []
        self._terms: list[tuple[slice, Values | None, float]] = []  # of each output: places, factors, offset
        inner_boundary = 0
        for k, name in enumerate(outputs):
            if k == self._boundary:
                inner_boundary = len(names)
            parts, first = self.sums.get(name, ()), len(names)
            names += [part_name(name, part) for part in parts] or [name]
            units = [part.unit or SI for part in parts]
            factors = np.array([u.factor for u in units]) if units else None
            self._terms.append((slice(first, len(names)), factors, sum(u.offset for u in units)))
        own = np.zeros(split + len(names))
        self._inner_inputs, self._inner_outputs = own[:split], own[split:]
        count = len(names) - inner_boundary if feedthrough else 0
        self.inner.bind(own, inputs, 0, names, split, count)

    def watch_locals(self, names: Sequence[str], values: Values) -> None:
        self.inner.watch_locals(names, values)

    def set_parameters(self, values: Mapping[str, float]) -> None:
        self.inner.set_parameters(values)

    def enter_initialization(self, time: float, stop: float) -> None:
        self.inner.enter_initialization(time, stop)

    def exit_initialization(self) -> None:
        self.inner.exit_initialization()

    def set_inputs(self) -> None:
        self._inner_inputs[:] = self._inputs
        self.inner.set_inputs()

    def get_outputs(self) -> None:
        self.inner.get_outputs()
        self._add(range(len(self._terms)))

    def get_outputs_without_feedthrough(self) -> None:
        self.inner.get_outputs_without_feedthrough()
        self._add(range(self._boundary))

    def get_feedthrough_outputs(self) -> None:
        self.inner.get_feedthrough_outputs()
        self._add(range(self._boundary, len(self._terms)))

    def _add(self, outputs: range) -> None:
        for k in outputs:
            places, factors, offset = self._terms[k]
            values = self._inner_outputs[places]
            self._outputs[k] = values[0] if factors is None else values @ factors + offset

    def get_locals(self) -> None:
        self.inner.get_locals()

    def do_step(self, time: float, step: float) -> None:
        self.inner.do_step(time, step)

    def save_before_steps(self) -> None:
        self.inner.save_before_steps()

    def save_state(self) -> Any:
        return self.inner.save_state()

    def restore_state(self, state: Any) -> None:
        self.inner.restore_state(state)

    def free_state(self, state: Any) -> None:
        self.inner.free_state(state)

    def messages(self) -> Messages | None:
        return self.inner.messages()

    def reset(self) -> None:
        self.inner.reset()
        self._inner_inputs[:] = self._inner_outputs[:] = 0.0

    def close(self) -> None:
        self.inner.close()
