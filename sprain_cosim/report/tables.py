"""The tables of the report: numbers, sensitivities, all responses, inputs, provenance."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from .. import __version__
from .. import figures as plots
from ..brace.comparison import CHANGED, LINES, PEAKS, postures
from ..figures.selection import Named, response_label
from ..figures.style import PARAMETERS
from ..folders.comparison import INJURY, NONE, BraceSummary, ComparisonFolder, MeanEstimate, called
from ..folders.read import Folder
from ..folders.run import RunFolder, RunSummary
from ..folders.study import StudyFolder
from ..metrics import pose_artefacts, table, unit_of
from ..records import ends_of
from ..study.manifest import FmuFile
from ..study.summary import FormSearch, LevelSearch, LevelTest, Percentile, Probability, Response, SobolSearch
from ..units import FINEST, RARE, percentage, percentage_ends, shown_unit
from .blocks import Block, Cell, Folded, Heading, PageTable, Paragraph, Row, probability_cell
from .design import design_blocks
from .persons import groups_table, persons_tables, who_landed
from .words import UNKNOWN, ends, percent, rounded, signed

FAILURES = 20  # rows of the table of failed trials
SOURCES = (
    "Model and studies: A. J. Yoder, A. J. Petrella, S. Farrokhi 2021, doi 10.3389/fbioe.2021.765331; M. S. "
    "DeMers, J. L. Hicks, S. L. Delp 2017, "
    "doi 10.1016/j.jbiomech.2016.11.002. Measured landings: Y. Li et al. 2018, J. Sport Health Sci."
)
OF_COMPARISON = (
    "Means, with 95 % intervals where the landings are a random sample; changes are paired over the same landings."
)
OF_ONE_LANDING = "One landing with each brace: what others would give is not known."
OF_LEVELS = "Small: 95 % intervals."
PUBLISHED = "“published”: the same study in Yoder et al. 2021."
OF_FACTORS = (
    "Pearson's r: + raises the response. dSD/dmean and dSD/dSD: by how much the response's "
    "standard deviation follows the input's mean and standard deviation, both normalised. Small: 95 % intervals."
)
OF_METRICS = (
    "JCS angles are raw (not zeroed), moments are those at the time of the axis' own peak and positive when they "
    "resist."
)
OF_INPUTS = "Quantities without a unit are dimensionless. Everything not listed is at the default of its FMU."

Studies = Sequence[tuple[str, StudyFolder]]
Parts = list[tuple[str, PageTable]]


def numbers_tables(folders: Sequence[Folder], items: Sequence[Named]) -> list[Block]:
    """What a reader wants first: of comparisons, studies and landings."""
    blocks: list[Block] = []
    comparisons = [folder for folder in folders if isinstance(folder, ComparisonFolder)]
    for folder in comparisons:
        about = OF_COMPARISON if folder.summary.is_study else OF_ONE_LANDING
        blocks += [_comparison(folder), Paragraph(about, "about")]
        blocks += persons_tables(folder.summary.persons) if folder.summary.persons else []
    studies = [(n, s) for n, s in items if isinstance(s, StudyFolder) and s.is_sample]
    if studies:
        published = f" {PUBLISHED}" if any(s.published_peak for _, s in studies) else ""
        blocks += [_levels(studies), Paragraph(OF_LEVELS + published, "about")]
    blocks += _searches(items)
    for _, item in items:
        if isinstance(item, StudyFolder) and item.summary.design is not None:
            blocks += design_blocks(item.summary.design)
    compared = {id(member) for folder in comparisons for member in folder.members.values()}
    runs = [(n, r) for n, r in items if isinstance(r, RunFolder) and id(r) not in compared]
    if runs:
        blocks.append(_peaks(runs))
    return blocks + _failures(studies)


def _searches(items: Sequence[Named]) -> list[Block]:
    """What methods of few landings found, and what tests it."""
    blocks: list[Block] = []
    for name, item in items:
        found = None if isinstance(item, RunFolder) else item.summary.search
        if not isinstance(item, StudyFolder) or found is None:
            continue
        blocks += [Heading(name)] if len(items) > 1 else []
        if isinstance(found, FormSearch):
            orders = {"first order alone": found.first_order if found.ci_low is not None else found.probability}
            orders |= {f"second order, {formula}": p for formula, p in (found.second_order or {}).items()}
            rows: list[Row] = [[order, percent(p, RARE)] for order, p in orders.items()]
            rows.append(["reliability index β of first order", rounded(found.beta)])
            if found.ci_low is not None:
                ends_of_it = found.ci_low, found.ci_high
                cell = Cell(percent(found.probability, RARE, ends_of_it), _doubts(found, RARE))
                rows.insert(0, [f"P({plots.label(item.response)} above the threshold)", cell])
            blocks.append(PageTable(["", ""], rows))
            continue
        heads, test = [response_label(item.response), "level"], found.check
        rows = [[f"{level} %", rounded(v.value)] for level, v in found.levels.items()]
        if test is not None:
            heads.append(f"of {test.n} random landings below it [%]")
            rows = [[*row, _below(level, test)] for row, level in zip(rows, found.levels, strict=True)]
        beside = [_published(item.published_peak.get(f"{level} % [deg]")) for level in found.levels]
        rows = [[row[0], Cell(str(row[1]), notes), *row[2:]] for row, notes in zip(rows, beside, strict=True)]
        published = f" {PUBLISHED}" if any(beside) else ""
        blocks += [PageTable(heads, rows), Paragraph(OF_LEVELS + published, "about")]
    return blocks


def _below(level: str, test: LevelTest) -> str | Cell:
    """The share of random landings below a level, in percent."""
    off, (low, high) = test.off.get(level), test.ci.get(level, (None, None))
    if off is None or low is None or high is None:
        return UNKNOWN
    share = float(level)
    return Cell(f"{share + off:.3g}", (f"{share + low:.3g} … {share + high:.3g}",))


def _levels(studies: Studies) -> PageTable:
    columns = [_levels_of(study) for _, study in studies]
    labels = list(dict.fromkeys(label for column in columns for label in column))
    rows = [[label, *(column.get(label, "") for column in columns)] for label in labels]
    return PageTable(["", *(n for n, _ in studies)], rows)


def _levels_of(study: StudyFolder) -> dict[str, str | Cell]:
    """{row: cell} of the table of numbers."""
    summary = study.summary
    found = summary.responses.get(study.response)
    cells: dict[str, str | Cell] = {"initial pose": study.pose} if study.pose else {}
    cells["landings completed"] = f"{summary.n_completed} of {summary.n_requested}"
    if found is not None:
        name = response_label(study.response)
        for level in ("5", "50", "95"):
            p = found.percentiles.get(level, Percentile(None))
            beside = _published(study.published_peak.get(f"{level} % [deg]"))
            cells[f"{name}: {level} %"] = Cell(rounded(p.value), (*ends(p.ci_low, p.ci_high), *beside))
        cells[f"{name}: mean ± SD"] = _mean_sd(found)
    elif study.response in study.done and len(values := study.done[study.response].dropna()):
        cells[f"{response_label(study.response)}: all"] = ", ".join(rounded(v) for v in sorted(values.tolist()))
    for key, q in summary.questions.items():
        own = "" if q.source == "own" else ", literature"
        label = f"P({plots.label(q.response or key).partition(', +')[0]} {q.event}){own}"
        cells[label] = Cell(percent(q.probability, interval=(q.ci_low, q.ci_high)), _doubts(q))
    return cells


def _doubts(q: Probability | FormSearch, finest: float = FINEST) -> tuple[str, ...]:
    """What the sample and what the threshold leave open, a line each."""
    lines = [f"sample {e}" for e in percentage_ends(q.ci_low, q.ci_high, finest)]
    if q.threshold_ci is not None:
        behind = f"threshold, n = {q.specimens}:" if q.specimens else "threshold's ends"
        lines += [f"{behind} {e}" for e in percentage_ends(*q.threshold_ci, finest)]
    if (shapes := ends_of(q.shapes)) is not None:
        lines += [f"threshold's shape {e}" for e in percentage_ends(*shapes, finest)]
    return tuple(lines)


def _peaks(runs: Sequence[tuple[str, RunFolder]]) -> PageTable:
    columns = [{label: (value, unit, at) for label, value, unit, at in table(run.result)} for _, run in runs]
    units = {label: unit for column in columns for label, (_, unit, _) in column.items()}

    def cell(column: Mapping[str, tuple[float, str, float]], label: str, run: RunFolder) -> str | Cell:
        if label not in column:
            return ""
        value, _, at = column[label]
        doubt = run.summary.coupling_doubt_deg if label == next(iter(units)) else None
        by_the_step = () if doubt is None else (f"step ± {doubt:.2g}",)
        return Cell(rounded(value), (f"at {1e3 * at:.1f} ms", *by_the_step))

    rows: list[Row] = [
        [f"{label} [{unit}]", *(cell(column, label, run) for column, (_, run) in zip(columns, runs, strict=True))]
        for label, unit in units.items()
    ]
    shares = [run.summary.coupling_error for _, run in runs]
    if any(share is not None for share in shares):
        rows.append(
            ["coupling error [% of the energy exchanged]", *("" if s is None else percentage(s) for s in shares)]
        )
    return PageTable(["", *(n for n, _ in runs)], rows)


def _comparison(folder: ComparisonFolder) -> PageTable:
    braces = folder.summary.braces
    rows: list[Row] = []
    for label, key, factor in LINES:
        found = [b.metrics.get(key) for b in braces.values()]
        if any(e and e.value is not None for e in found):
            cells = (
                probability_cell(e, b.injury_doubt)
                if key == INJURY
                else _estimate(e, factor, step=b.coupling_doubt_deg if key == PEAKS[0] else None)
                for e, b in zip(found, braces.values(), strict=True)
            )
            rows.append([label.strip(), *cells])
        changes = [b.difference_to_none.get(key) for b in braces.values()]
        if key in CHANGED and any(changes):
            cells = (
                _share_changed(e, b.injury_doubt_against(braces.get(NONE)))
                if key == INJURY
                else _estimate(e, factor, True)
                for e, b in zip(changes, braces.values(), strict=True)
            )
            rows.append(["\u00a0 change against none", *cells])
    for motion in postures():
        held = [_held(b, motion) for b in braces.values()]
        if any(held):
            rows.append([f"resists {motion} of 5 / 10° [N·m]", *held])
    rows.append(["landings completed", *map(folder.summary.completion, braces.values())])
    return PageTable(["", *map(called, braces)], rows)


def _estimate(e: MeanEstimate | None, factor: float, sign: bool = False, step: float | None = None) -> str | Cell:
    """`step`: what the communication step leaves open of the value, in its unit."""
    if e is None or e.value is None:
        return ""
    value = factor * e.value
    by_the_step = () if step is None else (f"step ± {step:.2g}",)
    return Cell(signed(value, 2) if sign else rounded(value), (*ends(e.ci_low, e.ci_high, factor), *by_the_step))


def _share_changed(e: MeanEstimate | None, shapes: tuple[float, float] | None) -> str | Cell:
    """The change of a probability in percentage points, with both of its doubts."""
    if e is None or e.value is None:
        return ""
    doubts = [f"landings {line}" for line in ends(e.ci_low, e.ci_high, 100)]
    low, high = shapes or (None, None)
    doubts += [f"threshold's shape {line}" for line in ends(low, high, 100)]
    return Cell(signed(100 * e.value, 2), tuple(doubts))


def _held(brace: BraceSummary, motion: str) -> str:
    held = brace.resistance_Nm
    return " / ".join(rounded(held.get(f"{motion}_{angle}deg")) for angle in (5, 10)) if held else ""


def _failures(studies: Studies) -> list[Block]:
    rows = []
    for name, study in studies:
        bad = study.trials[study.trials["status"] != "completed"]
        first = [name] if len(studies) > 1 else []
        rows += [[*first, str(r.trial), str(r.status), str(getattr(r, "message", ""))] for r in bad.itertuples()]
    if not rows:
        return []
    blocks: list[Block] = [
        Heading("Failed landings"),
        PageTable([*[""] * (len(studies) > 1), "trial", "status", "why"], rows[:FAILURES], "text"),
    ]
    return blocks + ([Paragraph(f"{len(rows) - FAILURES} more in trials.csv.")] if len(rows) > FAILURES else [])


def sensitivities_tables(items: Sequence[Named]) -> list[Block]:
    """Of each study: Sobol' indices, the importance that a search found, or correlations and factors."""
    parts: Parts = []
    for name, study in items:
        if not isinstance(study, StudyFolder):
            continue
        if study.summary.sobol is not None:
            found = _of_indices(study, study.summary.sobol)
        elif study.summary.search is not None:
            search = study.summary.search
            found = _of_event(study, search) if isinstance(search, FormSearch) else _of_importance(search)
        else:
            found = _of_factors(study)
        if found.rows:
            parts.append((name, found))
    studies = {name: study for name, study in items if isinstance(study, StudyFolder)}
    groups = groups_table({n: (s.response, (s.summary.groups or {}).get(s.response, {})) for n, s in studies.items()})
    about = [Paragraph(OF_FACTORS, "about")] if any("dSD/dSD" in table.heads for _, table in parts) else []
    return [*_folded(parts), *about, *groups]


