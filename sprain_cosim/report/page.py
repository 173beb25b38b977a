"""One HTML file about runs, studies and comparisons: it opens without a network, on a phone and on paper. All of it
comes from the folders; nothing is simulated. Every text out of a folder is escaped."""

from __future__ import annotations

import base64
import json
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from .. import __version__, files
from .. import figures as plots
from ..brace import compare
from ..errors import InputError
from ..figures import gallery
from ..figures.style import LINES, PARAMETERS, SERIES
from ..folders.read import Comparison, Folder, Run, StudyFolder
from ..literature import INJURY_INVERSION
from ..metrics import table, unit_of

NAME = "report.html"
ANIMATION = ("animation.webp", 2_000_000)  # shown when no larger [bytes]
INVERSION = "peak_inversion_from_neutral_deg"
EXPLORED = (
    "peak_subtalar_angle_deg",
    INVERSION,
    "peak_subtalar_velocity_deg_s",
    "peak_talocrural_angle_deg",
    "anatomy_subtalar_moment_Nm",
    "brace_subtalar_moment_Nm",
    "peak_vertical_grf_after_impact_N",
)
FAILURES = 20  # rows of the table of failed trials
LIMITS = (
    "<b>The published pose starts inside the floor.</b> In the paper's records the foot starts 8 to 58 mm inside the "
    "platform, and is thrown out by tens "
    "of kilonewtons in the first millisecond. The touching pose starts with the foot just touching. Read which pose a "
    "figure has before you compare it.",
    "<b>The ground reaction is not human.</b> About ten body weights at 35 to 50 ms after contact, far more than "
    "people land with. The paper's own model "
    "does the same. Peak angles are compared with measurements, forces are not.",
    "<b>One subject.</b> One skeleton of 67.5 kg with 49 muscles, one foot, no shoe. What the studies vary is the "
    "landing, the ankle's stiffness and its "
    "muscles, not the person.",
    "<b>No injury threshold is known.</b> 35 ± 6° of inversion is where ankles of cadavers failed. A probability of "
    "exceeding it compares braces; "
    "it is not the risk of a patient.",
    "<b>The brace is an idea.</b> A device acts as torques between shank and foot: no strap slips, no skin moves, no "
    "fit is wrong, no shoe helps.",
    "<b>Angles have different zeros.</b> Supination and inversion from neutral are zero in the model's neutral pose. "
    "Raw inversion, as in Table 3 of the "
    "paper, is 10° lower; measurements have their laboratory's own zero.",
)


def write(given: Sequence[Folder], out: Path) -> Path:
    """The report as `out`, a file that ends in .html, or report.html in the folder `out`."""
    target = out if out.suffix.lower() in (".html", ".htm") else out / NAME
    if target.is_dir():
        raise InputError(f"{target}: is a folder; name a file that ends in .html")
    text = page(given)
    files.write(target, text, parents=True)
    return target


def page(given: Sequence[Folder]) -> str:
    """The whole page."""
    items = gallery.flat(given)
    drawn = list(gallery.draw(given))
    title = _title(given, items)
    charts = _charts(items)
    sections = [
        ("verdict", "Verdict", _verdict(given, items)),
        ("numbers", "Numbers", _numbers(given, items)),
        ("explore", "Look closer", _explore(charts)),
        ("figures", "Figures", _figures(drawn) + _animations(given, items)),
        ("sensitivities", "What drives the result", _sensitivities(items)),
        ("metrics", "All responses", _metrics(items)),
        ("inputs", "Inputs", _inputs(items)),
        ("provenance", "Where it comes from", _provenance(items)),
        ("limits", "Limits of the model", "<ul>" + "".join(f"<li>{text}</li>" for text in LIMITS) + "</ul>"),
    ]
    sections = [s for s in sections if s[2]]
    links = " ".join(f'<a href="#{key}">{name}</a>' for key, name, _ in sections)
    body = "".join(f'<section id="{key}"><h2>{name}</h2>{content}</section>\n' for key, name, content in sections)
    data = json.dumps(charts, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><meta name="viewport" '
        'content="width=device-width, initial-scale=1">'
        '<link rel="icon" '
        f'href="data:,"><title>{escape(title)}</title>\n<style>\n{_asset("style.css")}</style></head>\n<body>\n'
        f'<h1>{escape(title)}</h1>\n<p class="about">{_about(items)}</p>\n<nav>{links}</nav>\n{body}'
        '<script type="application/json" '
        f'id="data">{data}</script>\n<script>\n{_asset("chart.js")}</script>\n</body></html>\n'
    )


