"""Trials that repeat published ones (`study --inputs`), beside their records, which users do not have: they are looked
for in the folder that SPRAIN_REFERENCE names."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..folders.study import PEAK, StudyFolder
from .selection import FEWEST

if TYPE_CHECKING:
    import pandas as pd

REFERENCE = "SPRAIN_REFERENCE"
INPUTS = {"drop_height_m": "plant.drop_height [m]", "contact_dissipation_s_m": "plant.contact_dissipation [s/m]"}
Pair = tuple[NDArray[np.float64], NDArray[np.float64]]


def published_records(study: StudyFolder) -> Pair | None:
    """(n,) published and simulated peaks [deg] of the same trials; None where no published study has these inputs."""
    import pandas as pd

    place = os.environ.get(REFERENCE)
    if not place or study.summary.method != "table" or any(c not in study.done for c in (*INPUTS.values(), PEAK)):
        return None
    done = study.done.set_index("trial")
    for path in sorted((Path(place) / "paper").glob("study*_trials.csv")):
        records = pd.read_csv(path).set_index("trial")
        both = done.index.intersection(records.index)
        if len(both) >= FEWEST and len(both) == len(done) and _alike(done.loc[both], records.loc[both], study):
            return records.loc[both, "peak_subtalar_deg"].to_numpy(float), done.loc[both, PEAK].to_numpy(float)
    return None


def authors_peaks(number: int) -> NDArray[np.float64] | None:
    """Peaks [deg] of the authors' own trials of that study, as many as are at hand; None where there are none."""
    import pandas as pd

    place = os.environ.get(REFERENCE)
    path = Path(place or "") / "paper" / f"study{number}_trials.csv"
    return pd.read_csv(path)["peak_subtalar_deg"].to_numpy(float) if place and path.is_file() else None


def _alike(done: pd.DataFrame, records: pd.DataFrame, study: StudyFolder) -> bool:
    """The same inputs, and a device, co-activation and reflex where the records have them: studies 3 and 4 share their
    other inputs."""
    controls: Mapping[str, str] = {
        "coactivation": "controller.coactivation",
        "reflex_gain": "controller.reflex_gain",
    }
    pairs = [(done[ours], records[theirs]) for theirs, ours in INPUTS.items()]
    for theirs, ours in controls.items():
        pairs.append((done[ours] if ours in done else 0.0 * records[theirs], records[theirs]))
    braced = bool(records["brace_scale_bi"].notna().all())
    return braced == ("brace" in study.manifest.fmus) and all(np.allclose(a, b, rtol=1e-4) for a, b in pairs)