def _of_indices(study: StudyFolder, found: SobolSearch) -> PageTable:
    rows: list[Row] = [
        [
            _parameter(parameter),
            Cell(rounded(v.first), ends(v.first_low, v.first_high)),
            Cell(rounded(v.total), ends(v.total_low, v.total_high)),
        ]
        for parameter, v in sorted(found.indices.items(), key=lambda kv: -(kv[1].total or 0.0))
    ]
    return PageTable([response_label(study.response), "Sobol' first", "Sobol' total"], rows)


def _of_event(study: StudyFolder, found: FormSearch) -> PageTable:
    units = {name: unit for name, _, unit in (str(c).rstrip("]").partition(" [") for c in study.trials.columns)}

    def point(name: str) -> str:
        value = found.design_point.get(name)
        factor, shown = shown_unit(units[name]) if name in units else (1.0, unit_of(found.response))
        return UNKNOWN if value is None else f"{factor * value:.5g} {shown}".rstrip().replace("-", "−")

    names = sorted(found.importance, key=lambda p: -abs(found.importance[p] or 0.0))
    rows: list[Row] = [[_parameter(p), signed(found.importance[p], 2), point(p)] for p in names]
    return PageTable(["+ leads to the event", "importance (unit vector)", "design point"], rows)


def _of_importance(found: LevelSearch) -> PageTable:
    columns = {f"{level} %": v.importance for level, v in found.levels.items()}
    first = next(iter(columns.values()), {})
    names = sorted(first, key=lambda p: -max(abs(c.get(p) or 0.0) for c in columns.values()))
    rows: list[Row] = [[_parameter(p), *(signed(c.get(p), 2) for c in columns.values())] for p in names]
    return PageTable(["importance (unit vector), + raises the response", *columns], rows)


