"""Is a scaled person the one that OpenSim's scale tool makes? Through the FMU alone."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...cosim.result import Result
from ..check import Check, CheckRow
from ..laboratory import Laboratory, every_millisecond, rms

SCALED = "OpenSim 4.6 running the scaled model of Yoder et al. 2021 (doi 10.3389/fbioe.2021.765331)"
CASES = {"incline30": "bare", "incline30_mixed": "mixed"}  # in the names of the reference trajectories
EQUAL, UNEQUAL = 0.06, 0.12  # deg
WHY = (
    f"{EQUAL:g} deg, the reference's own error by its held controls; {UNEQUAL:g} deg for unequal factors, for which "
    "OpenSim takes a solid cylinder's inertia and the plant scales the second moments"
)


def _landing(laboratory: Laboratory, person: dict[str, Any], scenario: str) -> Result:
    """At 0.25 ms, over which the reference holds its controls, sampled at 1 kHz as it is."""
    return every_millisecond(laboratory.run(scenario, person["set"], step="0.25 ms"))


def _limit(person: dict[str, Any]) -> float:
    return UNEQUAL if person.get("unequal") else EQUAL


def person_peaks(laboratory: Laboratory) -> list[CheckRow]:
    return [
        CheckRow(
            f"{person['name']}, {scenario}",
            float(np.degrees(_landing(laboratory, person, scenario)["plant.subtalar_angle"].max())),
            peak,
            _limit(person),
            "deg",
        )
        for person in laboratory.figures["person"]
        for scenario, peak in person["peak_subtalar_angle_deg"].items()
    ]


def person_trajectories(laboratory: Laboratory) -> list[CheckRow]:
    rows = []
    for person in laboratory.figures["person"]:
        for scenario, case in CASES.items():
            ours = _landing(laboratory, person, scenario)
            table = laboratory.table(f"subjects/{person['name'].replace(' ', '_')}_{case}.csv.gz")
            label, late = f"{person['name']}, {scenario}", (table.time_s > 0.005).to_numpy()
            off = rms(np.degrees(ours["plant.subtalar_angle"]) - table.subtalar_angle_deg)
            rows.append(CheckRow(f"{label}: subtalar angle", off, 0.0, _limit(person), "deg RMS"))
            expected = table.grf_vertical_N.to_numpy()[late]
            off = 100 * rms(ours["plant.ground_force_y"][late] - expected) / expected.max()
            rows.append(CheckRow(f"{label}: ground reaction after 5 ms", off, 0.0, 1.0, "% of its peak"))
    return rows


CHECKS = (
    Check("plant-23", "Peak subtalar supination of nine scaled persons, two landings each", WHY, SCALED, person_peaks),
    Check(
        "plant-24",
        "Subtalar trajectories and ground reactions of scaled persons",
        WHY + "; ground reaction: the bound of 1 %",
        SCALED,
        person_trajectories,
        quick=False,
        needs=("reference",),
    ),
)
