"""The suite: our checks and a user's own, run one after the other; what came of them.

Exit code: a failed check is 1. Known gaps and checks that could not run do not fail a run, are never counted as passed,
and stand in every output with their reason; `strict` lets them fail it too."""

from __future__ import annotations

import fnmatch
import platform
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from time import perf_counter
from typing import Any

from .. import __version__
from ..errors import InputError, SprainError, nearest
from ..machine.here import SYSTEM
from .check import FAIL, GAP, NOT_RUN, PASS, STATUSES, Check, CheckOutcome, judge
from .checks import coupling, fmi, paper, persons, plant, populations, report_page, uncertainty, user_files
from .laboratory import Laboratory


@dataclass(frozen=True)
class Report:
    """What a run of the suite found; `of`: the number of its checks, 0 where it is not known."""

    outcomes: tuple[CheckOutcome, ...]
    quick: bool
    seconds: float
    created: str
    environment: dict[str, str] = field(default_factory=dict)
    of: int = 0

    @property
    def size(self) -> str:
        """How many checks these are, and of how many where some were chosen."""
        n = len(self.outcomes)
        return f"{n} of {self.of} checks (--only)" if self.of > n else f"{n} checks"

    def count(self, status: str) -> int:
        return sum(o.status == status for o in self.outcomes)

    @property
    def counts(self) -> dict[str, int]:
        return {status: self.count(status) for status in STATUSES}

    def passes(self, strict: bool = False) -> bool:
        return not self.count(FAIL) and not (strict and (self.count(GAP) or self.count(NOT_RUN)))

    def as_dict(self) -> dict[str, Any]:
        rows = [o.status_of(row) for o in self.outcomes for row in o.rows]
        return {
            "status": "passed" if self.passes() else "failed",
            "quick": self.quick,
            "counts": self.counts,
            "of": self.of or len(self.outcomes),
            "numbers": {status: rows.count(status) for status in STATUSES[:3]},
            "seconds": round(self.seconds, 1),
            "created": self.created,
            "environment": self.environment,
            "checks": [o.as_dict() for o in self.outcomes],
        }


def suite(folder: Path | None = None) -> list[Check]:
    """All checks in the order of their ids' groups; those of a user's `folder` last. Raises InputError for the folder's
    files."""
    of_plant, of_uq = [*plant.CHECKS, *persons.CHECKS], [*uncertainty.CHECKS, *populations.CHECKS]
    found = [*coupling.CHECKS, *of_plant, *of_uq, *fmi.CHECKS, *report_page.CHECKS, *paper.CHECKS]
    return found + (user_files.read_checks(folder) if folder is not None else [])


def select(checks: Sequence[Check], only: Sequence[str]) -> list[Check]:
    """The checks that `only` names: ids, groups such as `paper`, patterns such as `uq-0*`. Raises InputError for a name
    that matches none."""
    if not only:
        return list(checks)
    chosen = set()
    for name in only:
        matching = {c.id for c in checks if c.group == name or fnmatch.fnmatchcase(c.id, name)}
        if not matching:
            raise InputError(
                f"--only {name}: no check of that id or "
                f"group{nearest(name, [*(c.id for c in checks), *(c.group for c in checks)])}"
            )
        chosen |= matching
    return [c for c in checks if c.id in chosen]


def run_checks(
    checks: Sequence[Check],
    laboratory: Laboratory,
    on_outcome: Callable[[CheckOutcome], None] | None = None,
    named: Collection[str] = (),
    keep: Callable[[Report], None] | None = None,
    interrupted: Callable[[], bool] = lambda: False,
    of: int = 0,
) -> Report:
    """Runs the checks one after the other.

    - on_outcome: called with each outcome as soon as it is there
    - named: ids that run although they are left out of a quick run
    - keep: called with the report so far when the run is interrupted; the checks that are left count as not run, and
      the interrupt goes on
    - of: how many checks there are, of which these were chosen
    - interrupted: whether a signal has arrived that a Python FMU has swallowed, which reports it as an error of its own
    """
    began, outcomes = perf_counter(), list[CheckOutcome]()

    def report() -> Report:
        return Report(
            tuple(outcomes),
            laboratory.quick,
            perf_counter() - began,
            datetime.now(UTC).isoformat(timespec="seconds"),
            environment(),
            of,
        )

    try:
        for check in checks:
            outcome = _outcome(check, laboratory, check.id in named)
            if interrupted():
                raise KeyboardInterrupt
            outcomes.append(outcome)
            if on_outcome:
                on_outcome(outcome)
    except BaseException:
        outcomes += [CheckOutcome(check, NOT_RUN, reason="interrupted") for check in checks[len(outcomes) :]]
        if keep:
            keep(report())
        raise
    return report()


def _outcome(check: Check, laboratory: Laboratory, named: bool) -> CheckOutcome:
    if laboratory.quick and not check.quick and not named:
        return CheckOutcome(check, NOT_RUN, reason="left out of --quick")
    lacks = [reason for reason in map(laboratory.missing, check.needs) if reason]
    if lacks:
        return CheckOutcome(check, NOT_RUN, reason="; ".join(lacks))
    began = perf_counter()
    try:
        rows = check.measure(laboratory)
    except SprainError as problem:
        return CheckOutcome(check, FAIL, reason=f"could not be measured: {problem}", seconds=perf_counter() - began)
    except Exception as problem:  # one broken check must not hide the others
        return CheckOutcome(
            check,
            FAIL,
            reason=f"could not be measured: {type(problem).__name__}: {problem}",
            seconds=perf_counter() - began,
        )
    return judge(check, rows, perf_counter() - began)


def environment() -> dict[str, str]:
    """Versions and machine that a reader of the report needs."""
    import numpy
    import scipy

    return {
        "sprain-cosim": __version__,
        "python": platform.python_version(),
        "numpy": numpy.__version__,
        "scipy": scipy.__version__,
        "platform": platform.platform(),
        "cores": str(SYSTEM.cores()),
    }


def outcome_line(outcome: CheckOutcome) -> str:
    """One line of a listing."""
    worst, figure = outcome.worst, ""
    if worst is not None:
        figure = (
            f"  {worst.label}: {worst.value:.5g} against {worst.expected:.5g} ± {worst.tolerance:.2g} {worst.unit}"
        ).rstrip()
    text = (
        f"{outcome.status:10} {outcome.check.id:13} {outcome.check.title}  [{outcome.seconds:.1f} s, "
        f"{len(outcome.rows)} numbers]"
    )
    detail = outcome.reason if outcome.status != PASS else f"closest to its bound:{figure}"
    return f"{text}\n{'':25}{detail}"


def totals(report: Report) -> str:
    counts = ", ".join(f"{n} {status}" for status, n in report.counts.items())
    rows = sum(len(o.rows) for o in report.outcomes)
    return f"{report.size} with {rows} numbers in {report.seconds:.0f} s: {counts}"
