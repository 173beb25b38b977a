"""Which trials a run of a study is about: all of them, the k-th of n parts, or the first of them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..units import whole_number
from ..uq.distributions import Array
from .plan import MOST_TRIALS, Plan

Shard = tuple[int, int]  # (k, n): the k-th of n parts, from 1


def shard(text: str) -> Shard:
    """ "2/10" as (2, 10). Raises InputError."""
    k, slash, n = text.partition("/")
    if not (slash and k.isdecimal() and n.isdecimal() and 1 <= int(k) <= int(n)):
        raise InputError(f"--shard {text}: must be K/N with K from 1 to N, such as 2/10")
    return int(k), whole_number(int(n), f"--shard {text}: N", 1, MOST_TRIALS)


def as_shard(part: Shard | str) -> Shard:
    """(2, 10) or "2/10". Raises InputError."""
    if isinstance(part, str):
        return shard(part)
    if not isinstance(part, tuple) or len(part) != 2:
        raise InputError(f"shard = {part!r}: must be (k, n): the k-th of n parts, such as (2, 10)")
    n = whole_number(part[1], "shard, number of parts", 1, MOST_TRIALS)
    if not 1 <= (k := whole_number(part[0], "shard", 1)) <= n:
        raise InputError(f"shard = {part!r}: there are {n} parts, from 1 to {n}")
    return k, n


def trial_numbers(study: Plan, shard: Shard | None = None, rows: int | None = None) -> NDArray[np.int64]:
    """(n,) numbers of the trials, ascending as far as the study numbers them so; the first `rows` of them."""
    count = int(np.prod([len(levels) for levels in study.grid.values()])) if study.method == "grid" else study.trials
    numbers = np.array(study.numbers or range(count), np.int64)
    return (numbers if shard is None else numbers[numbers % shard[1] == shard[0] - 1])[:rows]


def trial_blocks(
    study: Plan, shard: Shard | None, rows: int | None = None
) -> Iterator[tuple[NDArray[np.int64], Array]]:
    for numbers, x in study.blocks():
        mine = slice(None) if shard is None else numbers % shard[1] == shard[0] - 1
        numbers, x = numbers[mine][:rows], x[mine][:rows]
        yield numbers, x
        rows = None if rows is None else rows - len(numbers)
        if rows == 0:
            return