def _of_factors(study: StudyFolder) -> PageTable:
    moved = study.summary.sensitivity.get(study.response)
    inputs = {} if moved is None else moved.inputs
    published = study.published_peak.get("pearson", {})
    sobol = any(v.sobol_total is not None for v in inputs.values())
    rows: list[Row] = []
    for parameter, v in sorted(inputs.items(), key=lambda kv: -abs(kv[1].pearson.value or 0.0)):
        r = v.pearson
        row: list[str | Cell] = [
            _parameter(parameter),
            Cell(signed(r.value, 2), (*ends(r.low, r.high), *_published(published.get(parameter)))),
            Cell(signed(v.dsd_dmean, 2), ends(*(v.ci.dsd_dmean or (None, None)))),
            Cell(signed(v.dsd_dsd, 2), ends(*(v.ci.dsd_dsd or (None, None)))),
        ]
        shares = ((v.sobol_first, v.sobol_first_ci), (v.sobol_total, v.sobol_total_ci), (v.shapley, v.shapley_ci))
        rows.append([*row, *([Cell(rounded(s), ends(*(ci or (None, None)))) for s, ci in shares] if sobol else [])])
    heads = [response_label(study.response), "Pearson's r", "dSD/dmean", "dSD/dSD"]
    return PageTable(heads + (["Sobol' first", "Sobol' total", "Shapley share"] if sobol else []), rows)


