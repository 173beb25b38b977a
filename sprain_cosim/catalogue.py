"""Every name that may be typed: scenarios, studies and braces that ship, the parameters of a scenario, the responses of
a landing. As records for programs and as tables for people."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any
from xml.etree import ElementTree

from .errors import InputError
from .fmu import archive
from .metrics import MEANINGS, NAMES, OF_BRACE, unit_of
from .scenario import Scenario, load_scenario
from .scenario.settable import Settable, settables
from .shipped import FMUS, shipped_fmus, shipped_scenarios, shipped_studies
from .study.file import load_study
from .terminal import fitted_table

BRACE = "brace_"  # what the names of devices that ship begin with
HEADS = {
    "scenarios": ("scenario", "landing"),
    "studies": ("study", "method", "trials", "landings"),
    "braces": ("brace", "device"),
    "parameters": ("parameter", "unit", "range", "default", "here", "meaning"),
    "responses": ("response", "unit", "meaning"),
}


def parameters_of(scenario: Scenario) -> list[Settable]:
    """Every parameter of its FMUs and every input that nothing feeds, and what describes its subject. Raises
    InputError."""
    return settables(scenario.system(), scenario.values())


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
