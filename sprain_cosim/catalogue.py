"""Every name that may be typed: scenarios, studies and braces that ship, the parameters of a scenario, the responses of
a landing. As records for programs and as tables for people."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any
from xml.etree import ElementTree

from .errors import InputError
from .fmu import archive
from .fmu.element import Connector
from .metrics import MEANINGS, NAMES, OF_BRACE, unit_of
from .scenario import Scenario, load_scenario
from .shipped import FMUS, shipped_fmus, shipped_scenarios, shipped_studies
from .study.file import load_study
from .terminal import fitted_table
from .units import SHOWN, unit

BRACE = "brace_"  # what the names of devices that ship begin with
HEADS = {
    "scenarios": ("scenario", "landing"),
    "studies": ("study", "method", "trials", "landings"),
    "braces": ("brace", "device"),
    "parameters": ("parameter", "unit", "range", "default", "here", "meaning"),
    "responses": ("response", "unit", "meaning"),
}


@dataclass(frozen=True)
class Settable:
    """A parameter of a scenario, or an input that nothing feeds.

    name     component.parameter
    input    whether it is an input that nothing feeds, and no parameter
    kind     real, integer, boolean, enumeration or string
    unit     of minimum, maximum and default, as the FMU declares it; "" where it declares none
    minimum  least value; None for no limit
    maximum  greatest value; None for no limit
    choices  names of an enumeration
    default  the FMU's own value; a name for an enumeration, None where it has none
    value    the scenario's, as it was written; None where it leaves the default
    meaning  the FMU's description
    """

    name: str
    input: bool
    kind: str
    unit: str
    minimum: float | None
    maximum: float | None
    choices: tuple[str, ...]
    default: float | str | None
    value: float | str | None
    meaning: str

    @classmethod
    def of(cls, name: str, connector: Connector, value: Any) -> Settable:
        c, default = connector, connector.start
        return cls(
            name,
            c.causality == "input",
            c.kind,
            c.unit.name if c.unit else "",
            c.minimum if math.isfinite(c.minimum) else None,
            c.maximum if math.isfinite(c.maximum) else None,
            tuple(c.items),
            next((n for n, v in c.items.items() if v == default), default),
            value,
            c.description,
        )

    def row(self) -> tuple[str, ...]:
        """Name, unit, range, default, value, meaning for people: angles in degrees."""
        shown = SHOWN.get(self.unit, "" if self.unit == "1" else self.unit)
        low, high = self._shown(self.minimum), self._shown(self.maximum)
        span = f"{low} ... {high}" if low and high else f"{low} or more" if low else f"{high} or less" if high else ""
        return (
            self.name,
            shown,
            ", ".join(self.choices) or span,
            self._shown(self.default),
            "" if self.value is None else f"{self.value:g}" if isinstance(self.value, float) else str(self.value),
            self.meaning,
        )

    def _shown(self, value: float | str | None) -> str:
        if not isinstance(value, int | float):
            return value or ""
        if self.kind == "boolean":
            return str(bool(value)).lower()
        shown = SHOWN.get(self.unit)
        return f"{value if shown is None else unit(shown).from_base(value) + 0.0:.6g}"


def parameters_of(scenario: Scenario) -> list[Settable]:
    """Every parameter of its FMUs and every input that nothing feeds, and what describes its subject. Raises
    InputError."""
    system, values = scenario.system(), scenario.values()
    found = [
        f"{component.name}.{name}"
        for component in system.components
        for several in (component.parameters, component.inputs)
        for name, connector in several.items()
        if connector.kind != "array"  # whose elements stand for it
    ]
    listed = []
    for name in (*found, *system.derived):
        try:
            listed.append(Settable.of(name, system.settable(name), values.get(name)))
        except InputError:  # an input that something feeds
            continue
    return listed


def catalogue(kind: str, scenario: Scenario | None = None) -> list[dict[str, Any]]:
    """One record a name of that kind, of guidance.LISTED; `scenario` for parameters. Raises InputError."""
    if kind == "scenarios":
        return [{"name": name, "heading": load_scenario(name).heading} for name in shipped_scenarios()]
    if kind == "studies":
        return [_study(name) for name in shipped_studies()]
    if kind == "braces":
        return [{"name": n, "description": _description(n)} for n in shipped_fmus() if n.startswith(BRACE)]
    if kind == "responses":
        return [{"name": n, "unit": unit_of(n), "meaning": MEANINGS[n], "needs_brace": n in OF_BRACE} for n in NAMES]
    if scenario is None:
        raise InputError("list parameters: name a scenario, such as `sprain-cosim list parameters incline30_brace`")
    return [{**vars(p), "choices": list(p.choices)} for p in parameters_of(scenario)]


def catalogue_table(kind: str, columns: int | None, scenario: Scenario | None = None) -> str:
    """The same for people, within that many columns of a terminal; None: one line a name."""
    if kind == "parameters" and scenario is not None:
        rows: Iterable[tuple[str, ...]] = [parameter.row() for parameter in parameters_of(scenario)]
    else:
        rows = [_row(kind, record) for record in catalogue(kind, scenario)]
    return fitted_table(HEADS[kind], list(rows), columns)


def _row(kind: str, record: dict[str, Any]) -> tuple[str, ...]:
    if kind == "responses":
        brace = " (with a brace)" if record["needs_brace"] else ""
        return record["name"], record["unit"], f"{record['meaning']}{brace}"
    return tuple(str(value) for key, value in record.items() if key != "varied")


def _study(name: str) -> dict[str, Any]:
    study = load_study(name)
    return {
        "name": name,
        "method": study.method,
        "trials": study.trials,
        "heading": study.heading,
        "varied": [*study.marginals, *study.grid],
    }


def _description(name: str) -> str:
    """What an FMU that ships says it is."""
    return ElementTree.fromstring(archive.read(FMUS / f"{name}.fmu").description).get("description", "")
