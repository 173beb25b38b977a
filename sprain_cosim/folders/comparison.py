"""The folder that `compare` leaves: compare.json, one folder a brace, the figure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from ..errors import InputError
from ..files import read_json
from ..records import FORMAT, Record, Summary, known_format
from .run import RunFolder
from .study import StudyFolder

FILE = "compare.json"
NONE = "none"  # the name under which the landings without a brace stand


@dataclass(frozen=True)
class MeanEstimate(Record):
    """The value of one landing, or the mean over several.

    value            in the unit of the metric's name
    ci_low, ci_high  Student's 95 % interval; None where the landings are no random sample
    n                landings that it is the mean of
    """

    value: float | None = None
    ci_low: float | None = None
    ci_high: float | None = None
    n: int = 0

    @property
    def half_width(self) -> float | None:
        """Of the interval."""
        return None if self.ci_low is None or self.ci_high is None else 0.5 * (self.ci_high - self.ci_low)


Estimates = Mapping[str, MeanEstimate]  # {metric: ...}


@dataclass(frozen=True)
class BraceSummary(Record):
    """What one brace did.

    fmu                     file or name as it was typed; None without a brace
    status, message         completed or failed, and why
    warnings                about the device, one line each
    folder                  its folder inside that of the comparison
    n_completed, n_failed   landings
    metrics                 over the completed landings
    difference_to_none      over the landings that completed both with it and without a brace: with minus without
    resistance_Nm           {posture: moment that resists it [N·m]}; None where it was not measured
    """

    fmu: str | None = None
    status: str = ""
    message: str = ""
    warnings: tuple[str, ...] = ()
    folder: str = ""
    n_completed: int | None = None
    n_failed: int | None = None
    metrics: Estimates = field(default_factory=dict)
    difference_to_none: Estimates = field(default_factory=dict)
    resistance_Nm: Mapping[str, float] | None = None

    @property
    def completed(self) -> bool:
        return self.status == "completed"


@dataclass(frozen=True, eq=False, kw_only=True)
class ComparisonSummary(Summary):
    """Several braces on the same landings: content of compare.json, and what `compare --json` prints.

    format            of the file
    kind              "scenario", one landing for each brace, or "study"
    source, title     where the landings come from, and what they are
    initial_pose      of every landing; None for a plant that has no such choice
    method, seed      of a study's sample
    landings          for each brace
    injury            the event whose probability is the metric probability_of_injury, in words
    braces            {name: what it did}, "none" first
    pairs             {"B - A": the metrics of B minus those of A, over the landings that completed with both}
    """

    format: int = FORMAT
    kind: str = ""
    source: str = ""
    title: str = ""
    initial_pose: str | None = None
    method: str | None = None
    seed: int | None = None
    landings: int | None = None
    injury: str = ""
    braces: Mapping[str, BraceSummary]
    pairs: Mapping[str, Estimates] = field(default_factory=dict)

    @property
    def is_study(self) -> bool:
        return self.kind == "study"

    @property
    def has_intervals(self) -> bool:
        """Whether the landings are independent draws, so that means have intervals."""
        return self.is_study and self.method in ("monte-carlo", "table")

    @property
    def completed(self) -> dict[str, BraceSummary]:
        return {name: brace for name, brace in self.braces.items() if brace.completed}

    @property
    def failed(self) -> dict[str, BraceSummary]:
        return {name: brace for name, brace in self.braces.items() if not brace.completed}


@dataclass(frozen=True)
class ComparisonFolder:
    """Several braces on the same landings: the folder, compare.json, and {brace: its folder}."""

    path: Path
    summary: ComparisonSummary
    members: Mapping[str, RunFolder | StudyFolder]

    @property
    def title(self) -> str:
        return self.summary.title or self.path.name


def read_comparison_summary(folder: Path) -> ComparisonSummary:
    """Raises InputError when there is none, or one of a later version."""
    path = folder / FILE
    return ComparisonSummary.from_json(known_format(read_json(path), path), str(path))


def member_path(folder: Path, name: str) -> Path:
    """The folder of one brace. Raises InputError for a name that leads out of the comparison's folder."""
    if Path(name).name != name:
        raise InputError(f"{folder / FILE}: names {name!r}, which is no folder beside it")
    return folder / name
