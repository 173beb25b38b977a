"""Which figures a set of result folders allows, from what the folders hold: nothing is simulated."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from .. import figures as plots
from ..cosim.result import Result
from ..errors import InputError
from ..folders.comparison import ComparisonFolder
from ..folders.read import Folder
from ..folders.run import RunFolder, coupling_note
from ..folders.study import StudyFolder
from ..metrics import brace_torques
from ..records import ends_of
from ..study.questions import law_name
from ..study.summary import DesignSearch, FormSearch, LevelSearch
from ..units import RARE
from .braces import draw_comparison
from .drawn import Drawn, as_file_name, write_drawn
from .pairs import Column, most_inputs, strongest
from .persons import persons_figure
from .records import published_records
from .samples import Sample, open_end
from .selection import (
    FEWEST,
    as_interval,
    asking,
    both_ends,
    in_reader_units,
    named_folders,
    palette_of,
    pearson_intervals,
    pose_note,
    response_label,
    same_question,
    sample_of,
    spread_intervals,
    study_devices,
)
from .style import DOUBLE, FORMATS, LONGEST, MOST_DRAWN, SINGLE, shorten

SCREEN, NARROWEST, WIDEST = 16.0, 8.0, 40.0  # cm
FAN = 20  # trajectories for a fan
SAMPLE = f"a sampled study of which {FEWEST} landings completed"
NEEDS = {  # figure: what it is drawn of
    "paired": "a comparison of which a brace completed",
    "forest": "a comparison of which a brace and the landings without one, or two braces, completed",
    "persons": "a comparison whose persons vary",
    "landing": "a run",
    "moment_angle": "a run",
    "cdf": SAMPLE,
    "percentiles": "two sampled studies",
    "poses": "one study in two initial poses",
    "design": "a folder of `design`",
    "questions": "a study with questions",
    "amv": "a study by mean-value, amv, amv+ or hmv",
    "form": "a study by form",
    "sobol": "a study by sobol-indices",
    "tornado": "a Monte Carlo study",
    "grid": "a grid of one or two parameters",
    "fan": f"a sampled study of which the signals of {FAN} trials were kept (--trajectories {FAN})",
    "pairs": f"{SAMPLE}; of a comparison, name the folder of one brace",
    "phase": "a landing that completed",
    "sharing": SAMPLE,
    "published": "trials that repeat published ones, and SPRAIN_REFERENCE",
}

Runs = Sequence[tuple[str, RunFolder]]
Studies = Sequence[tuple[str, StudyFolder]]
Values = NDArray[np.float64]
MOMENTS = ("anatomy_subtalar_moment_Nm", "brace_subtalar_moment_Nm")  # of anatomy and brace
K = TypeVar("K")


def draw(folders: Sequence[Folder]) -> Iterator[Drawn]:
    """One figure after the other, those that answer the first questions first; none is drawn yet."""
    items = named_folders(folders)
    runs = [(name, item) for name, item in items if isinstance(item, RunFolder)]
    studies = [(name, item) for name, item in items if isinstance(item, StudyFolder)]
    for folder in folders:
        if isinstance(folder, ComparisonFolder):
            yield from draw_comparison(folder, sum(isinstance(f, ComparisonFolder) for f in folders) > 1)
    if runs:
        for name, run in runs:
            if "plant.subtalar_angle" not in run.result.index:
                raise InputError(f"{run.path}: {name} has no plant.subtalar_angle; there is no landing to draw")
        yield from _of_runs(runs)
    if studies:
        yield from _of_studies(studies)
        compared = {id(m) for f in folders if isinstance(f, ComparisonFolder) for m in f.members.values()}
        yield from _pairs([(name, study) for name, study in studies if id(study) not in compared])
    yield from _persons(folders)
    yield from _phase(runs, studies)
    yield from _sharing(items, studies)
    caption = (
        "A brace is the law of the passive ankle with its angle scaled, about the three body-fixed axes. For "
        "comparison with Figures 1C and 2 of Yoder et al. 2021."
    )
    title = "Torque-angle laws of the paper's ankle and braces"
    yield Drawn("torque_angle", title, caption, plots.torque_angle, ())


def figure_form(width: str | None, screen: bool, panels: bool) -> plots.Form:
    """The form that the options of `plot` ask for. Raises InputError."""
    named = {None: SCREEN if screen else SINGLE, "single": SINGLE, "double": DOUBLE}
    if width in named:
        return plots.Form(named[width], screen, panels)
    try:
        centimetres = float(str(width).removesuffix("cm"))
    except ValueError:
        raise InputError(f"--width {width}: must be single, double or a number of cm") from None
    if not NARROWEST <= centimetres <= WIDEST:
        raise InputError(f"--width {width}: must lie between {NARROWEST:g} and {WIDEST:g} cm")
    return plots.Form(centimetres, screen, panels)


def figure_kinds(text: str) -> list[str]:
    """The kinds of file in "pdf,svg". Raises InputError."""
    kinds = [kind.strip().lower() for kind in text.split(",") if kind.strip()]
    for kind in kinds:
        if kind not in FORMATS:
            raise InputError(f"--format {kind}: must be of {', '.join(FORMATS)}")
    if not kinds:
        raise InputError(f"--format {text!r}: name one of {', '.join(FORMATS)}")
    return list(dict.fromkeys(kinds))


def write_figures(
    folders: Sequence[Folder],
    out: Path,
    kinds: Sequence[str] = ("png", "svg"),
    form: plots.Form | None = None,
    only: Sequence[str] = (),
    response: str | None = None,
) -> list[Path]:
    """The figures as files of the `kinds` in `out`/figures, captions.txt beside them.

    form       width, style and panel letters; its palette is set here
    only       beginnings of names, such as cdf; all figures where empty
    response   of studies, in place of the one that their files name first

    Raises InputError for names that no figure has, EnvironmentProblem."""
    empty = [item for _, item in named_folders(folders) if isinstance(item, StudyFolder) and item.done.empty]
    if empty and len(empty) == len(named_folders(folders)):
        raise InputError(f"{empty[0].path}: none of its {len(empty[0].trials)} landings completed; nothing to draw")
    folders = asking(folders, response) if response is not None else folders
    names: list[str] = []

    def chosen() -> Iterator[Drawn]:
        for drawn in draw(folders):
            names.append(drawn.name)
            if not only or any(is_of_kind(drawn.name, name) for name in only):
                yield drawn

    with plots.drawn_as(replace(form or plots.Form(), palette=palette_of(folders))):
        written = write_drawn(chosen(), folders, out / "figures", kinds)
    for name in only:
        if not any(is_of_kind(drawn_name, name) for drawn_name in names):
            needs = next((f"; it needs {what}" for kind, what in NEEDS.items() if is_of_kind(name, kind)), "")
            raise InputError(f"--only {name}: these folders allow no such figure, but {', '.join(names)}{needs}")
    return written


def is_of_kind(figure: str, name: str) -> bool:
    """Whether `name` is the figure's, or its kind: cdf is also of cdf_peak_inversion_from_neutral_deg."""
    return figure == name or bool(re.match(rf"{re.escape(name)}(_|\d*$)", figure))


