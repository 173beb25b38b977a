"""Mapping files: how a device's own variables become the contract's signals. `FILE` says what they may hold.

[inputs]   subtalar_angle  = { to = "In1_InvAngle", unit = "deg" }
[outputs]  subtalar_torque = { from = "M_out", factor = -1 }

What arrives is factor * what comes + offset, both in the FMU's unit: the one it declares, or `unit` where it declares
none or a wrong one."""

from __future__ import annotations

import re
from collections.abc import Mapping as MappingOf
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from . import keys
from .contract import INPUTS, OUTPUTS, plain
from .errors import InputError, nearest, problems_to_error
from .files import parse_toml, read_text
from .fmu import archive
from .fmu.component import Component
from .fmu.element import LONGEST_STEP, SHORTEST_STEP, Connector
from .sandbox.allowed import NOTHING, Allowed, allowed
from .sandbox.allowed import PATTERN as ALLOW
from .units import SECOND, Unit, unit

INSIDE = "extra/sprain-cosim/map.toml"
METRE = unit("m")
LEVERED = {"_torque": unit("N"), "_angle": METRE, "_velocity": unit("m/s")}  # at the end of an arm, by signal
SHA256 = re.compile(r"[0-9a-fA-F]{64}")
UNKNOWN = Unit("?")  # a unit that nobody has stated yet
READINGS = {  # how a unit may be meant that nobody has stated, by the end of a signal's name
    "_angle": ("deg", "rad"),
    "_velocity": ("deg/s", "rad/s"),
    "_torque": ("N.m", "N.mm"),
}
FACTOR = {"type": "number", "not": {"const": 0}}


def _factor(value: Any, place: str) -> float:
    if not keys.is_number(value):
        raise InputError(f"{place.rpartition('.')[0]}: factor must be a finite number")
    if value == 0:
        raise InputError(f"{place.rpartition('.')[0]}: factor must not be 0")
    return float(value)


def _factors(value: Any, place: str) -> float | tuple[float, ...]:
    if isinstance(value, list) and value:
        return tuple(_factor(number, place) for number in value)
    return _factor(value, place)


def _variables(value: Any, place: str) -> tuple[str, ...]:
    names = [value] if isinstance(value, str) else value
    if not isinstance(names, list) or not names or not all(isinstance(name, str) for name in names):
        table = place.rpartition(".")[0]
        raise InputError(f'{table}: needs {{ from = "variable of the FMU" }}, or several: {{ from = ["a", "b"] }}')
    return tuple(names)


def _unit(value: Any, place: str) -> Unit:
    table = place.rpartition(".")[0]
    if not isinstance(value, str):
        raise InputError(f'{table}: unit must be text such as "deg"')
    if value == UNKNOWN.name:
        return UNKNOWN
    try:
        return unit(value)
    except InputError as problem:
        raise InputError(f"{table}: {problem}") from None


def _allowed(value: Any, place: str) -> Allowed:
    if not isinstance(value, list):
        raise InputError(f'{place}: must be a list, such as ["loopback", "read:/opt/licence"]')
    return allowed(value)


def _or_list(form: MappingOf[str, Any]) -> dict[str, Any]:
    """The JSON Schema of one, or of a list of some."""
    return {"anyOf": [form, {"type": "array", "items": form, "minItems": 1}]}


def _signals(link: str, causality: str, known: MappingOf[str, Unit]) -> keys.Named:
    needs = f'needs {{ {link} = "variable of the FMU" }}'
    several = link == "from"
    linked = keys.text(f"{{table}}: {needs}")
    if several:
        linked = keys.Value("text, or list of text", _or_list({"type": "string"}), _variables)
    entry = keys.Table(
        (
            keys.Key(link, linked, f"{causality} of the FMU{'; of several, the sum' * several}", needs=needs),
            keys.Key(
                "factor",
                keys.Value("number, or one for each", _or_list(FACTOR), _factors)
                if several
                else keys.Value("number", FACTOR, _factor),
                "what arrives is factor * what comes + offset, in the FMU's unit; not 0",
                "1",
            ),
            keys.Key(
                "offset",
                keys.number("{table}: offset must be a finite number"),
                "added to what comes, in the FMU's unit",
                "0",
            ),
            keys.Key(
                "unit",
                keys.Value("text", {"type": "string"}, _unit),
                "the FMU's unit where it declares none or a wrong one, such as deg or N.mm; ? is one still to be "
                "stated, which no run takes",
                "as declared; where the FMU declares none it must be stated",
            ),
            keys.Key(
                "arm",
                keys.measured(METRE, above_zero=True),
                "lever of a cable or a strap, where the FMU has a force, a travel or a speed in place of a torque, an "
                "angle or a velocity",
            ),
        ),
        says=f"{{at}}: {needs}",
    )
    strange = "{at}.{name}: is no signal of the contract{hint}"
    return keys.Named("SIGNAL", keys.Short(link, entry), known=tuple(known), strange=strange)


