"""For whom does a brace work: peak and probability by measures of the persons, and who is among the worst landings."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..folders.comparison import INJURY, INVERSION, Estimates, MeanEstimate, PersonBand, Persons, WorstInput, WorstTenth
from ..scenario.body import OWNER, SEX, is_of_subject
from ..subject.anthropometry import MASS, STATURE
from .estimates import injury_estimate, mean_estimate

if TYPE_CHECKING:
    import pandas as pd

    from ..uq.distributions import Array

SHOWN = (STATURE, MASS, "foot_length", "foot_breadth")
BANDS = 5
FEWEST = 20  # landings a band
TENTH = 0.1
NORMAL_95 = 1.959963984540054


def persons_of(
    landed: Mapping[str, pd.DataFrame], headings: Sequence[str], keys: Sequence[str], response: str, random: bool = True
) -> Persons | None:
    """Of the landings that completed with every brace. None where no persons vary, or too few landed.

    landed    {brace: one row a landing, indexed by trial, with the inputs}
    headings  the inputs, "component.parameter [unit]"
    keys      metrics that are averaged
    response  by which landings are worst
    random    they are independent draws, so that means have intervals
    """
    if not landed or not any(is_of_subject(heading) for heading in headings):
        return None
    common = sorted(set.intersection(*(set(rows.index) for rows in landed.values())))
    tables = {name: rows.loc[common] for name, rows in landed.items() if response in rows}
    if len(common) < 2 * FEWEST or not tables:
        return None
    inputs = next(iter(tables.values()))
    bands: dict[str, tuple[PersonBand, ...]] = {}
    units: dict[str, str] = {}
    for heading in headings:
        name, unit = _name_and_unit(heading)
        if name.removeprefix(OWNER) in SHOWN and is_of_subject(name) and np.ptp(inputs[heading]) > 0:
            units[name] = unit
            bands[name] = _bands(inputs[heading].to_numpy(float), tables, keys, random)
    worst = {name: _worst(rows, headings, keys, response, random) for name, rows in tables.items()}
    return Persons(response, units, bands, worst)


def _bands(
    measure: Array, tables: Mapping[str, pd.DataFrame], keys: Sequence[str], random: bool
) -> tuple[PersonBand, ...]:
    """Parts of the measure's range with equal numbers of landings."""
    count = min(BANDS, len(measure) // FEWEST)
    parts = np.array_split(np.argsort(measure, kind="stable"), count)
    return tuple(
        PersonBand(
            float(measure[rows].min()),
            float(measure[rows].max()),
            len(rows),
            {name: _means(table.iloc[rows], keys, random) for name, table in tables.items()},
            float(measure[rows].mean()),
        )
        for rows in parts
    )


def _means(rows: pd.DataFrame, keys: Sequence[str], random: bool) -> Estimates:
    found = {key: mean_estimate(rows[key].to_numpy(float), random) for key in keys if key in rows}
    if INJURY in found:
        found[INJURY] = injury_estimate(rows[INVERSION].to_numpy(float), random)
    return found


def _worst(rows: pd.DataFrame, headings: Sequence[str], keys: Sequence[str], response: str, random: bool) -> WorstTenth:
    n = max(2, math.ceil(TENTH * len(rows)))
    order = np.argsort(-rows[response].to_numpy(float), kind="stable")
    worst, rest = rows.iloc[order[:n]], rows.iloc[order[n:]]
    found: dict[str, WorstInput] = {}
    for heading in (h for h in headings if h in rows):  # a device of its own has other inputs
        name, unit = _name_and_unit(heading)
        one, other = worst[heading].to_numpy(float), rest[heading].to_numpy(float)
        sd = float(np.std(rows[heading].to_numpy(float), ddof=1))
        if sd > 0:
            shift = (one.mean() - other.mean()) / sd
            half = NORMAL_95 * math.sqrt(one.var(ddof=1) / len(one) + other.var(ddof=1) / len(other)) / sd
            ends = (float(shift - half), float(shift + half)) if random else (None, None)
            estimate = MeanEstimate(float(shift), ends[0], ends[1], n)
            found[name] = WorstInput(unit, float(one.mean()), float(other.mean()), estimate)
    ordered = sorted(found.items(), key=lambda item: -abs(item[1].shift.value or 0.0))
    return WorstTenth(n, float(worst[response].min()), _means(worst, keys, random), dict(ordered))


def _name_and_unit(heading: str) -> tuple[str, str]:
    name, _, unit = heading.partition(" [")
    return name, unit.rstrip("]")


def persons_listing(persons: Persons, metric: str, label: str, factor: float) -> list[str]:
    """Lines for the terminal: the metric by each measure, and what sets the worst tenth apart."""
    lines: list[str] = []
    for name, bands in persons.bands.items():
        unit = persons.units[name]
        braces = list(bands[0].metrics)
        width = max(16, *(len(b) + 2 for b in braces))
        title = f"{label} by {name.removeprefix(OWNER).replace('_', ' ')} [{unit}]"
        lines += ["", f"{title:44}" + "".join(f"{b:>{width}}" for b in braces)]
        for band in bands:
            cells = (_cell(band.metrics[b].get(metric), factor) for b in braces)
            row = f"  {' ... '.join(band.ends)}"
            lines.append(f"{row:44}" + "".join(f"{c:>{width}}" for c in cells))
    for brace, worst in persons.worst.items():
        told = ", ".join(_shifted(name, i.shift.value or 0.0) for name, i in list(worst.inputs.items())[:4])
        lines += [""] if brace == next(iter(persons.worst)) else []
        lines.append(f"worst tenth with {brace} ({label} from {factor * worst.above:.1f}): {told}")
    return lines


def _shifted(name: str, shift: float) -> str:
    if name == SEX:
        return f"more {'men' if shift > 0 else 'women'} ({shift:+.1f} SD)"
    return f"{name.partition('.')[2].replace('_', ' ')} {shift:+.1f} SD"


def _cell(e: MeanEstimate | None, factor: float) -> str:
    if e is None or e.value is None:
        return ""
    if not e.half_width:
        return f"{factor * e.value:.3g}"
    half = factor * e.half_width
    digits = max(0, 1 - math.floor(math.log10(half)))
    return f"{factor * e.value:.{digits}f} ± {half:.{digits}f}"