def _end(study: StudyFolder, of: int) -> str:
    """What a file name ends in that stands for one study of several."""
    return "" if of == 1 else "_" + as_file_name(study.path)


def _of_runs(runs: Runs) -> Iterator[Drawn]:
    overlaid = [(name, run.result) for name, run in runs]
    note = coupling_note([run.summary for _, run in runs])
    caption = "Each landing from contact on; the dot marks the peak of supination."
    yield Drawn("landing", "The landing over time", caption, partial(plots.landing_signals, overlaid, note))
    caption = (
        "The path each landing took: a loop means that the moment depends on more than this angle (speed, the "
        "other axes, coupling)."
    )
    yield Drawn("moment_angle", "Moment over angle", caption, partial(plots.moment_angle, overlaid, note))


def _of_studies(studies: Studies) -> Iterator[Drawn]:
    samples = {name: sample_of(name, study) for name, study in studies}
    distributions = [
        (name, study) for name, study in studies if study.is_sample and len(samples[name].values) >= FEWEST
    ]
    for response in dict.fromkeys(study.response for _, study in distributions):
        chosen = [(name, study) for name, study in distributions if study.response == response]
        suffix = "" if response == distributions[0][1].response else f"_{response}"
        yield from _distributions(chosen, samples, response_label(response), suffix)
    yield from _designs(studies)
    yield from _questions(studies)
    yield from _searches(studies, distributions, samples)
    yield from _events(studies)
    yield from _indices(studies)
    for name, study in distributions:
        if pearson_intervals(study, study.response):
            yield _tornado(name, study, _end(study, len(distributions)))
    yield from _grids(studies)
    yield from _fans([(name, study) for name, study in studies if study.is_sample])
    yield from _published(distributions)


