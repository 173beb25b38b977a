"""Numbers as a reader takes them in: three or four figures, a true minus sign, an interval in brackets."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Protocol

from ..metrics import unit_of
from ..units import FINEST, percentage_within

UNKNOWN = "–"
SIGNS: Mapping[str, str] = {"deg": "°", "deg/s": "°/s"}


class WithInterval(Protocol):
    """An estimate with the ends of its 95 % interval, None where there is none."""

    @property
    def ci_low(self) -> float | None: ...

    @property
    def ci_high(self) -> float | None: ...


def rounded(value: Any) -> str:
    """Three or four figures; a dash for what is no finite number."""
    if value is None or not isinstance(value, int | float) or not math.isfinite(value):
        return UNKNOWN
    size = abs(value)
    digits = 0 if size >= 1000 else 1 if size >= 10 else 2 if size >= 0.1 or size < 5e-4 else 3
    return f"{value:z.{digits}f}".replace("-", "−")


def signed(value: float | None, digits: int = 1) -> str:
    """With its sign, also +."""
    return UNKNOWN if value is None else f"{value:+z.{digits}f}".replace("-", "−")


def percent(p: float | None, finest: float = FINEST, interval: tuple[float | None, float | None] = (None, None)) -> str:
    """A probability 0 ... 1 in percent, as fine as its `interval`."""
    return UNKNOWN if p is None else f"{percentage_within(p, *interval, finest)} %"


def interval(entry: WithInterval, factor: float, unit: str, negate: bool = False) -> str:
    """ " (95 % interval 1.0 … 2.0°)", in the unit that `factor` leads to; nothing where there is none."""
    if entry.ci_low is None or entry.ci_high is None:
        return ""
    ends = sorted(factor * (-v if negate else v) for v in (entry.ci_low, entry.ci_high))
    return f" (95 % interval {rounded(ends[0])} … {rounded(ends[1])}{unit})"


def ends(low: float | None, high: float | None, factor: float = 1) -> tuple[str, ...]:
    """ "1.0 … 2.0" as the small line of a table's cell, "open … 2.0" where too few landings close it; none where there
    is no interval."""
    if low is None and high is None:
        return ()
    return (" … ".join("open" if end is None else rounded(factor * end) for end in (low, high)),)


def unit_after(response: str) -> str:
    """The unit of a response as it follows a number: "°", " N·m" or nothing."""
    unit = unit_of(response)
    return SIGNS.get(unit, f" {unit}" if unit else "")


def unit_alone(response: str) -> str:
    """The unit of a response on its own: "°", "N·m" or nothing."""
    unit = unit_of(response)
    return SIGNS.get(unit, unit)
