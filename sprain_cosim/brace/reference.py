"""Does a device give here what it gave where it was made? The reference experiments that it carries (fmu/reference.py),
run in a child process and compared: they show a wrong build, unit or start value without any guess.

Inputs are set at the beginning of each communication step, as FMPy and the Reference-FMUs do, and hold for it; where
the outputs then differ, a second run sets those of the step's end, for the drafts leave this open."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, SprainError, without_name
from ..fmu.component import Component
from ..fmu.confine import confinement
from ..fmu.driver import Driver
from ..fmu.element import Connector
from ..fmu.opener import import_libraries as _prepare  # noqa: F401 - the former before the process is copied
from ..fmu.opener import preload
from ..fmu.reference import VERSION, Experiment, Series, experiments
from ..process import Child, Handlers, Limits, ProcessEnded, serve
from ..units import unit
from .fit import FitReport

LIMIT = 1e-3  # of a variable's largest value, by which it may differ, unless the file's tolerance is wider
START_LIMIT, RUN_LIMIT = 60.0, 60.0  # s, of each experiment
MEMORY = 8 << 30  # B
ROUNDING = 1e-9
POINTS = 200_000  # communication points that are run at most
DEFAULT_POINTS = 500
Array = NDArray[np.float64]


def compare_references(component: Component, report: FitReport) -> None:
    """Runs what `component`, as the FMU describes it, carries; the findings go to `report`."""
    found, unread = experiments(component.fmu)
    report.notes += [f"reference experiment {line}" for line in unread]
    for experiment in found:
        try:
            report.references.append(_compared(component, experiment))
        except InputError as problem:
            report.warnings.append(
                f"reference experiment {experiment.name} cannot be compared: {without_name(component.name, problem)}"
            )
        except (SprainError, ProcessEnded) as problem:
            words = without_name(component.name, problem)
            report.problems.append(
                f"reference experiment {experiment.name}: ran where the FMU was made, but here: {words}"
            )
        else:
            _judge(report.references[-1], report)


def _judge(result: dict[str, Any], report: FitReport) -> None:
    name, variable = result["name"], result["variable"]
    share, limit = (f"{100 * result[key]:.2g} %" for key in ("difference", "limit"))
    if result["fits"]:
        count = result["outputs"]
        apart = "to rounding" if result["difference"] < ROUNDING else f"at most {share} of its largest value apart"
        report.notes.append(
            f"reference experiment {name} (FMI-LS-REF {VERSION}) is reproduced: {count} output{'s' * (count > 1)} at "
            f"{result['points']} times, {apart} ({variable} at {result['time_s']:.6g} s; {limit} allowed)"
        )
        return
    report.problems.append(
        f"reference experiment {name} is not reproduced: {variable} is {result['value']:.6g} at "
        f"{result['time_s']:.6g} s, {result['expected']:.6g} in the table that the FMU carries: {share} of "
        f"its largest value apart, {limit} allowed; a build, a unit or a start value differs from its maker's; ask the "
        "maker, or have the experiment written again"
    )


def _compared(component: Component, experiment: Experiment) -> dict[str, Any]:
    """The largest difference of any output, as data. Raises InputError, SimulationError, ProcessEnded."""
    outputs = [name for name in experiment.references.values if name in component.outputs]
    if not outputs:
        raise InputError(
            f"its reference results name no output of the FMU ({', '.join(list(experiment.references.values)[:6])})"
        )
    for name in experiment.stimuli.values if experiment.stimuli else {}:
        if name not in component.inputs:
            raise InputError(f"its stimuli set {name}, which is no input of the FMU")
    parameters = {name: _parameter(component, name, value) for name, value in experiment.parameters.items()}
    times = _communication_points(component, experiment)
    expected = {name: _in_own_unit(component.outputs[name], experiment.references, name) for name in outputs}
    limit = max(LIMIT, experiment.tolerance or 0.0)
    results = []
    child = Child("sprain_cosim.brace.reference", Limits(memory=MEMORY))
    try:
        child.open(replace(component, fmu=component.fmu.absolute()), START_LIMIT, confinement([component]))
        for at_end in (False, True):
            inputs = _inputs(component, experiment.stimuli, times, at_end)
            values = child.call("run", times.tolist(), inputs, outputs, parameters, limit=RUN_LIMIT)
            results.append(_largest(experiment.references.time, expected, times, np.array(values), limit))
            if results[-1]["fits"] or experiment.stimuli is None:
                break
    finally:
        child.close()
    best = min(results, key=lambda result: float(result["difference"]))
    return {"name": experiment.name, **best, "outputs": len(outputs), "points": len(experiment.references.time)}


def _parameter(component: Component, name: str, value: float | str | bool) -> float:
    """In the variable's own unit. Raises InputError."""
    connector = component.connectors.get(name)
    if connector is None or connector.causality not in ("parameter", "structuralParameter", "input"):
        raise InputError(f"it sets {name}, which is no parameter of the FMU")
    if isinstance(value, float) and connector.kind in ("real", "integer"):
        return value
    return connector.value(value, name)


