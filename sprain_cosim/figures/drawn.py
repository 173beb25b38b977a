"""A drawn figure, and its files with a caption beside them."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from matplotlib.figure import Figure

from .. import __version__
from ..errors import EnvironmentProblem
from ..files import write
from ..folders.comparison import ComparisonFolder
from ..folders.read import Folder
from ..folders.run import RunFolder
from .selection import Named, named_folders, pose_note
from .style import save

CAPTIONS = "captions.txt"


@dataclass(frozen=True)
class Drawn:
    """A figure with the name of its file, a title and a caption in words, what draws it once it is wanted, and what it
    shows; None: all there is."""

    name: str
    title: str
    caption: str
    draw: Callable[[], Figure]
    shown: Sequence[Named] | None = None


def write_drawn(figures: Iterable[Drawn], folders: Sequence[Folder], target: Path, kinds: Sequence[str]) -> list[Path]:
    """Each of the `figures` of these folders as files of the `kinds` in `target`, captions.txt beside them. Raises
    EnvironmentProblem."""
    written, captions = list[Path](), list[str]()
    try:
        for drawn in figures:
            target.mkdir(parents=True, exist_ok=True)
            written += save(drawn.draw(), target / drawn.name, kinds)
            captions.append(_caption(drawn, folders))
        if captions:
            write(target / CAPTIONS, "\n\n".join(captions) + "\n")
            written.append(target / CAPTIONS)
    except OSError as problem:
        raise EnvironmentProblem(f"{target}: cannot be written: {problem.strerror or problem}") from None
    return written


def _caption(drawn: Drawn, folders: Sequence[Folder]) -> str:
    """What a journal prints below: what is shown, of how many landings, which intervals, from which versions."""
    counts, versions = list[str](), dict[str, None]()
    drawn_by = {  # the rows of a comparison's studies are given ones; how they were drawn stands in its own summary
        id(member): f.summary.method
        for f in folders
        if isinstance(f, ComparisonFolder)
        for member in f.members.values()
    }
    shown = named_folders(folders) if drawn.shown is None else drawn.shown
    for name, item in shown:
        if isinstance(item, RunFolder):
            counts.append(f"{name}: one landing")
            versions[f"sprain-cosim {item.summary.version}" if item.summary.version else ""] = None
        else:
            failed = f", {item.summary.n_failed} failed" if item.summary.n_failed else ""
            counts.append(
                f"{name}: n = {item.summary.n_completed}{failed} ({drawn_by.get(id(item)) or item.summary.method})"
            )
            versions[", ".join(f"{k} {v}" for k, v in item.manifest.versions.items())] = None
    made = " | ".join(v for v in versions if v)
    parts = (
        f"{drawn.name}. {drawn.title}. {drawn.caption}",
        f"{'; '.join(counts)}." if counts else "",
        pose_note(shown),
        f"Computed with {made}." if made else "",
        f"Drawn with sprain-cosim {__version__}.",
    )
    return " ".join(part for part in parts if part)


def as_file_name(folder: Path) -> str:
    return re.sub(r"[^\w.-]", "_", folder.resolve().name)
