"""What a study is to know before it stops: a number of one response, and how narrowly.

One looks after 50 trials and then as often as `planned_looks` says, at last at the number that is allowed; the interval
of each look holds together with those of all others (uq/sequential.py). What is known after a look depends on the
trials up to it and on nothing else."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..metrics import unit_of
from ..units import quantity, unit
from ..uq import statistics
from ..uq.distributions import Array, Marginal
from ..uq.exceedance import Bounds, Threshold
from ..uq.measured import Measured
from ..uq.statistics import Estimate
from .questions import known_response, parse_question, threshold_text, unit_of_response

FIRST_LOOK = 50  # trials
GRAMMAR = (
    '"p95 0.5 deg", "mean 0.2 deg" (of the first response, or "p95 of RESPONSE 0.5 deg") or '
    '"P(RESPONSE > VALUE [+- SD] UNIT) 1 %"'
)
_ASKED = re.compile(
    r"\s*(mean|p[\d.]+(?![\d.])|P\s*\(.*\))(?:\s+of\s+(\S+))?\s*(?:within|\+\s*/?\s*-|±)?\s*([\d.].*?)\s*"
)


@dataclass(frozen=True)
class Until:
    """A number of a response that is to be known.

    response    a metric
    half_width  how far its interval may reach to either side: in the response's unit, of a probability 0 ... 1
    level       of a percentile
    threshold   of a probability, that the response exceeds it
    """

    response: str
    half_width: float
    level: float | None = None
    threshold: Threshold | None = None

    @property
    def quantity(self) -> str:
        """ "p95 of peak_subtalar_angle_deg", "P(peak_subtalar_angle_deg above 40 deg)"."""
        if self.threshold is not None:
            return f"P({self.response} above {threshold_text(self.threshold, unit_of(self.response))})"
        return f"{'mean' if self.level is None else f'p{100 * self.level:g}'} of {self.response}"

    @property
    def factor(self) -> float:
        """From the number to what people read."""
        return 1.0 if self.threshold is None else 100.0

    @property
    def unit(self) -> str:
        return unit_of(self.response) if self.threshold is None else "%"

    def estimate(self, y: Array, failed: int, confidence: float) -> Estimate:
        """From the completed trials `y`; those that failed could have lain anywhere, but count for no mean."""
        if self.threshold is not None:
            return statistics.exceedance(y, _law(self.threshold), confidence, failed)
        return (
            statistics.mean(y, confidence, skewed=True)
            if self.level is None
            else _percentile(y, failed, self.level, confidence)
        )

    def reach(self, found: Estimate) -> float:
        """How far its interval reaches from the value."""
        return max(found.value - found.low, found.high - found.value)

    def known(self, found: Estimate) -> bool:
        return bool(np.isfinite(found.value)) and self.reach(found) <= self.half_width * (1.0 + 1e-9)


def _law(threshold: Threshold) -> float | Marginal:
    """What counts of a threshold here: of bounds the end that gives the larger probability."""
    if isinstance(threshold, Bounds):
        return threshold.low
    return threshold.marginal if isinstance(threshold, Measured) else threshold


def _percentile(y: Array, failed: int, p: float, confidence: float) -> Estimate:
    """With the ends of the interval as far out as the failed trials could have put them."""
    found = statistics.percentile(y, p, confidence)
    if not failed:
        return found
    low, high = statistics.order_statistic_ranks(len(y) + failed, p, confidence)
    ordered = np.sort(y)
    return Estimate(
        found.value,
        float(ordered[low - failed - 1]) if low > failed else -np.inf,
        float(ordered[high - 1]) if high <= len(y) else np.inf,
    )


def parse_until(text: str, response: str, place: str = "--until") -> Until:
    """ "p95 0.5 deg", "mean of RESPONSE within 0.2 deg", "P(RESPONSE > 35 +- 6 deg) 1 %"; `response` where none is
    named. Raises InputError that begins with `place`."""
    match = _ASKED.fullmatch(text)
    if match is None:
        raise InputError(f"{place} {text!r}: must read {GRAMMAR}")
    what, of, width = match.groups()
    here = f"{place} {text!r}"
    if what.startswith("P"):
        if of:
            raise InputError(f"{here}: the response of a probability stands in its brackets")
        question = parse_question(what, place)
        share = quantity(width.replace("%", " %"), unit("1"), f"{here}, the half width")
        if not 0.0 < share < 0.5:
            raise InputError(f"{here}: the half width of a probability lies between 0 and 50 %")
        return Until(question.response, share, threshold=question.threshold)
    name = known_response(of or response, here)
    own = quantity(width, unit_of_response(name), f"{here}, the half width")
    if not own > 0.0:
        raise InputError(f"{here}: the half width must be positive")
    return Until(name, own, level=None if what == "mean" else _level(what, here))


def _level(text: str, place: str) -> float:
    try:
        percent = float(text[1:])
    except ValueError:
        percent = 0.0
    if not 0.0 < percent < 100.0:
        raise InputError(f"{place}: {text} is no percentile; write p5, p50, p97.5")
    return percent / 100.0


def parse_untils(texts: str | Sequence[str], response: str, place: str = "--until") -> tuple[Until, ...]:
    """Several at once. Raises InputError."""
    found = [parse_until(text, response, place) for text in ([texts] if isinstance(texts, str) else texts)]
    asked = [until.quantity for until in found]
    if twice := next((name for name in asked if asked.count(name) > 1), None):
        raise InputError(f"{place}: {twice} is asked twice")
    return tuple(found)
