"""Runs the paper's studies and AMV in full and writes their tables beside the published ones into docs/validation.md,
between the markers.

Needs the reference numbers (SPRAIN_REFERENCE). Run: python tools/study_tables.py [--out DIR] [--workers K]. A study
already complete in DIR is not run again, nor are its seeds chosen here: they stand in the study files."""

from __future__ import annotations

import argparse
import math
import os
import platform
import resource
import sys
import tempfile
from collections.abc import Iterator
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

sys.path.insert(0, str(Path(__file__).parent.parent))

import sprain_cosim as sc
from sprain_cosim.study.evaluation import FACTORS
from sprain_cosim.uq import reliability, sensitivity, statistics
from sprain_cosim.validation.checks.paper import PEAK, RECORDS
from sprain_cosim.validation.checks.paper import published_inputs as to_inputs
from tools.reference import FOLDER, read

PAGE = Path(__file__).parent.parent / "docs" / "validation.md"
BEGIN, END = "<!-- studies: begin, written by tools/study_tables.py -->", "<!-- studies: end -->"
TITLES = {
    1: "level",
    2: "30° slope",
    3: "reflex gain 10",
    4: "co-activation 60 %",
    5: "240 % brace",
    6: "mixed, 150 % brace",
}
SUMMARY = {  # the prefix of the columns of paper/summary.csv: our input
    "drop_height_m": "plant.drop_height",
    "contact_modulus": "plant.contact_modulus",
    "dissipation": "plant.contact_dissipation",
    "ankle_stiffness_fi": "plant.passive_angle_scale",
    "coactivation": "controller.coactivation",
    "reflex_gain": "controller.reflex_gain",
    "talocrural_deg": "plant.talocrural_angle_at_contact",
    "subtalar_deg": "plant.subtalar_angle_at_contact",
    "strength_m1i": "plant.ankle_strength_scale",
    "brace_bi": "brace.angle_scale",
}
LEVELS = (5, 50, 95)


def run(name: str, out: Path, workers: int, **options: Any) -> Any:
    folder = out / "-".join([name, *(str(v) for v in options.values())])
    study = sc.load_study(name)
    if "inputs" in options:
        folder = out / f"{name}-inputs"
        study = study.with_inputs(options.pop("inputs"))
    return study.run(workers=workers, out=folder, resume=True, **options)


def published_inputs(out: Path, workers: int) -> Iterator[str]:
    yield "### On the published inputs"
    yield ""
    yield (
        "The 500 trials of each study whose inputs are at hand, run with `--inputs`, minus the records of the same "
        "trials. Bounds: mean and SD within"
    )
    yield "0.05°, every percentile within 0.15°, every Pearson r within 0.02."
    yield ""
    yield "| Study | mean [deg] | SD | 5 % | 50 % | 95 % | largest gap of r | missed |"
    yield "|---|---|---|---|---|---|---|---|"
    for n, title in TITLES.items():
        folder = out / f"records{n}"
        folder.mkdir(parents=True, exist_ok=True)
        records = read(f"paper/study{n}_trials.csv")
        to_inputs(records).to_csv(folder / "inputs.csv", index=False)
        trials = run(f"study{n}", out, workers, inputs=folder / "inputs.csv").trials
        ours, theirs = trials[PEAK].to_numpy(), records["peak_subtalar_deg"].to_numpy()
        gaps = {"mean": ours.mean() - theirs.mean(), "SD": ours.std(ddof=1) - theirs.std(ddof=1)}
        gaps |= {f"{p} %": np.percentile(ours, p) - np.percentile(theirs, p) for p in LEVELS}
        bounds = {"mean": 0.05, "SD": 0.05} | {f"{p} %": 0.15 for p in LEVELS}
        missed = [k for k, v in gaps.items() if abs(v) > bounds[k]]
        r = {}
        for heading, _, _ in RECORDS.values():
            if heading in trials and trials[heading].std() > 0:
                x = trials[heading]
                r[heading.partition(" [")[0]] = np.corrcoef(x, ours)[0, 1] - np.corrcoef(x, theirs)[0, 1]
        worst = max(r, key=lambda k: abs(r[k]))
        missed += [f"r of {k} ({v:+z.3f})" for k, v in r.items() if abs(v) > 0.02]
        cells = " | ".join(f"{v:+z.3f}" for v in gaps.values())
        yield f"| {n}: {title} | {cells} | {r[worst]:+.4f} ({worst}) | {', '.join(missed) or 'none'} |"


