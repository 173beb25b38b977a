"""The inputs of a study's trials: which parameters can vary, and a table of their values that a user brings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..cosim.system import System
from ..errors import InputError, nearest, problems_to_error
from ..fmu.element import Connector
from ..units import Unit
from ..uq.distributions import Array

if TYPE_CHECKING:
    import pandas as pd

OPTIONAL = ("plant", "controller", "brace")  # a column of one that the scenario lacks is dropped, with a warning
OUTCOMES = ("status", "message")  # columns of trials.csv that are no inputs
ENOUGH = 5  # problems of one column, after which the rest of its rows is not read


@dataclass(frozen=True)
class Table:
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


def parameter(system: System, name: str) -> Connector:
    """The parameter that can vary under this name. Raises InputError where there is none."""
    connector = system.find(name)
    if connector.causality != "parameter":
        raise InputError(f"{name}: is an {connector.causality}, not a parameter")
    if connector.kind != "real":
        raise InputError(
            f"{name}: only real parameters can vary, not "
            f"{'an enumeration' if connector.items else f'a {connector.kind}'}"
        )
    return connector


def unit_name(unit: Unit | None) -> str:
    """The unit as a column's heading shows it: empty for a quantity without dimension."""
    return "" if unit is None or unit.dimensionless else unit.name


def read_table(path: Path, system: System, varied: Sequence[str]) -> Table:
    """A CSV file with header `component.parameter [unit]`, one row a trial, an optional column `trial` numbering them.
    `varied` are the study's own names, for the hint at a column that is none.

    Raises InputError naming row and column."""
    cells = _cells(path)
    components = {c.name for c in system.components}
    reader = _Reader(path, system, components, varied)
    if cells.empty:
        reader.problems.append("has no rows")
    for heading in cells.columns:
        reader.column(str(heading), list(cells[heading]))
    numbers = reader.numbers or tuple(range(len(cells)))
    if len(set(numbers)) != len(numbers) or any(n < 0 for n in numbers):
        reader.problems.append("column trial: numbers must be different and not negative")
    problems_to_error(str(path), reader.problems)
    return Table(reader.columns, reader.units, numbers, tuple(reader.warnings))


def _cells(path: Path) -> pd.DataFrame:
    import pandas as pd

    try:
        return pd.read_csv(path, dtype=str, keep_default_na=False)
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except (ValueError, OSError) as problem:
        raise InputError(f"{path}: cannot be read as a table: {' '.join(str(problem).split())}") from None


@dataclass
class _Reader:
    """Takes one column after the other; `problems` and `warnings` grow."""

    path: Path
    system: System
    components: set[str]
    varied: Sequence[str]
    columns: dict[str, Array] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    numbers: tuple[int, ...] = ()
    problems: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)

    def column(self, heading: str, texts: Sequence[str]) -> None:
        name, _, rest = heading.partition(" [")
        component = name.partition(".")[0]
        if name == "trial":
            self._numbers(heading, texts)
        elif component in self.components:
            self._values(name, heading, rest.rstrip("] "), texts)
        elif component in OPTIONAL:
            self.warnings.append(f"{self.path}: column {heading} is dropped: the scenario has no {component}")
        elif name not in OUTCOMES:
            self.problems.append(f"column {heading!r}: expected component.parameter [unit]{nearest(name, self.varied)}")

    def _numbers(self, heading: str, texts: Sequence[str]) -> None:
        numbers = []
        for row, text in enumerate(texts, 2):
            try:
                numbers.append(int(text))
            except ValueError:
                self.problems.append(f"row {row}: {heading} = {text!r}: not a whole number")
            if len(self.problems) > ENOUGH:
                break
        self.numbers = tuple(numbers)

    def _values(self, name: str, heading: str, unit: str, texts: Sequence[str]) -> None:
        try:
            connector = parameter(self.system, name)
        except InputError as problem:
            self.problems.append(f"column {heading}: {problem}")
            return
        values = []
        for row, text in enumerate(texts, 2):
            try:
                values.append(connector.value(f"{text.strip()} {unit}".strip(), heading))
            except InputError as problem:
                self.problems.append(f"row {row}: {problem}")
            if len(self.problems) > ENOUGH:
                break
        self.columns[name], self.units[name] = np.array(values), unit_name(connector.unit)
