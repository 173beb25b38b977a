"""A drawn figure, and its files with a caption beside them."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TypeVar

from matplotlib.figure import Figure

from .. import __version__
from ..errors import EnvironmentProblem
from ..files import write
from ..folders.comparison import ComparisonFolder
from ..folders.read import Folder
from ..folders.run import RunFolder
from ..twin import shared
from .selection import Named, named_folders, pose_note
from .style import save

CAPTIONS = "captions.txt"
T = TypeVar("T")


@dataclass(frozen=True)
class Drawn:
    """A figure with the name of its file, a title and a caption in words, what draws it once it is wanted, and what it
    shows; None: all there is. `reads`: a name of what is read for it and for others, where that takes long."""

    name: str
    title: str
    caption: str
    draw: Callable[[], Figure]
    shown: Sequence[Named] | None = None
    reads: str = ""


@contextmanager
def shared_out(figures: Sequence[Drawn], make: Callable[[Drawn], T]) -> Iterator[Callable[[], list[T]]]:
    """Yields what gives the results of `make` for each of the figures. A twin begins with them: with those that read
    much, which one of the two processes makes, so that it is read once."""
    groups: dict[str | int, list[int]] = {}
    for n, drawn in enumerate(figures):
        groups.setdefault(drawn.reads or n, []).append(n)
    order = sorted(groups.values(), key=lambda group: not figures[group[0]].reads)

    def made(group: list[int]) -> dict[int, T]:
        return {n: make(figures[n]) for n in group}

    with shared([partial(made, group) for group in order]) as results:

        def found() -> list[T]:
            by_number = {n: result for group in results() for n, result in group.items()}
            return [by_number[n] for n in range(len(figures))]

        yield found


def write_drawn(figures: Iterable[Drawn], folders: Sequence[Folder], target: Path, kinds: Sequence[str]) -> list[Path]:
    """Each of the `figures` of these folders as files of the `kinds` in `target`, captions.txt beside them. Raises
    EnvironmentProblem."""
    figures = list(figures)
    if not figures:
        return []
    try:
        target.mkdir(parents=True, exist_ok=True)
        with shared_out(figures, lambda drawn: save(drawn.draw(), target / drawn.name, kinds)) as saved:
            captions = [_caption(drawn, folders) for drawn in figures]
            written = [path for paths in saved() for path in paths]
        write(target / CAPTIONS, "\n\n".join(captions) + "\n")
    except OSError as problem:
        raise EnvironmentProblem(f"{target}: cannot be written: {problem.strerror or problem}") from None
    return [*written, target / CAPTIONS]


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
