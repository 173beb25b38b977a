"""Which figures a set of result folders allows, from what the folders hold: nothing is simulated."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from .. import figures as plots
from ..cosim.result import Result
from ..errors import EnvironmentProblem, InputError
from ..folders import run as runfolder
from ..folders.read import Comparison, Folder, Run, StudyFolder
from ..metrics import brace_torques, unit_of
from ..uq import statistics
from . import Sample

REFERENCE = "SPRAIN_REFERENCE"
LEVELS = (5.0, 50.0, 95.0)
FEWEST = 4  # completed trials for a distribution
FAN = 20  # trajectories for a fan


@dataclass(frozen=True)
class Drawn:
    """A figure with the name of its file, a title and a caption in words."""

    name: str
    title: str
    caption: str
    figure: Figure


def flat(folders: Sequence[Folder]) -> list[tuple[str, Run | StudyFolder]]:
    """(name, run or study) of all, comparisons opened. The name is the title, with the initial pose where poses differ
    and the folder where titles do not."""
    items: list[tuple[str, Run | StudyFolder]] = []
    for folder in folders:
        if isinstance(folder, Comparison):
            items += [("no brace" if brace == "none" else brace, member) for brace, member in folder.members.items()]
        else:
            items.append((folder.title, folder))
    if len({item.pose for _, item in items}) > 1:
        items = [(f"{item.pose} pose · {name}" if item.pose else name, item) for name, item in items]
    names = [name for name, _ in items]
    return [(name if names.count(name) == 1 else f"{item.path.resolve().name} · {name}", item) for name, item in items]


def landing_picture(result: Result, summary: Mapping[str, Any]) -> bytes:
    """The content of landing.png in a run's folder, whose summary.json holds `summary`."""
    return plots.picture(plots.landing([(str(summary["title"]), result)], runfolder.note([summary])), "png")


def draw(folders: Sequence[Folder]) -> Iterator[Drawn]:
    """One figure after the other, those that answer the first questions first."""
    items = flat(folders)
    runs = [(name, item) for name, item in items if isinstance(item, Run)]
    studies = [(name, item) for name, item in items if isinstance(item, StudyFolder)]
    if runs:
        for name, run in runs:
            if "plant.subtalar_angle" not in run.result.index:
                raise InputError(f"{run.path}: {name} has no plant.subtalar_angle; there is no landing to draw")
        yield from _of_runs(runs)
    if studies:
        yield from _of_studies(studies)
    yield from _phase(runs, studies)
    rows = [
        (name, np.atleast_1d(anatomy), np.atleast_1d(brace))
        for name, item in items
        for anatomy, brace in [_moments(item)]
        if anatomy is not None and brace is not None
    ]
    if rows:
        caption = (
            "Resisting moment about the subtalar axis at the time of its peak angle: what the passive tissue "
            "bears, and what the brace takes."
        )
        yield Drawn("sharing", "Who bears the load", caption, plots.sharing(rows, _note(items)))
    caption = (
        "Torque-angle laws of the paper's passive ankle and of its braces (the same law with the angle scaled), about "
        "the three body-fixed axes. "
        "For comparison with Figures 1C and 2 of Yoder et al. 2021."
    )
    yield Drawn("torque_angle", "Torque-angle laws of ankle and brace", caption, plots.torque_angle())


def write(folders: Sequence[Folder], out: Path) -> list[Path]:
    """All figures as PNG and SVG in `out`/figures."""
    target, written = out / "figures", list[Path]()
    try:
        for drawn in draw(folders):
            target.mkdir(parents=True, exist_ok=True)
            written += plots.save(drawn.figure, target / drawn.name)
    except OSError as problem:
        raise EnvironmentProblem(f"{target}: cannot be written: {problem.strerror or problem}") from None
    return written


