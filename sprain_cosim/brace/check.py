"""Does a device FMU fit the contract? Five stages in order, nothing native loaded before archive and description pass:

1 archive, 2 description (both raise InputError: not a usable FMU) - 3 names, causality, units (names.py) - 4 dynamics
and 5 physics, measured by probe.py in a child process under a time limit and judged by judge.py."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from shlex import quote

from ..errors import InputError, SprainError
from ..fmu import archive, cache
from ..fmu.component import Component
from ..fmu.confine import confinement
from ..mapping import carried, load_mapping
from ..process import Child, Limits, ProcessEnded
from .fit import FitReport
from .judge import Measured, judge_dynamics, judge_landing, judge_physics, judge_steps
from .names import contract_axes, contradicting_units
from .probe import own_step
from .readings import both_readings

START_LIMIT, PROBE_LIMIT = 60.0, 6.0  # s
MEMORY = 8 << 30  # bytes


def check_brace(fmu: Path | str, mapping: Path | str | None = None) -> FitReport:
    """Judges the device in `fmu`, seen through the file `mapping` or the mapping that the FMU carries.

    Raises InputError when it is not a usable FMU: archive, description, library, or it cannot be instantiated even
    once."""
    component = Component.read("brace", fmu)
    checked = archive.read(component.fmu)
    archive.verify(checked)
    unusable = component.library_problem()
    if unusable:
        raise InputError(f"{fmu}: {unusable}")
    inside = carried(component)
    found = load_mapping(mapping) if mapping is not None else inside
    report = FitReport(str(fmu), component.capabilities.interface, component.capabilities.tool)
    if component.capabilities.shared_modules:
        report.notes.append("its Python modules could clash with another FMU's: a run gives it a process of its own")
    _name_clocks(component, report)
    if component.capabilities.single:
        report.notes.append("allows one instance per process: two of them in one run need --isolate")
    if inside is not None and mapping is not None:
        report.notes.append(f"the mapping inside the FMU is not used, but {mapping} in its place")
    signals = () if found is None else (*found.inputs.values(), *found.outputs.values())
    report.problems += contradicting_units(component, {s.variable: s.unit is not None for s in signals})
    if found is not None and found.open_units:
        report.mapping = found.source
        report.problems.append(both_readings(component, found))
        report.next_step = _next_step(report, fmu, mapping)
        return report
    if found is not None:
        component, report.mapping = found.apply(component), found.source
    axes = contract_axes(component, report)
    if report.fits:
        cache.unpacked(component.fmu, component.sha256)
        try:
            _judge_behaviour(component, axes, found is not None and found.active, report)
        except InputError:
            cache.forget(component.sha256)
            raise
    report.next_step = _next_step(report, fmu, mapping)
    return report


def _name_clocks(component: Component, report: FitReport) -> None:
    """No run ticks an input clock, none reads an output clock."""
    for causality in ("input", "output"):
        clocks = [name for name, c in component.select(causality).items() if c.kind == "clock"]
        few = f"{', '.join(clocks[:4])}{' ...' if len(clocks) > 4 else ''}"
        if clocks and causality == "input":
            report.warnings.append(
                f"has input clocks ({few}), which no run ticks: what they trigger does not happen; export it with a "
                "sampling of its own, as a fixed step"
            )
        elif clocks:
            report.notes.append(f"has output clocks ({few}), which no run reads")


def _next_step(report: FitReport, fmu: Path | str, mapping: Path | str | None) -> str:
    if report.proposal:
        other = f"; or {report.next_step}" if report.next_step else ""
        return f"review the mapping file, then sprain-cosim check {quote(str(fmu))} --map FILE{other}"
    if report.fits:
        mapped = f" --map {quote(f'brace={mapping}')}" if mapping is not None else ""
        return f"sprain-cosim run incline30 --fmu {quote(f'brace={fmu}')}{mapped}"
    mapped = f" --map {quote(str(mapping))}" if mapping is not None else ""
    return report.next_step or f"correct it, then sprain-cosim check {quote(str(fmu))}{mapped}"


DOING = {  # by probe, in the order in which they run
    "steps": "trying communication steps",
    "start": "instantiated twice and started",
    "reset": "two landings in a row, reset between",
    "repeat": "two landings in a row, each with a fresh instance",
    "state": "saving and restoring its state in a landing",
    "finite": "over the physiological range at up to 1000 deg/s",
    "recorded": "through a recorded landing",
    "static": "held at angles",
    "moving": "passed through zero at 200 deg/s",
    "cycle": "in closed cycles of +-15 deg",
}


def _judge_behaviour(component: Component, axes: tuple[str, ...], active: bool, report: FitReport) -> None:
    child = Child("sprain_cosim.brace.probe", Limits(memory=MEMORY))
    try:
        try:
            placed = replace(component, fmu=component.fmu.absolute())
            child.open((placed, axes), START_LIMIT, confinement([component]))
        except ProcessEnded as end:
            raise InputError(f"{component.fmu}: cannot be instantiated: {end}{child.last_words()}") from None
        except SprainError as problem:
            raise InputError(f"{component.fmu}: cannot be instantiated: {problem}") from None
        measured, step = _measure(child, component, report)
    finally:
        child.close()
    if not report.fits:
        return
    judge_dynamics(measured, report)
    for k, axis in enumerate(axes):
        judge_physics(axis, k, measured, step, active, report)
    judge_landing(measured, axes, report)


def _measure(child: Child, component: Component, report: FitReport) -> tuple[Measured, float]:
    """The results of all probes and the step [s] they ran with; a probe that ends the check leaves a problem in
    `report`."""
    measured: Measured = {}
    step = own_step(component)
    for probe, doing in DOING.items():
        if probe == "state" and not component.capabilities.state:
            continue
        try:
            measured[probe] = child.call("run", probe, step, limit=PROBE_LIMIT)
        except ProcessEnded as end:
            report.problems.append(f"{doing}: the device {end}{child.last_words()}")
        except SprainError as problem:
            report.problems.append(f"{doing}: {str(problem).removeprefix('brace: ')}")
        else:
            if probe == "steps":
                step = judge_steps(measured[probe]["taken"], step, component.capabilities, report)
            elif probe == "reset" and component.capabilities.reusable and not measured[probe]["equal"]:
                report.problems.append(
                    "its reset does not give a fresh instance, though reset = true says so; take that line out of the "
                    "mapping file"
                )
        if not report.fits:
            break
    return measured, step
