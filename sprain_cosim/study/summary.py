"""What a study's trials say: moments, percentiles with intervals, sensitivities, injury questions; and the published
figures beside them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from ..errors import InputError, nearest
from ..uq import reliability, sensitivity, statistics
from ..uq.distributions import Array, Marginal, Normal, Uniform
from .plan import Plan

if TYPE_CHECKING:
    import pandas as pd

PERCENTILES = (5, 50, 95)
FEWEST = 4  # completed trials for moments
LEAST = 20  # completed trials for sensitivities and probabilities
RESAMPLES = 1000  # of the bootstrap
# trials above which intervals of sensitivity factors are ± 1.96 standard errors, and polynomial chaos takes the first
# rows alone
MANY = 20_000
CHAOS_DEGREE = 3  # at most; seconds instead of minutes for ten inputs and thousands of trials
FACTORS = ("dmean_dmean", "dmean_dsd", "dsd_dmean", "dsd_dsd")
# Injury thresholds: inversion of cadaver ankles at failure, counted from the neutral pose, and the anatomy's inversion
# moment there.
QUESTIONS = {
    "peak_inversion_from_neutral_deg": ("above 35 ± 6 deg", Normal(35.0, 6.0)),
    "anatomy_jcs_inversion_moment_Nm": ("above 2.7 ... 4.3 N·m", Uniform(2.7, 4.3)),
}


def summarise(study: Plan, trials: pd.DataFrame, found: Any) -> dict[str, Any]:
    """Content of summary.json. Raises InputError for a response that is no metric.

    What the trials cannot tell is left out or null, and `notes` says why."""
    done = trials[trials["status"] == "completed"]
    failed = len(trials) - len(done)
    notes: list[str] = []
    summary: dict[str, Any] = {
        "study": study.source,
        "title": study.title,
        "method": study.method,
        "seed": study.seed,
        "initial_pose": study.scenario.initial_pose(),
        "n_requested": study.trials if found is None and study.method != "grid" else len(trials),
        "n_completed": len(done),
        "n_failed": failed,
        "failures": {
            status: int(count) for status, count in trials["status"].value_counts().items() if status != "completed"
        },
        "responses": {},
        "sensitivity": {},
        "questions": {},
        "notes": notes,
        "dropped": list(study.scenario.dropped),
    }
    metrics = list(trials.columns[3 + len(study.names) :])
    for name in study.responses:
        if len(done) and name not in metrics:
            raise InputError(f"response {name!r}: no such metric{nearest(name, metrics)}")
    if found is not None:
        match found:
            case reliability.FormResult():
                summary["form"] = _form(study, found)
            case sensitivity.SobolIndices():
                summary["sobol"] = _sobol(study, found)
            case _:
                summary["amv"] = _levels(study, found)
                summary["questions"] = _questions_of_levels(study, found, notes)
        return _finite(summary)
    sample = _Sample.of(study, done, failed, notes)
    if len(done) < FEWEST:
        notes.append(f"{len(done)} completed trials: no moments below {FEWEST}")
    elif len(done) < LEAST:
        notes.append(f"{len(done)} completed trials: no sensitivities and no probabilities below {LEAST}")
    if study.method == "grid":
        summary["grid"] = _grid(study, trials)
    for name in metrics if len(done) >= FEWEST else ():
        summary["responses"][name] = sample.response(done[name].to_numpy(float))
    if study.method == "monte-carlo" and len(done) >= LEAST:
        x = done[study.headings].to_numpy(float)
        for name in study.responses:
            summary["sensitivity"][name] = _sensitivity(study, x, done[name].to_numpy(float))
    for name, (text, threshold) in QUESTIONS.items():
        if name in done and len(done) >= LEAST and study.method != "grid":
            e = sample.exceedance(done[name].to_numpy(float), threshold)
            summary["questions"][name] = {"event": text, "probability": e.value, "ci_low": e.low, "ci_high": e.high}
    if study.half_width is not None and summary["responses"]:
        rule = statistics.stopping_of(
            {p: sample.percentile(done[study.responses[0]].to_numpy(float), p) for p in study.levels},
            len(done),
            study.half_width,
        )
        half = {f"{100 * p:g}": h for p, h in rule.half_width.items()}
        summary["stopping"] = {
            "response": study.responses[0],
            "wanted": rule.wanted,
            "half_width": half,
            "met": rule.met,
            "trials_needed": rule.needed,
        }
    return _finite(summary)


@dataclass(frozen=True)
class _Sample:
    """How the trials were drawn, hence which intervals they allow. `replicates` of a complete Sobol' study."""

    failed: int
    independent: bool
    replicates: int | None

    @classmethod
    def of(cls, study: Plan, done: pd.DataFrame, failed: int, notes: list[str]) -> Self:
        replicates = None
        if study.method == "sobol":
            whole = (
                not failed and np.array_equal(done["trial"], np.arange(len(done))) and len(done) % study.replicates == 0
            )
            if whole and study.replicates >= statistics.MIN_REPLICATES:
                replicates = study.replicates
                notes.append(f"intervals from the spread over {replicates} scrambled Sobol' sequences")
            else:
                notes.append(
                    f"no intervals of percentiles: they need {statistics.MIN_REPLICATES} complete replicates; "
                    "probabilities as from independent trials"
                )
        elif study.method == "lhs":
            notes.append(
                "one Latin hypercube has no intervals of its own: percentiles are given without; those of mean and "
                "probabilities are the ones of independent "
                "trials, which a Latin hypercube does not exceed (A. B. Owen, SIAM J. Numer. Anal. 34, 1997, 1884)"
            )
        elif study.method == "table":
            notes.append("intervals hold if the given rows are independent draws")
        elif study.method == "grid":
            notes.append("a grid is no sample: moments and percentiles describe its points, no probability is theirs")
        return cls(failed, study.method in ("monte-carlo", "table"), replicates)

    def percentile(self, y: Array, p: float) -> statistics.Estimate:
        if self.replicates:
            return statistics.replicated_percentile(y, self.replicates, p)
        e = statistics.percentile(y, p)
        return e if self.independent else statistics.Estimate(e.value, math.nan, math.nan)

    def exceedance(self, y: Array, threshold: Marginal) -> statistics.Estimate:
        if self.replicates:
            return statistics.replicated_exceedance(y, self.replicates, threshold)
        return statistics.exceedance(y, threshold, failed=self.failed)

    def response(self, y: Array) -> dict[str, Any]:
        if self.replicates:
            mean = statistics.replicated(y, self.replicates, np.mean)
            sd = statistics.replicated(y, self.replicates, lambda v: np.std(v, ddof=1))
        else:
            mean, sd = statistics.mean(y), statistics.standard_deviation(y)
        out: dict[str, Any] = {"mean": mean.value, "sd": sd.value, "percentiles": {}}
        if self.independent or self.replicates:
            out |= {"mean_ci": [mean.low, mean.high], "sd_ci": [sd.low, sd.high]}
        for p in PERCENTILES:
            e = self.percentile(y, p / 100)
            entry: dict[str, Any] = {"value": e.value, "ci_low": e.low, "ci_high": e.high}
            if self.failed:
                entry["with_failures"] = list(statistics.percentile_bounds(y, self.failed, p / 100))
            out["percentiles"][str(p)] = entry
        return out


