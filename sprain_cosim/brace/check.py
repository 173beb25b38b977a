"""Does a device FMU fit the contract? Five stages in order, nothing native loaded before archive and description pass:

1 archive, 2 description (both raise InputError: not a usable FMU) - 3 names, causality, units (names.py) - 4 dynamics
and 5 physics, measured by probe.py in a child process under a time limit and judged by judge.py."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

from ..contract import INPUTS, plain
from ..errors import InputError, SprainError, nearest, without_name
from ..fmu import archive, cache
from ..fmu.component import Component
from ..fmu.confine import confinement
from ..fmu.driver import own_step
from ..machine.here import SYSTEM
from ..mapping import carried, load_mapping, parse
from ..process import Child, Limits, ProcessEnded
from ..sandbox.confinement import Confinement
from ..sandbox.kernel import offered
from ..sandbox.watch import Watch
from .conduct import note_conduct, note_messages
from .fit import FitReport
from .judge import Measured, judge_dynamics, judge_landing, judge_physics, judge_steps
from .names import clocks, contract_axes, contradicting_units, undeclared
from .probe import BEGINS, FREED, FREEING
from .proposal import propose
from .readings import readings_of_mapping, readings_of_names
from .reference import compare_references

AXES_DRAWN = "what is positive about each axis: docs/figures/axes.png, shown in docs/brace-contract.md, Axes and signs"
START_LIMIT, PROBE_LIMIT = 60.0, 6.0  # s; a slow device has the time of its calls on top, LONGEST at most
LONGEST = 900.0  # s
UNCHANGED = 1e-9  # relative: torques that differ by less have not changed
NO_TICKS = "no run ticks clocks; export it with a sampling of its own, as a fixed step"
MEMORY = 8 << 30  # bytes


def check_brace(
    fmu: Path | str,
    mapping: Path | str | None = None,
    settings: Mapping[str, float | str | bool] | None = None,
    say: Say | None = None,
) -> FitReport:
    """Judges the device in `fmu`, seen through the file `mapping` or the mapping that the FMU carries.

    - settings: {parameter, or input that nothing feeds: value, such as "48 V"}; they hold in all measurements
    - say: takes a line of progress, where the device is slow

    Raises InputError when it is not a usable FMU (archive, description, library, or it cannot be instantiated even
    once), and for settings that it does not take.

    >>> import sprain_cosim as sc
    >>> report = sc.check_brace("my_brace.fmu", settings={"angle_scale": 1.5})
    >>> report.fits, report.profile
    (True, 'bushing')
    """
    settings = dict(settings or {})
    component = _with_settings(Component.read("brace", fmu), settings)
    checked = archive.read(component.fmu)
    archive.verify(checked)
    unusable = component.library_problem()
    if unusable:
        raise InputError(f"{fmu}: {unusable}")
    inside = carried(component)
    found = load_mapping(mapping) if mapping is not None else inside
    unusable = (component if found is None else replace(component, allowed=found.allowed)).tool_problem()
    if unusable:
        raise InputError(f"{fmu}: {unusable}")
    report = FitReport(str(fmu), component.capabilities.interface, component.capabilities.tool)
    report.sha256 = component.sha256
    _note_description(component, report)
    if inside is not None and mapping is not None:
        report.notes.append(f"the mapping inside the FMU is not used, but {mapping} in its place")
    report.problems += contradicting_units(component, found)
    if found is not None and found.unstated(component):
        report.mapping = found.source
        report.problems.append(readings_of_mapping(component, found).question())
        compare_references(component, report)
        report.next_step = _next_step(report, fmu, mapping, settings)
        return report
    described = component
    if found is not None:
        component, report.mapping = found.apply(component), found.source
        component = replace(component, constants={**component.constants, **settings})
    _refuse_fed(component, settings)
    if component.constants:
        held = ", ".join(f"{name} = {value}" for name, value in component.constants.items())
        report.notes.append(f"measured with {held}")
    axes = contract_axes(component, report)
    if report.proposal:
        report.notes.append(AXES_DRAWN)
        _read_as_proposed(component, report)
    _judge_undeclared(component, report)
    if report.fits:
        cache.unpacked(component.fmu, component.sha256)
        try:
            _judge_behaviour(component, axes, found is not None and found.active, report, say)
        except InputError:
            cache.forget(component.sha256)
            raise
    compare_references(replace(described, capabilities=component.capabilities, allowed=component.allowed), report)
    report.next_step = _next_step(report, fmu, mapping, settings)
    return report


def _judge_undeclared(component: Component, report: FitReport) -> None:
    """The contract's own names without units: in SI, unless no brace is so."""
    names = undeclared(component)
    if not names:
        return
    report.facts["undeclared_units"] = list(names)
    readings = readings_of_names(component) if report.fits else None
    if readings is None:
        report.warnings.append(f"no unit is declared for {', '.join(names)}; the contract's SI units are assumed")
    elif readings.refused:
        report.problems.append(readings.refusal())
        report.proposal = report.proposal or ("" if report.mapping else propose(component))
    else:
        report.warnings.append(readings.assumption())


