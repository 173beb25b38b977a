"""A response with a memory: counts the points asked for and executes each distinct point once."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["DEFAULT_BUDGET", "Array", "BudgetSpent", "Evaluations", "Function", "PointLedger", "Status"]

Array = NDArray[np.float64]
Function = Callable[[Array], ArrayLike]
Status = Literal["ok", "suspect", "rejected"]

DEFAULT_BUDGET = 2000


class Evaluations(int):
    """Number of evaluations requested, which an int is enough for; and what was executed.

    `executed` counts distinct points. `x` (executed, d) and `y` (executed,) are those points in the order of
    execution.
    """

    x: Array
    y: Array

    def __new__(cls, requested: int, x: Array, y: Array) -> Self:
        self = super().__new__(cls, requested)
        self.x, self.y = x, y
        return self

    def __reduce__(self) -> tuple[type[Self], tuple[int, Array, Array]]:
        return type(self), (int(self), self.x, self.y)

    @property
    def requested(self) -> int:
        return int(self)

    @property
    def executed(self) -> int:
        return len(self.y)


class BudgetSpent(Exception):
    pass


class BudgetTooSmall(ValueError):
    """The budget does not even allow the first step of a search."""


@dataclass
class PointLedger:
    """The function with a memory: counts what is asked, executes each distinct point once."""

    function: Function
    budget: int | None = None
    requested: int = 0
    known: dict[bytes, float] = field(default_factory=dict)
    x: list[Array] = field(default_factory=list)

    def __call__(self, points: Array) -> Array:
        points = np.atleast_2d(points) + 0.0  # −0 and 0 are one point
        keys = [row.tobytes() for row in points]
        fresh = {key: row for key, row in zip(keys, points, strict=True) if key not in self.known}
        if self.budget is not None and len(self.known) + len(fresh) > self.budget:
            raise BudgetSpent
        self.requested += len(points)
        if fresh:
            rows = np.array(list(fresh.values()))
            values = np.asarray(self.function(rows), dtype=float)
            if values.shape != (len(rows),):
                raise ValueError(f"the function must return shape ({len(rows)},), it returned {values.shape}")
            for row, value in zip(rows, values, strict=True):
                if not math.isfinite(value):
                    raise ValueError(f"the function returned {value} at x = {row.tolist()}")
                self.known[row.tobytes()] = float(value)
                self.x.append(row)
        return np.array([self.known[key] for key in keys])

    def at(self, point: Array) -> float:
        return float(self(point)[0])

    def evaluations(self) -> Evaluations:
        return Evaluations(self.requested, np.array(self.x), np.array(list(self.known.values())))
