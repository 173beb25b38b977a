"""Does a device's description carry the contract's names, with scalar reals and units of the right dimension?"""

from __future__ import annotations

import difflib
import math

from ..contract import AXES, INPUTS, OUTPUTS, PLANT, RANGE_DEG, plain, profile
from ..errors import InputError
from ..fmu.component import Component
from ..fmu.element import Connector
from ..mapping import Mapping
from ..units import Unit, unit
from .fit import FitReport
from .proposal import could_be, propose

MEASURED = ("_angle", "_velocity", "_torque")  # ends of names whose unit shows in how strong a device is
LANDING_DEG = 45.0  # as far as a landing goes
SHOWN = 6  # inputs outside the contract that are named


def contract_axes(component: Component, report: FitReport) -> tuple[str, ...]:
    """The axes that have a torque output. Problems, warnings and notes about names, types and units go to `report`."""
    outputs = {plain(n): c for n, c in component.outputs.items()}
    inputs = {plain(n): c for n, c in component.inputs.items()}
    _judge_duplicates(component, report)
    axes = tuple(a for a in AXES if plain(f"{a}_torque") in outputs)
    report.profile = profile(set(axes))
    if not axes:
        _judge_missing_torque(component, report)
        return axes
    if report.profile is None:
        report.problems.append(f"torques of several profiles ({', '.join(axes)}); map only those of one")
    _judge_missing_inputs(component, axes, inputs, report)
    for signals, have in ((INPUTS, inputs), (OUTPUTS, outputs)):
        for name, expected in signals.items():
            if plain(name) in have:
                _judge_variable(name, have[plain(name)], expected, report)
    known = {plain(name) for name in INPUTS}
    extra = [
        n
        for n, c in component.inputs.items()
        if c.kind not in ("clock", "array") and plain(n) not in known and n not in component.constants
    ]
    if extra:
        report.notes.append(
            "inputs outside the contract keep their start values: "
            f"{', '.join(extra[:SHOWN])}{' ...' if len(extra) > SHOWN else ''}"
        )
    return axes


def clocks(component: Component) -> tuple[list[str], list[str]]:
    """Warnings and notes: runs tick input clocks of constant interval and no others, and read no output clock."""
    found: dict[str, list[str]] = {"input": [], "output": []}
    ticked = [f"{n} every {1e3 * c.interval:g} ms" for n, c in component.inputs.items() if c.interval is not None]
    if ticked:
        found["output"].append(f"every run ticks its clocks: {', '.join(ticked[:4])}{' ...' * (len(ticked) > 4)}")
    for causality, lines in found.items():
        ticking = [name for name, c in component.select(causality).items() if c.kind == "clock" and c.interval is None]
        few = f"{', '.join(ticking[:4])}{' ...' if len(ticking) > 4 else ''}"
        if ticking and causality == "input":
            lines.append(
                f"has input clocks ({few}), which no run ticks: what they trigger does not happen; export it with a "
                "sampling of its own, as a fixed step"
            )
        elif ticking:
            lines.append(f"has output clocks ({few}), which no run reads")
    return found["input"], found["output"]


def contradicting_units(component: Component, mapping: Mapping | None) -> list[str]:
    """Variables that the contract uses whose unit has a factor that its name does not have, such as N.mm with factor 1:
    one line each. `component` as the FMU describes it, `mapping` what leads to the contract."""
    signals = () if mapping is None else (*mapping.inputs.values(), *mapping.outputs.values())
    mapped = {variable: signal.unit is not None for signal in signals for variable in signal.variables}
    known = {plain(name) for name in (*INPUTS, *OUTPUTS)}
    found = []
    for name, connector in (*component.inputs.items(), *component.outputs.items()):
        declared = connector.unit
        if declared is None or mapped.get(name, plain(name) not in known):
            continue
        try:
            named = unit(declared.name)
        except InputError:
            continue
        if named.exponents[:-1] == declared.exponents[:-1] and abs(named.factor / declared.factor - 1.0) > 1e-6:
            found.append(
                f"{name}: its unit {declared.name} is declared with the factor {declared.factor:g}, but "
                f"{declared.name} is {named.factor:g} {named.dimension()}; correct the description, or state the true "
                "unit in a mapping file"
            )
    return found