def sample(name: str, study: StudyFolder, response: str | None = None) -> Sample:
    """A response of the study with everything known about it; of a search, its levels."""
    response = response or study.response
    first = study.published if response == "peak_subtalar_angle_deg" else {}
    published = {level: float(first[f"{level:g} % [deg]"]) for level in LEVELS if f"{level:g} % [deg]" in first}
    if study.search is not None:
        levels = {float(k): (float(v["value"]),) * 3 for k, v in study.search.get("levels", {}).items()}
        return Sample(name, percentiles=levels, published=published)
    values = study.done[response].dropna().to_numpy(float) if response in study.done else np.empty(0)
    low = high = None
    if len(values) >= FEWEST and study.head["method"] in ("monte-carlo", "table"):
        bounds = statistics.empirical_cdf(values)
        index = np.searchsorted(bounds.value, np.sort(values))
        low, high = bounds.low[index], bounds.high[index]
    given = study.head.get("responses", {}).get(response, {}).get("percentiles", {})
    percentiles = {
        float(k): (float(v["value"]), _or(v.get("ci_low"), v["value"]), _or(v.get("ci_high"), v["value"]))
        for k, v in given.items()
    }
    return Sample(name, values, low, high, percentiles, published, pearson(study, response))


def pearson(study: StudyFolder, response: str) -> dict[str, tuple[float, float, float]]:
    """{parameter: (r, low, high)}."""
    table = study.head.get("sensitivity", {}).get(response, {})
    found = {name: row.get("pearson", {}) for name, row in table.items() if not name.startswith("_")}
    return {
        n: (float(r["value"]), _or(r.get("low"), r["value"]), _or(r.get("high"), r["value"]))
        for n, r in found.items()
        if r.get("value") is not None
    }


def spread(study: StudyFolder, response: str) -> dict[str, tuple[float, float, float]]:
    """{parameter: (dSD/dSD normalised, ends of its 95 % interval)}."""
    found = {}
    for name, row in study.head.get("sensitivity", {}).get(response, {}).items():
        value = None if name.startswith("_") else row.get("dsd_dsd")
        if value is not None:
            half = 1.96 * (row.get("standard_error", {}).get("dsd_dsd") or 0.0)
            low, high = (row.get("ci") or {}).get("dsd_dsd") or (value - half, value + half)
            found[name] = (float(value), _or(low, value), _or(high, value))
    return found


def quantity(response: str) -> str:
    """ "peak subtalar angle [deg], + supination"."""
    name, _, sign = plots.label(response).partition(", ")
    unit = unit_of(response)
    return name + (f" [{unit}]" if unit else "") + (f", {sign}" if sign else "")


def _or(value: Any, other: float) -> float:
    return float(other if value is None else value)


def _end(study: StudyFolder, of: int) -> str:
    """What a file name ends in that stands for one study of several."""
    return "" if of == 1 else "_" + re.sub(r"[^\w.-]", "_", study.path.resolve().name)


def _note(items: Sequence[tuple[str, Run | StudyFolder]]) -> str:
    poses = list(dict.fromkeys(item.pose for _, item in items if item.pose))
    if len(poses) > 1:
        return f"Initial poses {' and '.join(poses)}, as named."
    return f"Initial pose: {poses[0]}." if poses else ""


def _of_runs(runs: Sequence[tuple[str, Run]]) -> Iterator[Drawn]:
    overlaid = [(name, run.result) for name, run in runs]
    note = runfolder.note([dict(run.head) for _, run in runs])
    caption = "Each landing from contact on; the dot marks the peak of supination."
    yield Drawn("landing", "The landing over time", caption, plots.landing(overlaid, note))
    caption = (
        "The path each landing took: a loop means that the moment depends on more than this angle (speed, the "
        "other axes, coupling)."
    )
    yield Drawn("moment_angle", "Moment over angle", caption, plots.moment_angle(overlaid, note))


