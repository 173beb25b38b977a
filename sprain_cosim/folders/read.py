"""The folders that `run`, `study` and `compare` leave, read back. Nothing is simulated and nothing written.

Raises InputError for a folder that is none of them, is not finished, or cannot be read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..cosim.result import Result
from ..errors import InputError
from ..files import read_json, read_toml
from ..study import ledger
from ..study import trajectories as trajectory
from . import run as runfolder

if TYPE_CHECKING:
    import pandas as pd

SAMPLES = ("monte-carlo", "lhs", "sobol", "table")
PUBLISHED_WITH = {"plant.fmu", "reflex_controller.fmu", "brace_bushing.fmu"}


@dataclass(frozen=True)
class _Finished:
    """What a run and a study share: `head` is summary.json."""

    path: Path
    head: Mapping[str, Any]

    @property
    def title(self) -> str:
        return str(self.head["title"])

    @property
    def pose(self) -> str:
        return str(self.head.get("initial_pose") or "")

    @cached_property
    def manifest(self) -> Mapping[str, Any]:
        path = self.path / "manifest.json"
        return read_json(path) if path.is_file() else {}


@dataclass(frozen=True)
class Run(_Finished):
    """One landing: `result` the signals."""

    result: Result


@dataclass(frozen=True)
class StudyFolder(_Finished):
    """Many landings: `trials` the table, `file` the study file as run."""

    trials: pd.DataFrame
    file: Mapping[str, Any] = field(default_factory=dict)

    @property
    def done(self) -> pd.DataFrame:
        return self.trials[self.trials["status"] == "completed"]

    @property
    def search(self) -> Mapping[str, Any] | None:
        """What the advanced mean value method or FORM found, or None for a sample."""
        found: Mapping[str, Any] | None = self.head.get("amv") or self.head.get("form")
        return found

    @property
    def is_sample(self) -> bool:
        """Whether its trials are drawn from the marginals, so that shares of them are probabilities."""
        return self.head["method"] in SAMPLES

    @property
    def response(self) -> str:
        """The response asked for first."""
        asked = self.file.get("study", {}).get("responses") or [(self.search or {}).get("response")]
        return str(asked[0] or "peak_subtalar_angle_deg")

    @property
    def published(self) -> Mapping[str, Any]:
        """Published figures of the study file; none when the study ran with another pose, device or parameter than the
        file asks for."""
        asked = self.file.get("parameters", {})
        ran = self.manifest.get("identity", {}).get("parameters", asked)
        same = asked.get("plant.initial_pose", self.pose) == self.pose and all(
            ran.get(k) == v for k, v in asked.items()
        )
        varied = {str(c).partition(" [")[0] for c in self.trials.columns if "." in str(c)}
        devices = {Path(str(fmu.get("file"))).name for fmu in self.manifest.get("fmus", {}).values()}
        same = (
            same
            and varied == set(self.file.get("marginals", {}))
            and devices <= PUBLISHED_WITH
            and not self.head.get("dropped")
        )
        return self.file.get("published", {}) if same else {}

    @cached_property
    def trajectories(self) -> Mapping[int, Path]:
        """{trial: file} of the signals kept."""
        found = {}
        for path in sorted((self.path / trajectory.FOLDER).glob("*.csv.gz")):
            number = path.name.removesuffix(".csv.gz")
            if number.isdigit():
                found[int(number)] = path
        return found

    def trajectory(self, trial: int) -> Result:
        return Result.read_csv(self.trajectories[trial])


@dataclass(frozen=True)
class Comparison:
    """Several braces on the same landings: `data` is compare.json, `members` {brace: its folder}."""

    path: Path
    data: Mapping[str, Any]
    members: Mapping[str, Run | StudyFolder]


Folder = Run | StudyFolder | Comparison


def read(path: Path) -> Folder:
    """What `path` holds."""
    if not path.is_dir():
        raise InputError(f"{path}: {'is a file; name a folder' if path.exists() else 'no such folder'}")
    if (path / "compare.json").is_file():
        data = read_json(path / "compare.json")
        named = data.get("braces")
        names = [str(n) for n in named] if isinstance(named, dict) else []
        members = {name: read(path / name) for name in names if (path / name / "summary.json").is_file()}
        if not members:
            raise InputError(
                f"{path}: compare.json names braces, but none of their folders is here; run `sprain-cosim compare` "
                "again"
            )
        return Comparison(path, data, {name: m for name, m in members.items() if not isinstance(m, Comparison)})
    if (path / "trials.csv").is_file() and (path / "summary.json").is_file():
        return _study(path)
    if (path / ledger.FILE).is_file():
        raise InputError(f"{path}: the study is not finished; continue it with --resume")
    if (path / "signals.csv").is_file() or (path / "summary.json").is_file():
        head, result = runfolder.read(path)
        return Run(path, head, result)
    raise InputError(
        f"{path}: holds no run, study or comparison; make one with `sprain-cosim run SCENARIO --out {path}`"
    )


def read_all(paths: Sequence[Path]) -> list[Folder]:
    """Each folder once."""
    return [read(path) for path in dict.fromkeys(paths)]


def _study(path: Path) -> StudyFolder:
    import pandas as pd

    head = read_json(path / "summary.json")
    try:
        trials = pd.read_csv(path / "trials.csv", keep_default_na=True)
    except (ValueError, OSError) as problem:
        raise InputError(f"{path}: cannot be read: {problem}") from None
    file = read_toml(path / "study.toml") if (path / "study.toml").is_file() else {}
    missing = [key for key in ("title", "method", "n_requested", "n_completed", "n_failed") if key not in head]
    missing += [column for column in ("trial", "status") if column not in trials]
    if missing:
        raise InputError(f"{path}: not a folder of `sprain-cosim study`: {missing[0]} is missing")
    return StudyFolder(path, head, trials, file)
