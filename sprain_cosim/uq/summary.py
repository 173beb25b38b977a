"""What a study's trials say: moments, percentiles with intervals, sensitivities, injury questions; and the published figures beside them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import InputError, nearest
from . import reliability, sensitivity, statistics
from .distributions import Normal, Uniform
from .study import Study

if TYPE_CHECKING:
    import pandas as pd

PERCENTILES = (5, 50, 95)
FEWEST = 4  # completed trials for moments
LEAST = 20  # completed trials for sensitivities
# Injury thresholds: inversion of cadaver ankles at failure, and the anatomy's inversion moment there; see docs and the sources they cite.
QUESTIONS = {
    "peak_inversion_from_neutral_deg": ("above 35 ± 6 deg", Normal(35.0, 6.0)),
    "anatomy_jcs_inversion_moment_Nm": ("above 2.7 ... 4.3 N·m", Uniform(2.7, 4.3)),
}


def summarise(study: Study, trials: pd.DataFrame, found: Any) -> dict[str, Any]:
    """Content of summary.json. Raises InputError for a response that is no metric."""
    done = trials[trials["status"] == "completed"]
    failed = len(trials) - len(done)
    summary: dict[str, Any] = {
        "study": study.source,
        "title": study.title,
        "method": study.method,
        "seed": study.seed,
        "initial_pose": study.scenario.initial_pose(),
        "n_requested": study.trials if found is None else len(trials),
        "n_completed": len(done),
        "n_failed": failed,
        "failures": {status: int(count) for status, count in trials["status"].value_counts().items() if status != "completed"},
        "responses": {},
        "sensitivity": {},
        "questions": {},
        "dropped": list(study.scenario.dropped),
    }
    if found is not None:
        summary["form" if isinstance(found, reliability.FormResult) else "amv"] = _search(study, found)
        return summary
    metrics = list(trials.columns[3 + len(study.names) :])
    for name in study.responses:
        if len(done) and name not in metrics:
            raise InputError(f"response {name!r}: no such metric{nearest(name, metrics)}")
    random = study.method == "monte-carlo"
    for name in metrics:
        y = done[name].to_numpy(float)
        if len(y) >= FEWEST:
            summary["responses"][name] = _response(y, failed, random or study.method == "table")
    if random and len(done) >= LEAST:
        x = done[study.headings].to_numpy(float)
        for name in study.responses:
            summary["sensitivity"][name] = _sensitivity(study, x, done[name].to_numpy(float))
    for name, (text, threshold) in QUESTIONS.items():
        if name in done and len(done) >= LEAST and study.method in ("monte-carlo", "table"):
            e = statistics.exceedance(done[name].to_numpy(float), threshold, failed=failed)
            summary["questions"][name] = {"event": text, "probability": e.value, "ci_low": e.low, "ci_high": e.high}
    return _finite(summary)


def _response(y: np.ndarray, failed: int, intervals: bool) -> dict[str, Any]:
    mean, sd = statistics.mean(y), statistics.standard_deviation(y)
    out: dict[str, Any] = {"mean": mean.value, "sd": sd.value, "percentiles": {}}
    if intervals:
        out |= {"mean_ci": [mean.low, mean.high], "sd_ci": [sd.low, sd.high]}
    for p in PERCENTILES:
        e = statistics.percentile(y, p / 100)
        entry: dict[str, Any] = {"value": e.value, "ci_low": e.low if intervals else None, "ci_high": e.high if intervals else None}
        if failed:
            entry["with_failures"] = list(statistics.percentile_bounds(y, failed, p / 100))
        out["percentiles"][str(p)] = entry
    return out


def _sensitivity(study: Study, x: np.ndarray, y: np.ndarray) -> dict[str, Any]:
    marginals = tuple(study.marginals.values())
    active = [i for i, m in enumerate(marginals) if not m.is_fixed]
    if not active or not np.ptp(y) > 0:
        return {}
    r, rho = sensitivity.pearson(x[:, active], y), sensitivity.spearman(x[:, active], y)
    factors = sensitivity.sensitivity_factors(x, y, marginals, study.correlation)
    names = list(study.names)
    out: dict[str, Any] = {}
    for k, i in enumerate(active):
        out[names[i]] = {
            "pearson": _correlation(r, k),
            "spearman": _correlation(rho, k),
            **{f: float(getattr(factors, f)[i]) for f in ("dmean_dmean", "dmean_dsd", "dsd_dmean", "dsd_dsd")},
            "standard_error": {f: float(getattr(factors.standard_error, f)[i]) for f in ("dmean_dmean", "dmean_dsd", "dsd_dmean", "dsd_dsd")},
        }
    if study.correlation is None and len(y) >= 100:
        given = sensitivity.given_data_indices(x, y, marginals)
        for i in active:
            out[names[i]] |= {"sobol_first": float(given.first[i]), "sobol_total": float(given.total[i])}
        out["_given_data"] = {"degree": given.degree, "terms": given.terms, "q2": given.q2}
    return out


def _correlation(r: sensitivity.Correlation, k: int) -> dict[str, float]:
    fields = {name: np.atleast_1d(value)[k] for name, value in asdict(r).items() if name != "standard_error"}
    return {name: float(value) for name, value in fields.items()}


def _search(study: Study, found: Any) -> dict[str, Any]:
    names = study.names

    def named(values: Any) -> dict[str, float]:
        return dict(zip(names, (float(v) for v in values), strict=True))

    shared = {
        "evaluations_requested": found.evaluations.requested,
        "evaluations_executed": found.evaluations.executed,
        "status": found.status,
        "reasons": list(found.reasons),
    }
    if isinstance(found, reliability.FormResult):
        return shared | {
            "beta": found.beta, "probability": found.probability, "threshold": study.threshold,
            "importance": named(found.alpha), "design_point": named(found.design_point),
        }  # fmt: skip
    return shared | {
        "response": study.responses[0],
        "levels": {
            f"{100 * p:g}": {"value": v, "importance": named(found.importance[p]), "design_point": named(found.design_point[p])} for p, v in found.value.items()
        },
        "linear_importance": named(found.linear_importance),
        "mean": found.mean,
        "sd": found.sd,
    }


def _finite(value: Any) -> Any:
    """JSON has no NaN nor infinity: null."""
    if isinstance(value, Mapping):
        return {k: _finite(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(v) for v in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def text(study: Study, summary: Mapping[str, Any]) -> str:
    """The tables that `study` prints: percentiles, correlations, moments of every metric, beside the published figures where there are any."""
    lines = [
        f"{summary['title']}  ·  {summary['method']}, pose {summary['initial_pose']}, "
        f"{summary['n_completed']} of {summary['n_requested']} trials completed, {summary['wall_s']:.1f} s wall time"
    ]
    lines += [f"failed: {count} {status}" for status, count in summary["failures"].items()]
    if "amv" in summary:
        lines += _search_lines(study, summary["amv"])
    elif "form" in summary:
        f = summary["form"]
        lines += ["", f"P({study.responses[0]} > {f['threshold']:g}) = {f['probability']:.4g}   beta {f['beta']:.3f}   {f['status']}", *f["reasons"]]
    published = study.published
    for name in study.responses if summary["responses"] else ():
        r = summary["responses"][name]
        lines += ["", f"{name:34}{'here':>10}{'95 % interval':>20}{'published':>12}"]
        first = published if name == "peak_subtalar_angle_deg" else {}
        for label, value, low, high in _statistics(r):
            lines.append(f"  {label:32}{value:10.2f}{_interval(low, high):>20}{_number(first.get(f'{label} [deg]')):>12}")
        table = {k: v for k, v in summary["sensitivity"].get(name, {}).items() if not k.startswith("_")}
        if table:
            lines += ["", f"{'Pearson r':34}{'here':>10}{'95 % interval':>20}{'published':>12}{'dsd/dmean':>12}{'dsd/dsd':>9}{'± SE':>7}"]
        for key, s in table.items():
            shown = published.get("pearson", {}).get(key) if first else None
            p = s["pearson"]
            lines.append(
                f"  {key:32}{p['value']:10.2f}{_interval(p['low'], p['high']):>20}{_number(shown):>12}"
                f"{_fixed(s['dsd_dmean']):>12}{_fixed(s['dsd_dsd']):>9}{_fixed(s['standard_error']['dsd_dsd']):>7}"
            )
    if summary["responses"]:
        lines += ["", f"{'metric (mean ± SD)':48}{'here':>20}{'published':>16}"]
        for key, r in summary["responses"].items():
            pair = published.get("metrics", {}).get(key)
            lines.append(f"  {key:46}{r['mean']:11.1f} ± {r['sd']:<6.1f}{f'{pair[0]:g} ± {pair[1]:g}' if pair else '':>16}")
    for key, q in summary["questions"].items():
        lines.append(f"P({key} {q['event']}) = {q['probability']:.3f}  ({q['ci_low']:.3f} ... {q['ci_high']:.3f})")
    if published:
        lines += ["", f"published: {published['source']}"]
    return "\n".join(lines)


def _statistics(r: Mapping[str, Any]) -> list[tuple[str, float, float | None, float | None]]:
    mean, sd = r.get("mean_ci", (None, None)), r.get("sd_ci", (None, None))
    rows = [("mean", r["mean"], *mean), ("sd", r["sd"], *sd)]
    return rows + [(f"{p} %", e["value"], e["ci_low"], e["ci_high"]) for p, e in r["percentiles"].items()]


def _search_lines(study: Study, found: Mapping[str, Any]) -> list[str]:
    lines = ["", f"{found['response']:34}{'here':>10}{'published':>12}"]
    for level, entry in found["levels"].items():
        lines.append(f"  {level + ' %':32}{entry['value']:10.2f}{_number(study.published.get(f'{level} % [deg]')):>12}")
    lines += ["", f"{'importance':34}{'linear':>10}" + "".join(f"{level + ' %':>10}" for level in found["levels"])]
    for name, value in found["linear_importance"].items():
        lines.append(f"  {name:32}{value:10.2f}" + "".join(f"{e['importance'][name]:10.2f}" for e in found["levels"].values()))
    lines += ["", f"evaluations: {found['evaluations_requested']} requested, {found['evaluations_executed']} executed; gate: {found['status']}"]
    return lines + [f"  {reason}" for reason in found["reasons"]]


def _interval(low: float | None, high: float | None) -> str:
    return "" if low is None or high is None else f"{low:.2f} ... {high:.2f}"


def _fixed(value: float | None) -> str:
    """Two decimals; '-' for a factor that is not defined, such as those of a uniform input."""
    return "-" if value is None else f"{value:.2f}"


def _number(value: Any) -> str:
    return "" if value is None else f"{value:g}"