def _asset(name: str) -> str:
    return (resources.files(__package__) / name).read_text("utf-8")


def _title(given: Sequence[Folder], items: Sequence[tuple[str, Run | StudyFolder]]) -> str:
    if len(given) == 1 and isinstance(given[0], Comparison):
        return f"Braces compared: {given[0].data.get('title', given[0].path.name)}"
    if len(items) == 1:
        return items[0][0]
    kinds = {type(item) for _, item in items}
    return (
        f"{len(items)} {'landings' if kinds == {Run} else 'studies' if kinds == {StudyFolder} else 'results'} side "
        "by side"
    )


def _about(items: Sequence[tuple[str, Run | StudyFolder]]) -> str:
    poses = list(dict.fromkeys(item.pose for _, item in items if item.pose))
    parts = [f"Initial pose {' and '.join(poses)}"] if poses else []
    studies = [item for _, item in items if isinstance(item, StudyFolder)]
    if studies:
        counts = list(dict.fromkeys(str(s.head["n_requested"]) for s in studies))
        each = " each" if len(counts) == 1 and len(studies) > 1 else ""
        methods = dict.fromkeys("given rows" if s.head["method"] == "table" else str(s.head["method"]) for s in studies)
        parts.append(f"{' and '.join(counts)} landings{each} ({', '.join(methods)})")
        dates = sorted({str(s.manifest["created"])[:10] for s in studies if s.manifest.get("created")})
        parts += [" to ".join(dict.fromkeys([dates[0], dates[-1]]))] if dates else []
    parts.append(f"sprain-cosim {__version__}")
    return escape(" · ".join(parts))


# ---- verdict


def _verdict(given: Sequence[Folder], items: Sequence[tuple[str, Run | StudyFolder]]) -> str:
    blocks = [_compared(folder) for folder in given if isinstance(folder, Comparison)]
    several = len(items) > 1
    compared = {id(member) for folder in given if isinstance(folder, Comparison) for member in folder.members.values()}
    for name, item in items:
        if id(item) in compared and not (isinstance(item, StudyFolder) and int(item.head["n_failed"])):
            continue
        text = (
            _of_run(item) if isinstance(item, Run) else _of_search(item) if item.search is not None else _of_study(item)
        )
        bad = isinstance(item, StudyFolder) and (
            int(item.head["n_failed"]) > 0 or (item.search or {}).get("status", "ok") != "ok"
        )
        lead = f'<span class="name">{escape(name)}.</span> ' if several else ""
        blocks.append(f'<div class="verdict{" warn" if bad else ""}"><p>{lead}{text}</p></div>')
    return (
        "".join(blocks)
        + '<p>These are figures of a model, with its <a href="#limits">limits</a>; they rank braces, they do not '
        "certify one.</p>"
    )


def _compared(folder: Comparison) -> str:
    """Which brace lowered the peak most, paired over the same landings."""
    key, rows = "peak_subtalar_angle_deg", []
    for name, brace in folder.data.get("braces", {}).items():
        change = (brace.get("difference_to_none") or {}).get(key)
        if change and change.get("value") is not None:
            rows.append((float(change["value"]), name, change))
    failed = [
        f"{name}: {brace.get('message', '')}"
        for name, brace in folder.data.get("braces", {}).items()
        if brace.get("status") != "completed"
    ]
    text = ""
    if rows:
        rows.sort(key=lambda row: row[0])
        value, name, change = rows[0]
        word = "lowered" if value < 0 else "raised"
        alone = "" if len(rows) == 1 else " most of all"
        by = f"{abs(value):.1f}° on average{_interval(change, 1, '°', value < 0)}"
        text = f"Over the same landings, <b>{escape(name)}</b> {word} the peak of supination{alone}: by {by}."
        others = [f"{escape(n)} {_signed(v)}°" for v, n, _ in rows[1:]]
        text += f" The others: {', '.join(others)}." if others else ""
        text += _injuries(folder, name)
    text += f" <b>Failed:</b> {escape('; '.join(failed))}." if failed else ""
    return f'<div class="verdict{" warn" if failed else ""}"><p>{text}</p></div>' if text else ""


