"""Mapping files: how a device's own variables become the contract's signals.

active = true                                                optional: a device that may give energy
step = "1 ms"                                                optional: its own fixed step, where it declares none
reset = true                                                 optional: its reset equals a fresh instance
[inputs]   subtalar_angle  = { to = "In1_InvAngle", unit = "deg" }
[outputs]  subtalar_torque = { from = "M_out", factor = -1 }

What arrives is factor * what comes + offset, both in the FMU's unit: the one it declares, or `unit` where it declares
none or a wrong one."""

from __future__ import annotations

import math
from collections.abc import Mapping as MappingOf
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from .contract import INPUTS, OUTPUTS
from .errors import InputError, nearest, problems_to_error
from .files import parse_toml, read_text
from .fmu import archive
from .fmu.component import Component
from .fmu.element import Connector
from .units import Unit, quantity, unit

INSIDE = "extra/sprain-cosim/map.toml"
KEYS = ("active", "step", "reset", "inputs", "outputs")
SECOND = unit("s")


@dataclass(frozen=True)
class Signal:
    """`variable` of the FMU; `unit` None: as declared."""

    variable: str
    factor: float = 1.0
    offset: float = 0.0
    unit: Unit | None = None


@dataclass(frozen=True)
class Mapping:
    """{contract name: Signal}; `step` [s] of its own; `source` where it was read."""

    inputs: MappingOf[str, Signal] = field(default_factory=dict)
    outputs: MappingOf[str, Signal] = field(default_factory=dict)
    active: bool = False
    source: str = ""
    step: float | None = None
    reset: bool = False

    def apply(self, component: Component) -> Component:
        """The component under the contract's names. Raises InputError with all that cannot be honoured."""
        problems: list[str] = []
        connectors = dict(component.connectors)
        used: dict[str, str] = {}
        for causality, signals in (("input", self.inputs), ("output", self.outputs)):
            for name, signal in signals.items():
                place = f"{causality}s.{name} = {signal.variable}"
                found = component.connectors.get(signal.variable)
                if found is None:
                    problems.append(
                        f"{place}: {component.fmu.name} has no such "
                        f"variable{nearest(signal.variable, component.select(causality))}"
                    )
                    continue
                if found.causality != causality:
                    problems.append(
                        f"{place}: is of causality {found.causality}; only an {causality} can be mapped here"
                    )
                elif not found.scalar_number:
                    problems.append(f"{place}: is of type {found.kind}; only scalar numbers can be mapped")
                elif signal.variable in used:
                    problems.append(f"{place}: is mapped to {used[signal.variable]} already")
                elif name != signal.variable and name in component.connectors:
                    problems.append(
                        f"{place}: the FMU has a variable {name} of its own, which would be hidden; leave the line "
                        "out or map that one"
                    )
                else:
                    used[signal.variable] = name
                    connectors.pop(signal.variable, None)
                    try:
                        connectors[name] = _renamed(name, found, signal, causality)
                    except InputError as problem:
                        problems.append(f"{place}: {problem}")
        declared = component.capabilities.fixed_step
        if self.step is not None and declared is not None and abs(self.step - declared) > 1e-9 * declared:
            problems.append(f"step = {1e3 * self.step:g} ms: {component.fmu.name} declares {1e3 * declared:g} ms")
        problems_to_error(self.source or "mapping", problems)
        for name, c in connectors.items():
            if c.depends_on is not None:
                connectors[name] = replace(c, depends_on=tuple(used.get(n, n) for n in c.depends_on))
        driven = replace(
            component.capabilities,
            fixed_step=self.step or component.capabilities.fixed_step,
            reusable=self.reset or component.capabilities.reusable,
        )
        return replace(component, connectors=connectors, capabilities=driven)