def _distributions(chosen: Studies, samples: Mapping[str, Sample], text: str, suffix: str) -> Iterator[Drawn]:
    """Studies of one response, which is `text` in words."""
    caption = "Share of landings whose response stays below the value."
    if len(chosen) <= 2 and any(samples[n].low is not None for n, _ in chosen):
        caption += " Bands: 95 % bounds of each share by itself (Clopper-Pearson)."
    elif len(chosen) > 2 and any(samples[n].low is not None for n, _ in chosen):
        caption += " The 95 % bounds of the shares are left out: more than two of them hide each other."
    if any(samples[n].published for n, _ in chosen):
        caption += " Circles: the published levels, where the study is one of the paper's in its pose."
    drawn = partial(plots.cdf, [samples[n] for n, _ in chosen], text, pose_note(chosen))
    yield Drawn(f"cdf{suffix}", "Distribution", caption, drawn, chosen)
    with_levels = [(n, s) for n, s in chosen if samples[n].percentiles]
    if len(with_levels) > 1:
        caption = _of_levels([samples[n] for n, _ in with_levels])
        drawn = partial(plots.percentiles, [samples[n] for n, _ in with_levels], text, pose_note(with_levels))
        yield Drawn(f"percentiles{suffix}", "Levels side by side", caption, drawn, with_levels)
    yield from _poses(chosen, samples, text, suffix)


def _of_levels(samples: Sequence[Sample]) -> str:
    """What the figure of levels shows."""
    ends = [interval[1:] for sample in samples for interval in sample.percentiles.values()]
    caption = "The 5, 50 and 95 % levels with their 95 % intervals."
    if any(open_end(*pair) is not None for pair in ends):
        caption += (
            " A tip in place of an end: too few landings to close the interval, the level may lie anywhere beyond."
        )
    if any(np.isnan(pair).all() for pair in ends):
        caption += " Without a bar: draws that are not independent give no interval."
    if any(sample.published for sample in samples):
        caption += " Circles: the published levels."
    return caption


def _questions(studies: Studies) -> Iterator[Drawn]:
    """Of each study with questions of its own; those of the literature where there is one study alone."""
    asked = [
        (name, study)
        for name, study in studies
        if study.summary.search is None
        and any(len(studies) == 1 or q.source == "own" for q in study.summary.questions.values())
    ]
    for name, study in asked:
        summary = study.summary
        answers = [
            plots.Answer(
                f"{plots.label(q.response or key).partition(', +')[0]} {q.event}"
                + ("" if q.source == "own" else " (literature)"),
                q.probability,
                both_ends(q.sampling_ci or (q.ci_low, q.ci_high)),
                both_ends(q.threshold_ci),
                {law_name(law): p for law, p in (q.shapes or {}).items()},
            )
            for key, q in summary.questions.items()
        ]
        own = {q.response for q in summary.questions.values() if q.source == "own"}
        curves = [
            plots.Exceeded(
                response_label(response),
                np.array(curve.threshold),
                *(np.array(values, float) for values in (curve.probability, curve.low, curve.high)),
            )
            for response, curve in (summary.curves or {}).items()
            if response in own or (not own and response == study.response)
        ]
        caption = (
            "How likely the response exceeds a threshold. What the sample leaves open (95 %) and what is not known of "
            "the threshold stand apart: more landings narrow the first alone, more specimens the second alone."
        )
        drawn = partial(plots.questions, answers, curves, pose_note([(name, study)]))
        yield Drawn(f"questions{_end(study, len(asked))}", f"How likely: {name}", caption, drawn, [(name, study)])


