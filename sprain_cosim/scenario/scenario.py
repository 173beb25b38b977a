"""A landing, described: components, connections, parameters with units, master; and a session that runs it."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from ..contract import PLANT
from ..cosim.assembly import Assembly
from ..cosim.coupling import check_scheme
from ..cosim.layout import conversion
from ..cosim.master import Master
from ..cosim.result import HALVED_WITHIN, PEAK, Result, unconverged
from ..cosim.system import System, coupled
from ..errors import InputError, SimulationError, nearest, problems_to_error
from ..fmu.component import Component
from ..fmu.element import Element
from ..fmu.foreign import is_foreign
from ..mapping import carried, read_component
from ..metrics import doubtful_peaks
from ..notebook import Card, Rows
from ..shipped import fmu_path, is_package
from ..subject.person import Subject
from ..units import plain_number, proportion, seconds, stated
from .body import (
    OWNER,
    is_of_subject,
    of_person,
    plant_values,
    pose_problem,
    subject_connectors,
    with_measures,
    without_person,
)
from .isolation import Isolation, isolation
from .title import Ran, heading
from .wiring import Wiring

if TYPE_CHECKING:
    import pandas as pd

    from ..process import Limits
    from ..sandbox.confinement import Confinement
    from ..ssp.flat import Flat
    from .apart import Apart

TRIED = {  # SI
    "plant.drop_height": (0.0, 0.8, "0 to 0.8 m"),
    "plant.platform_incline": (math.radians(-15.0), math.radians(45.0), "-15 to 45 deg"),
}
ROLES = ("plant", "controller", "brace")
ADAPTIVE = 1e-3

Value = float | int | str | bool


@dataclass(frozen=True, repr=False)
class Scenario(Card):
    """A landing, described.

    title        of the file; empty for none. What people read is `heading`
    fmus         {component: FMU file}, in stepping order
    parameters   {"component.parameter": value}, as in the file
    connections  {"component.input": "component.output"}, as in the file
    master       how the components are stepped
    source       the file, or the name of one that ships
    warnings     one line each
    dropped      parameters that the FMU put in a component's place does not have
    maps         {component: mapping file}
    isolate      components that run in a process of their own; those whose modules could clash always do
    in_process   foreign FMUs run without a sandbox, in `open` and `run` in this very process
    changes      what was changed since the file was read, such as "plant.drop_height = 0.35 m"
    subject      who lands; None: the person with whom the plant was made
    wiring       of a system that others described; None: connections are as the files and the contract say

    >>> import sprain_cosim as sc
    >>> braced = sc.load_scenario("incline30_brace").with_parameters(brace={"angle_scale": 1.5})
    >>> braced.heading
    '30° slope, 150 % brace, ankle muscles off'
    >>> braced.parameter_table.loc["plant.drop_height", ["unit", "maximum", "value"]].tolist()
    ['m', 5.0, '0.30 m']
    >>> with braced.open() as session:  # the FMUs stay open
    ...     low, high = (session.run({"plant.drop_height": height}) for height in (0.2, "40 cm"))  # SI, or a unit
    >>> high.metrics["peak_subtalar_angle_deg"] > low.metrics["peak_subtalar_angle_deg"]
    True
    """

    title: str
    fmus: Mapping[str, Path]
    parameters: Mapping[str, Value]
    connections: Mapping[str, str]
    master: Master
    source: str
    warnings: tuple[str, ...] = ()
    dropped: tuple[str, ...] = ()
    maps: Mapping[str, Path] = field(default_factory=dict)
    isolate: tuple[str, ...] = ()
    in_process: bool = False
    changes: tuple[str, ...] = ()
    subject: Subject | None = None
    wiring: Wiring | None = None

    @property
    def heading(self) -> str:
        """The heading of tables and figures: true for what runs, see `title`."""
        return self.heading_with({})

    def card(self) -> tuple[str, Rows]:
        master, parts = self.master, ", ".join(f"{name} {path.stem}" for name, path in self.fmus.items())
        rows = [("components", parts), *((n, str(value)) for n, value in self.parameters.items())]
        rows += [("lands", self.subject.words)] if self.subject else []
        rows += [(f"warning {k}", text) for k, text in enumerate(self.warnings, 1)]
        step = f"{1e3 * master.communication_step:g} ms, {master.scheme}, until {1e3 * master.stop:g} ms"
        return self.heading, [*rows, ("step", step)]

    @property
    def heading_of_braces(self) -> str:
        """That of a comparison of braces on it."""
        return self.heading_with({}, compared=True)

    def heading_with(
        self,
        means: Mapping[str, Value],
        varied: Collection[str] = (),
        own: str | None = None,
        person: str = "",
        compared: bool = False,
    ) -> str:
        """The heading of a study of this scenario: parameters at their `means`, those `varied` over several values,
        under the study's `own` title (None: the scenario's); `person`: who lands, in place of the scenario's subject;
        `compared`: with several braces."""
        person = person or (self.subject.words if self.subject else "")
        ran = Ran(self.fmus, {**self.parameters, **means}, self._start, varied, person, compared)
        description, named = ran.described()
        return heading(self.title if own is None else own, description or Path(self.source).stem, self.changes, named)

    def _start(self, name: str) -> str | float | None:
        """The start value of a parameter with its unit; None where there is none, or the FMU cannot be read."""
        owner, _, parameter = name.partition(".")
        if owner not in self.fmus:
            return None
        try:
            component = read_component(owner, self.fmus[owner], self.maps.get(owner))
        except InputError:
            return None
        connector = component.connectors.get(parameter)
        if connector is None or connector.start is None:
            return None
        return connector.start if connector.unit is None else f"{connector.start!r} {connector.unit.name}"

    def noted(self, change: str) -> Self:
        """The same scenario with a change of its description listed: what the heading must say of it. A later value of
        a parameter replaces an earlier one."""
        name, equals, _ = change.partition(" = ")
        kept = [c for c in self.changes if c.partition(" = ")[0] != name] if equals else list(self.changes)
        return replace(self, changes=(*kept, change))

    def override(self, parameter: str, value: Value) -> Self:
        """The same scenario with another value, as files have it: a quantity with a dimension is a text with its unit.
        Raises InputError when it has no such parameter or the value does not fit."""
        value = plain_number(value)
        if is_of_subject(parameter):
            if self.subject is None:
                raise InputError(f"{parameter}: nobody is described; name a person with --subject or in [subject]")
            number = self._described().find(parameter).value(value, parameter)
            return self.with_subject(with_measures(self.subject, {parameter: number}))
        changed = replace(self, parameters={**self.parameters, parameter: value})
        connector = changed._described().settable(parameter)
        number, before = connector.value(value, parameter), connector.start
        if parameter in self.parameters:
            try:
                before = connector.value(self.parameters[parameter], parameter)
            except InputError:  # a value that is mended here
                before = None
        return changed if number == before else changed.noted(f"{parameter} = {value}")

    def with_parameters(
        self, values: Mapping[str, float | str] | None = None, /, **of_component: Mapping[str, float | str]
    ) -> Self:
        """The same scenario with other values, {"component.parameter": value} or by component:
        `with_parameters(plant={"drop_height": "35 cm"}, brace={"angle_scale": 1.5})`. A text has its unit; a number is
        in the parameter's own, which `parameter_table` names. Raises InputError."""
        changed = self
        for name, value in self.in_words(values, of_component).items():
            changed = changed.override(name, value)
        return changed

    @property
    def parameter_table(self) -> pd.DataFrame:
        """All that may be set, a row for each "component.parameter": its `unit`, in which are `minimum`, `maximum` and
        `default`; the scenario's `value`, as it was written; `meaning`; the `choices` of an enumeration; `kind`;
        `input`, whether it is an input that nothing feeds, and no parameter."""
        from .settable import settable_table, settables

        return settable_table(settables(self.system(), self.values()))

    def in_words(
        self, values: Mapping[str, float | str] | None, of_component: Mapping[str, Mapping[str, float | str]]
    ) -> dict[str, Value]:
        """{"component.parameter": value as a file has it} of what `with_parameters` takes. Raises InputError."""
        system, several = self._described(), dict(values or {})
        for name, own in of_component.items():
            if not isinstance(own, Mapping):
                raise InputError(f'{name} = {own!r}: expected the parameters of {name}, such as {{"parameter": value}}')
            several |= {f"{name}.{parameter}": value for parameter, value in own.items()}
        return {name: stated(value, system.settable(name).unit) for name, value in several.items()}

    def with_subject(self, subject: Subject | str) -> Self:
        """The same landing of another person, such as "female, 1.63 m, 62 kg". Raises InputError."""
        from ..subject.words import parse_subject

        person = parse_subject(subject) if isinstance(subject, str) else subject.checked("subject")
        return self.landing(person).noted(f"subject = {person.words}")

    def landing(self, person: Subject, kept: Collection[str] = ()) -> Self:
        """The same landing of another person, in the place of what its parameters say of one, with a warning; `kept`:
        those that hold for this person too. Raises InputError."""
        parameters, gone = without_person(self.parameters, person, kept)
        changed = replace(self, subject=person, parameters=parameters)
        changed.system()
        unusual = tuple(line for line in self.warnings if self.subject is None or line not in self.subject.warnings)
        return replace(changed, warnings=(*unusual, *person.warnings, *gone))

    def replace_fmu(self, name: str, fmu: Path | str, mapping: Path | str | None = None) -> Self:
        """Another device under a component's name, or one more: its connections are made anew from its contract
        profile, its names taken through the `mapping` file; parameters of this scenario that it lacks are dropped, with
        one warning."""
        if name not in self.fmus and name not in ROLES:
            raise InputError(f"component {name!r} is not in {self.source}{nearest(name, [*self.fmus, *ROLES])}")
        if is_package(fmu):
            if mapping is not None:
                raise InputError(
                    f"{name} = {fmu}: a mapping file belongs to one FMU; a package has its own connections"
                )
            from ..ssp.flat import flattened

            return self.with_device(name, flattened(Path(fmu)))
        path = fmu_path(str(fmu), Path.cwd(), f"{name} = {fmu}")
        maps = {k: v for k, v in self.maps.items() if k != name} | (
            {name: Path(mapping)} if mapping is not None else {}
        )
        component = read_component(name, path, maps.get(name))
        known = component.parameters | component.inputs
        lost = tuple(k for k in self.parameters if k.startswith(f"{name}.") and k.partition(".")[2] not in known)
        warning = (
            (
                f"{name}: {path.name} has no {', '.join(k.partition('.')[2] for k in lost)}; the scenario's value is "
                "dropped",
            )
            if lost
            else ()
        )
        return replace(
            self.noted(f"{name} = {path.name}"),
            fmus={**self.fmus, name: path},
            maps=maps,
            parameters={k: v for k, v in self.parameters.items() if k not in lost},
            connections={
                t: s for t, s in self.connections.items() if name not in (t.partition(".")[0], s.partition(".")[0])
            },
            warnings=self.warnings + warning,
            dropped=self.dropped + lost,
            wiring=None if self.wiring is None else self.wiring.without([name]),
        )

    def with_device(self, name: str, flat: Flat) -> Self:
        """A device of several FMUs, from a package, in a component's place. Raises InputError."""
        from .package import device

        bare = self.without(name)
        plant = next((c for c in bare.components() if c.name == PLANT), None)
        if plant is None:
            raise InputError(f"{self.source}: has no {PLANT} that {flat.path} could be connected to")
        found = device(flat, name, plant)
        before = self.wiring or Wiring()
        return replace(
            bare,
            changes=self.noted(f"{name} = {flat.path.name}").changes,
            fmus={**bare.fmus, **found.fmus},
            maps={**bare.maps, **found.maps},
            parameters={**bare.parameters, **found.parameters},
            connections={**bare.connections, **found.connections},
            warnings=self.warnings + found.notes,
            wiring=before.without([name]).joined(found.wiring),
        )

    def without(self, name: str) -> Self:
        """The same scenario without a component: its parameters and connections go with it. Itself where there is none
        of that name."""
        if name not in self.fmus:
            return self
        return replace(
            self.noted(f"{name} = none"),
            fmus={k: v for k, v in self.fmus.items() if k != name},
            maps={k: v for k, v in self.maps.items() if k != name},
            parameters={k: v for k, v in self.parameters.items() if not k.startswith(f"{name}.")},
            connections={
                t: s for t, s in self.connections.items() if name not in (t.partition(".")[0], s.partition(".")[0])
            },
            wiring=None if self.wiring is None else self.wiring.without([name]),
        )

    def with_master(
        self,
        scheme: str | None = None,
        communication_step: float | str | None = None,
        stop: float | str | None = None,
        identify: int | None = None,
        adaptive: float | str | None = None,
    ) -> Self:
        """Other settings of the master; times as "0.5 ms", or in seconds. Raises InputError."""
        master = self.master if identify is None else replace(self.master, identify=identify)
        if adaptive is not None:
            master = replace(master, adaptive=share(adaptive, "adaptive"))
        if scheme is not None:
            check_scheme(scheme)
            master = replace(master, scheme=scheme)
        if communication_step is not None:
            master = replace(master, communication_step=seconds(communication_step, "communication step"))
        if stop is not None:
            master = replace(master, stop=seconds(stop, "stop"))
        return replace(self, master=master)

    def isolated(self, *names: str) -> Self:
        """The same with these components (default: all) in a process of their own: a crash or a hang then ends the run,
        not this process."""
        return replace(self, isolate=names or tuple(self.fmus))

    def unconfined(self) -> Self:
        """The same without a sandbox: `open` and `run` load foreign FMUs into this very process."""
        return replace(self, in_process=True)

    def absolute(self) -> Self:
        """The same with its files by their full paths: for a process that stands in another folder."""
        fmus, maps = ({name: path.absolute() for name, path in d.items()} for d in (self.fmus, self.maps))
        return replace(self, fmus=fmus, maps=maps)

    def recording(self, *patterns: str) -> Self:
        """The same, with these local variables of its FMUs in the result besides inputs and outputs: `plant.*`,
        `plant.*_fibre_length`. A pattern that nothing matches is refused when it runs."""
        return replace(self, master=replace(self.master, record=patterns))

    def values_of_set(self, name: str, chosen: str) -> dict[str, Value]:
        """{"component.parameter": value} of a parameter set that a component's FMU carries. Raises InputError."""
        from .package import parameter_set_values

        if name not in self.fmus:
            raise InputError(f"{name}=@{chosen}: no component {name!r}{nearest(name, self.fmus)}")
        component = read_component(name, self.fmus[name], self.maps.get(name))
        return {f"{name}.{n}": value for n, value in parameter_set_values(component, chosen).items()}

    def initial_pose(self) -> str | None:
        """The name of the plant's initial pose; None for a plant that has no such choice."""
        plant = next((c for c in self._described().components if c.name == "plant"), None)
        connector = plant.parameters.get("initial_pose") if plant else None
        if connector is None or not connector.items:
            return None
        pose = self.parameters.get("plant.initial_pose")
        return str(pose) if pose is not None else next(n for n, v in connector.items.items() if v == connector.start)

    def system(self) -> System:
        """The checked system. Raises InputError with all problems in one line."""
        return self._checked(self.components())

    def _checked(self, components: Sequence[Component]) -> System:
        system = self._described(components)
        problems = system.check(self.master.communication_step, self.master.stop - self.master.start)
        values: dict[str, float] = {}
        if self.subject is not None:
            try:
                values = plant_values(self.subject, system)
            except InputError as problem:
                problems.append(str(problem))
        for full, value in {**_constants(system.components), **self.parameters}.items():
            try:
                values[full] = system.settable(full).value(value, full)
            except InputError as problem:
                problems.append(str(problem) if full in str(problem) else f"parameter {problem}")
        problems += filter(None, [pose_problem(system, values)])
        problems_to_error(self.source, _without_repeats(problems))
        return replace(system, parameters=values)

    def components(self) -> tuple[Component, ...]:
        """The FMUs under the contract's names, in the order of the file. Raises InputError with all that cannot be
        read, in one line."""
        components, unreadable = list[Component](), list[str]()
        for name, path in self.fmus.items():
            try:
                component = read_component(name, path, self.maps.get(name))
                components.append(component if self.wiring is None else self.wiring.applied(component))
            except InputError as problem:
                unreadable.append(f"components.{name}: {problem}")
        problems_to_error(self.source, unreadable)
        apart = {c.name for c in components if c.name in self.isolate or c.capabilities.shared_modules}
        if any(c.name in apart and is_foreign(c.fmu, c.sha256) for c in components):
            # a process that starts others runs no foreign code: its sandbox would forbid the one or allow the other
            apart |= {c.name for c in components if is_foreign(c.fmu, c.sha256)}
        if not apart:
            return tuple(components)
        from ..fmu.isolated import isolated

        return tuple(isolated(c) if c.name in apart else c for c in components)

    def confinement(self) -> Confinement | None:
        """The sandbox of a process that runs the whole scenario; None where it runs no foreign code itself: all FMUs
        ship, or those that do not have processes of their own; also with `in_process`. Raises InputError,
        EnvironmentProblem."""
        if self.in_process:
            return None
        from ..fmu.confine import confinement

        inside = [component for component in self.components() if not component.own_process]
        return confinement(inside, (*self.fmus.values(), *self.maps.values()))

    def foreign(self) -> tuple[str, ...]:
        """The components that do not ship and share a process with the others. Raises InputError."""
        return _foreign(self.components())

    def isolation(self, of_trials: bool = False) -> Isolation:
        """Where the FMUs run; `of_trials`: those of a study. Raises InputError."""
        return isolation(self.components(), self.in_process, of_trials)

    def values(self) -> dict[str, Value]:
        """{"component.variable": value, as it was written} of all that a run sets: the parameters, what the subject
        makes of them, and what mapping files hold constant. Raises InputError."""
        return {**_constants(self.components()), **self._of_subject(), **self.parameters}

    def _of_subject(self) -> dict[str, Value]:
        """The plant's parameters that follow from the subject, with their units."""
        if self.subject is None:
            return {}
        system, found = self._described(), dict[str, Value]()
        for name, value in plant_values(self.subject, system).items():
            own = system.find(name).unit
            found[name] = value if own is None or own.dimensionless else f"{value!r} {own.name}"
        return found

    def of_persons(self, system: System, values: Mapping[str, float]) -> dict[str, float]:
        """{"component.parameter": value in its own unit} with "subject.NAME" among `values` replaced by what such a
        person makes of the plant; what the scenario itself sets stays. Raises InputError."""
        measures = {name: value for name, value in values.items() if is_of_subject(name)}
        if not measures:
            return dict(values)
        if self.subject is None:
            raise InputError(f"{next(iter(measures))}: the scenario has no subject")
        body = plant_values(with_measures(self.subject, measures), system)
        return {n: v for n, v in body.items() if n not in self.parameters} | {
            n: v for n, v in values.items() if n not in measures
        }

    def with_inputs(self, values: Mapping[str, float], texts: Mapping[str, Value]) -> Self:
        """The same scenario at the inputs of a trial: `values` in their own units, and as they are written."""
        measures = {name: value for name, value in values.items() if is_of_subject(name)}
        subject = None if self.subject is None else with_measures(self.subject, measures)
        others = {name: text for name, text in texts.items() if not is_of_subject(name)}
        return replace(self, subject=subject, parameters={**self.parameters, **others})

    def _described(self, components: Sequence[Component] | None = None) -> System:
        system, problems = self._coupled(self.components() if components is None else components)
        problems_to_error(self.source, problems)
        if self.subject is not None:
            system = replace(system, derived=subject_connectors(self.subject))
        return system if self.wiring is None else self.wiring.linked(system)

    def _coupled(self, components: Sequence[Component]) -> tuple[System, Sequence[str]]:
        return coupled(components, self.connections, () if self.wiring is None else self.wiring.complete)

    def _untried(self) -> list[str]:
        """Values outside those at which landings are known to run, a line each."""
        found = []
        for name, (low, high, words) in TRIED.items():
            if name in self.parameters and not low - 1e-9 <= self.system().parameters[name] <= high + 1e-9:
                found.append(f"{name} = {self.parameters[name]}: landings were only tried from {words}")
        return found

    def without_effect(self, names: Collection[str]) -> list[str]:
        """Of parameters that somebody sets or varies, those that another one makes idle, a line each."""
        found = []
        if "plant.drop_height" in names and "plant.pelvis_vertical_velocity" in self.parameters:
            speed = self.system().parameters["plant.pelvis_vertical_velocity"]
            if speed != 0.0:
                found.append(
                    f"plant.drop_height has no effect: the pelvis falls with {-speed:.3g} m/s, as "
                    'plant.pelvis_vertical_velocity says; set that to "0 m/s" for a drop'
                )
        measures = [name for name in names if is_of_subject(name)]
        if measures and self.subject is not None and (fixed := of_person(self.subject) & self.parameters.keys()):
            found.append(
                f"{', '.join(sorted(fixed))}: set by the scenario, so that {', '.join(measures)} cannot move it"
            )
        if "plant.pelvis_ty_at_contact" in names and (pose := self.initial_pose()) != "given":
            found.append(f"plant.pelvis_ty_at_contact has no effect with plant.initial_pose = {pose}; it needs given")
        return found

    def doubts(self) -> list[str]:
        """What is assumed without being said anywhere, one line each: undeclared units of connected variables, a
        mapping that another replaces, a change that has no effect; and what foreign FMUs may do beyond the sandbox."""
        components = self.components()
        system, _ = self._coupled(components)
        connections, links = system.connections, {} if self.wiring is None else self.wiring.links
        units = {t: (system.find(s).unit, system.find(t).unit) for t, s in connections.items() if t in links}
        said = [target for target, pair in units.items() if links[target] != conversion(*pair)]
        found = self.without_effect([change.partition(" = ")[0] for change in self.changes])
        found += self._untried()
        for component in components:
            ends = {
                end.partition(".")[2]: None
                for pair in connections.items()
                for end in pair
                if end.partition(".")[0] == component.name and pair[0] not in said
            }
            connectors = [component.connectors[n] for n in ends if n in component.connectors]
            silent = [c.name for c in connectors if c.unit is None and c.kind == "real"]
            silent += self._converted(component)
            if silent:
                found.append(
                    f"{component.name}: {component.fmu.name} declares no unit for {', '.join(silent)}; SI is assumed"
                )
            if component.name in self.maps and carried(component) is not None:
                found.append(
                    f"{component.name}: the mapping inside {component.fmu.name} is not used, but "
                    f"{self.maps[component.name]} in its place"
                )
        apart = isolation(components, self.in_process)
        found += [
            f"{name}: may use {', '.join(words)} beyond the sandbox ({self.maps.get(name, 'its mapping')} allows it)"
            for name, words in apart.granted.items()
        ]
        if apart.gaps:
            found.append(f"this machine holds foreign FMUs only in part: {'; '.join(apart.gaps)}")
        return found

    def _converted(self, component: Component) -> list[str]:
        """Inputs without a unit that hold a value which was written with one."""
        values = {**_constants([component]), **self.parameters}
        named = {n: values.get(f"{component.name}.{n}") for n, c in component.inputs.items() if c.unit is None}
        return [n for n, value in named.items() if isinstance(value, str) and component.connectors[n].kind == "real"]

    def open(
        self, in_process: bool = False, limits: Limits | None = None, system: System | None = None
    ) -> Session | Apart:
        """Loads and instantiates the FMUs: in this process where all of them ship (or, with `in_process`, whatever they
        are), else together in one of their own, in a sandbox and within `limits`. `system`: its own, where that has
        been described before. Raises InputError, SimulationError, EnvironmentProblem."""
        if in_process or self.in_process:
            return Session(self, system, limits)
        components = self.components()
        if _foreign(components):
            from .apart import Apart

            return Apart(self, limits)
        return Session(self, system or self._checked(components), limits)

    def coupling_check(self, result: Result) -> dict[str, float]:
        """Change of every metric at half the steps, as in Session.at_half_the_step: how far `result` is from converged.

        Raises SimulationError when that run fails."""
        master = replace(self.master, communication_step=0.5 * self.master.communication_step)
        parameters = {**self.parameters, **_finer_plant(self.system(), {})}
        finer = replace(self, master=master, parameters=parameters).run()
        if finer.status != "completed":
            raise SimulationError(f"at half the communication step: {finer.message}")
        return {key: finer.metrics[key] - value for key, value in result.metrics.items()}

    def run(self, in_process: bool = False, halve: bool = False, limits: Limits | None = None) -> Result:
        """One landing, see `open`; `halve`: and once more at half the communication step, what that changes being the
        result's `halved`, and of a subject also with other measures where they are estimated, what that changes being
        its `estimates_doubt`, where a landing takes no longer than HALVED_WITHIN. Raises InputError before it, never
        during it: a failure is in the result's status and message."""
        with self.open(in_process, limits) as session:
            result = session.run()
            if not halve or result.status != "completed" or result.wall > HALVED_WITHIN:
                return result
            result = self.compared(result, session.at_half_the_step())
            return replace(result, estimates_doubt=self._left_open(session, result))

    def _left_open(self, session: Session | Apart, result: Result) -> float | None:
        """[deg] standard deviation of the peak over the persons who share what is known of the subject, to first order;
        None without estimates, or where it is not known."""
        peak = result.metrics.get(PEAK)
        others = [] if self.subject is None else self.subject.deviations
        if peak is None or not others:
            return None
        changes = []
        for measures in others:
            try:
                other = session.run({f"{OWNER}{name}": value for name, value in measures.items()}).metrics
            except (InputError, SimulationError):  # nobody whom the plant can be
                return None
            if PEAK not in other:
                return None
            changes.append(other[PEAK] - peak)
        return math.hypot(*changes)

    def refused(self, result: Result) -> bool:
        """Whether the plant, being the project's own, would not start with its parameters: a matter of input."""
        begun = result.status != "failed" or len(result.time) > 0
        return not begun and result.message.startswith(f"{PLANT}: ") and PLANT not in (*self.foreign(), *self.isolate)

    def compared(self, result: Result, finer: Mapping[str, float]) -> Result:
        """The result beside the metrics at half its step, with a warning where its coupling has not converged; itself
        where there are none."""
        if not finer:
            return result
        changes = {key: finer[key] - value for key, value in result.metrics.items() if key in finer}
        result = replace(result, halved=changes)
        doubt = unconverged(changes.get(PEAK, 0.0), self.master.communication_step)
        return replace(result, warning="; ".join(text for text in (doubt, result.warning) if text))


