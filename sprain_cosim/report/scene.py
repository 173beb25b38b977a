"""The landings of the page that a reader can turn: bodies, force and moments over time, as scene.js reads them, and the
film's frame that stands where a browser draws nothing or on paper.

A run's folder holds its landing whole. Of a study one landing is simulated again, as `animate` does: it must give the
recorded response."""

from __future__ import annotations

import base64
import io
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.colors import to_rgb
from numpy.typing import NDArray

from ..animate.moving import HALF_PLATFORM, MovingBodies
from ..animate.stage import PLATFORM, Stage, part_colour
from ..errors import InputError, SprainError
from ..figures.selection import Named
from ..figures.style import ANATOMY, BRACE, GROUND, SeriesLook
from ..folders.comparison import ComparisonFolder
from ..folders.landing import MEDIAN, Landing, choose_common_trial, load_landing
from ..folders.read import Folder
from ..folders.run import RunFolder
from ..folders.study import StudyFolder

MOST = 12  # landings of one page
TRIAL = re.compile(r"\d+|worst|p(\d{1,2}(\.\d+)?|100)")
NOTHING = "none"  # in place of a trial: no landing, nothing is simulated
Moving = tuple[str, MovingBodies]  # the name of a result, and its landing
GROUPS = {
    "sole": "sole",
    "bone": "bone",
    "skin": "glass",
    "foot": "glass",
    "brace": "cuff",
}  # bones are seen through glass


@dataclass(frozen=True)
class Scene:
    """
    content  what scene.js reads; None where there is no landing to turn
    frame    the film's frame at the first landing's peak, WebP, as base64; empty where there is none
    alt      what the frame shows, in words
    reason   why a landing is missing; empty where none is
    """

    content: Mapping[str, Any] | None
    frame: str = ""
    alt: str = ""
    reason: str = ""


def landing_scene(
    folders: Sequence[Folder], items: Sequence[Named], looks: Mapping[str, SeriesLook], trial: str | None = None
) -> Scene:
    """The landings of the first MOST `items` in the colours of `looks`. Of a comparison's study the same trial of every
    brace: the one that is `trial` (a number, worst, pXX; default p50) without a brace. A folder whose landing cannot be
    had is no error: the scene says why. Raises InputError for a `trial` that is none of these."""
    if trial == NOTHING:
        return Scene(None)
    if trial is not None and not TRIAL.fullmatch(trial.strip().lower()):
        raise InputError(
            f"--trial {trial or repr(trial)}: must be a number, worst, a percentile such as p95, or {NOTHING}"
        )
    same = _same_trials(folders, trial)
    landings: list[tuple[str, Landing, MovingBodies]] = []
    reasons: dict[str, None] = {}
    for name, item in items[:MOST]:
        try:
            chosen = None if isinstance(item, RunFolder) else same.get(item.path, trial)
            landing = load_landing(item.path, chosen)
            landings.append((name, landing, MovingBodies.of(landing)))
        except SprainError as problem:
            reasons[str(problem).replace(str(item.path), item.path.name)] = None
    if len(items) > MOST:
        reasons[f"a page shows {MOST} landings, these are {len(items)}"] = None
    reason = "; ".join(reasons)
    if not landings:
        return Scene(None, reason=reason)
    shown = _shown([motion for _, _, motion in landings])
    first = [landings[k] for k in shown]
    motions = [(name, motion) for name, _, motion in landings]
    at = float(first[0][2].time[first[0][2].peak])
    frame = _frame([landing for _, landing, _ in first], [looks[name][0] for name, _, _ in first], at)
    words = _words([(name, motion) for name, _, motion in first], at)
    return Scene(_content(motions, shown, looks), frame, words, reason)


def _shown(motions: Sequence[MovingBodies]) -> list[int]:
    """Which two stand side by side at first: the first one, and of the others the one whose foot rolled least."""
    others = sorted(range(1, len(motions)), key=lambda k: motions[k].signals["angle"].max())
    return [0, *others[:1]]