def standard_errors(y: np.ndarray) -> dict[str, float]:
    """Of mean, SD and percentiles of an independent sample, from their 95 % intervals."""
    half = {"mean": statistics.mean(y), "SD": statistics.standard_deviation(y)} | {
        f"{p} %": statistics.percentile(y, p / 100) for p in LEVELS
    }
    return {k: e.half_width / 1.96 for k, e in half.items()}


def fresh(campaigns: dict[int, Any]) -> Iterator[str]:
    yield "### Fresh samples of 1000 trials"
    yield ""
    yield (
        "Seed 20211208 in every study file, fixed before the first run. `z` is the difference over its standard "
        "error, both samples counted (1000"
    )
    yield "published trials each). Bounds: |z| ≤ 3 everywhere; one in 370 would miss that by chance."
    yield ""
    yield "| Study | | mean [deg] | SD [deg] | 5 % [deg] | 50 % [deg] | 95 % [deg] |"
    yield "|---|---|---|---|---|---|---|"
    missed, count, lines = [], 0, []
    for n, title in TITLES.items():
        campaign = campaigns[n]
        y = campaign.trials[PEAK].to_numpy()
        record = read("paper/summary.csv").set_index("study").loc[n]
        error = standard_errors(y)
        ours = {"mean": y.mean(), "SD": y.std(ddof=1)} | {f"{p} %": np.percentile(y, p) for p in LEVELS}
        theirs = {"mean": record.peak_subtalar_mean_deg, "SD": record.peak_subtalar_sd_deg} | {
            f"{p} %": record[f"p{p}_deg"] for p in LEVELS
        }
        interval = campaign.summary["responses"][PEAK]
        ends = {"mean": interval["mean_ci"], "SD": interval["sd_ci"]} | {
            f"{p} %": [interval["percentiles"][str(p)][e] for e in ("ci_low", "ci_high")] for p in LEVELS
        }
        z = {k: (ours[k] - theirs[k]) / (math.sqrt(2) * error[k]) for k in ours}
        yield (
            f"| {n}: {title} | here | "
            + " | ".join(f"{ours[k]:.2f} ({ends[k][0]:.2f} … {ends[k][1]:.2f})" for k in ours)
            + " |"
        )
        yield "| | published | " + " | ".join(f"{v:.2f}" for v in theirs.values()) + " |"
        yield "| | z | " + " | ".join(f"{v:+.1f}" for v in z.values()) + " |"
        missed += [f"study {n}, {k}: z = {v:+.1f}" for k, v in z.items() if abs(v) > 3]
        count += len(z)
        row = []
        for prefix, name in SUMMARY.items():
            heading = next((h for h in campaign.study.headings if h.partition(" [")[0] == name), None)
            if heading is None or math.isnan(record.get(f"{prefix}_pearson_r", math.nan)):
                row.append("")
                continue
            found = sensitivity.pearson(campaign.trials[heading].to_numpy(), y)
            r, known = float(found.value[0]), float(record[f"{prefix}_pearson_r"])
            gap = (math.atanh(r) - math.atanh(known)) / math.sqrt(2 / (len(y) - 3))
            row.append(f"{r:.2f} / {known:.2f} ({gap:+.1f})")
            count += 1
            if abs(gap) > 3:
                missed.append(f"study {n}, r of {name}: z = {gap:+.1f}")
        lines.append(f"| {n} | " + " | ".join(row) + " |")
    yield ""
    yield "Pearson r with the peak subtalar angle, here / published (z of the difference of Fisher's transforms):"
    yield ""
    yield "| Study | " + " | ".join(SUMMARY.values()) + " |"
    yield "|---" * (len(SUMMARY) + 1) + "|"
    yield from lines
    yield ""
    yield f"Of the {count} correlations {'; '.join(['these miss', *missed]) if missed else 'none misses its bound'}."


