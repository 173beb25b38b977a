"""The report's tables about persons: for whom each brace works, who is among the worst landings, person or posture."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from ..figures.style import PARAMETERS, label
from ..folders.comparison import INJURY, MeanEstimate, PersonBand, Persons, WorstInput, called
from ..folders.run import RunFolder, RunSummary
from ..folders.study import StudyFolder
from ..records import ends_of
from ..scenario.body import SEX, is_of_subject
from ..study.summary import VarianceShare
from ..subject.anthropometry import SEXES
from ..subject.person import Subject
from ..units import shown_unit, unit
from .blocks import Block, Cell, Heading, PageTable, Paragraph, Row, probability_cell, probability_doubts
from .words import ends, percent, rounded, signed

WORST_INPUTS = 6  # rows of each brace
OF_WORST = (
    "Worst tenth: the landings in which the foot inverted farthest. Shift: by how many standard deviations of the "
    "input their mean lies from that of the other landings. Small: 95 % intervals, each for its input alone: of twenty "
    "inputs that do nothing one leaves zero by chance."
)
OF_GROUPS = (
    "What each group of inputs explains of the response's variance by itself, by a polynomial of degree 1 or 2; the "
    "rest needs several groups together, or is not smooth. Groups that a study correlates count twice. "
    "Small: 95 % intervals."
)


def persons_tables(persons: Persons) -> list[Block]:
    blocks: list[Block] = [Heading("For whom does each brace work?"), _bands(persons)] if persons.bands else []
    for brace in persons.worst:
        blocks += [Heading(f"The worst tenth: {called(brace)}"), _worst(persons, brace)]
    return [*blocks, Paragraph(OF_WORST, "about")]


def persons_sentence(persons: Persons | None, brace: str) -> str:
    """The probability in the lowest and in the highest fifth of the measure that moves it most, where their intervals
    are apart, with its doubts; empty where nothing was estimated."""
    known = []
    for name, bands in persons.bands.items() if persons else ():
        found = [(b.metrics.get(brace, {}).get(INJURY), b) for b in (bands[0], bands[-1])]
        ends_of = [(e.value, e.ci_low, e.ci_high, b) for e, b in found if e is not None and e.value is not None]
        ends_of.sort(key=lambda end: end[0])
        if len(ends_of) == 2:
            (_, _, below, _), (_, above, _, _) = ends_of
            gap = -1.0 if above is None or below is None else above - below
            known.append((gap, name, ends_of))
    if not known or persons is None:
        return ""
    gap, name, ((least, _, _, few), (most, _, _, many)) = max(known, key=lambda entry: entry[0])
    if gap <= 0.0:
        return (
            f" With {brace} no measure of the persons moves that probability beyond its interval, between the persons "
            "who have least and most of it."
        )
    unit = persons.units[name]
    high, low = (
        f"{percent(p)} for {' to '.join(b.ends)} {unit}{_open(b, brace)}" for p, b in ((most, many), (least, few))
    )
    return f" With {brace} that probability depends on the {label(name)}: {high}, {low}."


def _open(band: PersonBand, brace: str) -> str:
    """What leaves the probability in a part of the persons open."""
    found = probability_doubts(band.metrics[brace][INJURY], ends_of(band.injury_shapes.get(brace)))
    return f" ({'; '.join(found)} %)" if found else ""


def _landed(summary: RunSummary) -> list[Row]:
    if summary.subject is None:
        return []
    rows: list[Row] = [["who lands", summary.subject.words]]
    if summary.estimates_doubt_deg is not None:
        open_left = f"± {summary.estimates_doubt_deg:.2g} deg of the peak supination (one standard deviation)"
        rows.append(["what is estimated of the body leaves open", open_left])
    return rows


def who_landed(item: RunFolder | StudyFolder) -> list[Row]:
    """Rows of the table of inputs: the subject, or the population of a study; none for the base person."""
    if isinstance(item, RunFolder):
        return _landed(item.summary)
    drawn = [str(column) for column in item.trials.columns if is_of_subject(str(column))]
    if not drawn:
        subject = item.manifest.identity.get("subject")
        return [["who lands", _subject_words(subject)]] if isinstance(subject, Mapping) else []
    values = item.done
    rows: list[Row] = []
    for column in drawn:
        name, _, unit = column.partition(" [")
        mean, sd = values[column].mean(), values[column].std()
        text = f"{mean:.4g} ± {sd:.3g} {unit.rstrip(']')} in these landings"
        if name == SEX:
            text = f"{int(values[column].sum())} of {len(values)} landings are of men"
        rows.append([Cell(PARAMETERS[name][0], name=name) if name in PARAMETERS else Cell(name, code=True), text])
    return rows


def _subject_words(subject: Mapping[str, Any]) -> str:
    """The subject of an identity in words."""
    inner = subject.get("Subject", {})
    measures = inner.get("measures", {}) if isinstance(inner, Mapping) else {}
    told = {str(name): value for name, value in measures.items() if isinstance(value, float)}
    return Subject(str(inner.get("sex")), told).words if inner.get("sex") in SEXES else ""


def _bands(persons: Persons) -> PageTable:
    braces = list(persons.worst)
    rows: list[Row] = []
    for name, bands in persons.bands.items():
        for band in bands:
            row: list[str | Cell] = [f"{label(name)} {' to '.join(band.ends)} {persons.units[name]}"]
            for brace in braces:
                found = band.metrics.get(brace, {})
                shapes = ends_of(band.injury_shapes.get(brace))
                row += [_mean(found.get(persons.response)), probability_cell(found.get(INJURY), shapes)]
            rows.append(row)
    heads = [f"{called(b)}: {what}" for b in braces for what in ("peak inversion [°]", "P(injury) [%]")]
    return PageTable(["persons", *heads], rows)


def _worst(persons: Persons, brace: str) -> PageTable:
    worst = persons.worst[brace]
    shown = list(worst.inputs.items())
    of_persons = [pair for pair in shown if pair[0] in persons.bands]
    chosen = dict([*shown[:WORST_INPUTS], *of_persons])
    rows: list[Row] = [
        [
            Cell(PARAMETERS[name][0], name=name) if name in PARAMETERS else Cell(name, code=True),
            *_read(name, i),
            Cell(signed(i.shift.value, 2), ends(i.shift.ci_low, i.shift.ci_high)),
        ]
        for name, i in chosen.items()
    ]
    return PageTable([f"{worst.n} landings from {worst.above:z.1f}°", "unit", "there", "elsewhere", "shift [SD]"], rows)


def _read(name: str, i: WorstInput) -> tuple[str, str, str]:
    """Unit and both means as people read them, with three figures of the larger: they may lie near each other."""
    factor, shown = shown_unit(i.unit)
    if name in PARAMETERS and i.unit:
        shown = PARAMETERS[name][1]
        factor = unit(i.unit).factor / unit(shown).factor if shown else 1.0
    worst, rest = factor * i.worst, factor * i.rest
    digits = max(0, 2 - math.floor(math.log10(max(abs(worst), abs(rest), 1e-9))))
    there, elsewhere = (f"{value + 0.0:.{digits}f}".replace("-", "−") for value in (worst, rest))
    return shown, there, elsewhere


def groups_table(studies: Mapping[str, tuple[str, Mapping[str, VarianceShare]]]) -> list[Block]:
    """Which group of inputs moves the response of each study, in a column each, of {name: (response, shares)}; nothing
    where no persons vary."""
    shares = {name: found for name, (_, found) in studies.items() if found}
    groups = dict.fromkeys(group for found in shares.values() for group in found)
    rows: list[Row] = [[group, *(_share(found.get(group)) for found in shares.values())] for group in groups]
    if not rows:
        return []
    responses = dict.fromkeys(label(studies[name][0]) for name in shares)
    of = f"share of the variance of {' and '.join(responses)}"
    heads = ["", *(f"{name}: {of}" if len(shares) == 1 else name for name in shares)]
    about = OF_GROUPS if len(shares) == 1 else f"{of[:1].upper()}{of[1:]}. {OF_GROUPS}"
    return [PageTable(heads, rows), Paragraph(about, "about")]


def _share(share: VarianceShare | None) -> str | Cell:
    if share is None:
        return ""
    return Cell(_whole(share.value), tuple(_whole_ends(share.ci_low, share.ci_high)))


def _whole(share: float | None) -> str:
    return "" if share is None else f"{100 * share:z.0f} %".replace("-", "−")


def _whole_ends(low: float | None, high: float | None) -> list[str]:
    return [] if low is None or high is None else [f"{100 * low:z.0f} … {100 * high:z.0f} %".replace("-", "−")]


def _mean(e: MeanEstimate | None) -> str | Cell:
    return "" if e is None or e.value is None else Cell(rounded(e.value), ends(e.ci_low, e.ci_high))