def undeclared(component: Component) -> tuple[str, ...]:
    """The device's variables that are angles, velocities or torques of the contract, without a unit."""
    known = {plain(name) for name in (*INPUTS, *OUTPUTS) if name.endswith(MEASURED)}
    return tuple(
        name
        for name, c in (*component.inputs.items(), *component.outputs.items())
        if c.unit is None and c.kind == "real" and plain(name) in known
    )


def _judge_duplicates(component: Component, report: FitReport) -> None:
    for causality, known in (("input", INPUTS), ("output", OUTPUTS)):
        for name in known:
            same = [n for n in component.select(causality) if plain(n) == plain(name)]
            if len(same) > 1:
                report.problems.append(
                    f"{' and '.join(same)} both read as {name}, since ., _ and letter case do not count; rename one"
                )


def _judge_missing_torque(component: Component, report: FitReport) -> None:
    if f"{PLANT}.subtalar_angle" in component.outputs:
        report.problems.append(
            "is a landing with its plant inside, as `ssp export --container` writes it, and no device"
        )
        return
    candidates = [n for n, c in component.outputs.items() if could_be(c, "torque")]
    if candidates:
        report.proposal = propose(component)
        report.problems.append(
            f"no output is named A_torque for an axis A ({', '.join(AXES)}); candidates: {', '.join(candidates)}"
        )
        return
    report.proposal = propose(component)
    report.problems.append(
        "no output in N.m, declared or named as a torque: this is no brace in the sense of the contract, unless a "
        "mapping file says which of its outputs is one"
    )
    report.next_step = (
        "sprain-cosim brace new DIR for a brace to start from, or sprain-cosim brace from-csv "
        "TABLE.csv for one from a measured table"
    )


def _judge_missing_inputs(
    component: Component, axes: tuple[str, ...], inputs: dict[str, Connector], report: FitReport
) -> None:
    for axis in axes:
        if plain(f"{axis}_angle") not in inputs:
            close = ", ".join(difflib.get_close_matches(f"{axis}_angle", component.inputs, 3, 0.4))
            report.problems.append(
                f"no input {axis}_angle [rad], which {axis}_torque needs{f'; candidates: {close}' if close else ''}"
            )
            report.proposal = propose(component)
    if not any(plain(f"{a}_velocity") in inputs for a in axes):
        report.notes.append("no velocity inputs: the brace sees how fast the foot moves only by the angle's change")


def _judge_resolution(name: str, connector: Connector, expected: Unit, report: FitReport) -> None:
    """What is lost between the contract's real numbers and what the variable takes."""
    if connector.kind != "real" and not expected.dimensionless:
        report.warnings.append(
            f"{connector.name}: is of type {connector.kind}, so its values are whole numbers"
            f"{f' of {connector.unit.name}' if connector.unit else ''}; export it as a real number"
        )
    axis = name.removesuffix("_angle")
    if axis in RANGE_DEG and connector.unit is not None and connector.unit.same_dimension(expected):
        reached = sorted(math.degrees(connector.unit.to_base(v)) for v in (connector.minimum, connector.maximum))
        low, high = (math.copysign(min(abs(d), LANDING_DEG), d) for d in RANGE_DEG[axis])
        if reached[0] > low or reached[1] < high:
            report.warnings.append(
                f"{connector.name}: is declared for {reached[0]:.4g} ... {reached[1]:.4g} deg; a landing may go to "
                f"{low:g} ... {high:g} deg"
            )


def _judge_variable(name: str, connector: Connector, expected: Unit, report: FitReport) -> None:
    """Type and unit of the variable that is the contract's `name`."""
    if not connector.scalar_number:
        report.problems.append(f"{connector.name}: is of type {connector.kind}; the contract has scalar reals")
        return
    _judge_resolution(name, connector, expected, report)
    if connector.unit is None:
        if not name.endswith(MEASURED):
            report.warnings.append(f"{connector.name}: no unit declared; {expected.name} is assumed")
    elif not connector.unit.same_dimension(expected):
        report.problems.append(
            f"{connector.name}: unit {connector.unit.name} has the dimension {connector.unit.dimension()}, "
            f"expected {expected.dimension()};"
            f' declare it right, or write unit = "..." in a mapping file'
        )
