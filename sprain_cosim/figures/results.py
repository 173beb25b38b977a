"""The figure that a result, a campaign or a folder gives when it is asked to draw itself."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

from matplotlib.figure import Figure

from ..cosim.result import Result
from ..errors import InputError
from ..folders.comparison import ComparisonFolder
from ..folders.read import Folder, read_folder
from ..folders.run import RunFolder
from ..folders.study import StudyFile, StudyFolder
from ..study.campaign import Campaign
from .gallery import draw, is_of_kind
from .landings import landing_signals, moment_angle
from .samples import cdf
from .selection import palette_of, response_label, sample_of
from .style import FORM, drawn_as, picture

Named = Iterator[tuple[str, Callable[[], Figure]]]


def figure_of(item: object, kind: str) -> Figure:
    """See `Plottable.plot`. A notebook shows the figure also where pyplot was never loaded."""
    folder, known = _folder(item), list[str]()
    with drawn_as(FORM.get() if folder is None else replace(FORM.get(), palette=palette_of([folder]))):
        for name, drawn in _of_memory(item) if folder is None else ((d.name, d.draw) for d in draw([folder])):
            if not kind or is_of_kind(name, kind):
                figure = drawn()
                vars(figure)["_repr_png_"] = partial(picture, figure, "png")
                return figure
            known.append(name)
    if not known:
        raise InputError("nothing to draw: no landing completed, or its signals were not kept")
    hint = "" if folder is not None or isinstance(item, Result) else "; a study with a folder (out=) allows more"
    raise InputError(f"plot({kind!r}): there is no such figure, but {', '.join(known)}{hint}")


def _folder(item: object) -> Folder | None:
    if isinstance(item, Campaign):
        return None if item.out is None else read_folder(item.out)
    return item if isinstance(item, RunFolder | StudyFolder | ComparisonFolder) else None


def _of_memory(item: object) -> Named:
    if isinstance(item, Result):
        if "plant.subtalar_angle" in item.index and len(item.time):
            title = "landing" if item.status == "completed" else item.status
            yield "landing", partial(landing_signals, [(title, item)])
            yield "moment_angle", partial(moment_angle, [(title, item)])
    elif isinstance(item, Campaign):
        study = StudyFolder(Path(), item.summary, item.trials, StudyFile(responses=item.study.responses))
        for response in item.study.responses:
            sample = sample_of(item.summary.title, study, response, with_published=False)
            if len(sample.values) > 1:
                yield f"cdf_{response}", partial(cdf, [sample], response_label(response))