def _designs(studies: Studies) -> Iterator[Drawn]:
    asked = [(name, study, study.summary.design) for name, study in studies]
    found = [(name, study, design) for name, study, design in asked if design is not None]
    for name, study, design in found:
        note, end = pose_note([(name, study)]), _end(study, len(found))
        quantity = _labelled(design.parameter, design.unit)
        if len(design.points) == 1:
            caption = (
                "The probability over the parameter: a polynomial through the landings, corrected by fresh landings at "
                "the value found. Away from there the band joins what landings drawn again would change; where it is "
                "dotted nothing but its upper end is known. The doubt about the threshold is not in the band: it "
                "stands upright at the value found."
            )
            drawn = partial(plots.design_curve, _designed(design, quantity), note)
            yield Drawn(f"design{end}", f"{design.find.capitalize()} value: {name}", caption, drawn)
            continue
        low, high = design.range
        assert low is not None and high is not None
        points = [
            (
                p.second or 0.0,
                p.value,
                low if p.ci_low is None else p.ci_low,
                high if p.ci_high is None else p.ci_high,
                p.value_95,
            )
            for p in design.points
            if p.status != "nowhere"
        ]
        if points:
            caption = (
                "Which values of the two parameters meet the goal: on and beyond the curve. The threshold is held."
            )
            second = _labelled(design.second or "", design.second_unit or "")
            goal = f"P ≤ {100 * design.at_most:g} %"
            drawn = partial(plots.trade_off, quantity, second, points, design.find == "least", goal, (low, high), note)
            yield Drawn(f"design{end}", f"Trade-off: {name}", caption, drawn)


def _designed(design: DesignSearch, quantity: str) -> plots.Designed:
    (point,) = design.points
    curve, at, known = point.curve, point.comfort, point.probability
    resistance = {m: [(c.value, *_atboth_ends(c.resistance_Nm, m)) for c in at] for m in point.motions[0]}
    event = design.goal.partition("(")[2].rpartition(")")[0].partition(" ")
    return plots.Designed(
        f"{plots.label(event[0]).partition(', +')[0]} {event[2]}".replace(" = ", "\u00a0=\u00a0"),
        design.at_most,
        quantity,
        np.array(curve.parameter, float),
        np.array(curve.probability, float),
        np.array(curve.low, float),
        np.array(curve.high, float),
        (point.value, point.ci_low, point.ci_high) if point.status == "met" else None,
        None if point.value_95 is None else design.on_the_safe_side(point.value_95),
        design.find == "least",
        resistance,
        both_ends(known.threshold_ci) or ends_of(known.shapes),
        "threshold of another shape"
        if known.threshold_ci is None
        else f"threshold, n\u00a0=\u00a0{known.specimens}"
        if known.specimens
        else "ends of the threshold",
    )


def _atboth_ends(resistance: Mapping[str, float | None], motion: str) -> tuple[float, float]:
    """N·m at 5 and 10 degrees."""
    five, ten = (resistance.get(f"{motion}_{d}deg") for d in (5, 10))
    return five or 0.0, ten or 0.0


def _labelled(name: str, unit: str) -> str:
    return plots.label(name) + (f" [{unit}]" if unit else "")


def _tornado(name: str, study: StudyFolder, end: str) -> Drawn:
    moves, spread = pearson_intervals(study, study.response), spread_intervals(study, study.response)
    widens = " and what widens it (how its standard deviation follows the input's: dSD/dSD, normalised)"
    caption = f"What moves the response (Pearson's r){widens if spread else ''}, with 95 % intervals."
    if spread and len(spread) < len(moves):
        caption += (
            " No second bar: this factor is not known of an input that depends on others, or of its distribution."
        )
    drawn = partial(
        plots.tornado,
        moves,
        spread,
        name,
        response_label(study.response),
        study.published_peak.get("pearson", {}),
        pose_note([(name, study)]),
    )
    return Drawn(f"tornado{end}", f"Sensitivities: {name}", caption, drawn, [(name, study)])


