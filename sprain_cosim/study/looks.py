"""A sample that stops when it tells enough: the looks at its trials, and what each of them knew."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..records import finite
from ..uq.sequential import look_confidence, planned_looks
from ..uq.statistics import Estimate
from .dispatch import Dispatch
from .folder import trial_tables
from .plan import Plan
from .questions import computed_response
from .shards import trial_blocks, trial_numbers
from .summary import UntilLook, UntilRule, Watched
from .until import FIRST_LOOK, Until

if TYPE_CHECKING:
    import pandas as pd

CONFIDENCE = 0.95
FEWEST = 4  # completed trials for an interval


def confidence_of(study: Plan) -> float:
    """Of each interval of a study, that all may hold together however often one looks."""
    return look_confidence(_planned(study), CONFIDENCE) if study.watched else CONFIDENCE


def land_until_known(study: Plan, dispatch: Dispatch, numbers: NDArray[np.int64]) -> NDArray[np.int64]:
    """Runs the trials look by look until all is known; the numbers of those that belong to the study. Trials that the
    ledger had before beyond them are kept."""
    confidence = confidence_of(study)
    before = np.flatnonzero(np.isin(numbers, dispatch.ledger.finished()[0]))
    held, n = int(before[-1]) + 1 if len(before) else 0, 0
    for n in _planned(study):
        dispatch.finish(trial_blocks(study, None, n), n, len(numbers))
        table, _ = trial_tables(study, dispatch.ledger, numbers[:n])
        if all(u.known(e) for u, e in zip(study.watched, _look(study, table, confidence), strict=True)):
            break
    n = max(n, held)
    dispatch.finish(trial_blocks(study, None, n), n)
    return numbers[:n]


def until_rule(study: Plan, trials: pd.DataFrame) -> UntilRule | None:
    """What each look knew, of a study that stops when it knows enough; None for any other."""
    planned, numbers = _planned(study), trial_numbers(study)
    made = [n for n in planned if n <= len(trials)]
    if not study.watched or not made:
        return None
    confidence = confidence_of(study)
    found = [_look(study, trials[trials["trial"].isin(numbers[:n])], confidence) for n in made]
    watched = {
        u.quantity: _watched(u, made, [estimates[k] for estimates in found]) for k, u in enumerate(study.watched)
    }
    known = all(w.known for w in watched.values())
    return UntilRule(CONFIDENCE, confidence, tuple(planned), len(numbers), len(trials), known, watched)


def _planned(study: Plan) -> list[int]:
    return planned_looks(study.trials, FIRST_LOOK)


def _look(study: Plan, trials: pd.DataFrame, confidence: float) -> list[Estimate]:
    done = trials[trials["status"] == "completed"]
    failed, found = len(trials) - len(done), list[Estimate]()
    for until in study.watched:
        if len(done) < FEWEST:
            found.append(Estimate(math.nan, -math.inf, math.inf))
        else:
            computed_response(until.response, list(trials.columns))
            found.append(until.estimate(done[until.response].to_numpy(float), failed, confidence))
    return found


def _watched(until: Until, made: Sequence[int], found: Sequence[Estimate]) -> Watched:
    last, reach = found[-1], until.reach(found[-1])
    known = until.known(last)
    needed = None
    if not known and math.isfinite(reach):
        needed = 10 * math.ceil(0.1 * made[-1] * (reach / until.half_width) ** 2)
    looks = tuple(
        UntilLook(n, finite(e.value), finite(e.low), finite(e.high)) for n, e in zip(made, found, strict=True)
    )
    return Watched(until.response, until.half_width, until.unit, looks, known, needed)
