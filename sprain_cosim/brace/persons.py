"""For whom does a brace work: peak and probability by measures of the persons, and who is among the worst landings."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..folders.comparison import INJURY, INVERSION, Estimates, MeanEstimate, PersonBand, Persons, WorstInput, WorstTenth
from ..scenario.body import OWNER, SEX, is_of_subject
from ..subject.anthropometry import MASS, STATURE
from ..uq import statistics
from .estimates import estimate, injury_estimate, injury_of_other_shapes, mean_estimate

if TYPE_CHECKING:
    import pandas as pd

    from ..uq.distributions import Array

SHOWN = (STATURE, MASS, "foot_length", "foot_breadth")
BANDS = 5
FEWEST = 20  # landings a band
TENTH = 0.1


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
        if name.removeprefix(OWNER) in SHOWN and is_of_subject(name):
            parts = _parts(inputs[heading].to_numpy(float))
            if len(parts) > 1:
                units[name] = unit
                bands[name] = _bands(inputs[heading].to_numpy(float), parts, tables, keys, random)
    worst = {name: _worst(rows, headings, keys, response, random) for name, rows in tables.items()}
    return Persons(response, units, bands, worst)


def _parts(measure: Array) -> list[NDArray[np.intp]]:
    """The rows of each part of the measure's range: equal numbers of landings, but those of one value stay together, so
    that no person is among the small and among the tall."""
    order = np.argsort(measure, kind="stable")
    ordered, n = measure[order], len(measure)
    borders = np.flatnonzero(np.diff(ordered)) + 1
    cuts = [0]
    for part in np.array_split(np.arange(n), min(BANDS, n // FEWEST))[1:]:
        near = borders[np.argmin(np.abs(borders - part[0]))] if len(borders) else n
        if min(near - cuts[-1], n - near) >= FEWEST:
            cuts.append(int(near))
    return np.split(order, cuts[1:])


def _bands(
    measure: Array,
    parts: Sequence[NDArray[np.intp]],
    tables: Mapping[str, pd.DataFrame],
    keys: Sequence[str],
    random: bool,
) -> tuple[PersonBand, ...]:
    return tuple(
        PersonBand(
            float(measure[rows].min()),
            float(measure[rows].max()),
            len(rows),
            {name: _means(table.iloc[rows], keys, random) for name, table in tables.items()},
            float(measure[rows].mean()),
            {name: _of_other_shapes(table.iloc[rows], keys) or {} for name, table in tables.items()},
        )
        for rows in parts
    )


def _means(rows: pd.DataFrame, keys: Sequence[str], random: bool) -> Estimates:
    found = {key: mean_estimate(rows[key].to_numpy(float), random) for key in keys if key in rows}
    if INJURY in found:
        found[INJURY] = injury_estimate(rows[INVERSION].to_numpy(float), random)
    return found


def _of_other_shapes(rows: pd.DataFrame, keys: Sequence[str]) -> dict[str, float] | None:
    return injury_of_other_shapes(rows[INVERSION].to_numpy(float)) if INJURY in keys and INJURY in rows else None


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
            shift = estimate(statistics.difference_of_means(one / sd, other / sd), n, random)
            found[name] = WorstInput(unit, float(one.mean()), float(other.mean()), shift)
    ordered = sorted(found.items(), key=lambda item: -abs(item[1].shift.value or 0.0))
    means = {key: _mean_of_worst(key, rows, response, n, random) for key in keys if key in rows}
    shapes = _of_other_shapes(worst, keys)
    return WorstTenth(n, float(worst[response].min()), means, dict(ordered), shapes)


def _mean_of_worst(key: str, rows: pd.DataFrame, response: str, n: int, random: bool) -> MeanEstimate:
    values, by = (rows[name].to_numpy(float) for name in (key, response))
    known = np.isfinite(values)
    if known.sum() < len(rows):  # the border lies elsewhere among those that are known
        return MeanEstimate(float(np.nanmean(values[np.argsort(-by, kind="stable")[:n]])), n=n)
    found = statistics.mean_of_largest(values, by, n)
    if key == INJURY:
        found = statistics.Estimate(found.value, max(found.low, 0.0), min(found.high, 1.0))
    return estimate(found, n, random)


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
        told = ", ".join(_shifted(name, i.shift) for name, i in list(worst.inputs.items())[:4])
        lines += [""] if brace == next(iter(persons.worst)) else []
        lines.append(f"worst tenth with {brace} ({label} from {factor * worst.above:z.1f}): {told}")
    return lines


def _shifted(name: str, shift: MeanEstimate) -> str:
    value = shift.value or 0.0
    text = f"{value:+z.1f}" + (f" ± {shift.half_width:.1f}" if shift.half_width else "") + " SD"
    if name == SEX:
        return f"more {'men' if value > 0 else 'women'} ({text})"
    return f"{name.partition('.')[2].replace('_', ' ')} {text}"


def _cell(e: MeanEstimate | None, factor: float) -> str:
    if e is None or e.value is None:
        return ""
    if not e.half_width:
        return f"{factor * e.value:.3g}"
    half = factor * e.half_width
    digits = max(0, 1 - math.floor(math.log10(half)))
    return f"{factor * e.value:.{digits}f} ± {half:.{digits}f}"
