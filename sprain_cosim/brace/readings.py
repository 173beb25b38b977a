"""What a device means whose units nobody declared: how strong it is with its angles read as degrees and as radians, or
its torques as N.m and as N.mm, and which of the readings a brace can have."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from ..contract import AXES, POSITIVE, plain
from ..errors import SprainError, without_name
from ..fmu.component import Component
from ..fmu.confine import confinement
from ..fmu.driver import own_step
from ..literature import BRACES_TEXT
from ..mapping import Mapping as MappingFile
from ..process import Child, Limits, ProcessEnded
from ..units import unit
from .names import undeclared
from .strength import Strength

AT = 20.0  # deg, at which the torques are shown
MILLI = 1e-3  # N.m in a N.mm
Units = Mapping[str, str]  # {end of a signal's name: unit}
BY_ANGLE: dict[str, Units] = {  # the readings where nobody declared the unit of an angle or a velocity
    "radians": {"_angle": "rad", "_velocity": "rad/s", "_torque": "N.m"},
    "degrees": {"_angle": "deg", "_velocity": "deg/s", "_torque": "N.m"},
}
BY_TORQUE: dict[str, Units] = {"N.m": {"_torque": "N.m"}, "N.mm": {"_torque": "N.mm"}}  # and that of a torque alone
START_LIMIT, PROBE_LIMIT = 60.0, 6.0  # s
MEMORY = 8 << 30  # B


@dataclass(frozen=True)
class Reading:
    """A device with its undeclared units read in one way.

    - words: what was read, such as "degrees"
    - shown: its torques and stiffness in words, or why they cannot be measured
    - strength: None where it cannot be measured
    """

    words: str
    shown: str
    strength: Strength | None

    @property
    def plausible(self) -> bool:
        return self.strength is not None and not self.strength.doubt

    def text(self) -> str:
        verdict = "" if self.strength is None else f" ({self.strength.doubt or 'plausible'})"
        return f"as {self.words}: {self.shown}{verdict}"


@dataclass(frozen=True)
class Readings:
    """All that were tried, the one in SI units first; `names` the signals whose unit nobody declared."""

    names: tuple[str, ...]
    tried: tuple[Reading, ...]

    @property
    def refused(self) -> bool:
        """Whether what was measured in SI units is no brace."""
        return self.tried[0].strength is not None and not self.tried[0].plausible

    def text(self) -> str:
        fitting = [f"as {reading.words}" for reading in self.tried if reading.plausible]
        if len(fitting) == 1:
            verdict = f"only {fitting[0]} is plausible"
        else:
            verdict = f"{' and '.join(fitting)} are plausible" if fitting else "none of them is plausible"
        return f"{'; '.join(reading.text() for reading in self.tried)}; {verdict} ({BRACES_TEXT})"

    def question(self) -> str:
        """What a mapping file leaves open."""
        return (
            f"units that nobody declared ({', '.join(self.names)}): {self.text()}; ask its maker, and write the right "
            'units in place of "?", or where none stands'
        )

    def assumption(self) -> str:
        """What is assumed of the contract's own names."""
        return f"no unit is declared for {', '.join(self.names)}; the contract's SI units are assumed: {self.text()}"

    def refusal(self) -> str:
        """Why that cannot be assumed."""
        return (
            f"no unit is declared for {', '.join(self.names)}, and the contract's SI units are not plausible: "
            f"{self.text()}; state the right units in a mapping file"
        )


def readings_of_mapping(component: Component, mapping: MappingFile) -> Readings:
    """Of the units that the mapping file leaves open; `component` as the FMU describes it."""
    names = mapping.unstated(component)
    return _readings(names, lambda units: mapping.read_as(component, units).apply(component))


def readings_of_names(component: Component) -> Readings | None:
    """Of the contract's own angles, velocities and torques whose unit the FMU does not declare; None where there are
    none."""
    names = undeclared(component)
    return _readings(names, lambda units: _read_as(component, names, units)) if names else None


def _read_as(component: Component, names: tuple[str, ...], units: Units) -> Component:
    connectors = dict(component.connectors)
    for name in names:
        own = next((u for end, u in units.items() if plain(name).endswith(plain(end))), None)
        if own is not None:
            connectors[name] = replace(connectors[name], unit=unit(own))
    return replace(component, connectors=connectors)


def _readings(names: tuple[str, ...], read: Callable[[Units], Component]) -> Readings:
    ends = {end for name in names for end in BY_ANGLE["radians"] if plain(name).endswith(plain(end))}
    tried = BY_ANGLE if ends - {"_torque"} else BY_TORQUE
    found = [_reading(words, read(units)) for words, units in tried.items()]
    if tried is BY_ANGLE and "_torque" in ends and not any(reading.plausible for reading in found):
        found += [
            Reading(f"{r.words} with torques in N.mm", f"a thousandth of {r.words}", r.strength.times(MILLI))
            for r in found
            if r.strength is not None and not r.strength.times(MILLI).doubt
        ]
    return Readings(names, tuple(found))


def _reading(words: str, component: Component) -> Reading:
    outputs, inputs = ({plain(n) for n in component.select(kind)} for kind in ("output", "input"))
    axes = tuple(a for a in AXES if plain(f"{a}_torque") in outputs and plain(f"{a}_angle") in inputs)
    if not axes:
        return Reading(words, "cannot be measured, since no axis has both an angle and a torque", None)
    try:
        static, recorded = _measured(component, axes)
    except (SprainError, ProcessEnded) as problem:
        return Reading(words, f"cannot be measured: {without_name(component.name, problem)}", None)
    strength = Strength.of(static, recorded)
    parts = []
    for axis in axes:
        pair = next((p for p in static["torque"][axis] if p[0] == AT), None)
        if pair is not None:
            away = ", which pushes it further" if pair[1] > max(0.0, static["rest"][axes.index(axis)]) else ""
            parts.append(f"{pair[1]:.3g} N.m at {AT:g} deg of {axis} ({POSITIVE[axis]}){away}")
    shown = f"{strength.stiffness:.3g} N.m/rad, up to {strength.torque:.3g} N.m in a landing"
    return Reading(words, ", ".join([*parts, shown]), strength)


def _measured(component: Component, axes: tuple[str, ...]) -> tuple[dict[str, Any], dict[str, Any]]:
    """The results of the probes static and recorded. Raises SprainError, ProcessEnded."""
    child = Child("sprain_cosim.brace.probe", Limits(memory=MEMORY))
    try:
        placed = replace(component, fmu=component.fmu.absolute())  # the child has a folder of its own
        child.open((placed, axes), START_LIMIT, confinement([component]))
        step = own_step(component)
        static = child.call("run", "static", step, limit=PROBE_LIMIT)
        return static, child.call("run", "recorded", step, limit=PROBE_LIMIT)
    finally:
        child.close()
