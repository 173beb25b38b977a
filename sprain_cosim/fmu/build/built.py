"""The record of a clone's builds: which FMUs are what their sources would give, known without what compiles them."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Collection, Iterable
from dataclasses import dataclass, field
from importlib import metadata
from pathlib import Path
from typing import Any

from ...errors import SprainError
from ...files import read_json, write_json
from .link import shim
from .packing import digest, tree

FILE = "built.json"
PACKAGES = ("numba", "llvmlite", "mujoco-core")


@dataclass(frozen=True)
class Built:
    """An FMU of the clone. `new`: written now; else its sources have not changed since it was."""

    file: Path
    guid: str
    new: bool


@dataclass
class BuildRecord:
    """{model: what its FMUs were made from}; `folder` holds the FMUs and the record."""

    folder: Path
    models: dict[str, Any] = field(default_factory=dict)

    @classmethod
    def read(cls, folder: Path) -> BuildRecord:
        """An unreadable record is none: everything is built again."""
        try:
            return cls(folder, read_json(folder / FILE))
        except SprainError:
            return cls(folder)

    def current(self, model: Path, platforms: Collection[str]) -> list[Built]:
        """The FMUs of the model in folder `model`, where they hold all `platforms` and nothing that they are made from
        has changed; else none. Packages that compile are compared where they are installed."""
        entry: Any = self.models.get(model.name)
        try:
            files = {self.folder / name: sha for name, sha in entry["files"].items()}
            same = (
                entry["sources"] == sources(model)
                and set(platforms) <= set(entry["platforms"])
                and all(version in (None, entry["packages"][name]) for name, version in _versions().items())
                and all(hashlib.sha256(file.read_bytes()).hexdigest() == sha for file, sha in files.items())
            )
            return [Built(file, entry["guid"], False) for file in files] if same else []
        except (TypeError, KeyError, AttributeError, OSError):
            return []

    def add(
        self, model: Path, digested: str, platforms: Iterable[str], guid: str, files: Iterable[Path]
    ) -> list[Built]:
        """`digested`: `sources(model)` before it was compiled; they may have changed meanwhile."""
        files = list(files)
        self.models[model.name] = {
            "sources": digested,
            "platforms": sorted(platforms),
            "packages": _versions(),
            "guid": guid,
            "files": {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in files},
        }
        return [Built(file, guid, True) for file in files]

    def write(self) -> None:
        write_json(self.folder / FILE, dict(sorted(self.models.items())))


def sources(model: Path) -> str:
    """Digest of the model's folder, of the models beside it whose modules it imports, of the shim and the modules that
    build."""
    parts = {"model": tree(model), "shim": tree(shim()), "build": tree(Path(__file__).parent)}
    for name in re.findall(rb"^from \.\.(\w+)", b"\n".join(parts["model"].values()), re.MULTILINE):
        parts[name.decode()] = tree(model.parent / name.decode())
    return digest({f"{part}/{path}": data for part, members in parts.items() for path, data in members.items()})


def _versions() -> dict[str, str | None]:
    return {name: version(name) for name in PACKAGES}


def version(package: str) -> str | None:
    """None: it is not installed."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None