def _pairs(studies: Studies) -> Iterator[Drawn]:
    """Of each sample: its strongest inputs and its response against each other."""
    found = [(name, study, _columns(study)) for name, study in studies if study.is_sample]
    found = [(name, study, columns) for name, study, columns in found if columns]
    for name, study, (*inputs, response) in found:
        chosen, n = strongest(inputs, response, most_inputs()), len(response.values)
        independent = study.summary.method in ("monte-carlo", "table")
        few = len(chosen) < len(inputs)
        rule = (
            f"{len(chosen)} of {len(inputs)} inputs, those of the largest rank correlation with it" if few else "inputs"
        )
        every = f" (of {n} landings every {-(-n // MOST_DRAWN)}th; all numbers are of all)" if n > MOST_DRAWN else ""
        doubt = "with its 95 % interval" if independent else f"without interval, as {study.summary.method} draws are no"
        caption = (
            f"The response and its {rule}. Below the diagonal each point is a landing{every}; on it the distribution; "
            f"above it Spearman's rank correlation, {doubt}{'' if independent else ' independent landings'}."
        )
        note = f"{shorten(name, LONGEST)}: n\u00a0=\u00a0{n}. {pose_note([(name, study)])}"
        drawn = partial(plots.pairs, [*chosen, response], independent, note)
        title = f"Inputs and response: {name}"
        yield Drawn(f"pairs{_end(study, len(found))}", title, caption, drawn, [(name, study)])


def _columns(study: StudyFolder) -> list[Column]:
    """The inputs that vary as numbers, the response last; empty where there is too little to draw."""
    if study.response not in study.done:
        return []
    done = study.done.dropna(subset=[study.response])
    values = {str(c): done[c].to_numpy(float) for c in done if "." in str(c) and done[c].dtype.kind in "fiu"}
    inputs = [Column(*in_reader_units(name, v)) for name, v in values.items() if len(set(v.tolist())) > 1]
    name, _, sign = response_label(study.response).partition(", + ")
    response = Column(name, done[study.response].to_numpy(float), sign)
    return [*inputs, response] if inputs and len(done) >= FEWEST and np.ptp(response.values) > 0 else []


def _poses(chosen: Studies, samples: Mapping[str, Sample], text: str, suffix: str) -> Iterator[Drawn]:
    """Studies with the same marginals that start in different poses."""
    for k, group in enumerate(_groups(chosen, lambda s: (s.file.scenario, s.file.marginals, study_devices(s)))):
        pairs = {study.pose: samples[name] for name, study in group if study.pose}
        if len(pairs) > 1:
            caption = (
                "The published pose starts with the foot inside the floor, as the paper's records do; the touching "
                "pose starts with the foot just touching. "
                "The pose moves the level of the response and can turn the sign of a sensitivity. Bands and lines: 95 "
                "% bounds of each share, 95 % intervals of Pearson's r."
            )
            title = "Initial poses side by side"
            yield Drawn(
                f"poses{suffix}{k or ''}",
                title,
                caption,
                partial(plots.poses, list(pairs.items()), text, pose_note(group)),
                group,
            )


