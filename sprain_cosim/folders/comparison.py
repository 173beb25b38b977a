"""The folder that `compare` leaves: compare.json, one folder a brace, the figure."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from ..errors import InputError
from ..files import read_json
from ..notebook import Card, Plottable, Rows, with_interval
from ..records import FORMAT, Record, Summary, ends_of, known_format, named_differences, optional
from .run import RunFolder
from .study import PEAK, StudyFolder

FILE = "compare.json"
SHOWN = 6  # braces that are shown in brief
NONE = "none"  # the name under which the landings without a brace stand
INVERSION, INJURY = "peak_inversion_from_neutral_deg", "probability_of_injury"  # metrics


def called(brace: str) -> str:
    """A brace as people read it; NONE is the landings without one."""
    return "no brace" if brace == NONE else brace


@dataclass(frozen=True)
class MeanEstimate(Record):
    """The value of one landing, or the mean over several.

    value            in the unit of the metric's name
    ci_low, ci_high  95 % interval, of probability_of_injury that of the studies' questions; wider where pairs stopped
                     when they were decided: it holds however often one looked; None where the landings are no random
                     sample. Each holds by itself
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
    injury_shapes           the metric probability_of_injury for thresholds of the same mean and SD in other laws,
                            {"normal": ..., "lognormal": ..., "weibull": ...}; absent where no landing completed
    resistance_Nm           {posture: moment that resists it [N·m]}; None where it was not measured
    coupling_doubt_deg      how uncertain the peak of the foot is by the communication step, twice its change at half
                            the step; absent of a study, whose folders say in how many trials that is much
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
    injury_shapes: Mapping[str, float] | None = optional()
    resistance_Nm: Mapping[str, float] | None = None
    coupling_doubt_deg: float | None = optional()

    @property
    def completed(self) -> bool:
        return self.status == "completed"

    @property
    def injury_doubt(self) -> tuple[float, float] | None:
        """The least and the greatest probability of injury that a threshold of another law gives."""
        return ends_of(self.injury_shapes)

    def injury_doubt_against(self, other: BraceSummary | None) -> tuple[float, float] | None:
        """The same of its difference to that of `other`, with one threshold for both."""
        return None if other is None else ends_of(named_differences(self.injury_shapes, other.injury_shapes))


@dataclass(frozen=True)
class PairLook(Record):
    """One look at the paired differences of two braces.

    n                paired landings seen
    p_value          of Student's test that their mean difference is zero
    level            what it was compared with
    value            mean difference, in the unit of the response
    ci_low, ci_high  its interval at that level, which holds for all looks and pairs together
    """

    n: int
    p_value: float
    level: float
    value: float | None = None
    ci_low: float | None = None
    ci_high: float | None = None


@dataclass(frozen=True)
class DecidedPair(Record):
    """Which of two braces has the lower peak.

    lower, higher  names of braces; None while it is not decided
    n              paired landings that it took, or has taken so far
    looks          all that were made
    """

    lower: str | None = None
    higher: str | None = None
    n: int = 0
    looks: tuple[PairLook, ...] = ()


@dataclass(frozen=True)
class Decisions(Record):
    """What was decided about the pairs of braces, by a sequential test.

    response  whose mean is compared
    error     probability of any false decision, over all looks and pairs
    at_most   landings of each brace, and of none
    landed    landings that were made, those without a brace among them
    saved     landings that were not needed
    pairs     {"B - A": ...}
    """

    response: str
    error: float
    at_most: int
    landed: int
    saved: int
    pairs: Mapping[str, DecidedPair] = field(default_factory=dict)

    def lowest(self, names: Iterable[str]) -> str | None:
        """The brace that is decided to be lower than all others of `names`."""
        found = {(p.lower, p.higher) for p in self.pairs.values()}
        names = list(names)
        return next((a for a in names if all((a, b) in found for b in names if b != a)), None)


@dataclass(frozen=True)
class PersonBand(Record):
    """The landings of persons within a part of the range of a measure.

    low, high      ends of the part, in the measure's unit
    n              landings that completed with every brace
    metrics        {brace: {metric: mean over them}}
    mean           of the measure over them; None in a file that does not have it
    injury_shapes  {brace: {law: ...}}, the metric probability_of_injury as in BraceSummary
    """

    low: float
    high: float
    n: int
    metrics: Mapping[str, Estimates] = field(default_factory=dict)
    mean: float | None = None
    injury_shapes: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    @property
    def ends(self) -> tuple[str, str]:
        """With three figures, the last ones kept where they are 0."""
        low, high = (f"{end:#.3g}".rstrip(".") for end in (self.low, self.high))
        return low, high


