"""Does a device's description carry the contract's names, with scalar reals and units of the right dimension?"""

from __future__ import annotations

import difflib
from collections.abc import Mapping

from ..contract import AXES, INPUTS, OUTPUTS, plain, profile
from ..errors import InputError
from ..fmu.component import Component
from ..fmu.element import Connector
from ..units import Unit, unit
from .fit import FitReport
from .proposal import could_be, propose

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
                _judge_variable(have[plain(name)], expected, report)
    known = {plain(name) for name in INPUTS}
    extra = [n for n in component.inputs if plain(n) not in known and n not in component.constants]
    if extra:
        report.notes.append(
            "inputs outside the contract keep their start values: "
            f"{', '.join(extra[:SHOWN])}{' ...' if len(extra) > SHOWN else ''}"
        )
    return axes


def contradicting_units(component: Component, mapped: Mapping[str, bool]) -> list[str]:
    """Variables that the contract uses whose unit has a factor that its name does not have, such as N.mm with factor 1:
    one line each. `component` as the FMU describes it; `mapped` {variable: whether the mapping file states its
    unit}."""
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


def _judge_duplicates(component: Component, report: FitReport) -> None:
    for causality, known in (("input", INPUTS), ("output", OUTPUTS)):
        for name in known:
            same = [n for n in component.select(causality) if plain(n) == plain(name)]
            if len(same) > 1:
                report.problems.append(
                    f"{' and '.join(same)} both read as {name}, since ., _ and letter case do not count; rename one"
                )


def _judge_missing_torque(component: Component, report: FitReport) -> None:
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


def _judge_variable(connector: Connector, expected: Unit, report: FitReport) -> None:
    if not connector.scalar_number:
        report.problems.append(f"{connector.name}: is of type {connector.kind}; the contract has scalar reals")
    elif connector.unit is None:
        report.warnings.append(f"{connector.name}: no unit declared; {expected.name} is assumed")
    elif not connector.unit.same_dimension(expected):
        report.problems.append(
            f"{connector.name}: unit {connector.unit.name} has the dimension {connector.unit.dimension()}, "
            f"expected {expected.dimension()};"
            f' declare it right, or write unit = "..." in a mapping file'
        )
