"""One landing out of a folder: of a run, or a trial of a study by its number, the worst, a percentile. What the folder
lacks is simulated again."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..cosim.result import Result
from ..errors import EnvironmentProblem, InputError, SimulationError
from ..fmu.component import Component
from ..fmu.element import Connector
from ..scenario import Scenario
from ..scenario.body import is_of_subject
from ..shipped import fmu_path, names_a_place
from ..study.folder import TRIALS, load_study_plan, read_trials
from ..study.ledger import FILE as LEDGER
from ..study.ledger import Ledger
from ..study.plan import Plan
from ..study.trajectories import read_trajectory, trajectory_path
from ..units import quantity
from .comparison import FILE as COMPARISON
from .comparison import NONE, called, member_path, read_comparison_summary
from .run import RunSummary, read_run

if TYPE_CHECKING:
    import pandas as pd

# relative; a trial simulated again gives its recorded response within this, or its FMUs are not those of the record
AGREEMENT = 1e-6
MEDIAN = "p50"  # the trial of a study where none is named


@dataclass(frozen=True)
class Landing:
    """One landing.

    label       which one it is: its folder, its trial and why that trial
    title       of its scenario or study, or the name of its brace
    pose        initial pose; None for a plant that has no such choice
    result      signals
    parameters  {"component.parameter": value in its own unit} that were set
    plant       the FMU that landed
    """

    label: str
    title: str
    pose: str | None
    result: Result
    parameters: dict[str, float]
    plant: Path

    @cached_property
    def described(self) -> Component:
        return Component.read("plant", self.plant)

    def parameter(self, name: str) -> float:
        """The plant's parameter in its own unit: as set, or its start value. Raises InputError for one it does not
        have."""
        connector = self.described.connectors.get(name)
        if connector is None or connector.start is None:
            raise InputError(f"{self.plant}: the plant has no parameter {name}")
        return self.parameters.get(f"plant.{name}", connector.start)

    def need(self, names: Iterable[str], what: str) -> None:
        """Raises InputError when signals of the plant are missing."""
        missing = [name for name in names if f"plant.{name}" not in self.result.index]
        if missing:
            some = ", ".join(missing[:3]) + (" ..." if len(missing) > 3 else "")
            raise InputError(
                f"{self.label}: its record has no {some}, which {what} needs; run it again with this version"
            )


def load_landings(folder: Path, trial: str | None = None) -> list[Landing]:
    """The landing of a run's or a study's folder (see `load_landing`), or those of every brace of a comparison, under
    the braces' names: of its studies the same trial (see `choose_common_trial`). Raises InputError."""
    if not (folder / COMPARISON).is_file():
        return [load_landing(folder, trial)]
    braces = read_comparison_summary(folder).completed
    places = {name: member_path(folder, brace.folder or name) for name, brace in braces.items()}
    tables = {name: read_trials(place) for name, place in places.items() if (place / TRIALS).is_file()}
    if not tables:
        return [replace(load_landing(place, trial), title=called(name)) for name, place in places.items()]
    first = places[next(iter(tables))]
    with Ledger.read(first) as ledger:
        response = load_study_plan(first, ledger).responses[0]
    number, how = choose_common_trial(tables, response, MEDIAN if trial is None else trial, str(folder))
    return [
        replace(load_landing(place, str(number)), title=called(name), label=f"{place}, {how}")
        for name, place in places.items()
    ]


def load_landing(folder: Path, trial: str | None = None) -> Landing:
    """The landing in a run's folder; in a study's folder the trial `trial`: a number, worst, or pXX for a percentile of
    the study's first response (default p50). Raises InputError."""
    if (folder / TRIALS).is_file():
        return _of_study(folder, MEDIAN if trial is None else trial)
    if (folder / COMPARISON).is_file():
        braces = read_comparison_summary(folder).completed
        places = ", ".join(str(member_path(folder, brace.folder or name)) for name, brace in braces.items())
        raise InputError(f"{folder}: holds one folder for each brace; name one of them: {places}")
    if (folder / LEDGER).is_file():
        raise InputError(f"{folder}: the study is not finished; continue it with --resume")
    run = read_run(folder)
    if trial is not None:
        raise InputError(f"{folder}: holds a single run, which has no trials; leave --trial out")
    plant = _plant(run.summary)
    described = Component.read("plant", plant)
    parameters = {}
    for name, value in run.summary.parameters.items():
        owner, _, parameter = name.partition(".")
        if owner == "plant" and parameter in described.parameters:
            parameters[name] = described.connectors[parameter].value(value, name)
    return Landing(folder.as_posix(), run.title, run.summary.initial_pose, run.result, parameters, plant)