def _searches(
    studies: Studies,
    distributions: Studies,
    samples: Mapping[str, Sample],
) -> Iterator[Drawn]:
    found = [(name, study, study.summary.amv) for name, study in studies]
    searches = [(name, study, amv) for name, study, amv in found if amv is not None and amv.levels]
    for name, study, amv in searches:
        sampled = next(((n, s) for n, s in distributions if same_question(s, study)), None)
        beside = None if sampled is None else samples[sampled[0]]
        note = f"{pose_note([(name, study)])} The method's own test says {amv.status}."
        caption = "Levels of the response found with few landings, and which input leads to each."
        if beside is not None:
            caption += " Grey: the distribution of the Monte Carlo study, with 95 % bounds of each share by itself."
        if amv.check is not None:
            caption += (
                f" Upright lines: the share of {amv.check.n} random landings that lies below the level, with its 95 % "
                "interval; it should hold the level."
            )
        else:
            caption += " No random landings tested the levels: their doubt is not known."
        drawn = partial(
            plots.level_search,
            samples[name],
            importance_of(amv),
            response_label(study.response),
            beside,
            note,
            tested=tested_shares(amv),
        )
        shown = [(name, study), *([] if sampled is None else [sampled])]
        yield Drawn(f"amv{_end(study, len(searches))}", name, caption, drawn, shown)


def tested_shares(amv: LevelSearch) -> dict[float, tuple[float, float]]:
    """{level in %: ends of the share [%] of random landings below its value, 95 %}; empty where none tested it."""
    pairs = {} if amv.check is None else {key: both_ends(ci) for key, ci in amv.check.ci.items()}
    return {float(key): (float(key) + ci[0], float(key) + ci[1]) for key, ci in pairs.items() if ci}


def _events(studies: Studies) -> Iterator[Drawn]:
    found = [(name, study, study.summary.search) for name, study in studies]
    searches = [(name, study, form) for name, study, form in found if isinstance(form, FormSearch)]
    for name, study, form in searches:
        shapes = {law_name(law): p for law, p in (form.shapes or {}).items()}
        event = f"{plots.label(form.response).partition(', +')[0]} above {form.threshold.distribution}"
        answer = plots.Answer(
            event, form.probability, both_ends((form.ci_low, form.ci_high)), both_ends(form.threshold_ci), shapes, RARE
        )
        orders = {"first order": form.first_order} | {
            f"second order, {formula}": p for formula, p in (form.second_order or {}).items()
        }
        caption = (
            "The probability of the event, from sampling about its design point, with what the landings (95 %) and "
            "what the threshold leave open; what first and second order alone say; which inputs lead to the event."
        )
        drawn = partial(
            plots.event_search,
            answer,
            {method: p for method, p in orders.items() if p is not None},
            {n: v for n, v in form.importance.items() if v is not None},
            f"{pose_note([(name, study)])} The method's own test says {form.status}.",
        )
        yield Drawn(f"form{_end(study, len(searches))}", f"How likely: {name}", caption, drawn, [(name, study)])


def _indices(studies: Studies) -> Iterator[Drawn]:
    searches = [(name, study, study.summary.sobol) for name, study in studies if study.summary.sobol]
    for name, study, sobol in searches:
        found = sobol.indices.items()
        first = {n: as_interval(i.first, i.first_low, i.first_high) for n, i in found if i.first is not None}
        total = {n: as_interval(i.total, i.total_low, i.total_high) for n, i in found if i.total is not None}
        if not total:
            continue
        caption = (
            "Share of the response's variance that each input explains, alone and in all with the others, with 95 % "
            "intervals. A share lies between 0 and 100 %; what reaches beyond is doubt from few landings."
        )
        drawn = partial(
            plots.variance_shares, first, total, response_label(sobol.response), name, pose_note([(name, study)])
        )
        yield Drawn(f"sobol{_end(study, len(searches))}", f"Variance: {name}", caption, drawn, [(name, study)])


def importance_of(amv: LevelSearch) -> dict[str, dict[str, float]]:
    """{level: {parameter: its part}}."""
    return {
        level: {name: value for name, value in found.importance.items() if value is not None}
        for level, found in amv.levels.items()
    }


def _groups(chosen: Studies, key: Callable[[StudyFolder], K]) -> list[list[tuple[str, StudyFolder]]]:
    """Those with the same key together, in the order in which keys first appear; keys need not be hashable."""
    groups: list[tuple[K, list[tuple[str, StudyFolder]]]] = []
    for item in chosen:
        known = next((members for k, members in groups if k == key(item[1])), None)
        if known is None:
            groups.append((key(item[1]), [item]))
        else:
            known.append(item)
    return [members for _, members in groups]