def _of_studies(studies: Sequence[tuple[str, StudyFolder]]) -> Iterator[Drawn]:
    samples = {name: sample(name, study) for name, study in studies}
    distributions = [
        (name, study) for name, study in studies if study.is_sample and len(samples[name].values) >= FEWEST
    ]
    for response in dict.fromkeys(study.response for _, study in distributions):
        chosen = [(name, study) for name, study in distributions if study.response == response]
        suffix = "" if response == distributions[0][1].response else f"_{response}"
        text = quantity(response)
        caption = (
            "Share of landings whose peak stays below the value. Circles: the published levels, where the study "
            "is one of the paper's in its pose."
        )
        yield Drawn(
            f"cdf{suffix}", "Distribution", caption, plots.cdf([samples[n] for n, _ in chosen], text, _note(chosen))
        )
        with_levels = [(n, s) for n, s in chosen if samples[n].percentiles]
        if len(with_levels) > 1:
            caption = "The 5, 50 and 95 % levels with their 95 % intervals."
            yield Drawn(
                f"percentiles{suffix}",
                "Levels side by side",
                caption,
                plots.percentiles([samples[n] for n, _ in with_levels], text, _note(with_levels)),
            )
        yield from _poses(chosen, samples, text, suffix)
    yield from _searches(studies, distributions, samples)
    for name, study in distributions:
        sensitivity = pearson(study, study.response)
        if sensitivity:
            end = _end(study, len(distributions))
            r = study.published.get("pearson", {}) if study.response == "peak_subtalar_angle_deg" else {}
            caption = (
                "What moves the response (Pearson's r) and what widens it (normalised sensitivity of its "
                "standard deviation), with 95 % intervals."
            )
            drawn = plots.tornado(
                sensitivity, spread(study, study.response), name, quantity(study.response), r, _note([(name, study)])
            )
            yield Drawn(f"tornado{end}", f"Sensitivities: {name}", caption, drawn)
    yield from _grids(studies)
    yield from _fans([(name, study) for name, study in studies if study.is_sample])
    yield from _published(distributions)


def _poses(
    chosen: Sequence[tuple[str, StudyFolder]], samples: Mapping[str, Sample], text: str, suffix: str
) -> Iterator[Drawn]:
    """Studies with the same marginals that start in different poses."""
    for k, group in enumerate(
        _groups(chosen, lambda s: (s.file.get("scenario"), s.file.get("marginals"), _devices(s)))
    ):
        pairs = {study.pose: samples[name] for name, study in group if study.pose}
        if len(pairs) > 1:
            caption = (
                "The published pose starts with the foot inside the floor, as the paper's records do; the touching "
                "pose starts with the foot just touching. "
                "The pose moves the level of the response and can turn the sign of a sensitivity."
            )
            title = "Initial poses side by side"
            yield Drawn(f"poses{suffix}{k or ''}", title, caption, plots.poses(list(pairs.items()), text, _note(group)))


def _searches(
    studies: Sequence[tuple[str, StudyFolder]],
    distributions: Sequence[tuple[str, StudyFolder]],
    samples: Mapping[str, Sample],
) -> Iterator[Drawn]:
    found = [(name, study) for name, study in studies if study.search and study.search.get("levels")]
    for name, study in found:
        beside = next((samples[n] for n, s in distributions if _same_question(s, study)), None)
        levels = study.search["levels"] if study.search else {}
        importance = {level: {k: float(v) for k, v in row["importance"].items()} for level, row in levels.items()}
        end = _end(study, len(found))
        note = f"{_note([(name, study)])} Gate of the method: {study.search['status'] if study.search else ''}."
        caption = (
            "Levels of the response found with few landings, on the distribution of the Monte Carlo study if "
            "there is one; which input leads to each."
        )
        yield Drawn(
            f"amv{end}",
            f"{name}",
            caption,
            plots.amv(samples[name], importance, quantity(study.response), beside, note),
        )


def _same_question(one: StudyFolder, other: StudyFolder) -> bool:
    keys = ("scenario", "marginals")
    return one.pose == other.pose and one.response == other.response and _devices(one) == _devices(other) and all(
        one.file.get(k) == other.file.get(k) for k in keys
    )  # fmt: skip