def metrics_tables(items: Sequence[Named]) -> list[Block]:
    """Every metric of each result."""
    parts: Parts = []
    for name, item in items:
        if isinstance(item, RunFolder):
            thrown = pose_artefacts(item.summary.metrics, item.pose)
            rows = [[_metric(k, thrown), rounded(v and _factor(k) * v)] for k, v in item.summary.metrics.items()]
            parts.append((name, PageTable(["response", "value"], rows)))
        elif item.summary.responses:
            parts.append((name, _responses(item)))
    return [*_folded(parts), Paragraph(OF_METRICS, "about")] if parts else []


def _responses(study: StudyFolder) -> PageTable:
    table3, rows = study.published.get("metrics", {}), list[list[str | Cell]]()
    thrown = pose_artefacts(study.summary.responses, study.pose)
    for key, r in study.summary.responses.items():
        there = f"{table3[key][0]:g}\u00a0±\u00a0{table3[key][1]:g}" if key in table3 else ""
        factor = _factor(key)
        levels = [
            Cell(rounded(p.value and factor * p.value), ends(p.ci_low, p.ci_high, factor))
            for p in (r.percentiles.get(level, Percentile(None)) for level in ("5", "50", "95"))
        ]
        rows.append([_metric(key, thrown), _mean_sd(r, factor), there, *levels])
    heads = ["response", "mean ± SD", "published", "5 %", "50 %", "95 %"]
    if not any(row[2] for row in rows):
        heads.pop(2)
        rows = [row[:2] + row[3:] for row in rows]
    return PageTable(heads, rows)


