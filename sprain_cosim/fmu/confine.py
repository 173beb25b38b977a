"""The sandbox of a process that runs foreign FMUs."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from ..sandbox.allowed import NOTHING, Allowed
from ..sandbox.confinement import Confinement
from . import cache
from .component import Component
from .foreign import is_foreign


def granted_to(strangers: Iterable[Component]) -> Allowed:
    """What a process may do that runs them together."""
    granted = NOTHING
    for component in strangers:
        granted |= component.allowed
    return granted


def confinement(components: Iterable[Component], files: Iterable[Path] = ()) -> Confinement | None:
    """The sandbox of a process that runs the components together and reads `files`; None where none is foreign. Unpacks
    them, which the process itself no longer could. Raises what the unpacking raises."""
    components = tuple(components)
    strangers = [component for component in components if is_foreign(component.fmu, component.sha256)]
    if not strangers:
        return None
    entries = [cache.unpacked(component.fmu, component.sha256).parent for component in components]
    places = [*entries, *(component.fmu for component in components), *files]
    return Confinement(tuple(str(place.absolute()) for place in places), "", granted_to(strangers))
