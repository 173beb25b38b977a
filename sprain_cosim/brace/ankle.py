"""A measured ankle: the plant's passive law fitted to torques that were measured without a brace, and the brace as the
difference of two tables.

The law is P(t) = a t + b t^2 + c t^3 about each body-fixed Euler angle t of the calcaneus in the tibia, restoring; it
is linear in its coefficients. A table about rotation_x, rotation_y, rotation_z gives the three of that axis. A table
about a hinge, turned with the other one held, gives sum of P_k dt_k/dangle (virtual work): a subtalar curve cannot tell
x and y apart, so each power of both is scaled by one factor and keeps the model's proportion; a talocrural curve does
so with z. Least squares; 95 % intervals by Student's t, each coefficient by itself: they suppose that the law is right
and the deviations are independent, and what the law cannot follow shows in the RMS."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from ..errors import InputError, visible
from ..files import check_file, write
from ..fmu.component import Component
from ..fmu.driver import Driver
from ..literature import PASSIVE
from ..scenario import load_scenario
from ..scenario.title import RAN
from .from_csv import AXES, Curves, curve_rows, curves_to_fmu, read_curves

Array = NDArray[np.float64]
EULER = tuple(PASSIVE)
POWERS = {"linear": "N.m/rad", "quadratic": "N.m/rad2", "cubic": "N.m/rad3"}
SCALED = {"subtalar": ("rotation_x", "rotation_y"), "talocrural": ("rotation_z",)}  # by the factors of that hinge
LANDING = math.radians(55.0)  # as far as a landing on the 30 deg slope turns the ankle without a brace
HYSTERESIS, OFFSET = 0.15, 0.1  # shares of the largest torque that are worth a word


@dataclass(frozen=True)
class PassiveCoefficient:
    """One of the nine: what the model has and the fitted value [N.m/rad, N.m/rad2, N.m/rad3] with its 95 % interval;
    None: of a table with no row to spare, or kept as the model's."""

    axis: str
    power: str
    model: float
    value: float
    low: float | None
    high: float | None
    fitted: bool

    @property
    def parameter(self) -> str:
        return f"passive_{self.axis[-1]}_{self.power}"

    @property
    def text(self) -> str:
        return f"{self.value!r} {POWERS[self.power]}"


@dataclass(frozen=True)
class MeasuredAnkle:
    """The passive ankle of a table.

    - coefficients: all nine
    - rms_model, rms: root mean square of the deviations [N.m] of the model's law and of the fitted one
    - curves: {axis of the table: (n, 4) angle [rad], measured, model's and fitted torque [N.m] on the foot}
    - notes: what a reader must know
    """

    coefficients: tuple[PassiveCoefficient, ...]
    rms_model: float
    rms: float
    curves: Mapping[str, Array]
    notes: tuple[str, ...]

    def listing(self) -> str:
        lines = [f"{'parameter':22}{'model':>12}{'fitted':>12}   95 % interval"]
        for c in self.coefficients:
            known = f"{c.low:.4g} ... {c.high:.4g}" if c.low is not None else "not known" if c.fitted else "kept"
            lines.append(f"{c.parameter:22}{c.model:12.4g}{c.value:12.4g}   {known} {POWERS[c.power]}")
        rows = sum(len(curve) for curve in self.curves.values())
        lines.append(
            f"deviation (RMS of {rows} rows): {self.rms_model:.3g} N.m of the model, {self.rms:.3g} N.m fitted"
        )
        for axis, curve in self.curves.items():
            ends = np.degrees(curve[[0, -1], 0])
            lines.append(
                f"{axis}: data from {ends[0]:.4g} to {ends[1]:.4g} deg; outside, the cubic goes on without data"
            )
        return "\n".join([*lines, *(f"note: {note}" for note in self.notes)])

    def toml(self, source: str, base: str) -> str:
        """A scenario on top of `base`."""
        head = "".join(f"# {line}\n" for line in visible(f"fitted to {source}\n{self.listing()}").splitlines())
        title = visible(f"{RAN}, ankle of {source}").replace("\\", "\\\\").replace('"', '\\"')
        held = "\n".join(f'"plant.{c.parameter}" = "{c.text}"' for c in self.coefficients)
        return f'{head}base = "{base}"\ntitle = "{title}"\n\n[parameters]\n{held}\n'