def _devices(study: StudyFolder) -> Any:
    return {name: fmu.get("sha256") for name, fmu in study.manifest.get("fmus", {}).items() if isinstance(fmu, dict)}


def _groups(chosen: Sequence[tuple[str, StudyFolder]], key: Any) -> list[list[tuple[str, StudyFolder]]]:
    groups: list[tuple[Any, list[tuple[str, StudyFolder]]]] = []
    for item in chosen:
        known = next((members for k, members in groups if k == key(item[1])), None)
        if known is None:
            groups.append((key(item[1]), [item]))
        else:
            known.append(item)
    return [members for _, members in groups]


def _grids(studies: Sequence[tuple[str, StudyFolder]]) -> Iterator[Drawn]:
    """Grids of one or two parameters: the first along the axis, a line for each level of the second."""
    for name, study in studies:
        columns = {str(c).partition(" [")[0]: str(c) for c in study.done}
        axes = [columns[p] for p in study.file.get("grid", {}) if p in columns]
        if study.head["method"] != "grid" or not 1 <= len(axes) <= 2 or study.response not in study.done:
            continue
        done, rows = study.done.sort_values(axes[0]), []
        levels = np.unique(done[axes[0]])
        for level, part in done.groupby(axes[1]) if len(axes) == 2 else [("", done)]:
            if len(part) == len(levels):
                title = f"{_with_unit(axes[1])} = {level:g}" if len(axes) == 2 else name
                rows.append((title, part[study.response].to_numpy(float)))
        if rows:
            end = _end(study, sum(s.head["method"] == "grid" for _, s in studies))
            drawn = plots.grid(levels, rows, _with_unit(axes[0]), quantity(study.response), _note([(name, study)]))
            yield Drawn(
                f"grid{end}",
                name,
                "The response at the points of the grid. A grid is no sample: no probability is in it.",
                drawn,
            )


def _with_unit(column: str) -> str:
    name, bracket, unit = column.partition(" [")
    return plots.label(name) + bracket + unit


def _fans(studies: Sequence[tuple[str, StudyFolder]]) -> Iterator[Drawn]:
    groups = []
    for name, study in studies:
        # only the first trials are a fair sample: the others were kept because they are extreme
        first = (study.head.get("trajectories") or {}).get("first", 0)
        chosen = [trial for trial in study.trajectories if trial < (first or 0)]
        done = set(study.done["trial"])
        chosen = [trial for trial in chosen if trial in done]
        if len(chosen) >= FAN:
            records = [study.trajectory(trial) for trial in chosen]
            time = records[0].time
            records = [r for r in records if len(r.time) == len(time)]
            signals = {
                s: np.array([r[s] for r in records]) for _, s, _ in plots.PANELS if all(s in r.index for r in records)
            }
            if not brace_torques(records[0]):
                signals.pop("plant.brace_subtalar_moment", None)
            groups.append((f"{name}, {len(records)} landings", time, signals))
    for k in range(0, len(groups), 3):
        caption = "Percentiles at each moment over the trials whose signals were kept: a band is no landing of its own."
        yield Drawn(
            f"fan{k // 3 or ''}", "Many landings over time", caption, plots.fan(groups[k : k + 3], _note(studies))
        )


