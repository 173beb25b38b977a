"""Parameters of a device fitted to the torques that its maker measured on a bench, before it lands.

The device is held at each angle of the table as `check` holds it, in a child process and in the sandbox; least squares
within the ranges (scipy's trust region); intervals of the linearised problem by Student's t, each parameter by itself.
They suppose that the law is right and the deviations are independent: what the law cannot follow shows in the RMS."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..contract import AXES, plain
from ..errors import InputError, SimulationError, nearest
from ..files import check_file, write
from ..fmu.component import Component
from ..fmu.confine import confinement
from ..fmu.driver import own_step
from ..fmu.opener import import_libraries as _prepare  # noqa: F401 - before the process is copied
from ..mapping import carried, load_mapping
from ..process import Child, Handlers, Limits, ProcessEnded, serve
from ..units import quantity
from .from_csv import read_curves
from .probe import Rig

Array = NDArray[np.float64]
LIMITS = Limits(trial=60.0, start=60.0, cpu=900.0)
AT_AN_END = 1e-3  # of the range


@dataclass(frozen=True)
class FittedParameter:
    """A parameter in its own unit: start value, fitted value, 95 % interval (None: the table does not determine it)."""

    name: str
    unit: str
    start: float
    value: float
    low: float | None
    high: float | None

    @property
    def text(self) -> str:
        """ "35.2 N.m/rad", as --set and a mapping file take it."""
        return f"{self.value:.6g} {self.unit}".strip()


@dataclass(frozen=True)
class Calibration:
    """Parameters fitted to a bench.

    parameters        what was varied
    rms_before, rms   root mean square of the deviations [N.m], at the start values and fitted
    curves            {axis: (n, 4) angle [rad], measured, start and fitted torque [N.m], in the contract's sign}
    notes             what a reader must know
    """

    parameters: tuple[FittedParameter, ...]
    rms_before: float
    rms: float
    curves: Mapping[str, Array]
    notes: tuple[str, ...]

    def settings(self, component: str = "brace") -> str:
        """The options that make a run use the values."""
        return " ".join(f'--set {component}.{p.name}="{p.text}"' for p in self.parameters)

    def listing(self) -> str:
        lines = [f"{'parameter':32}{'start':>14}{'fitted':>14}   95 % interval"]
        for p in self.parameters:
            known = "not determined by the table" if p.low is None else f"{p.low:.4g} ... {p.high:.4g} {p.unit}".strip()
            lines.append(f"{p.name:32}{p.start:14.4g}{p.value:14.4g}   {known}")
        rows = sum(len(c) for c in self.curves.values())
        lines.append(
            f"deviation (RMS of {rows} rows): {self.rms_before:.3g} N.m at the start values, {self.rms:.3g} N.m fitted"
        )
        return "\n".join([*lines, *(f"note: {note}" for note in self.notes)])

    def toml(self, source: str) -> str:
        """A mapping file that holds the values."""
        held = "\n".join(f'"{p.name}" = "{p.text}"' for p in self.parameters)
        return f"# fitted to {source}: {self.rms:.3g} N.m RMS\n[constants]\n{held}\n"


def calibrate(fmu: Path, bench: Path, ranges: Mapping[str, str], mapping: Path | None = None) -> Calibration:
    """Fits parameters {name: "LOW..HIGH" with unit} of the device to the table `bench` (as brace from-csv reads them).
    Raises InputError for what cannot be asked, SimulationError when the device fails at every try."""
    component = Component.read("brace", fmu)
    found = load_mapping(mapping) if mapping is not None else carried(component)
    component = component if found is None else found.apply(component)
    varied = {name: _range(component, name, text) for name, text in ranges.items()}
    if not varied:
        raise InputError("--vary: name a parameter of the device and its range, such as stiffness=10..80 N.m/rad")
    table = read_curves(bench)
    outputs = {plain(name) for name in component.outputs}
    axes = tuple(a for a in AXES if plain(f"{a}_torque") in outputs)
    for axis, branches in table.items():
        if axis not in axes:
            raise InputError(
                f"{bench}: measures {axis}, and {fmu.name} has no torque about it; it has {', '.join(axes)}"
            )
        if branches["loading"] != branches["unloading"]:
            raise InputError(f"{bench}: {axis} has two branches; a held device has one: give the column of one of them")
    angles = {axis: np.array(branches["loading"])[:, 0] for axis, branches in table.items()}
    measured = {axis: np.array(branches["loading"])[:, 1] for axis, branches in table.items()}
    rows = sum(map(len, angles.values()))
    if rows <= len(varied):
        raise InputError(f"{bench}: {rows} rows cannot determine {len(varied)} parameters")
    with _Held(component, axes, angles) as held:
        return _fit(held, measured, varied, component)


def write_calibration(target: Path, found: Calibration, source: str) -> None:
    """The mapping file with the values, and the figure beside it (.png). Raises InputError for a target that is no
    name of a file, EnvironmentProblem."""
    from ..figures import calibration, picture

    check_file(target, beside=(".png",))
    note = f"{source}; deviation {found.rms:.3g} N·m RMS. Held at each angle: no landing."
    write(target, found.toml(source), parents=True)
    write(target.with_suffix(".png"), picture(calibration(found.curves, note), "png"))


def _range(component: Component, name: str, text: str) -> tuple[float, float]:
    known = component.parameters
    if name not in known or not known[name].scalar_number:
        raise InputError(f"--vary {name}: {component.fmu.name} has no such parameter{nearest(name, known)}")
    first, dots, second = text.partition("..")
    unit = second.strip().partition(" ")[2]
    if not dots:
        raise InputError(f"--vary {name}={text}: must read NAME=LOW..HIGH, such as stiffness=10..80 N.m/rad")
    first = first.strip() if " " in first.strip() or not unit else f"{first.strip()} {unit}"
    connector = known[name]
    low, high = (quantity(part.strip(), connector.unit, f"--vary {name}") for part in (first, second))
    low, high = max(low, connector.minimum), min(high, connector.maximum)
    if not low < high:
        raise InputError(f"--vary {name}={text}: must rise, within {connector.minimum:g} ... {connector.maximum:g}")
    return low, high


def _fit(
    held: _Held, measured: Mapping[str, Array], varied: Mapping[str, tuple[float, float]], component: Component
) -> Calibration:
    from scipy.optimize import least_squares
    from scipy.special import stdtrit

    names, ends = list(varied), np.array(list(varied.values()))
    low, high = ends.T
    width = high - low
    target = np.concatenate([measured[axis] for axis in measured])
    stated = np.array([component.parameters[name].start or 0.0 for name in names])
    begin = np.where((stated > low) & (stated < high), stated, 0.5 * (low + high))

    def torques(x: Array) -> Array:
        return held.torques(dict(zip(names, (low + width * x).tolist(), strict=True)))

    before = held.torques(dict(zip(names, stated.tolist(), strict=True)))
    fit = least_squares(
        lambda x: torques(x) - target,
        (begin - low) / width,
        bounds=(0.0, 1.0),
        diff_step=1e-3,
        x_scale=1.0,
        max_nfev=60,
    )
    free = len(target) - len(names)
    rms = float(np.sqrt(np.mean(fit.fun**2)))
    deviation = float(np.sqrt(np.sum(fit.fun**2) / free))
    singular = np.linalg.svd(fit.jac, compute_uv=False)
    determined = singular[-1] > 1e-8 * max(singular[0], 1e-300)
    half = np.full(len(names), math.nan)
    if determined:
        error = deviation * np.sqrt(np.diag(np.linalg.inv(fit.jac.T @ fit.jac)))
        half = float(stdtrit(free, 0.975)) * error * width
    values = low + width * fit.x
    notes = [
        f"{name} lies at the end of its range: widen it, or the law does not fit the table"
        for name, x in zip(names, fit.x, strict=True)
        if not AT_AN_END < x < 1 - AT_AN_END
    ]
    if not determined:
        notes.append("the table cannot tell these parameters apart: fix some of them")
    fitted = torques(fit.x)
    curves, at = {}, 0
    for axis, torque in measured.items():
        span = slice(at, at + len(torque))
        curves[axis] = np.column_stack([held.angles[axis], torque, before[span], fitted[span]])
        at += len(torque)
    parameters = tuple(
        FittedParameter(
            name,
            _unit(component, name),
            float(stated[k]),
            float(values[k]),
            None if math.isnan(half[k]) else float(values[k] - half[k]),
            None if math.isnan(half[k]) else float(values[k] + half[k]),
        )
        for k, name in enumerate(names)
    )
    return Calibration(parameters, float(np.sqrt(np.mean((before - target) ** 2))), rms, curves, tuple(notes))


def _unit(component: Component, name: str) -> str:
    unit = component.parameters[name].unit
    return "" if unit is None or unit.dimensionless else unit.name


class _Held:
    """The device in a child, held at the angles {axis: (n,) [rad]} of a table."""

    def __init__(self, component: Component, axes: Sequence[str], angles: Mapping[str, Array]) -> None:
        self.angles = angles
        self._child = Child(__name__, LIMITS)
        try:
            places = {axis: at.tolist() for axis, at in angles.items()}
            self._child.open((component, tuple(axes), places), LIMITS.of_starts().seconds, confinement([component]))
        except ProcessEnded as end:
            words = self._child.last_words()
            self._child.close()
            raise SimulationError(f"the device cannot be opened: its process {end}{words}") from None
        except BaseException:
            self._child.close()
            raise

    def torques(self, parameters: Mapping[str, float]) -> Array:
        """(rows,) [N.m], axis after axis."""
        try:
            return np.array(self._child.call("torques", dict(parameters), limit=LIMITS.of_trials().seconds))
        except ProcessEnded as end:
            raise SimulationError(f"the device's process {end}{self._child.last_words()}") from None

    def __enter__(self) -> _Held:
        return self

    def __exit__(self, *_: object) -> None:
        self._child.close()


@contextmanager
def _handlers(subject: tuple[Component, tuple[str, ...], Mapping[str, list[float]]]) -> Iterator[Handlers]:
    """The child: holds the device at each angle."""
    component, axes, angles = subject
    step = own_step(component)

    def torques(parameters: dict[str, float]) -> list[float]:
        rig = Rig(component, axes, parameters)
        try:
            found: list[Any] = []
            for axis, values in angles.items():
                k = axes.index(axis)
                found += [float(rig.hold(rig.along(k, value), step)[k]) for value in values]
            return found
        finally:
            rig.close()

    yield {"torques": torques}


if __name__ == "__main__":
    serve(_handlers)