def _same_trials(folders: Sequence[Folder], trial: str | None) -> dict[Path, str]:
    """{folder of a brace: trial} of comparisons over a study; the trial is chosen among the landings that all braces
    completed."""
    found: dict[Path, str] = {}
    for folder in folders:
        members = list(folder.members.values()) if isinstance(folder, ComparisonFolder) else []
        studies = [member for member in members if isinstance(member, StudyFolder)]
        if not studies or not isinstance(folder, ComparisonFolder):
            continue
        tables = {name: member.trials for name, member in folder.members.items() if isinstance(member, StudyFolder)}
        try:
            number, _ = choose_common_trial(tables, studies[0].response, trial or MEDIAN, str(folder.path))
        except SprainError:
            continue
        found |= {study.path: str(number) for study in studies}
    return found


def _content(
    motions: Sequence[tuple[str, MovingBodies]], shown: Sequence[int], looks: Mapping[str, SeriesLook]
) -> dict[str, Any]:
    """Numbers as 32-bit floats in base64: a page of four landings grows by 150 kB."""
    top = max(float(np.linalg.norm(m.force[m.time > 0.005], axis=1).max(initial=1.0)) for _, m in motions)
    moment = max(float(np.abs(m.signals[who]).max()) for _, m in motions for who in ("anatomy", "brace"))
    return {
        "half": HALF_PLATFORM,
        "shown": shown,
        "platform": [float(c) for c in PLATFORM],
        "newton": 0.42 / top,  # metres of arrow
        "radian": 2.6 / max(moment, 20.0),  # of arc, for a newton metre
        "colours": {"force": _rgb(GROUND), "anatomy": _rgb(ANATOMY)},
        # of one landing alone as in its film and its figures
        "landings": [_landing(name, m, looks[name][0] if len(motions) > 1 else BRACE) for name, m in motions],
    }


def _landing(name: str, motion: MovingBodies, colour: str) -> dict[str, Any]:
    bodies = list(motion.places)
    columns = [column for body in bodies for column in (motion.places[body], motion.turns[body])]
    columns += [motion.ankle, motion.axis, motion.force, motion.point]
    columns += [motion.signals[key][:, None] for key in ("angle", "anatomy", "brace")]
    table = np.concatenate(columns, axis=1)
    return {
        "name": name,
        "label": motion.label.rpartition("/")[2],
        "colour": colour,
        "braced": motion.braced,
        "bodies": len(bodies),
        "step": float(motion.time[1] - motion.time[0]),
        "steps": len(motion.time),
        "peak": motion.peak,
        "pivot": [float(c) for c in motion.pivot],
        "tilt": motion.tilt,
        "outline": motion.outline.round(5).tolist(),
        "edge": [0.0, 0.0, 1.0] if motion.edge is None else [float(c) for c in motion.edge],
        "shapes": [_shape(volume, bodies, colour) for volume in motion.volumes],
        "data": base64.b64encode(table.astype("<f4").tobytes()).decode(),
    }


def _shape(volume: Mapping[str, Any], bodies: Sequence[str], colour: str) -> list[Any]:
    """[body, group, ends and radii, colour]."""
    part = str(volume["part"])
    rgb = _rgb(colour) if part == "brace" else _three(part_colour(part))
    ends = [round(float(v), 5) for end in ("from", "to", "radii") for v in volume[end]]
    return [bodies.index(volume["body"]), GROUPS.get(part, "far"), ends, rgb]


def _frame(landings: Sequence[Landing], colours: Sequence[str], at: float) -> str:
    from PIL import Image

    (picture,) = Stage(landings, 20.0, colours).frames(np.array([at]))
    buffer = io.BytesIO()
    Image.fromarray(picture).save(buffer, "WEBP", quality=80, method=4)
    return base64.b64encode(buffer.getvalue()).decode()


def _words(motions: Sequence[Moving], at: float) -> str:
    parts = []
    for name, motion in motions:
        angle, anatomy, brace = (np.interp(at, motion.time, motion.signals[k]) for k in ("angle", "anatomy", "brace"))
        moments = f"moment of the anatomy {anatomy:z.1f} N·m" + (
            f", of the brace {brace:z.1f} N·m" if motion.braced else ""
        )
        parts.append(f"{name}: subtalar angle {angle:z.1f}°, {moments}")
    return f"A landing {1e3 * at:.0f} ms after contact, drawn from behind. {'; '.join(parts)}."


def _rgb(colour: str) -> list[float]:
    return _three(np.array(to_rgb(colour)))


def _three(colour: NDArray[np.float64]) -> list[float]:
    return [round(float(c), 3) for c in colour]
