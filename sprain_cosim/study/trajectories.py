"""The trajectories of a study: one record per trial, `trajectories/000123.record` (cosim/record.py). Versions
before 0.2 wrote `000123.csv.gz`, laid out as a run's signals.csv; it is read as well."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..cosim.record import read_record
from ..cosim.result import Result
from ..errors import InputError
from ..files import LARGEST_RECORD, write
from .ledger import RESUME
from .plan import Plan
from .worker import Outcome

if TYPE_CHECKING:
    import pandas as pd

FOLDER, ENDING, BEFORE = "trajectories", ".record", ".csv.gz"
FIRST = 100  # trials recorded by default
ALL = 1 << 62
ROLES = {"p5": 0.05, "p50": 0.50, "p95": 0.95, "min": 0.0, "max": 1.0}


def trajectory_path(folder: Path, trial: int) -> Path:
    """Where the folder of a study has the signals of a trial, or is to have them."""
    places = [folder / FOLDER / f"{trial:06d}{ending}" for ending in (ENDING, BEFORE)]
    return next((place for place in places if place.is_file()), places[0])


def trajectory_paths(folder: Path) -> dict[int, Path]:
    """{trial: file} of the signals that the folder of a study has."""
    found = {}
    for ending in (BEFORE, ENDING):
        for path in sorted((folder / FOLDER).glob(f"*{ending}")):
            number = path.name.removesuffix(ending)
            if number.isdigit():
                found[int(number)] = path
    return dict(sorted(found.items()))


def read_trajectory(path: Path) -> Result:
    """Raises InputError."""
    if path.name.endswith(BEFORE):
        return Result.read_csv(path)
    try:
        if path.stat().st_size > LARGEST_RECORD:
            raise InputError(f"{path}: has more than {LARGEST_RECORD >> 20} MB")
        return read_record(path.read_bytes(), str(path))
    except OSError as problem:
        raise InputError(f"{path}: cannot be read: {problem.strerror or problem}") from None


@dataclass
class Trajectories:
    """Which trials of a study keep their record.

    folder  of the study; None keeps nothing
    first   trials below this number are recorded while they run; a record of any other trial is kept when there is one
    """

    folder: Path | None
    first: int = FIRST

    def wants(self, trial: int) -> bool:
        return self.folder is not None and trial < self.first

    def keep(self, trial: int, outcome: Outcome) -> None:
        """Writes the record that came with a trial, if one did. Raises EnvironmentProblem."""
        if self.folder is None or not outcome.trajectory:
            return
        write(self.folder / FOLDER / f"{trial:06d}{ENDING}", outcome.trajectory, RESUME, parents=True)

    def take(self, source: Path, trial: int) -> None:
        """Copies the record of another study's folder, if it has one."""
        path = trajectory_path(source, trial)
        if self.folder is not None and path.is_file():
            write(self.folder / FOLDER / path.name, path.read_bytes(), RESUME, parents=True)

    def lacks(self, trials: Any) -> list[int]:
        """Those of the numbers that have no record yet."""
        return (
            []
            if self.folder is None
            else [int(t) for t in dict.fromkeys(trials) if not trajectory_path(self.folder, int(t)).exists()]
        )


def roles(numbers: np.ndarray, response: np.ndarray, values: Mapping[str, float] | None = None) -> dict[str, int]:
    """{role: number of the trial whose response is next to it}; the lowest number where several are as near.

    numbers   (n,) of the trials
    response  (n,) of theirs
    values    {role: value}; None: the percentiles and extremes of ROLES
    """
    if not len(response):
        return {}
    if values is None:
        values = {role: float(np.quantile(response, p)) for role, p in ROLES.items()}
    return {role: int(numbers[np.argmin(np.abs(response - value))]) for role, value in values.items()}


def roles_of(study: Plan, table: pd.DataFrame, found: Any) -> dict[str, int]:
    """{role: trial} of the first response: the percentiles and extremes of a sample, the trials of a search that gave
    its levels' values."""
    done = table[table["status"] == "completed"]
    response = study.responses[0]
    if response not in done:
        return {}
    values: Mapping[str, float] | None = None
    if found is not None:
        values = {f"p{100 * p:g}": v for p, v in getattr(found, "value", {}).items()}
    return roles(done["trial"].to_numpy(), done[response].to_numpy(float), values)


def first_trajectories(text: str) -> int:
    """How many trials "100", "all" or "none" ask to record. Raises InputError."""
    if text not in ("all", "none") and not text.isdecimal():
        raise InputError(f"--trajectories {text}: must be a number, all or none")
    return ALL if text == "all" else 0 if text == "none" else int(text)
