"""Searches: methods that choose each trial after those before it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ..errors import InputError, SimulationError, nearest
from ..uq.distributions import Array
from ..uq.reliability import LevelResult
from .dispatch import Dispatch
from .plan import Plan
from .worker import Outcome


def run_search(study: Plan, dispatch: Dispatch) -> Any:
    response, count = study.responses[0], 0

    def function(x: Array) -> Array:
        nonlocal count
        points = np.atleast_2d(x)
        numbers = np.arange(count, count + len(points))
        dispatch.finish([(numbers, points)], len(points))
        rows = [row for row in map(dispatch.ledger.row, numbers.tolist()) if row is not None]
        count += len(rows)
        for row, point in zip(rows, points, strict=True):
            if not np.array_equal(row.inputs, point):
                raise InputError(
                    "the ledger holds other points than this search asks for; name a new folder with --out"
                )
        return np.array([_response(row.outcome, response, row.trial) for row in rows])

    found = study.search(function)
    if not isinstance(found, LevelResult) or not study.check:
        return found
    dispatch.trajectories.first = min(dispatch.trajectories.first, count)  # the check's landings need no record
    return replace(found, check=study.level_check(function, found))


def _response(outcome: Outcome, name: str, trial: int) -> float:
    if outcome.status != "completed":
        raise SimulationError(
            f"trial {trial} of the search {outcome.status}: {outcome.message}; a search needs all its points"
        )
    if name not in outcome.metrics:
        raise InputError(f"response {name!r}: no such metric{nearest(name, outcome.metrics)}")
    return outcome.metrics[name]