FILE = keys.File(
    "mapping files",
    "mapping",
    "How the variables of an FMU become the signals of the [brace contract](../brace-contract.md). The file lies "
    "beside the FMU, or in it as `extra/sprain-cosim/map.toml`.",
    keys.Table(
        (
            keys.Key("active", keys.flag(), "true: a device that may give energy", "false"),
            keys.Key(
                "step",
                keys.measured(SECOND, above_zero=True),
                'its own fixed step where the FMU declares none, such as "1 ms"',
            ),
            keys.Key(
                "continuous",
                keys.flag(),
                "true: its law is continuous in truth; its fixed step is only that of the tool that exported it",
                "false",
            ),
            keys.Key("reset", keys.flag(), "true: its reset equals a fresh instance", "false"),
            keys.Key(
                "allow",
                keys.Value("list of text", {"type": "array", "items": {"type": "string", "pattern": ALLOW}}, _allowed),
                'what it may do beyond the sandbox: "loopback", "network", "exec", "read:/path"; only in '
                "a file beside the FMU, never in one that it carries",
                "nothing",
            ),
            keys.Key(
                "expect_sha256",
                keys.simple(
                    "text",
                    {"type": "string", "pattern": f"^{SHA256.pattern}$"},
                    lambda value: isinstance(value, str) and SHA256.fullmatch(value) is not None,
                    "{at} = {value}: must be the 64 hexadecimal digits of a SHA-256",
                    str.lower,
                ),
                "of the FMU's file; another file is refused",
                "any",
            ),
            keys.Key("inputs", _signals("to", "input", INPUTS), "the input of the FMU that takes the signal"),
            keys.Key("outputs", _signals("from", "output", OUTPUTS), "the output of the FMU that is the signal"),
            keys.Key(
                "constants",
                keys.Named(
                    "INPUT",
                    keys.raw("quantity, number, true or false, or a name", {"type": ["string", "number", "boolean"]}),
                ),
                'what an input of the FMU holds that nothing feeds, such as supply = "48 V"; `--set` of a run goes '
                "before it",
                "the FMU's start value",
            ),
        )
    ),
)


@dataclass(frozen=True)
class Signal:
    """Where a signal of the contract goes to or comes from: factor * what comes + offset arrives.

    variables  of the FMU; of an output there may be several, which are added
    factors    of each, not 0
    arm        [m] of the lever between the FMU's force, travel or speed and the signal; None: there is none
    offset     in the FMU's unit
    unit       the FMU's; None: as declared, which the FMU must do; UNKNOWN: still to be stated
    """

    variables: tuple[str, ...]
    factors: tuple[float, ...]
    offset: float = 0.0
    unit: Unit | None = None
    arm: float | None = None


