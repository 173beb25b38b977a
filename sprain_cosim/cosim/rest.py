"""What a component gives at rest: with its inputs at their start values, before anything of the others reaches it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..errors import SimulationError
from ..fmu.description import OWN_TOOL
from .schedule import RECORD
from .spare import spare_in_initialization

if TYPE_CHECKING:
    from .assembly import Assembly, Member

Values = NDArray[np.floating]


def outputs_at_rest(assembly: Assembly, member: Member) -> Values:
    """(n,) its outputs, each in its own unit. `member` has entered its initialisation, and its inputs were not set.

    FMI has outputs follow from what is set while a component initialises, but some tools compute them when the
    initialisation ends, or in a step only. Where all are 0, a second instance shows which; one that cannot be had, or
    fails, leaves them at 0."""
    member.instance.get_outputs()
    able = member.component.capabilities
    if member.output_values.any() or able.tool == OWN_TOOL or able.single:
        return member.output_values.copy()
    try:
        spare = spare_in_initialization(assembly, member)
        spare.exit_initialization()
        spare.get_outputs()
        outputs = member.spare_bus[len(member.input_values) :]
        if not outputs.any():
            spare.do_step(assembly.time, able.fixed_step or RECORD)
            spare.get_outputs()
    except SimulationError:
        member.close_spare()
        return member.output_values.copy()
    return np.nan_to_num(outputs, nan=0.0, posinf=0.0, neginf=0.0)