def _in_own_unit(connector: Connector, series: Series, name: str) -> Array:
    """The column in the unit of its variable. Raises InputError."""
    if name not in series.units or connector.unit is None:
        return series.values[name]
    named = unit(series.units[name])
    if not named.same_dimension(connector.unit):
        raise InputError(f"its column {name} is in {named.name}, the FMU's variable in {connector.unit.name}")
    own = connector.unit
    return np.array([own.from_base(named.to_base(value)) for value in series.values[name].tolist()])


def _communication_points(component: Component, experiment: Experiment) -> Array:
    """(n,) s. Steps as the experiment says, in multiples of the device's own; else the times of the references."""
    reached = experiment.references.time
    stop = float(reached[-1]) if experiment.stop is None else experiment.stop
    span = stop - experiment.start
    if not span > 0:
        raise InputError(f"it ends at {stop:g} s, where it begins")
    own = component.capabilities.fixed_step
    step = experiment.step or own
    if step is None:
        times = np.unique(reached[(reached > experiment.start) & (reached <= stop)])
        times = np.concatenate([[experiment.start], times])
        return times if len(times) > 1 else np.linspace(experiment.start, stop, DEFAULT_POINTS)
    if own is not None:
        step = own * max(1, round(step / own))
    count = math.floor(span / step + 1e-9)
    if not 1 <= count <= POINTS:
        raise InputError(f"it has {count} steps; 1 to {POINTS} are run")
    return np.asarray(experiment.start + step * np.arange(count + 1))


def _inputs(component: Component, stimuli: Series | None, times: Array, at_end: bool) -> dict[str, list[float]]:
    """{input: values (n,)}: what is set for the initialisation, and for each step from its beginning or its end."""
    if stimuli is None:
        return {}
    taken = np.concatenate([times[:1], times[1:] if at_end else times[:-1]])
    columns = {
        name: replace(stimuli, values={name: _in_own_unit(component.inputs[name], stimuli, name)})
        for name in stimuli.values
    }
    return {
        name: [series.at(name, time, component.inputs[name].kind == "real") for time in taken.tolist()]
        for name, series in columns.items()
    }


def _largest(reached: Array, expected: dict[str, Array], times: Array, values: Array, limit: float) -> dict[str, Any]:
    """The output that differs most from `expected`, as a share of its largest value; `values` (n, outputs)."""
    inside = (reached >= times[0] - 1e-12) & (reached <= times[-1] * (1 + 1e-12))
    worst: dict[str, Any] = {"difference": -1.0}
    for k, (name, column) in enumerate(expected.items()):
        found = np.interp(reached[inside], times, values[:, k])
        apart = np.abs(found - column[inside]) / (np.abs(column[inside]).max(initial=0.0) or 1.0)
        if not len(apart):
            raise InputError("no time of its reference results lies between its start and its stop")
        apart = np.where(np.isfinite(apart), apart, np.inf)
        at = int(apart.argmax())
        if apart[at] > worst["difference"]:
            worst = {
                "variable": name,
                "time_s": float(reached[inside][at]),
                "value": float(found[at]),
                "expected": float(column[inside][at]),
                "difference": float(apart[at]),
            }
    return {**worst, "limit": limit, "fits": worst["difference"] <= limit}


# ---- the child


@contextmanager
def _handlers(component: Component) -> Iterator[Handlers]:
    preload()

    def run(
        times: list[float], inputs: dict[str, list[float]], outputs: list[str], parameters: dict[str, float]
    ) -> list[list[float]]:
        with Driver(component, list(inputs), outputs) as driver:
            driver.start(parameters, {name: values[0] for name, values in inputs.items()}, times[0], times[-1])
            rows = [driver.output_values.tolist()]
            for k in range(1, len(times)):
                driver.step(times[k] - times[k - 1], {n: v[k] for n, v in inputs.items()}, times[k - 1])
                rows.append(driver.output_values.tolist())
        return rows

    yield {"run": run}


if __name__ == "__main__":
    serve(_handlers)
