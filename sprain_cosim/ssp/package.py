"""An SSP package: a zip archive with SystemStructure.ssd at its top, checked as FMUs are before anything of it is
used. A single .ssd or .ssv beside its files is read as well."""

from __future__ import annotations

import hashlib
import posixpath
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import unquote, urlsplit

from ..errors import InputError, nearest
from ..fmu import archive, cache

STRUCTURE = "SystemStructure.ssd"
FMU_TYPE = "application/x-fmu-sharedlibrary"
SSD_TYPES = ("application/x-ssp-definition", "application/x-ssp-package")


@dataclass(frozen=True)
class Package:
    """A package that passed the checks of its archive.

    path    the file
    sha256  of its content
    names   of the files in it
    """

    path: Path
    sha256: str
    names: tuple[str, ...]

    @classmethod
    def read(cls, path: Path) -> Package:
        """Raises InputError in one line."""
        sha256, names = archive.contents(path)
        if STRUCTURE not in names:
            raise InputError(f"{path}: no {STRUCTURE} at the top of the archive, so it is not an SSP package")
        return cls(path, sha256, names)

    @classmethod
    def within(cls, fmu: Path) -> Package:
        """The files of an FMU, in which parameter sets may lie. Raises InputError."""
        return cls(fmu, *archive.contents(fmu))

    def member(self, name: str) -> bytes:
        """Raises InputError where there is none, or it is damaged."""
        if name not in self.names:
            raise InputError(f"{self.path}: has no {name}{nearest(name, self.names)}")
        return archive.member(self.path, name)

    def kept(self, name: str) -> Path:
        """A file of the package as a file of its own, by its content. Raises InputError, EnvironmentProblem."""
        content = self.member(name)
        return cache.keep(posixpath.basename(name), content, hashlib.sha256(content).hexdigest())

    def resolved(self, source: str, place: str, base: str = "") -> str:
        """The file of the package that a relative URI names; `base`: the file that it is relative to. Raises InputError
        for any other URI."""
        parts = urlsplit(source)
        if parts.scheme or parts.netloc or parts.fragment or parts.query:
            raise InputError(
                f"{place}: source {source!r} is no path inside the package; only relative ones are read, such as "
                "resources/brace.fmu"
            )
        name = posixpath.normpath(posixpath.join(posixpath.dirname(base), unquote(parts.path)))
        if not parts.path or name.startswith(("..", "/")):
            raise InputError(f"{place}: source {source!r} leads out of the package; refused")
        if name not in self.names:
            raise InputError(f"{place}: source {source!r}: {self.path.name} has no {name}{nearest(name, self.names)}")
        return name
