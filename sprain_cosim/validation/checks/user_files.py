"""A user's own checks: every *.toml file of a folder. `FILE` says what they may hold.

[[check]]
id = "hold-01"                              shown as custom-hold-01
title = "Brace A holds the ankle at 0.35 m"
scenario = "incline30_brace"                or study = "study6", trials = 200, statistic = "p95"
set = { "plant.drop_height" = "0.35 m" }
fmu = { brace = "brace_a.fmu" }
metric = "peak_subtalar_angle_deg"
expected = 29.0                             with tolerance = 0.5; or between = [28.0, 30.0]
tolerance = 0.5
why = "repeatability of the rig, twice its SD"
source = "bench test of 12 May, rig 3"
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ... import keys
from ...errors import InputError, nearest, problems_to_error
from ...files import is_missing, read_toml
from ...metrics import unit_of
from ...scenario import Scenario, load_scenario
from ...scenario.file import PARAMETERS
from ...shipped import is_file
from ...study.file import load_study
from ...study.study import Study
from ..check import Check, CheckRow
from ..laboratory import Laboratory

ID = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*")
STATISTIC = re.compile(r"mean|sd|p(\d{1,2}(\.\d+)?)")
OF_STUDY = ("trials", "statistic")
SHIPS = "a file beside this one, or the name of one that ships"


def _needed(key: str, meaning: str) -> keys.Key:
    """A text that every check has."""
    says = f"{key}: needed, as text"
    form = {"type": "string", "pattern": r"\S"}
    return keys.Key(key, keys.simple("text", form, _is_text, says), meaning, needs=says)


def _is_text(value: Any) -> bool:
    return isinstance(value, str) and bool(value.strip())


def _statistic_name(value: Any) -> bool:
    return isinstance(value, str) and STATISTIC.fullmatch(value) is not None


def _identity(value: Any, place: str) -> Any:
    if not _is_text(value):
        raise InputError(f"{place}: needed, as text")
    if not ID.fullmatch(value):
        raise InputError(f"{place}: letters, digits, `.`, `_` and `-` only")
    return value


def _tables(label: str, value: keys.Kind) -> keys.Named:
    return keys.Named(label, value, says="{at}: must be a table")


NEEDS_STATISTIC = 'statistic: needed with study; "mean", "sd" or a percentile such as "p95"'
BOUND = {"type": "number"}
ENTRY = keys.Table(
    (
        keys.Key(
            "id",
            keys.Value("text", {"type": "string", "pattern": f"^{ID.pattern}$"}, _identity),
            "shown as custom-ID; letters, digits, `.`, `_` and `-`",
            needs="id: needed, as text",
        ),
        _needed("title", "what is checked, as a sentence"),
        keys.Key("scenario", keys.text(), f"one landing: {SHIPS}"),
        keys.Key("study", keys.text(), f"many landings: {SHIPS}"),
        keys.Key(
            "set",
            _tables('"component.parameter"', PARAMETERS.value),
            "as --set",
        ),
        keys.Key(
            "fmu",
            _tables("NAME", keys.text()),
            "as --fmu: a file beside this one, or the name of a shipped FMU",
        ),
        keys.Key("map", _tables("NAME", keys.text()), "as --map: a file beside this one"),
        keys.Key(
            "step",
            keys.raw("quantity", {"type": "string", "pattern": keys.MEASURED}, "s"),
            "communication step of a scenario",
            "the scenario's",
        ),
        keys.Key("trials", keys.whole(1, "{at}: must be a positive whole number"), "of a study", "the study's"),
        keys.Key(
            "statistic",
            keys.simple(
                "name", {"type": "string", "pattern": f"^({STATISTIC.pattern})$"}, _statistic_name, NEEDS_STATISTIC
            ),
            "of a study: mean, sd or a percentile such as p95",
        ),
        _needed("metric", "what is compared"),
        keys.Key("expected", keys.raw("number", BOUND, "that of the metric"), "the value it should have"),
        keys.Key(
            "tolerance",
            keys.raw("number", {"type": "number", "minimum": 0}, "that of the metric"),
            "beside expected: how far off it may be",
        ),
        keys.Key(
            "between",
            keys.raw(
                "two numbers", {"type": "array", "items": BOUND, "minItems": 2, "maxItems": 2}, "that of the metric"
            ),
            "in place of expected and tolerance: [low, high]",
        ),
        _needed("why", "reason for the bounds"),
        _needed("source", "where the expected value comes from"),
    ),
    says="must be a table",
    more={
        "allOf": [
            {
                "oneOf": [
                    {"required": ["scenario"], "properties": {"study": False}},
                    {"required": ["study", "statistic"], "properties": {"scenario": False}},
                ]
            },
            {"oneOf": [{"required": ["expected", "tolerance"]}, {"required": ["between"]}]},
        ]
    },
)
FILE = keys.File(
    "checks of your own",
    "check",
    "Further checks of `validate --checks FOLDER`: every `*.toml` file of the folder, with one `[[check]]` each.",
    keys.Table((keys.Key("check", keys.Tables(ENTRY), "one check", needs="must hold [[check]] tables"),)),
)


def read_checks(folder: Path) -> list[Check]:
    """Raises InputError with the problems of all files."""
    if missing := is_missing(folder):
        raise InputError(f"--checks {folder}: {missing}")
    files = sorted(folder.glob("*.toml"))
    if not files:
        raise InputError(f"--checks {folder}: holds no *.toml file")
    found, problems = list[Check](), list[str]()
    for path in files:
        try:
            content = read_toml(path)
        except InputError as problem:
            problems.append(str(problem))
            continue
        entries = content.get("check")
        if not isinstance(entries, list) or set(content) != {"check"}:
            problems.append(f"{path.name}: must hold [[check]] tables and nothing else")
            continue
        for number, entry in enumerate(entries, 1):
            try:
                found.append(_check(entry, path))
            except InputError as problem:
                problems.append(f"{path.name}, check {number}: {problem}")
    ids = [c.id for c in found]
    problems += [f"id {name!r} is used twice" for name in sorted(set(ids)) if ids.count(name) > 1]
    problems_to_error(f"--checks {folder}", problems)
    return found


@dataclass(frozen=True)
class Custom:
    """What a user's check runs: a scenario with a metric, or a study with a statistic of it."""

    label: str
    expected: float
    tolerance: float
    metric: str
    statistic: str = ""
    scenario: Scenario | None = None
    study: Study | None = None
    options: Mapping[str, Any] = field(default_factory=dict)

    def __call__(self, laboratory: Laboratory) -> list[CheckRow]:
        if self.study is not None:
            trials = self.study.run(workers=laboratory.workers, **self.options).trials
            values = trials[trials["status"] == "completed"]
            self._known(values)
            value = _statistic(values[self.metric].to_numpy(float), self.statistic)
        else:
            assert self.scenario is not None
            metrics = laboratory.land(self.scenario).metrics
            self._known(metrics)
            value = metrics[self.metric]
        return [CheckRow(self.label, value, self.expected, self.tolerance, unit_of(self.metric))]

    def _known(self, values: Any) -> None:
        if self.metric not in values:
            raise InputError(f"metric {self.metric!r}: no such metric{nearest(self.metric, list(values))}")