class Session:
    """An open scenario: runs it many times with the same instances. Use as a context manager.

    Every run starts from the initial state; two sessions in one process do not disturb each other."""

    def __init__(self, scenario: Scenario, system: System | None = None, limits: Limits | None = None) -> None:
        """`system`: that of the scenario; None: it is described here. `limits` of FMUs with a process of their own."""
        scenario.master.steps  # noqa: B018 - raises for times that do not fit
        self.scenario, self.system = scenario, system or scenario.system()
        parts = self.system.components
        if limits and any(isinstance(c, Component) and c.own_process for c in parts):
            from ..fmu.isolated import Isolated

            limited = (replace(c, limits=limits) if isinstance(c, Isolated) else c for c in parts)
            self.system = replace(self.system, components=tuple(limited))
        self._assembly: Assembly | None = self.system.open()

    def run(self, parameters: Mapping[str, float | str] | None = None, judged: bool = True) -> Result:
        """`parameters` {"component.parameter": a number in the parameter's own unit, or a text such as "35 cm"} on top
        of the scenario's; `judged` as in Master.run. Raises InputError for a value that does not fit: unit, kind or
        range."""
        return self._run(self.scenario.master, parameters, judged)

    def at_half_the_step(self, parameters: Mapping[str, float | str] | None = None) -> dict[str, float]:
        """The metrics of the same run at half the communication step and half the steps that the plant takes by itself;
        empty where that does not run."""
        step = 0.5 * self.scenario.master.communication_step
        finer = replace(self.scenario.master, communication_step=step, record=())
        try:
            values = self.system.in_own_units(parameters or {})
            return self._run(finer, values | _finer_plant(self.system, values), judged=False).metrics
        except (InputError, SimulationError):
            return {}

    def _run(self, master: Master, parameters: Mapping[str, float | str] | None, judged: bool) -> Result:
        values = self.system.in_own_units(parameters or {})
        if self._assembly is None:
            self._assembly = self.system.open()
        own = self.scenario.of_persons(self.system, values)
        result = master.land(self._assembly, {**self.system.parameters, **own}, judged)
        if result.status != "completed":  # an instance that reported an error may only be freed
            self.close()
        elif judged and (more := (*self.system.left_ranges(result), *doubtful_peaks(result, master.stop))):
            result = replace(result, warning="; ".join(text for text in (result.warning, *more) if text))
        return result

    def close(self) -> None:
        if self._assembly is not None:
            self._assembly.close()
            self._assembly = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


