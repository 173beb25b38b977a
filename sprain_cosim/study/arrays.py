"""The trials of a study as labelled arrays: inputs and responses over `trial`, recorded signals over `trial` and
`time`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..dataset import Variable, dataset, in_words
from ..errors import InputError, nearest
from ..metrics import MEANINGS, unit_of
from .inputs import HEADING
from .summary import StudySummary
from .trajectories import read_trajectory, trajectory_paths

if TYPE_CHECKING:
    import pandas as pd
    import xarray

MEANING = {"status": "how the trial ended", "message": "why it did not complete"} | MEANINGS


def name_and_unit(column: str) -> tuple[str, str]:
    """Of a column of trials.csv; "" where there is no unit."""
    found = HEADING.fullmatch(column)
    return (found[1], found[2]) if found else (column, unit_of(column))


def about_study(summary: StudySummary) -> dict[str, Any]:
    """What the numbers are of, and how many are missing."""
    return {
        "title": summary.title,
        "method": summary.method,
        "initial_pose": summary.initial_pose,
        "n_completed": summary.n_completed,
        "n_failed": summary.n_failed,
    }


def trials_dataset(
    trials: pd.DataFrame, folder: Path | None, signals: Sequence[str] | str, about: Mapping[str, Any]
) -> xarray.Dataset:
    """An xarray.Dataset of the columns of trials.csv over `trial`, and of `signals`, which the folder has of recorded
    trials, over `trial` and `time` [s]: NaN for a trial that has none, or ended before. Raises InputError for a signal
    that there is not."""
    numbers = trials["trial"].to_numpy()
    coordinates = [Variable("trial", ("trial",), numbers, "", "number of the trial")]
    variables = []
    for column in trials.columns.drop("trial"):
        name, unit = name_and_unit(str(column))
        values = trials[column].fillna("").to_numpy(str) if name in ("status", "message") else trials[column].to_numpy()
        unit = "?" if name in ("status", "message") else unit
        variables.append(Variable(name, ("trial",), values, unit, MEANING.get(name, in_words(name))))
    if signals:
        time, recorded = _recorded(numbers, folder, [signals] if isinstance(signals, str) else signals)
        coordinates.append(time)
        variables += recorded
    return dataset(variables, coordinates, about)


def _recorded(numbers: np.ndarray, folder: Path | None, signals: Sequence[str]) -> tuple[Variable, list[Variable]]:
    paths = {} if folder is None else trajectory_paths(folder)
    runs = {k: read_trajectory(paths[int(n)]) for k, n in enumerate(numbers) if int(n) in paths}
    if not runs:
        raise InputError(f"{folder or 'a study without a folder'}: no trial has its signals; run it with out=...")
    longest = max(runs.values(), key=lambda run: len(run.time))
    for name in signals:
        if name not in longest.index:
            raise InputError(f"signal {name!r}: not recorded{nearest(name, longest.names)}")
    recorded = []
    for name in signals:
        values = np.full((len(numbers), len(longest.time)), np.nan)
        for k, run in runs.items():
            values[k, : len(run.time)] = run[name]
        unit = longest.units[longest.index[name]]
        recorded.append(Variable(name, ("trial", "time"), values, unit.name if unit else "?", in_words(name)))
    return Variable("time", ("time",), longest.time, "s", "time after contact"), recorded