def _renamed(name: str, found: Connector, signal: Signal, causality: str) -> Connector:
    wanted = (INPUTS if causality == "input" else OUTPUTS)[name]
    own = signal.unit or found.unit or wanted
    if not own.same_dimension(wanted):
        raise InputError(
            f"its unit {own.name} has the dimension {own.dimension()}, expected {wanted.dimension()}; state the true "
            "one with unit = ..."
        )
    if causality == "input":
        factor = own.factor / signal.factor
        offset = own.offset - signal.offset * factor
    else:
        factor = own.factor * signal.factor
        offset = own.offset + signal.offset * own.factor
    low, high = sorted((found.minimum, found.maximum))
    return replace(found, name=name, unit=Unit(own.name, own.exponents, factor, offset), minimum=low, maximum=high)


def read_component(name: str, fmu: Path, mapping: Path | None = None) -> Component:
    """The component under the contract's names: by the mapping file, else by the mapping it carries, else as it is.
    Raises InputError."""
    component = Component.read(name, fmu)
    found = load_mapping(mapping) if mapping is not None else carried(component)
    return component if found is None else found.apply(component)


def load_mapping(path: Path | str) -> Mapping:
    """Raises InputError."""
    return parse(read_text(Path(path)), str(path))


def carried(component: Component) -> Mapping | None:
    """The mapping inside the FMU, if it carries one. Raises InputError."""
    if INSIDE not in archive.read(component.fmu).names:
        return None
    try:
        return parse(archive.member(component.fmu, INSIDE).decode(), f"{component.fmu}:{INSIDE}")
    except UnicodeDecodeError:
        raise InputError(f"{component.fmu}:{INSIDE}: is not UTF-8 text") from None


def parse(text: str, source: str) -> Mapping:
    """Raises InputError with all problems."""
    content = parse_toml(text, source)
    problems = [f"unknown key {key!r}{nearest(key, KEYS)}" for key in content if key not in KEYS]
    problems += [
        f"{key}: must be true or false" for key in ("active", "reset") if not isinstance(content.get(key, False), bool)
    ]
    step = None
    if "step" in content:
        try:
            step = quantity(content["step"], SECOND, "step")
            if step <= 0:
                problems.append(f"step = {content['step']!r}: must be positive")
        except InputError as problem:
            problems.append(str(problem))
    signals: dict[str, dict[str, Signal]] = {}
    for section, link, known in (("inputs", "to", INPUTS), ("outputs", "from", OUTPUTS)):
        signals[section] = {}
        entries = content.get(section, {})
        if not isinstance(entries, dict):
            problems.append(f"{section}: must be a table, [{section}]")
            continue
        for name, entry in entries.items():
            if name not in known:
                problems.append(f"{section}.{name}: is no signal of the contract{nearest(name, known)}")
                continue
            try:
                signals[section][name] = _signal(entry, link)
            except InputError as problem:
                problems.append(f"{section}.{name}: {problem}")
    problems_to_error(source, problems)
    return Mapping(
        signals["inputs"], signals["outputs"], content.get("active", False), source, step, content.get("reset", False)
    )


def _signal(entry: Any, link: str) -> Signal:
    if isinstance(entry, str):
        entry = {link: entry}
    if not isinstance(entry, dict) or not isinstance(entry.get(link), str):
        raise InputError(f'needs {{ {link} = "variable of the FMU" }}')
    for key in entry:
        if key not in (link, "factor", "offset", "unit"):
            raise InputError(f"unknown key {key!r}{nearest(key, [link, 'factor', 'offset', 'unit'])}")
    numbers = {}
    for key, default in (("factor", 1.0), ("offset", 0.0)):
        value = entry.get(key, default)
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
            raise InputError(f"{key} must be a finite number")
        numbers[key] = float(value)
    if numbers["factor"] == 0.0:
        raise InputError("factor must not be 0")
    if "unit" in entry and not isinstance(entry["unit"], str):
        raise InputError('unit must be text such as "deg"')
    return Signal(entry[link], numbers["factor"], numbers["offset"], unit(entry["unit"]) if "unit" in entry else None)
