"""Components without FMUs that note what is asked of them, and small FMUs built from source text."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from sprain_cosim.fmu.element import Connector
from sprain_cosim.fmu.python import PythonComponent, PythonInstance
from sprain_cosim.units import unit
from tests.python_fmu import build_python_fmu

MODELS = Path(__file__).parent.parent / "fmus"


def connector(name: str, causality: str, in_unit: str | None = "1", **more: Any) -> Connector:
    return Connector(name, 0, causality, "real", unit(in_unit) if in_unit else None, **more)


@dataclass(frozen=True)
class FakeComponent(PythonComponent):
    """A law in Python that keeps a journal of the calls that it gets. Its state is 0 at the start."""

    initial: Any = 0.0
    journal: list[str] = field(default_factory=list)

    def open(self) -> FakeInstance:
        return FakeInstance(self)


class FakeInstance(PythonInstance):
    """Implements Instance; `component.journal` grows with its calls."""

    component: FakeComponent

    def enter_initialization(self, time: float, stop: float) -> None:
        self.component.journal.append("enter_initialization")
        super().enter_initialization(time, stop)

    def exit_initialization(self) -> None:
        self.component.journal.append("exit_initialization")

    def do_step(self, time: float, step: float) -> None:
        self.component.journal.append(f"do_step {time!r}")
        super().do_step(time, step)

    def save_before_steps(self) -> None:
        self.component.journal.append("save_before_steps")

    def save_state(self) -> Any:
        assert self.component.capabilities.state
        return super().save_state()

    def close(self) -> None:
        self.component.journal.append("close")


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
    build_python_fmu(model, target)
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
