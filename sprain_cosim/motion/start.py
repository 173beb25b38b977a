"""The state at contact out of a measured motion, as a scenario's parameters."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..errors import InputError, SimulationError
from ..export.landing import COORDINATES, TRANSLATIONS
from ..fmu.component import Component
from ..fmu.element import Element
from ..scenario import Scenario, load_scenario
from ..scenario.title import RAN
from .contact import TOUCH, FirstContact, first_contact, sole_heights
from .coordinates import AHEAD, Array, Course, facing, read_course
from .osim import OpenSimModel, read_osim
from .speeds import CUTOFF, LEAST, SplineSpeed, spline_speed, value_at
from .storage import StorageTable, read_storage

NAMES = {"ankle_angle_r": "talocrural_angle_at_contact", "subtalar_angle_r": "subtalar_angle_at_contact"}
RATES = {
    "ankle_angle_r": "talocrural_velocity_at_contact",
    "subtalar_angle_r": "subtalar_velocity_at_contact",
    "pelvis_ty": "pelvis_vertical_velocity",
}


@dataclass(frozen=True)
class StartValue:
    """One coordinate at contact, in the plant's sign [rad, m].

    - label: its column in the file, "" where the file has none and it is filled: neutral, at rest
    - value, speed: at contact [rad, m, and per s]
    - own: value and speed that the plant has without a motion
    - tried: the speed by other smoothings; None: from the file's own column, or filled
    - by_column: the speed stands in the file
    """

    coordinate: str
    label: str
    value: float
    speed: float
    own: tuple[float, float]
    tried: SplineSpeed | None
    by_column: bool

    @property
    def low(self) -> float:
        """The least speed of all smoothings."""
        return self.speed if self.tried is None else self.tried.low

    @property
    def high(self) -> float:
        return self.speed if self.tried is None else self.tried.high

    @property
    def unit(self) -> str:
        return "m" if self.coordinate in TRANSLATIONS else "rad"

    def by(self, smoothing: str) -> StartValue:
        """The same with the speed by another of the smoothings that were tried."""
        return self if self.tried is None else replace(self, speed=self.tried.tried.get(smoothing, self.speed))


@dataclass(frozen=True)
class MotionStart:
    """A landing that starts as a measured motion.

    - table, course: the file, and its motion as the plant counts it
    - contact: when, and how that is known
    - values: the 15 coordinates
    - side, pose, base, cutoff [Hz]: as asked for
    - heights: (n,) [m] of the sole over a level floor at the file's rows; empty where they were not needed
    - clearance: [m] of the sole over the base's platform, in the file's own height
    - model: the person's, if one was named
    - scenario: the base with all of it
    """

    table: StorageTable
    course: Course
    contact: FirstContact
    values: Mapping[str, StartValue]
    side: str
    pose: str
    base: str
    cutoff: float
    heights: Array
    clearance: float
    model: OpenSimModel | None
    scenario: Scenario

    @property
    def filled(self) -> tuple[str, ...]:
        return tuple(c for c, v in self.values.items() if not v.label)

    @property
    def drop(self) -> float:
        """[m] of the fall from rest that gives the pelvis its vertical speed; 0 where it does not fall."""
        return min(self.values["pelvis_ty"].speed, 0.0) ** 2 / (2 * 9.80665)

    @property
    def title(self) -> str:
        return f"{RAN}, from {self.table.path.name} at {self.contact.at:.6g} s, {self.side} foot"

    def settings(self) -> dict[str, str | float]:
        """{"plant.parameter": value with unit}, as a scenario file takes them."""
        out: dict[str, str | float] = {"plant.initial_pose": self.pose}
        for name, (value, unit) in start_parameters(self.values).items():
            turned = unit.replace("rad", "deg")
            out[name] = f"{value if turned == unit else math.degrees(value)!r} {turned}"
        if self.model is not None:
            out |= {
                f"plant.{name}": f"{value!r} kg" if name == "body_mass" else value
                for name, value in self.model.parameters().items()
            }
        return out


def start_parameters(values: Mapping[str, StartValue]) -> dict[str, tuple[float, str]]:
    """{"plant.parameter": (value, its unit)} of the coordinates and their speeds."""
    out = {f"plant.{NAMES.get(c, f'{c}_at_contact')}": (v.value, v.unit) for c, v in values.items()}
    out |= {f"plant.{RATES.get(c, f'{c}_speed_at_contact')}": (v.speed, f"{v.unit}/s") for c, v in values.items()}
    if values["pelvis_ty"].speed == 0.0:
        out["plant.drop_height"] = (0.0, "m")  # a vertical speed of 0 would leave it to the drop
    return out


def motion_start(
    file: Path,
    at: float | None = None,
    side: str = "right",
    pose: str = "touching",
    base: str = "incline30",
    cutoff: float = CUTOFF,
    knee: str | None = None,
    angles: str | None = None,
    turn: float = 0.0,
    model: Path | None = None,
) -> MotionStart:
    """Reads the motion in `file` and takes its state at `at` [s]; None: at first contact.

    - side: the foot that lands, right or left
    - pose: touching, or given: with the pelvis' height as in the file
    - base: scenario that the landing is to change
    - cutoff: [Hz] of the smoothing that gives the speeds
    - knee, angles, turn: see read_course
    - model: the person's .osim

    Raises InputError in one line, SimulationError."""
    table = read_storage(file)
    person = read_osim(model, side) if model is not None else None
    course = read_course(table, side, knee, angles, turn, person.knee if person else None)
    scenario = load_scenario(base)
    plant = next((c for c in scenario.components() if c.name == "plant"), None)
    if not isinstance(plant, Component) or "pelvis_ty_at_contact" not in plant.parameters:
        raise InputError(f"--base {base}: its plant does not take a motion (no parameter pelvis_ty_at_contact)")
    if person is not None:
        scenario = _with_person(scenario, plant, person, model)
    contact, heights = _contact(scenario, course, at, file)
    values = start_values(scenario, course, contact.at, cutoff, file)
    _check_heading(values, file, turn)
    start = MotionStart(table, course, contact, values, side, pose, base, cutoff, heights, 0.0, person, scenario)
    moved = replace(scenario, parameters={**scenario.parameters, **start.settings()}, title=start.title)
    moved.system()  # every value in its range
    clearance = float(sole_heights(moved, [{n: value for n, (value, _) in start_parameters(values).items()}])[0])
    if pose == "given" and clearance < -TOUCH:
        raise InputError(
            f"{file}: at {contact.at:.6g} s the foot is {-1e3 * clearance:z.1f} mm inside the platform of {base}; take "
            "an earlier instant with --at, or let --pose touching find the height"
        )
    return replace(start, clearance=clearance, scenario=moved)


def start_values(scenario: Scenario, course: Course, at: float, cutoff: float, file: Path) -> dict[str, StartValue]:
    """{coordinate: at `at` [s]}. Raises InputError for rows that give no speed, and for gaps."""
    plant = next(c for c in scenario.components() if c.name == "plant")
    return {c: _start(plant, course, c, at, cutoff, file) for c in COORDINATES}


def _with_person(scenario: Scenario, plant: Component, person: OpenSimModel, file: Path | None) -> Scenario:
    for name, value in person.parameters().items():
        if name not in plant.parameters:
            raise InputError(f"--model {file}: this plant has no parameter {name}; leave --model out")
        scenario = scenario.override(f"plant.{name}", f"{value!r} kg" if name == "body_mass" else value)
    return scenario


def _contact(scenario: Scenario, course: Course, at: float | None, file: Path) -> tuple[FirstContact, Array]:
    """When the foot touches, and the heights of the sole that say so."""
    time = course.time
    if at is not None:
        if not time[0] <= at <= time[-1]:
            raise InputError(
                f"{file}: --at {at:g} s lies outside the file, which goes from {time[0]:g} to {time[-1]:g} s"
            )
        k = int(np.argmin(np.abs(time - at)))
        near = math.isclose(time[k], at, rel_tol=0.0, abs_tol=1e-9)
        _check_numbers(course, [k] if near else range(max(k - 2, 0), min(k + 3, len(time))), file)
        how = "as --at says" + ("" if near else ", between two rows: on the cubic spline through them")
        return FirstContact(float(time[k]) if near else at, how), np.empty(0)
    _check_numbers(course, range(len(time)), file)
    rows = [
        {f"plant.{NAMES.get(c, f'{c}_at_contact')}": float(course.values[c][k]) if c in course.values else 0.0
         for c in COORDINATES}
        for k in range(len(time))
    ]  # fmt: skip
    try:
        if abs(sole_heights(scenario, rows[:1])[0]) <= TOUCH:
            how = f"found: in the file's first row the foot touches the platform of {Path(scenario.source).stem}"
            return FirstContact(float(time[0]), how), np.empty(0)
        heights = sole_heights(scenario.override("plant.platform_incline", "0 deg"), rows)
        return first_contact(time, heights), heights
    except InputError as problem:
        raise InputError(f"{file}: {problem}") from None
    except SimulationError as problem:
        raise InputError(f"{file}: a row that the plant refuses ({problem}); say the instant with --at") from None


def _check_numbers(course: Course, rows: Sequence[int], file: Path) -> None:
    """Raises InputError for a cell that is needed and holds no number."""
    for group in (course.values, course.speeds):
        for c, column in group.items():
            for k in rows:
                if not np.isfinite(column[k]):
                    raise InputError(
                        f"{file}: line {course.lines[k]} (time {course.time[k]:g} s): column {course.sources[c]}: no "
                        "number; fill the gap, or cut the file before it"
                    )


def _start(plant: Element, course: Course, c: str, at: float, cutoff: float, file: Path) -> StartValue:
    position = plant.connectors[NAMES.get(c, f"{c}_at_contact")].start
    rate = plant.connectors[RATES.get(c, f"{c}_speed_at_contact")].start
    drop = plant.connectors["drop_height"].start
    assert isinstance(position, float) and isinstance(rate, float) and isinstance(drop, float)
    own = (position, -math.sqrt(2 * 9.80665 * drop) if c == "pelvis_ty" else rate)
    if c not in course.values:
        return StartValue(c, "", 0.0, 0.0, own, None, False)
    time, label = course.time, course.sources[c]
    value = value_at(time, course.values[c], at)
    if c in course.speeds:
        return StartValue(c, label, value, value_at(time, course.speeds[c], at), own, None, True)
    if len(time) < LEAST:
        raise InputError(
            f"{file}: {len(time)} rows give no speed of {label} (a spline needs {LEAST}); add rows, or a column {c}_u "
            "with the speed"
        )
    _check_numbers(course, range(len(time)), file)
    speed = spline_speed(time, course.values[c], at, cutoff)
    return StartValue(c, label, value, speed.value, own, speed, False)


def _check_heading(values: Mapping[str, StartValue], file: Path, turn: float) -> None:
    """Raises InputError for a person who does not look along the plant's forward axis: the slope is beside them."""
    heading = facing({c: v.value for c, v in values.items()})
    if abs(heading) > AHEAD:
        total = math.degrees(turn) - heading
        raise InputError(
            f"{file}: the person faces {abs(heading):.0f} deg to the {'left' if heading > 0 else 'right'} of the "
            f'plant\'s forward axis (+x), which is where the slope is beside the foot: say --turn "{total:z.0f} deg"'
        )
