"""A study again from its manifest: what of the machine differs, and the first trial that does.

The study is taken from the ledger beside the manifest; without a ledger from study.toml, if that and the manifest's
seed and number of trials give the manifest's study. Trials are compared as trials.csv has them: to the last digit."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import EnvironmentProblem, InputError
from ..processor import ROUNDING, within_rounding
from ..records import Record, optional
from ..shipped import fmu_path
from .file import load_study
from .folder import check_study_folder, read_trials, recorded_plan
from .identity import changes
from .ledger import FILE as LEDGER
from .ledger import Ledger
from .manifest import FILE, FmuFile, Manifest, level_then, read_manifest, software, whole_manifest
from .plan import Plan
from .previous import identity_then, is_previous
from .progress import Progress
from .runner import run
from .summary import read_summary

if TYPE_CHECKING:
    import pandas as pd

ABSENT = FmuFile("absent", "absent")
OF_THE_MACHINE = (
    "version",
    "fmus",
    "maps",
)  # keys of a study's identity that may differ: then it is the same study with other software


@dataclass(frozen=True)
class TrialDifference(Record):
    """A cell of trials.csv that differs: its text before and now; "absent" where the row or the column is missing."""

    trial: int
    column: str
    before: str
    now: str


@dataclass(frozen=True)
class Reproduction(Record):
    """What a repetition found.

    identical    all trials are the same to the last digit
    trials       number that were compared
    different    number of those that differ
    rounding     they differ in the last digits alone, and another level of processors ran the FMUs' code: no fault
    first        the first difference, or None
    differences  between then and now, one line each: versions, FMUs, platform
    out          the new folder
    """

    identical: bool
    trials: int
    different: int
    first: TrialDifference | None
    differences: tuple[str, ...]
    out: str
    rounding: bool | None = optional()

    def text(self) -> str:
        lines = [f"differs: {line}" for line in self.differences] or ["versions, files and platform are the same"]
        if self.first is None:
            lines.append(f"identical: {self.trials} trials, to the last digit")
        else:
            f = self.first
            if self.rounding:
                lines.append(
                    "the same but for the last digits, as code for another level of processors rounds: "
                    f"within {ROUNDING:g} of every value"
                )
            lines.append(
                f"{self.different} of {self.trials} trials differ; the first is trial {f.trial}: {f.column} = "
                f"{f.before} then, {f.now} now"
            )
        return "\n".join([*lines, f"written: {self.out}"])


def reproduce(
    manifest: Path, out: Path | None = None, workers: int | None = None, progress: Progress | None = None
) -> Reproduction:
    """Runs the study of `manifest` again into `out` (default: its folder's name with -again). Raises InputError when
    the manifest, its study or its trials cannot be read, or an FMU is gone."""
    manifest = manifest / FILE if manifest.is_dir() else manifest
    folder = manifest.parent
    then = whole_manifest(manifest)
    before = _table(folder)
    study = _study(folder, then)
    target = out or folder.with_name(f"{folder.resolve().name}-again")
    if target.resolve() == folder.resolve():
        raise InputError(f"{target}: is the study's own folder; name a new one with --out")
    check_study_folder(target, resume=False, resumable=False)
    done = run(
        study,
        out=target,
        rows=_rows(folder, study),
        workers=workers,
        max_failed=1.0,
        progress=progress,
        trajectories=0,
        command=f"sprain-cosim reproduce {manifest}",
        level=level_then(folder),
    )
    assert done.out is not None
    after = _table(done.out)
    first, different = compare_trials(before, after)
    now = Manifest.of(study, study.identity, levels=read_manifest(done.out).processor)
    differences = tuple(differences_of(then, now))
    other_level = bool(then.processor and now.processor) and then.processor != now.processor
    rounding = (first is not None and other_level and _same_but_rounding(before, after)) or None
    return Reproduction(first is None, len(before), different, first, differences, str(done.out), rounding)


def _rows(folder: Path, study: Plan) -> int | None:
    """How many rows were run of what may stop early: the table of a decided comparison, a study that knew enough."""
    try:
        return read_summary(folder).n_requested if study.method == "table" or study.watched else None
    except InputError:
        return None


def _same_but_rounding(before: pd.DataFrame, now: pd.DataFrame) -> bool:
    if not (before.index.equals(now.index) and before.columns.equals(now.columns)):
        return False
    cells = zip(before.to_numpy().ravel(), now.to_numpy().ravel(), strict=True)
    return all(a == b or _numbers_within_rounding(str(a), str(b)) for a, b in cells)


def _numbers_within_rounding(a: str, b: str) -> bool:
    try:
        return within_rounding(float(a), float(b))
    except ValueError:
        return False


def compare_trials(before: pd.DataFrame, now: pd.DataFrame) -> tuple[TrialDifference | None, int]:
    """The first difference and how many trials differ; both tables as text, indexed by trial."""
    found = [_trial_difference(trial, before, now) for trial in before.index.union(now.index, sort=False)]
    differences = [difference for difference in found if difference is not None]
    return (differences[0] if differences else None), len(differences)


def _trial_difference(trial: str, before: pd.DataFrame, now: pd.DataFrame) -> TrialDifference | None:
    there, here = (trial in table.index for table in (before, now))
    if not (there and here):
        words = ("present" if present else "absent" for present in (there, here))
        return TrialDifference(int(trial), "trial", *words)
    for column in dict.fromkeys([*before.columns, *now.columns]):
        a, b = (str(table.at[trial, column]) if column in table else "absent" for table in (before, now))
        if a != b:
            return TrialDifference(int(trial), column, a, b)
    return None


def _table(folder: Path) -> pd.DataFrame:
    try:
        return read_trials(folder, as_text=True).set_index("trial")
    except KeyError:
        raise InputError(f"{folder}: trials.csv cannot be read: it has no column trial") from None


def _study(folder: Path, then: Manifest) -> Plan:
    if (folder / LEDGER).is_file():
        with Ledger.read(folder) as ledger:
            study = recorded_plan(folder, ledger)
        study = replace(
            study, scenario=replace(study.scenario, fmus={n: _there(n, p) for n, p in study.scenario.fmus.items()})
        )
        for name, path in study.scenario.maps.items():
            if not path.is_file():
                raise InputError(
                    f"{folder}: was made with the mapping file {name} = {path}, which is gone; put it back"
                )
    else:
        study = load_study(folder / "study.toml")
        method, seed = (then.identity.get(key, getattr(study, key)) for key in ("method", "seed"))
        if not isinstance(method, str) or not isinstance(seed, int):
            raise InputError(f"{folder / FILE}, identity: method must be a text, seed a whole number")
        study = replace(study, method=method, seed=seed, trials=then.trials or study.trials)
    now = identity_then(study) if is_previous(then.identity) else json.loads(json.dumps(study.identity))
    changed = changes(then.identity, now, OF_THE_MACHINE)
    if changed:
        raise InputError(
            f"{folder}: its study.toml alone does not give the study of the manifest ({'; '.join(changed)}); "
            "put the ledger beside it, or type again: "
            f"{then.command or 'the command it was made with'}"
        )
    return study


def _there(name: str, path: Path) -> Path:
    """The FMU, or the shipped one of its name where the path is another machine's."""
    if path.is_file():
        return path
    try:
        return fmu_path(path.stem, Path.cwd(), name)
    except (InputError, EnvironmentProblem):
        raise InputError(f"{name} = {path}: the FMU of the study is gone; put it back") from None


def differences_of(then: Manifest, now: Manifest) -> list[str]:
    """Software, FMUs, mapping files and processors that differ, a line each."""
    found = software(then, now)
    for name in dict.fromkeys([*then.fmus, *now.fmus]):
        old, new = (m.fmus.get(name, ABSENT) for m in (then, now))
        if old.sha256 != new.sha256:
            found.append(f"FMU {name}: SHA-256 {str(old.sha256)[:12]} then, {str(new.sha256)[:12]} now ({new.file})")
    files_then, files_now = (m.identity.get("maps") or {} for m in (then, now))
    for name in dict.fromkeys([*files_then, *files_now]):
        a, b = (str(files.get(name, "absent"))[:12] for files in (files_then, files_now))
        if a != b:
            found.append(f"mapping file {name}: SHA-256 {a} then, {b} now")
    if then.processor and now.processor and then.processor != now.processor:
        found.append(f"code for {', '.join(then.processor)} processors then, for {', '.join(now.processor)} now")
    return found
