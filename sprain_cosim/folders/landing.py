"""One landing out of a folder: of a run, or a trial of a study by its number, the worst, a percentile. What the folder
lacks is simulated again."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..cosim.result import Result
from ..errors import EnvironmentProblem, InputError, SimulationError
from ..files import read_json
from ..fmu.component import Component
from ..fmu.element import Connector
from ..scenario import Scenario
from ..shipped import fmu_path
from ..study import folder as studyfolder
from ..study.ledger import FILE, Ledger
from ..study.plan import Plan
from ..study.trajectories import file as recorded
from ..units import quantity
from . import run as runfolder

if TYPE_CHECKING:
    import pandas as pd

# relative; a trial simulated again gives its recorded response within this, or its FMUs are not those of the record
AGREEMENT = 1e-6


@dataclass(frozen=True)
class Landing:
    """`label` says which landing it is, `parameters` {"component.parameter": value in its own unit} what was set,
    `plant` the FMU that landed."""

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


def load_all(folder: Path, trial: str | None = None) -> list[Landing]:
    """The landing of a run's or a study's folder (see `load`), or those of every brace of a comparison, under the
    braces' names."""
    if not (folder / "compare.json").is_file():
        return [load(folder, trial)]
    try:
        braces = read_json(folder / "compare.json")["braces"]
        return [
            replace(load(folder / entry["folder"], trial), title=name)
            for name, entry in braces.items()
            if entry["status"] == "completed"
        ]
    except (TypeError, AttributeError, KeyError) as problem:
        raise InputError(f"{folder / 'compare.json'}: cannot be read: {problem!r}") from None


def load(folder: Path, trial: str | None = None) -> Landing:
    """The landing in a run's folder; in a study's folder the trial `trial`: a number, worst, or pXX for a percentile of
    the study's first response (default p50). Raises InputError."""
    if (folder / "trials.csv").is_file():
        return _of_study(folder, trial or "p50")
    if (folder / "compare.json").is_file():
        raise InputError(f"{folder}: holds one folder for each brace; name one of them")
    if (folder / FILE).is_file():
        raise InputError(f"{folder}: the study is not finished; continue it with --resume")
    head, result = runfolder.read(folder)
    if trial is not None:
        raise InputError(f"{folder}: holds a single run, which has no trials; leave --trial out")
    plant = _plant(head)
    described = Component.read("plant", plant)
    given = {
        k: v
        for k, v in head["parameters"].items()
        if k.startswith("plant.") and k.partition(".")[2] in described.parameters
    }
    parameters = {k: described.connectors[k.partition(".")[2]].value(v, k) for k, v in given.items()}
    return Landing(str(folder), head["title"], head["initial_pose"], result, parameters, plant)


def pick(trials: pd.DataFrame, response: str, which: str, place: str) -> tuple[int, str]:
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
        raise InputError(f"--trial {which}: must be a number, worst, or a percentile such as p95")
    done = trials[trials["status"] == "completed"]
    if done.empty or response not in done or done[response].isna().all():
        raise InputError(f"{place}: no completed trial has {response}; name one by its number")
    values = done[response].to_numpy(float)
    if percentile is None:
        at, said = int(np.nanargmax(values)), f"largest {response}"
    else:
        share = float(percentile.group(1))
        at, said = (
            int(np.nanargmin(np.abs(values - np.nanpercentile(values, share)))),
            f"{share:g}th percentile of {response}",
        )
    number = int(done["trial"].iloc[at])
    return number, f"trial {number}, {said}"


def _of_study(folder: Path, which: str) -> Landing:
    import pandas as pd

    with Ledger.read(folder) as ledger:
        study = studyfolder.load(folder, ledger)
    try:
        trials = pd.read_csv(folder / "trials.csv")
    except (ValueError, OSError) as problem:
        raise InputError(f"{folder / 'trials.csv'}: cannot be read: {problem}") from None
    number, said = pick(trials, study.responses[0], which, str(folder))
    row = trials[trials["trial"] == number].iloc[0]
    what, values = f"{folder}, trial {number}", _inputs(study.scenario, row)
    result = _recorded(recorded(folder, number), row)
    if result is None or "plant.pelvis_tx" not in result.index:
        result = _again(study, values, row, what)
    return Landing(
        f"{folder}, {said}", study.title, study.scenario.initial_pose(), result, values, study.scenario.fmus["plant"]
    )


def _inputs(scenario: Scenario, row: pd.Series) -> dict[str, float]:
    """The trial's inputs and the scenario's own parameters."""
    system = scenario.system()
    values = dict(system.parameters)
    for heading, value in row.items():
        name, _, unit = str(heading).partition(" [")
        if name.partition(".")[0] in scenario.fmus:
            values[name] = _in_own_unit(system.find(name), float(value), unit.rstrip("]"))
    return values


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
        return replace(Result.read_csv(path), status=str(row["status"]), message=str(row["message"]))
    except (ValueError, OSError, EOFError) as problem:
        raise InputError(f"{path}: cannot be read: {problem}") from None


def _again(study: Plan, values: dict[str, float], row: pd.Series, what: str) -> Result:
    if row["status"] not in ("completed", "failed"):
        raise InputError(f"{what}: {row['status']}: {row['message']}; there is nothing to show")
    with study.scenario.recording("plant.*").open() as session:
        result = session.run(values)
    if len(result.time) < 2:
        raise SimulationError(f"{what}: {result.message}")
    response = study.responses[0]
    if row["status"] == "completed" and response in row:
        before, now = float(row[response]), result.metrics.get(response, np.nan)
        if not abs(now - before) <= AGREEMENT * max(1.0, abs(before)):
            raise InputError(
                f"{what}: simulated again it gives {response} = {now:.6g} instead of {before:.6g}; FMUs or versions "
                "are not those of the record "
                f"(sprain-cosim reproduce names them)"
            )
    return result


def _plant(head: dict[str, Any]) -> Path:
    name = head.get("fmus", {}).get("plant", "")
    try:
        return fmu_path(Path(name).stem if "/" not in name else name, Path.cwd(), f"plant = {name!r}")
    except (InputError, EnvironmentProblem):
        raise InputError(
            f"plant {name!r}: this run's plant is not one that ships, so its landing cannot be drawn or exported as a "
            "motion"
        ) from None
