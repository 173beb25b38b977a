"""A brace from a measured table: a copy of the shipped brace_table FMU with another table in it. Only a zip is written,
nothing compiled.

angle [deg], subtalar_resistance [N.m]                                 one curve: torque against the motion is positive
angle [deg], subtalar_torque_loading [N.m], subtalar_torque_unloading [N.m]     two branches, in the contract's sign

`resistance` is minus `torque`. Rows by rising angle; a cell may be left empty where an axis was not measured. Any unit
of the right dimension. Between the rows the FMU takes the shape-preserving cubic, outside the table it goes straight on
with the end slope (fmus/brace_table/README.md)."""

from __future__ import annotations

import difflib
import hashlib
import io
import math
import re
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from posixpath import dirname

import numpy as np
from scipy.interpolate import PchipInterpolator

from ..contract import PROFILES
from ..errors import InputError, nearest, problems_to_error
from ..files import check_file, read_csv, write
from ..fmu.archive import read
from ..fmu.build import CONSTANTS, EPOCH, constants_file
from ..fmu.reference import MANIFEST
from ..notebook import Card, Rows
from ..shipped import fmu_path
from ..units import Unit, unit

AXES = ("talocrural", "subtalar")
HEADER = re.compile(r"\s*([A-Za-z_]+)\s*\[\s*([^\]]+?)\s*\]\s*")
AGAINST = {  # motions that count negative about an axis
    "eversion": "inversion",
    "plantarflexion": "dorsiflexion",
    "external_rotation": "internal_rotation",
    "pronation": "subtalar",
}
LARGEST_TORQUE = 1e5  # N.m, far beyond what any brace or ankle bears
SMALLEST_ANGLE = 1e-9  # rad, between two rows
CAPACITY = 8192  # points of all curves together, as in fmus/brace_table/device.py
Column = tuple[str, str, str]  # axis; torque or resistance; "", loading or unloading
Curves = Mapping[str, Mapping[str, list[list[float]]]]
Branches = dict[str, tuple[np.ndarray, np.ndarray]]  # angles [rad] and torques [N.m] of "", loading, unloading


def from_csv(table: Path, target: Path, template: Path) -> dict[str, tuple[float, float]]:
    """Writes the FMU `target` from the measured `table` and the FMU `template`; returns the range of angles [rad] of
    each axis.

    Raises InputError naming row and column, EnvironmentProblem where `target` cannot be written."""
    return curves_to_fmu(table, read_curves(table), target, template)


@dataclass(frozen=True, repr=False)
class CurveBrace(Card):
    """A brace made from a measured table.

    fmu    the file
    spans  {axis: the range of angles [rad] that was measured}
    """

    fmu: Path
    spans: Mapping[str, tuple[float, float]]

    def card(self) -> tuple[str, Rows]:
        return self.fmu.name, [(axis, measured_span(*span)) for axis, span in self.spans.items()]


def measured_span(low: float, high: float) -> str:
    """Where the data of a table end, whose angles are in rad."""
    ends = f"{math.degrees(low):.4g} ... {math.degrees(high):.4g} deg"
    return f"{ends}; outside, the torque goes straight on with the end slope"


def brace_from_csv(table: Path | str, out: Path | str | None = None) -> CurveBrace:
    """Makes an FMU of a measured table, whose columns are "angle [deg]" and "subtalar_resistance [N.m]", or others that
    the vendor tutorial shows; `out`: the file, None: the table's name with the ending .fmu. Nothing is compiled. Raises
    InputError naming row and column, EnvironmentProblem where it cannot be written.

    >>> import sprain_cosim as sc
    >>> rows = ["angle [deg], subtalar_resistance [N.m]", "0, 0", "10, 2", "20, 5", "30, 9"]
    >>> with open("cuff.csv", "w") as table:
    ...     print(*rows, sep="\\n", file=table)
    >>> sc.brace_from_csv("cuff.csv")
    CurveBrace(cuff.fmu: subtalar 0 ... 30 deg; outside, the torque goes straight on with the end slope)
    """
    check_file(Path(table))
    target = Path(out) if out is not None else Path(table).with_suffix(".fmu")
    check_file(target, [Path(table)])
    return CurveBrace(target, from_csv(Path(table), target, fmu_path("brace_table", Path.cwd(), "brace_table")))


def curves_to_fmu(table: Path, curves: Curves, target: Path, template: Path) -> dict[str, tuple[float, float]]:
    """The same of curves about AXES as read_curves gives them; `table` is named where they do not fit."""
    files = {}
    with zipfile.ZipFile(read(template).path) as content:
        # but the reference experiment, which is that of the other table
        files = {n: content.read(n) for n in content.namelist() if not n.startswith(f"{dirname(MANIFEST)}/")}
    description = files["modelDescription.xml"].decode()
    old = re.search(r'guid="([^"]*)"', description)
    assert old is not None
    constants = _constants(table, curves)
    guid = hashlib.sha256(old[1].encode() + constants).hexdigest()
    files[CONSTANTS] = constants_file(guid, constants)
    files["modelDescription.xml"] = _with_ranges(description.replace(old[1], guid), curves).encode()
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            entry = zipfile.ZipInfo(name, EPOCH)
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, data, zipfile.ZIP_DEFLATED)
    write(target, buffer.getvalue(), parents=True)
    return {axis: (c["loading"][0][0], c["loading"][-1][0]) for axis, c in curves.items()}