def _phase(runs: Sequence[tuple[str, Run]], studies: Sequence[tuple[str, StudyFolder]]) -> Iterator[Drawn]:
    degrees = plots.DEGREES
    tracks = [
        (name, degrees * run.result["plant.inversion_angle"], degrees * run.result["plant.inversion_velocity"])
        for name, run in runs
        if "plant.inversion_angle" in run.result.index
    ]
    columns = ["peak_inversion_from_neutral_deg", "peak_jcs_inversion_velocity_deg_s"]
    points = []
    for name, study in studies:
        median = (study.head.get("trajectories") or {}).get("p50")
        if study.is_sample and all(c in study.done for c in columns):
            both = study.done[columns].dropna().to_numpy(float)
            points.append((name, both[:, 0], both[:, 1]))
        if study.is_sample and median is not None and median in study.trajectories and len(studies) <= 2:
            record = study.trajectory(median)
            if "plant.inversion_angle" in record.index:
                tracks.append(
                    (name, degrees * record["plant.inversion_angle"], degrees * record["plant.inversion_velocity"])
                )
    if tracks or points:
        caption = (
            "Inversion of the joint coordinate system, zero at the model's neutral pose (the paper's Table 3 is 10° "
            "lower: raw angles). Ankles of cadavers "
            "failed in the grey range. Li et al. measured two people on a 25° slope, with their laboratory's zero, "
            "which may differ by some degrees; the model "
            "lands on the slope of its scenario. A study's line is its median trial. The threshold of a living ankle "
            "is not known."
        )
        yield Drawn(
            "phase",
            "Inversion against measured sprains",
            caption,
            plots.phase(tracks, points, _note([*runs, *studies])),
        )


def _moments(item: Run | StudyFolder) -> tuple[Any, Any]:
    names = ("anatomy_subtalar_moment_Nm", "brace_subtalar_moment_Nm")
    if isinstance(item, Run):
        metrics = item.head.get("metrics", {})
        return metrics.get(names[0]), metrics.get(names[1], 0.0)
    done = item.done
    if not item.is_sample or names[0] not in done or len(done) < FEWEST:
        return None, None
    return done[names[0]].to_numpy(float), done[names[1]].to_numpy(float) if names[1] in done else np.zeros(len(done))


def _published(studies: Sequence[tuple[str, StudyFolder]]) -> Iterator[Drawn]:
    """Trials that repeat published ones (`study --inputs`), where the records are at hand in the folder
    SPRAIN_REFERENCE."""
    folder = os.environ.get(REFERENCE)
    matched = []
    for name, study in studies if folder else ():
        pair = _records(study, Path(str(folder)) / "paper")
        if pair is not None:
            matched.append((name, *pair))
    if matched:
        caption = "Every trial with the inputs of a published one; records are rounded to 0.1°."
        yield Drawn("published", "Published against simulated", caption, plots.published(matched, _note(studies)))


def _records(study: StudyFolder, folder: Path) -> tuple[np.ndarray, np.ndarray] | None:
    import pandas as pd

    columns = {"drop_height_m": "plant.drop_height [m]", "contact_dissipation_s_m": "plant.contact_dissipation [s/m]"}
    if study.head["method"] != "table" or not all(
        c in study.done for c in (*columns.values(), "peak_subtalar_angle_deg")
    ):
        return None
    done = study.done.set_index("trial")
    for path in sorted(folder.glob("study*_trials.csv")):
        records = pd.read_csv(path).set_index("trial")
        both = done.index.intersection(records.index)
        if len(both) >= FEWEST and len(both) == len(done) and _like(done, records, both, columns, study):
            return records.loc[both, "peak_subtalar_deg"].to_numpy(float), done.loc[
                both, "peak_subtalar_angle_deg"
            ].to_numpy(float)
    return None


def _like(done: Any, records: Any, both: Any, columns: Mapping[str, str], study: StudyFolder) -> bool:
    """The same inputs, and a device, co-activation and reflex where the records have them: studies 3 and 4 share their
    other inputs."""
    same = all(
        np.allclose(done.loc[both, ours], records.loc[both, theirs], rtol=1e-4) for theirs, ours in columns.items()
    )
    for theirs, ours in (("coactivation", "controller.coactivation"), ("reflex_gain", "controller.reflex_gain")):
        values = done.loc[both, ours] if ours in done else 0.0 * records.loc[both, theirs]
        same = same and bool(np.allclose(values, records.loc[both, theirs], rtol=1e-4))
    return same and bool(records.loc[both, "brace_scale_bi"].notna().all()) == (
        "brace" in study.manifest.get("fmus", {})
    )
