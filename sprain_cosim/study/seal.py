"""Whether a study's folder is finished as it was asked for, so that nothing need be computed again.

When the exports are written, the ledger notes what was asked for, how many rows it had and the SHA-256 of each export.
As long as all of that still holds, a resumed study has nothing to do."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from .ledger import Ledger
from .trajectories import trajectory_path

EXPORTS = ("trials.csv", "timing.csv", "summary.json", "study.toml", "manifest.json", "failures.json", "trials.parquet")
NECESSARY = EXPORTS[:5]


def seal(folder: Path, ledger: Ledger, request: Mapping[str, Any], recorded: Iterable[int]) -> None:
    """`recorded`: trials whose trajectories belong to what was asked for. Raises EnvironmentProblem."""
    files = {name: _sha256(folder / name) for name in EXPORTS if (folder / name).is_file()}
    ledger.note_exports({"request": request, "rows": ledger.count(), "files": files, "recorded": sorted(set(recorded))})


def sealed(folder: Path, ledger: Ledger, request: Mapping[str, Any]) -> bool:
    noted = ledger.noted_exports()
    if noted.get("request") != json.loads(json.dumps(request)) or noted.get("rows") != ledger.count():
        return False
    files, recorded = noted.get("files", {}), noted.get("recorded", [])
    if not set(NECESSARY) <= set(files) or (request["parquet"] and "trials.parquet" not in files):
        return False
    try:
        return all(_sha256(folder / name) == digest for name, digest in files.items()) and all(
            trajectory_path(folder, trial).is_file() for trial in recorded
        )
    except (OSError, TypeError, ValueError):
        return False


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
