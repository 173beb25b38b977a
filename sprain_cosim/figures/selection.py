"""What the figures and the report show of a set of folders: names of the series, samples, pearson_intervals, notes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, nearest
from ..folders.comparison import NONE, ComparisonFolder, called
from ..folders.read import Folder
from ..folders.run import RunFolder
from ..folders.study import PEAK, StudyFolder
from ..metrics import unit_of
from ..study.summary import LevelSearch
from ..units import unit
from ..uq import statistics
from .samples import Interval, Sample
from .style import PARAMETERS, SeriesLook, label, palette

LEVELS = (5.0, 50.0, 95.0)
FEWEST = 4  # completed trials for a distribution

Named = tuple[str, RunFolder | StudyFolder]


def named_folders(folders: Sequence[Folder]) -> list[Named]:
    """(name, run or study) of all, comparisons opened. The name is the title, with the initial pose where poses differ
    and the folder where titles do not."""
    items: list[Named] = []
    for folder in folders:
        if isinstance(folder, ComparisonFolder):
            items += [(called(brace), member) for brace, member in folder.members.items()]
        else:
            items.append((folder.title, folder))
    if len({item.pose for _, item in items}) > 1:
        items = [(f"{item.pose} pose · {name}" if item.pose else name, item) for name, item in items]
    names = [name for name, _ in items]
    return [(name if names.count(name) == 1 else f"{item.path.resolve().name} · {name}", item) for name, item in items]


def asking(folders: Sequence[Folder], response: str) -> list[Folder]:
    """The same folders, their studies about another `response`. Raises InputError where none of them has it."""
    known: dict[str, None] = {}

    def of(folder: Folder) -> Folder:
        if isinstance(folder, ComparisonFolder):
            members = {name: of(member) for name, member in folder.members.items()}
            return replace(folder, members=members)  # type: ignore[arg-type]
        if isinstance(folder, StudyFolder):
            known.update(dict.fromkeys(str(c) for c in folder.trials if unit_of(str(c)) and "." not in str(c)))
            if response in folder.trials:
                return replace(folder, file=replace(folder.file, responses=(response,)))
        return folder

    found = [of(folder) for folder in folders]
    if response not in known:
        close = nearest(response, list(known)) or "; `sprain-cosim list responses` names all"
        raise InputError(f"--response {response}: these folders have no such response{close}")
    return found


def palette_of(folders: Sequence[Folder]) -> dict[str, SeriesLook]:
    """{name of `named_folders`: its look}. Landings without a brace look alike wherever others have one."""
    items, compared = named_folders(folders), list[Folder | RunFolder | StudyFolder]()
    keys: list[str] = []  # in the order of the folders, braces that failed included, so that no colour moves up
    bare: set[str] = set()
    names = {id(item): name for name, item in items}
    for folder in folders:
        if isinstance(folder, ComparisonFolder):
            compared += folder.members.values()
            of_brace = {b: names.get(id(folder.members.get(b)), f"{folder.path}: {b}") for b in folder.summary.braces}
            keys += of_brace.values()
            bare |= {name for brace, name in of_brace.items() if brace == NONE}
        else:
            keys.append(names[id(folder)])
    alone = [name for name, item in items if not is_braced(item)]
    if len(alone) == 1 and len(items) > 1:
        bare |= set(alone)
    return palette(keys, bare)


def is_braced(item: RunFolder | StudyFolder) -> bool:
    return "brace" in (item.summary.fmus if isinstance(item, RunFolder) else item.manifest.fmus)


def sample_of(name: str, study: StudyFolder, response: str | None = None, with_published: bool = True) -> Sample:
    """A response of the study with everything known about it; of a search, its levels."""
    response = response or study.response
    published = published_levels(study, response) if with_published else {}
    search = study.summary.search
    if search is not None:
        found = search.levels if isinstance(search, LevelSearch) else {}
        levels = {float(k): (v.value,) * 3 for k, v in found.items() if v.value is not None}
        return Sample(name, percentiles=levels, published=published)
    values = study.done[response].dropna().to_numpy(float) if response in study.done else np.empty(0)
    low = high = None
    if len(values) >= FEWEST and study.summary.method in ("monte-carlo", "table"):
        bounds = statistics.empirical_cdf(values)
        index = np.searchsorted(bounds.value, np.sort(values))
        low, high = bounds.low[index], bounds.high[index]
    percentiles = {}
    if response in study.summary.responses:
        for key, p in study.summary.responses[response].percentiles.items():
            if p.value is not None:
                percentiles[float(key)] = as_interval(p.value, p.ci_low, p.ci_high)
    return Sample(name, values, low, high, percentiles, published, pearson_intervals(study, response))


def published_levels(study: StudyFolder, response: str) -> dict[float, float]:
    """{level [%]: value} that the study's file gives of the response."""
    figures = study.published if response == PEAK else {}
    return {level: float(figures[f"{level:g} % [deg]"]) for level in LEVELS if f"{level:g} % [deg]" in figures}


