"""A scenario from an SSP package, and a device that comes as one."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..contract import PLANT, plain
from ..cosim.layout import Link, conversion
from ..cosim.master import Master
from ..errors import InputError, problems_to_error
from ..fmu import cache
from ..fmu.component import Component
from ..ssp.flat import Feed, Flat, unlike
from ..ssp.package import Package
from ..ssp.values import finite_number, parameter_set, set_name
from ..units import SECOND, Unit, quantity
from .wiring import Wiring

BRACE = "brace"
MOTION = {"subtalar_angle", "talocrural_angle"}  # what a plant gives and no device does
FLAGS = ("active", "continuous", "reset")  # of a mapping file, which a package carries; never what it would allow
MASTER_KEYS = {
    "communicationStep": "communication_step",
    "scheme": "scheme",
    "identify": "identify",
    "adaptive": "adaptive",
}


def package_content(flat: Flat) -> dict[str, Any]:
    """What a package says, with the keys of a scenario file as they are after reading; besides them `wiring` and
    `notes`. Raises InputError."""
    path, described = flat.path, flat.structure
    names, notes = _with_plant(flat, path)
    master: dict[str, Any] = {
        key: _setting(key, described.master[name], path)
        for name, key in MASTER_KEYS.items()
        if name in described.master
    }
    if described.start:
        raise InputError(f"{path}: the default experiment starts at {described.start:g} s; a landing starts at 0")
    if described.stop is not None:
        master["stop"] = described.stop
    else:
        notes.append(f"states no stop; the landing ends at {1e3 * Master.stop:g} ms")
    connections = {_named(t, names): _named(f.source, names) for t, f in flat.feeds.items()}
    connections |= {_named(h.target, names): _named(h.source, names) for h in flat.hand_over}
    links = {target: feed.link for target, feed in flat.feeds.items()} | {h.target: h.link for h in flat.hand_over}
    notes += [f"input {name} of the system is fed by nothing" for name in flat.inputs]
    return {
        "components": _components(flat, names),
        "parameters": {_named(n, names): value for n, value in flat.parameters.items()},
        "connections": connections,
        "master": master,
        "wiring": Wiring(
            {_named(n, names): unit for n, unit in flat.units.items()},
            {_named(t, names): link for t, link in links.items() if link is not None},
            tuple(names[n] for n in flat.components),
        ),
        "notes": [f"{path.name}: {note}" for note in (*flat.notes, *notes)],
    }


@dataclass(frozen=True)
class PackagedDevice:
    """A device of one or more FMUs, as it takes a component's place.

    fmus, maps, parameters, connections  as those of a scenario
    wiring  its units and transformations
    notes   one line each
    """

    fmus: Mapping[str, Path]
    maps: Mapping[str, Path]
    parameters: Mapping[str, float | str | bool]
    connections: Mapping[str, str]
    wiring: Wiring
    notes: tuple[str, ...]


def device(flat: Flat, name: str, plant: Component) -> PackagedDevice:
    """The device of a package in the place of component `name`: its own connectors meet those of the `plant` by their
    names. Raises InputError."""
    giving = [feed.source.partition(".")[0] for n, feed in flat.outputs.items() if plain(n).endswith("torque")]
    first = giving[0] if giving else next(iter(flat.components), "")
    names = {c: name if c == first else f"{name}_{c}" for c in flat.components}
    feeds = {_named(target, names): _seen(feed, names) for target, feed in flat.feeds.items()}
    met, heard, problems = _meetings(flat, names, plant)
    problems += ["annotation HandOver belongs to a landing, not to a device"] * bool(flat.hand_over)
    problems_to_error(str(flat.path), problems)
    feeds |= met
    found, values = _components(flat, names), {_named(n, names): value for n, value in flat.parameters.items()}
    deaf = [f"output {n} of the system is no signal of the contract; left out" for n in flat.outputs if n not in heard]
    fed = [f"{n}: is fed by {feeds[n].source}; its start value is left out" for n in values if n in feeds]
    return PackagedDevice(
        {n: spec["fmu"] for n, spec in found.items()},
        {n: spec["map"] for n, spec in found.items() if "map" in spec},
        {n: value for n, value in values.items() if n not in feeds},
        {target: feed.source for target, feed in feeds.items()},
        Wiring(
            {_named(n, names): u for n, u in flat.units.items()},
            {target: feed.link for target, feed in feeds.items() if feed.link is not None},
            tuple(names.values()),
        ),
        tuple(f"{flat.path.name}: {note}" for note in (*flat.notes, *deaf, *fed)),
    )


def _meetings(flat: Flat, names: Mapping[str, str], plant: Component) -> tuple[dict[str, Feed], set[str], list[str]]:
    """{target: its feed} where the system's own connectors meet those of the plant, the outputs that do, and the
    problems."""
    gives, takes = {plain(n): n for n in plant.outputs}, {plain(n): n for n in plant.inputs}
    found, heard, problems = dict[str, Feed](), set[str](), list[str]()
    for port, fed in flat.inputs.items():
        if plain(port) not in gives:
            problems.append(f"its input {port} is no signal of the contract")
            continue
        given = plant.outputs[gives[plain(port)]]
        for target, feed in fed.items():
            link, wrong = _joined(feed, given.unit, inward=True)
            problems += [f"its input {port}: {wrong}"] * bool(wrong)
            found[_named(target, names)] = Feed(f"{PLANT}.{given.name}", link)
    for port, feed in flat.outputs.items():
        name = takes.get(plain(port)) or takes.get(f"brace{plain(port)}")
        if name is None or feed.outer:
            continue
        link, wrong = _joined(feed, plant.inputs[name].unit, inward=False)
        problems += [f"its output {port}: {wrong}"] * bool(wrong)
        if f"{PLANT}.{name}" in found:
            problems.append(f"its output {port}: another output means {PLANT}.{name} as well; keep one")
        found[f"{PLANT}.{name}"] = Feed(_named(feed.source, names), link)
        heard.add(port)
    if not heard:
        problems.append(
            "none of the system's own outputs is a torque of the contract; expose one, such as subtalar_torque"
        )
    return found, heard, problems


def _joined(feed: Feed, own: Unit | None, inward: bool) -> tuple[Link | None, str]:
    """The link of a feed between a device and the plant's connector in the unit `own`; and what is wrong."""
    if feed.unit is None or own is None or feed.unclear:
        return feed.link, feed.unclear
    wrong = unlike(own, feed.unit)
    if wrong or feed.link is None:
        return feed.link, wrong
    factor, offset = feed.link
    scale, shift = conversion(own, feed.unit) if inward else conversion(feed.unit, own)
    return ((factor * scale, factor * shift + offset) if inward else (scale * factor, scale * offset + shift)), ""