@dataclass(frozen=True)
class Mapping:
    """What a mapping file says.

    inputs         {signal of the contract: the FMU's input that takes it}
    outputs        {signal of the contract: the FMU's output that is it}
    active         whether the device may give energy
    source         where the mapping was read
    step           [s] of its own, where the FMU declares none; None: as declared
    reset          whether its reset equals a fresh instance
    continuous     whether its law is continuous in truth, whatever its fixed step
    allowed        what it may do beyond the sandbox
    expect_sha256  of the FMU's file; "": any
    constants      {the FMU's input that nothing feeds: its value, as it was written}
    """

    inputs: MappingOf[str, Signal] = field(default_factory=dict)
    outputs: MappingOf[str, Signal] = field(default_factory=dict)
    active: bool = False
    source: str = ""
    step: float | None = None
    reset: bool = False
    continuous: bool = False
    allowed: Allowed = NOTHING
    expect_sha256: str = ""
    constants: MappingOf[str, Any] = field(default_factory=dict)

    def unstated(self, component: Component) -> tuple[str, ...]:
        """The signals whose unit nobody has stated: "?" in the file, or neither there nor in the FMU."""
        both = {**self.inputs, **self.outputs}
        return tuple(name for name, signal in both.items() if _is_unstated(signal, component))

    def read_as(self, component: Component, units: MappingOf[str, str]) -> Mapping:
        """The same with the units that nobody has stated read as `units` {end of a signal's name: unit}, else SI."""

        def stated(name: str, signal: Signal, known: MappingOf[str, Unit]) -> Signal:
            if not _is_unstated(signal, component):
                return signal
            return replace(signal, unit=next((unit(u) for end, u in units.items() if name.endswith(end)), known[name]))

        return replace(
            self,
            inputs={name: stated(name, signal, INPUTS) for name, signal in self.inputs.items()},
            outputs={name: stated(name, signal, OUTPUTS) for name, signal in self.outputs.items()},
        )

    def apply(self, component: Component) -> Component:
        """The component under the contract's names. Raises InputError with all that cannot be honoured."""
        problems: list[str] = []
        connectors = dict(component.connectors)
        used: dict[str, str] = {}
        for causality, signals in (("input", self.inputs), ("output", self.outputs)):
            for name, signal in signals.items():
                problems += _put(name, signal, component, causality, connectors, used)
        problems += self._wrong_constants(component, used)
        declared = component.capabilities.fixed_step
        if self.step is not None and declared is not None and abs(self.step - declared) > 1e-9 * declared:
            problems.append(f"step = {1e3 * self.step:g} ms: {component.fmu.name} declares {1e3 * declared:g} ms")
        if self.step is not None and not SHORTEST_STEP <= self.step <= LONGEST_STEP:
            problems.append(f"step = {self.step:g} s: must lie between {SHORTEST_STEP:g} s and {LONGEST_STEP:g} s")
        if self.expect_sha256 not in ("", component.sha256):
            problems.append(
                f"expect_sha256 = {self.expect_sha256[:12]}...: {component.fmu.name} has another content, SHA-256 "
                f"{component.sha256}"
            )
        problems_to_error(self.source or "mapping", problems)
        for name, c in connectors.items():
            if c.depends_on is not None:
                connectors[name] = replace(c, depends_on=tuple(used.get(n, n) for n in c.depends_on))
        driven = replace(
            component.capabilities,
            fixed_step=self.step or component.capabilities.fixed_step,
            continuous=self.continuous,
            reusable=self.reset or component.capabilities.reusable,
        )
        return replace(
            component,
            connectors=connectors,
            capabilities=driven,
            allowed=self.allowed,
            constants={**component.constants, **self.constants},
        )

    def _wrong_constants(self, component: Component, used: MappingOf[str, str]) -> list[str]:
        """One line for each constant that cannot be held; `used` {variable: the signal that it is mapped to}."""
        problems = []
        for name, value in self.constants.items():
            place = f"constants.{name}"
            found = component.connectors.get(name)
            if found is None:
                hint = nearest(name, component.inputs)
                problems.append(f"{place}: {component.fmu.name} has no such variable{hint}")
            elif found.causality != "input":
                hint = f"; set it with --set brace.{name}=VALUE" if found.causality == "parameter" else ""
                problems.append(f"{place}: is of causality {found.causality}; only an input can be held constant{hint}")
            elif name in used or plain(name) in {plain(signal) for signal in INPUTS}:
                problems.append(f"{place}: is fed as {used.get(name, name)}; leave one of the two out")
            else:
                try:
                    found.value(value, place)
                except InputError as problem:
                    problems.append(str(problem))
        return problems