def _injuries(folder: Comparison, best: str) -> str:
    """The probability of injury without a brace and with the best one."""
    found = {
        n: b.get("metrics", {}).get(compare.INJURY)
        for n, b in folder.data.get("braces", {}).items()
        if n in (compare.NONE, best)
    }
    if len(found) < 2 or not all(e and e.get("value") is not None for e in found.values()):
        return ""
    without, with_best = (found[n] for n in (compare.NONE, best))
    return (
        f" Probability that inversion exceeds the injury range ({INJURY_INVERSION[0]:g} ± {INJURY_INVERSION[1]:g}° "
        "from neutral): "
        f"<b>{_percent(without['value'])}</b> without a brace{_interval(without, 100, ' %')}, "
        f"<b>{_percent(with_best['value'])}</b> with {escape(best)}"
        f"{_interval(with_best, 100, ' %')}."
    )


def _of_run(run: Run) -> str:
    m = run.head.get("metrics", {})
    if "peak_subtalar_angle_deg" not in m:
        return f"Ended as {escape(str(run.head['status']))}. {escape(str(run.head['message']))}"
    text = (
        f"In this landing the ankle supinated to <b>{m['peak_subtalar_angle_deg']:.1f}°</b> at "
        f"{1e3 * m['time_of_peak_subtalar_s']:.0f} ms."
    )
    mean, sd = INJURY_INVERSION
    if INVERSION in m:
        where = "below" if m[INVERSION] < mean - sd else "above" if m[INVERSION] > mean + sd else "inside"
        text += (
            f" Inversion from neutral peaked at {m[INVERSION]:.1f}°, {where} the range of {mean:g} ± {sd:g}° in "
            "which ankles of cadavers failed."
        )
    anatomy, brace = m.get("anatomy_subtalar_moment_Nm"), m.get("brace_subtalar_moment_Nm")
    if anatomy is not None and brace is not None and anatomy + brace:
        text += (
            f" At the peak the brace bore {brace:.1f} of {anatomy + brace:.1f} N·m "
            f"({100 * brace / (anatomy + brace):.0f} %)."
        )
    if run.head.get("coupling_error") is not None:
        text += f" Coupling error: {100 * run.head['coupling_error']:.2g} % of the energy exchanged."
    return text


def _of_study(study: StudyFolder) -> str:
    n, done, failed = (int(study.head[k]) for k in ("n_requested", "n_completed", "n_failed"))
    response = study.response
    found = study.head.get("responses", {}).get(response)
    text, unit = "", _unit(response)
    values = study.done[response].dropna().to_numpy(float) if response in study.done else np.empty(0)
    if len(values) and not (found and study.is_sample):
        kind = f"At {done} points of a grid" if study.head["method"] == "grid" else f"In {done} simulated landings"
        low, high = _n(float(values.min())), _n(float(values.max()))
        lay = f"was <b>{low}{unit}</b>" if len(values) == 1 else f"lay between <b>{low} and {high}{unit}</b>"
        text = f"{'In one landing' if done == 1 else kind} the {escape(gallery.quantity(response))} {lay}."
    elif found:
        level = {k: found["percentiles"].get(k, {}) for k in ("5", "50", "95")}
        name = (
            "peak of supination" if response == "peak_subtalar_angle_deg" else plots.label(response).partition(",")[0]
        )
        text = (
            f"In {done} simulated landings the {escape(name)} was <b>{_n(level['50'].get('value'))}{unit}</b> in "
            "the median"
        )
        text += (
            f"{_interval(level['50'], 1, unit)}, and between {_n(level['5'].get('value'))} and "
            f"{_n(level['95'].get('value'))}{unit} in nine of ten."
        )
    question = study.head.get("questions", {}).get(INVERSION)
    if question:
        text += (
            f" Probability that inversion exceeds the injury range ({INJURY_INVERSION[0]:g} ± "
            f"{INJURY_INVERSION[1]:g}° from neutral): "
        )
        text += f"<b>{_percent(question['probability'])}</b>{_interval(question, 100, ' %')}."
    if failed:
        kinds = ", ".join(f"{count} {status}" for status, count in study.head.get("failures", {}).items())
        text += f" <b>{failed} of {n} landings failed</b> ({escape(kinds)}); percentiles count only the others."
    else:
        text += " No landing failed." if done == n else f" {n - done} landings are missing."
    return text + "".join(
        f" {escape(str(note))[:1].upper()}{escape(str(note))[1:]}." for note in study.head.get("notes", [])
    )


