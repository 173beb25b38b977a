"""An SSP package: a zip archive with SystemStructure.ssd at its top, checked as FMUs are before anything of it is
used."""

from __future__ import annotations

import hashlib
import posixpath
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import unquote, urlsplit

from ..errors import InputError, nearest
from ..fmu import archive, cache
from ..machine.here import SYSTEM

STRUCTURE = archive.STRUCTURE
KIND = "an SSP package"
FMU_TYPE = "application/x-fmu-sharedlibrary"
PACKAGE_TYPE, DEFINITION_TYPE = "application/x-ssp-package", "application/x-ssp-definition"


@dataclass(frozen=True)
class Package:
    """A package that passed the checks of its archive.

    path    the file
    sha256  of its content
    names   of the files in it
    label   for messages: the file, or where it lies in another package
    """

    path: Path
    sha256: str
    names: tuple[str, ...]
    label: str

    @classmethod
    def read(cls, path: Path, label: str = "") -> Package:
        """Raises InputError in one line."""
        if path.suffix.lower() == ".ssd":
            raise InputError(
                f"{path}: is a structure without its package; zip it as {STRUCTURE} with the files it names"
            )
        found = cls._opened(path, KIND, label)
        if STRUCTURE in found.names:
            return found
        if archive.DESCRIPTION in found.names:
            hint = "" if label else f"; `sprain-cosim check {SYSTEM.quoted(str(path))}` says whether it fits"
            raise InputError(f"{found.label}: is an FMU, not {KIND}{hint}")
        deeper = next((n.rpartition("/")[0] for n in found.names if n.endswith(f"/{STRUCTURE}")), "")
        where = f"; it lies in its folder {deeper}" if deeper else ""
        raise InputError(f"{found.label}: no {STRUCTURE} at the top of the archive, so it is not {KIND}{where}")

    @classmethod
    def within(cls, fmu: Path, label: str = "") -> Package:
        """The files of an FMU, in which parameter sets may lie. Raises InputError."""
        return cls._opened(fmu, archive.FMU, label)

    @classmethod
    def _opened(cls, path: Path, kind: str, label: str) -> Package:
        try:
            return cls(path, *archive.contents(path, kind), label or str(path))
        except InputError as problem:
            raise InputError(str(problem).replace(str(path), label or str(path))) from None

    def content(self, name: str) -> bytes:
        """Of a file. Raises InputError where there is none, or it is damaged."""
        if name not in self.names:
            raise InputError(f"{self.label}: has no {name}{nearest(name, self.names)}")
        return archive.member(self.path, name)

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
            raise InputError(
                f"{place}: source {source!r}: {posixpath.basename(self.label)} has no {name}{nearest(name, self.names)}"
            )
        return name


@dataclass(frozen=True)
class PackageFile:
    """A file of a package."""

    package: Package
    name: str

    @property
    def key(self) -> tuple[str, str]:
        """What it is, wherever the package lies."""
        return self.package.sha256, self.name

    @property
    def label(self) -> str:
        """For messages."""
        return f"{self.package.label}:{self.name}"

    def content(self) -> bytes:
        """Raises InputError where there is none, or it is damaged."""
        return self.package.content(self.name)

    def kept(self) -> Path:
        """As a file of its own, by its content. Raises InputError, EnvironmentProblem."""
        content = self.content()
        return cache.keep(posixpath.basename(self.name), content, hashlib.sha256(content).hexdigest())

    def package_in_it(self) -> Package:
        """Raises InputError, EnvironmentProblem."""
        return Package.read(self.kept(), self.label)
