"""What a folder holds: a run, a study or a comparison. Nothing is simulated and nothing written.

Raises InputError for a folder that is none of them, is not finished, or cannot be read."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from pathlib import Path

from ..errors import InputError
from ..files import is_missing
from ..machine.here import SYSTEM
from ..study import ledger
from ..study.folder import TRIALS, recorded_plan
from ..study.originals import edited_files
from . import run
from .comparison import FILE, ComparisonFolder, member_path, read_comparison_summary
from .run import RunFolder, read_run
from .study import StudyFolder, read_study

Folder = RunFolder | StudyFolder | ComparisonFolder


def read_folder(path: Path) -> Folder:
    """What `path` holds."""
    if missing := is_missing(path):
        raise InputError(f"{path}: {missing}")
    if (path / FILE).is_file():
        return _read_comparison(path)
    found = _read_landings(path)
    if found is None:
        raise InputError(
            f"{path}: holds no run, study or comparison; make one with `sprain-cosim run SCENARIO --out "
            f"{SYSTEM.quoted(str(path))}`"
        )
    return found


def open_folder(path: Path | str) -> Folder:
    """What `run --out`, `study --out` or `compare --out` left, to look at and to `plot()`:

    - a run: `summary`, `result` (its `signals`, its `metrics`)
    - a study: `summary`, `trials`, `trajectory(number)`
    - a comparison: `summary`, `members` {brace: a run or a study}

    >>> import sprain_cosim as sc
    >>> sc.open_folder("runs/s6").summary.method
    'monte-carlo'
    """
    return read_folder(Path(path).expanduser())


def read_folders(paths: Sequence[Path]) -> list[Folder]:
    """Each folder once."""
    return [read_folder(path) for path in dict.fromkeys(paths)]


def edited_since(folders: Sequence[Folder]) -> list[str]:
    """What has been edited of the files that studies were run with, a line each that begins with the folder."""
    found = []
    for folder in folders:
        members = folder.members.values() if isinstance(folder, ComparisonFolder) else (folder,)
        for path in (member.path for member in members if isinstance(member, StudyFolder)):
            with contextlib.suppress(InputError), ledger.Ledger.read(path) as held:
                found += [f"{path}: {line}" for line in edited_files(recorded_plan(path, held), held.said("identity"))]
    return found


def _read_landings(path: Path) -> RunFolder | StudyFolder | None:
    if (path / TRIALS).is_file() and (path / run.FILE).is_file():
        return read_study(path)
    if (path / ledger.FILE).is_file():
        raise InputError(f"{path}: the study is not finished; continue it with --resume")
    if (path / run.SIGNALS).is_file() or (path / run.FILE).is_file():
        return read_run(path)
    return None


def _read_comparison(path: Path) -> ComparisonFolder:
    summary = read_comparison_summary(path)
    places = {name: member_path(path, brace.folder or name) for name, brace in summary.braces.items()}
    found = {name: _read_landings(place) for name, place in places.items() if (place / run.FILE).is_file()}
    members = {name: member for name, member in found.items() if member is not None}
    if not members:
        raise InputError(
            f"{path}: compare.json names braces, but none of their folders is here; run `sprain-cosim compare` again"
        )
    return ComparisonFolder(path, summary, members)
