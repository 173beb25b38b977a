"""Which FMUs are foreign: all but those that ship, by content."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

from ..errors import SprainError
from ..shipped import FMUS, shipped_fmus
from . import archive


def is_foreign(fmu: Path, sha256: str) -> bool:
    """A file of the package's own folder is not; of any other, which may be a copy, the content decides."""
    return fmu.parent != FMUS and sha256 not in _shipped()


@lru_cache(maxsize=1)
def _shipped() -> frozenset[str]:
    found = set()
    for name in shipped_fmus():
        try:
            found.add(archive.read(FMUS / f"{name}.fmu").sha256)
        except SprainError:
            continue
    return frozenset(found)
