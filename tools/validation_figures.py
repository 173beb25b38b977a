"""Draws the figures of docs/validation.md and prints its tables. Needs the reference numbers (SPRAIN_REFERENCE). Run:
python tools/validation_figures.py"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

sys.path.insert(0, str(Path(__file__).parent.parent))

from sprain_cosim.figures.style import FAINT, SUBTALAR, TALOCRURAL, legend_above, legend_line, sheet, styled
from tools import published
from tools.direct import COLUMN, plant
from tools.reference import read

FIGURES = Path(__file__).parent.parent / "docs" / "figures"
STUDIES = {1: "1: level", 2: "2: 30° slope", 3: "3: reflex", 4: "4: co-activation", 5: "5: 240 % brace", 6: "6: mixed"}
OVERLAID = {
    "base": "30° slope",
    "nopen_study2": "30° slope, touching pose",
    "study3_centre": "reflex (study 3)",
    "study4_centre": "co-activation (study 4)",
    "brace_200": "200 % brace",
    "combo_i15_h0.4_c0.2": "15° slope, drop 0.4 m",
}
STYLE = {"subtalar": "-", "talocrural": (0, (5, 1.6))}
DPI = 220


@styled
def scatter() -> Figure:
    made, axes = sheet([3.5] * 3, columns=2)
    print("| Study | trials | bias [deg] | RMS error [deg] | largest [deg] |\n|---|---|---|---|---|")
    for axis, (study, title) in zip(axes, STUDIES.items(), strict=True):
        records = read(f"paper/study{study}_trials.csv")
        errors = published.errors(records)
        peaks = records.peak_subtalar_deg.to_numpy()
        low, high = peaks.min() - 1, peaks.max() + 1
        axis.plot([low, high], [low, high], color=FAINT, linewidth=0.8)
        axis.plot(peaks, peaks + errors, ".", color=TALOCRURAL, markersize=3, alpha=0.5)
        axis.set_title(f"study {title}")
        text = f"RMS {np.sqrt(np.mean(errors**2)):.3f}°\nbias {errors.mean():+z.3f}°"
        axis.text(0.05, 0.95, text, transform=axis.transAxes, va="top")
        print(
            f"| {title} | {len(errors)} | {errors.mean():+z.3f} | {np.sqrt(np.mean(errors**2)):.3f} | "
            f"{np.abs(errors).max():.2f} |"
        )
    made.supxlabel("published peak subtalar supination [deg]", fontsize="medium")
    made.supylabel("simulated [deg]", fontsize="medium")
    return made


@styled
def overlay() -> Figure:
    made, axes = sheet([3.2] * 3, columns=2)
    for axis, (case, title) in zip(axes, OVERLAID.items(), strict=True):
        reference = read(f"landing/{case}.csv.gz")
        out = published.simulated(case)[0]
        ms = 1e3 * reference.time_s
        for name, column, color in (
            ("subtalar", "subtalar_angle_deg", SUBTALAR),
            ("talocrural", "ankle_angle_deg", TALOCRURAL),
        ):
            axis.plot(ms, reference[column], color=color, linewidth=4, alpha=0.3)
            axis.plot(ms, np.degrees(out[:, COLUMN[f"{name}_angle"]]), color=color, linestyle=STYLE[name])
        axis.set_title(title)
    entries = [(legend_line(c, STYLE[n]), n) for n, c in (("subtalar", SUBTALAR), ("talocrural", TALOCRURAL))]
    legend_above(made, [*entries, (legend_line(FAINT, "-", linewidth=4), "wide, pale: OpenSim 4.6")], columns=2)
    made.supxlabel("time after contact [ms]", fontsize="medium")
    made.supylabel("angle [deg]", fontsize="medium")
    return made


def table() -> None:
    print(
        "\n| Landings | cases | subtalar RMS [°] | subtalar peak [°] | talocrural RMS [°] | knee RMS [°] | ground "
        "reaction after 5 ms [%] |\n|---|---|---|---|---|---|---|"
    )
    groups: dict[str, list[list[float]]] = {"published pose": [], "touching pose": []}
    for case in published.CASES:
        reference = read(f"landing/{case}.csv.gz")
        out, q, _, _ = published.simulated(case)
        q = np.degrees(q)
        late = (reference.time_s > 0.005).to_numpy()
        force = reference.grf_vertical_N.to_numpy()[late]
        found = [
            published.rms(q[:, published.SUBTALAR], reference.subtalar_angle_deg),
            abs(q[:, published.SUBTALAR].max() - reference.subtalar_angle_deg.max()),
            published.rms(q[:, published.TALOCRURAL], reference.ankle_angle_deg),
            published.rms(q[:, published.KNEE], reference.knee_angle_deg),
            100 * published.rms(out[late, COLUMN["ground_force_y"]], force) / force.max(),
        ]
        if case != "conv_h1e-3":
            groups["touching pose" if case.startswith("nopen") else "published pose"].append(found)
    for name, rows in groups.items():
        a = np.array(rows)
        cells = " | ".join(f"{np.median(a[:, k]):.3f} ({a[:, k].max():.3f})" for k in range(5))
        print(f"| {name} | {len(a)} | {cells} |")
    worst = max(muscles(case) for case in published.MUSCLES)
    print(f"\nlargest RMS error of any of the 49 muscle forces: {worst:.2f} N")


def muscles(case: str) -> float:
    reference = read(f"landing/{case}_muscles.csv.gz")
    forces = published.simulated(case)[2]
    names = plant().muscles.names
    return max(published.rms(forces[:, k], reference[f"F_N_{n}"]) for k, n in enumerate(names))


if __name__ == "__main__":
    scatter().savefig(FIGURES / "trials.png", dpi=DPI, metadata={"Software": None})
    overlay().savefig(FIGURES / "landings.png", dpi=DPI, metadata={"Software": None})
    table()
