"""What a system that others described says beyond a scenario file: units that an FMU does not declare, linear
transformations of connections, and whose connections are complete."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Self

from ..contract import PLANT
from ..cosim.layout import Link, conversion
from ..cosim.system import System
from ..errors import InputError
from ..fmu.component import Component
from ..fmu.element import Connector
from ..units import Unit


@dataclass(frozen=True)
class Wiring:
    """See above.

    units     {"component.variable": unit that the FMU does not declare}
    links     {"component.input": (factor, offset)}: factor * number at the source + offset is the number at the target
    complete  components that connect to nothing by their names
    """

    units: Mapping[str, Unit] = field(default_factory=dict)
    links: Mapping[str, Link] = field(default_factory=dict)
    complete: tuple[str, ...] = ()

    def applied(self, component: Component) -> Component:
        """The component with the units that are stated here."""
        own = {n: u for n, c in component.connectors.items() if (u := self.units.get(f"{component.name}.{n}"))}
        if not own:
            return component
        stated = {n: replace(c, unit=own[n]) if n in own else c for n, c in component.connectors.items()}
        return replace(component, connectors=stated)

    def without(self, names: Iterable[str]) -> Self:
        """The same without components."""
        gone = set(names)
        return replace(
            self,
            units={n: u for n, u in self.units.items() if n.partition(".")[0] not in gone},
            links={n: x for n, x in self.links.items() if n.partition(".")[0] not in gone},
            complete=tuple(n for n in self.complete if n not in gone),
        )

    def joined(self, other: Wiring) -> Self:
        """Both together."""
        return replace(
            self,
            units={**self.units, **other.units},
            links={**self.links, **other.links},
            complete=(*self.complete, *other.complete),
        )

    def linked(self, system: System) -> System:
        """The system with the transformations of its connections; the units at their devices' ends are those by which
        the plant's end is SI, so that energy and stiffness are in SI as well. Raises InputError."""
        links = {target: link for target, link in self.links.items() if target in system.connections}
        if not links:
            return system
        units: dict[str, Unit] = {}
        for target, (factor, offset) in links.items():
            source = system.connections[target]
            ends = system.find(source).unit, system.find(target).unit
            at_plant = target.startswith(f"{PLANT}.")
            end, own, other = (source, *ends[::-1]) if at_plant else (target, *ends)
            if own is None:
                continue
            if at_plant:
                seen = replace(own, factor=own.factor * factor, offset=own.offset + own.factor * offset)
            else:
                seen = replace(own, factor=own.factor / factor, offset=own.offset - offset * own.factor / factor)
            seen = replace(seen, name=other.name if other is not None else own.name)
            if units.setdefault(end, seen) != seen:
                raise InputError(
                    f"{end}: its connections have different transformations; give each an output of its own"
                )
        for target, source in system.connections.items():
            if source in units and target not in links:
                links[target] = conversion(system.find(source).unit, system.find(target).unit)
        components = tuple(
            replace(c, connectors={n: _seen(x, units.get(f"{c.name}.{n}")) for n, x in c.connectors.items()})
            for c in system.components
        )
        return replace(system, components=components, links=links)


def _seen(connector: Connector, unit: Unit | None) -> Connector:
    return connector if unit is None else replace(connector, unit=unit)
