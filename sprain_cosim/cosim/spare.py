"""A second instance of a member, for experiments that the run's own instance must not see."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..fmu.instance import Instance

if TYPE_CHECKING:
    from .assembly import Assembly, Member


def spare_in_initialization(assembly: Assembly, member: Member) -> Instance:
    """The spare of `member`, with the run's parameters, in its initialisation; its inputs and then its outputs stand on
    `member.spare_bus`, in the order of the member's own. Raises SimulationError."""
    n = len(member.input_values)
    if member.spare is None:
        member.spare = member.component.open()
        member.spare_bus = np.zeros(n + len(member.output_values))
        names = member.place.own_names
        member.spare.bind(member.spare_bus, names[:n], 0, names[n:], n, 0)
    else:
        member.spare.reset()
    member.spare.set_parameters(assembly.parameters_of(member))
    member.spare.enter_initialization(assembly.time, assembly.stop)
    return member.spare