def _of_search(study: StudyFolder) -> str:
    found = study.search or {}
    unit = _unit(study.response)
    cost = f"{found['evaluations_executed']} landings"
    if "levels" in found:
        levels = ", ".join(f"{_n(v['value'])}{unit} ({level} %)" for level, v in found["levels"].items())
        text = (
            f"With {cost} the method {escape(str(study.head['method']))} puts the "
            f"{escape(gallery.quantity(study.response))} at <b>{levels}</b>."
        )
    else:
        text = (
            f"With {cost}: the probability that {escape(gallery.quantity(study.response))} exceeds "
            f"{_threshold(found.get('threshold'), unit)} is "
        )
        text += f"<b>{_percent(found['probability'])}</b> (β = {found['beta']:.2f})."
    status, reasons = str(found.get("status", "")), "; ".join(str(r) for r in found.get("reasons", []))
    return text + f" The method's own check says <b>{escape(status)}</b>{': ' + escape(reasons) if reasons else ''}."


def _threshold(given: Any, unit: str) -> str:
    return (
        escape(f"the uncertain threshold {given.get('distribution', given.get('mean'))}")
        if isinstance(given, dict)
        else f"{_n(given)}{unit}"
    )


# ---- tables


def _numbers(given: Sequence[Folder], items: Sequence[tuple[str, Run | StudyFolder]]) -> str:
    parts = [_comparison_table(folder) for folder in given if isinstance(folder, Comparison)]
    studies = [(n, s) for n, s in items if isinstance(s, StudyFolder) and s.is_sample]
    if studies:
        columns = [_levels(study) for _, study in studies]
        labels = list(dict.fromkeys(label for column in columns for label in column))
        rows = [[label, *(column.get(label, "") for column in columns)] for label in labels]
        note = "<p class='about'>Small: 95 % intervals; “published”: the same study in Yoder et al. 2021.</p>"
        parts.append(_table(["", *(escape(n) for n, _ in studies)], rows) + note)
    runs = [(n, r) for n, r in items if isinstance(r, Run)]
    if runs and not any(isinstance(f, Comparison) for f in given):
        tables = [{label: (value, unit, time) for label, value, unit, time in table(run.result)} for _, run in runs]
        labels = list(dict.fromkeys(label for t in tables for label in t))
        rows = [
            [escape(f"{label} [{next(t[label][1] for t in tables if label in t)}]")]
            + [
                f"{_n(t[label][0])}<span class='ci'>at {1e3 * t[label][2]:.1f} ms</span>" if label in t else ""
                for t in tables
            ]
            for label in labels
        ]
        parts.append(_table(["", *(escape(n) for n, _ in runs)], rows))
    return "".join(parts) + _failures(studies)


def _levels(study: StudyFolder) -> dict[str, str]:
    """{row: cell} of the table of numbers."""
    found = study.head.get("responses", {}).get(study.response)
    cells = {
        "initial pose": escape(study.pose),
        "landings completed": f"{study.head['n_completed']} of {study.head['n_requested']}",
    }
    if found:
        published = study.published if study.response == "peak_subtalar_angle_deg" else {}
        name = escape(gallery.quantity(study.response))
        for level in ("5", "50", "95"):
            p = found["percentiles"].get(level, {})
            cells[f"{name}: {level} %"] = _n(p.get("value")) + _ci(p) + _beside(published.get(f"{level} % [deg]"))
        cells[f"{name}: mean ± SD"] = _mean_sd(found)
    for key, question in study.head.get("questions", {}).items():
        cells[f"P({escape(plots.label(key).partition(', +')[0])} {escape(str(question['event']))})"] = _percent(
            question["probability"]
        ) + _ci(question, 100)
    return cells


def _mean_sd(found: Mapping[str, Any]) -> str:
    return f"{_n(found['mean'])}&nbsp;±&nbsp;{_n(found['sd'])}"