def _grids(studies: Studies) -> Iterator[Drawn]:
    """Grids of one or two parameters: the first along the axis, a line for each level of the second."""
    grids = [(name, study) for name, study in studies if study.summary.method == "grid"]
    for name, study in grids:
        columns = {str(c).partition(" [")[0]: str(c) for c in study.done}
        axes = [columns[p] for p in study.file.grid if p in columns]
        if not 1 <= len(axes) <= 2 or study.response not in study.done:
            continue
        done, rows = study.done.sort_values(axes[0]), []
        label, levels, sign = in_reader_units(axes[0], np.unique(done[axes[0]]))
        for level, part in done.groupby(axes[1]) if len(axes) == 2 else [(0.0, done)]:
            if len(part) == len(levels):
                second, at, _ = in_reader_units(axes[-1], np.array([level]))
                words = f"{at[0]:.6g}" if isinstance(level, float | int) else str(level)
                title = f"{second} = {words}" if len(axes) == 2 else name
                rows.append((title, part[study.response].to_numpy(float)))
        if rows:
            note, along = pose_note([(name, study)]), label + (f", + {sign}" if sign else "")
            drawn = partial(plots.grid, levels, rows, along, response_label(study.response), note)
            caption = "The response at the points of the grid. A grid is no sample: no probability is in it."
            yield Drawn(f"grid{_end(study, len(grids))}", name, caption, drawn, [(name, study)])


def _fans(studies: Studies) -> Iterator[Drawn]:
    found = []
    for name, study in studies:
        # only the first trials are a fair sample: the others were kept because they are extreme
        done = set(study.done["trial"])
        chosen = [trial for trial in study.trajectories if trial < study.summary.first_kept and trial in done]
        if len(chosen) >= FAN:
            found.append((name, study, chosen))
    fans = cache(lambda: [_fan(name, [study.trajectory(t) for t in chosen]) for name, study, chosen in found])
    note = pose_note(studies)
    for k in range(0, len(found), 3):
        counts = ", ".join(str(n) for n in dict.fromkeys(len(chosen) for _, _, chosen in found[k : k + 3]))
        caption = (
            f"Percentiles at each moment over the first {counts} landings, whose signals were kept. A band is the "
            "spread of the landings, no interval of the median; it joins different landings: none need follow it."
        )
        drawn = partial(lambda k: plots.fan(fans()[k : k + 3], note, fans()), k)
        shown = [(name, study) for name, study, _ in found[k : k + 3]]
        yield Drawn(f"fan{k // 3 or ''}", "Many landings over time", caption, drawn, shown, reads="trajectories")


def _fan(name: str, records: Sequence[Result]) -> tuple[str, Values, dict[str, Values]]:
    """(title, (n,) time [s], {signal: (landings, n)}) of the records as long as the first."""
    time = records[0].time
    records = [r for r in records if len(r.time) == len(time)]
    shown = [signal for _, signal, _ in plots.PANELS if all(signal in r.index for r in records)]
    signals = {signal: np.array([r[signal] for r in records]) for signal in shown}
    if not brace_torques(records[0]):
        signals.pop("plant.brace_subtalar_moment", None)
    return name, time, signals


def _phase(runs: Runs, studies: Studies) -> Iterator[Drawn]:
    records = [(name, run.result) for name, run in runs]
    columns = ["peak_inversion_from_neutral_deg", "peak_jcs_inversion_velocity_deg_s"]
    points = []
    for name, study in studies:
        if not study.is_sample:
            continue
        if all(c in study.done for c in columns):
            both = study.done[columns].dropna().to_numpy(float)
            if len(both):
                points.append((name, both[:, 0], both[:, 1]))
        median = study.summary.trajectories.roles.get("p50") if study.summary.trajectories else None
        if median is not None and median in study.trajectories and len(studies) <= 2:
            records.append((name, study.trajectory(median)))
    tracks = [
        (name, plots.DEGREES * record["plant.inversion_angle"], plots.DEGREES * record["plant.inversion_velocity"])
        for name, record in records
        if "plant.inversion_angle" in record.index
    ]
    if tracks or points:
        caption = (
            "Inversion of the joint coordinate system, zero at the model's neutral pose (the paper's Table 3 is 10° "
            "lower: raw angles). Ankles of cadavers "
            "failed in the grey range. Li et al. measured two people on a 25° slope, with their laboratory's zero, "
            "which may differ by some degrees; the model "
            "lands on the slope of its scenario; they state the velocity of the sprains alone. The threshold of a "
            "living ankle is not known."
        )
        if len(records) > len(runs):
            caption += " A study's line is its median trial."
        yield Drawn(
            "phase",
            "Inversion against measured sprains",
            caption,
            partial(plots.phase, tracks, points, pose_note([*runs, *studies])),
        )


