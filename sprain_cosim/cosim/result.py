"""What a run leaves behind, and how it ended."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import IO, TYPE_CHECKING

import numpy as np

from ..dataset import Variable, dataset, in_words
from ..errors import InputError, nearest, visible
from ..files import LARGEST_RECORD, read_frame
from ..fmu.messages import Messages
from ..metrics import metrics
from ..notebook import Plottable, Rows, coupling_share, with_doubt
from ..units import Unit

if TYPE_CHECKING:
    import pandas as pd
    import xarray

PEAK = "peak_subtalar_angle_deg"
CONVERGED = 0.1  # deg
UNCONVERGED = "coupling not converged"  # begins what is said of such a landing
HALVED_WITHIN = 2.0  # s: a run that took longer is not made again at half its step without being asked for


def step_doubt(change: float) -> float:
    """How far [deg] the communication step leaves the peak of the foot from that of a fine exchange: twice its change
    [deg] at half the step, since the error of a coupling is of the first order in the step or better."""
    return 2.0 * abs(change)


def unconverged(change: float, step: float) -> str:
    """What is to be said where half of the communication step [s] changes the peak so; empty where that is little."""
    if step_doubt(change) <= CONVERGED:
        return ""
    return (
        f"{UNCONVERGED} at {1e3 * step:g} ms: half the step changes the peak of the foot by {change:+.2g} deg, so that "
        f"it is uncertain by about {step_doubt(change):.2g} deg; "
        f'--step "{250.0 * step:g} ms" leaves about a quarter of that'
    )


@dataclass(frozen=True)
class Held:
    """How old the torques of a sampled device become between two of its calls.

    period          [s] of its calls
    largest_change  [N.m] of a torque from one call to the next
    share           of that torque's largest magnitude
    axis            of that torque
    """

    period: float
    largest_change: float
    share: float
    axis: str


@dataclass(frozen=True, repr=False)
class Result(Plottable):
    """One run.

    time             (n,) [s]
    values           (n, m), one column for each of `names` in its unit
    names            "component.variable"
    units            of the columns; None is an undeclared unit
    status           completed, stopped (an FMU asked to end the run) or failed; the latter two have the record until
                     then and a message, but no metrics
    message          why it did not complete; empty where it did
    scheme           the coupling scheme that ran
    scheme_reason    why it was taken
    warning          of the stability guard; empty for none
    parameters       those that were set, in their own units
    coupling_error   the residual energy as a share of the exchanged energy; None where nothing was exchanged, or the
                     run was not judged
    halved           {metric: its change} when the run was made again at half the communication step; None: it was not
    estimates_doubt  standard deviation [deg] of the peak of the foot over the persons who share what is known of the
                     one who lands, to first order; None: all was measured, or it was not looked at
    held             {component: Held} of devices whose torques are held between their calls
    messages         {component: what its FMU said}, of those that said anything
    wall             wall time [s]
    exchanges        steps of the coupling taken
    smallest_step    of those [s]; shorter than the communication step under an adaptive step, and where a component
                     with a rate of its own is due between two communication points

    >>> import sprain_cosim as sc
    >>> result = sc.load_scenario("incline30_brace").run(halve=True)  # with the doubt of its step
    >>> round(result.metrics["peak_subtalar_angle_deg"], 1), result.coupling_doubt < 0.1
    (29.8, True)
    >>> float(result.labelled_signals["plant.subtalar_angle [rad]"].idxmax())  # s
    0.093
    >>> result.to_xarray()["plant.subtalar_angle"].attrs["units"]
    'rad'
    """

    time: np.ndarray
    values: np.ndarray
    names: tuple[str, ...]
    units: tuple[Unit | None, ...]
    status: str
    message: str
    scheme: str
    scheme_reason: str = ""
    warning: str = ""
    parameters: dict[str, float] = field(default_factory=dict)
    coupling_error: float | None = None
    halved: dict[str, float] | None = None
    estimates_doubt: float | None = None
    held: dict[str, Held] = field(default_factory=dict)
    messages: dict[str, Messages] = field(default_factory=dict)
    wall: float = 0.0
    exchanges: int = 0
    smallest_step: float = 0.0

    @cached_property
    def signals(self) -> pd.DataFrame:
        """(n, m) table over the index `time [s]`, columns "component.variable"; `attrs["units"]` has their units."""
        import pandas as pd

        table = pd.DataFrame(self.values, pd.Index(self.time, name="time [s]"), list(self.names))
        table.attrs["units"] = {n: u.name if u else "?" for n, u in zip(self.names, self.units, strict=True)}
        return table

    @property
    def headings(self) -> list[str]:
        """ "component.variable [unit]" of the columns; "?" for a unit that is not declared."""
        return [f"{n} [{u.name if u else '?'}]" for n, u in zip(self.names, self.units, strict=True)]

    @property
    def labelled_signals(self) -> pd.DataFrame:
        """The signals with their units in the names of the columns, as signals.csv has them."""
        return self.signals.set_axis(self.headings, axis=1)

    def to_xarray(self) -> xarray.Dataset:
        """The signals as an xarray.Dataset over `time` [s], each with `units` and `long_name`; its attributes say how
        the run ended and what is known of its doubt. Raises EnvironmentProblem where xarray is not installed."""
        units = [u.name if u else "?" for u in self.units]
        several = zip(self.names, self.values.T, units, strict=True)
        about = {
            "status": self.status,
            "message": self.message,
            "scheme": self.scheme,
            "coupling_error": self.coupling_error,
            "coupling_doubt_deg": self.coupling_doubt,
        }
        return dataset(
            [Variable(name, ("time",), column, unit, in_words(name)) for name, column, unit in several],
            [Variable("time", ("time",), self.time, "s", "time after contact")],
            about,
        )

    def _ipython_key_completions_(self) -> list[str]:
        return list(self.names)

    def csv(self) -> str:
        """The record as signals.csv has it: `time [s]`, then `component.variable [unit]`, ten digits; of the first
        row, from which another landing can start, the 17 that give every number back to the bit."""
        headings = ["time [s]", *self.headings]
        head = io.StringIO()
        csv.writer(head, lineterminator="\n").writerow(map(visible, headings))  # names may hold commas
        values = np.column_stack([self.time, self.values])
        first, line = (",".join([digits] * len(headings)) + "\n" for digits in ("%.17g", "%.10g"))
        # one format for all rows: 30 times as fast as pandas
        text = (first * len(values[:1]) + line * len(values[1:])) % tuple(values.ravel().tolist())
        return head.getvalue() + (text if np.isfinite(values).all() else text.replace("nan", ""))

    @classmethod
    def read_csv(cls, source: Path | IO[bytes]) -> Result:
        """The record of a signals.csv, also gzipped as a study keeps it. Raises InputError when it is none."""
        try:
            table = read_frame(source, LARGEST_RECORD, index_col=0)
            names, units = zip(*(str(c).removesuffix("]").rsplit(" [", 1) for c in table.columns), strict=True)
            time, values = table.index.to_numpy(float), table.to_numpy(float)
        except FileNotFoundError:
            raise InputError(f"{source}: no such file; make the run again with --out") from None
        except ValueError as problem:
            raise InputError(f"{source}: cannot be read: {str(problem)[:200]}") from None
        if not len(time) or not np.isfinite(time).all() or np.isinf(values).any():
            raise InputError(
                f"{source}: cannot be read: {'holds a number that is not finite' if len(time) else 'no rows'}"
            )
        known = tuple(None if u == "?" else Unit(u) for u in units)
        return cls(time=time, values=values, names=names, units=known, status="completed", message="", scheme="")

    @cached_property
    def index(self) -> dict[str, int]:
        return {name: k for k, name in enumerate(self.names)}

    def __getitem__(self, name: str) -> np.ndarray:
        """(n,) values of one signal. Raises InputError for one that there is not."""
        try:
            return self.values[:, self.index[name]]
        except KeyError:
            raise InputError(f"{name}: no such signal{nearest(name, self.names)}") from None

    @property
    def coupling_doubt(self) -> float | None:
        """See `step_doubt`; None where no run at half the step was made."""
        change = (self.halved or {}).get(PEAK)
        return None if change is None else step_doubt(change)

    @property
    def converged(self) -> bool | None:
        """Whether that is no more than CONVERGED; None where it is not known."""
        doubt = self.coupling_doubt
        return None if doubt is None else doubt <= CONVERGED

    @cached_property
    def metrics(self) -> dict[str, float]:
        """Named responses; empty unless the run completed."""
        return metrics(self) if self.status == "completed" else {}

    def card(self) -> tuple[str, Rows]:
        peak = self.metrics.get(PEAK)
        rows = [] if peak is None else [("peak supination", with_doubt(peak, self.coupling_doubt, "deg"))]
        rows += [("coupling error", coupling_share(self.coupling_error)), ("scheme", self.scheme or "not known")]
        rows += [("warning", self.warning)] if self.warning else []
        rows += [("why", self.message)] if self.message else []
        until = f", until {1e3 * float(self.time[-1]):.4g} ms" if len(self.time) else ""
        rows.append(("record", f"{len(self.time)} times{until}, {len(self.names)} signals"))
        return self.status, rows
