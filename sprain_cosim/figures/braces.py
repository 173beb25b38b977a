"""The figures that a comparison allows: paired changes, the forest."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial

from ..folders.comparison import INJURY, INVERSION, NONE, ComparisonFolder, called
from ..folders.study import PEAK, StudyFolder
from ..literature import INJURY_INVERSION_TEXT
from ..records import ends_of, named_differences
from .comparison import paired
from .drawn import Drawn, as_file_name
from .forest import Changed, Difference, forest
from .selection import both_ends
from .style import FORM, SeriesLook, palette

COMPARED = {  # metric of a comparison: what it is called in a forest, unit of the differences, factor to it
    PEAK: ("peak subtalar angle, + supination", "deg", 1.0),
    INVERSION: ("peak inversion from neutral", "deg", 1.0),
    INJURY: (f"probability of inversion beyond {INJURY_INVERSION_TEXT}°", "percentage points", 100.0),
    "anatomy_subtalar_moment_Nm": ("subtalar moment of the anatomy at the peak", "N·m", 1.0),
}


def draw_comparison(folder: ComparisonFolder, several: bool) -> Iterator[Drawn]:
    """Its figures; their names end in that of the folder where there are `several` comparisons."""
    if not folder.summary.completed.keys() - {NONE}:
        return
    suffix = f"_{as_file_name(folder.path)}" if several else ""
    sampled = folder.summary.has_intervals
    silent = "Draws that are not independent" if folder.summary.is_study else "One landing: what others"
    silent += " give no interval." if folder.summary.is_study else " would give is not known."
    caption = (
        "What each brace changed against no brace over the same landings (in numbers: supination), and how likely "
        "inversion exceeds the range in which ankles of cadavers failed. "
    )
    thin = "the same threshold with a law of another shape, or what its specimens leave open."
    caption += (
        f"Thick: what the landings leave open (95 %); thin: {thin} More landings narrow the first alone. Beside the "
        "probabilities: the value, then both pairs of ends."
        if sampled
        else f"Lines: {thin} {silent}"
    )
    looks: dict[str, SeriesLook | None] = {
        brace: FORM.get().palette.get(name) for brace, name in _names_of(folder).items()
    }
    own = palette(list(folder.summary.braces), [NONE])
    drawn = partial(paired, folder.summary, threshold_doubts(folder), {b: looks.get(b) or own[b] for b in own})
    title = f": {folder.title}" if several else ""
    yield Drawn(f"paired{suffix}", f"What the braces change{title}", caption, drawn)
    panels, reference = brace_differences(folder)
    if panels:
        against = called(reference)
        caption = f"Each brace minus {against}, paired over the same landings; left of the line is less. "
        caption += "Thick: the 95 % interval of the mean, what the landings leave open. " if sampled else ""
        caption += (
            "Thin, of the probability: the same threshold with laws of another shape, or the ends of what its "
            "specimens leave open, for both alike; more landings do not narrow it."
        )
        caption += "" if sampled else f" {silent}"
        note = f"{folder.summary.source}: {folder.summary.count}, the same for every brace. "
        note += f"Initial pose: {folder.summary.initial_pose}." if folder.summary.initial_pose else ""
        drawn = partial(forest, panels, against, {b: looks.get(b) or own[b] for b in own}, note.strip())
        yield Drawn(f"forest{suffix}", f"Differences to {against}{title}", caption, drawn)


def _names_of(folder: ComparisonFolder) -> dict[str, str]:
    """{brace: its name in the palette} of a comparison that is drawn alone."""
    return {brace: called(brace) for brace in folder.members}


def threshold_doubts(folder: ComparisonFolder) -> dict[str, tuple[float, float]]:
    """{brace: ends of the probability of injury as far as the threshold is known}."""
    found = {brace: _other_thresholds(folder, brace) for brace in folder.members}
    known = {brace: ends or ends_of(shapes) for brace, (ends, shapes) in found.items()}
    return {brace: ends for brace, ends in known.items() if ends}


def _other_thresholds(
    folder: ComparisonFolder, brace: str
) -> tuple[tuple[float, float] | None, Mapping[str, float] | None]:
    """The probability of injury with other thresholds: its ends as far as their specimens are known, and
    {law: probability} of the same mean and SD. None for what nothing says."""
    member, summary = folder.members.get(brace), folder.summary.braces.get(brace)
    question = member.summary.questions.get(INVERSION) if isinstance(member, StudyFolder) else None
    ends, shapes = (both_ends(question.threshold_ci), question.shapes) if question else (None, None)
    return ends, shapes or (summary.injury_shapes if summary else None)


def brace_differences(folder: ComparisonFolder) -> tuple[list[Changed], str]:
    """What each brace changed, a panel for each response, and what it is compared with: no brace, or the first brace
    where the landings without one failed."""
    summary = folder.summary
    names = list(summary.completed)
    reference = NONE if NONE in names else names[0]
    panels = []
    for metric, (quantity, unit, factor) in COMPARED.items():
        rows = {}
        for name in names:
            to_first = summary.pairs.get(f"{name} - {reference}", {})
            e = (summary.braces[name].difference_to_none if reference == NONE else to_first).get(metric)
            if name == reference or e is None or e.value is None:
                continue
            sampling = both_ends((e.ci_low, e.ci_high))
            threshold = _doubt_of_difference(folder, name, reference) if metric == INJURY else None
            pairs = (None if pair is None else (factor * pair[0], factor * pair[1]) for pair in (sampling, threshold))
            rows[name] = Difference(factor * e.value, *pairs)
        if rows:
            panels.append(Changed(quantity, unit, rows))
    return panels, reference


def _doubt_of_difference(folder: ComparisonFolder, brace: str, reference: str) -> tuple[float, float] | None:
    """Ends of the difference of two probabilities against one threshold: with each law of the same mean and SD, or with
    the ends of what its specimens leave open, which move both probabilities the same way."""
    (ours, one), (theirs, other) = (_other_thresholds(folder, name) for name in (brace, reference))
    if ours and theirs:
        return ends_of({str(k): a - b for k, (a, b) in enumerate(zip(ours, theirs, strict=True))})
    return ends_of(named_differences(one, other))
