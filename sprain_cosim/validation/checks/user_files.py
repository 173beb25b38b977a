"""A user's own checks: every *.toml file of a folder.

[[check]]
id = "hold-01"                              shown as custom-hold-01
title = "Brace A holds the ankle at 0.35 m"
scenario = "incline30_brace"                a file beside this one, or a name that ships; or study = ..., see below
set = { "plant.drop_height" = "0.35 m" }    optional, as --set
fmu = { brace = "brace_a.fmu" }             optional, as --fmu; a file beside this one, or the name of a shipped FMU
map = { brace = "brace_a.map.toml" }        optional, as --map
step = "0.25 ms"                            optional
metric = "peak_subtalar_angle_deg"
expected = 29.0                             with tolerance = 0.5; or between = [28.0, 30.0]
tolerance = 0.5
why = "repeatability of the rig, twice its SD"
source = "bench test of 12 May, rig 3"

With study = "study6" (a file or a name that ships), trials = 200 and statistic = "mean", "sd" or "p95" in place of
scenario and step."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import InputError, nearest, problems_to_error
from ...files import read_toml
from ...metrics import unit_of
from ...scenario import Scenario, load_scenario
from ...study.file import load_study
from ...study.study import Study
from ..check import Check, Row
from ..laboratory import Laboratory

KEYS = (
    "id",
    "title",
    "scenario",
    "study",
    "set",
    "fmu",
    "map",
    "step",
    "trials",
    "statistic",
    "metric",
    "expected",
    "tolerance",
    "between",
    "why",
    "source",
)
TEXTS = ("id", "title", "metric", "why", "source")
ID = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*")
STATISTIC = re.compile(r"mean|sd|p(\d{1,2}(\.\d+)?)")


def read(folder: Path) -> list[Check]:
    """Raises InputError with the problems of all files."""
    if not folder.is_dir():
        raise InputError(f"--checks {folder}: no such folder")
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

    def __call__(self, laboratory: Laboratory) -> list[Row]:
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
        return [Row(self.label, value, self.expected, self.tolerance, unit_of(self.metric))]

    def _known(self, values: Any) -> None:
        if self.metric not in values:
            raise InputError(f"metric {self.metric!r}: no such metric{nearest(self.metric, list(values))}")


def _statistic(values: np.ndarray, name: str) -> float:
    if name == "mean":
        return float(values.mean())
    return float(values.std(ddof=1)) if name == "sd" else float(np.percentile(values, float(name[1:])))


def _check(entry: Any, path: Path) -> Check:
    if not isinstance(entry, dict):
        raise InputError("must be a table")
    problems = [f"unknown key {key!r}{nearest(key, KEYS)}" for key in entry if key not in KEYS]
    problems += [
        f"{key}: needed, as text" for key in TEXTS if not isinstance(entry.get(key), str) or not entry[key].strip()
    ]
    if isinstance(entry.get("id"), str) and not ID.fullmatch(entry["id"]):
        problems.append("id: letters, digits, `.`, `_` and `-` only")
    if ("scenario" in entry) == ("study" in entry):
        problems.append("needs scenario or study, one of the two")
    problems += [
        f"{key}: belongs to a study" for key in ("trials", "statistic") if key in entry and "study" not in entry
    ]
    if "study" in entry and not STATISTIC.fullmatch(str(entry.get("statistic", ""))):
        problems.append('statistic: needed with study; "mean", "sd" or a percentile such as "p95"')
    if "trials" in entry and not (isinstance(entry["trials"], int) and entry["trials"] > 0):
        problems.append("trials: must be a positive whole number")
    expected, tolerance = _bounds(entry, problems)
    for key in ("set", "fmu", "map"):
        if not isinstance(entry.get(key, {}), dict):
            problems.append(f"{key}: must be a table")
    if problems:
        raise InputError("; ".join(problems))
    name = str(entry.get("scenario", entry.get("study")))
    beside = path.parent / name
    chosen: Any = (load_scenario if "scenario" in entry else load_study)(beside if beside.is_file() else name)
    maps = entry.get("map", {})
    for component, file in entry.get("fmu", {}).items():
        own = path.parent / str(file)
        chosen = chosen.replace_fmu(
            component, own if own.is_file() else str(file), path.parent / maps[component] if component in maps else None
        )
    for key, value in entry.get("set", {}).items():
        chosen = chosen.override(key, value)
    if "step" in entry:
        if "scenario" not in entry:
            raise InputError("step: belongs to a scenario")
        chosen = chosen.with_master(communication_step=entry["step"])
    what = f"{entry['statistic']} of {entry['metric']}" if "study" in entry else entry["metric"]
    measure = Custom(
        what,
        expected,
        tolerance,
        entry["metric"],
        entry.get("statistic", ""),
        chosen if "scenario" in entry else None,
        chosen if "study" in entry else None,
        {"trials": entry["trials"]} if "trials" in entry else {},
    )
    return Check(f"custom-{entry['id']}", entry["title"], entry["why"], entry["source"], measure)


def _bounds(entry: Mapping[str, Any], problems: list[str]) -> tuple[float, float]:
    def number(value: Any) -> bool:
        return isinstance(value, (int, float)) and not isinstance(value, bool) and np.isfinite(value)

    if "between" in entry:
        pair = entry["between"]
        if (
            not (isinstance(pair, list) and len(pair) == 2 and all(map(number, pair)) and pair[0] <= pair[1])
            or "expected" in entry
            or "tolerance" in entry
        ):
            problems.append("between: must be [low, high], without expected and tolerance")
            return 0.0, 0.0
        return 0.5 * (pair[0] + pair[1]), 0.5 * (pair[1] - pair[0])
    if not number(entry.get("expected")) or not number(entry.get("tolerance")) or entry["tolerance"] < 0:
        problems.append("needs expected and tolerance (not negative) as numbers, or between = [low, high]")
        return 0.0, 0.0
    return float(entry["expected"]), float(entry["tolerance"])
