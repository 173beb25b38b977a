"""What a finished study is: its summary, its folder, its tables."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING

from ..notebook import Plottable, Rows
from .arrays import about_study, trials_dataset
from .listing import study_listing
from .plan import Plan
from .summary import StudySummary

if TYPE_CHECKING:
    import pandas as pd
    import xarray

Tables = tuple["pd.DataFrame", "pd.DataFrame"]  # trials, timing


@dataclass(frozen=True, repr=False)
class Campaign(Plottable):
    """A finished study.

    study     what was run
    summary   as in summary.json
    out       its folder, or None
    load      gives both tables, when they are first asked for
    warnings  one line each, about this run of it
    """

    study: Plan
    summary: StudySummary
    out: Path | None
    load: Callable[[], Tables]
    warnings: tuple[str, ...] = ()

    @cached_property
    def _tables(self) -> Tables:
        return self.load()

    @property
    def trials(self) -> pd.DataFrame:
        """One row for each trial, the columns of trials.csv: `trial`, `status`, `message`, inputs such as
        "plant.drop_height [m]", responses with their unit in the name; `attrs["units"]` has the units of both."""
        return self._tables[0]

    @property
    def timing(self) -> pd.DataFrame:
        """One row for each trial: what depends on the machine, the columns of timing.csv; `wall_s` in
        seconds."""
        return self._tables[1]

    def text(self) -> str:
        """The tables that `sprain-cosim study` prints."""
        return study_listing(self.study, self.summary)

    def to_xarray(self, signals: Sequence[str] | str = ()) -> xarray.Dataset:
        """Inputs and responses as an xarray.Dataset over `trial`, each with `units` and `long_name`; `signals` of the
        recorded trials, such as ["plant.subtalar_angle"], over `trial` and `time` [s], NaN where there are none. Raises
        InputError, and EnvironmentProblem where xarray is not installed."""
        return trials_dataset(self.trials, self.out, signals, about_study(self.summary))

    def card(self) -> tuple[str, Rows]:
        heading, rows = self.summary.card()
        return heading, [*rows, ("folder", str(self.out) if self.out else "none")]


def at_hand(tables: Tables) -> Callable[[], Tables]:
    """The `load` of a campaign whose tables are there already; picklable."""
    return partial(_same, tables)


def _same(tables: Tables) -> Tables:
    return tables
