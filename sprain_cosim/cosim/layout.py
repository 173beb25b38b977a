"""Where everything stands on the bus of a system: what follows from its components and their connections alone,
whatever the parameters. Found once, and known again by every later system of the very same components with the same
connections. Nothing of a run is kept here."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..contract import MOTION, PLANT, impedance_input, is_excitation, is_impedance, motion_output, torque_axis
from ..fmu.element import Connector, Element, Same
from ..units import Unit

Slots = NDArray[np.intp]
Link = tuple[float, float]


@dataclass(frozen=True, eq=False)
class Place:
    """Of one component; its arrays are never written.

    inputs, outputs  its slots on the bus
    own_names        its names of these, inputs first
    feedthrough      so many of its outputs, the last ones, follow its inputs directly
    connected        the slots that its inputs are fed from, with stiffness and damping handed over
    unconnected      the same with zeros in their place
    resting          the same while the components initialise, with excitations at rest; None where it has none
    factor, offset   from the sources' units to those of the inputs; `scaled`: one of them matters
    zero             the slot that stays 0
    """

    inputs: slice
    outputs: slice
    own_names: tuple[str, ...]
    feedthrough: int
    connected: Slots
    unconnected: Slots
    resting: Slots | None
    factor: NDArray[np.floating]
    offset: NDArray[np.floating]
    scaled: bool
    zero: int

    def fed_back(self, sources: Slots) -> bool:
        """Whether a component that steps after it is among the `sources` of its inputs."""
        return bool(((sources >= self.outputs.stop) & (sources < self.zero)).any())

    @cached_property
    def fed_back_connected(self) -> bool:
        return self.fed_back(self.connected)

    @cached_property
    def fed_back_unconnected(self) -> bool:
        return self.fed_back(self.unconnected)


class Layout:
    """Of components with connections {target: source} and links, as System has them.

    places      of the components
    names       of the slots of connectors, "component.connector"; after them the bus has slots of its own
    units       of the slots of connectors; None where none is declared
    index       {name: slot}
    zero        the slot that stays 0: the source of what is not handed over
    identified  {input of the plant: slot of the identified stiffness or damping that may feed it}
    at_rest     {excitation: slot of its value while the components initialise}
    size        of the bus
    """

    def __init__(
        self, components: Sequence[Element], connections: Mapping[str, str], links: Mapping[str, Link]
    ) -> None:
        self.components, self.connections, self.links = components, connections, links
        self._plant = next((c for c in components if c.name == PLANT), None)

    def __reduce__(self) -> tuple[Any, ...]:
        return Layout, (self.components, self.connections, self.links)

    @cached_property
    def torques(self) -> dict[str, str]:
        """{axis: the output that gives the torque about it} for all torques of devices on the plant."""
        outputs = set(self._plant.outputs) if self._plant else set[str]()
        return {
            axis: source
            for target, source in self.connections.items()
            if (axis := torque_axis(target)) is not None
            and {motion_output(axis, kind).partition(".")[2] for kind in MOTION} <= outputs
        }

    @cached_property
    def undeclared(self) -> dict[str, tuple[str, str]]:
        """{input of the plant: (torque, the plant's output it may depend on)} for stiffness and damping that the plant
        could use and the device does not declare. Declared about an axis without cross terms means that there are
        none."""
        found: dict[str, tuple[str, str]] = {}
        for kind in MOTION:
            for axis, torque in self.torques.items():
                if self._plant is None or impedance_input(axis, axis, kind) in self.connections:
                    continue
                device = torque.partition(".")[0]
                for other in self.torques:
                    name, motion = impedance_input(axis, other, kind), motion_output(other, kind)
                    if name.partition(".")[2] in self._plant.inputs and self._feeds(motion, device):
                        found[name] = torque, motion
        return found

    def _feeds(self, source: str, component: str) -> bool:
        return any(s == source and t.startswith(f"{component}.") for t, s in self.connections.items())

    @cached_property
    def _own(self) -> list[tuple[list[str], list[str], int]]:
        return [self.of(component) for component in self.components]

    def of(self, component: Element) -> tuple[list[str], list[str], int]:
        """Its inputs and outputs that stand on the bus; the last so many outputs follow the inputs directly."""
        fed = [f"{component.name}.{n}" for n in component.inputs]
        inputs = [n.partition(".")[2] for n in fed if n in self.connections or n in self.undeclared]
        direct = {
            name: connector.depends_on is None or not set(inputs).isdisjoint(connector.depends_on)
            for name, connector in component.outputs.items()
            if connector.scalar_number
        }
        return inputs, sorted(direct, key=direct.__getitem__), sum(direct.values()) if inputs else 0

    @cached_property
    def names(self) -> tuple[str, ...]:
        own = zip(self.components, self._own, strict=True)
        return tuple(f"{c.name}.{name}" for c, (inputs, outputs, _) in own for name in (*inputs, *outputs))

    @cached_property
    def units(self) -> tuple[Unit | None, ...]:
        own = zip(self.components, self._own, strict=True)
        return tuple(c.connectors[name].unit for c, (inputs, outputs, _) in own for name in (*inputs, *outputs))

    @cached_property
    def index(self) -> dict[str, int]:
        return {name: k for k, name in enumerate(self.names)}

    @property
    def zero(self) -> int:
        return len(self.names)

    def factor(self, slot: int) -> float:
        """From the slot's unit to SI, offsets apart; 1 for slots of the bus itself and for undeclared units."""
        unit = self.units[slot] if slot < self.zero else None
        return unit.factor if unit else 1.0

    @cached_property
    def identified(self) -> dict[str, int]:
        return {name: k for k, name in enumerate(self.undeclared, self.zero + 1)}

    @cached_property
    def at_rest(self) -> dict[str, int]:
        rest = [target for target in self.connections if is_excitation(target) and target in self.index]
        return {name: k for k, name in enumerate(rest, self.zero + 1 + len(self.identified))}

    @property
    def size(self) -> int:
        return self.zero + 1 + len(self.identified) + len(self.at_rest)

    @cached_property
    def bounded(self) -> tuple[tuple[str, Connector], ...]:
        """Connected inputs with a declared range."""
        return tuple(
            (f"{component.name}.{connector.name}", connector)
            for component in self.components
            for connector in component.connectors.values()
            if connector.causality == "input"
            and (connector.minimum > -math.inf or connector.maximum < math.inf)
            and f"{component.name}.{connector.name}" in self.connections
        )

    @cached_property
    def places(self) -> tuple[Place, ...]:
        found, first = [], 0
        for component, (inputs, outputs, direct) in zip(self.components, self._own, strict=True):
            split = first + len(inputs)
            names = [f"{component.name}.{name}" for name in inputs]
            connected = _fixed([self._source(name) for name in names], np.intp)
            resting = [self.at_rest.get(n, s) for n, s in zip(names, connected.tolist(), strict=True)]
            links = [self._link(component, name) for name in inputs]
            found.append(
                Place(
                    inputs=slice(first, split),
                    outputs=slice(split, split + len(outputs)),
                    own_names=(*inputs, *outputs),
                    feedthrough=direct,
                    connected=connected,
                    unconnected=_fixed(
                        [self.zero if is_impedance(n) else s for n, s in zip(names, connected.tolist(), strict=True)],
                        np.intp,
                    ),
                    resting=_fixed(resting, np.intp) if any(name in self.at_rest for name in names) else None,
                    factor=_fixed([factor for factor, _ in links], float),
                    offset=_fixed([offset for _, offset in links], float),
                    scaled=any(link != (1.0, 0.0) for link in links),
                    zero=self.zero,
                )
            )
            first = found[-1].outputs.stop
        return tuple(found)

    def _source(self, name: str) -> int:
        source = self.connections.get(name)
        return self.index[source] if source else self.identified[name]

    def _link(self, component: Element, name: str) -> Link:
        target = f"{component.name}.{name}"
        own, source = component.connectors[name].unit, self.connections.get(target)
        return self.links.get(target) or conversion(self.units[self.index[source]] if source else None, own)


@lru_cache(maxsize=16)
def _layout(
    components: tuple[Same, ...], connections: tuple[tuple[str, str], ...], links: tuple[tuple[str, Link], ...]
) -> Layout:
    return Layout([same.element for same in components], dict(connections), dict(links))


def layout(components: Iterable[Element], connections: Mapping[str, str], links: Mapping[str, Link]) -> Layout:
    return _layout(tuple(map(Same, components)), tuple(connections.items()), tuple(links.items()))


def conversion(source: Unit | None, target: Unit | None) -> Link:
    """Factor and offset from the source's unit to the target's; an undeclared unit is SI."""
    if source == target or (
        source is not None and target is not None and (source.factor, source.offset) == (target.factor, target.offset)
    ):
        return 1.0, 0.0
    source, target = source or Unit("1"), target or Unit("1")
    return source.factor / target.factor, (source.offset - target.offset) / target.factor


def _fixed(values: Sequence[float], kind: type) -> NDArray[Any]:
    array: NDArray[Any] = np.array(values, dtype=kind)
    array.flags.writeable = False
    return array