def _factor(key: str) -> float:
    """Times are read in milliseconds."""
    return 1e3 if unit_of(key) == "s" else 1.0


def _metric(key: str, thrown: Collection[str]) -> str | Cell:
    """The name of a metric with its unit; with a remark where the initial pose alone gives it."""
    name = f"{plots.label(key)} [ms]" if unit_of(key) == "s" else response_label(key)
    return Cell(name, ("of the published pose, not of a landing",)) if key in thrown else name


def inputs_tables(items: Sequence[Named]) -> list[Block]:
    """What was varied and what was set."""
    parts: Parts = []
    for name, item in items:
        if isinstance(item, RunFolder):
            fixed, varied = item.summary.parameters, dict[str, Any]()
        else:
            fixed = item.ran_with or item.file.parameters
            varied = {k: v for k, v in item.file.marginals.items() if k in item.varied} | _searched(item)
        rows: list[Row] = who_landed(item)
        rows += [[_parameter(k), _distribution(v)] for k, v in varied.items()]
        rows += [[_parameter(k), str(v)] for k, v in fixed.items() if k not in varied]
        if item.summary.dropped:
            rows.append(["dropped, the device has none", ", ".join(item.summary.dropped)])
        if rows:
            parts.append((name, PageTable(["input", "value or distribution"], rows, "text")))
    return [*_folded(_shared(parts)), Paragraph(OF_INPUTS, "about")] if parts else []


def _searched(study: StudyFolder) -> dict[str, str]:
    """The parameters of a design question."""
    ranges = study.manifest.identity.get("vary") or {}
    units = study.manifest.identity.get("units") or {}
    return {
        name: f"searched from {rounded(low)} to {rounded(high)} {units.get(name, '')}".strip()
        for name, (low, high) in (ranges.items() if study.summary.design is not None else ())
    }


