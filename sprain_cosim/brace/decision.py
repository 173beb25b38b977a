"""Braces over the landings of a study until it is decided which of each pair has the lower peak (uq/sequential.py).

The looks depend on the number of landings allowed and on nothing else, and a landing on its row alone: what is decided
is the same for any number of workers, and after an interruption."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..folders.comparison import NONE, DecidedPair, Decisions, PairLook
from ..records import finite
from ..study.study import Study
from ..uq.sequential import PairDecision, decide, planned_looks
from .comparison import PEAKS, Entry, Source

FIRST = 10  # landings before the first look, which spends most of the error
ERROR = 0.05
Pair = tuple[str, str]
Land = Callable[[str, int, Entry | None], Entry]  # the first so many landings of a brace, after what it did before


def check_decidable(source: Source, braces: Sequence[str], trials: int | None) -> None:
    """Raises InputError for what no sequence of looks can decide; searches are refused where samples are needed."""
    if not isinstance(source, Study):
        raise InputError(f"--decide: {source.source} is one landing; name a study, such as study6")
    if len(braces) < 2:
        raise InputError("--decide: compares braces with each other; name a second with --brace NAME=FILE")
    if source.method in ("lhs", "sobol", "grid"):
        raise InputError(
            f"--decide: {source.source}: method {source.method} fills its sample as a whole, its first landings "
            'are no random sample; use method = "monte-carlo"'
        )
    count = source.trials if trials is None else trials
    if count < FIRST:
        raise InputError(f"--decide: {count} landings are fewer than the {FIRST} of the first look; raise --trials")


def land_until_decided(
    names: Sequence[str], numbers: Sequence[int], land: Land
) -> tuple[list[Entry], list[int], Decisions]:
    """What each of `names` did ("none" as many landings as the brace that needed most), the looks that were made, and
    what they decided. `numbers` of the trials, in the order in which they are landed.

    A brace that fails leaves the comparison: its pairs do not count."""
    entries, made = dict[str, Entry](), list[int]()
    found = dict[Pair, PairDecision]()
    waiting = {name for name in names if name != NONE}
    for n in planned_looks(len(numbers), FIRST):
        for name in (name for name in names if name in waiting):
            entries[name] = land(name, n, entries.get(name))
        made.append(n)
        found = _decided(entries, numbers, made)
        waiting = {name for pair, d in found.items() if not d.decided for name in pair}
        if not waiting:
            break
    if NONE in names:
        entries[NONE] = land(NONE, made[-1], None)
    at_most = len(numbers)
    landed = sum(len(e.landings) for e in entries.values() if e.landings is not None)
    whole = at_most * sum(e.landings is not None for e in entries.values())
    pairs = {f"{b} - {a}": _recorded(a, b, d) for (a, b), d in found.items()}
    return [entries[n] for n in names], made, Decisions(PEAKS[0], ERROR, at_most, landed, whole - landed, pairs)


def _decided(entries: Mapping[str, Entry], numbers: Sequence[int], made: Sequence[int]) -> dict[Pair, PairDecision]:
    """{(A, B): what the looks say of B minus A}"""
    peaks = {name: _peaks(e, numbers) for name, e in entries.items() if e.landings is not None}
    pairs = {f"{b} - {a}": (a, b) for a, b in combinations(peaks, 2)}
    found = decide({name: peaks[b] - peaks[a] for name, (a, b) in pairs.items()}, made, ERROR)
    return {pairs[name]: d for name, d in found.items()}


def _peaks(entry: Entry, numbers: Sequence[int]) -> NDArray[np.float64]:
    """(n,) peaks in the order of the trials; NaN where a landing failed or was not made."""
    rows = entry.completed.set_index("trial").reindex(list(numbers))
    return rows[PEAKS[0]].to_numpy(float) if PEAKS[0] in rows else np.full(len(numbers), np.nan)


def _recorded(a: str, b: str, d: PairDecision) -> DecidedPair:
    lower, higher = {0: (None, None), 1: (a, b), -1: (b, a)}[d.sign]
    seen = tuple(
        PairLook(
            k.n, k.p_value, k.level, finite(k.difference.value), finite(k.difference.low), finite(k.difference.high)
        )
        for k in d.looks
    )
    return DecidedPair(lower, higher, d.n, seen)