def _grid(study: Plan, trials: pd.DataFrame) -> dict[str, Any]:
    """The responses as an array of the grid's shape (nested lists, null where a trial failed), in the order of
    `axes`."""
    shape = [len(levels) for levels in study.grid.values()]
    axes = [{"name": name, "unit": study.units[name], "levels": list(levels)} for name, levels in study.grid.items()]
    if len(trials) != math.prod(shape):
        return {"axes": axes, "responses": {}}
    values = {
        name: trials[name].where(trials["status"] == "completed").to_numpy(float).reshape(shape)
        for name in study.responses
        if name in trials
    }
    return {"axes": axes, "responses": {name: v.tolist() for name, v in values.items()}}


def _sensitivity(study: Plan, x: Array, y: Array) -> dict[str, Any]:
    marginals = tuple(study.marginals.values())
    active = [i for i, m in enumerate(marginals) if not m.is_fixed]
    if not active or not np.ptp(y) > 0:
        return {}
    r, rho = sensitivity.pearson(x[:, active], y), sensitivity.spearman(x[:, active], y)
    factors = sensitivity.sensitivity_factors(
        x, y, marginals, study.correlation, resamples=RESAMPLES if len(y) <= MANY else 0, seed=study.seed
    )
    fit = sensitivity.importance(x, y, marginals, study.correlation) if len(y) > len(active) + 1 else None
    names = list(study.names)
    out: dict[str, Any] = {}
    for k, i in enumerate(active):
        out[names[i]] = {
            "pearson": _correlation(r, k),
            "spearman": _correlation(rho, k),
            **{f: float(getattr(factors, f)[i]) for f in FACTORS},
            "standard_error": {f: float(getattr(factors.standard_error, f)[i]) for f in FACTORS},
            "ci": {f: _factor_interval(factors, f, i) for f in FACTORS},
        }
        if fit is not None:
            out[names[i]] |= {
                "importance": float(fit.alpha[i]),
                "importance_standard_error": float(fit.standard_error[i]),
            }
    if fit is not None:
        out["_importance"] = {"r2": fit.r2}
    if study.correlation is None and len(y) >= 100:
        given = sensitivity.given_data_indices(x[:MANY], y[:MANY], marginals, CHAOS_DEGREE)
        for i in active:
            out[names[i]] |= {"sobol_first": float(given.first[i]), "sobol_total": float(given.total[i])}
        out["_given_data"] = {"degree": given.degree, "terms": given.terms, "q2": given.q2}
    return out