def _with_ranges(description: str, curves: Curves) -> str:
    """The description with the range that was measured declared at the angles (their start value, 0, included), so that
    a landing says when it leaves the data."""
    for axis, branches in curves.items():
        angles = [row[0] for rows in branches.values() for row in rows]
        begin = description.index(f'<ScalarVariable name="{axis}_angle"')
        at = description.index("<Real ", begin) + len("<Real ")
        ends = f'min="{min(*angles, 0.0)!r}" max="{max(*angles, 0.0)!r}" '
        description = description[:at] + ends + description[at:]
    return description


def _constants(path: Path, curves: Curves) -> bytes:
    """The record that fmus/brace_table/device.py describes. Raises InputError for a table that it cannot hold."""
    record = np.zeros((), [("first", "<i8", (2, 2)), ("count", "<i8", (2, 2)), ("point", "<f8", (CAPACITY, 3))])
    points: list[list[float]] = []
    for i, axis in enumerate(AXES):
        for j, rows in enumerate(curves[axis][b] for b in ("loading", "unloading") if axis in curves):
            record["first"][i, j], record["count"][i, j] = len(points), len(rows)
            points += rows
    if len(points) > CAPACITY:
        raise InputError(f"{path}: {len(points)} points on its curves; the FMU holds {CAPACITY}; leave some rows out")
    record["point"][: len(points)] = points
    return record.tobytes()


def read_curves(path: Path, axes: tuple[str, ...] = AXES) -> dict[str, dict[str, list[list[float]]]]:
    """{axis: {loading, unloading: rows of angle [rad], torque [N.m] in the contract's sign, slope [N.m/rad]}} about
    some of `axes`. Raises InputError."""
    lines = list(read_csv(path))
    if len(lines) < 4:
        raise InputError(f"{path}: needs a header and at least three rows")
    columns, angle = _header(path, lines[0][1], axes)
    numbers = _numbers(path, lines[0][1], lines[1:])
    rows = [number for number, _ in lines[1:]]
    problems_to_error(str(path), _falling(numbers[:, 0], rows, SMALLEST_ANGLE / angle.factor)[:5])
    if (largest := angle.factor * float(np.abs(numbers[:, 0]).max())) > math.pi:
        raise InputError(f"{path}: column 1 (angle) reaches {math.degrees(largest):g} deg; is its unit right?")
    problems: list[str] = []
    measured = _measured(columns, angle, numbers, problems)
    for axis, branches in measured.items():
        problems += _passivity(axis, branches, angle, not problems)
    problems_to_error(str(path), problems)
    out = {}
    for axis, branches in measured.items():
        both = (branches[""], branches[""]) if "" in branches else (branches["loading"], branches["unloading"])
        out[axis] = {name: curve_rows(*points) for name, points in zip(("loading", "unloading"), both, strict=True)}
    return out


def _falling(angles: np.ndarray, rows: list[int], least: float) -> list[str]:
    """Problems of an angle that does not rise by `least` from row to row; `rows` are their numbers in the file."""
    return [
        f"row {rows[k]}, column 1 (angle): {angles[k]:g} does not rise (row {rows[k - 1]} has {angles[k - 1]:g})"
        for k in range(1, len(angles))
        if not angles[k] - angles[k - 1] >= least
    ]


def _measured(
    columns: dict[int, tuple[Column, Unit]], angle: Unit, numbers: np.ndarray, problems: list[str]
) -> dict[str, Branches]:
    """By axis, the points of each column in the contract's sign; columns with too few of them are added to
    `problems`."""
    found: dict[str, Branches] = {}
    for place, ((axis, kind, branch), own) in columns.items():
        have = np.isfinite(numbers[:, place])
        if have.sum() < 3:
            name = f"{axis}_{kind}{'_' + branch if branch else ''}"
            problems.append(f"column {name}: fewer than three values")
            continue
        torque = (-1.0 if kind == "resistance" else 1.0) * own.factor * numbers[have, place]
        if not np.abs(torque).max() < LARGEST_TORQUE:
            problems.append(f"column {place + 1}: reaches {np.abs(torque).max():g} N.m; is its unit right?")
            continue
        found.setdefault(axis, {})[branch] = (angle.factor * numbers[have, 0], torque)
    return found