def _comparison_table(folder: Comparison) -> str:
    braces: Mapping[str, Any] = folder.data.get("braces", {})
    heads = ["", *("no brace" if name == compare.NONE else escape(name) for name in braces)]
    rows = []
    for label, key, factor in compare.LINES:
        cells = [b.get("metrics", {}).get(key) for b in braces.values()]
        if any(c and c.get("value") is not None for c in cells):
            rows.append([escape(label.strip()), *(_estimate(c, factor) for c in cells)])
        changes = [(b.get("difference_to_none") or {}).get(key) for b in braces.values()]
        if key in compare.CHANGED and any(changes):
            rows.append(["&nbsp; change against none", *(_estimate(c, factor, True) for c in changes)])
    for kind in dict.fromkeys(posture.rpartition("_")[0] for posture in compare.POSTURES):
        held = [b.get("resistance_Nm") for b in braces.values()]
        if any(held):
            rows.append(
                [
                    f"resists {kind} of 5 / 10° [N·m]",
                    *(f"{_n(h[f'{kind}_5deg'])} / {_n(h[f'{kind}_10deg'])}" if h else "" for h in held),
                ]
            )
    total = folder.data.get("landings", "")
    rows.append(
        [
            "landings completed",
            *(
                f"{b.get('n_completed', '')} of {total}" if b.get("status") == "completed" else "failed"
                for b in braces.values()
            ),
        ]
    )
    note = (
        "Means, with 95 % intervals where the landings are a random sample; changes are paired over the same landings."
    )
    return _table(heads, rows) + f"<p class='about'>{note}</p>"


def _estimate(e: Mapping[str, Any] | None, factor: float, sign: bool = False) -> str:
    if not e or e.get("value") is None:
        return ""
    value = factor * float(e["value"])
    return (_signed(value, 2) if sign else _n(value)) + _ci(e, factor)


def _failures(studies: Sequence[tuple[str, StudyFolder]]) -> str:
    rows = []
    for name, study in studies:
        bad = study.trials[study.trials["status"] != "completed"]
        rows += [
            [escape(name), str(r.trial), escape(str(r.status)), escape(str(getattr(r, "message", "")))]
            for r in bad.itertuples()
        ]
    if not rows:
        return ""
    more = f"<p>{len(rows) - FAILURES} more in trials.csv.</p>" if len(rows) > FAILURES else ""
    return "<h3>Failed landings</h3>" + _table(["", "trial", "status", "why"], rows[:FAILURES], "text") + more


def _sensitivities(items: Sequence[tuple[str, Run | StudyFolder]]) -> str:
    out = []
    for name, study in items:
        if not isinstance(study, StudyFolder):
            continue
        rows = []
        indices = study.head.get("sobol", {}).get("indices", {})
        if indices:
            for parameter, v in sorted(indices.items(), key=lambda kv: -(kv[1]["total"] or 0.0)):
                rows.append(
                    [
                        _parameter(parameter),
                        *(_n(v[k]) + _ci(v, 1, f"{k}_low", f"{k}_high") for k in ("first", "total")),
                    ]
                )
            heads = [escape(gallery.quantity(study.response)), "Sobol' first", "Sobol' total"]
        elif study.search is not None:
            levels = study.search.get("levels", {"": study.search})
            names = [name for v in list(levels.values())[:1] for name in v.get("importance", {})]
            for parameter in sorted(names, key=lambda p: -max(abs(v["importance"][p]) for v in levels.values())):
                rows.append([_parameter(parameter), *(_signed(v["importance"][parameter], 2) for v in levels.values())])
            heads = [
                "importance (unit vector), + raises the response",
                *(f"{level} %" if level else "design point" for level in levels),
            ]
        else:
            found = study.head.get("sensitivity", {}).get(study.response, {})
            published = study.published.get("pearson", {}) if study.response == "peak_subtalar_angle_deg" else {}
            chosen = {k: v for k, v in found.items() if not k.startswith("_")}
            sobol = any("sobol_total" in v for v in chosen.values())
            for parameter, v in sorted(chosen.items(), key=lambda kv: -abs(kv[1]["pearson"]["value"] or 0.0)):
                row = [
                    _parameter(parameter),
                    _signed(v["pearson"]["value"], 2)
                    + _ci(v["pearson"], 1, "low", "high")
                    + _beside(published.get(parameter)),
                ]
                error = v.get("standard_error", {}).get("dsd_dsd")
                row += [
                    _signed(v["dsd_dmean"], 2),
                    _signed(v["dsd_dsd"], 2)
                    + (f"<span class='ci'>± {error:.2f} SE</span>" if error is not None else ""),
                ]
                rows.append(row + ([f"{_n(v.get('sobol_first'))} / {_n(v.get('sobol_total'))}"] if sobol else []))
            heads = [escape(gallery.quantity(study.response)), "Pearson's r", "dSD/dmean", "dSD/dSD"] + (
                ["Sobol' first / total"] if sobol else []
            )
        if rows:
            out.append((name, _table(heads, rows)))
    return _folded(out)