def table3(campaigns: dict[int, Any]) -> Iterator[str]:
    printed = pd.read_csv(FOLDER / "paper" / "table3.csv", dtype=str).set_index("metric")
    table = printed.astype(float)
    yield "### Table 3, cell by cell"
    yield ""
    yield (
        "Mean ± SD of 1000 fresh trials, here / published (which is rounded to the digits shown). JCS angles are "
        "raw, as in the paper's table. Bounds:"
    )
    yield "the mean within a tenth of the published SD; cells outside are marked and listed."
    yield ""
    yield "| Metric | " + " | ".join(f"study {n}" for n in TITLES) + " |"
    yield "|---" * 7 + "|"
    outside: dict[str, list[str]] = {"rounding": [], "sampling": [], "none of these": []}
    inside = 0
    for metric, row in table.iterrows():
        cells = []
        for n in TITLES:
            mean, sd = row[f"mean_study{n}"], row[f"sd_study{n}"]
            if math.isnan(mean):
                cells.append("")
                continue
            y = campaigns[n].trials[metric].to_numpy()
            digits = len(printed.loc[metric, f"mean_study{n}"].partition(".")[2])
            gap = abs(y.mean() - mean)
            rounding, chance = 0.5 * 10.0**-digits, 3 * math.sqrt(2 / len(y)) * y.std()
            mark = ""
            if gap > 0.1 * sd:
                mark = " *"
                reason = (
                    "rounding"
                    if gap <= 0.1 * sd + rounding
                    else "sampling"
                    if gap <= chance + rounding
                    else "none of these"
                )
                outside[reason].append(f"{metric} of study {n} ({y.mean() - mean:+.{digits + 1}f}, SD {sd:g})")
            else:
                inside += 1
            cells.append(f"{y.mean():.{digits + 1}f} ± {y.std(ddof=1):.{digits + 1}f} / {mean:g} ± {sd:g}{mark}")
        yield f"| {metric} | " + " | ".join(cells) + " |"
    yield ""
    yield f"Within: {inside} of {inside + sum(map(len, outside.values()))} cells. Outside, by what can explain it:"
    yield ""
    yield (
        "- the published mean's own rounding (a tenth of the SD plus half a unit of its last digit): "
        f"{len(outside['rounding'])} cells;"
    )
    yield (
        "- two samples of 1000 differ that much (3 standard errors plus rounding): "
        f"{'; '.join(outside['sampling']) or 'none'};"
    )
    yield f"- none of these: {'; '.join(outside['none of these']) or 'no cell'}."


def sigma_effects(campaigns: dict[int, Any], out: Path, workers: int) -> Iterator[str]:
    yield "### Effects on the spread in studies 3 and 4"
    yield ""
    yield (
        "The paper marks, in studies 3 and 4, that the SD of the response falls with the mean of the contact "
        "dissipation and rises with the mean of the"
    )
    yield (
        "talocrural angle. Normalised factors ± standard error; * where the 95 % BCa bootstrap interval excludes 0, "
        "** where the estimate is above 2.7"
    )
    yield "standard errors (5 % over the eight inputs together)."
    yield ""
    yield "| Input | study 3 ∂σ/∂μ | study 3 ∂σ/∂σ | study 4 ∂σ/∂μ | study 4 ∂σ/∂σ |"
    yield "|---|---|---|---|---|"
    tables = {n: campaigns[n].summary["sensitivity"][PEAK] for n in (3, 4)}
    for name in {**tables[3], **tables[4]}:
        if name.startswith("_"):
            continue
        cells = []
        for n in (3, 4):
            for factor in FACTORS[2:]:
                s = tables[n].get(name)
                if s is None:
                    cells.append("")
                    continue
                low, high = s["ci"][factor]
                error = s["standard_error"][factor]
                mark = "**" if abs(s[factor]) > 2.7 * error else "*" if low > 0 or high < 0 else ""
                cells.append(f"{s[factor]:+.2f} ± {error:.2f}{mark}")
        yield f"| {name} | " + " | ".join(cells) + " |"
    yield ""
    shown = []
    for n in (3, 4):
        study = sc.load_study(f"study{n}")
        x = run(f"study{n}", out, workers, inputs=out / f"records{n}" / "inputs.csv").trials[study.headings].to_numpy()
        found = sensitivity.sensitivity_factors(
            x, read(f"paper/study{n}_trials.csv")["peak_subtalar_deg"], tuple(study.marginals.values())
        )
        assert found.standard_error
        for name in ("plant.contact_dissipation", "plant.talocrural_angle_at_contact"):
            k = study.names.index(name)
            shown.append(f"study {n}, {name}: {found.dsd_dmean[k]:+.2f} ± {found.standard_error.dsd_dmean[k]:.2f}")
    yield f"The same ∂σ/∂μ from the 500 published trials at hand: {'; '.join(shown)}."


