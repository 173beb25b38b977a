"""What `check` would say of a scenario's device and costs next to nothing: for `run`, `study` and `compare`."""

from __future__ import annotations

from dataclasses import replace

from ..contract import is_torque
from ..errors import InputError, problems_to_error
from ..fmu.component import Component
from ..fmu.foreign import is_foreign
from ..mapping import carried, load_mapping
from ..scenario import Scenario


def device_doubts(scenario: Scenario, name: str = "brace") -> list[str]:
    """About the component `name` where it is a foreign FMU, one line each: input clocks that no run ticks, and SI units
    that nobody declared. Only the latter are measured, in a second or two. Raises InputError where a unit contradicts
    itself, or the device would be no brace in SI units."""
    fmu = scenario.fmus.get(name)
    if fmu is None:
        return []
    component = Component.read(name, fmu)
    if not is_foreign(component.fmu, component.sha256):
        return []
    from .names import clocks, contradicting_units, undeclared
    from .readings import readings_of_names

    file = scenario.maps.get(name)
    mapping = load_mapping(file) if file is not None else carried(component)
    problems_to_error(f"{name}: {fmu.name}", contradicting_units(component, mapping))
    found, _ = clocks(component)
    if mapping is not None:
        component = mapping.apply(component)
    if not any(is_torque(output) for output in component.outputs) or not undeclared(component):
        return [f"{name}: {fmu.name} {doubt}" for doubt in found]
    held = {k.partition(".")[2]: v for k, v in scenario.parameters.items() if k.startswith(f"{name}.")}
    readings = readings_of_names(replace(component, constants={**component.constants, **held}))
    if readings is not None and readings.refused:
        raise InputError(f"{name}: {fmu.name}: {readings.refusal()}")
    said = [] if readings is None else [readings.assumption()]
    return [f"{name}: {fmu.name}: {doubt}" for doubt in (*found, *said)]