TOLERANCE = "plant.tolerance"
OF_HALF_THE_STEP = 0.25  # of the tolerance: the local error that the plant controls is of the second order


def _finer_plant(system: System, values: Mapping[str, float]) -> dict[str, float]:
    """{parameter: value} with which a plant that controls its own steps halves them; `values`, in own units, stand
    before the system's. Empty for one that does not."""
    try:
        connector = system.find(TOLERANCE)
    except InputError:
        return {}
    held = values.get(TOLERANCE, system.parameters.get(TOLERANCE, connector.start))
    if connector.causality != "parameter" or not isinstance(held, int | float):
        return {}
    return {TOLERANCE: max(OF_HALF_THE_STEP * held, connector.minimum)}


def _foreign(components: Iterable[Component]) -> tuple[str, ...]:
    return tuple(c.name for c in components if is_foreign(c.fmu, c.sha256) and not c.own_process)


def _constants(components: Iterable[Element]) -> dict[str, Value]:
    return {
        f"{c.name}.{name}": value for c in components if isinstance(c, Component) for name, value in c.constants.items()
    }


def _without_repeats(problems: list[str]) -> list[str]:
    """check() and the conversion of values both meet an unknown parameter; the first report stays."""
    kept: list[str] = []
    for problem in problems:
        if not any(
            problem in other or other.removeprefix("parameter ") == problem.removeprefix("parameter ") for other in kept
        ):
            kept.append(problem)
    return kept


def parse_value(text: str) -> Value:
    """A value typed on the command line: a number stays a number, anything else is for the connector to read."""
    try:
        return float(text)
    except ValueError:
        return text


def share(value: Any, place: str) -> float:
    """0.001 or "0.1 %"; true is 0.1 %, false 0."""
    if isinstance(value, bool):
        return ADAPTIVE if value else 0.0
    share = proportion(value, place)
    if share == 1.0:
        raise InputError(f"{place} = {value}: must lie below 100 %")
    return share