@dataclass(frozen=True)
class WorstInput(Record):
    """An input in the worst tenth of a brace's landings.

    unit         "" where it has no dimension
    worst, rest  its mean there, and over the other landings, in the unit
    shift        their difference in standard deviations of the input, with Welch's 95 % interval
    """

    unit: str
    worst: float
    rest: float
    shift: MeanEstimate


@dataclass(frozen=True)
class WorstTenth(Record):
    """The tenth of a brace's landings in which the foot rolled farthest.

    n              landings in it
    above          all of them lie at or above this value of the metric that `Persons` names
    metrics        means over them, as estimates of those over the worst tenth of all landings there may be
    inputs         {"component.parameter": ...}, the largest shift first
    injury_shapes  {law: ...}, the metric probability_of_injury as in BraceSummary; None in a file that does not have it
    """

    n: int
    above: float
    metrics: Estimates = field(default_factory=dict)
    inputs: Mapping[str, WorstInput] = field(default_factory=dict)
    injury_shapes: Mapping[str, float] | None = optional()


@dataclass(frozen=True)
class Persons(Record):
    """For whom a brace works, of landings whose persons vary.

    response  by which landings are worst
    units     {measure: unit}
    bands     {measure: parts of its range with equal numbers of landings as far as those of one value stay together,
              ascending}; none of a measure that has no two such parts
    worst     {brace: ...}
    """

    response: str
    units: Mapping[str, str] = field(default_factory=dict)
    bands: Mapping[str, tuple[PersonBand, ...]] = field(default_factory=dict)
    worst: Mapping[str, WorstTenth] = field(default_factory=dict)


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class ComparisonSummary(Card, Summary):
    """Several braces on the same landings: content of compare.json, and what `compare --json` prints.

    format            of the file
    kind              "scenario", one landing for each brace, or "study"
    source, title     where the landings come from, and what they are
    initial_pose      of every landing; None for a plant that has no such choice
    method, seed      of a study's sample
    landings          for each brace; where pairs stopped when they were decided, at most
    injury            the event whose probability is the metric probability_of_injury, in words
    braces            {name: what it did}, "none" first
    pairs             {"B - A": the metrics of B minus those of A, over the landings that completed with both}
    persons           absent unless the persons who land vary
    decisions         absent unless pairs stopped when they were decided
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
    persons: Persons | None = optional()
    decisions: Decisions | None = optional()

    @property
    def count(self) -> str:
        """How many landings each brace made, in words."""
        if not self.is_study:
            return "one landing"
        return f"{'at most ' if self.decisions else ''}{self.landings} landings"

    def completion(self, brace: BraceSummary) -> str:
        """ "20 of 20": landings that completed, of those that were made."""
        if not brace.completed:
            return "failed"
        made = (brace.n_completed or 0) + (brace.n_failed or 0) if self.decisions else self.landings
        return f"{brace.n_completed} of {made}"

    def card(self) -> tuple[str, Rows]:
        rows = []
        for name, brace in list(self.braces.items())[:SHOWN]:
            change, peak = brace.difference_to_none.get(PEAK), brace.metrics.get(PEAK)
            what, e = ("changes the peak by", change) if change else ("peak", peak)
            text = f"{what} {with_interval(e.value, e.ci_low, e.ci_high, 'deg')}" if e else brace.status
            rows.append((name, text))
        rows += [("further braces", str(len(self.braces) - SHOWN))] if len(self.braces) > SHOWN else []
        failed = f"; failed: {', '.join(self.failed)}" if self.failed else ""
        return f"{self.title or self.source}, {self.count}", [
            ("status", f"{len(self.completed)} completed{failed}"),
            *rows,
        ]

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


@dataclass(frozen=True, repr=False)
class ComparisonFolder(Plottable):
    """Several braces on the same landings: the folder, compare.json, and {brace: its folder}."""

    path: Path
    summary: ComparisonSummary
    members: Mapping[str, RunFolder | StudyFolder]

    @property
    def title(self) -> str:
        return self.summary.title or self.path.name

    def card(self) -> tuple[str, Rows]:
        heading, rows = self.summary.card()
        return heading, [*rows, ("folder", str(self.path))]


def read_comparison_summary(folder: Path) -> ComparisonSummary:
    """Raises InputError when there is none, or one of a later version."""
    path = folder / FILE
    return ComparisonSummary.from_json(known_format(read_json(path), path), str(path))


def member_path(folder: Path, name: str) -> Path:
    """The folder of one brace. Raises InputError for a name that leads out of the comparison's folder."""
    if Path(name).name != name:
        raise InputError(f"{folder / FILE}: names {name!r}, which is no folder beside it")
    return folder / name