def measured_ankle(
    table: Path, base: str = "incline30", talocrural: float = 0.0, subtalar: float = 0.0
) -> tuple[MeasuredAnkle, Curves]:
    """Fits the law to the `table`; its curves besides, as read_curves gives them.

    - base: scenario whose plant turns the hinges
    - talocrural, subtalar: [rad] at which that joint was held while the table turned the other one

    Raises InputError naming row and column."""
    curves = read_curves(table, (*AXES, *EULER))
    hinges = [axis for axis in curves if axis in AXES]
    if hinges and len(hinges) < len(curves):
        raise InputError(
            f"{table}: measures about hinges ({', '.join(hinges)}) and about Euler axes; give a table of one kind"
        )
    points = {axis: _mean(branches) for axis, branches in curves.items()}
    notes = _hysteresis(curves)
    if not hinges:
        rates = {axis: {axis: (p[:, 0], np.ones(len(p)))} for axis, p in points.items()}
        return _fitted(table, _Measured(points, rates), [(axis,) for axis in points], False, notes), curves
    plant = next((c for c in load_scenario(base).components() if c.name == "plant"), None)
    if not isinstance(plant, Component):
        raise InputError(f"--base {base}: has no plant")
    kept = [axis for axis in EULER if not any(axis in SCALED[hinge] for hinge in hinges)]
    notes += [f"{axis}: not measured; the model's law is kept, and the others make up for it" for axis in kept]
    notes += [
        f"{hinge}: one factor for each power of {' and '.join(SCALED[hinge])}, in the model's proportion: a hinge "
        "cannot tell its axes apart"
        for hinge in hinges
    ]
    turned = _turned(plant, points, {"talocrural": talocrural, "subtalar": subtalar})
    return _fitted(table, _Measured(points, turned), [SCALED[hinge] for hinge in hinges], True, notes), curves


def _mean(branches: Mapping[str, list[list[float]]]) -> Array:
    """(n, 2) angle [rad] and torque on the foot [N.m]: the mean of the two branches at the rows of the first that lie
    within the second."""
    loading, unloading = (np.array(branches[b])[:, :2] for b in ("loading", "unloading"))
    inside = (loading[:, 0] >= unloading[0, 0]) & (loading[:, 0] <= unloading[-1, 0])
    other = PchipInterpolator(unloading[:, 0], unloading[:, 1])(loading[inside, 0])
    return np.column_stack([loading[inside, 0], 0.5 * (loading[inside, 1] + other)])


def _hysteresis(curves: Curves) -> list[str]:
    notes = []
    for axis, branches in curves.items():
        if branches["loading"] == branches["unloading"]:
            continue
        loading, unloading = (np.array(branches[b]) for b in ("loading", "unloading"))
        low, high = max(loading[0, 0], unloading[0, 0]), min(loading[-1, 0], unloading[-1, 0])
        at = np.linspace(low, high, 101)
        one, two = (PchipInterpolator(c[:, 0], c[:, 1])(at) for c in (loading, unloading))
        gap, most = float(np.abs(one - two).max()), float(np.abs(loading[:, 1]).max())
        if gap > HYSTERESIS * most:
            notes.append(
                f"{axis}: loading and unloading differ by up to {gap:.3g} N.m; the law, which has no friction, is that "
                "of their mean"
            )
    return notes


def _turned(
    plant: Component, points: Mapping[str, Array], held: Mapping[str, float]
) -> dict[str, dict[str, tuple[Array, Array]]]:
    """{hinge: {Euler axis: (n,) its angle [rad] and its rate over the hinge's}} at the rows of the table."""
    out = {}
    wanted = [f"{axis}_{kind}" for axis in EULER for kind in ("angle", "velocity")]
    with Driver(plant, (), wanted) as driver:
        for hinge, rows in points.items():
            found = []
            for angle in rows[:, 0]:
                at = {**held, hinge: float(angle)}
                driver.start(
                    {f"{joint}_angle_at_contact": value for joint, value in at.items()}
                    | {f"{joint}_velocity_at_contact": float(joint == hinge) for joint in AXES},
                    stop=1.0,
                )
                found.append([driver[name] for name in wanted])
            columns = np.array(found).T
            out[hinge] = {axis: (columns[2 * k], columns[2 * k + 1]) for k, axis in enumerate(EULER)}
    return out


