"""Which FMUs are foreign: all but those that ship, by content."""

from __future__ import annotations

from functools import lru_cache

from ..errors import SprainError
from ..shipped import FMUS, shipped_fmus
from . import archive


def is_foreign(sha256: str) -> bool:
    return sha256 not in _shipped()


@lru_cache(maxsize=1)
def _shipped() -> frozenset[str]:
    found = set()
    for name in shipped_fmus():
        try:
            found.add(archive.read(FMUS / f"{name}.fmu").sha256)
        except SprainError:
            continue
    return frozenset(found)
