"""What a device would mean whose units nobody declared: its torque with angles read as degrees, and as radians."""

from __future__ import annotations

import math
from dataclasses import replace

from ..contract import AXES, POSITIVE
from ..errors import SprainError
from ..fmu.component import Component
from ..fmu.confine import confinement
from ..mapping import Mapping
from ..process import Child, Limits, ProcessEnded
from .probe import own_step

AT = 20.0  # deg, at which the torques are shown
WORDS = {"deg": "as degrees", "rad": "as radians"}
START_LIMIT, PROBE_LIMIT = 60.0, 6.0  # s
MEMORY = 8 << 30  # B


def both_readings(component: Component, mapping: Mapping) -> str:
    """One sentence with both; `component` as the FMU describes it."""
    shown = "; ".join(f"{WORDS[angle]}: {_reading(mapping.read_as(angle).apply(component))}" for angle in WORDS)
    return (
        f"units that nobody declared ({', '.join(mapping.open_units)}): {shown}; torques are read as N.m; ask its "
        'maker, and write the right units in place of "?"'
    )


def _reading(component: Component) -> str:
    axes = tuple(a for a in AXES if f"{a}_torque" in component.outputs and f"{a}_angle" in component.inputs)
    if not axes:
        return "cannot be measured, since no axis has both an angle and a torque"
    child = Child("sprain_cosim.brace.probe", Limits(memory=MEMORY))
    try:
        placed = replace(component, fmu=component.fmu.absolute())  # the child has a folder of its own
        child.open((placed, axes), START_LIMIT, confinement([component]))
        measured = child.call("run", "static", own_step(component), limit=PROBE_LIMIT)
    except (SprainError, ProcessEnded) as problem:
        return f"cannot be measured: {problem}"
    finally:
        child.close()
    parts = []
    for axis in axes:
        pair = next((p for p in measured["torque"][axis] if p[0] == AT), None)
        if pair is not None:
            rest = measured["rest"][axes.index(axis)]
            stiffness = abs(pair[1] - rest) / math.radians(AT)
            parts.append(f"{pair[1]:.3g} N.m at {AT:g} deg of {axis} ({POSITIVE[axis]}), {stiffness:.3g} N.m/rad")
    return ", ".join(parts) or "cannot be measured"