@dataclass(frozen=True)
class _Measured:
    """Rows of a table, one axis after the other: `points` {axis: (n, 2) angle [rad], torque on the foot [N.m]}, and
    `rates` {axis: {Euler axis: its angle [rad] and its rate over the table's}}."""

    points: Mapping[str, Array]
    rates: Mapping[str, Mapping[str, tuple[Array, Array]]]

    @property
    def resisting(self) -> Array:
        return np.concatenate([-p[:, 1] for p in self.points.values()])

    def power(self, euler: str, power: int, coefficient: float) -> Array:
        """(rows,) [N.m] of one term of the law."""
        zero = np.zeros(0)
        parts = []
        for axis, p in self.points.items():
            angle, rate = self.rates[axis].get(euler, (zero, zero))
            parts.append(coefficient * rate * angle ** (power + 1) if len(angle) else np.zeros(len(p)))
        return np.concatenate(parts)

    def model(self, axes: Iterable[str]) -> Array:
        """(rows,) [N.m] of the model's law about these Euler axes."""
        terms = [self.power(axis, k, PASSIVE[axis][k]) for axis in axes for k in range(3)]
        return np.sum(terms, axis=0) if terms else np.zeros(len(self.resisting))


def _fitted(
    table: Path, measured: _Measured, groups: Sequence[tuple[str, ...]], scaled: bool, notes: Sequence[str]
) -> MeasuredAnkle:
    """`groups` of Euler axes: with `scaled` the three powers of each have one factor of the model's coefficients, else
    each is one axis, whose coefficients are found."""
    free = [axis for group in groups for axis in group]
    kept = measured.model(a for a in EULER if a not in free)
    design = np.column_stack(
        [
            np.sum([measured.power(axis, k, PASSIVE[axis][k] if scaled else 1.0) for axis in group], axis=0)
            for group in groups
            for k in range(3)
        ]
    )
    _check_design(table, design)
    target = measured.resisting - kept
    solution = np.linalg.lstsq(design, target, rcond=None)[0]
    ends = np.cumsum([len(p) for p in measured.points.values()])[:-1]
    half = _half_widths(design, target - design @ solution, [] if scaled else ends.tolist())
    found = {
        (axis, k): (PASSIVE[axis][k] if scaled else 1.0) * np.array([solution[3 * g + k], half[3 * g + k]])
        for g, group in enumerate(groups)
        for axis in group
        for k in range(3)
    }
    coefficients = tuple(_coefficient(axis, k, found.get((axis, k))) for axis in EULER for k in range(3))
    model, fitted = kept + measured.model(free), kept + design @ solution
    parts = zip(measured.points.items(), np.split(model, ends), np.split(fitted, ends), strict=True)
    return MeasuredAnkle(
        coefficients,
        float(np.sqrt(np.mean((model - measured.resisting) ** 2))),
        float(np.sqrt(np.mean((fitted - measured.resisting) ** 2))),
        {axis: np.column_stack([p, -before, -after]) for (axis, p), before, after in parts},
        (*notes, *_zero(measured.points), *_pushing(coefficients)),
    )


def _check_design(table: Path, design: Array) -> None:
    rows, count = design.shape
    if rows < count:
        raise InputError(f"{table}: {rows} rows cannot determine {count} coefficients; measure more")
    size = np.linalg.norm(design, axis=0)
    singular = np.linalg.svd(design / np.where(size > 0, size, 1.0), compute_uv=False)
    if not size.all() or singular[-1] < 1e-6 * singular[0]:
        raise InputError(f"{table}: its angles cannot tell the three powers apart; measure over a wider range")


def _half_widths(design: Array, deviations: Array, ends: Sequence[int]) -> Array:
    """(k,) of the 95 % intervals; NaN without a row to spare. `ends` of rows that have three columns, and a scatter, of
    their own; none: all rows have all columns."""
    from scipy.special import stdtrit

    out = []
    for k, rows in enumerate(np.split(np.arange(len(design)), ends)):
        part = design[rows, 3 * k : 3 * k + 3] if len(ends) else design
        spare = part.shape[0] - part.shape[1]
        if spare < 1:
            out.append(np.full(part.shape[1], math.nan))
            continue
        variance = float(deviations[rows] @ deviations[rows]) / spare
        spread = np.sqrt(variance * np.diag(np.linalg.inv(part.T @ part)))
        out.append(float(stdtrit(spare, 0.975)) * spread)
    return np.concatenate(out)


