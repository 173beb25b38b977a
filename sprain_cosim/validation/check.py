"""What a check is, and how its outcome is judged.

A check measures rows: numbers beside what they should be, each with its tolerance. Its status is the worst of its
rows':

    pass       every row within its tolerance
    known gap  some rows miss by no more than a documented gap; never counted as passed
    fail       a row misses, or the measurement itself failed
    not run    the machine, or the kind of run, lacks what the check needs; never counted as passed
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from ..records import finite
from .laboratory import Laboratory

PASS, GAP, FAIL, NOT_RUN = "pass", "known gap", "fail", "not run"
STATUSES = (PASS, GAP, FAIL, NOT_RUN)


@dataclass(frozen=True)
class CheckRow:
    """One number: passes when |value - expected| <= tolerance. A bound is a row with expected 0 or the middle of its
    range."""

    label: str
    value: float
    expected: float
    tolerance: float
    unit: str = ""

    @property
    def deviation(self) -> float:
        return self.value - self.expected

    @property
    def passes(self) -> bool:
        return math.isfinite(self.value) and abs(self.deviation) <= self.tolerance

    @property
    def strain(self) -> float:
        """Size of the deviation in tolerances: the worst row has the largest."""
        if not math.isfinite(self.value):
            return math.inf
        return abs(self.deviation) / self.tolerance if self.tolerance else (0.0 if self.deviation == 0 else math.inf)


Measure = Callable[[Laboratory], Sequence[CheckRow]]


@dataclass(frozen=True)
class Gap:
    """A miss that is known: |value - expected| may reach `limit`, for the reason in words."""

    limit: float
    reason: str


@dataclass(frozen=True)
class Check:
    """A numbered check of the suite.

    - id: group and number, such as uq-04; title: the question in words
    - why: the reason for the size of the tolerance
    - source: origin of the expected numbers
    - measure: gives the rows
    - quick: part of --quick
    - needs: what the machine must have (names of laboratory.NEEDS)
    - gaps: documented misses by the label of their row
    """

    id: str
    title: str
    why: str
    source: str
    measure: Measure
    quick: bool = True
    needs: tuple[str, ...] = ()
    gaps: Mapping[str, Gap] = field(default_factory=dict)

    @property
    def group(self) -> str:
        return self.id.partition("-")[0]


@dataclass(frozen=True)
class CheckOutcome:
    """A check, its status (one of STATUSES), its rows, a reason in words unless it passed, its wall time [s]."""

    check: Check
    status: str
    rows: tuple[CheckRow, ...] = ()
    reason: str = ""
    seconds: float = 0.0

    def status_of(self, row: CheckRow) -> str:
        gap = self.check.gaps.get(row.label)
        return PASS if row.passes else GAP if gap and abs(row.deviation) <= gap.limit else FAIL

    @property
    def worst(self) -> CheckRow | None:
        return max(self.rows, key=lambda row: (STATUSES.index(self.status_of(row)), row.strain), default=None)

    def as_dict(self) -> dict[str, Any]:
        worst = self.worst
        return {
            "id": self.check.id,
            "title": self.check.title,
            "status": self.status,
            "reason": self.reason,
            "value": worst and finite(worst.value),
            "expected": worst and worst.expected,
            "tolerance": worst and worst.tolerance,
            "unit": worst.unit if worst else "",
            "why": self.check.why,
            "source": self.check.source,
            "seconds": round(self.seconds, 3),
            "rows": [
                {
                    "label": r.label,
                    "value": finite(r.value),
                    "expected": r.expected,
                    "tolerance": r.tolerance,
                    "unit": r.unit,
                    "status": self.status_of(r),
                }
                for r in self.rows
            ],
        }


def judge(check: Check, rows: Sequence[CheckRow], seconds: float = 0.0) -> CheckOutcome:
    """The outcome of a check that was measured."""
    outcome = CheckOutcome(check, PASS, tuple(rows), seconds=seconds)
    found = [(row, outcome.status_of(row)) for row in rows]
    failed = [row for row, status in found if status == FAIL]
    gaps = [row for row, status in found if status == GAP]
    if not rows:
        return CheckOutcome(check, FAIL, reason="measured nothing", seconds=seconds)
    if failed:
        reason = (
            f"{len(failed)} of {len(rows)} outside: "
            + "; ".join(_miss(row) for row in failed[:3])
            + (" ..." if len(failed) > 3 else "")
        )
        return CheckOutcome(check, FAIL, tuple(rows), reason, seconds)
    if gaps:
        reasons = dict.fromkeys(check.gaps[row.label].reason for row in gaps)
        return CheckOutcome(
            check, GAP, tuple(rows), f"{'; '.join(_miss(row) for row in gaps)}: {'; '.join(reasons)}", seconds
        )
    return outcome


def _miss(row: CheckRow) -> str:
    unit = f" {row.unit}" if row.unit else ""
    return f"{row.label} {row.value:.4g} against {row.expected:.4g} ± {row.tolerance:.2g}{unit}"