def by_levels(out: Path, workers: int, campaign: Any) -> Iterator[str]:
    yield "### AMV of study 6 and what it is worth"
    yield ""
    yield (
        "Peak subtalar angle, published pose. The Monte Carlo intervals are order statistics of the 1000 trials, "
        "the authors' and ours."
    )
    yield ""
    study = sc.load_study("amv6")
    records = study.published["monte_carlo"]
    ours = campaign.summary["responses"][PEAK]["percentiles"]
    yield "| Level | authors' Monte Carlo | our Monte Carlo | authors' AMV | MV | AMV | AMV+ | HMV |"
    yield "|---|---|---|---|---|---|---|---|"
    found = {m: run("amv6", out, workers, method=m).summary["amv"] for m in ("mean-value", "amv", "amv+", "hmv")}
    for level in ("5", "50", "95"):
        known, mine = records[f"{level} % [deg]"], ours[level]
        row = [
            f"{known[0]:g} ({known[1]:g} … {known[2]:g})",
            f"{mine['value']:.1f} ({mine['ci_low']:.1f} … {mine['ci_high']:.1f})",
        ]
        author = study.published[f"{level} % [deg]"]
        row.append(f"{author:g}: {statistics.agreement(author, statistics.Estimate(*known))}")
        row += [
            f"{f['levels'][level]['value']:.2f}: {f['levels'][level]['against_monte_carlo']}" for f in found.values()
        ]
        yield f"| {level} % | " + " | ".join(row) + " |"
    cost = [f"{f['evaluations_requested']} / {f['evaluations_executed']}" for f in found.values()]
    yield "| landings requested / executed | 1000 | 1000 | 14 | " + " | ".join(cost) + " |"
    for level in ("5", "50", "95"):
        cells = [
            f"{float(level) + f['check']['off'][level]:.1f} % ({float(level) + f['check']['ci'][level][0]:.1f} … "
            f"{float(level) + f['check']['ci'][level][1]:.1f}): {f['check']['verdict'][level]}"
            for f in found.values()
        ]
        yield f"| really below the {level} % level | | | | " + " | ".join(cells) + " |"
    yield "| by random landings | | | | " + " | ".join(str(f["check"]["n"]) for f in found.values()) + " |"
    yield "| gate | | | | " + " | ".join(f["status"] for f in found.values()) + " |"
    yield ""
    importance = found["amv"]["linear_importance"]
    shown = ", ".join(f"{k} {v:+.2f}" for k, v in sorted(importance.items(), key=lambda kv: -abs(kv[1])))
    yield f"Importance levels of the linearisation (unrounded gradients): {shown}."
    yield ""
    yield (
        "The paper's AMV differs at 5 %. Where that comes from: the same landings, the same 0.1 SD steps, only the "
        "gradient differs."
    )
    yield ""
    yield "| Gradient from | inputs that move nothing | 5 % | 50 % | 95 % |"
    yield "|---|---|---|---|---|"
    yield from decomposition(study)


