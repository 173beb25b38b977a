"""The tables that `study` prints: percentiles, correlations, sensitivities, moments of every metric, what a search
found, beside the published figures."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

from ..metrics import unit_of
from ..units import shown_unit
from ..uq import statistics
from .evaluation import FACTORS
from .groups import groups_listing
from .plan import Plan
from .questions import law_name
from .summary import (
    PAIR,
    Axis,
    DesignPoint,
    DesignSearch,
    DoubtedProbability,
    FormSearch,
    Grid,
    InputSensitivity,
    LevelSearch,
    Probability,
    Response,
    Sensitivity,
    SobolSearch,
    StoppingRule,
    StudySummary,
    UntilRule,
    in_figures,
)


def study_listing(study: Plan, summary: StudySummary) -> str:
    """The whole text."""
    lines = [
        f"{summary.title}  ·  {summary.method}, pose {summary.initial_pose}, "
        f"{summary.n_completed} of {summary.n_requested} trials completed, {_number(summary.wall_s, '.1f')} s wall time"
    ]
    lines += [f"failed: {count} {status}" for status, count in summary.failures.items()]
    lines += [
        f"{name}: {law_name(fit.law)} fitted to {fit.n} values of {fit.file}, AICc "
        f"{_number(fit.aicc, '.1f') or 'none'}, Anderson-Darling A² = {fit.anderson_darling:.2g}, p = {fit.p_value:.2g}"
        for name, fit in (summary.fits or {}).items()
    ]
    if summary.amv is not None:
        lines += _levels(study, summary.amv)
    elif summary.form is not None:
        lines += _form(study, summary.form)
    elif summary.sobol is not None:
        lines += _sobol(summary.sobol)
    elif summary.design is not None:
        lines += design_listing(summary.design)
    elif summary.grid is not None:
        lines += _grid(summary.grid)
    else:
        lines += _sample(study, summary)
    for name, q in summary.questions.items():
        lines += _question(name, q)
    if summary.stopping is not None:
        lines.append(_stopping(summary.stopping))
    if summary.until is not None:
        lines += _until(summary.until)
    lines += [f"note: {note}" for note in summary.notes]
    if study.beside:
        lines += ["", f"published: {study.beside['source']}"]
    elif study.published:
        lines += ["", f"published figures are of another study: this one has {', '.join(study.scenario.changes)}"]
    return "\n".join(lines)


def _question(name: str, q: Probability) -> list[str]:
    """The probability, then its two doubts apart."""
    of = "" if q.source == "own" else " (literature)"
    value = "between" if q.probability is None else f"= {_share(q.probability)}"
    lines = ["", f"P({q.response or name} {q.event}){of} {value}"]
    rows = []
    if q.sampling_ci is not None:
        counted = "" if q.trials is None else f", {q.trials} trials" + (f" ({q.failed} failed)" if q.failed else "")
        rows.append((f"sample{counted}", q.sampling_ci))
    lines += _doubt_rows(*rows, *_of_threshold(q))
    if q.inputs_ci is not None:
        lines += _doubt_rows(("specimens behind the inputs", q.inputs_ci))
    lines += _other_shapes(q)
    return [*lines, f"  {q.sentence}"] if q.sentence else lines


def _of_threshold(q: Probability | FormSearch) -> list[tuple[str, PAIR]]:
    if q.threshold_ci is None:
        return []
    return [(f"threshold, {f'n = {q.specimens}' if q.specimens else 'its ends'}", q.threshold_ci)]


def _doubt_rows(*rows: tuple[str, PAIR]) -> list[str]:
    return [f"  {label:32}{_share(low):>10} ... {_share(high)}" for label, (low, high) in rows]


def _other_shapes(q: Probability | FormSearch) -> list[str]:
    if not q.shapes:
        return []
    shapes = ", ".join(f"{law_name(law)} {_share(p)}" for law, p in q.shapes.items())
    return [f"  {'threshold of another shape':32}{'':2}{shapes}"]


def _share(p: float | None) -> str:
    """A probability with three figures."""
    return "unknown" if p is None else f"{p:.3g}"


def _stopping(rule: StoppingRule) -> str:
    widest = max((w for w in rule.half_width.values() if w is not None), default=math.nan)
    needed = ""
    if not rule.met and rule.trials_needed:
        needed = f"; about {rule.trials_needed} trials needed: --trials {rule.trials_needed} --resume"
    met = "met" if rule.met else "not met"
    return f"stopping rule, half-width {rule.wanted:g}: {met}, widest level {widest:.2g}{needed}"


def _until(rule: UntilRule) -> list[str]:
    looks = ", ".join(str(n) for n in rule.planned if n <= rule.trials)
    needed = max((w.trials_needed or 0 for w in rule.watched.values()), default=0)
    more = f"; more trials: --trials {needed} --resume" if needed else ""
    return ["", rule.sentence, f"  looks after {looks} trials, each at {100 * rule.each:.3g} %{more}"]


def _sample(study: Plan, summary: StudySummary) -> list[str]:
    published, lines = study.beside, []
    for name in study.responses if summary.responses else ():
        first = published if name == "peak_subtalar_angle_deg" else {}
        lines += ["", f"{name:34}{'here':>10}{'95 % interval':>20}" + f"{'published':>12}" * bool(first)]
        without = _without_failed(summary)
        response = summary.responses[name]
        for label, value, (low, high) in _rows(response):
            beside = _number(first.get(f"{label} [deg]"))
            # where the mean has an interval its absence beside a percentile is a lack of trials
            ends = _interval(low, high) or ("open" if response.mean_ci else "")
            line = f"  {label:32}{_number(value, 'z.2f'):>10}{ends:>20}" + f"{beside:>12}" * bool(first)
            lines.append(f"{line}{without}".rstrip())
        moved = summary.sensitivity.get(name)
        if moved is not None and moved.inputs:
            lines += _correlations(moved, published.get("pearson", {}) if first else {}, without)
            lines += _factors(moved.inputs, without)
        lines += groups_listing(name, (summary.groups or {}).get(name, {}))
    theirs = published.get("metrics", {})
    if summary.responses:
        beside = f"{'published':>16}" * bool(theirs)
        lines += ["", f"{'metric (mean ± SD)':48}{'here':>20}{beside}{_without_failed(summary)}"]
    for key, r in summary.responses.items():
        pair = theirs.get(key)
        beside = f"{pair[0]:g} ± {pair[1]:g}" if pair else ""
        places = _places(r.sd)
        lines.append(f"  {key:46}{_number(r.mean, places):>11} ± {_number(r.sd, places):<6}{beside:>16}".rstrip())
    return lines


def _places(sd: float | None) -> str:
    """One decimal, or as many as show two figures of a spread below one."""
    return f".{1 - math.floor(math.log10(sd)) if sd and 0.0 < sd < 1.0 else 1}f"


def _without_failed(summary: StudySummary) -> str:
    """What stands beside every statistic of a sample with failed trials."""
    return f"   {summary.n_failed} failed left out" if summary.n_failed else ""


def _correlations(moved: Sensitivity, published: Mapping[str, Any], without: str) -> list[str]:
    room, columns = _room(moved.inputs), dict[tuple[str, int], list[str]]()
    for key, s in moved.inputs.items():
        error = _number(s.importance_standard_error, "z.2f") or "-"
        indices = f"{_number(s.sobol_first, 'z.2f')}  {_number(s.sobol_total, 'z.2f')}"
        shapley = f"{_number(s.shapley, 'z.2f')} ({_interval(*(s.shapley_ci or (None, None)))})"
        for column, cell in {
            ("here", 10): _number(s.pearson.value, "z.2f"),
            ("95 % interval", 20): _interval(s.pearson.low, s.pearson.high),
            ("published", 12): _number(published.get(key)),
            ("importance ± SE", 18): "" if s.importance is None else f"{_number(s.importance, 'z.2f')} ± {error}",
            ("Sobol first total", 19): "" if s.sobol_first is None else indices,
            ("Shapley, 95 % interval", 26): "" if s.shapley is None else shapley,
        }.items():
            columns.setdefault(column, []).append(cell)
    known = {column: cells for column, cells in columns.items() if any(cells)}  # no heading over nothing
    lines = ["", f"{'Pearson r':{2 + room}}{''.join(f'{name:>{wide}}' for name, wide in known)}{without}"]
    for k, key in enumerate(moved.inputs):
        row = "".join(f"{cells[k]:>{wide}}" for (_, wide), cells in known.items())
        lines.append(f"  {key:{room}}{row}".rstrip())
    if moved.linear is not None:
        lines.append(
            f"  importance from a linear fit, which explains {_number(moved.linear.r2, '.0%')} of the variance"
        )
    if moved.chaos is not None:
        lines.append(
            f"  Sobol' indices and Shapley shares from polynomial chaos of degree {moved.chaos.degree}, "
            f"{moved.chaos.terms} terms, which predicts {_number(moved.chaos.q2, '.0%')} of left-out variance"
        )
    return lines


def _factors(inputs: Mapping[str, InputSensitivity], without: str) -> list[str]:
    known = {key: s for key, s in inputs.items() if any(getattr(s, f) is not None for f in FACTORS)}
    room = _room(known)
    lines = [
        "",
        f"{'sensitivity factors ± SE':{2 + room}}{'dmean/dmean':>16}{'dmean/dsd':>16}{'dsd/dmean':>16}{'dsd/dsd':>16}"
        f"    (* 95 % interval without 0){without}",
    ]
    for key, s in known.items():
        cells = []
        for f in FACTORS:
            value, error, interval = (getattr(held, f) for held in (s, s.standard_error, s.ci))
            mark = "*" if _beyond_noise(interval) else " "
            cells.append(f"{_number(value, 'z.2f') or '-'} ± {_number(error, 'z.2f') or '-'}{mark}")
        lines.append(f"  {key:{room}}" + "".join(f"{cell:>16}" for cell in cells))
    return lines


def _beyond_noise(interval: PAIR | None) -> bool:
    low, high = interval or (None, None)
    return low is not None and high is not None and (low > 0 or high < 0)


def _rows(r: Response) -> Iterable[tuple[str, float | None, PAIR]]:
    yield "mean", r.mean, r.mean_ci or (None, None)
    yield "sd", r.sd, r.sd_ci or (None, None)
    for p, e in r.percentiles.items():
        yield f"{p} %", e.value, (e.ci_low, e.ci_high)


def _ending(found: LevelSearch | FormSearch) -> list[str]:
    return [
        "",
        f"landings: {found.evaluations_requested} asked for, {found.evaluations_executed} made; the method's own test "
        f"says {found.status}",
        *(f"  {reason}" for reason in found.reasons),
    ]


def _levels(study: Plan, found: LevelSearch) -> list[str]:
    published, known = study.beside, study.beside.get("monte_carlo", {})
    lines = [
        "",
        f"{found.response:34}{'here':>10}{'published' if published else '':>12}".rstrip()
        + (f"{'their Monte Carlo':>24}   here / published against its interval" if known else ""),
    ]
    for level, entry in found.levels.items():
        key = f"{level} % [deg]"
        theirs, sampled = published.get(key), known.get(key)
        line = f"  {level + ' %':32}{_number(entry.value, 'z.2f'):>10}{_number(theirs):>12}"
        if sampled and theirs is not None:
            verdict = statistics.agreement(theirs, statistics.Estimate(*sampled))
            interval = f"{sampled[0]:g} ({sampled[1]:g} ... {sampled[2]:g})"
            line += f"{interval:>24}   {entry.against_monte_carlo} / {verdict}"
        lines.append(line.rstrip())
    room = _room(found.linear_importance)
    lines += ["", f"{'importance':{2 + room}}{'linear':>10}" + "".join(f"{level + ' %':>10}" for level in found.levels)]
    for name, value in found.linear_importance.items():
        cells = (value, *(e.importance.get(name) for e in found.levels.values()))
        lines.append(f"  {name:{room}}" + "".join(f"{_number(cell, 'z.2f'):>10}" for cell in cells))
    return lines + _tested(found) + _ending(found)


def _tested(found: LevelSearch) -> list[str]:
    check = found.check
    if check is None:
        return []
    lines = [
        "",
        f"{f'tested on {check.n} random landings':34}{'lie below':>12}{'off, points':>12}{'95 % interval':>22}",
    ]
    for level, off in check.off.items():
        low, high = check.ci[level]
        lies = "" if off is None else f"{float(level) + off:z.1f} %"
        ends = "" if low is None or high is None else f"{low:+z.1f} ... {high:+z.1f}"
        lines.append(f"  {level + ' %':32}{lies:>12}{_number(off, '+z.1f'):>12}{ends:>22}  {check.verdict[level]}")
    return lines


def _room(names: Iterable[str]) -> int:
    """Of a column of names."""
    return max(32, *(len(name) for name in names))


def _form(study: Plan, found: FormSearch) -> list[str]:
    threshold = found.threshold.distribution or _number(found.threshold.mean)
    sampled = found.ci_low is not None
    interval = f"({_share(found.ci_low)} ... {_share(found.ci_high)})" if sampled else "(first order: no interval)"
    room = _room(found.importance)
    lines = ["", f"P({found.response} > {threshold}) = {_share(found.probability)}  {interval}"]
    if sampled:
        points = "the design point" if found.design_points == 1 else f"{found.design_points} design points"
        second = ", ".join(f"{name} {_share(p)}" for name, p in (found.second_order or {}).items())
        lines += [
            f"  {f'{found.sampled} landings about {points}':32}  coefficient of variation {_number(found.cov, '.0%')}",
            f"  {'first order':32}  {_share(found.first_order)}, beta {_number(found.beta, 'z.3f')}",
            *([f"  {'second order':32}  {second}"] if second else []),
            *(f"  {remark}" for remark in found.remarks or ()),
            *_doubt_rows(*_of_threshold(found)),
            *_other_shapes(found),
            *([f"  {found.sentence}"] if found.sentence else []),
        ]
    else:
        lines.append(f"  beta {_number(found.beta, 'z.3f')}")
    lines += [
        "",
        f"  {'':{room}}{'importance':>12}{'design point':>16}",
    ]
    for name, value in found.importance.items():
        factor, shown = shown_unit(study.units[name]) if name in study.units else (1.0, unit_of(found.response))
        point = found.design_point.get(name)
        text = _number(None if point is None else factor * point, ".5g")
        lines.append(f"  {name:{room}}{_number(value, 'z.2f'):>12}{text:>16} {shown}".rstrip())
    return lines + _ending(found)


def _sobol(found: SobolSearch) -> list[str]:
    sd = None if found.variance is None else math.sqrt(found.variance)
    room = _room(found.indices)
    lines = [
        "",
        f"{found.response}: mean {_number(found.mean, 'z.3f')}, SD {_number(sd, 'z.3f')}, {found.evaluations} landings",
        "",
        f"{'Sobol indices':{2 + room}}{'first':>8}{'95 % interval':>20}{'total':>8}{'95 % interval':>20}",
    ]
    for name, i in found.indices.items():
        lines.append(
            f"  {name:{room}}{_number(i.first, 'z.2f'):>8}{_interval(i.first_low, i.first_high):>20}"
            f"{_number(i.total, 'z.2f'):>8}{_interval(i.total_low, i.total_high):>20}"
        )
    return lines


def design_listing(found: DesignSearch) -> list[str]:
    """The value that is asked for, P there, what it costs in comfort."""
    lines = ["", found.goal, f"{found.landings} landings over {_searched(found)}"]
    if len(found.points) > 1:
        lines += ["", f"{_named(found.second or '', found.second_unit):32}{found.find + ' ' + found.parameter:>30}"]
        lines[-1] += f"{'95 % interval':>24}{'holds with 95 %':>18}{'goal':>12}"
        for point in found.points:
            cells = (*_cells(found, point), found.verdict(point))
            lines.append(f"  {in_figures(point.second):<30}{cells[0]:>30}{cells[1]:>24}{cells[2]:>18}{cells[3]:>12}")
        lines += _comfort_table(found)
        return lines
    (point,) = found.points
    value, interval, sure = _cells(found, point)
    lines += [
        "",
        f"{found.find + ' ' + _named(found.parameter, found.unit):44}{value}",
        f"{'  95 % interval':44}{interval}",
        f"{'  holds with 95 % confidence':44}{sure}",
        f"{'  goal':44}{found.in_words(point)}",
        *_doubted(found, point),
    ]
    return lines + _comfort(found, point)


def _searched(found: DesignSearch) -> str:
    low, high = found.range
    return f"{found.parameter} = {in_figures(low)} ... {in_figures(high)} {found.unit}".rstrip()


def _named(name: str, unit: str | None) -> str:
    return f"{name} [{unit}]" if unit else name


def _cells(found: DesignSearch, point: DesignPoint) -> tuple[str, str, str]:
    """Value, interval and the value that holds with confidence, in words where there is none."""
    if point.status == "nowhere":
        p = point.probability.value
        most = "" if p is None else f"; at {in_figures(point.value)} P = {_share(p)}"
        return f"none in the range{most}", "", "none in the range"
    low = "below the range" if point.ci_low is None else in_figures(point.ci_low)
    high = "above the range" if point.ci_high is None else in_figures(point.ci_high)
    sure = "none in the range" if point.value_95 is None else in_figures(found.on_the_safe_side(point.value_95))
    if point.status == "everywhere":
        return f"{in_figures(point.value)} (all of the range)", "", sure
    return in_figures(point.value), f"{low} ... {high}", sure


def _doubted(found: DesignSearch, point: DesignPoint) -> list[str]:
    p: DoubtedProbability = point.probability
    at = f"P at {found.parameter} = {in_figures(point.value)}"
    lines = ["", f"{at:44}{'between' if p.value is None else _share(p.value)}"]
    if point.surface is not None:
        lines.append(f"{'  by the polynomial alone':44}{_share(point.surface)}")
    if p.sampling_ci is not None:
        lines.append(f"{f'  sample, {point.fresh} fresh landings':44}{' ... '.join(_share(e) for e in p.sampling_ci)}")
    if p.threshold_ci is not None:
        behind = f"n = {p.specimens}" if p.specimens else "its ends"
        lines.append(f"{f'  threshold, {behind}':44}{' ... '.join(_share(e) for e in p.threshold_ci)}")
    if p.shapes:
        shapes = ", ".join(f"{law_name(law)} {_share(v)}" for law, v in p.shapes.items())
        lines.append(f"{'  threshold of another shape':44}{shapes}")
    return [*lines, f"  {p.sentence}"] if p.sentence else lines


def _comfort(found: DesignSearch, point: DesignPoint) -> list[str]:
    names = {"value": "value", "value_95": "holds with 95 %", "low": "low end", "high": "high end"}
    shown = [c for c in point.comfort if c.at in names]
    if not shown:
        return []
    at = [found.on_the_safe_side(c.value) if c.at == "value_95" else c.value for c in shown]
    lines = [
        "",
        f"{'resists in ordinary motion, 5 / 10° [N·m]':44}" + "".join(f"{names[c.at]:>18}" for c in shown),
        f"{'  ' + found.parameter:44}" + "".join(f"{in_figures(value):>18}" for value in at),
    ]
    resisted, free = point.motions
    if free:
        lines.append(f"  nothing against {' and '.join(free)}")
    for motion in resisted:
        lines.append(f"{'  ' + motion:44}" + "".join(f"{_resisted(c.resistance_Nm, motion):>18}" for c in shown))
    return lines


def _comfort_table(found: DesignSearch) -> list[str]:
    """A row for each value of the second parameter."""
    held = [(p, c) for p in found.points for c in p.comfort if c.at == "value"]
    if not held:
        return []
    motions = _motions(held[0][0])
    lines = ["", f"{'resists, 5 / 10° [N·m]':32}" + "".join(f"{motion:>20}" for motion in motions)]
    for point, c in held:
        cells = "".join(f"{_resisted(c.resistance_Nm, motion):>20}" for motion in motions)
        lines.append(f"  {f'{in_figures(point.second)}, {found.parameter} {in_figures(point.value)}':30}{cells}")
    return lines


def _motions(point: DesignPoint) -> list[str]:
    return list(dict.fromkeys(name.rpartition("_")[0] for c in point.comfort for name in c.resistance_Nm))


def _resisted(held: Mapping[str, float | None], motion: str) -> str:
    torques = (held.get(f"{motion}_{d}deg") for d in (5, 10))
    return " / ".join("-" if t is None else f"{round(t, 2) + 0.0:z.2f}" for t in torques)


def _grid(grid: Grid) -> list[str]:
    lines: list[str] = []
    for name, values in grid.responses.items():
        if len(grid.axes) > 2:
            lines += ["", f"{name}: {len(grid.axes)} axes, see trials.csv"]
            continue
        rows, columns = grid.axes[0], grid.axes[1] if len(grid.axes) > 1 else None
        lines += ["", f"{name}: {_axis(rows)} down" + (f", {_axis(columns)} across" if columns else "")]
        if columns:
            lines.append(" " * 10 + "".join(f"{level:9.4g}" for level in columns.levels))
        for level, row in zip(rows.levels, values, strict=True):
            cells = row if isinstance(row, list) else [row]
            lines.append(f"{level:10.4g}" + "".join(f"{'failed' if v is None else f'{v:z.2f}':>9}" for v in cells))
    return lines


def _axis(axis: Axis) -> str:
    return f"{axis.name} [{axis.unit}]" if axis.unit else axis.name


def _interval(low: float | None, high: float | None) -> str:
    """Nothing where there is no interval; one that the sample is too small to close has an open end."""
    if low is None and high is None:
        return ""
    return " ... ".join("open" if end is None else f"{end:z.2f}" for end in (low, high))


def _number(value: float | None, form: str = "g") -> str:
    """Nothing for a number that is not known, such as the factors of a uniform input; "84 %" with a blank."""
    return "" if value is None else f"{value:{form}}".replace("%", " %")
