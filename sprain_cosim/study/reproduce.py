"""A study again from its manifest: what of the machine differs, and the first trial that does.

The study is taken from the ledger beside the manifest; without a ledger from study.toml, if that and the manifest's
seed and number of trials give the manifest's study. Trials are compared as trials.csv has them: to the last digit."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import EnvironmentProblem, InputError
from ..files import read_json
from ..shipped import fmu_path
from . import folder as studyfolder
from .dispatch import Progress
from .file import load_study
from .identity import changes
from .ledger import FILE, Ledger
from .plan import Plan
from .runner import run

if TYPE_CHECKING:
    import pandas as pd

OF_THE_MACHINE = (
    "version",
    "fmus",
    "maps",
)  # keys of a study's identity that may differ: then it is the same study with other software


@dataclass(frozen=True)
class Reproduction:
    """`differences` between then and now: versions, FMUs, platform; `trials` compared; `first` {trial, column, before,
    now} that differs, or None; `different` how many do; `out` the new folder."""

    differences: tuple[str, ...]
    trials: int
    first: Mapping[str, Any] | None
    different: int
    out: Path

    @property
    def identical(self) -> bool:
        return self.first is None

    def as_dict(self) -> dict[str, Any]:
        return {
            "identical": self.identical,
            "trials": self.trials,
            "different": self.different,
            "first": self.first,
            "differences": list(self.differences),
            "out": str(self.out),
        }

    def text(self) -> str:
        lines = [f"differs: {line}" for line in self.differences] or ["versions, FMUs and platform are the same"]
        if self.first is None:
            lines.append(f"identical: {self.trials} trials, to the last digit")
        else:
            f = self.first
            lines.append(
                f"{self.different} of {self.trials} trials differ; the first is trial {f['trial']}: {f['column']} = "
                f"{f['before']} then, {f['now']} now"
            )
        return "\n".join([*lines, f"written: {self.out}"])


def reproduce(
    manifest: Path, out: Path | None = None, workers: int | None = None, progress: Progress | None = None
) -> Reproduction:
    """Runs the study of `manifest` again into `out` (default: its folder's name with -again). Raises InputError when
    the manifest, its study or its trials cannot be read, or an FMU is gone."""
    manifest = manifest / "manifest.json" if manifest.is_dir() else manifest
    folder = manifest.parent
    then = _read(manifest)
    before = _table(folder)
    study = _study(folder, then)
    target = out or folder.with_name(f"{folder.resolve().name}-again")
    if target.resolve() == folder.resolve():
        raise InputError(f"{target}: is the study's own folder; name a new one with --out")
    now = studyfolder.manifest(study, "", {}, study.identity)
    done = run(
        study,
        out=target,
        workers=workers,
        max_failed=1.0,
        progress=progress,
        trajectories=0,
        command=f"sprain-cosim reproduce {manifest}",
    )
    assert done.out is not None
    first, different = compare(before, _table(done.out))
    return Reproduction(tuple(_differences(then, now)), len(before), first, different, done.out)


def compare(before: pd.DataFrame, now: pd.DataFrame) -> tuple[dict[str, Any] | None, int]:
    """The first trial that differs and how many do; both tables as text, indexed by trial."""
    first, different = None, 0
    for trial in before.index.union(now.index, sort=False):
        there = [trial in table.index for table in (before, now)]
        if not all(there):
            found = {
                "column": "trial",
                "before": "present" if there[0] else "absent",
                "now": "present" if there[1] else "absent",
            }
        else:
            columns = [*before.columns, *(c for c in now.columns if c not in before.columns)]
            pairs = (
                (c, before.at[trial, c] if c in before else "absent", now.at[trial, c] if c in now else "absent")
                for c in columns
            )
            found = next(({"column": c, "before": a, "now": b} for c, a, b in pairs if a != b), {})
        if found:
            different += 1
            first = first or {"trial": int(trial), **found}
    return first, different


def _read(manifest: Path) -> dict[str, Any]:
    if not manifest.exists():
        raise InputError(f"{manifest}: no such file; name the manifest.json of a study's folder")
    content = read_json(manifest)
    missing = [key for key in ("versions", "fmus", "study_digest", "identity") if key not in content]
    if missing:
        raise InputError(f"{manifest}: not a study's manifest: it has no {', '.join(missing)}")
    return content


def _table(folder: Path) -> pd.DataFrame:
    import pandas as pd

    try:
        return pd.read_csv(folder / "trials.csv", dtype=str, keep_default_na=False).set_index("trial")
    except FileNotFoundError:
        raise InputError(f"{folder}: no trials.csv to compare with; the study is not finished") from None
    except (KeyError, ValueError, OSError) as problem:
        raise InputError(f"{folder / 'trials.csv'}: cannot be read: {problem}") from None


def _study(folder: Path, then: Mapping[str, Any]) -> Plan:
    if (folder / FILE).is_file():
        with Ledger.read(folder) as ledger:
            study = studyfolder.described(folder, ledger)
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
        identity = then["identity"]
        study = replace(
            study, method=identity["method"], seed=identity["seed"], trials=then.get("trials", study.trials)
        )
    now = json.loads(json.dumps(study.identity))
    changed = changes(then["identity"], now, OF_THE_MACHINE)
    if changed:
        raise InputError(
            f"{folder}: its study.toml alone does not give the study of the manifest ({'; '.join(changed)}); "
            "put the ledger beside it, or type again: "
            f"{then.get('command') or 'the command it was made with'}"
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


def _differences(then: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    found = []
    for package in dict.fromkeys([*then["versions"], *now["versions"]]):
        a, b = then["versions"].get(package), now["versions"].get(package)
        if a != b:
            found.append(f"{package} {a or 'absent'} then, {b or 'absent'} now")
    for name in dict.fromkeys([*then["fmus"], *now["fmus"]]):
        a, b = (m["fmus"].get(name, {}).get("sha256", "absent") for m in (then, now))
        if a != b:
            found.append(
                f"FMU {name}: SHA-256 {a[:12]} then, {b[:12]} now ({now['fmus'].get(name, {}).get('file', 'absent')})"
            )
    if then.get("platform") != now["platform"]:
        found.append(f"platform {then.get('platform')} then, {now['platform']} now")
    return found
