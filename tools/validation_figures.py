"""Draws the figures of docs/validation.md and prints its tables. Needs the reference numbers (SPRAIN_REFERENCE). Run:
python tools/validation_figures.py"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

sys.path.insert(0, str(Path(__file__).parent.parent))

from sprain_cosim.figures import FAINT, GROUND, INK, SUBTALAR, TALOCRURAL
from tools import published
from tools.direct import COLUMN, plant
from tools.reference import read

FIGURES = Path(__file__).parent.parent / "docs" / "figures"
STUDIES = {1: "1: level", 2: "2: 30° slope", 3: "3: reflex", 4: "4: co-activation", 5: "5: 240 % brace", 6: "6: mixed"}
OVERLAID = ("base", "nopen_study2", "study3_centre", "study4_centre", "brace_200", "combo_i15_h0.4_c0.2")


def figure(rows: int, columns: int, size: tuple[float, float]) -> tuple[Figure, np.ndarray]:
    made = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(made)
    axes = made.subplots(rows, columns, squeeze=False)
    for axis in axes.flat:
        axis.spines[["top", "right"]].set_visible(False)
        axis.tick_params(labelsize=8, colors=INK)
    return made, axes


def scatter() -> None:
    made, axes = figure(2, 3, (9.6, 6.2))
    print("| Study | trials | bias [deg] | RMS error [deg] | largest [deg] |\n|---|---|---|---|---|")
    for axis, (study, title) in zip(axes.flat, STUDIES.items(), strict=True):
        records = read(f"paper/study{study}_trials.csv")
        errors = published.errors(records)
        peaks = records.peak_subtalar_deg.to_numpy()
        low, high = peaks.min() - 1, peaks.max() + 1
        axis.plot([low, high], [low, high], color=FAINT, linewidth=0.8)
        axis.plot(peaks, peaks + errors, ".", color=SUBTALAR, markersize=3, alpha=0.5)
        axis.set_title(f"study {title}", fontsize=10, loc="left", color=INK)
        text = f"RMS {np.sqrt(np.mean(errors**2)):.3f}°\nbias {errors.mean():+.3f}°"
        axis.text(0.05, 0.95, text, transform=axis.transAxes, va="top", fontsize=9, color=INK)
        print(
            f"| {title} | {len(errors)} | {errors.mean():+.3f} | {np.sqrt(np.mean(errors**2)):.3f} | "
            f"{np.abs(errors).max():.2f} |"
        )
    made.supxlabel("published peak subtalar supination [deg]", fontsize=10, color=INK)
    made.supylabel("simulated [deg]", fontsize=10, color=INK)
    made.savefig(FIGURES / "trials.png", dpi=130, metadata={"Software": None})


def overlay() -> None:
    made, axes = figure(2, 3, (9.6, 5.8))
    for axis, case in zip(axes.flat, OVERLAID, strict=True):
        reference = read(f"landing/{case}.csv.gz")
        out = published.simulated(case)[0]
        ms = 1e3 * reference.time_s
        for name, column, color in (
            ("subtalar", "subtalar_angle_deg", SUBTALAR),
            ("talocrural", "ankle_angle_deg", TALOCRURAL),
        ):
            axis.plot(ms, reference[column], color=color, linewidth=4, alpha=0.3)
            axis.plot(ms, np.degrees(out[:, COLUMN[f"{name}_angle"]]), color=color, linewidth=1.2)
        axis.set_title(case, fontsize=9, loc="left", color=INK)
    axes[0, 0].text(60, -25, "thick: OpenSim 4.6\nthin: this plant", fontsize=8, color=GROUND)
    axes[0, 0].text(0.02, 0.95, "subtalar", color=SUBTALAR, fontsize=8, transform=axes[0, 0].transAxes)
    axes[0, 0].text(0.02, 0.87, "talocrural", color=TALOCRURAL, fontsize=8, transform=axes[0, 0].transAxes)
    made.supxlabel("time after contact [ms]", fontsize=10, color=INK)
    made.supylabel("angle [deg]", fontsize=10, color=INK)
    made.savefig(FIGURES / "landings.png", dpi=130, metadata={"Software": None})


def table() -> None:
    print(
        "\n| Landings | cases | subtalar RMS | subtalar peak | talocrural RMS | knee RMS | ground reaction after 5 ms "
        "|\n|---|---|---|---|---|---|---|"
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
        cells = " | ".join(f"{np.median(a[:, k]):.3f} ({a[:, k].max():.3f}) {'%' if k == 4 else '°'}" for k in range(5))
        print(f"| {name} | {len(a)} | {cells} |")
    worst = max(muscles(case) for case in published.MUSCLES)
    print(f"\nlargest RMS error of any of the 49 muscle forces: {worst:.2f} N")


def muscles(case: str) -> float:
    reference = read(f"landing/{case}_muscles.csv.gz")
    forces = published.simulated(case)[2]
    names = plant().muscles.names
    return max(published.rms(forces[:, k], reference[f"F_N_{n}"]) for k, n in enumerate(names))


if __name__ == "__main__":
    scatter()
    overlay()
    table()
