"""One HTML file about runs, studies and comparisons: it opens without a network, on a phone and on paper. All of it
comes from the folders; nothing is simulated but the one landing of a study that can be turned (scene.py)."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from pathlib import Path

from markupsafe import Markup

from .. import __version__, files
from .. import figures as plots
from ..errors import InputError
from ..figures import gallery
from ..figures.drawn import Drawn, shared_out
from ..figures.selection import Named, named_folders, palette_of
from ..folders.comparison import ComparisonFolder
from ..folders.read import Folder
from ..folders.run import RunFolder
from ..folders.study import StudyFolder
from ..literature import DEPTH_TEXT, GROUND_TEXT, INJURY_INVERSION_TEXT
from . import tables
from .blocks import Block, Bullets, Chart, Hero, PageSection, Picture, Pictures
from .charts import charts, script_data
from .data import downloads
from .html import asset, render
from .scene import NOTHING, Scene, landing_scene
from .verdict import notes_of_comparisons, verdicts

NAME = "report.html"
ANIMATION = ("animation.webp", 2_000_000)  # shown when no larger [bytes]
LIMITS = (
    Markup(
        "<b>The published pose starts inside the floor.</b> In the paper's records the foot starts "
        f"{DEPTH_TEXT}, and is thrown out by tens of kilonewtons in the first millisecond: 41 kN in the reference "
        "posture, more where it starts deeper. The touching pose starts with the foot just touching. Read which pose a "
        "figure has before you compare it."
    ),
    Markup(
        f"<b>The ground reaction is not human.</b> {GROUND_TEXT}, at 35 to 50 ms after contact, far more than people "
        "land with. The paper's own model does the same. Peak angles are compared with measurements, forces are not."
    ),
    Markup(
        "<b>One skeleton.</b> One subject of 67.5 kg with 49 muscles, one foot, no shoe. Another person is that "
        "subject scaled in size and mass; strength, stiffness and reflexes stay unless a result names a rule, and no "
        "person but that subject was ever compared with measurements."
    ),
    Markup(
        f"<b>No injury threshold is known.</b> {INJURY_INVERSION_TEXT}° of inversion is where ankles of cadavers "
        "failed. A probability of exceeding it compares braces; it is not the risk of a patient."
    ),
    Markup(
        "<b>The brace is an idea.</b> A device acts as torques between shank and foot: no strap slips, no skin moves, "
        "no fit is wrong, no shoe helps."
    ),
    Markup(
        "<b>Angles have different zeros.</b> Supination and inversion from neutral are zero in the model's neutral "
        "pose. Raw inversion, as in Table 3 of the paper, is 10° lower; measurements have their laboratory's own zero."
    ),
)


def write_report(folders: Sequence[Folder], out: Path, trial: str | None = None) -> Path:
    """The report as `out`, a file that ends in .html, or report.html in the folder `out`. Raises InputError,
    EnvironmentProblem."""
    target = out if out.suffix.lower() in (".html", ".htm") else out / NAME
    if target.is_dir():
        raise InputError(f"{target}: is a folder; name a file that ends in .html")
    files.write(target, report_page(folders, trial), parents=True)
    return target


def report_page(folders: Sequence[Folder], trial: str | None = None) -> str:
    """The whole page. `trial`: which landing of a study can be turned, a number, worst or pXX (default p50); "none":
    no landing."""
    items, looks = named_folders(folders), palette_of(folders)
    content = charts(items, looks)
    with (
        plots.drawn_as(plots.Form(palette=looks)),
        shared_out(list(gallery.draw(folders)), _picture) as pictures,
    ):
        scene = landing_scene(folders, items, looks, trial)
        drawn = pictures()
    missing = "" if trial == NOTHING else _missing(scene)
    hero = Hero(verdicts(folders, items), drawn[0] if drawn else None, scene.frame, scene.alt, missing)
    sections = [
        PageSection("verdict", "Verdict", hero.blocks),
        PageSection(
            "numbers", "Numbers", [*tables.numbers_tables(folders, items), *notes_of_comparisons(folders, items)]
        ),
        PageSection("explore", "Look closer", [Chart(c) for c in content]),
        PageSection("figures", "Figures", _pictures(drawn[1:], folders, items)),
        PageSection("sensitivities", "What drives the result", tables.sensitivities_tables(items)),
        PageSection("metrics", "All responses", tables.metrics_tables(items)),
        PageSection("inputs", "Inputs", tables.inputs_tables(items)),
        PageSection("provenance", "Where it comes from", tables.provenance_tables(items)),
        PageSection("downloads", "Data", downloads(folders, items)),
        PageSection("limits", "Limits of the model", [Bullets(LIMITS)]),
    ]
    return render(
        "report.html",
        title=_title(folders, items),
        about=_about(folders, items),
        hero=hero,
        sections=[section for section in sections if section.blocks],
        data=script_data(content),
        scene="" if scene.content is None else script_data(scene.content),
        script=asset("chart.js"),
        turning=asset("scene.js"),
    )


def _missing(scene: Scene) -> str:
    """Why a landing to turn is missing; each reason says what to do."""
    if scene.content is not None and not scene.reason:
        return ""
    what = "There is no landing to turn here" if scene.content is None else "Not every landing can be turned"
    return f"{what}: {scene.reason}{'' if scene.reason.endswith('.') else '.'}"


def _title(folders: Sequence[Folder], items: Sequence[Named]) -> str:
    if len(folders) == 1 and isinstance(folders[0], ComparisonFolder):
        return f"Braces compared: {folders[0].title}"
    if len(items) == 1:
        return items[0][0]
    kinds = {type(item) for _, item in items}
    word = "landings" if kinds == {RunFolder} else "studies" if kinds == {StudyFolder} else "results"
    return f"{len(items)} {word} side by side"


def _method(study: StudyFolder, folders: Sequence[Folder]) -> str:
    """How the landings were drawn; those of a comparison are one sample, handed to each brace as rows."""
    for folder in folders:
        if isinstance(folder, ComparisonFolder) and any(member is study for member in folder.members.values()):
            return folder.summary.method or study.summary.method
    return "rows of a table" if study.summary.method == "table" else study.summary.method


def _about(folders: Sequence[Folder], items: Sequence[Named]) -> str:
    """Pose, numbers of landings, methods, dates and version."""
    poses = list(dict.fromkeys(item.pose for _, item in items if item.pose))
    parts = [f"Initial pose {' and '.join(poses)}"] if poses else []
    studies = [item for _, item in items if isinstance(item, StudyFolder)]
    if studies:
        counts = list(dict.fromkeys(str(s.summary.n_requested) for s in studies))
        each = " each" if len(counts) == 1 and len(studies) > 1 else ""
        methods = dict.fromkeys(_method(study, folders) for study in studies)
        parts.append(f"{' and '.join(counts)} landings{each} ({', '.join(methods)})")
        dates = sorted({s.manifest.created[:10] for s in studies if s.manifest.created})
        parts += [" to ".join(dict.fromkeys([dates[0], dates[-1]]))] if dates else []
    return " · ".join([*parts, f"sprain-cosim {__version__}"])


def _picture(drawn: Drawn) -> Picture:
    content = _base64(plots.picture(drawn.draw(), "svg"))
    return Picture(drawn.title, drawn.caption, "image/svg+xml", content, drawn.name)


def _pictures(drawn: Sequence[Picture], folders: Sequence[Folder], items: Sequence[Named]) -> list[Block]:
    """The figures, then the first animation that is small enough."""
    file, most = ANIMATION
    found = [path / file for path in dict.fromkeys([f.path for f in folders] + [item.path for _, item in items])]
    shown = [p for p in found if p.is_file() and p.stat().st_size <= most]
    films = [Picture("Animation", p.parent.name, "image/webp", _base64(p.read_bytes())) for p in shown[:1]]
    return [Pictures(pictures) for pictures in (drawn, films) if pictures]


def _base64(content: bytes) -> str:
    return base64.b64encode(content).decode()