def pearson_intervals(study: StudyFolder, response: str) -> dict[str, Interval]:
    """{parameter: Pearson's r with the ends of its 95 % interval}."""
    if response not in study.summary.sensitivity:
        return {}
    inputs = study.summary.sensitivity[response].inputs
    return {
        name: as_interval(s.pearson.value, s.pearson.low, s.pearson.high)
        for name, s in inputs.items()
        if s.pearson.value is not None
    }


def spread_intervals(study: StudyFolder, response: str) -> dict[str, Interval]:
    """{parameter: dSD/dSD normalised, with the ends of its 95 % interval}, where it has one."""
    if response not in study.summary.sensitivity:
        return {}
    inputs = study.summary.sensitivity[response].inputs
    return {
        name: (s.dsd_dsd, *known)
        for name, s in inputs.items()
        if s.dsd_dsd is not None and (known := both_ends(s.ci.dsd_dsd)) is not None
    }


def same_question(one: StudyFolder, other: StudyFolder) -> bool:
    """Whether two studies ask for the same response of the same landings: pose, devices, scenario and marginals."""
    return (
        (one.pose, one.response) == (other.pose, other.response)
        and study_devices(one) == study_devices(other)
        and (one.file.scenario, one.file.marginals) == (other.file.scenario, other.file.marginals)
    )


def study_devices(study: StudyFolder) -> dict[str, str | None]:
    """{component: SHA-256 of its FMU}."""
    return {name: fmu.sha256 for name, fmu in study.manifest.fmus.items()}


def response_label(response: str) -> str:
    """ "peak subtalar angle [deg], + supination"."""
    name, _, sign = label(response).partition(", ")
    unit = unit_of(response)
    return name + (f" [{unit}]" if unit else "") + (f", {sign}" if sign else "")


def in_reader_units(column: str, values: NDArray[np.float64]) -> tuple[str, NDArray[np.float64], str]:
    """Of an input's column of trials.csv: its name with the unit it is read in, its values in that unit, what +
    means."""
    name, _, held = column.partition(" [")
    held, read = held.removesuffix("]"), PARAMETERS.get(name, ("", ""))[1]
    if held and read and unit(held).same_dimension(unit(read)):
        values, held = values * (unit(held).factor / unit(read).factor), read
    text, _, sign = label(name).partition(", + ")
    return text + (f" [{held}]" if held else ""), values, sign


def pose_note(items: Sequence[tuple[str, RunFolder | StudyFolder]]) -> str:
    """What stands below a figure: the initial pose."""
    poses = list(dict.fromkeys(item.pose for _, item in items if item.pose))
    if len(poses) > 1:
        return f"Initial poses {' and '.join(poses)}, as named."
    return f"Initial pose: {poses[0]}." if poses else ""


def as_interval(value: float, low: float | None, high: float | None) -> Interval:
    """An end that is not known is NaN: it is drawn nowhere, least of all at the value."""
    return value, math.nan if low is None else low, math.nan if high is None else high


def both_ends(pair: tuple[float | None, float | None] | None) -> tuple[float, float] | None:
    if pair is None or pair[0] is None or pair[1] is None:
        return None
    return pair[0], pair[1]