def _metrics(items: Sequence[tuple[str, Run | StudyFolder]]) -> str:
    out = []
    for name, item in items:
        if isinstance(item, Run):
            rows = [[escape(plots.label(k)), _n(v), unit_of(k)] for k, v in item.head.get("metrics", {}).items()]
            out.append((name, _table(["response", "value", "unit"], rows)))
        elif item.head.get("responses"):
            table3 = item.published.get("metrics", {})
            rows = []
            for key, r in item.head["responses"].items():
                p = r["percentiles"]
                there = f"{table3[key][0]:g}&nbsp;±&nbsp;{table3[key][1]:g}" if key in table3 else ""
                levels = [_n(p.get(level, {}).get("value")) for level in ("5", "50", "95")]
                rows.append([escape(plots.label(key)), unit_of(key), _mean_sd(r), there, *levels])
            heads = ["response", "unit", "mean ± SD", "published", "5 %", "50 %", "95 %"]
            if not any(row[3] for row in rows):
                heads.pop(3)
                rows = [row[:3] + row[4:] for row in rows]
            out.append((name, _table(heads, rows)))
    note = (
        "<p class='about'>JCS angles are raw (not zeroed), moments are those at the time of the axis' own peak and "
        "positive when they resist.</p>"
    )
    return _folded(out) + note if out else ""


def _inputs(items: Sequence[tuple[str, Run | StudyFolder]]) -> str:
    out = []
    for name, item in items:
        if isinstance(item, Run):
            fixed: Mapping[str, Any] = item.head.get("parameters", {})
            varied: Mapping[str, Any] = {}
        else:
            fixed = item.manifest.get("identity", {}).get("parameters") or item.file.get("parameters", {})
            columns = {str(c).partition(" [")[0] for c in item.trials.columns}
            varied = {k: v for k, v in item.file.get("marginals", {}).items() if k in columns}
        rows = [[_parameter(k), escape(_distribution(v))] for k, v in varied.items()]
        rows += [[_parameter(k), escape(str(v))] for k, v in fixed.items() if k not in varied]
        if item.head.get("dropped"):
            rows.append(["dropped, the device has none", escape(", ".join(str(d) for d in item.head["dropped"]))])
        if rows:
            out.append((name, _table(["input", "value or distribution"], rows, "text")))
    note = (
        "<p class='about'>Quantities without a unit are dimensionless. Everything not listed is at the default of "
        "its FMU.</p>"
    )
    return _folded(out) + note if out else ""


def _distribution(spec: Any) -> str:
    if not isinstance(spec, dict):
        return str(spec)
    parts = []
    for kind, values in spec.items():
        inner = ", ".join(f"{k} {v}" for k, v in values.items()) if isinstance(values, dict) else str(values)
        parts.append(f"{kind}: {inner}")
    return "; ".join(parts)


