"""A landing as an SSP package that other tools open: every FMU of the scenario, its connections with the
transformations of mapping files, its parameters, and our master's settings as annotations."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ..contract import is_impedance
from ..cosim.layout import conversion
from ..cosim.system import System
from ..errors import InputError, problems_to_error
from ..files import write
from ..fmu.component import Component
from ..fmu.element import Connector
from ..mapping import Mapping, Signal, carried, load_mapping
from ..scenario import Scenario
from ..ssp.writing import SET, Joint, Written, package_bytes

VERSIONS = ("1.0", "2.0")


@dataclass(frozen=True)
class Exported:
    """A component as its FMU describes it, and the mapping by which the contract's names became its own."""

    component: Component
    mapping: Mapping

    def variable(self, signal: str) -> Connector:
        """The FMU's own variable behind a name of the contract. Raises InputError for what no connection can carry."""
        found = self.mapping.inputs.get(signal) or self.mapping.outputs.get(signal) or Signal((signal,), (1.0,))
        if len(found.variables) > 1:
            raise InputError(
                f"{self.component.name}.{signal}: is the sum of {', '.join(found.variables)}, which no connection of "
                "SSP carries; let the FMU give the sum as one output"
            )
        return self.component.connectors[found.variables[0]]

    def device(self) -> dict[str, str]:
        """What the mapping says of the device itself."""
        said = {"active": self.mapping.active, "continuous": self.mapping.continuous, "reset": self.mapping.reset}
        step = {} if self.mapping.step is None else {"step": f"{self.mapping.step!r} s"}
        return {name: "true" for name, holds in said.items() if holds} | step


def export_package(scenario: Scenario, out: Path, version: str = "1.0") -> list[str]:
    """Writes a scenario as an SSP package of that version of the standard; returns what other tools must know, one line
    each. Raises InputError for what SSP cannot carry, EnvironmentProblem."""
    system = scenario.system()
    parts = {name: exported(scenario, name, path) for name, path in scenario.fmus.items()}
    problems, joints, hand_over = list[str](), list[Joint](), list[Joint]()
    for target, source in system.connections.items():
        try:
            joint = _joint(system, parts, source, target)
        except InputError as problem:
            problems.append(str(problem))
            continue
        (hand_over if is_impedance(target) else joints).append(joint)
    problems_to_error(f"{scenario.source}: cannot be written as SSP", problems)
    master = scenario.master
    settings = {
        "communicationStep": repr(master.communication_step),
        "scheme": master.scheme,
        "identify": str(master.identify),
        "adaptive": repr(master.adaptive),
    }
    written = [_written(part, system, [*joints, *hand_over]) for part in parts.values()]
    content = package_bytes(scenario.heading, version, written, joints, master.stop, settings, hand_over)
    write(out, content)
    return _notes(parts, joints, hand_over, master.communication_step)


def exported(scenario: Scenario, name: str, path: Path) -> Exported:
    """A component of a scenario as its FMU describes it, with its mapping. Raises InputError."""
    component = Component.read(name, path)
    mapping = load_mapping(scenario.maps[name]) if name in scenario.maps else carried(component)
    if scenario.wiring is not None:
        component = scenario.wiring.applied(component)
    return Exported(component, mapping or Mapping())


def _joint(system: System, parts: dict[str, Exported], source: str, target: str) -> Joint:
    ends = []
    for full in (source, target):
        name, _, signal = full.partition(".")
        ends.append((name, parts[name].variable(signal)))
    link = system.links.get(target) or conversion(system.find(source).unit, system.find(target).unit)
    own = [connector.unit for _, connector in ends]
    one, other = own
    alike = (one is None and other is None) or (one is not None and other is not None and one.same_dimension(other))
    plain = alike and conversion(one, other) == link
    (first, giving), (second, taking) = ends
    return Joint(f"{first}.{giving.name}", f"{second}.{taking.name}", None if plain else link)


def _written(part: Exported, system: System, joints: list[Joint]) -> Written:
    component, own = part.component, f"{part.component.name}."
    ends = dict.fromkeys(end for joint in joints for end in (joint.source, joint.target) if end.startswith(own))
    values = {}
    for full, value in system.parameters.items():
        if full.startswith(own):
            connector = part.variable(full.removeprefix(own))
            values[connector.name] = connector, value
    connectors = [component.connectors[end.removeprefix(own)] for end in ends]
    return Written(component.name, component.fmu.read_bytes(), connectors, values, part.device())


def _converted(parts: dict[str, Exported], joints: list[Joint]) -> list[str]:
    """The inputs whose number is in another unit than that of the output."""
    found = []
    for joint in (j for j in joints if j.link is None):
        ends = [e.partition(".")[::2] for e in (joint.source, joint.target)]
        if conversion(*(parts[part].component.connectors[name].unit for part, name in ends)) != (1.0, 0.0):
            found.append(joint.target)
    return found


def _notes(parts: dict[str, Exported], joints: list[Joint], hand_over: list[Joint], step: float) -> list[str]:
    notes = [
        f"{name}: what its mapping allows beyond the sandbox is not in the package; whoever runs it grants that anew"
        for name, part in parts.items()
        if part.mapping.allowed
    ]
    notes.append(
        f"all parameter sets are called {SET}: a tool that takes them by name and is not told that one runs the FMUs' "
        "own start values"
    )
    changed, converted = [joint.target for joint in joints if joint.link is not None], _converted(parts, joints)
    if changed:
        notes.append(
            f"{', '.join(changed)}: the connection has a LinearTransformation instead of a conversion of units; tools "
            "leave it out or convert as well without a word (OMSimulator): compare the first run with `run`"
        )
    if converted:
        notes.append(
            f"{', '.join(converted)}: the tool has to convert the unit; some do not, without a word (ecos): compare "
            "the first run with `run`"
        )
    if hand_over:
        notes.append(
            "stiffness and damping of the brace stand in our annotations, not among the connections: our master hands "
            f"them over; a master that does not couples explicitly, for which {1e3 * step:g} ms may be too long a step"
        )
    return notes