def _statistic(values: np.ndarray, name: str) -> float:
    if name == "mean":
        return float(values.mean())
    return float(values.std(ddof=1)) if name == "sd" else float(np.percentile(values, float(name[1:])))


def _check(table: Any, path: Path) -> Check:
    problems: list[str] = []
    entry = ENTRY.read(table, "", problems)
    if entry is not keys.MISSING:
        _judge_together(table, problems)
    if problems:
        raise InputError("; ".join(problems))
    expected, tolerance = _bounds(entry)
    chosen = _with_changes(_source(entry, path.parent), entry, path.parent)
    measure = Custom(
        label=f"{entry['statistic']} of {entry['metric']}" if "study" in entry else entry["metric"],
        expected=expected,
        tolerance=tolerance,
        metric=entry["metric"],
        statistic=entry.get("statistic", ""),
        scenario=chosen if isinstance(chosen, Scenario) else None,
        study=chosen if isinstance(chosen, Study) else None,
        options={"trials": entry["trials"]} if "trials" in entry else {},
    )
    return Check(f"custom-{entry['id']}", entry["title"], entry["why"], entry["source"], measure)


def _judge_together(table: Mapping[str, Any], problems: list[str]) -> None:
    """What several keys must be together."""
    if ("scenario" in table) == ("study" in table):
        problems.append("needs scenario or study, one of the two")
    problems += [f"{key}: belongs to a study" for key in OF_STUDY if key in table and "study" not in table]
    if "study" in table and "statistic" not in table:
        problems.append(NEEDS_STATISTIC)
    if "between" in table:
        pair = table["between"]
        ordered = isinstance(pair, list) and len(pair) == 2 and all(map(keys.is_number, pair)) and pair[0] <= pair[1]
        if not ordered or "expected" in table or "tolerance" in table:
            problems.append("between: must be [low, high], without expected and tolerance")
    elif not all(keys.is_number(table.get(key)) for key in ("expected", "tolerance")) or table["tolerance"] < 0:
        problems.append("needs expected and tolerance (not negative) as numbers, or between = [low, high]")


def _source(entry: Mapping[str, Any], folder: Path) -> Scenario | Study:
    """The scenario or the study that the check names: a file beside its own, or one that ships."""
    name = str(entry.get("scenario", entry.get("study")))
    where = folder / name if is_file(folder / name) else name
    return load_scenario(where) if "scenario" in entry else load_study(where)


def _with_changes(source: Scenario | Study, entry: Mapping[str, Any], folder: Path) -> Scenario | Study:
    """With the devices, the values and the step that the check asks for."""
    maps = entry.get("map", {})
    for component, file in entry.get("fmu", {}).items():
        own = folder / str(file)
        mapping = folder / maps[component] if component in maps else None
        source = source.replace_fmu(component, own if is_file(own) else str(file), mapping)
    for key, value in entry.get("set", {}).items():
        source = source.override(key, value)
    if "step" in entry:
        if not isinstance(source, Scenario):
            raise InputError("step: belongs to a scenario")
        source = source.with_master(communication_step=entry["step"])
    return source


def _bounds(entry: Mapping[str, Any]) -> tuple[float, float]:
    """Middle and half width of what is accepted."""
    if "between" in entry:
        low, high = entry["between"]
        return 0.5 * (low + high), 0.5 * (high - low)
    return float(entry["expected"]), float(entry["tolerance"])
