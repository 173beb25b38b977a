"""What the rest of the package drives a simulator with: a running component, FMU or not.

    bind                                        once
    watch_locals                                at any time after bind
    set_parameters
    enter_initialization
        set_inputs, get_outputs                 as often as the loops between components need
    exit_initialization
        set_inputs, do_step, get_outputs        one communication step after the other
        save_state, restore_state, free_state   between steps
    reset                                       then again from set_parameters; or close

Failure policy: a method that fails raises SimulationError with component, call and time in its message; after that only
`close` may be called. StepDiscarded (a SimulationError) says that the step could be taken in parts by a run whose
instances save before steps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from .messages import Messages

Values = NDArray[np.float64]


class Instance(Protocol):
    """A running component. Values are numbers in the unit that each variable declares; times are in s."""

    def bind(
        self,
        bus: Values,
        inputs: Sequence[str],
        first_input: int,
        outputs: Sequence[str],
        first_output: int,
        feedthrough: int,
    ) -> None:
        """Lays variables on `bus` (n,): `inputs` from slot `first_input` on, `outputs` from slot `first_output` on,
        both in the order of their names. The last `feedthrough` of the outputs follow inputs directly.

        Before: the instance is new; called once. After: the calls below read and write these slots, and the caller
        never moves the array. Raises EnvironmentProblem where the FMU's library lacks a function that this needs."""

    def watch_locals(self, names: Sequence[str], values: Values) -> None:
        """Chooses variables that `get_locals` writes into `values` (len(names),). A later call replaces the choice."""

    def set_parameters(self, values: Mapping[str, float]) -> None:
        """Sets parameters by name, and inputs that are not on the bus, which hold their value over the run.

        Before: the instance is new or reset. After: the run begins with them. Raises SimulationError for a value that
        the FMU refuses; for that of an input, `enter_initialization` does."""

    def enter_initialization(self, time: float, stop: float) -> None:
        """Begins the initialisation of a run from `time` to `stop`.

        Before: parameters are set. After: inputs can be set and outputs got at `time`."""

    def exit_initialization(self) -> None:
        """Ends the initialisation. After: the first step can be taken, and outputs hold for its beginning."""

    def set_inputs(self) -> None:
        """Sends all inputs from the bus; they hold until they are sent again.

        Before: in initialisation, or between steps."""

    def get_outputs(self) -> None:
        """Fetches all outputs onto the bus. Before: in initialisation, or between steps."""

    def get_outputs_without_feedthrough(self) -> None:
        """Fetches the outputs that do not follow inputs directly; the other slots stay as they are."""

    def get_feedthrough_outputs(self) -> None:
        """Fetches the outputs that follow inputs directly; the other slots stay as they are."""

    def get_locals(self) -> None:
        """Fetches what `watch_locals` chose. Before: the initialisation has ended."""

    def do_step(self, time: float, step: float) -> None:
        """Takes the instance from `time` to `time + step`, with the inputs that were sent last held.

        Before: the instance is at `time`. After: outputs are those at `time + step`, to be fetched. Raises
        SimulationStopped when the FMU asks to end the run, StepDiscarded when it refuses a step that could be taken in
        parts, else SimulationError."""

    def save_before_steps(self) -> None:
        """From the next step on, an instance that can saves its state before each step, and takes a step that its FMU
        refuses in parts. Stays so over a reset."""

    def save_state(self) -> Any:
        """The state, for `restore_state` of this instance alone; several may be held at once.

        Before: the initialisation has ended, and `Capabilities.state` is true. Raises SimulationError otherwise."""

    def restore_state(self, state: Any) -> None:
        """Goes back to a saved state, which stays valid. After: inputs count as not sent and outputs as not fetched."""

    def free_state(self, state: Any) -> None:
        """Frees a saved state; it must not be used afterwards."""

    def messages(self) -> Messages | None:
        """What it has said since the run began, its instantiation included; None when it said nothing.

        At any time, also after a call has failed."""

    def reset(self) -> None:
        """Back to the state of a new instance, parameters included; what was bound and watched stays so.

        Before: no call has failed. After: the same calls as for a new instance give the same numbers."""

    def close(self) -> None:
        """Frees the instance, whatever state it is in. May be called twice. No other call may follow."""
