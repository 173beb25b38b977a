"""Which FMUs are foreign: all but those that ship, by content."""

from __future__ import annotations

import os
from functools import lru_cache
from pathlib import Path

from ..errors import SprainError
from ..shipped import FMUS
from . import archive


def is_foreign(fmu: Path, sha256: str) -> bool:
    """A file of the package's own folder is not; of any other, which may be a copy, the content decides. Of those that
    ship only the ones of its size are read."""
    if os.path.dirname(fmu) == str(FMUS):
        return False
    try:
        return sha256 not in _shipped(fmu.stat().st_size)
    except OSError:
        return True


@lru_cache(maxsize=64)
def _shipped(size: int) -> frozenset[str]:
    """SHA-256 of those that ship and have `size` bytes."""
    found = set()
    for entry in os.scandir(FMUS) if FMUS.is_dir() else ():
        try:
            if entry.name.endswith(".fmu") and entry.stat().st_size == size:
                found.add(archive.read(Path(entry.path)).sha256)
        except (OSError, SprainError):
            continue
    return frozenset(found)