def _distribution(spec: Any) -> str:
    if not isinstance(spec, dict):
        return str(spec)
    parts = []
    for kind, values in spec.items():
        inner = ", ".join(f"{k} {v}" for k, v in values.items()) if isinstance(values, dict) else str(values)
        parts.append(f"{kind}: {inner}")
    return "; ".join(parts)


def provenance_tables(items: Sequence[Named]) -> list[Block]:
    """Folder, command, seed, versions, FMUs."""
    parts: Parts = []
    for name, item in items:
        facts = _of_a_run(item.summary) if isinstance(item, RunFolder) else _of_a_study(item)
        rows: list[Row] = [
            [key, Cell(value, code=True)] for key, value in [("folder", item.path.name), *facts] if value
        ]
        parts.append((name, PageTable(["", ""], rows, "text")))
    written = f"Written by sprain-cosim {__version__} from the folders alone."
    return [*_folded(_shared(parts)), Paragraph(f"{SOURCES} {written}", "about")]


def _of_a_run(summary: RunSummary) -> list[tuple[str, str]]:
    step = math.nan if summary.communication_step_s is None else 1e3 * summary.communication_step_s
    return [
        ("scenario or study", summary.scenario),
        ("coupling", f"{summary.scheme} every {step:g} ms; {summary.scheme_reason}"),
        ("versions", summary.version and f"sprain-cosim {summary.version}"),
        *((f"said by {name}", said.text) for name, said in summary.fmu_messages.items()),
        *(_fmu(name, FmuFile(str(file), summary.sha256.get(name))) for name, file in summary.fmus.items()),
    ]


def _of_a_study(study: StudyFolder) -> list[tuple[str, str]]:
    manifest = study.manifest
    trials = study.summary.n_completed + study.summary.n_failed
    seed = manifest.seed if manifest.seed is not None else study.summary.seed
    return [
        ("scenario or study", study.summary.study or ""),
        ("command", manifest.command),
        ("created", manifest.created),
        ("seed", "" if seed is None else str(seed)),
        ("digest of the study", manifest.study_digest),
        ("platform", manifest.platform),
        ("processor", f"code for {', '.join(manifest.processor)}" if manifest.processor else ""),
        ("versions", ", ".join(f"{k} {v}" for k, v in manifest.versions.items())),
        *(_fmu(name, fmu) for name, fmu in manifest.fmus.items()),
        *((f"said by {n}", said.text(trials)) for n, said in study.summary.fmu_messages.items()),
    ]


def _fmu(component: str, fmu: FmuFile) -> tuple[str, str]:
    return f"FMU {component}", Path(fmu.file).name + (f"  sha256 {fmu.sha256}" if fmu.sha256 else "")


def _shared(parts: Parts) -> Parts:
    """The rows that all tables have, once; then what each has besides."""
    if len(parts) < 2:
        return parts
    common = [row for row in parts[0][1].rows if all(row in table.rows for _, table in parts[1:])]
    if not common:
        return parts
    rest = [
        (name, replace(table, rows=[row for row in table.rows if row not in common]))
        for name, table in parts
        if any(row not in common for row in table.rows)
    ]
    return [("all of them", replace(parts[0][1], rows=common)), *rest]


def _folded(parts: Parts) -> list[Block]:
    """One table as it is; several under their names."""
    return [parts[0][1]] if len(parts) == 1 else [Folded(parts)] if parts else []


def _parameter(name: str) -> Cell:
    known = PARAMETERS.get(name)
    return Cell(known[0], name=name) if known else Cell(name, code=True)


def _mean_sd(found: Response, factor: float = 1.0) -> str:
    mean, sd = (rounded(v and factor * v) for v in (found.mean, found.sd))
    return f"{mean}\u00a0±\u00a0{sd}"


def _published(figure: Any) -> tuple[str, ...]:
    return () if figure is None else (f"published {figure:g}".replace("-", "−"),)