def _seen(feed: Feed, names: Mapping[str, str]) -> Feed:
    return Feed(_named(feed.source, names), feed.link)


def parameter_set_values(component: Component, name: str) -> dict[str, float | str | bool]:
    """{parameter: value as a scenario file has it} of a named parameter set (SSV) inside an FMU, by the set's own name
    or its file's. Raises InputError with the names there are."""
    inside = Package.within(component.fmu)
    files = [file for file in inside.names if file.lower().endswith(".ssv")]
    sets: dict[str, dict[str, None]] = {}
    for file in files:
        for known in (Path(file).stem, set_name(inside.content(file), f"{component.fmu}:{file}")):
            sets.setdefault(known, {})[file] = None
    if name not in sets:
        there = f"it has {', '.join(sorted(sets))}" if sets else "it carries none"
        raise InputError(f"@{name}: {component.fmu.name} has no parameter set of that name; {there}")
    if len(sets[name]) > 1:
        raise InputError(f"@{name}: {component.fmu.name} has several of that name: {', '.join(sets[name])}")
    file = next(iter(sets[name]))
    place = f"{component.fmu}:{file}"
    found, unknown = dict[str, float | str | bool](), list[str]()
    for value in parameter_set(inside.content(file), place):
        connector = component.connectors.get(value.name)
        if connector is None:
            unknown.append(f"{value.name}: the FMU has no such parameter")
        else:
            found[value.name] = value.value(connector)
    problems_to_error(place, unknown)
    return found


def _with_plant(flat: Flat, path: Path) -> tuple[dict[str, str], list[str]]:
    """{component of the package: its name here}: one of them is the plant. Raises InputError."""
    names = {name: name for name in flat.components}
    if PLANT in names:
        return names, []
    found = [name for name, component in flat.components.items() if set(component.outputs) >= MOTION]
    if len(found) != 1:
        raise InputError(
            f"{path}: {len(found) or 'no'} component{'s' * (len(found) != 1)} with the plant's outputs; one must be "
            f"called {PLANT} (a device alone takes its place with --fmu brace={path.name})"
        )
    return {**names, found[0]: PLANT}, [f"component {found[0]} is the plant"]


def _named(full: str, names: Mapping[str, str]) -> str:
    component, _, variable = full.partition(".")
    return f"{names.get(component, component)}.{variable}"


def _components(flat: Flat, names: Mapping[str, str]) -> dict[str, dict[str, Path]]:
    """{component: {"fmu": its file, "map": what a mapping file says of the device itself}}."""
    found: dict[str, dict[str, Path]] = {}
    for name, component in flat.components.items():
        found[names[name]] = {"fmu": component.fmu}
        lines = [_line(key, text) for key, text in flat.devices.get(name, {}).items()]
        if lines:
            content = "".join(f"{line}\n" for line in lines).encode()
            found[names[name]]["map"] = cache.keep(f"{name}.toml", content, hashlib.sha256(content).hexdigest())
    return found


def _line(key: str, text: str) -> str:
    """A line of a mapping file; nothing else gets into it. Raises InputError."""
    if key == "step":
        return f'step = "{quantity(text, SECOND, "annotation Device: step")!r} s"'
    if key not in FLAGS or text not in ("true", "false"):
        raise InputError(f"annotation Device: {key} = {text!r}: expected true or false for one of {', '.join(FLAGS)}")
    return f"{key} = {text}"


def _setting(key: str, text: str, path: Path) -> float | int | str:
    if key == "scheme":
        return text
    number = finite_number(text, f"{path}: annotation Master: {key}")
    if key != "identify":
        return number
    if number != int(number):
        raise InputError(f"{path}: annotation Master: {key} = {text!r} is no whole number")
    return int(number)
