"""Searches: methods that choose each trial after those before it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ..errors import InputError, SimulationError, nearest
from ..uq.distributions import Array
from ..uq.reliability import BudgetTooSmall, LevelResult
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
        if study.method == "design":  # a landing that fails widens its intervals
            done = [row.outcome.metrics if row.outcome.status == "completed" else {} for row in rows]
            return np.array([metrics.get(response, np.nan) for metrics in done])
        return np.array([_response(row.outcome, response, row.trial) for row in rows])

    try:
        found = study.search(function)
    except BudgetTooSmall:
        raise InputError(
            f"study.budget = {study.budget}: is spent before the first step of method {study.method} is complete; take "
            "more"
        ) from None
    except ValueError as problem:
        if study.method != "design":
            raise
        raise SimulationError(str(problem)) from None
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