def _read_as_proposed(component: Component, report: FitReport) -> None:
    """A note on what the units would mean that the proposed mapping leaves open."""
    with contextlib.suppress(InputError):
        proposed = parse(report.proposal, "proposal")
        if proposed.unstated(component) and proposed.inputs and proposed.outputs:
            report.notes.append(f"with the names as proposed: {readings_of_mapping(component, proposed).question()}")


def _note_description(component: Component, report: FitReport) -> None:
    """Notes about what the description says of processes and clocks, and about its faults."""
    report.notes += [f"its description breaks the rules of FMI where nothing here looks: {q}" for q in component.quirks]
    if component.needs_tool:
        report.warnings.append(f"needs its authoring tool ({component.needs_tool}) wherever it runs")
    unread = [n for c in ("input", "output") for n, v in component.select(c).items() if v.kind == "binary"]
    if unread:
        report.notes.append(
            f"has binary variables ({', '.join(unread[:4])}{' ...' * (len(unread) > 4)}), which no run uses"
        )
    if component.capabilities.shared_modules:
        report.notes.append("its Python modules could clash with another FMU's: a run gives it a process of its own")
    warnings, notes = clocks(component)
    report.warnings += warnings
    report.notes += notes
    if component.capabilities.single:
        report.notes.append("allows one instance per process: two of them in one run need --isolate")


def _refuse_fed(component: Component, settings: Mapping[str, float | str | bool]) -> None:
    """Raises InputError for a setting of an input that the plant feeds: by the contract's name, or through the map."""
    signals = {plain(name) for name in INPUTS}
    fed = [name for name in settings if name in component.inputs and plain(name) in signals]
    mapped = [name for name in settings if name not in component.connectors]
    for name in (*fed, *mapped):
        raise InputError(f"--set {name}: the plant feeds it; a value holds only where nothing does")


def _with_settings(component: Component, settings: Mapping[str, float | str | bool]) -> Component:
    """The component with these values. Raises InputError for a name or a value that it does not have or take."""
    for name, value in settings.items():
        connector = component.connectors.get(name)
        if connector is None:
            hint = nearest(name, {**component.parameters, **component.inputs})
            raise InputError(f"--set {name}: {component.fmu.name} has no such variable{hint}")
        if connector.causality not in ("parameter", "input"):
            raise InputError(f"--set {name}: is of causality {connector.causality}, not a parameter")
        connector.value(value, f"--set {name}")
    return replace(component, constants={**component.constants, **settings})


def _judge_clocks(component: Component, axes: tuple[str, ...], measured: Measured, report: FitReport) -> None:
    """What changes only when an input clock ticks never changes in a run: by the description, else by what was
    measured."""
    ticking = [name for name, c in component.inputs.items() if c.kind == "clock" and c.interval is None]
    if not ticking:
        return
    torques = {plain(f"{axis}_torque") for axis in axes}
    outputs = [c for c in component.outputs.values() if plain(c.name) in torques]
    named = {c.name: c.clocks for c in outputs if c.clocks and set(c.clocks) <= set(ticking)}
    static = measured["static"]
    held = [pair[1:] for pairs in static["torque"].values() for pair in pairs]
    seen = [*static["rest"], *(torque for pair in held for torque in pair)]
    for name, own in named.items():
        report.problems.append(f"{name} changes only when its clock ({', '.join(own)}) ticks, and {NO_TICKS}")
    if not named and max(seen) - min(seen) <= UNCHANGED * max(map(abs, seen)):
        report.problems.append(
            f"its torque never changed, it has input clocks ({', '.join(ticking[:4])}) that may trigger its law, and "
            f"{NO_TICKS}"
        )


def _next_step(
    report: FitReport,
    fmu: Path | str,
    mapping: Path | str | None,
    settings: Mapping[str, float | str | bool],
) -> str:
    options = set_options(settings)
    if report.proposal:
        other = f"; or {report.next_step}" if report.next_step else ""
        return f"review the mapping file, then sprain-cosim check {SYSTEM.quoted(str(fmu))} --map FILE{options}{other}"
    if report.fits:
        mapped = f" --map {SYSTEM.quoted(f'brace={mapping}')}" if mapping is not None else ""
        options = set_options({f"brace.{name}": value for name, value in settings.items()})
        return f"sprain-cosim run incline30 --fmu {SYSTEM.quoted(f'brace={fmu}')}{mapped}{options}"
    mapped = f" --map {SYSTEM.quoted(str(mapping))}" if mapping is not None else ""
    return report.next_step or f"correct it, then sprain-cosim check {SYSTEM.quoted(str(fmu))}{mapped}{options}"


