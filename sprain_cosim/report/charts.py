"""What chart.js draws: distributions of studies, signals of runs. JSON, with four figures a number."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from .. import figures as plots
from ..figures.samples import drawn_ranks
from ..figures.selection import FEWEST, Named, published_levels, response_label
from ..figures.style import LINES, MOST_DRAWN
from ..figures.style import SeriesLook as StyledLook
from ..folders.comparison import INVERSION
from ..folders.run import RunFolder
from ..folders.study import PEAK, StudyFolder
from ..literature import INJURY_INVERSION
from .words import unit_alone

EXPLORED = (
    PEAK,
    INVERSION,
    "peak_subtalar_velocity_deg_s",
    "peak_talocrural_angle_deg",
    "anatomy_subtalar_moment_Nm",
    "brace_subtalar_moment_Nm",
    "peak_vertical_grf_after_impact_N",
)
DASHES = ("", "7 3", "2 3", "7 3 2 3")
HINT = "Point at the curves, or touch them, to read values."

Look = Mapping[str, str]  # colour, dashes and mark, by the names that chart.js knows


def charts(items: Sequence[Named], looks: Mapping[str, StyledLook]) -> list[dict[str, Any]]:
    """{id, title, hint, options} of each chart that the items allow; an option is what one choice of the reader
    shows. `looks`: {name: look}."""
    studies, runs = [], []
    for name, item in items:
        style = looks[name]
        dash, mark = DASHES[LINES.index(style.line)], style.dot if style.marked else ""
        look = {"color": style.colour, "dash": dash, "mark": mark}
        if isinstance(item, RunFolder):
            runs.append((name, item, look))
        elif item.is_sample:
            studies.append((name, item, look))
    distributions = {
        "id": "chart-distribution",
        "title": "Share of landings below a value",
        "hint": f"{HINT}{_thinned(studies)}",
        "options": _distributions(studies),
    }
    signals = {"id": "chart-time", "title": "Signals over time", "hint": HINT, "options": _signals(runs)}
    return [chart for chart in (distributions, signals) if chart["options"]]


def _thinned(studies: Sequence[tuple[str, StudyFolder, Look]]) -> str:
    """That not every landing is drawn, where it is so."""
    if all(len(study.done) <= MOST_DRAWN for _, study, _ in studies):
        return ""
    return f" Curves go through {MOST_DRAWN} landings, evenly by rank; trials.csv has them all."


def _distributions(studies: Sequence[tuple[str, StudyFolder, Look]]) -> list[dict[str, Any]]:
    options = []
    for response in dict.fromkeys([*(s.response for _, s, _ in studies), *EXPLORED]):
        series, drawn = [], list[float]()
        for name, study, look in studies:
            values = study.done[response].dropna().to_numpy(float) if response in study.done else np.empty(0)
            if len(values) >= FEWEST:
                marks = [[v, p / 100] for p, v in published_levels(study, response).items()]
                x = _digits(np.sort(values)[drawn_ranks(len(values))])
                drawn += [float(values.min()), float(values.max()), *(v for v, _ in marks)]
                series.append({"name": name, **look, "x": x, "marks": marks})
        if series:
            mean, sd = INJURY_INVERSION
            text = response_label(response)
            option: dict[str, Any] = {
                "label": text,
                "xlabel": text,
                "xunit": unit_alone(response),
                "kind": "cdf",
                "series": series,
            }
            said = " Circles: published levels." if any(s["marks"] for s in series) else ""
            if response == INVERSION:
                option["band"] = [mean - sd, mean + sd]
                said += " Grey: injury range." if min(drawn) < mean + sd and max(drawn) > mean - sd else ""
            options.append(option | ({"hint": said} if said else {}))
    return options


def _signals(runs: Sequence[tuple[str, RunFolder, Look]]) -> list[dict[str, Any]]:
    options = []
    for title, signal, factor in plots.PANELS if runs else ():
        series = []
        for name, run, look in runs:
            if signal in run.result.index:
                x, y = _digits(1e3 * run.result.time), _digits(factor * run.result[signal])
                series.append({"name": name, **look, "x": x, "y": y})
        if any(any(s["y"]) for s in series):
            unit = re.search(r"\[(.+)\]", title)
            options.append(
                {
                    "label": title,
                    "xlabel": "time after contact [ms]",
                    "xunit": "ms",
                    "unit": unit[1] if unit else "",
                    "kind": "line",
                    "series": series,
                }
            )
    return options


def script_data(content: Sequence[Mapping[str, Any]] | Mapping[str, Any]) -> Markup:
    """What a script reads, as the text of a script element, which no text inside can end."""
    return Markup(json.dumps(content, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c"))


def _digits(values: NDArray[np.float64]) -> list[float | None]:
    return [float(f"{v:.4g}") if np.isfinite(v) else None for v in values.tolist()]
