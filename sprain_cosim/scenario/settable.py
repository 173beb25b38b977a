"""What may be set of a scenario: every parameter with its unit, range, default and value."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ..cosim.system import System
from ..errors import InputError
from ..fmu.element import Connector
from ..units import shown_unit

if TYPE_CHECKING:
    import pandas as pd

COLUMNS = ("unit", "minimum", "maximum", "default", "value", "meaning", "choices", "kind", "input")  # of the table


@dataclass(frozen=True)
class Settable:
    """A parameter of a scenario, or an input that nothing feeds.

    name     component.parameter
    input    whether it is an input that nothing feeds, and no parameter
    kind     real, integer, boolean, enumeration or string
    unit     of minimum, maximum and default, as the FMU declares it; "" where it declares none
    minimum  least value; None for no limit
    maximum  greatest value; None for no limit
    choices  names of an enumeration
    default  the FMU's own value; a name for an enumeration, None where it has none
    value    the scenario's, as it was written; None where it leaves the default
    meaning  the FMU's description
    """

    name: str
    input: bool
    kind: str
    unit: str
    minimum: float | None
    maximum: float | None
    choices: tuple[str, ...]
    default: float | str | None
    value: float | str | None
    meaning: str

    @classmethod
    def of(cls, name: str, connector: Connector, value: Any) -> Settable:
        c, default = connector, connector.start
        return cls(
            name,
            c.causality == "input",
            c.kind,
            c.unit.name if c.unit else "",
            c.minimum if math.isfinite(c.minimum) else None,
            c.maximum if math.isfinite(c.maximum) else None,
            tuple(c.items),
            next((n for n, v in c.items.items() if v == default), default),
            value,
            c.description,
        )

    def row(self) -> tuple[str, ...]:
        """Name, unit, range, default, value, meaning for people: angles in degrees."""
        _, shown = shown_unit(self.unit)
        low, high = self._shown(self.minimum), self._shown(self.maximum)
        span = f"{low} ... {high}" if low and high else f"{low} or more" if low else f"{high} or less" if high else ""
        return (
            self.name,
            shown,
            ", ".join(self.choices) or span,
            self._shown(self.default),
            "" if self.value is None else f"{self.value:g}" if isinstance(self.value, float) else str(self.value),
            self.meaning,
        )

    def _shown(self, value: float | str | None) -> str:
        if not isinstance(value, int | float):
            return value or ""
        if self.kind == "boolean":
            return str(bool(value)).lower()
        factor, _ = shown_unit(self.unit)
        return f"{factor * value + 0.0:.6g}"


def settables(system: System, values: Mapping[str, Any]) -> list[Settable]:
    """Every parameter of the components and every input that nothing feeds, and what describes the subject; `values`
    are the scenario's."""
    found = [
        f"{component.name}.{name}"
        for component in system.components
        for several in (component.parameters, component.inputs)
        for name, connector in several.items()
        if connector.kind != "array"  # whose elements stand for it
    ]
    listed = []
    for name in (*found, *system.derived):
        try:
            listed.append(Settable.of(name, system.settable(name), values.get(name)))
        except InputError:  # an input that something feeds
            continue
    return listed


def settable_table(several: list[Settable]) -> pd.DataFrame:
    """One row a name; the columns are fields of Settable."""
    import pandas as pd

    rows = [[getattr(one, column) for column in COLUMNS] for one in several]
    names = pd.Index([one.name for one in several], name="parameter")
    return pd.DataFrame(rows, names, list(COLUMNS), dtype=object)
