"""How far a landing depends on what the motion leaves open: the smoothing of its speeds, and the row that is taken for
first contact."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..cosim.result import PEAK
from ..errors import InputError
from .start import MotionStart, StartValue, start_parameters, start_values


def peak_doubts(start: MotionStart) -> dict[str, float]:
    """{what was taken otherwise: peak of the subtalar angle [deg]}, "" for the landing as it is. Landings that fail are
    left out."""
    starts: dict[str, Mapping[str, StartValue]] = {"": start.values}
    names = dict.fromkeys(name for v in start.values.values() if v.tried for name in v.tried.tried)
    for name in names:
        starts[f"speeds by {name}"] = {c: v.by(name) for c, v in start.values.items()}
    time = start.course.time
    k = int(np.argmin(np.abs(time - start.contact.at)))
    for other, word in ((k - 1, "one row earlier"), (k + 1, "one row later")):
        if 0 <= other < len(time):
            try:
                starts[word] = start_values(
                    start.scenario, start.course, float(time[other]), start.cutoff, start.table.path
                )
            except InputError:
                continue  # a gap there
    found = {}
    with start.scenario.open() as session:
        for name, values in starts.items():
            try:
                result = session.run({n: value for n, (value, _) in start_parameters(values).items()})
            except InputError:
                continue  # outside what the plant takes
            if PEAK in result.metrics:
                found[name] = result.metrics[PEAK]
    return found