def _factor_interval(factors: sensitivity.SensitivityFactors, name: str, i: int) -> list[float]:
    if factors.low and factors.high:
        return [float(getattr(end, name)[i]) for end in (factors.low, factors.high)]
    value, half = float(getattr(factors, name)[i]), 1.96 * float(getattr(factors.standard_error, name)[i])
    return [value - half, value + half]


def _correlation(r: sensitivity.Correlation, k: int) -> dict[str, float]:
    return {name: float(np.atleast_1d(value)[k]) for name, value in asdict(r).items()}


def _ended(found: Any) -> dict[str, Any]:
    return {
        "evaluations_requested": found.evaluations.requested,
        "evaluations_executed": found.evaluations.executed,
        "status": found.status,
        "reasons": list(found.reasons),
    }


def _named(study: Plan, values: Any, *more: str) -> dict[str, float]:
    return dict(zip((*study.names, *more), (float(v) for v in values), strict=True))


def _form(study: Plan, found: reliability.FormResult) -> dict[str, Any]:
    uncertain = isinstance(study.threshold, Marginal)
    threshold = (
        {"distribution": repr(study.threshold), "mean": study.threshold.mean}
        if isinstance(study.threshold, Marginal)
        else study.threshold
    )
    more = ("threshold",) if uncertain else ()
    return _ended(found) | {
        "response": study.responses[0],
        "beta": found.beta,
        "probability": found.probability,
        "threshold": threshold,
        "importance": _named(study, found.alpha, *more),
        "design_point": _named(study, found.design_point, *more),
    }


def _sobol(study: Plan, found: sensitivity.SobolIndices) -> dict[str, Any]:
    ends = ("first", "first_low", "first_high", "total", "total_low", "total_high")
    return {
        "response": study.responses[0],
        "mean": found.mean,
        "variance": found.variance,
        "evaluations": found.evaluations,
        "indices": {name: {end: float(getattr(found, end)[i]) for end in ends} for i, name in enumerate(study.names)},
    }


