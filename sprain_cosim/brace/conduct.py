"""How a device behaves towards its process and the machine, beside its torques: what `check` notes about it, and what
its mapping file would have to allow it."""

from __future__ import annotations

import sys
from collections.abc import Collection, Iterable, Iterator
from pathlib import Path
from typing import Any

from ..fmu.messages import Messages
from ..sandbox.watch import Attempt
from .fit import FitReport
from .probe import BEGINS, ENDS

FEW = 3  # paths that are named
EXPECTED = ("files", "sockets", "programs", "processes", "threads", "umask", "folder")  # topics with words of their own


def note_conduct(attempts: Iterable[Attempt], changed: Collection[str], report: FitReport) -> None:
    """Notes in `report`. `changed`: what of its process the device left in another state."""
    tried = list(_of_the_device(list(attempts)))
    if any(a.topic == "threads" for a in tried):
        report.notes.append("starts threads")
    own = [Path(a.detail).name for a in tried if a.topic == "files" and a.writes and not a.refused]
    if own:
        report.notes.append(f"writes files into its working folder, which is gone after it: {_few(own)}")
    if changed:
        report.notes.append(f"changes of its process: {', '.join(changed)}; put back after each run")
    outside = [a.detail for a in tried if a.topic == "files" and a.writes and a.refused]
    if outside:
        report.notes.append(f"tries to write outside its own folder, which is refused: {_few(outside)}")
    other = dict.fromkeys(a.topic for a in tried if a.refused and a.topic not in EXPECTED)
    if other:
        report.notes.append(f"tries what the sandbox refuses: {', '.join(other)}")
    needs = _needs(tried)
    if needs:
        words = ", ".join(f'"{word}"' for word in needs)
        report.notes.append(
            f"tried what only a mapping file can allow; if it needs that and you trust its maker: allow = [{words}]"
            + (', or "loopback" in its place for a server of its own' if "network" in needs else "")
        )


def note_messages(said: Any, report: FitReport) -> None:
    """Notes in `report` what its FMU said to the probes: Messages as JSON, or None."""
    if said is not None:
        report.notes.append(Messages.from_json(said, report.fmu).text)


def _of_the_device(attempts: list[Attempt]) -> Iterator[Attempt]:
    """Those between the marks of the probes; loading a library walks to its folder and back, and
    Python looks where it may import from."""
    names = [Path(a.detail).name for a in attempts]
    first = names.index(BEGINS) + 1 if BEGINS in names else 0
    last = names.index(ENDS) if ENDS in names else len(attempts)
    scratch = str(Path(attempts[first - 1].detail).parent) if first else ""
    for attempt in attempts[first:last]:
        loading = attempt.topic == "folder" and (attempt.detail == scratch or "/binaries/" in attempt.detail)
        importing = attempt.topic == "files" and attempt.detail in sys.path
        if not loading and not importing:
            yield attempt


def _needs(tried: list[Attempt]) -> list[str]:
    """The words of `allow` for what was refused. A socket is refused before its address is known."""
    refused = [a for a in tried if a.refused]
    words = ["network"] if any(a.topic == "sockets" for a in refused) else []
    words += ["exec"] if any(a.topic in ("programs", "processes") for a in refused) else []
    paths = dict.fromkeys(a.detail for a in refused if a.topic == "files" and not a.writes)
    return words + [f"read:{path}" for path in list(paths)[:FEW]]


def _few(paths: Collection[str]) -> str:
    named = list(dict.fromkeys(paths))
    return ", ".join(named[:FEW]) + (f" and {len(named) - FEW} more" if len(named) > FEW else "")
