"""The folder that `study` leaves, read back: the summary, the table of trials, the study file, the manifest, the
signals that were kept."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from ..cosim.result import Result
from ..errors import InputError
from ..files import read_toml
from ..notebook import Plottable, Rows
from ..study.arrays import about_study, trials_dataset
from ..study.folder import read_trials
from ..study.manifest import FILE as MANIFEST
from ..study.manifest import Manifest, read_manifest
from ..study.summary import StudySummary, read_summary
from ..study.trajectories import read_trajectory, trajectory_paths

if TYPE_CHECKING:
    import pandas as pd
    import xarray

SAMPLES = ("monte-carlo", "lhs", "sobol", "table")  # methods that draw their trials from the marginals
PUBLISHED_WITH = {"plant.fmu", "reflex_controller.fmu", "brace_bushing.fmu"}
PEAK = "peak_subtalar_angle_deg"  # the response that the published figures are of


@dataclass(frozen=True)
class StudyFile:
    """The tables of a study file, as they are written.

    scenario    name or file
    parameters  {"component.parameter": value}
    marginals   {"component.parameter": {kind: its values}}
    grid        {"component.parameter": levels}
    published   figures to stand beside the results
    responses   metrics, the first of them first
    """

    scenario: str = ""
    parameters: Mapping[str, Any] = field(default_factory=dict)
    marginals: Mapping[str, Any] = field(default_factory=dict)
    grid: Mapping[str, Any] = field(default_factory=dict)
    published: Mapping[str, Any] = field(default_factory=dict)
    responses: tuple[str, ...] = ()

    @classmethod
    def read(cls, path: Path) -> Self:
        """An empty one where there is no such file. Raises InputError."""
        content = read_toml(path) if path.is_file() else {}
        held = {key: content.get(key) for key in ("parameters", "marginals", "grid", "published", "study")}
        tables = {key: table if isinstance(table, dict) else {} for key, table in held.items()}
        listed = tables.pop("study").get("responses")
        responses = tuple(str(r) for r in listed) if isinstance(listed, list) else ()
        return cls(str(content.get("scenario", "")), **tables, responses=responses)


@dataclass(frozen=True, repr=False)
class StudyFolder(Plottable):
    """Many landings.

    path     the folder
    summary  its summary.json
    trials   its trials.csv, one row a trial
    file     its study.toml
    """

    path: Path
    summary: StudySummary
    trials: pd.DataFrame
    file: StudyFile = field(default_factory=StudyFile)

    @property
    def title(self) -> str:
        return self.summary.title

    def card(self) -> tuple[str, Rows]:
        heading, rows = self.summary.card()
        return heading, [*rows, ("folder", str(self.path))]

    def to_xarray(self, signals: Sequence[str] | str = ()) -> xarray.Dataset:
        """See `Campaign.to_xarray`."""
        return trials_dataset(self.trials, self.path, signals, about_study(self.summary))

    @property
    def pose(self) -> str:
        """The initial pose; empty for a plant that has none."""
        return self.summary.initial_pose or ""

    @cached_property
    def manifest(self) -> Manifest:
        return read_manifest(self.path)

    @cached_property
    def done(self) -> pd.DataFrame:
        """The completed trials."""
        return self.trials[self.trials["status"] == "completed"]

    @property
    def is_sample(self) -> bool:
        """Whether its trials are drawn from the marginals, so that shares of them are probabilities."""
        return self.summary.method in SAMPLES

    @property
    def response(self) -> str:
        """The response of a design question, else the one that the study file names first."""
        if self.summary.design is not None:
            return self.summary.design.response
        if self.file.responses:
            return self.file.responses[0]
        return self.summary.search.response if self.summary.search else PEAK

    @property
    def varied(self) -> frozenset[str]:
        """The names of the inputs among the columns of trials.csv."""
        return frozenset(str(c).partition(" [")[0] for c in self.trials.columns if "." in str(c))

    @property
    def ran_with(self) -> Mapping[str, Any]:
        """{"component.parameter": value} of the scenario as it ran; empty where the manifest does not say. Raises
        InputError."""
        found = self.manifest.identity.get("parameters") or {}
        if not isinstance(found, Mapping):
            raise InputError(f"{self.path / MANIFEST}, identity, parameters: must be an object")
        return found

    @cached_property
    def published(self) -> Mapping[str, Any]:
        """Published figures of the study file; none when the study ran with another pose, device or parameter than the
        file names."""
        named = self.file.parameters
        ran = self.ran_with or named
        devices = {Path(fmu.file).name for fmu in self.manifest.fmus.values()}
        same = (
            named.get("plant.initial_pose", self.pose) == self.pose
            and all(ran.get(k) == v for k, v in named.items())
            and self.varied == set(self.file.marginals)
            and not self._held
            and devices <= PUBLISHED_WITH
            and not self.summary.dropped
        )
        return self.file.published if same else {}

    @property
    def _held(self) -> bool:
        """Whether an input with a marginal had one value in all landings: the rows of another study, or of a comparison
        that sets it."""
        inputs = self.trials[[c for c in self.trials.columns if "." in str(c)]]
        return len(inputs) > 1 and bool((inputs.nunique() == 1).any())

    @property
    def published_peak(self) -> Mapping[str, Any]:
        """Those of the peak supination, where the study is about it."""
        return self.published if self.response == PEAK else {}

    @cached_property
    def trajectories(self) -> Mapping[int, Path]:
        """{trial: file} of the signals that were kept."""
        return trajectory_paths(self.path)

    def trajectory(self, trial: int) -> Result:
        """Signals of a trial that were kept. Raises InputError."""
        return read_trajectory(self.trajectories[trial])


def read_study(path: Path) -> StudyFolder:
    """Raises InputError for a folder that is none of a finished study, or of a later version."""
    summary, trials = read_summary(path), read_trials(path)
    for column in ("trial", "status"):
        if column not in trials:
            raise InputError(f"{path}: not a folder of `sprain-cosim study`: {column} is missing")
    return StudyFolder(path, summary, trials, StudyFile.read(path / "study.toml"))