def _levels(study: Plan, found: reliability.LevelResult) -> dict[str, Any]:
    levels = {}
    for p, value in found.value.items():
        key = f"{100 * p:g}"
        levels[key] = {
            "value": value,
            "importance": _named(study, found.importance[p]),
            "design_point": _named(study, found.design_point[p]),
        }
        levels[key]["iterations"] = found.iterations[p]
        known = study.published.get("monte_carlo", {}).get(f"{key} % [deg]")
        if known:  # a method of the mean value family matches Monte Carlo if it lies in its interval
            levels[key]["against_monte_carlo"] = statistics.agreement(value, statistics.Estimate(*known))
    return _ended(found) | {
        "response": study.responses[0],
        "levels": levels,
        "linear_importance": _named(study, found.linear_importance),
        "mean": found.mean,
        "sd": found.sd,
    }


def _questions_of_levels(study: Plan, found: reliability.LevelResult, notes: list[str]) -> dict[str, Any]:
    name = study.responses[0]
    if name not in QUESTIONS:
        notes.append(
            f"no injury probabilities: they need a response among {', '.join(QUESTIONS)}, or method form with a "
            "threshold"
        )
        return {}
    text, threshold = QUESTIONS[name]
    notes.append(
        "probabilities interpolate the levels; a search has no sampling error, and its own error is not known: no "
        "interval"
    )
    try:
        return {
            name: {
                "event": text,
                "probability": statistics.exceedance_of_levels(found.value, threshold),
                "ci_low": None,
                "ci_high": None,
            }
        }
    except ValueError as problem:
        notes.append(f"no probability: {problem}")
        return {}


