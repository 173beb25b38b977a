"""The paper again: its six studies and its search are run, and its Figures 1C, 4 and 5 drawn with the published figures
beside."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..brace.probe import Rig
from ..errors import InputError
from ..figures.drawn import Drawn, write_drawn
from ..figures.gallery import importance_of, tested_shares
from ..figures.law import AXES, SPAN, resisting
from ..figures.paper import LAWS, Repeated, figure_1c, figure_4, signed_gap
from ..figures.records import REFERENCE, authors_peaks
from ..figures.samples import Authors, level_search
from ..figures.selection import LEVELS, pose_note, response_label, sample_of
from ..figures.style import Form, drawn_as
from ..files import check_folder
from ..fmu.component import Component
from ..fmu.driver import own_step
from ..folders.read import read_folders
from ..folders.study import PEAK, StudyFolder
from ..literature import AUTHORS_IMPORTANCE, PASSIVE
from ..shipped import fmu_path
from ..study.file import load_study
from ..study.progress import Progress

STUDIES, SEARCH = tuple(f"study{n}" for n in range(1, 7)), "amv6"
FEWEST = 20  # landings of a study, for its 5 and 95 % levels
PAPER = "Yoder, Petrella & Farrokhi 2021, doi 10.3389/fbioe.2021.765331"
Array = NDArray[np.float64]


def repeat_paper(
    out: Path,
    trials: int | None = None,
    workers: int | None = None,
    progress: Callable[[str], Progress | None] = lambda _: None,
) -> list[StudyFolder]:
    """The six studies and the search, each in a folder of its name in `out`; what is there already is continued.

    trials    of each study, instead of the paper's 1000
    progress  of the study of that name

    Raises InputError, for a folder of another number of trials as well, and SimulationError."""
    if trials is not None and trials < FEWEST:
        raise InputError(f"--trials {trials}: the paper's levels need {FEWEST} landings or more")
    check_folder(out)
    for name in (*STUDIES, SEARCH):
        study, number = load_study(name), None if name == SEARCH else trials
        command = f"sprain-cosim study {name} --out {out / name}" + (f" --trials {number}" if number else "")
        where: Any = {"out": out / name, "workers": workers, "resume": True, "trajectories": 0}
        study.run(trials=number, progress=progress(name), command=command, **where)
    found = read_folders([out / name for name in (*STUDIES, SEARCH)])
    return [folder for folder in found if isinstance(folder, StudyFolder)]


def write_paper_figures(folders: Sequence[StudyFolder], out: Path, kinds: Sequence[str], form: Form) -> list[Path]:
    """figure_1c, figure_4 and figure_5 of the folders of `repeat_paper` with captions.txt, in `out`/figures. Raises
    EnvironmentProblem."""
    with drawn_as(form):
        return write_drawn(paper_figures(folders), folders, out / "figures", kinds)


def paper_figures(folders: Sequence[StudyFolder]) -> Iterator[Drawn]:
    """Each with a caption that says how far ours are from the published figures."""
    *studies, search = folders
    yield _figure_1c()
    yield _figure_4(studies)
    yield _figure_5(studies[-1], search)


def _figure_1c() -> Drawn:
    measured = {name: law_torques(name, scale) for name, scale in LAWS.items()}
    apart = max(
        float(np.abs(torque - resisting(axis, angle, LAWS[name])).max())
        for name, curves in measured.items()
        for axis, (angle, torque) in curves.items()
    )
    caption = (
        f"Figure 1C of {PAPER}: the passive ankle, as the plant's own parameters have it, and the two braces, as the "
        "FMU of the bushing gives them, about the three body-fixed axes. Circles: the polynomial with the published "
        f"coefficients, for which the article has curves alone. Largest gap {apart:.1g} N·m."
    )
    note = "Body-fixed X-Y-Z angles of the calcaneus in the tibia, zero at neutral. No landing, no initial pose."
    return Drawn("figure_1c", "Torque-angle laws of ankle and braces", caption, partial(figure_1c, measured, note), ())


def law_torques(name: str, scale: float) -> dict[str, tuple[Array, Array]]:
    """{axis: (angle [rad], resisting torque [N·m])} of the plant's passive ankle or of the brace."""
    angles = np.radians(np.linspace(-SPAN, SPAN, 71))
    if scale == 1.0:
        plant = Component.read("plant", fmu_path("plant", Path.cwd(), name))
        return {axis: (angles, _passive(plant, axis, angles)) for axis in PASSIVE}
    brace = Component.read("brace", fmu_path("brace_bushing", Path.cwd(), name))
    rig, step = Rig(brace, tuple(AXES), {"angle_scale": scale}), own_step(brace)
    try:
        held = {axis: [-rig.hold(rig.along(k, angle), step)[k] for angle in angles] for k, axis in enumerate(AXES)}
    finally:
        rig.close()
    return {axis: (angles, np.array(torques, float)) for axis, torques in held.items()}