def set_options(settings: Mapping[str, float | str | bool]) -> str:
    """As they are typed, with a space before each."""
    return "".join(f" --set {SYSTEM.quoted(f'{name}={value}')}" for name, value in settings.items())


DOING = {  # by probe, in the order in which they run; a reset that nothing uses comes last
    "pace": "in its first steps",
    "steps": "trying communication steps",
    "start": "instantiated twice and started",
    "repeat": "two landings in a row, each with a fresh instance",
    "state": "saving and restoring its state in a landing",
    "finite": "over the physiological range at up to 1000 deg/s",
    "recorded": "through a recorded landing",
    "closed_landing": "through a recorded landing from zero and back to zero",
    "static": "held at angles",
    "moving": "passed through zero at 200 and 1000 deg/s",
    "cycle": "in closed cycles of +-15 deg, and as far and fast as a landing",
    "reset": "two landings in a row, reset between",
}
Say = Callable[[str], None]


def _judge_behaviour(
    component: Component, axes: tuple[str, ...], active: bool, report: FitReport, say: Say | None
) -> None:
    sandbox = confinement([component])
    with Watch(sandbox or Confinement((), ""), mark=BEGINS) as watch:
        child = Child(
            "sprain_cosim.brace.probe", Limits(memory=MEMORY), watch if sandbox and offered().seccomp else None
        )
        changed: list[str] = []
        said = None
        try:
            try:
                placed = replace(component, fmu=component.fmu.absolute())
                child.open((placed, axes), START_LIMIT, sandbox)
            except ProcessEnded as end:
                raise InputError(f"{component.fmu}: {_where(child)}: {end}{_words(child)}") from None
            except SprainError as problem:
                raise InputError(
                    f"{component.fmu}: cannot be instantiated: {without_name(component.name, problem)}"
                ) from None
            measured, step = _measure(child, component, len(axes), report, say)
            with contextlib.suppress(ProcessEnded, SprainError):
                changed = child.call("conduct", limit=PROBE_LIMIT)
                said = child.call("messages", limit=PROBE_LIMIT)
        finally:
            child.close()
        note_conduct(watch.attempts, changed, report)
        note_messages(said, report)
    if not report.fits:
        return
    judge_dynamics(measured, report)
    _judge_clocks(component, axes, measured, report)
    for k, axis in enumerate(axes):
        judge_physics(axis, k, measured, step, active, report)
    judge_landing(measured, axes, step, active, report)


def _is_freed(child: Child) -> bool:
    """Whether the process ended while the device was freed: the probes say when they begin with that."""
    return [line for line in child.log().splitlines() if line in (FREEING, FREED)][-1:] == [FREEING]


def _where(child: Child) -> str:
    return "crashes while it is freed" if _is_freed(child) else "cannot be instantiated"


def _words(child: Child) -> str:
    """The device's last words, without those of the probes."""
    printed = [line for line in child.log().splitlines() if line not in (FREEING, FREED)]
    return f"; it said: {printed[-1].strip()}" if printed else ""


def _measure(
    child: Child, component: Component, axes: int, report: FitReport, say: Say | None
) -> tuple[Measured, float]:
    """The results of all probes and the step [s] they ran with; a probe that ends the check leaves a problem in
    `report`."""
    measured: Measured = {}
    step = own_step(component)
    order = list(DOING)
    if component.capabilities.reusable:  # all later ones use it
        order.remove("reset")
        order.insert(order.index("start") + 1, "reset")
    for probe in order:
        if probe == "state" and not component.capabilities.state:
            continue
        needs = _time_needed(measured.get("pace", {}), axes, step)
        if say is not None and needs > PROBE_LIMIT:
            say(f"{DOING[probe]}, up to {needs:.0f} s ...")
        try:
            measured[probe] = child.call("run", probe, step, limit=min(PROBE_LIMIT + 2 * needs, LONGEST))
        except ProcessEnded as end:
            freed = ", while it was freed" if _is_freed(child) else ""
            _report_failure(probe, f"the device {end}{freed}{_words(child)}", component, report)
        except SprainError as problem:
            _report_failure(probe, without_name(component.name, problem), component, report)
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


def _time_needed(pace: dict[str, float], axes: int, step: float) -> float:
    """Time [s] that any probe needs at most of a device with this `pace`: a second of its own time about every axis."""
    calls, starts = axes * (1.0 / step + 200), 20 * axes
    return calls * pace.get("call", 0.0) + starts * pace.get("start", 0.0)


def _report_failure(probe: str, failure: str, component: Component, report: FitReport) -> None:
    if probe != "reset":
        report.problems.append(f"{DOING[probe]}: {failure}")
    elif component.capabilities.reusable:
        report.problems.append(
            f"{DOING[probe]}: {failure}; a study would use it, since reset = true says so; take that line out of the "
            "mapping file"
        )
    else:
        report.notes.append(f"its reset fails ({failure}); no run uses it, every run takes a fresh instance")
