"""Components without FMUs: a few lines of Python behind the protocol that the master drives, and small FMUs built from
source text."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from sprain_cosim.fmu.build.python import build_python_fmu
from sprain_cosim.fmu.element import Capabilities, Connector
from sprain_cosim.units import unit

MODELS = Path(__file__).parent.parent / "fmus"


def connector(name: str, causality: str, in_unit: str | None = "1", **more: Any) -> Connector:
    return Connector(name, 0, causality, "real", unit(in_unit) if in_unit else None, **more)


@dataclass(frozen=True)
class FakeComponent:
    """`law(state, inputs, time, step)` returns the new state; `outputs(state, inputs)` the outputs."""

    name: str
    connectors: Mapping[str, Connector]
    law: Callable[..., Any] = lambda state, inputs, time, step: state
    output: Callable[..., Sequence[float]] = lambda state, inputs: ()
    initial: Any = 0.0
    capabilities: Capabilities = field(default_factory=lambda: Capabilities("2.0", state=True, reusable=True))
    journal: list[str] = field(default_factory=list)

    def select(self, causality: str) -> dict[str, Connector]:
        return {n: c for n, c in self.connectors.items() if c.causality == causality}

    @property
    def inputs(self) -> dict[str, Connector]:
        return self.select("input")

    @property
    def outputs(self) -> dict[str, Connector]:
        return self.select("output")

    @property
    def parameters(self) -> dict[str, Connector]:
        return self.select("parameter")

    def open(self) -> FakeInstance:
        return FakeInstance(self)


class FakeInstance:
    def __init__(self, component: FakeComponent) -> None:
        self.component, self.parameters = component, {}
        self.reset()

    def bind(
        self,
        bus: np.ndarray,
        inputs: Sequence[str],
        first_input: int,
        outputs: Sequence[str],
        first_output: int,
        feedthrough: int,
    ) -> None:
        self.bus, self.names = bus, list(inputs)
        self.place, self.out = (
            slice(first_input, first_input + len(inputs)),
            slice(first_output, first_output + len(outputs)),
        )
        self.inputs = dict.fromkeys(self.component.inputs, 0.0)

    def note(self, what: str) -> None:
        self.component.journal.append(what)

    def set_parameters(self, values: Mapping[str, float]) -> None:
        self.parameters.update(values)

    def enter_initialization(self, time: float, stop: float) -> None:
        self.note("enter_initialization")
        self.state = self.component.initial

    def exit_initialization(self) -> None:
        self.note("exit_initialization")

    def set_inputs(self) -> None:
        self.inputs.update(zip(self.names, self.bus[self.place].tolist(), strict=True))

    def get_outputs(self) -> None:
        self.bus[self.out] = self.component.output(self.state, self.inputs)

    get_outputs_without_feedthrough = get_feedthrough_outputs = get_outputs

    def do_step(self, time: float, step: float) -> None:
        self.note(f"do_step {time!r}")
        self.state = self.component.law(self.state, self.inputs, time, step)

    def save_before_steps(self) -> None:
        self.note("save_before_steps")

    def save_state(self) -> Any:
        assert self.component.capabilities.state
        return self.state

    def restore_state(self, state: Any) -> None:
        self.state = state

    def free_state(self, state: Any) -> None:
        pass

    def reset(self) -> None:
        self.state = self.component.initial

    def close(self) -> None:
        self.note("close")


def make_fmu(folder: Path, name: str, variables: str, slave: str, extra: str = "") -> Path:
    """An FMU from the text of `variables()`'s list and of the slave's methods."""
    model = folder / name
    model.mkdir(parents=True)
    (model / "interface.py").write_text(
        f'MODEL = "{name}"\nDESCRIPTION = "made by a test"\n{extra}\n\ndef variables():\n    return {variables}\n'
    )
    body = textwrap.indent(textwrap.dedent(slave).strip(), "    ")
    (model / "slave.py").write_text(
        "from .._fmi import Fmi2Slave\nfrom .interface import variables\n\n\nclass Slave(Fmi2Slave):\n    variables "
        f"= variables()\n\n{body}\n"
    )
    target = folder / f"{name}.fmu"
    build_python_fmu(model, target, MODELS / "_fmi.py")
    return target


def brace_variables(angle_unit: str = "rad", torque_unit: str = "N.m", axis: str = "subtalar") -> str:
    """The list for a device with one axis and a stiffness [N.m/rad]."""
    return f"""[
        dict(name="k", causality="parameter", variability="fixed", unit="N.m/rad", start=50.0, description="stiffness"),
        dict(name="{axis}_angle", causality="input", variability="continuous", unit="{angle_unit}", start=0.0, description="angle"),
        dict(name="{axis}_torque", causality="output", variability="continuous", unit="{torque_unit}", description="torque", depends=["{axis}_angle"]),
    ]"""


def linear_variables(declares: bool) -> str:
    """The list for a spring-damper on the subtalar axis, k [N.m/rad] and c [N.m.s/rad]; `declares`: it has outputs for
    both."""
    declared = """
        dict(name="subtalar_stiffness", causality="output", variability="continuous", unit="N.m/rad", description="stiffness"),
        dict(name="subtalar_damping", causality="output", variability="continuous", unit="N.m.s/rad", description="damping"),"""
    return f"""[
        dict(name="k", causality="parameter", variability="fixed", unit="N.m/rad", start=0.0, description="stiffness"),
        dict(name="c", causality="parameter", variability="fixed", unit="N.m.s/rad", start=0.0, description="damping"),
        dict(name="subtalar_angle", causality="input", variability="continuous", unit="rad", start=0.0, description="angle"),
        dict(name="subtalar_velocity", causality="input", variability="continuous", unit="rad/s", start=0.0, description="velocity"),
        dict(name="subtalar_torque", causality="output", variability="continuous", unit="N.m", description="torque"),{declared if declares else ""}
    ]"""