def decomposition(study: Any) -> Iterator[str]:
    marginals = tuple(study.marginals.values())
    known: dict[bytes, float] = {}
    with study.scenario.open() as session:

        def landing(x: np.ndarray) -> np.ndarray:
            for row in x:
                if row.tobytes() not in known:
                    known[row.tobytes()] = session.run(dict(zip(study.names, row, strict=True))).metrics[PEAK]
            return np.array([known[row.tobytes()] for row in x])

        means = np.array([m.mean for m in marginals])
        records = read("paper/amv_trials.csv").set_index("trial")["peak_subtalar_deg"]
        trial = dict(
            zip(
                (
                    "plant.drop_height",
                    "plant.contact_modulus",
                    "plant.contact_dissipation",
                    "plant.passive_angle_scale",
                    "controller.coactivation",
                    "controller.reflex_gain",
                    "plant.talocrural_angle_at_contact",
                    "plant.subtalar_angle_at_contact",
                    "plant.ankle_strength_scale",
                    "brace.angle_scale",
                ),
                range(2, 12),
                strict=True,
            )
        )

        def moved(row: np.ndarray) -> np.ndarray:
            return np.flatnonzero(~np.isclose(row, means, rtol=1e-9, atol=1e-12))

        def recorded(x: np.ndarray) -> np.ndarray:
            """The authors' outputs where they are at hand (centre and steps), ours at the design points."""
            out = []
            for row in x:
                where = moved(row)
                out.append(
                    landing(row[None])[0]
                    if len(where) > 1
                    else records[trial[study.names[where[0]]] if len(where) else 1]
                )
            return np.array(out)

        def rounded(x: np.ndarray) -> np.ndarray:
            return np.array(
                [landing(row[None])[0] if len(moved(row)) > 1 else round(landing(row[None])[0], 1) for row in x]
            )

        cases = {
            "our outputs, forward differences": (landing, {}),
            "our outputs, central differences": (landing, {"difference": "central"}),
            "our outputs rounded to 0.1°": (rounded, {}),
            "the authors' recorded outputs (rounded to 0.1°), our landings at the design points": (recorded, {}),
        }
        for label, (function, options) in cases.items():
            found = reliability.amv(function, marginals, **options)
            still = int(np.sum(found.gradient == 0.0))
            yield (
                f"| {label} | {still} of {len(marginals)} | "
                + " | ".join(f"{found.value[p]:.2f}" for p in (0.05, 0.5, 0.95))
                + " |"
            )
    yield "| *the authors' AMV records* | 6 of 10 | 25.2 | 30.7 | 34.3 |"


def questions(campaigns: dict[int, Any], out: Path, workers: int) -> Iterator[str]:
    yield "### What a designer asks"
    yield ""
    yield (
        "Probability that inversion, counted from the neutral pose (not the raw angle of Table 3, which lies 10° "
        "lower), exceeds an injury threshold of"
    )
    yield (
        "35 ± 6°, and that the anatomy's inversion moment exceeds 2.7 … 4.3 N·m (uniform); 95 % intervals, "
        "published pose."
    )
    yield ""
    yield "| Study | P(inversion > 35 ± 6°) | P(moment > 2.7 … 4.3 N·m) |"
    yield "|---|---|---|"
    for n, title in TITLES.items():
        cells = [
            f"{q['probability']:.3f} ({q['ci_low']:.3f} … {q['ci_high']:.3f})"
            for q in campaigns[n].summary["questions"].values()
        ]
        yield f"| {n}: {title} | " + " | ".join(cells) + " |"
    smooth = run("study6", out, workers, method="sobol", trials=1024).summary["questions"]
    yield (
        "| 6, 1024 trials of 8 Sobol' replicates | "
        + " | ".join(f"{q['probability']:.4f} ({q['ci_low']:.4f} … {q['ci_high']:.4f})" for q in smooth.values())
        + " |"
    )
    form = run("form6", out, workers).summary["form"]
    yield (
        f"| 6, sampling about the design point (`form6`, {form['evaluations_executed']} landings, {form['status']}) | "
        f"{form['probability']:.4f} ({form['ci_low']:.4f} … {form['ci_high']:.4f}) | |"
    )
    yield f"| 6, first order alone | {form['first_order']:.4f} | |"


