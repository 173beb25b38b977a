"""Draws docs/figures/coupling.png, error against communication step for every scheme, and prints the table of
docs/coupling.md, default settings against the brace inside the plant. Run: python tools/coupling_figure.py"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

sys.path.insert(0, str(Path(__file__).parent.parent))

from sprain_cosim.cosim.coupling import SCHEMES
from sprain_cosim.errors import InputError
from sprain_cosim.figures.style import FAINT, legend_above, looks, sheet, styled
from sprain_cosim.scenario import Scenario, load_scenario

STEPS = (2.0, 1.0, 0.5, 0.25, 0.125)  # ms
SCALES = (2.4, 4.0)
PUBLISHED = {"plant.initial_pose": "published", "plant.fibre_start": "as_published"}
CASES = (  # label, scenario, scale of the brace (0: none), start of the paper's studies
    ("mean of study 1", "level", 0.0, True),
    ("mean of study 2", "incline30", 0.0, True),
    ("mean of study 3", "incline30_reflex", 0.0, True),
    ("mean of study 4", "incline30_coactivation", 0.0, True),
    ("mean of study 5, 240 % brace", "incline30_brace", 2.4, True),
    ("mean of study 6, 150 % brace", "incline30_mixed", 1.5, True),
    ("240 % brace", "incline30_brace", 2.4, False),
    ("400 % brace", "incline30_brace", 4.0, False),
)
TARGET = Path(__file__).parent.parent / "docs" / "figures" / "coupling.png"


def braced(scale: float) -> Scenario:
    return load_scenario("incline30_brace").override("brace.angle_scale", scale).override("plant.tolerance", 1e-5)


def table() -> None:
    print("| Case | peak [°] | difference | brace's peak moment | stated error |\n|---|---|---|---|---|")
    for label, name, scale, published in CASES:
        scenario = load_scenario(name)
        for parameter, value in PUBLISHED.items() if published else ():
            scenario = scenario.override(parameter, value)
        if scale:
            scenario = scenario.override("brace.angle_scale", scale)
            reference = (
                scenario.override("brace.torque_scale", 0.0).override("plant.internal_brace_angle_scale", scale).run()
            )
        else:
            reference = scenario.with_master(communication_step="0.05 ms").run()
        result = scenario.run()
        peak, true = (r.metrics["peak_subtalar_angle_deg"] for r in (result, reference))
        if scale:
            ratio = result["plant.brace_subtalar_moment"].max() / reference["plant.brace_subtalar_moment"].max()
            rest = f"{100 * (ratio - 1):+.3f} % | {100 * (result.coupling_error or 0):.2f} %"
        else:
            rest = "– | –"
        print(f"| {label} | {peak:.3f} | {peak - true:+.4f}° | {rest} |")


def errors(scale: float) -> dict[str, list[float]]:
    """{scheme: RMS error of the subtalar angle [deg] at each of STEPS}, NaN where the guard refuses the run."""
    inside = braced(scale).override("brace.torque_scale", 0.0).override("plant.internal_brace_angle_scale", scale)
    truth = inside.with_master(communication_step="0.125 ms").run()
    found: dict[str, list[float]] = {}
    for name in SCHEMES:
        found[name] = []
        for step in STEPS:
            try:
                result = braced(scale).with_master(name, f"{step} ms").run()
            except InputError as refusal:
                print(f"{100 * scale:4.0f} %  {name:26}{step:6g} ms   refused: {str(refusal).split(';')[0]}")
                found[name].append(np.nan)
                continue
            angle, true = result["plant.subtalar_angle"], truth["plant.subtalar_angle"]
            difference = angle - true[:: len(true) // (len(angle) - 1)]
            found[name].append(np.degrees(np.sqrt(np.mean(difference**2))))
            print(
                f"{100 * scale:4.0f} %  {name:26}{step:6g} ms   RMS {found[name][-1]:.5f} deg   stated "
                f"{100 * (result.coupling_error or 0):.3f} %"
            )
    return found


@styled
def drawn() -> Figure:
    figure, axes = sheet([5.0] * len(SCALES))
    chosen = dict(zip(SCHEMES, looks(len(SCHEMES)), strict=True))
    for axis, scale in zip(axes, SCALES, strict=True):
        for name, values in errors(scale).items():
            axis.loglog(STEPS, values, marker=chosen[name].dot, color=chosen[name].colour, linestyle=chosen[name].line)
        axis.axvline(0.5, color=FAINT, linewidth=0.8)
        axis.set_title(f"{100 * scale:.0f} % brace")
        axis.set_ylabel("RMS error [deg]")
        axis.yaxis.set_major_formatter("{x:g}")
        axis.set_xticks(STEPS, [f"{s:g}" for s in STEPS])
        axis.minorticks_off()
        axis.grid()
    axes[-1].set_xlabel("communication step [ms] (default 0.5)")
    legend_above(figure, [(chosen[name].key(marker=chosen[name].dot), name) for name in SCHEMES], columns=1)
    return figure


def main() -> None:
    table()
    drawn().savefig(TARGET, dpi=220, metadata={"Software": None})


if __name__ == "__main__":
    main()