def _is_unstated(signal: Signal, component: Component) -> bool:
    if signal.unit is not None:
        return signal.unit == UNKNOWN
    found = [component.connectors[name] for name in signal.variables if name in component.connectors]
    return any(connector.unit is None and connector.kind == "real" for connector in found)


def _put(
    name: str,
    signal: Signal,
    component: Component,
    causality: str,
    connectors: dict[str, Connector],
    used: dict[str, str],
) -> list[str]:
    """Puts the signal's connector in the place of its variables, which are noted in `used`; returns the problems met,
    one line each."""
    problems, parts = list[str](), list[Connector]()
    for variable, factor in zip(signal.variables, signal.factors, strict=True):
        place = f"{causality}s.{name} = {variable}"
        found = component.connectors.get(variable)
        if found is None:
            array = component.connectors.get(variable.partition("[")[0])
            if array is not None and array.kind == "array":
                elements = [n for n, c in component.select(causality).items() if c.array and c.array.name == array.name]
                problems.append(
                    f"{place}: the array {array.name} has {elements[0]} to {elements[-1]}"
                    if elements
                    else f"{place}: {array.name} is an array, whose elements cannot be mapped; export scalars (it has "
                    "too many elements, no numbers, or no start values)"
                )
                continue
            hint = nearest(variable, component.select(causality))
            problems.append(f"{place}: {component.fmu.name} has no such variable{hint}")
        elif found.causality != causality:
            problems.append(f"{place}: is of causality {found.causality}; only an {causality} can be mapped here")
        elif not found.scalar_number:
            problems.append(f"{place}: is of type {found.kind}; only scalar numbers can be mapped")
        elif variable in used:
            problems.append(f"{place}: is mapped to {used[variable]} already")
        elif name not in signal.variables and name in component.connectors:
            problems.append(
                f"{place}: the FMU has a variable {name} of its own, which would be hidden; leave the line out or map "
                "that one"
            )
        else:
            used[variable] = name
            connectors.pop(variable, None)
            try:
                parts.append(_renamed(name, found, signal, factor, causality))
            except InputError as problem:
                problems.append(f"{place}: {problem}")
    if not problems:
        connectors[name] = parts[0] if len(parts) == 1 else _sum(name, signal, parts)
    return problems


def _sum(name: str, signal: Signal, parts: Sequence[Connector]) -> Connector:
    """The output that is the sum of these, in the contract's unit."""
    dependencies = [part.depends_on for part in parts]
    named = zip(signal.variables, parts, strict=True)
    return Connector(
        name,
        parts[0].reference,
        "output",
        "real",
        OUTPUTS[name],
        description=f"sum of {', '.join(signal.variables)}",
        depends_on=(
            None if None in dependencies else tuple(dict.fromkeys(n for found in dependencies for n in found or ()))
        ),
        parts=tuple(replace(part, name=variable) for variable, part in named),
    )


def _renamed(name: str, found: Connector, signal: Signal, weight: float, causality: str) -> Connector:
    signal_unit = (INPUTS if causality == "input" else OUTPUTS)[name]
    if signal.unit == UNKNOWN or (signal.unit is None and found.unit is None and not signal_unit.dimensionless):
        readings = next((pair for end, pair in READINGS.items() if name.endswith(end)), (signal_unit.name,))
        raise InputError(
            f"{'no unit' if signal.unit is None else f'unit = {chr(34)}?{chr(34)}'}: {' or '.join(readings)}? the FMU "
            "does not say; ask its maker, or let `sprain-cosim check` show what each would mean, and write it here"
        )
    expected = signal_unit if signal.arm is None else _levered(name)
    own = signal.unit or found.unit or expected
    if not own.same_dimension(expected):
        force = name.endswith("_torque") and own.same_dimension(LEVERED["_torque"])
        raise InputError(
            f"its unit {own.name} has the dimension {own.dimension()}, expected {expected.dimension()}; state the "
            + ('lever of the force with arm = "40 mm"' if force else "true one with unit = ...")
        )
    if causality == "input":
        factor = own.factor / weight
        offset = own.offset - signal.offset * factor
    else:
        factor = own.factor * weight
        offset = own.offset + signal.offset * own.factor
    lever = 1.0 if signal.arm is None else signal.arm if causality == "output" else 1.0 / signal.arm
    low, high = sorted((found.minimum, found.maximum))
    levered = Unit(own.name, signal_unit.exponents, lever * factor, lever * offset)
    return replace(found, name=name, unit=levered, minimum=low, maximum=high)


