"""What a reader may take away from the page: its numbers as tables of commas."""

from __future__ import annotations

import base64
from collections.abc import Iterator, Sequence

import pandas as pd

from ..figures.selection import Named
from ..figures.style import MOST_DRAWN
from ..folders.comparison import INJURY, NONE, ComparisonFolder, MeanEstimate
from ..folders.read import Folder
from ..folders.run import RunFolder
from ..metrics import unit_of
from ..study.summary import LevelSearch
from .blocks import Block, Download, Paragraph
from .charts import EXPLORED

NUMBERS = ["result", "response", "unit", "statistic", "value", "ci_low", "ci_high", "n"]
ABOUT = "Tables with commas and a point, one header line"
OF_NUMBERS = "; ci_low and ci_high are the ends of 95 % intervals"

Line = tuple[str, str, str, str, float | None, float | None, float | None, int | None]


def downloads(folders: Sequence[Folder], items: Sequence[Named]) -> list[Block]:
    """Links to the numbers of the page, and to the landings where they are not too many."""
    blocks: list[Block] = []
    lines = [*_of_comparisons(folders), *_of_items(items)]
    if lines:
        table = pd.DataFrame(lines, columns=NUMBERS)
        blocks.append(_link("numbers.csv", table, "values, levels, differences and probabilities, with intervals"))
    landings, left_out = _landings(items)
    if landings is not None:
        blocks.append(_link("landings.csv", landings, "one line a landing: inputs and the responses of the curves"))
    if left_out:
        blocks.append(Paragraph(f"Too many landings for a page: {', '.join(left_out)}. Their trials.csv has them all."))
    return [*blocks, Paragraph(f"{ABOUT}{OF_NUMBERS if lines else ''}.", "about")] if blocks else []


def _link(name: str, table: pd.DataFrame, about: str) -> Download:
    text = table.to_csv(index=False, float_format="%.6g", lineterminator="\n")
    return Download(name, about, len(table), base64.b64encode(text.encode()).decode())


def _of_comparisons(folders: Sequence[Folder]) -> Iterator[Line]:
    for folder in folders:
        if isinstance(folder, ComparisonFolder):
            for name, brace in folder.summary.braces.items():
                for key, e in brace.metrics.items():
                    yield _estimate(name, key, "mean" if folder.summary.is_study else "value", e)
                for key, e in brace.difference_to_none.items():
                    yield _estimate(name, key, "paired difference to none", e)
                against = brace.injury_doubt_against(folder.summary.braces.get(NONE))
                for statistic, of, threshold in (
                    ("value, thresholds of other shapes", brace.metrics, brace.injury_doubt),
                    ("difference to none, thresholds of other shapes", brace.difference_to_none, against),
                ):
                    if threshold is not None and INJURY in of:
                        yield name, INJURY, "1", statistic, of[INJURY].value, *threshold, of[INJURY].n
            for pair, estimates in folder.summary.pairs.items():
                for key, e in estimates.items():
                    yield _estimate(pair, key, "paired difference", e)


def _estimate(name: str, key: str, statistic: str, e: MeanEstimate) -> Line:
    return name, key, unit_of(key), statistic, e.value, e.ci_low, e.ci_high, e.n


def _of_items(items: Sequence[Named]) -> Iterator[Line]:
    for name, item in items:
        if isinstance(item, RunFolder):
            for key, value in item.summary.metrics.items():
                yield name, key, unit_of(key), "value", value, None, None, 1
            continue
        n = item.summary.n_completed
        for key, r in item.summary.responses.items():
            yield name, key, unit_of(key), "mean", r.mean, None, None, n
            yield name, key, unit_of(key), "SD", r.sd, None, None, n
            for level, p in r.percentiles.items():
                yield name, key, unit_of(key), f"{level} %", p.value, p.ci_low, p.ci_high, n
        search = item.summary.search
        if isinstance(search, LevelSearch):
            for level, v in search.levels.items():
                yield name, item.response, unit_of(item.response), f"{level} % by the method", v.value, None, None, n
        elif search is not None:
            ends = search.ci_low, search.ci_high
            yield name, item.response, "1", "probability above the threshold", search.probability, *ends, search.sampled
        for key, q in item.summary.questions.items():
            low, high = q.sampling_ci or (q.ci_low, q.ci_high)
            yield (
                name,
                q.response or key,
                "1",
                f"probability {q.event}, interval of the sample",
                q.probability,
                low,
                high,
                n,
            )
            if q.threshold_ci is not None:
                ends = q.threshold_ci
                yield name, q.response or key, "1", f"probability {q.event}, of the threshold", q.probability, *ends, n


def _landings(items: Sequence[Named]) -> tuple[pd.DataFrame | None, list[str]]:
    """The landings of all samples under each other; the names of those that have too many."""
    parts, left_out = [], []
    for name, item in items:
        if isinstance(item, RunFolder):
            continue
        if len(item.trials) > MOST_DRAWN:
            left_out.append(name)
            continue
        inputs = [c for c in item.trials.columns if "." in str(c)]
        chosen = [*inputs, *(c for c in dict.fromkeys([item.response, *EXPLORED]) if c in item.trials)]
        parts.append(item.trials[["trial", "status", *chosen]].assign(result=name))
    if not parts:
        return None, left_out
    table = pd.concat(parts, ignore_index=True)
    return table[["result", *(c for c in table.columns if c != "result")]], left_out