def _passivity(axis: str, branches: Branches, angle: Unit, compare: bool) -> list[str]:
    """Problems of curves that would push the foot; `compare`: the two branches with each other as well."""
    if set(branches) not in ({""}, {"loading", "unloading"}):
        return [f"{axis}: give one column, or both {axis}_..._loading and {axis}_..._unloading"]
    problems = []
    for branch, (at, torque) in branches.items():
        if float(np.sum(at * torque)) > 0:
            name = f"{axis}_torque{'_' + branch if branch else ''}"
            problems.append(
                f"column {name}: pushes the foot further instead of resisting; "
                f"name it {name.replace('torque', 'resistance')} if it is positive against the motion"
            )
    if len(branches) == 2 and compare and not problems:
        between = np.linspace(max(b[0][0] for b in branches.values()), min(b[0][-1] for b in branches.values()), 200)
        loading, unloading = (np.abs(PchipInterpolator(*branches[b])(between)) for b in ("loading", "unloading"))
        worst = int(np.argmax(unloading - loading))
        if unloading[worst] > loading[worst] + 0.02 * max(loading.max(), 1e-9):
            problems.append(
                f"{axis}: unloading resists more than loading at {between[worst] / angle.factor:.3g} {angle.name}: "
                "such a brace would give energy; are the columns swapped?"
            )
    return problems


def curve_rows(x: np.ndarray, torque: np.ndarray) -> list[list[float]]:
    """Rows of angle, torque and slope of the shape-preserving cubic through the points."""
    slopes = PchipInterpolator(x, torque).derivative()(x)
    return [[float(v) for v in row] for row in zip(x, torque, slopes, strict=True)]


def _column_names(axes: tuple[str, ...]) -> dict[str, Column]:
    return {
        f"{a}_{kind}{branch}": (a, kind, branch.removeprefix("_"))
        for a in axes
        for kind in ("torque", "resistance")
        for branch in ("", "_loading", "_unloading")
    }


def _header(path: Path, cells: list[str], axes: tuple[str, ...]) -> tuple[dict[int, tuple[Column, Unit]], Unit]:
    problems: list[str] = []
    known = _column_names(axes)
    columns: dict[int, tuple[Column, Unit]] = {}
    angle = unit("rad")
    for k, cell in enumerate(cells):
        match = HEADER.fullmatch(cell)
        if not match:
            problems.append(
                f"column {k + 1} {cell.strip()!r}: must read name [unit], such as angle [deg] or subtalar_torque [N.m]"
            )
            continue
        name, text = match[1].lower(), match[2]
        expected = unit("rad") if k == 0 else unit("N.m")
        if k == 0 and name != "angle":
            problems.append(f"column 1 {cell.strip()!r}: must be angle [deg] or angle [rad]")
        if k > 0 and name not in known:
            problems.append(f"column {k + 1} {name!r}: is no torque of an axis{_hint(name, axes)}")
            continue
        try:
            own = unit(text)
        except InputError as problem:
            problems.append(f"column {k + 1} {name}: {problem}")
            continue
        if not own.same_dimension(expected):
            problems.append(f"column {k + 1} {name}: {text} is not a unit of {'angle' if k == 0 else 'torque'}")
        elif k == 0:
            angle = own
        elif known[name] in (c for c, _ in columns.values()):
            problems.append(f"column {k + 1} {name}: given twice")
        else:
            columns[k] = (known[name], own)
    if not columns and not problems:
        problems.append("no torque column")
    problems_to_error(str(path), problems)
    return columns, angle


def _numbers(path: Path, header: list[str], lines: list[tuple[int, list[str]]]) -> np.ndarray:
    """(n, columns), NaN for an empty cell; `lines` (n,) of row number in the file and cells."""
    numbers, problems = np.full((len(lines), len(header)), np.nan), []
    for k, (at, row) in enumerate(lines):
        for j, cell in enumerate(row):
            place = f"row {at}, column {j + 1} ({header[j].strip()}): {cell.strip()!r}"
            try:
                numbers[k, j] = float(cell) if cell.strip() or j == 0 else np.nan
            except ValueError:
                problems.append(f"{place} is not a number")
                continue
            if np.isinf(numbers[k, j]) or (cell.strip() and np.isnan(numbers[k, j])):
                problems.append(f"{place} is not finite")
    problems_to_error(str(path), problems[:5])
    return numbers


def _hint(name: str, axes: tuple[str, ...]) -> str:
    """What the column may have been meant to be: never another axis than the one that its name begins with."""
    along = {axis: axis for axis in PROFILES["jcs"]}
    motion = next((m for m in (*along, *AGAINST) if name.startswith(m)), None)
    if motion is not None and (axis := along.get(motion, AGAINST.get(motion))) in along:
        turned = "" if motion in along else f"{motion} is {axis} with angle and torque of the other sign; "
        return (
            f" of such a table: {turned}{axis} is an axis of the joint coordinate system, another rotation than "
            f"{', '.join(axes[:-1])} and {axes[-1]}; measure about one of these, or write the law in a project of "
            "its own (sprain-cosim brace new DIR)"
        )
    if motion is not None:
        return f": {motion} turns against {axis}; turn the signs of angle and torque, and name the column {axis}_torque"
    if name.startswith("supination"):
        return ": supination is the positive direction of subtalar; name the column subtalar_torque"
    close = difflib.get_close_matches(name.partition("_")[0], axes, 1, 0.7)
    names = [n for n in _column_names(axes) if n.startswith(close[0])] if close else []
    return nearest(name, names) if close else f" (known: {', '.join(axes)})"