def _persons(folders: Sequence[Folder]) -> Iterator[Drawn]:
    """Of the first comparison over persons."""
    for folder in folders:
        persons = folder.summary.persons if isinstance(folder, ComparisonFolder) else None
        if isinstance(folder, ComparisonFolder) and persons is not None and persons.bands:
            caption = (
                "Means over parts of the persons with equal numbers, the same landings with every brace, and their "
                "95 % intervals. Pale: the probability for thresholds of another shape; more landings do not narrow it."
            )
            yield Drawn("persons", "For whom does each brace work?", caption, partial(persons_figure, folder.summary))
            return


def _sharing(items: Sequence[tuple[str, RunFolder | StudyFolder]], studies: Studies) -> Iterator[Drawn]:
    moments = [(name, _moments(item)) for name, item in items]
    rows = [(name, *pair) for name, pair in moments if pair is not None]
    if not rows:
        return
    caption = (
        "Resisting moment about the subtalar axis at the time of its peak angle: what the passive tissue bears, and "
        "what the brace takes."
    )
    if any(len(anatomy) > 1 for _, anatomy, _ in rows):
        caption += (
            " Of studies: means, with their 95 % intervals behind ±, the mean of the brace's shares, and below the "
            "bars the 5 … 95 % of the landings."
        )
    drawn = partial(plots.sharing, rows, pose_note(items), _doubts_of_moments(studies))
    shown = [(name, item) for (name, item), (_, pair) in zip(items, moments, strict=True) if pair is not None]
    yield Drawn("sharing", "Who bears the load", caption, drawn, shown)


def _moments(item: RunFolder | StudyFolder) -> tuple[Values, Values] | None:
    """(n,) moments [N·m] of anatomy and brace about the subtalar axis at its peak angle, one for each landing."""
    if isinstance(item, RunFolder):
        anatomy, brace = (item.summary.metrics.get(name) for name in MOMENTS)
        return None if anatomy is None else (np.array([anatomy]), np.array([brace or 0.0]))
    done, (own, borne) = item.done, MOMENTS
    if not item.is_sample or own not in done or len(done) < FEWEST:
        return None
    return done[own].to_numpy(float), done[borne].to_numpy(float) if borne in done else np.zeros(len(done))


def _doubts_of_moments(studies: Studies) -> dict[str, tuple[float, float]]:
    """{study: half widths [N·m] of the 95 % intervals of the means that `_moments` has}; where the sample has some."""
    found = {}
    for name, study in studies:
        responses = [study.summary.responses.get(n) for n in MOMENTS]
        ends = [both_ends(response.mean_ci) for response in responses if response is not None]
        halves = [0.5 * (pair[1] - pair[0]) for pair in ends if pair is not None]
        if halves and len(halves) == len(ends):
            found[name] = (halves[0], halves[-1])
    return found


def _published(studies: Studies) -> Iterator[Drawn]:
    """Trials that repeat published ones, where the records are at hand."""
    found = [(name, published_records(study)) for name, study in studies]
    matched = [(name, *pair) for name, pair in found if pair is not None]
    if matched:
        caption = "Every trial with the inputs of a published one; records are rounded to 0.1°."
        yield Drawn(
            "published", "Published against simulated", caption, partial(plots.published, matched, pose_note(studies))
        )