def _coefficient(axis: str, power: int, found: Array | None) -> PassiveCoefficient:
    name, model = tuple(POWERS)[power], PASSIVE[axis][power]
    if found is None:
        return PassiveCoefficient(axis, name, model, model, None, None, False)
    value, half = float(found[0]), abs(float(found[1]))
    if math.isnan(half):
        return PassiveCoefficient(axis, name, model, value, None, None, True)
    return PassiveCoefficient(axis, name, model, value, value - half, value + half, True)


def _zero(points: Mapping[str, Array]) -> list[str]:
    """A law without a constant passes through zero at the neutral pose; a table that does not has another zero."""
    notes = []
    for axis, p in points.items():
        if p[0, 0] <= 0.0 <= p[-1, 0]:
            torque, most = float(PchipInterpolator(p[:, 0], p[:, 1])(0.0)), float(np.abs(p[:, 1]).max())
            if abs(torque) > OFFSET * most:
                notes.append(
                    f"{axis}: {torque:.3g} N.m at 0 deg, where the law has none: is the table's zero the neutral pose?"
                )
        else:
            notes.append(f"{axis}: the table does not reach the neutral pose at 0 deg")
    return notes


def _pushing(coefficients: tuple[PassiveCoefficient, ...]) -> list[str]:
    """Where a fitted cubic pushes the foot on within the angles of a landing."""
    notes = []
    angles = np.linspace(0.01, LANDING, 300)
    for axis in EULER:
        a, b, c = (k.value for k in coefficients if k.axis == axis)
        if not any(k.fitted for k in coefficients if k.axis == axis):
            continue
        for sign, way in ((1.0, ""), (-1.0, "-")):
            stiffness = a + b * sign * angles + c * angles**2
            if stiffness.min() < 0:
                first = math.degrees(angles[int(np.argmax(stiffness < 0))])
                notes.append(
                    f"{axis}: from {way}{first:.0f} deg on the fitted law pushes the foot instead of holding it"
                )
    return notes


def brace_between(with_brace: Path, without: Curves, source: Path) -> dict[str, dict[str, list[list[float]]]]:
    """The brace: the table `with_brace` minus the curves `without` one, at its rows where both have data. Raises
    InputError."""
    if any(axis not in AXES for axis in without):
        raise InputError(
            f"{source}: the brace of a table is one about {' or '.join(AXES)}; these curves are about Euler axes: "
            "leave --with-brace out, or measure about a hinge"
        )
    both = read_curves(with_brace)
    out: dict[str, dict[str, list[list[float]]]] = {}
    for axis, branches in both.items():
        if axis not in without:
            raise InputError(f"{with_brace}: measures {axis}, which {source} does not: nothing to subtract")
        out[axis] = {}
        for name, rows in branches.items():
            bare, worn = np.array(without[axis][name]), np.array(rows)
            inside = (worn[:, 0] >= bare[0, 0]) & (worn[:, 0] <= bare[-1, 0])
            if inside.sum() < 3:
                raise InputError(f"{with_brace}: {axis}: fewer than three rows at angles that {source} has as well")
            at = worn[inside, 0]
            difference = worn[inside, 1] - PchipInterpolator(bare[:, 0], bare[:, 1])(at)
            if float(np.sum(at * difference)) > 0:
                raise InputError(
                    f"{with_brace}: {axis}: with the brace the foot is held less than without; are the tables swapped?"
                )
            out[axis][name] = curve_rows(at, difference)
    return out


def write_ankle(target: Path, found: MeasuredAnkle, source: str, base: str) -> None:
    """The scenario, and the figure beside it (.png). Raises InputError for a target that is no name of a file,
    EnvironmentProblem."""
    from ..figures import calibration, picture

    check_file(target, beside=(".png",))
    note = f"{source}; deviation {found.rms:.3g} N·m RMS. From the law alone: no landing, no initial pose."
    write(target, found.toml(source, base), parents=True)
    write(
        target.with_suffix(".png"),
        picture(calibration(found.curves, note, "ankle, fitted", "ankle of the model"), "png"),
    )


def write_difference(target: Path, curves: Curves, source: Path, template: Path) -> dict[str, tuple[float, float]]:
    """The FMU of the brace; the range of angles [rad] of each axis. Raises EnvironmentProblem."""
    return curves_to_fmu(source, curves, target, template)
