"""Scenario files: what they may hold, and how one becomes a Scenario. A base may have a base itself."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .. import keys
from ..cosim.coupling import SCHEMES, check_scheme
from ..cosim.master import Master
from ..errors import InputError, nearest, problems_to_error
from ..files import read_toml
from ..machine.here import SYSTEM
from ..shipped import (
    PACKAGES,
    fmu_path,
    is_file,
    is_package,
    names_a_place,
    scenario_folder,
    shipped_scenarios,
    shipped_studies,
)
from ..subject.words import SUBJECT, subject_of
from ..units import SECOND
from .body import without_person
from .scenario import Scenario, Value, share
from .title import RAN

if TYPE_CHECKING:
    from ..ssp.flat import Flat

NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")


def _parameter_value(value: Any, place: str) -> Value:
    name = place.partition(".")[2]
    if isinstance(value, dict):
        raise InputError(f'{place}: quote names with a dot: "{name}.{next(iter(value), "parameter")}" = ...')
    if not isinstance(value, str | int | float | bool):
        raise InputError(f'{place}: must be a number, a quantity such as "0.3 m", or a name')
    return value


def _scheme(value: Any, place: str) -> str:
    if not isinstance(value, str):
        raise InputError(f"{place}: must be text")
    try:
        check_scheme(value)
    except InputError as problem:
        raise InputError(f"{place.rpartition('.')[0]}: {problem}") from None
    return value


VARIABLE = r"^[A-Za-z][A-Za-z0-9_]*\..+$"  # component.variable
PARAMETERS = keys.Named(
    '"component.parameter"',
    keys.Value("number, text, true or false", {"type": ["number", "string", "boolean"]}, _parameter_value, "its own"),
    VARIABLE,
)
NEEDS_FMU = 'needs fmu = "a shipped FMU or a path"'
COMPONENT = keys.Table(
    (
        keys.Key(
            "fmu",
            keys.text(f"{{table}}: {NEEDS_FMU}"),
            "a shipped FMU by name, or a path relative to this file",
            needs=NEEDS_FMU,
        ),
        keys.Key("map", keys.text("{at}: must be the path of a mapping file"), "mapping file, relative to this file"),
    ),
    says=f"{{at}}: {NEEDS_FMU}",
)
MASTER = keys.Table(
    (
        keys.Key("communication_step", keys.measured(SECOND), "time between two exchanges of values", "0.5 ms"),
        keys.Key("stop", keys.measured(SECOND), "end of the landing", "150 ms"),
        keys.Key(
            "scheme",
            keys.Value("name", {"enum": ["auto", *SCHEMES]}, _scheme),
            f"coupling scheme: auto, {', '.join(SCHEMES)}",
            "auto",
        ),
        keys.Key(
            "identify",
            keys.whole(0, "{at} = {value}: must be a whole number of steps, 0 or more"),
            "steps after which undeclared stiffness and damping are found anew; 0: at the start only",
            "1",
        ),
        keys.Key(
            "adaptive",
            keys.Value(
                "number, share or true",
                {
                    "anyOf": [
                        {"type": "boolean"},
                        {"type": "number", "minimum": 0, "exclusiveMaximum": 1},
                        {"type": "string", "pattern": r"^\s*[0-9.]+([eE][-+]?[0-9]+)?\s*%?\s*$"},
                    ]
                },
                share,
            ),
            "communication steps are divided where the residual energy exceeds this share of the energy exchanged; "
            "true: 0.1 %",
            "0",
        ),
    )
)
FILE = keys.File(
    "scenario files",
    "scenario",
    "One landing: which FMUs, with which parameters, connected how. A scenario with a `base` says only what differs.",
    keys.Table(
        (
            keys.Key(
                "base",
                keys.text(),
                "the scenario that this one changes: a file beside it, or the name of one that ships",
            ),
            keys.Key(
                "title",
                keys.text(),
                f"heading of tables and figures, followed by the changes that options make; {RAN} in it stands for "
                "what runs: slope, brace, muscles",
                "what runs",
            ),
            keys.Key(
                "components",
                keys.Named(
                    "NAME",
                    COMPONENT,
                    f"^{NAME.pattern}$",
                    strange="component name {quoted}: letters, digits and _ only, beginning with a letter",
                ),
                "one FMU under the name that parameters and connections call it by",
            ),
            keys.Key(
                "parameters",
                PARAMETERS,
                "a number only where the parameter has no dimension, else text with the unit; enumerations by name",
                "the FMU's start value",
            ),
            keys.Key(
                "connections",
                keys.Named(
                    '"component.input"',
                    keys.simple(
                        "text",
                        {"type": "string", "pattern": VARIABLE},
                        lambda value: isinstance(value, str),
                        '{at}: must be "input" = "output", both as "component.variable"',
                    ),
                    VARIABLE,
                ),
                "the output that feeds this input, as component.output",
                "devices connect themselves by the contract's names",
            ),
            keys.Key("subject", SUBJECT, "who lands", "the person with whom the plant was made"),
            keys.Key("master", MASTER, "how the components are stepped"),
        ),
        more={"anyOf": [{"required": ["base"]}, {"required": ["components"]}]},
    ),
)


def load_scenario(name: str | Path) -> Scenario:
    """A scenario from a file or the name of one that ships. Raises InputError.

    >>> import sprain_cosim as sc
    >>> sc.load_scenario("incline30_brace").heading
    '30° slope, 240 % brace, ankle muscles off'
    """
    path = _find(str(name))
    # of this file: that of a base would not know what this one changes
    title = "" if is_package(path) else _read(path).get("title", "")
    return _scenario(path, title, _with_bases(path, ()))


def packaged_scenario(flat: Flat) -> Scenario:
    """The scenario that an SSP package is. Raises InputError."""
    from .package import package_content

    return _scenario(flat.path, "", package_content(flat))


def _scenario(path: Path, title: str, content: dict[str, Any]) -> Scenario:
    if not content.get("components"):
        raise InputError(f'{path}: no components; add [components.plant] with fmu = "plant", or a base')
    scenario = Scenario(
        title=title,
        fmus={name: spec["fmu"] for name, spec in content["components"].items()},
        maps={name: spec["map"] for name, spec in content["components"].items() if "map" in spec},
        parameters=content.get("parameters", {}),
        connections=content.get("connections", {}),
        master=Master(**content.get("master", {})),
        source=str(path) if path.parent != scenario_folder() else path.stem,
        warnings=tuple(content.get("notes", ())),
        wiring=content.get("wiring"),
    )
    if "subject" not in content:
        return scenario
    return scenario.landing(subject_of(content["subject"], f"{path}: subject"), kept=scenario.parameters)


def _find(name: str, beside: Path | None = None) -> Path:
    places = [Path(name)] if beside is None else [beside / name, beside / f"{name}.toml"]
    for place in places:
        if is_file(place):
            return place
    if NAME.fullmatch(name) or not names_a_place(name):
        inside = scenario_folder() / f"{name}.toml"
        if is_file(inside):
            return inside
    if name.endswith((".toml", *PACKAGES)) or names_a_place(name):
        raise InputError(f"{name}: no such scenario file")
    if name in shipped_studies():
        raise InputError(f"{name}: is a study, many landings; `sprain-cosim study {name}` runs it")
    raise InputError(
        f"scenario {name!r}: no such file, and none of that name ships{nearest(name, shipped_scenarios())}; "
        "`sprain-cosim list scenarios` shows them"
    )


def _with_bases(path: Path, heirs: tuple[Path, ...]) -> dict[str, Any]:
    """The content of a file on top of its base's; `heirs` are the files whose base it is. Raises InputError."""
    if is_package(path):
        from ..ssp.flat import flattened
        from .package import package_content

        return package_content(flattened(path))
    content = _resolve(_read(path), path)
    if "base" not in content:
        return content
    base = _find(content["base"], beside=path.parent)
    chain = (*heirs, path.resolve())
    if base.resolve() in chain:
        circle = " -> ".join(p.stem for p in (*chain[chain.index(base.resolve()) :], base))
        raise InputError(f"{path}: base {content['base']!r}: the bases form a circle ({circle}); leave one of them out")
    merged = _with_bases(base, chain)
    if "subject" in content:  # in the place of what the base says of a person
        person = subject_of(content["subject"], f"{path}: subject")
        merged["parameters"], _ = without_person(merged.get("parameters", {}), person, content.get("parameters", {}))
    return _merge(merged, content)


