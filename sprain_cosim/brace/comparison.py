"""What a comparison says: the metrics of each brace, paired differences, and the table that `compare` prints."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..folders.comparison import (
    INJURY,
    INVERSION,
    NONE,
    BraceSummary,
    ComparisonSummary,
    Decisions,
    Estimates,
    MeanEstimate,
    Persons,
)
from ..literature import INJURY_INVERSION_TEXT
from ..scenario import Scenario
from ..scenario.postures import POSTURES
from ..study.questions import QUESTIONS
from ..study.study import Study
from ..uq.sequential import spent
from .estimates import THRESHOLD, injury_change, injury_estimate, injury_of_other_shapes, mean_estimate
from .persons import persons_listing, persons_of

if TYPE_CHECKING:
    import pandas as pd

PEAKS = ("peak_subtalar_angle_deg", INVERSION, "peak_jcs_inversion_deg")
SHARE = "anatomy_share"
MOMENTS = ("anatomy_subtalar_moment_Nm", "brace_subtalar_moment_Nm")  # at the peak
KEYS = (
    *PEAKS,
    INJURY,
    "peak_brace_subtalar_moment_Nm",
    "brace_subtalar_work_to_peak_J",
    "brace_work_J",
    *MOMENTS,
    SHARE,
)
LINES: tuple[tuple[str, str, float], ...] = (  # label, metric, factor
    ("peak supination [deg]", "peak_subtalar_angle_deg", 1.0),
    ("peak inversion from neutral [deg]", INVERSION, 1.0),
    ("peak inversion, raw angle [deg]", "peak_jcs_inversion_deg", 1.0),
    (f"P(inversion from neutral > {INJURY_INVERSION_TEXT} deg) [%]", INJURY, 100.0),
    ("largest moment of the brace [N·m]", "peak_brace_subtalar_moment_Nm", 1.0),
    ("work it takes from the roll, to the peak [J]", "brace_subtalar_work_to_peak_J", 1.0),
    ("work it takes, all axes, whole landing [J]", "brace_work_J", 1.0),
    ("at the peak: moment of the anatomy [N·m]", "anatomy_subtalar_moment_Nm", 1.0),
    ("             moment of the brace [N·m]", "brace_subtalar_moment_Nm", 1.0),
    ("             borne by the anatomy [%]", SHARE, 100.0),
)
CHANGED = (*PEAKS[:2], INJURY)  # the raw angle changes as the one from neutral does
RANDOM = ("monte-carlo", "table")  # methods whose landings are independent draws
PAIRED = 6  # pairs that are printed; compare.json has all

Source = Scenario | Study


@dataclass(frozen=True)
class Entry:
    """What one brace did.

    name            of the brace; "none" for the landings without one
    fmu             file or name as it was typed; None without a brace
    status          completed or failed
    message         why it failed
    landings        one row a landing: trial, status, metrics and what is derived from them; None when it failed
    resistance      {posture: moment that resists it [N·m]}; None where it was not measured
    warnings        about the device, one line each
    coupling_doubt  how uncertain the peak of a single landing is by the communication step [deg]; None where that is
                    not known
    """

    name: str
    fmu: str | None
    status: str = "completed"
    message: str = ""
    landings: pd.DataFrame | None = None
    resistance: Mapping[str, float] | None = None
    warnings: tuple[str, ...] = ()
    coupling_doubt: float | None = None

    @property
    def completed(self) -> pd.DataFrame:
        """The landings that completed; of an entry that did not fail."""
        assert self.landings is not None
        return self.landings[self.landings["status"] == "completed"]


def with_derived(landings: pd.DataFrame) -> pd.DataFrame:
    """The landings with the share of the subtalar moment that the anatomy bears at the peak, and the probability that
    the inversion exceeds the injury threshold, itself uncertain, in that landing."""
    more = {}
    if INVERSION in landings:
        more[INJURY] = THRESHOLD.cdf(landings[INVERSION].to_numpy(float))
    if MOMENTS[1] in landings:
        anatomy, brace = (landings[key] for key in MOMENTS)
        more[SHARE] = (anatomy / (anatomy + brace)).where(anatomy + brace > 0)
    return landings.assign(**more)


def summarise_comparison(
    source: Source, entries: Sequence[Entry], looks: Sequence[int] = (), decisions: Decisions | None = None
) -> ComparisonSummary:
    """Every estimate is the landing's value, or the mean over the landings that completed, with its 95 % interval (the
    probability of injury with that of a study's question) where they are a random sample. Differences are over
    the landings that completed with both. Where braces stopped at one of several `looks` (numbers of landings), an
    interval is at the level of that look, so that it holds for all."""
    study = source if isinstance(source, Study) else None
    scenario = source.scenario if isinstance(source, Study) else source
    landed = _Landed(
        {e.name: e.completed.set_index("trial") for e in entries if e.landings is not None},
        study is not None and study.method in RANDOM,
        {e.name: spent(bisect_left(looks, len(e.landings)) + 1) for e in entries if e.landings is not None}
        if looks
        else {},
    )
    names = [n for n in landed.completed if n != NONE]
    return ComparisonSummary(
        kind="scenario" if study is None else "study",
        source=source.source,
        title=source.heading_of_braces,
        initial_pose=scenario.initial_pose(),
        method=None if study is None else study.method,
        seed=None if study is None else study.seed,
        landings=1 if study is None else study.trials,
        injury=f"inversion from neutral {QUESTIONS[INVERSION][0]}",
        braces={e.name: landed.summary(e) for e in entries},
        pairs={f"{b} - {a}": landed.difference(b, a) for i, a in enumerate(names) for b in names[i + 1 :]},
        persons=None if study is None or looks else landed.persons(study.headings),
        decisions=decisions,
    )


@dataclass(frozen=True)
class _Landed:
    """The landings that completed.

    completed  {brace: one row a landing, indexed by trial}; only braces that did not fail
    random     they are a random sample
    levels     {brace: error of its intervals}; 5 % for all where it is empty
    """

    completed: Mapping[str, pd.DataFrame]
    random: bool
    levels: Mapping[str, float]

    def persons(self, headings: Sequence[str]) -> Persons | None:
        """For whom each brace works, by the inputs of the landings."""
        return persons_of(self.completed, headings, (*PEAKS[:2], INJURY), INVERSION, self.random)

    def summary(self, entry: Entry) -> BraceSummary:
        rows = self.completed.get(entry.name)
        failed = None if rows is None or entry.landings is None else len(entry.landings) - len(rows)
        return BraceSummary(
            fmu=entry.fmu,
            status=entry.status,
            message=entry.message,
            warnings=entry.warnings,
            folder=entry.name,
            n_completed=0 if rows is None else len(rows),
            n_failed=failed,
            metrics={} if rows is None else self._metrics(entry.name, rows, failed or 0),
            difference_to_none=self.difference(entry.name, NONE),
            injury_shapes=None
            if rows is None or INVERSION not in rows
            else injury_of_other_shapes(rows[INVERSION].to_numpy(float)),
            resistance_Nm=None if entry.resistance is None else dict(entry.resistance),
            coupling_doubt_deg=entry.coupling_doubt,
        )

    def difference(self, a: str, b: str) -> Estimates:
        """The metrics of `a` minus those of `b`; empty where one of them did not land, or both are the same."""
        if a == b or a not in self.completed or b not in self.completed:
            return {}
        one, other = self.completed[a], self.completed[b]
        both = one.index.intersection(other.index)
        keys = [k for k in KEYS if k in one and k in other]
        found = {k: self._estimate((one.loc[both, k] - other.loc[both, k]).to_numpy(float), a, b) for k in keys}
        if INJURY in found:
            peaks, others = (rows.loc[both, INVERSION].to_numpy(float) for rows in (one, other))
            found[INJURY] = injury_change(peaks, others, self.random, self._error(a, b))
        return found

    def _metrics(self, name: str, rows: pd.DataFrame, failed: int) -> Estimates:
        found = {k: self._estimate(rows[k].to_numpy(float), name) for k in KEYS if k in rows}
        if INJURY in found:
            found[INJURY] = injury_estimate(rows[INVERSION].to_numpy(float), self.random, self._error(name), failed)
        return found

    def _estimate(self, y: NDArray[np.float64], *names: str) -> MeanEstimate:
        return mean_estimate(y, self.random, self._error(*names))

    def _error(self, *names: str) -> float:
        """Of an interval over the landings that these braces share: they share the fewer."""
        return max(self.levels.get(name, 0.05) for name in names)


def postures() -> list[str]:
    """The motions in which a brace is held, such as "plantarflexion", each at 5 and 10 degrees."""
    return list(dict.fromkeys(posture.rpartition("_")[0] for posture in POSTURES))


def comparison_listing(summary: ComparisonSummary) -> str:
    """The table that `compare` prints: one column a brace."""
    braces = summary.braces
    width = max(18, *(len(n) + 2 for n in braces))
    lines = [*_heading(summary), "", f"{'':44}" + "".join(f"{n:>{width}}" for n in braces)]
    for label, cells in _rows(summary):
        if any(cells):
            lines.append(f"{label:44}" + "".join(f"{c:>{width}}" for c in cells).rstrip())
    if summary.decisions is not None:
        lines += ["", *_decided(summary.decisions)]
    elif 0 < len(summary.pairs) <= PAIRED:
        lines += ["", f"{'':44}{'peak supination [deg]':>{width + 8}}{'inversion [deg]':>{width}}"]
        for pair, d in summary.pairs.items():
            supination, inversion = (_cell(d.get(peak), 1.0, sign=True) for peak in PEAKS[:2])
            lines.append(f"{pair:44}{supination:>{width + 8}}{inversion:>{width}}")
    if summary.persons is not None:
        lines += persons_listing(summary.persons, INVERSION, "peak inversion [deg]", 1.0)
    lines += [f"\n{n}: failed: {b.message}" for n, b in summary.failed.items()]
    return "\n".join(lines)


def _rows(summary: ComparisonSummary) -> Iterator[tuple[str, list[str]]]:
    """Label and cells, one a brace; empty cells where nothing is known."""
    braces = summary.braces.values()
    for label, key, factor in LINES:
        yield label, [_cell(b.metrics.get(key), factor, half=key != INJURY) for b in braces]
        if key == PEAKS[0]:
            yield "    doubt of the step", ["" if (d := b.coupling_doubt_deg) is None else f"± {d:.2g}" for b in braces]
        if key == INJURY:
            yield "    as far as the landings know it", [_between(_ends_of(b.metrics)) for b in braces]
            yield "    for a threshold of another shape", [_between(b.injury_doubt) for b in braces]
        if key in CHANGED:
            yield (
                "    change against none",
                [_cell(b.difference_to_none.get(key), factor, sign=True, half=key != INJURY) for b in braces],
            )
        if key == INJURY:
            bare = summary.braces.get(NONE)
            yield "        as far as the landings know it", [_between(_ends_of(b.difference_to_none)) for b in braces]
            against = [None if b is bare else b.injury_doubt_against(bare) for b in braces]
            yield "        for a threshold of another shape", [_between(ends) for ends in against]
    for motion in postures():
        yield f"resists {motion} of 5 / 10 deg [N·m]", [_held(b, motion) for b in braces]
    yield "landings completed", [summary.completion(b) for b in braces]


def _decided(found: Decisions) -> list[str]:
    """What was decided about each pair, and how many landings that saved."""
    lines = [f"lower peak supination, decided with an error of {100 * found.error:g} % over all looks and pairs:"]
    for pair, d in found.pairs.items():
        if not d.looks:
            continue
        look = d.looks[-1]
        ends = _ends(look.ci_low, look.ci_high)
        if d.lower is None:
            said = f"{pair}: undecided after {d.n} paired landings; difference {_number(look.value)} deg ({ends})"
        else:
            size = None if look.value is None else abs(look.value)
            if look.value is not None and look.value < 0.0:
                ends = _ends(look.ci_high, look.ci_low, -1.0)
            said = f"{d.lower} below {d.higher}: decided after {d.n} paired landings; {_number(size)} deg ({ends})"
        lines.append(f"  {said}")
    made = found.landed + found.saved
    return [*lines, f"{found.landed} landings made, {found.saved} of {made} saved"]


def _heading(summary: ComparisonSummary) -> list[str]:
    pose = f"pose {summary.initial_pose}, " if summary.initial_pose else ""
    lines = [f"{summary.source}  ·  {pose}{summary.count}, the same for every brace"]
    if summary.has_intervals:
        lines.append("mean ± half of its 95 % interval; changes are paired")
        if summary.decisions is not None:
            lines[-1] += "; a column is over its own landings, its interval holds however often one looked"
        elif len(summary.pairs) > 1:
            together = max(100 - 5 * len(summary.pairs), 0)
            lines.append(
                f"each by itself: the {len(summary.pairs)} differences of braces all hold with {together} % at the "
                "least; --decide keeps 95 % for all"
            )
    elif summary.is_study:
        lines.append("means; changes are paired")
    return lines


def _cell(estimate: MeanEstimate | None, factor: float, sign: bool = False, half: bool = True) -> str:
    """`half`: with half of its interval."""
    if estimate is None or estimate.value is None:
        return ""
    after = "" if estimate.half_width is None or not half else f" ± {factor * estimate.half_width:.2f}"
    return f"{factor * estimate.value:{'+' if sign else ''}.2f}{after}"


def _ends_of(found: Estimates) -> tuple[float, float] | None:
    """The interval of the probability of injury, or of its change."""
    e = found.get(INJURY)
    return None if e is None or e.ci_low is None or e.ci_high is None else (e.ci_low, e.ci_high)


def _between(shares: tuple[float, float] | None) -> str:
    """In percent."""
    return "" if shares is None else " ... ".join(f"{100.0 * share:.2g}" for share in shares)


def _number(value: float | None) -> str:
    return "?" if value is None else f"{value:z.2f}"


def _ends(low: float | None, high: float | None, factor: float = 1.0) -> str:
    return " ... ".join(_number(None if v is None else factor * v) for v in (low, high))


def _held(brace: BraceSummary, motion: str) -> str:
    held = brace.resistance_Nm
    return f"{_small(held.get(f'{motion}_5deg'))} / {_small(held.get(f'{motion}_10deg'))}" if held else ""


def _small(value: float | None) -> str:
    return "?" if value is None else f"{0.0 if abs(value) < 5e-3 else value:.2f}"