def grids(out: Path, workers: int) -> Iterator[str]:
    for name, response, title, digits in (
        ("demers2017", "peak_subtalar_angle_deg", "The grid of DeMers, Hicks & Delp 2017", 1),
        ("brace_scaling", "peak_subtalar_angle_deg", "Scaling a brace's torque instead of its angle", 1),
    ):
        grid = run(name, out, workers).summary["grid"]
        rows, columns = grid["axes"]
        yield f"### {title}"
        yield ""
        yield f"Study `{name}`, peak subtalar angle [deg], {rows['name']} down, {columns['name']} across."
        yield ""
        yield "| | " + " | ".join(f"{v:g}" for v in columns["levels"]) + " |"
        yield "|---" * (len(columns["levels"]) + 1) + "|"
        for level, values in zip(rows["levels"], grid["responses"][response], strict=True):
            yield f"| {level:g} | " + " | ".join(f"{v:.{digits}f}" for v in values) + " |"
        yield ""
        if name == "demers2017":
            reference = read("demers2017/index.csv")
            planned = reference[reference.case.str.contains("activation")]
            ours = {level: values[0] for level, values in zip(rows["levels"], grid["responses"][response], strict=True)}
            gaps = [
                ours[round(c, 1)] - peak
                for c, peak in zip(planned.coactivation, planned.peak_subtalar_deg, strict=True)
            ]
            yield (
                "Against the authors' own runs without reflex (co-activation 0 … 1 in steps of 0.2): "
                f"{min(gaps):+.2f} … {max(gaps):+.2f}°."
            )
            yield ""


def speed(campaigns: dict[int, Any], spent: dict[int, tuple[float, float]]) -> Iterator[str]:
    """`spent` is the processor time [s] of workers and driver of the studies that were run now."""
    yield "### Cost"
    yield ""
    yield (
        f"Load average of the machine {os.getloadavg()[2]:.0f} on {os.cpu_count()} cores while this ran: where it "
        "is above the number of workers, processor"
    )
    yield "time says more than wall time. The driver's share is what the runner costs beside the simulations."
    yield ""
    yield "| Study | processor time of the workers [s] | of the driver [s] | driver's share | wall time here [s] |"
    yield "|---|---|---|---|---|"
    for n, (workers, driver) in spent.items():
        yield (
            f"| {n}: {TITLES[n]} | {workers:.1f} | {driver:.1f} | {driver / workers:.1%} | "
            f"{campaigns[n].summary.wall_s:.0f} |"
        )


def processor_time() -> tuple[float, float]:
    """Of the children that have ended and of this process [s]."""
    children, own = resource.getrusage(resource.RUSAGE_CHILDREN), resource.getrusage(resource.RUSAGE_SELF)
    return children.ru_utime + children.ru_stime, own.ru_utime + own.ru_stime


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, help="Folder for the studies (default: a temporary one).")
    parser.add_argument("--workers", type=int, default=2)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        out, workers = arguments.out or Path(temporary), arguments.workers
        campaigns, spent = {}, {}
        for n in TITLES:
            complete, before = (out / f"study{n}" / "summary.json").exists(), processor_time()
            campaigns[n] = run(f"study{n}", out, workers)
            if not complete:
                spent[n] = tuple(after - was for after, was in zip(processor_time(), before, strict=True))
        parts = [
            published_inputs(out, workers),
            fresh(campaigns),
            table3(campaigns),
            sigma_effects(campaigns, out, workers),
            by_levels(out, workers, campaigns[6]),
            questions(campaigns, out, workers),
            grids(out, workers),
            speed(campaigns, spent),
        ]
        head = (
            f"Written by `python tools/study_tables.py`, {date.today()}, {workers} workers on shared "
            f"{platform.machine()} cores of a server."
        )
        text = "\n\n".join([head, *("\n".join(part).rstrip() for part in parts)])
    page = PAGE.read_text("utf-8")
    before, rest = page.split(BEGIN)
    _, after = rest.split(END)
    PAGE.write_text(f"{before}{BEGIN}\n\n{text}\n\n{END}{after}", "utf-8")
    print(text)


if __name__ == "__main__":
    main()