def _read(path: Path) -> dict[str, Any]:
    problems: list[str] = []
    raw = read_toml(path)
    if "scenario" in raw and not raw.keys() & {"base", "components"}:
        raise InputError(f"{path}: is a study, many landings; `sprain-cosim study {SYSTEM.quoted(str(path))}` runs it")
    content: dict[str, Any] = FILE.table.read(raw, "", problems)
    problems_to_error(str(path), problems)
    return content


def _resolve(content: dict[str, Any], path: Path) -> dict[str, Any]:
    """FMU names to files; paths are relative to the scenario's file."""
    components = {
        name: {
            **spec,
            "fmu": fmu_path(spec["fmu"], path.parent, f"{path}: components.{name}.fmu = {spec['fmu']!r}"),
            **({"map": path.parent / spec["map"]} if "map" in spec else {}),
        }
        for name, spec in content.get("components", {}).items()
    }
    return {**content, "components": components}


def _merge(base: dict[str, Any], own: dict[str, Any]) -> dict[str, Any]:
    merged = {**base, **own}
    for key in ("components", "parameters", "connections", "master"):
        merged[key] = {**base.get(key, {}), **own.get(key, {})}
    if "wiring" in base:  # a component that takes another's place connects itself
        gone = own.get("components", {})
        merged["wiring"] = base["wiring"].without(gone)
        kept = {
            t: s
            for t, s in base.get("connections", {}).items()
            if t.partition(".")[0] not in gone and s.partition(".")[0] not in gone
        }
        merged["connections"] = {**kept, **own.get("connections", {})}
    return merged
