"""The manifest of a study's folder: with what the study was run."""

from __future__ import annotations

import os
import platform
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Any

from .. import __version__, processor
from ..errors import InputError
from ..files import read_json
from ..records import Record
from .identity import digest_of
from .plan import Plan

FILE = "manifest.json"
PACKAGES = ("numpy", "scipy", "fmpy", "pandas")


@dataclass(frozen=True)
class FmuFile(Record):
    """An FMU as it was used: its path then, and the SHA-256 of its content."""

    file: str
    sha256: str | None = None


@dataclass(frozen=True)
class Manifest(Record):
    """With what a study was run.

    versions       {"sprain-cosim", "python", package: version, None where it is not installed}; several, as in
                   "1.26.4, 2.4.6", where the trials ran with several: parts of a study, or one that went on
    fmus           {component: its file}
    study_digest   of the study's identity
    seed, trials   of the sample
    platform       of the machine, or of several
    processor      levels of processors whose code the FMUs of the project ran (processor.py): one, unless the study
                   went on where another one runs
    command        what was typed; empty from Python
    created        when the study began, ISO 8601 in UTC
    identity       what the digest is of
    """

    versions: Mapping[str, str | None] = field(default_factory=dict)
    fmus: Mapping[str, FmuFile] = field(default_factory=dict)
    study_digest: str = ""
    seed: int | None = None
    platform: str = ""
    processor: tuple[str, ...] = ()
    command: str = ""
    created: str = ""
    trials: int | None = None
    identity: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def here(cls) -> Manifest:
        """What runs on this machine."""
        versions = {"sprain-cosim": __version__, "python": platform.python_version()}
        return cls(versions | {name: _version(name) for name in PACKAGES}, platform=platform.platform())

    @classmethod
    def of(
        cls,
        study: Plan,
        identity: Mapping[str, Any],
        command: str = "",
        before: Manifest | None = None,
        levels: Sequence[str] = (),
        parts: Sequence[Manifest] = (),
    ) -> Manifest:
        """Of a study of that `identity` on this machine, whose processor runs code for `levels`. `before` is the
        manifest that stands in the folder: it keeps when the study began, and with what. The trials of merged `parts`
        ran with what theirs say, not with what is here."""
        ran = [m for m in (before, *(parts or (cls.here(),))) if m is not None and m.versions] or [cls.here()]
        return cls(
            versions={name: _several(m.versions.get(name) for m in ran) for m in ran for name in m.versions},
            fmus={name: FmuFile(str(path), identity["fmus"][name]) for name, path in study.scenario.fmus.items()},
            study_digest=digest_of(identity),
            seed=study.seed,
            platform=_several(m.platform for m in ran) or "",
            processor=tuple(dict.fromkeys([*(before.processor if before else ()), *filter(None, levels)])),
            command=command,
            created=(before and before.created) or datetime.now(UTC).isoformat(timespec="seconds"),
            trials=study.trials,
            identity=identity,
        )


def _several(texts: Iterable[str | None]) -> str | None:
    """Those that differ, in one text; None for none."""
    return ", ".join(dict.fromkeys(part for text in texts if text for part in text.split(", "))) or None


def software(then: Manifest, now: Manifest, words: tuple[str, str] = ("then", "now")) -> list[str]:
    """What differs in versions and platform, a line each; nothing of a manifest that says nothing."""
    if not (then.versions and now.versions):
        return []
    pairs = [(name, then.versions.get(name), now.versions.get(name)) for name in {**then.versions, **now.versions}]
    pairs.append(("platform", then.platform, now.platform))
    return [f"{name} {a or 'absent'} {words[0]}, {b or 'absent'} {words[1]}" for name, a, b in pairs if a != b]


def read_manifest(folder: Path) -> Manifest:
    """That of a study's folder; one that says nothing where there is none. Raises InputError."""
    path = folder / FILE
    return Manifest.from_json(read_json(path), str(path)) if path.is_file() else Manifest()


def level_then(folder: Path | None) -> str:
    """The level of the processor that a study in a folder was run with, where it runs here and SPRAIN_CPU names no
    other; else empty."""
    if folder is None or os.environ.get(processor.VARIABLE):
        return ""
    try:
        level = processor.lowest(read_manifest(folder).processor)
    except InputError:
        return ""
    return level if processor.runs_here(level) else ""


def whole_manifest(path: Path) -> Manifest:
    """A manifest that a study can be repeated from. Raises InputError for one that lacks what this takes."""
    if not path.exists():
        raise InputError(f"{path}: no such file; name the manifest.json of a study's folder")
    content = read_json(path)
    missing = [key for key in ("versions", "fmus", "study_digest", "identity") if key not in content]
    if missing:
        raise InputError(f"{path}: not a study's manifest: it has no {', '.join(missing)}")
    return Manifest.from_json(content, str(path))


def _version(package: str) -> str | None:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None