def choose_trial(trials: pd.DataFrame, response: str, which: str, place: str) -> tuple[int, str]:
    """The number of a trial and how it was chosen. Among completed trials `worst` has the largest response and `pXX`
    the one nearest to that percentile (type 7, the lower number of two). Raises InputError."""
    which = which.strip().lower()
    if re.fullmatch(r"\d+", which):
        if int(which) not in set(trials["trial"]):
            raise InputError(
                f"{place}: has no trial {which}; they are numbered {trials['trial'].min()} ... {trials['trial'].max()}"
            )
        return int(which), f"trial {int(which)}"
    percentile = re.fullmatch(r"p(\d{1,2}(\.\d+)?|100)", which)
    if which != "worst" and percentile is None:
        raise InputError(f"--trial {which or repr(which)}: must be a number, worst, or a percentile such as p95")
    done = trials[trials["status"] == "completed"]
    if done.empty or response not in done or done[response].isna().all():
        raise InputError(f"{place}: no completed trial has {response}; name one by its number")
    values = done[response].to_numpy(float)
    if percentile is None:
        at, choice = int(np.nanargmax(values)), f"largest {response}"
    else:
        share = float(percentile.group(1))
        # one of the values: of an even number two are as near to the interpolated p50, and rounding would choose
        at = int(np.nanargmin(np.abs(values - np.nanpercentile(values, share, method="inverted_cdf"))))
        choice = f"{share:g}th percentile of {response}"
    number = int(done["trial"].iloc[at])
    return number, f"trial {number}, {choice}"


def choose_common_trial(tables: Mapping[str, pd.DataFrame], response: str, which: str, place: str) -> tuple[int, str]:
    """`choose_trial` among the trials that every brace completed, by the response without a brace (where that is
    missing, with the first one). Raises InputError."""
    shared = set.intersection(*(set(t["trial"][t["status"] == "completed"]) for t in tables.values()))
    without = NONE if NONE in tables else next(iter(tables))
    rows = tables[without]
    if which.strip().isdigit():
        number, how = choose_trial(rows, response, which, place)
        if number not in shared:
            raise InputError(f"{place}: trial {number} was not completed with every brace; name another one")
        return number, how
    number, how = choose_trial(rows[rows["trial"].isin(shared)], response, which, place)
    return number, f"{how} {'without a brace' if without == NONE else f'with {without}'}"


def _of_study(folder: Path, which: str) -> Landing:
    with Ledger.read(folder) as ledger:
        study = load_study_plan(folder, ledger)
    trials = read_trials(folder)
    number, choice = choose_trial(trials, study.responses[0], which, str(folder))
    row = trials[trials["trial"] == number].iloc[0]
    place, values = f"{folder}, trial {number}", _inputs(study.scenario, row)
    result = _recorded(trajectory_path(folder, number), row)
    if result is None or "plant.pelvis_tx" not in result.index:
        result = _again(study, values, row, place)
    plant = study.scenario.fmus["plant"]
    return Landing(
        f"{folder.as_posix()}, {choice}", study.heading, study.scenario.initial_pose(), result, values, plant
    )


def _inputs(scenario: Scenario, row: pd.Series) -> dict[str, float]:
    """The trial's inputs and the scenario's own parameters."""
    system, values = scenario.system(), dict[str, float]()
    for heading, value in row.items():
        name, _, unit = str(heading).partition(" [")
        if name.partition(".")[0] in scenario.fmus or is_of_subject(name):
            values[name] = _in_own_unit(system.find(name), float(value), unit.rstrip("]"))
    return {**system.parameters, **scenario.of_persons(system, values)}


def _in_own_unit(connector: Connector, value: float, unit: str) -> float:
    return (
        value
        if connector.unit is None or unit in ("", connector.unit.name)
        else quantity(f"{value!r} {unit}", connector.unit, connector.name)
    )


def _recorded(path: Path, row: pd.Series) -> Result | None:
    if not path.is_file():
        return None
    try:
        return replace(read_trajectory(path), status=str(row["status"]), message=str(row["message"]))
    except (ValueError, OSError, EOFError) as problem:
        raise InputError(f"{path}: cannot be read: {problem}") from None


def _again(study: Plan, values: dict[str, float], row: pd.Series, place: str) -> Result:
    if row["status"] not in ("completed", "failed"):
        raise InputError(f"{place}: {row['status']}: {row['message']}; there is nothing to show")
    with study.scenario.recording("plant.*").open() as session:
        result = session.run(values)
    if len(result.time) < 2:
        raise SimulationError(f"{place}: {result.message}")
    response = study.responses[0]
    if row["status"] == "completed" and response in row:
        before, now = float(row[response]), result.metrics.get(response, np.nan)
        if not abs(now - before) <= AGREEMENT * max(1.0, abs(before)):
            raise InputError(
                f"{place}: simulated again it gives {response} = {now:.6g} instead of {before:.6g}; FMUs or versions "
                "are not those of the record (sprain-cosim reproduce names them)"
            )
    return result


def _plant(summary: RunSummary) -> Path:
    name = summary.fmus.get("plant") or ""
    try:
        return fmu_path(Path(name).stem if not names_a_place(name) else name, Path.cwd(), f"plant = {name!r}")
    except (InputError, EnvironmentProblem):
        raise InputError(
            f"plant {name!r}: this run's plant is not one that ships, so its landing cannot be drawn or exported as a "
            "motion"
        ) from None