def _levered(name: str) -> Unit:
    """The unit of what a signal is at the end of a lever. Raises InputError for a signal that has no lever."""
    for end, at_the_end in LEVERED.items():
        if name.endswith(end):
            return at_the_end
    raise InputError("arm belongs to an angle, a velocity or a torque")


def read_component(name: str, fmu: Path, mapping: Path | None = None) -> Component:
    """The component under the contract's names: by the mapping file, else by the mapping it carries, else as it is.
    What has the same content is the same object. Raises InputError."""
    text = None if mapping is None else read_text(Path(mapping))
    return _component(name, archive.read(Path(fmu)), text, str(mapping))


@lru_cache(maxsize=64)
def _component(name: str, checked: archive.Archive, text: str | None, source: str) -> Component:
    component = Component.of(name, checked)
    found = parse(text, source) if text is not None else carried(component)
    component = component if found is None else found.apply(component)
    if component.tool_problem():
        raise InputError(f"{component.fmu}: {component.tool_problem()}")
    return component


def load_mapping(path: Path | str) -> Mapping:
    """Raises InputError."""
    return parse(read_text(Path(path)), str(path))


def carried(component: Component) -> Mapping | None:
    """The mapping inside the FMU, if it carries one; what it would allow itself is left out. Raises InputError."""
    found = _inside(component)
    return None if found is None else replace(found, allowed=NOTHING)


def asked_for(component: Component) -> Allowed:
    """What the mapping inside the FMU would allow it, which only a mapping file of the user's can. Raises
    InputError."""
    found = _inside(component)
    return NOTHING if found is None else found.allowed


def _inside(component: Component) -> Mapping | None:
    if INSIDE not in archive.read(component.fmu).names:
        return None
    try:
        return parse(archive.member(component.fmu, INSIDE).decode(), f"{component.fmu}:{INSIDE}")
    except UnicodeDecodeError:
        raise InputError(f"{component.fmu}:{INSIDE}: is not UTF-8 text") from None


def parse(text: str, source: str) -> Mapping:
    """Raises InputError with all problems."""
    problems: list[str] = []
    content: dict[str, Any] = FILE.table.read(parse_toml(text, source), "", problems)
    wrong = {name: _wrong_sum(entry) for name, entry in content.get("outputs", {}).items() if "from" in entry}
    problems += [f"outputs.{name}: {problem}" for name, problem in wrong.items() if problem]
    if not problems and all(value == {} for value in content.values()):
        problems.append("says nothing; name the FMU's variables in [inputs] and [outputs], or leave the file out")
    problems_to_error(source, problems)
    return Mapping(
        inputs={name: _signal(entry, "to") for name, entry in content.get("inputs", {}).items()},
        outputs={name: _signal(entry, "from") for name, entry in content.get("outputs", {}).items()},
        active=content.get("active", False),
        source=source,
        step=content.get("step"),
        reset=content.get("reset", False),
        continuous=content.get("continuous", False),
        allowed=content.get("allow", NOTHING),
        expect_sha256=content.get("expect_sha256", ""),
        constants=content.get("constants", {}),
    )


def _signal(entry: MappingOf[str, Any], link: str) -> Signal:
    variables = (entry[link],) if link == "to" else entry[link]
    factor = entry.get("factor", 1.0)
    factors = factor if isinstance(factor, tuple) else (factor,) * len(variables)
    return Signal(variables, factors, entry.get("offset", 0.0), entry.get("unit"), entry.get("arm"))


def _wrong_sum(entry: MappingOf[str, Any]) -> str:
    """What is wrong with an output's entry as a sum; empty where nothing is."""
    count, factor = len(entry["from"]), entry.get("factor")
    if isinstance(factor, tuple) and len(factor) != count:
        return f"factor has {len(factor)} numbers for {count} variables"
    if count > 1 and "offset" in entry:
        return "offset belongs to a single variable, not to a sum"
    return ""