def _finite(value: Any) -> Any:
    """JSON has no NaN nor infinity: null."""
    if isinstance(value, Mapping):
        return {k: _finite(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(v) for v in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def text(study: Plan, summary: Mapping[str, Any]) -> str:
    """The tables that `study` prints: percentiles, correlations, sensitivities, moments of every metric, beside the
    published figures."""
    lines = [
        f"{summary['title']}  ·  {summary['method']}, pose {summary['initial_pose']}, "
        f"{summary['n_completed']} of {summary['n_requested']} trials completed, {summary['wall_s']:.1f} s wall time"
    ]
    lines += [f"failed: {count} {status}" for status, count in summary["failures"].items()]
    if "amv" in summary:
        lines += _level_lines(study, summary["amv"])
    elif "form" in summary:
        lines += _form_lines(summary["form"])
    elif "sobol" in summary:
        lines += _sobol_lines(summary["sobol"])
    elif "grid" in summary:
        lines += _grid_lines(summary["grid"])
    else:
        lines += _sample_lines(study, summary)
    for key, q in summary["questions"].items():
        bounds = "" if q["ci_low"] is None else f"  ({q['ci_low']:.3f} ... {q['ci_high']:.3f})"
        lines.append(f"P({key} {q['event']}) = {q['probability']:.3f}{bounds}")
    if "stopping" in summary:
        rule = summary["stopping"]
        widest = max((w for w in rule["half_width"].values() if w is not None), default=math.nan)
        needed = (
            f"; about {rule['trials_needed']} trials needed: --trials {rule['trials_needed']} --resume"
            if not rule["met"] and rule["trials_needed"]
            else ""
        )
        lines.append(
            f"stopping rule, half-width {rule['wanted']:g}: {'met' if rule['met'] else 'not met'}, widest level "
            f"{widest:.2g}{needed}"
        )
    lines += [f"note: {note}" for note in summary["notes"]]
    if study.published:
        lines += ["", f"published: {study.published['source']}"]
    return "\n".join(lines)


def _sample_lines(study: Plan, summary: Mapping[str, Any]) -> list[str]:
    published, lines = study.published, []
    for name in study.responses if summary["responses"] else ():
        r = summary["responses"][name]
        lines += ["", f"{name:34}{'here':>10}{'95 % interval':>20}{'published':>12}"]
        first = published if name == "peak_subtalar_angle_deg" else {}
        for label, value, low, high in _statistics(r):
            lines.append(
                f"  {label:32}{value:10.2f}{_interval(low, high):>20}{_number(first.get(f'{label} [deg]')):>12}"
            )
        sensitivities = summary["sensitivity"].get(name, {})
        table = {k: v for k, v in sensitivities.items() if not k.startswith("_")}
        if not table:
            continue
        lines += [
            "",
            f"{'Pearson r':34}{'here':>10}{'95 % interval':>20}{'published':>12}{'importance ± SE':>18}"
            f"{'Sobol first total':>19}",
        ]
        for key, s in table.items():
            shown = published.get("pearson", {}).get(key) if first else None
            p = s["pearson"]
            alpha = f"{s['importance']:.2f} ± {s['importance_standard_error']:.2f}" if "importance" in s else ""
            indices = f"{s['sobol_first']:.2f}  {s['sobol_total']:.2f}" if "sobol_first" in s else ""
            lines.append(
                f"  {key:32}{p['value']:10.2f}{_interval(p['low'], p['high']):>20}{_number(shown):>12}"
                f"{alpha:>18}{indices:>19}"
            )
        if "_given_data" in sensitivities:
            g = sensitivities["_given_data"]
            lines.append(
                f"  Sobol' indices from polynomial chaos of degree {g['degree']}, {g['terms']} terms, which predicts "
                f"{g['q2']:.0%} of left-out variance"
            )
        lines += [
            "",
            f"{'sensitivity factors ± SE':34}{'dmean/dmean':>16}{'dmean/dsd':>16}{'dsd/dmean':>16}{'dsd/dsd':>16}    "
            "(* 95 % interval without 0)",
        ]
        for key, s in table.items():
            cells = [
                f"{_fixed(s[f])} ± {_fixed(s['standard_error'][f])}{'*' if _beyond_noise(s['ci'][f]) else ' '}"
                for f in FACTORS
            ]
            lines.append(f"  {key:32}" + "".join(f"{cell:>16}" for cell in cells))
    if summary["responses"]:
        lines += ["", f"{'metric (mean ± SD)':48}{'here':>20}{'published':>16}"]
        for key, r in summary["responses"].items():
            pair = published.get("metrics", {}).get(key)
            lines.append(
                f"  {key:46}{r['mean']:11.1f} ± {r['sd']:<6.1f}{f'{pair[0]:g} ± {pair[1]:g}' if pair else '':>16}"
            )
    return lines


def _beyond_noise(interval: Sequence[float | None]) -> bool:
    low, high = interval
    return low is not None and high is not None and (low > 0 or high < 0)


def _statistics(r: Mapping[str, Any]) -> list[tuple[str, float, float | None, float | None]]:
    mean, sd = r.get("mean_ci", (None, None)), r.get("sd_ci", (None, None))
    rows = [("mean", r["mean"], *mean), ("sd", r["sd"], *sd)]
    return rows + [(f"{p} %", e["value"], e["ci_low"], e["ci_high"]) for p, e in r["percentiles"].items()]


def _ending(found: Mapping[str, Any]) -> list[str]:
    lines = [
        "",
        f"evaluations: {found['evaluations_requested']} requested, {found['evaluations_executed']} executed; gate: "
        f"{found['status']}",
    ]
    return lines + [f"  {reason}" for reason in found["reasons"]]


def _level_lines(study: Plan, found: Mapping[str, Any]) -> list[str]:
    published, known = study.published, study.published.get("monte_carlo", {})
    lines = [
        "",
        f"{found['response']:34}{'here':>10}{'published':>12}"
        + (f"{'their Monte Carlo':>24}   here / published against its interval" if known else ""),
    ]
    for level, entry in found["levels"].items():
        key = f"{level} % [deg]"
        theirs, sampled = published.get(key), known.get(key)
        line = f"  {level + ' %':32}{entry['value']:10.2f}{_number(theirs):>12}"
        if sampled and theirs is not None:
            verdict = statistics.agreement(theirs, statistics.Estimate(*sampled))
            line += (
                f"{f'{sampled[0]:g} ({sampled[1]:g} ... {sampled[2]:g})':>24}   {entry['against_monte_carlo']} / "
                f"{verdict}"
            )
        lines.append(line)
    lines += ["", f"{'importance':34}{'linear':>10}" + "".join(f"{level + ' %':>10}" for level in found["levels"])]
    for name, value in found["linear_importance"].items():
        lines.append(
            f"  {name:32}{value:10.2f}" + "".join(f"{e['importance'][name]:10.2f}" for e in found["levels"].values())
        )
    return lines + _ending(found)


def _form_lines(found: Mapping[str, Any]) -> list[str]:
    threshold = found["threshold"]
    shown = threshold["distribution"] if isinstance(threshold, Mapping) else f"{threshold:g}"
    lines = [
        "",
        f"P({found['response']} > {shown}) = {found['probability']:.4g}   beta {found['beta']:.3f}   (first order: no "
        "interval)",
    ]
    lines += ["", f"{'':34}{'importance':>12}{'design point':>16}"]
    lines += [
        f"  {name:32}{value:12.2f}{found['design_point'][name]:16.5g}" for name, value in found["importance"].items()
    ]
    return lines + _ending(found)


def _sobol_lines(found: Mapping[str, Any]) -> list[str]:
    lines = [
        "",
        f"{found['response']}: mean {found['mean']:.3f}, SD {math.sqrt(found['variance']):.3f}, "
        f"{found['evaluations']} landings",
    ]
    lines += ["", f"{'Sobol indices':34}{'first':>8}{'95 % interval':>20}{'total':>8}{'95 % interval':>20}"]
    for name, i in found["indices"].items():
        lines.append(
            f"  {name:32}{i['first']:8.2f}{_interval(i['first_low'], i['first_high']):>20}"
            f"{i['total']:8.2f}{_interval(i['total_low'], i['total_high']):>20}"
        )
    return lines


def _grid_lines(grid: Mapping[str, Any]) -> list[str]:
    lines: list[str] = []
    for name, values in grid["responses"].items():
        rows, columns = (grid["axes"] * 2)[:2] if len(grid["axes"]) > 1 else (grid["axes"][0], None)
        if len(grid["axes"]) > 2:
            lines += ["", f"{name}: {len(grid['axes'])} axes, see trials.csv"]
            continue
        lines += ["", f"{name}: {_axis(rows)} down" + (f", {_axis(columns)} across" if columns else "")]
        if columns:
            lines.append(" " * 10 + "".join(f"{level:9.4g}" for level in columns["levels"]))
        for level, row in zip(rows["levels"], values, strict=True):
            cells = row if isinstance(row, list) else [row]
            lines.append(f"{level:10.4g}" + "".join(f"{'failed' if v is None else f'{v:.2f}':>9}" for v in cells))
    return lines


def _axis(axis: Mapping[str, Any]) -> str:
    return f"{axis['name']} [{axis['unit']}]" if axis["unit"] else str(axis["name"])


def _interval(low: float | None, high: float | None) -> str:
    return "" if low is None or high is None else f"{low:.2f} ... {high:.2f}"


def _fixed(value: float | None) -> str:
    """Two decimals; '-' for a factor that is not defined, such as those of a uniform input."""
    return "-" if value is None else f"{value:.2f}"


def _number(value: Any) -> str:
    return "" if value is None else f"{value:g}"