def _passive(plant: Component, axis: str, angles: Array) -> Array:
    powers = [plant.connectors[f"passive_{axis[-1]}_{power}"].start for power in ("linear", "quadratic", "cubic")]
    return angles * np.polynomial.polynomial.polyval(angles, [0.0 if p is None else p for p in powers])


def _figure_4(studies: Sequence[StudyFolder]) -> Drawn:
    repeated = [Repeated(n, sample_of(s.title, s), authors_peaks(n)) for n, s in enumerate(studies, 1)]
    gaps = {(r.number, level): gap for r in repeated for level, gap in r.gaps.items()}
    (number, level), worst = max(gaps.items(), key=lambda item: abs(item[1]))
    left_open = sum(r.open_ended for r in repeated)
    unsettled = f", {left_open} are not settled, since too few landings leave an end open" if left_open else ""
    caption = (
        f"Figure 4 of {PAPER}: peak supination in its six studies. {sum(r.agreeing for r in repeated)} of the "
        f"{len(gaps)} published levels lie within our 95 % intervals{unsettled}; the largest gap is "
        f"{signed_gap(worst, 2)}° (ours minus published; study {number}, {level:g} % level). "
        "Both are random samples, ours other draws than theirs. "
    )
    caption += (
        "Thin: the half of the authors' trials that are at hand."
        if any(r.records is not None for r in repeated)
        else f"Missing here: the authors' own trials ({REFERENCE} names their folder); of them the levels alone."
    )
    named = [(s.title, s) for s in studies]
    drawn = partial(figure_4, repeated, response_label(PEAK), pose_note(named))
    return Drawn("figure_4", "Peak supination in the paper's six studies", caption, drawn, named)


def _figure_5(study: StudyFolder, search: StudyFolder) -> Drawn:
    amv = search.summary.amv
    assert amv is not None
    levels, sample = sample_of("AMV, here", search), sample_of(study.title, study)
    sampled = search.file.published.get("monte_carlo", {})
    theirs = Authors({p: sampled[f"{p:g} % [deg]"] for p in LEVELS if f"{p:g} % [deg]" in sampled}, AUTHORS_IMPORTANCE)
    gaps = {p: levels.percentiles[p][0] - value for p, value in levels.published.items() if p in levels.percentiles}
    apart = ", ".join(f"{signed_gap(gap, 2)}° at {p:g} %" for p, gap in gaps.items())
    caption = (
        f"Figure 5 of {PAPER}: the advanced mean value method on study 6, over Monte Carlo, and what leads to each "
        f"level. Ours minus published: {apart}. The authors' outputs were rounded to 0.1°; a step of a tenth of the SD "
        "moved six of the ten inputs by less, so that they have no importance there and that of the others is coarse; "
        "most of the gap at 5 % follows. Small circles: their importance, from the design points of their runs. "
        "Upright lines: the share of our random landings that lies below our level, with its 95 % interval. Gate of "
        f"the method, here: {amv.status}."
    )
    shown = [(study.title, study), (search.title, search)]
    note = f"{pose_note(shown)} The method's own test says {amv.status}."
    drawn = partial(
        level_search, levels, importance_of(amv), response_label(PEAK), sample, note, theirs, tested_shares(amv)
    )
    return Drawn("figure_5", "Advanced mean value method over Monte Carlo", caption, drawn, shown)
