"""What `ssp check` says of a package: can it be run here, as a landing or as a device; nothing runs."""

from __future__ import annotations

from graphlib import CycleError, TopologicalSorter
from pathlib import Path

from ..contract import PLANT
from ..cosim.system import System
from ..ssp.flat import Flat, flattened
from .file import load_scenario, packaged_scenario
from .package import MOTION
from .scenario import Scenario

BASE = "incline30"  # the landing in which a device is judged


def inspected(path: Path) -> dict[str, str | list[str]]:
    """{heading: lines}. Raises InputError with all that keeps the package from running."""
    flat = flattened(path)
    landing = PLANT in flat.components or any(set(c.outputs) >= MOTION for c in flat.components.values())
    scenario = packaged_scenario(flat) if landing else load_scenario(BASE).with_device("brace", flat)
    system = scenario.system()
    return {
        "package": f"{path} fits: {'a landing' if landing else 'a device; run it with --fmu brace=' + path.name}",
        "components": [f"{c.name} ({c.capabilities.interface}, {c.fmu.name})" for c in flat.components.values()],
        "connections": _connections(flat, scenario),
        "parameters": [f"{name} = {value}" for name, value in flat.parameters.items()] or "none",
        "loops": _loop(system),
        "notes": [*scenario.warnings, *scenario.doubts()] or "none",
    }


def _connections(flat: Flat, scenario: Scenario) -> list[str]:
    lines = [f"{len(flat.feeds) + sum(map(len, flat.inputs.values())) + len(flat.outputs)}"]
    links = {} if scenario.wiring is None else scenario.wiring.links
    return lines + [
        f"{target} = {factor!r} * {scenario.connections[target]}" + (f" + {offset!r}" if offset else "")
        for target, (factor, offset) in links.items()
    ]


def _loop(system: System) -> str:
    """One algebraic loop by its connectors, by what the FMUs declare of direct feed-through."""
    order = TopologicalSorter[str]()
    for target, source in system.connections.items():
        order.add(target, source)
    for component in system.components:
        for name, output in component.outputs.items():
            inputs = component.inputs if output.depends_on is None else output.depends_on
            order.add(f"{component.name}.{name}", *(f"{component.name}.{n}" for n in inputs))
    try:
        order.prepare()
    except CycleError as cycle:
        return f"{' <- '.join(cycle.args[1])}; solved by iteration at the start, and by the scheme afterwards"
    return "no algebraic loop"