def _provenance(items: Sequence[tuple[str, Run | StudyFolder]]) -> str:
    out = []
    for name, item in items:
        head, manifest = item.head, item.manifest
        rows = [["folder", item.path.name], ["scenario or study", head.get("study") or head.get("scenario", "")]]
        rows += [
            [key, manifest[key]]
            for key in ("command", "created", "seed", "study_digest", "platform")
            if manifest.get(key) is not None
        ]
        if "seed" not in manifest and head.get("seed") is not None:
            rows.append(["seed", head["seed"]])
        versions = manifest.get("versions") or {}
        rows += [["versions", ", ".join(f"{k} {v}" for k, v in versions.items())]] if versions else []
        if isinstance(item, Run):
            rows += [
                [
                    "coupling",
                    f"{head['scheme']} every {1e3 * head.get('communication_step_s', math.nan):g} ms; "
                    f"{head.get('scheme_reason', '')}",
                ]
            ]
            rows += [["versions", f"sprain-cosim {head['version']}"]] if head.get("version") else []
        ran = manifest.get("fmus") or {
            n: {"file": f, "sha256": head.get("sha256", {}).get(n)} for n, f in head.get("fmus", {}).items()
        }
        for fmu, fact in ran.items():
            digest = f"  sha256 {fact['sha256']}" if fact and fact.get("sha256") else ""
            rows.append([f"FMU {fmu}", f"{Path(str((fact or {}).get('file'))).name}{digest}"])
        out.append(
            (
                name,
                _table(
                    ["", ""], [[escape(str(k)), f"<code>{escape(str(v))}</code>"] for k, v in rows if str(v)], "text"
                ),
            )
        )
    sources = (
        "Model and studies: A. J. Yoder, A. J. Petrella, S. Farrokhi 2021, doi 10.3389/fbioe.2021.765331; M. S. "
        "DeMers, J. L. Hicks, S. L. Delp 2017, "
        "doi 10.1016/j.jbiomech.2016.11.002. Measured landings: Y. Li et al. 2018, J. Sport Health Sci."
    )
    return (
        _folded(out) + f"<p class='about'>{sources} Written by sprain-cosim {__version__} from the folders alone.</p>"
    )


def _folded(parts: Sequence[tuple[str, str]]) -> str:
    """One table as it is; several under their names, the first open."""
    if len(parts) == 1:
        return parts[0][1]
    return "".join(
        f"<details{'' if k else ' open'}><summary>{escape(name)}</summary>{content}</details>"
        for k, (name, content) in enumerate(parts)
    )


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]], kind: str = "") -> str:
    """Cells are HTML."""
    head = "".join(f"<th>{h}</th>" for h in heads)
    body = "".join("<tr>" + "".join(f"<td>{cell}</td>" for cell in row) + "</tr>" for row in rows)
    top = f"<thead><tr>{head}</tr></thead>" if any(heads) else ""
    return f'<div class="scroll"><table class="{kind}">{top}<tbody>{body}</tbody></table></div>\n'


def _parameter(name: str) -> str:
    known = PARAMETERS.get(name)
    return (
        f"{escape(known[0])} <span class='ci mono'>{escape(name)}</span>" if known else f"<code>{escape(name)}</code>"
    )


# ---- figures and charts


def _figures(drawn: Sequence[gallery.Drawn]) -> str:
    out = []
    for d in drawn:
        encoded = base64.b64encode(plots.picture(d.figure, "svg")).decode()
        caption = f"<figcaption><b>{escape(d.title)}</b>{escape(d.caption)}</figcaption>"
        out.append(
            f'<figure id="figure-{escape(d.name)}"><img alt="{escape(d.title)}" '
            f'src="data:image/svg+xml;base64,{encoded}">{caption}</figure>'
        )
    return f'<div class="figures">{"".join(out)}</div>'


def _animations(given: Sequence[Folder], items: Sequence[tuple[str, Run | StudyFolder]]) -> str:
    file, most = ANIMATION
    found = [path / file for path in dict.fromkeys([f.path for f in given] + [item.path for _, item in items])]
    shown = [p for p in found if p.is_file() and p.stat().st_size <= most]
    pictures = [
        '<figure><img alt="Animation of a landing" '
        f'src="data:image/webp;base64,{base64.b64encode(p.read_bytes()).decode()}">'
        f"<figcaption><b>Animation</b>{escape(p.parent.name)}</figcaption></figure>"
        for p in shown[:1]
    ]
    return f'<div class="figures">{"".join(pictures)}</div>' if pictures else ""


