"""Where the FMUs of a scenario run, for summaries and warnings."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from ..fmu.component import Component
from ..fmu.foreign import is_foreign


@dataclass(frozen=True)
class Isolation:
    """Where the FMUs of a scenario run, and what foreign ones among them may do.

    kind     sandbox; process: a process of its own without a sandbox; none: this process
    granted  {foreign component: what its mapping file allows it}
    gaps     what this machine's sandbox does not hold back
    """

    kind: str
    granted: Mapping[str, tuple[str, ...]]
    gaps: tuple[str, ...]


def isolation(components: Iterable[Component], in_process: bool, of_trials: bool = False) -> Isolation:
    """`of_trials`: those of a study, which have a process of their own whatever they are."""
    components = tuple(components)
    strangers = [c for c in components if is_foreign(c.fmu, c.sha256)]
    if in_process or not strangers:
        concerned = strangers or components
        apart = of_trials or all(c.own_process for c in concerned)
        return Isolation("process" if apart else "none", {}, ())
    from ..fmu.confine import granted_to
    from ..sandbox.confinement import Confinement
    from ..sandbox.kernel import offered

    offer = offered()
    granted = {c.name: tuple(c.allowed.words()) for c in strangers if c.allowed}
    gaps = Confinement((), "", granted_to(strangers)).gaps(offer)
    return Isolation("sandbox" if offer.landlock or offer.seccomp else "process", granted, tuple(gaps))
