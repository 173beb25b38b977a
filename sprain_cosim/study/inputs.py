"""The inputs of a study's trials: which parameters can vary, and a table of their values that a user brings."""

from __future__ import annotations

import math
import re
from array import array
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ..cosim.system import System
from ..errors import InputError, nearest, problems_to_error
from ..files import read_csv
from ..fmu.element import Connector
from ..scenario.body import OWNER, SEX, is_of_subject, plant_values, with_measures
from ..subject.anthropometry import SEXES, USUAL, Anthropometry, anthropometry
from ..subject.person import Subject
from ..units import Unit
from ..uq.distributions import Array

HEADING = re.compile(r"([^\[\]]*?)\s*\[\s*([^\]]*?)\s*\]")
DECIMAL_COMMA = re.compile(r"[-+]?\d*,\d+([eE][-+]?\d+)?")
OPTIONAL = ("plant", "controller", "brace")  # a column of one that the scenario lacks is dropped, with a warning
OUTCOMES = ("status", "message")  # columns of trials.csv that are no inputs
ENOUGH = 5  # problems after which the rest of the rows is not read
OUTSIDE = 4.0 * USUAL[0]  # of all persons, by one measure: below or above, alone or beside the others


@dataclass(frozen=True)
class InputTable:
    """Rows of inputs.

    columns   {"component.parameter": (n,) values in the parameter's own unit}
    units     {the same names: that unit, "" where the parameter has no dimension}
    numbers   (n,) trial numbers
    warnings  one line for each column that is not used
    """

    columns: Mapping[str, Array]
    units: Mapping[str, str]
    numbers: tuple[int, ...]
    warnings: tuple[str, ...] = ()


def parameter(system: System, name: str, by_choice: bool = False) -> Connector:
    """The parameter that can vary under this name, `by_choice` among single values. Raises InputError where there is
    none."""
    if is_of_subject(name) and not system.derived:
        raise InputError(f"{name}: nobody is described; name a person with --subject or in [subject] of the scenario")
    connector = system.find(name)
    if connector.causality != "parameter":
        raise InputError(f"{name}: is an {connector.causality}, not a parameter")
    if connector.kind != "real" and not (by_choice and connector.scalar_number):
        raise InputError(
            f"{name}: only real parameters can vary, not "
            f"{'an enumeration' if connector.items else f'a {connector.kind}'}"
            f"{' (but among choices = [...] of a study file)' if connector.scalar_number else ''}"
        )
    return connector


def unit_name(unit: Unit | None) -> str:
    """The unit as a column's heading shows it: empty for a quantity without dimension."""
    return "" if unit is None or unit.dimensionless else unit.name


def read_table(path: Path, system: System, varied: Sequence[str]) -> InputTable:
    """A CSV file with header `component.parameter [unit]`, one row a trial, an optional column `trial` numbering them.
    `varied` are the study's own names, for the hint at a column that is none.

    Raises InputError naming row and column; rows are counted as the file's lines."""
    lines = read_csv(path)
    _, header = next(lines)
    columns = _Columns(path, system, varied)
    readers = [columns.reader(k, heading) for k, heading in enumerate(header)]
    count = 0
    for at, cells in lines:
        count += 1
        for read, cell in zip(readers, cells, strict=True):
            try:
                read(cell)
            except InputError as problem:
                columns.problems.append(f"row {at}: {problem}")
        if len(columns.problems) > ENOUGH:
            break
    if not count:
        columns.problems.append("has no rows")
    numbers = tuple(columns.numbers) if columns.numbered else tuple(range(count))
    if len(set(numbers)) != len(numbers) or any(n < 0 for n in numbers):
        columns.problems.append("column trial: numbers must be different and not negative")
    problems_to_error(str(path), columns.problems)
    values = {name: np.array(column) for name, column in columns.values.items()}
    return InputTable(values, columns.units, numbers, tuple(columns.warnings))