def _charts(items: Sequence[tuple[str, Run | StudyFolder]]) -> list[dict[str, Any]]:
    """What chart.js draws: distributions of studies, signals of runs."""
    looks = [
        (SERIES[k % len(SERIES)], "" if k % len(LINES) == 0 else ("7 3", "2 3", "7 3 2 3")[k % len(LINES) - 1])
        for k in range(len(items))
    ]
    charts, options = [], []
    studies = [
        (name, item, look)
        for (name, item), look in zip(items, looks, strict=True)
        if isinstance(item, StudyFolder) and item.is_sample
    ]
    for response in dict.fromkeys([*(s.response for _, s, _ in studies), *EXPLORED]):
        series = []
        for name, study, (color, dash) in studies:
            values = study.done[response].dropna().to_numpy(float) if response in study.done else np.empty(0)
            if len(values) >= gallery.FEWEST:
                marks = [[v, p / 100] for p, v in gallery.sample(name, study, response).published.items()]
                series.append(
                    {"name": name, "color": color, "dash": dash, "x": _digits(np.sort(values)), "marks": marks}
                )
        if series:
            mean, sd = INJURY_INVERSION
            band = {"band": [mean - sd, mean + sd]} if response == INVERSION else {}
            text = gallery.quantity(response)
            options.append(
                {"label": text, "xlabel": text, "xunit": _spoken(response), "kind": "cdf", "series": series, **band}
            )
    hint = "Point at the curves, or touch them, to read values. Circles: published levels. Grey: injury range."
    if options:
        charts.append(
            {"id": "chart-distribution", "title": "Share of landings below a value", "hint": hint, "options": options}
        )
    runs = [(name, item, look) for (name, item), look in zip(items, looks, strict=True) if isinstance(item, Run)]
    options = []
    for title, signal, factor in plots.PANELS if runs else ():
        series = []
        for name, run, (color, dash) in runs:
            if signal in run.result.index:
                x, y = _digits(1e3 * run.result.time), _digits(factor * run.result[signal])
                series.append({"name": name, "color": color, "dash": dash, "x": x, "y": y})
        if series and any(any(s["y"]) for s in series):
            found = re.search(r"\[(.+)\]", title)
            unit = found[1] if found else ""
            options.append(
                {
                    "label": title,
                    "xlabel": "time after contact [ms]",
                    "xunit": "ms",
                    "unit": unit,
                    "kind": "line",
                    "series": series,
                }
            )
    if options:
        charts.append(
            {
                "id": "chart-time",
                "title": "Signals over time",
                "hint": "Point at the curves, or touch them, to read values.",
                "options": options,
            }
        )
    return charts


def _explore(charts: Sequence[Mapping[str, Any]]) -> str:
    return "".join(
        f'<h3>{escape(str(c["title"]))}</h3><div class="explore" id="{c["id"]}"><noscript>Needs JavaScript; the '
        "figures below show the same.</noscript></div>"
        for c in charts
    )


def _digits(values: np.ndarray) -> list[float]:
    return [float(f"{v:.4g}") for v in values]


# ---- numbers in words


def _spoken(response: str) -> str:
    return {"deg": "°", "deg/s": "°/s"}.get(unit_of(response), unit_of(response))


def _unit(response: str) -> str:
    unit = unit_of(response)
    return {"deg": "°", "deg/s": "°/s", "": ""}.get(unit, f" {unit}")


def _n(value: Any) -> str:
    """Three or four figures that a reader can use."""
    if value is None or not isinstance(value, int | float) or not math.isfinite(value):
        return "–"
    size = abs(value)
    text = (
        f"{value:.0f}"
        if size >= 1000
        else f"{value:.1f}"
        if size >= 10
        else f"{value:.2f}"
        if size >= 0.1 or size < 5e-4
        else f"{value:.3f}"
    )
    return text.replace("-0.00", "0.00").replace("-", "−")


def _signed(value: Any, digits: int = 1) -> str:
    return "–" if value is None else f"{round(value, digits) + 0.0:+.{digits}f}".replace("-", "−")


def _percent(p: float) -> str:
    return f"{100 * p:.2g} %" if p < 0.1 else f"{100 * p:.0f} %"


def _interval(entry: Mapping[str, Any], factor: float, unit: str, negate: bool = False) -> str:
    low, high = entry.get("ci_low"), entry.get("ci_high")
    if low is None or high is None:
        return ""
    ends = sorted(factor * (-v if negate else v) for v in (low, high))
    return f" (95 % interval {_n(ends[0])} … {_n(ends[1])}{unit})"


def _ci(entry: Mapping[str, Any], factor: float = 1, low: str = "ci_low", high: str = "ci_high") -> str:
    a, b = entry.get(low), entry.get(high)
    return "" if a is None or b is None else f"<span class='ci'>{_n(factor * a)} … {_n(factor * b)}</span>"


def _beside(published: Any) -> str:
    return "" if published is None else f"<span class='ci'>published {published:g}</span>".replace("-", "−")