def persons_problems(rows: InputTable, subject: Subject, system: System) -> list[str]:
    """The rows whose measures make no person of the plant, a line each, the first few."""
    measured = {name: values for name, values in rows.columns.items() if is_of_subject(name)}
    found = list[str]()
    for k, number in enumerate(rows.numbers if measured else ()):
        try:
            plant_values(with_measures(subject, {name: float(v[k]) for name, v in measured.items()}), system)
        except InputError as problem:
            found.append(f"trial {number}: {problem}")
            if len(found) > ENOUGH:
                break
    return found


def unusual_persons(rows: InputTable, subject: Subject) -> list[str]:
    """A line where more rows than chance explains hold persons with unusual measures; none where nobody varies."""
    columns = {name.removeprefix(OWNER): values for name, values in rows.columns.items() if is_of_subject(name)}
    if not columns:
        return []
    n = len(rows.numbers)
    sexes = columns.pop(SEX.removeprefix(OWNER), np.full(n, float(SEXES.index(subject.sex))))
    given = {name: np.full(n, value) for name, value in subject.measures.items()} | columns
    found: dict[int, Anthropometry] = {}
    for number, sex in enumerate(SEXES):
        at = np.flatnonzero(sexes == number)
        law = anthropometry(sex)
        if given and len(at):
            found |= dict.fromkeys(at[law.unusual_rows({name: v[at] for name, v in given.items()})].tolist(), law)
    expected = n * len(given) * OUTSIDE
    if len(found) <= expected + 3.0 * math.sqrt(expected):
        return []
    first = min(found)
    why = found[first].unusual({name: float(values[first]) for name, values in given.items()})
    return [
        f"{len(found)} of {n} persons have measures outside what is usual; trial {rows.numbers[first]}: {why[0]}; "
        "factors follow the measures all the same, and the estimates extrapolate"
    ]


@dataclass
class _Columns:
    """What each column of a table is; `problems` and `warnings` grow, and the values while the rows are read."""

    path: Path
    system: System
    varied: Sequence[str]
    values: dict[str, array[float]] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    numbers: list[int] = field(default_factory=list)
    numbered: bool = False
    problems: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)

    def reader(self, place: int, heading: str) -> Callable[[str], None]:
        """What takes a cell of the column. Raises InputError for a cell that does not fit."""
        name, unit = heading_of(heading)
        component = name.partition(".")[0]
        if name == "trial":
            self.numbered = True
            return self._number
        if component in {c.name for c in self.system.components} or is_of_subject(name):
            return self._value(place, name, heading, unit)
        if component in OPTIONAL and "." in name:
            self.warnings.append(f"{self.path}: column {heading} is dropped: the scenario has no {component}")
        elif name not in OUTCOMES:
            self.problems.append(
                f"column {place + 1} {heading!r}: expected component.parameter [unit]{nearest(name, self.varied)}"
            )
        return _pass_over

    def _number(self, text: str) -> None:
        if not text.removeprefix("-").isdecimal() or len(text) > 18:
            raise InputError(f"trial = {text!r}: not a whole number")
        self.numbers.append(int(text))

    def _value(self, place: int, name: str, heading: str, unit: str) -> Callable[[str], None]:
        try:
            connector = parameter(self.system, name)
        except InputError as problem:
            self.problems.append(f"column {place + 1} {heading}: {problem}")
            return _pass_over
        if name in self.values:
            self.problems.append(f"column {place + 1} {heading}: {name} is given twice")
            return _pass_over
        column = self.values.setdefault(name, array("d"))
        self.units[name] = unit_name(connector.unit)

        def read(text: str) -> None:
            if not text:
                raise InputError(f"{heading}: the cell is empty")
            if DECIMAL_COMMA.fullmatch(text):
                raise InputError(f"{heading} = {text!r}: has a decimal comma; write a point")
            column.append(connector.value(f"{text} {unit}".strip(), heading))

        return read


def heading_of(heading: str) -> tuple[str, str]:
    """Name and unit of a heading, with or without a blank between them."""
    match = HEADING.fullmatch(heading)
    return (match[1], match[2]) if match else (heading, "")


def _pass_over(_: str) -> None:
    """A column that is not read."""
