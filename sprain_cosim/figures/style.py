"""How every figure looks: one journal column wide unless asked otherwise, letters of 7 points or more, and a line style
or a mark besides wherever a colour carries meaning.

Colours have a contrast of 3 or more (WCAG 2.2) to white as well as to the page's dark ground, which leaves lightness
little room: their hues were searched for the largest least distance among each other as trichromats, deuteranopes and
protanopes see them (Machado et al. 2009). It is 12.7 in CIELAB; that of Okabe & Ito (2008), whom they follow, is 17.9
at a contrast of 2.2."""

from __future__ import annotations

import io
import re
import textwrap
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from functools import wraps
from pathlib import Path
from string import ascii_uppercase
from typing import Any, NamedTuple, ParamSpec

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.markers import CARETLEFT
from matplotlib.text import Text
from matplotlib.textpath import TextToPath

from ..errors import visible
from ..files import write

SINGLE, DOUBLE = 8.5, 17.8  # width of one and of two columns of a journal [cm]
MARGIN = 0.22  # cm at the right, for half of the last tick's label
MATRIX = "matrix"  # label of a figure whose cells are one panel
MOST_DRAWN = 2000  # points of a curve; of more points, a picture inside the figure
SMALL, NORMAL = 7.0, 7.5  # points
INK, FAINT = "#1f2933", "#9aa5b1"
MUTED = "#52606d"  # for notes: 6 to 1 against white
BLUE, VERMILION, GREEN, OCHRE, PURPLE, SKY, TAUPE = (
    "#0b65d3",
    "#f66615",
    "#6d9f75",
    "#975609",
    "#be81a4",
    "#1a9dda",
    "#8b655a",
)
SERIES = (BLUE, VERMILION, PURPLE, GREEN, SKY, OCHRE, TAUPE)  # green and ochre late: they are anatomy and brace
UNBRACED = "#63656c"  # landings without a brace beside landings with one
SUBTALAR, TALOCRURAL, ANATOMY, BRACE, GROUND = VERMILION, BLUE, GREEN, OCHRE, "#5c677d"
CONTRAST = 4.55  # of text against white; 4.5 is asked
PATCH: dict[str, Any] = dict(facecolor="white", alpha=0.75, edgecolor="none", pad=0.4)  # behind words over a curve
LINE = 0.32  # height of a line of small letters [cm]
LONGEST = 240  # letters of a title that are shown
LINES: tuple[Any, ...] = ("-", (0, (5, 1.6)), (0, (1.2, 1.2)), (0, (6, 1.5, 1.2, 1.5)))
DOTS = ("o", "s", "^", "D", "v", "P", "X", "<", ">", "*", "p", "h")  # marks of single points
# bars of who bears a moment
BORNE: dict[str, Any] = {
    "anatomy": dict(color=ANATOMY),
    "brace": dict(facecolor=BRACE, hatch="////", edgecolor="white", linewidth=0),
}
HATCHES = ("", "////", "....", "xxxx")  # of bars
MARKS = 8  # on a line that carries marks
JOURNAL: Any = {
    "font.size": NORMAL,
    "axes.titlesize": NORMAL,
    "axes.labelsize": NORMAL,
    "xtick.labelsize": SMALL,
    "ytick.labelsize": SMALL,
    "legend.fontsize": SMALL,
    "legend.frameon": False,
    "legend.handlelength": 1.8,
    "legend.borderaxespad": 0.2,
    "legend.labelspacing": 0.3,
    "legend.columnspacing": 1.2,
    "axes.titlelocation": "left",
    "axes.titlepad": 3.0,
    "axes.titley": 1.0,  # right above the panel: to find a place, matplotlib measures every label again and again
    "axes.labelpad": 2.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.6,
    "axes.edgecolor": FAINT,
    "axes.labelcolor": INK,
    "axes.titlecolor": INK,
    "text.color": INK,
    "text.parse_math": False,  # titles and names come from files
    "xtick.color": FAINT,
    "ytick.color": FAINT,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "grid.color": FAINT,
    "grid.alpha": 0.25,
    "grid.linewidth": 0.5,
    "lines.linewidth": 1.2,
    "lines.markersize": 4.0,
    "svg.fonttype": "none",
    "svg.hashsalt": "sprain-cosim",
    "pdf.fonttype": 42,  # letters that can be searched and edited
}
# what a parameter of the shipped FMUs is called in figures and tables, and the unit it is read in
PARAMETERS = {
    "plant.platform_incline": ("platform incline", "deg"),
    "plant.drop_height": ("drop height", "m"),
    "plant.contact_modulus": ("contact modulus", "MPa/m"),
    "plant.contact_dissipation": ("contact dissipation", "s/m"),
    "plant.contact_friction": ("contact friction", ""),
    "plant.passive_angle_scale": ("passive ankle angle scale", ""),
    "plant.ankle_strength_scale": ("ankle muscle strength", ""),
    "plant.evertor_strength_scale": ("evertor muscle strength", ""),
    "plant.talocrural_angle_at_contact": ("talocrural angle at contact, + dorsiflexion", "deg"),
    "plant.subtalar_angle_at_contact": ("subtalar angle at contact, + supination", "deg"),
    "subject.stature": ("stature", "m"),
    "subject.mass": ("body mass", "kg"),
    "subject.sex": ("sex, 0 woman, 1 man", ""),
    "subject.foot_length": ("foot length", "m"),
    "subject.foot_breadth": ("foot breadth", "m"),
    "subject.lateral_malleolus_height": ("height of the lateral malleolus", "m"),
    "subject.lateral_epicondyle_height": ("height of the lateral epicondyle", "m"),
    "subject.trochanterion_height": ("height of the trochanter", "m"),
    "subject.bicristal_breadth": ("breadth of the pelvis", "m"),
    "subject.cervicale_height": ("height of the neck (cervicale)", "m"),
    "controller.coactivation": ("co-activation", ""),
    "controller.reflex_gain": ("reflex gain", ""),
    "controller.reflex_delay": ("reflex delay", "ms"),
    "brace.angle_scale": ("brace angle scale", ""),
    "brace.torque_scale": ("brace torque scale", ""),
}
RESPONSES = {
    "peak_subtalar_angle_deg": "peak subtalar angle, + supination",
    "peak_subtalar_velocity_deg_s": "peak subtalar velocity, + supination",
    "peak_talocrural_angle_deg": "peak talocrural angle, + dorsiflexion",
    "peak_inversion_from_neutral_deg": "peak inversion from neutral",
    "anatomy_subtalar_moment_Nm": "subtalar moment of the anatomy at the peak, + resists supination",
    "anatomy_jcs_inversion_moment_Nm": "inversion moment of the anatomy at the peak, + resists inversion",
    "brace_subtalar_moment_Nm": "subtalar moment of the brace at the peak, + resists supination",
    "peak_vertical_grf_after_impact_N": "peak vertical ground reaction after 5 ms, + up",
}
P = ParamSpec("P")


class SeriesLook(NamedTuple):
    """How a result is drawn wherever it stands: no two of twelve differ in colour alone.

    colour  of everything
    line    style of its lines
    dot     mark of its single points
    marked  whether its lines carry the mark as well, since another one has their style
    """

    colour: str
    line: Any
    dot: str
    marked: bool = False

    def along(self, n: int) -> dict[str, Any]:
        """What matplotlib draws a line through `n` points with."""
        marks: dict[str, Any] = {}
        if self.marked:
            step = max(1, n // MARKS)
            marks = dict(marker=self.dot, markersize=3.2, markevery=(min(n - 1, step // 2), step))
        return dict(color=self.colour, linestyle=self.line) | marks

    def key(self, **options: Any) -> Line2D:
        """The line of a legend."""
        marks: dict[str, Any] = dict(marker=self.dot, markersize=3.2) if self.marked else {}
        return legend_line(self.colour, self.line, **(marks | options))


@dataclass(frozen=True)
class Form:
    """What a reader wants of all figures of one call.

    width     of a figure [cm]
    screen    larger letters and thicker lines, for slides and pages; else as a journal prints it
    panels    letters on the panels
    palette   {title: its look}, for titles that should look the same in all of them
    """

    width: float = SINGLE
    screen: bool = False
    panels: bool = False
    palette: Mapping[str, SeriesLook] = field(default_factory=dict)

    @property
    def scale(self) -> float:
        """How much larger letters, lines and panels are than in a journal."""
        return 1.4 if self.screen else 1.0

    def letters_in(self, single: int) -> int:
        """How many letters stand side by side where a single column of a journal has `single`."""
        return int(single * self.width / SINGLE / self.scale)


JOURNAL_COLUMN = Form()
FORM: ContextVar[Form] = ContextVar("FORM", default=JOURNAL_COLUMN)


def small() -> float:
    """Size of the letters of notes and ticks [points]."""
    return SMALL * FORM.get().scale


def large() -> float:
    """Size of the letters of titles and axes [points]."""
    return NORMAL * FORM.get().scale


def _style() -> Any:
    """What matplotlib is told, in the present form."""
    scale, sizes = FORM.get().scale, (".size", "size", "linewidth", "width", "pad", "markersize")
    grown = {key: scale * value for key, value in JOURNAL.items() if key.endswith(sizes) and isinstance(value, float)}
    found: Any = JOURNAL | grown
    return found


@contextmanager
def drawn_as(form: Form) -> Iterator[None]:
    """Figures that are drawn inside are of this form."""
    token = FORM.set(form)
    try:
        yield
    finally:
        FORM.reset(token)


def styled(draw: Callable[P, Figure]) -> Callable[P, Figure]:
    """Draws in this style, whatever matplotlib's settings are outside."""

    def laid_out(style: Any, *args: P.args, **kwargs: P.kwargs) -> Figure:
        with rc_context(style):
            figure = draw(*args, **kwargs)
            if FORM.get().panels and figure.get_label() != MATRIX:
                _letter_panels(figure)
            _grow_marks(figure)
            for text in figure.findobj(Text):
                assert isinstance(text, Text)
                if (shown := visible(text.get_text())) != text.get_text():
                    text.set_text(shown)
            if (layout := figure.get_layout_engine()) is not None:
                layout.execute(figure)
        return figure

    @wraps(draw)
    def inside(*args: P.args, **kwargs: P.kwargs) -> Figure:
        figure = laid_out(_style(), *args, **kwargs)
        if any(axis.yaxis.get_offset_text().get_text() for axis in figure.axes):  # "1e−6", where the title stands
            figure = laid_out(_style() | {"axes.titley": None}, *args, **kwargs)
        figure.set_layout_engine(
            "none"
        )  # laid out once, and rounded, so that every file of the figure is the same to the byte
        for axis in figure.axes:
            left, bottom, width, height = (round(float(edge), 5) for edge in axis.get_position().bounds)
            axis.set_position((left, bottom, width, height))
        return figure

    return inside


def _grow_marks(figure: Figure) -> None:
    """Marks and lines whose size a figure states itself, where letters are larger than a journal's."""
    scale, usual = FORM.get().scale, _style()
    handles = [handle for legend in figure.legends for handle in legend.legend_handles]
    for line in [*(line for axis in figure.axes for line in axis.lines), *handles] if scale != 1.0 else ():
        if isinstance(line, Line2D):
            if line.get_markersize() != usual["lines.markersize"]:
                line.set_markersize(scale * line.get_markersize())
            if line.get_linewidth() != usual["lines.linewidth"]:
                line.set_linewidth(scale * line.get_linewidth())


def _letter_panels(figure: Figure) -> None:
    """A, B, C before the title of each panel, with room for it where there was no title."""
    bare = [axis for axis in figure.axes if not axis.get_title(loc="left")]
    rows = {spec.rowspan.start for axis in bare if (spec := axis.get_subplotspec()) is not None}
    grow(figure, 0.45 * len(rows))
    for letter, axis in zip(ascii_uppercase, figure.axes, strict=False):
        title = axis.get_title(loc="left")
        axis.set_title(f"{letter}   {title}".rstrip(), loc="left", fontweight="normal" if title else "bold")


def sheet(heights: Sequence[float], note: str = "", columns: int = 1, **options: Any) -> tuple[Figure, list[Axes]]:
    """A figure with one row of `columns` panels of each of the `heights` [cm], and a `note` below."""
    form = FORM.get()
    lines = textwrap.wrap(note, form.letters_in(62))
    taller = min(1.3, max(1.0, form.width / form.scale / SINGLE) ** 0.5)  # a wide panel is a little taller
    total = taller * sum(heights) + 0.35 * len(lines) + 0.3
    figure = Figure(
        figsize=(form.width / 2.54, form.scale * total / 2.54),
        layout=ConstrainedLayoutEngine(
            w_pad=0.03, h_pad=0.03, hspace=0.02, rect=(0, 0, 1 - MARGIN * form.scale / form.width, 1)
        ),
    )
    FigureCanvasAgg(figure)
    axes = figure.subplots(len(heights), columns, squeeze=False, height_ratios=list(heights), **options)
    if note:
        figure.supxlabel("\n".join(lines), color=MUTED, fontsize=small(), ha="left", x=0.01)
    return figure, list(axes.flat)


def grow(figure: Figure, centimetres: float) -> None:
    """Room for what lies outside the panels, such as a legend."""
    width, height = figure.get_size_inches()
    figure.set_size_inches(width, height + FORM.get().scale * centimetres / 2.54)


def legend_above(figure: Figure, entries: Sequence[tuple[Any, str]], columns: int = 1) -> None:
    """A legend over all panels; long names are broken."""
    room = FORM.get().letters_in(52 if columns == 1 else 24)
    names = [
        textwrap.fill(shorten(name, LONGEST).replace(" %", "\u00a0%"), room, break_on_hyphens=False)
        for _, name in entries
    ]
    figure.legend([handle for handle, _ in entries], names, loc="outside upper left", ncols=columns)
    rows = [sum(n.count("\n") + 1 for n in names[k::columns]) for k in range(columns)]
    grow(figure, 0.33 * max(rows, default=0) + 0.1)


def looks(count: int, first: int = 0) -> list[SeriesLook]:
    """Of each of `count` series, from the `first` place of line styles on: colours, line styles and marks in turn, the
    marks on the lines once every line style is taken."""
    places = range(first, first + count)
    return [
        SeriesLook(SERIES[(k - first) % len(SERIES)], LINES[k % len(LINES)], DOTS[k % len(DOTS)], k >= len(LINES))
        for k in places
    ]


def palette(names: Sequence[str], unbraced: Collection[str] = ()) -> dict[str, SeriesLook]:
    """{name: its look}: UNBRACED for those without a brace, the series' colours in turn for the others. The one place
    where a result gets its colour: figures, page, film and the landing to turn take it from here."""
    bare = [name for name in names if name in unbraced]
    rest = [name for name in names if name not in unbraced]
    found = {n: look._replace(colour=UNBRACED) for n, look in zip(bare, looks(len(bare)), strict=True)}
    return found | dict(zip(rest, looks(len(rest), len(bare)), strict=True))


def looks_of(titles: Sequence[str]) -> list[SeriesLook]:
    """Of each title as the form's palette has it; in turn where it does not."""
    known = FORM.get().palette
    return [known.get(title, look) for title, look in zip(titles, looks(len(titles)), strict=True)]


def letters(colour: str) -> str:
    """The colour for text: as dark as text on white has to be (CONTRAST, as WCAG 2.2 counts it)."""
    rgb = np.array(to_rgb(colour))
    while 1.05 / (0.05 + _luminance(rgb)) < CONTRAST:
        rgb = 0.96 * rgb
    return str(to_hex(tuple(rgb)))


def _luminance(rgb: Any) -> float:
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.2126, 0.7152, 0.0722])


def legend_line(color: Any, style: Any = "-", **options: Any) -> Line2D:
    """A line for a legend."""
    return Line2D([], [], color=color, linestyle=style, **({"solid_capstyle": "butt"} | options))


def band_above(axis: Axes, share: float) -> None:
    """Leaves `share` of the panel free above the data, for words."""
    low, high = axis.get_ylim()
    axis.set_ylim(low, high + share * (high - low))


def shorten(text: str, length: int = 60) -> str:
    """At most so many letters, ended with an ellipsis behind a word, or inside one that is long."""
    if len(text) <= length:
        return text
    kept = text[:length].rpartition(" ")[0]
    return (kept if 2 * len(kept) >= length else text[: length - 1]).rstrip(" ,;:·-") + "…"


def title_lines(title: str, single: int) -> list[str]:
    """A title of a row in lines of as many letters as stand side by side where a single column has `single`."""
    return textwrap.wrap(shorten(title, LONGEST), FORM.get().letters_in(single), break_on_hyphens=False) or [""]


def lines_of(text: str, room: float, size: float, weight: str = "normal", most: int = 2) -> list[str]:
    """The text in lines no wider than `room` [points] at a font size, `most` of them, the last one ended with an
    ellipsis where that does not hold all; a word that is too long is broken behind an underscore."""

    def fits(line: str) -> bool:
        return text_width(line, size, weight) <= room

    words, lines = text.split(), list[str]()
    while words and len(lines) < most:
        taken = next((k for k in range(len(words), 0, -1) if fits(" ".join(words[:k]))), 0)
        parts = [place.end() for place in re.finditer("_", words[0])] if not taken and len(lines) < most - 1 else []
        if (cut := next((at for at in reversed(parts) if fits(words[0][:at])), 0)) > 0:
            lines.append(words[0][:cut])
            words[0] = words[0][cut:]
            continue
        if (len(lines) == most - 1 and taken < len(words)) or not taken:
            whole = " ".join(words)
            cut = next((n for n in range(len(whole), 1, -1) if fits(shorten(whole, n))), 1)
            lines.append(shorten(whole, cut))
            break
        lines.append(" ".join(words[:taken]))
        words = words[taken:]
    return lines


def text_width(line: str, size: float, weight: str = "normal") -> float:
    """Of a line of letters [points]."""
    font = FontProperties(size=size, weight=weight)
    return float(TextToPath().get_text_width_height_descent(line, font, False)[0])


def width_of(figure: Figure) -> float:
    """[points]"""
    return 72.0 * float(figure.get_figwidth())


def in_two(name: str, most: int = 16) -> str:
    """A name beside its row, in two lines of `most` letters where one does not hold it, broken behind a blank or an
    underscore where there is one. Of a longer one the beginning and the end: names of a series differ at their ends."""
    if len(name) <= most:
        return name
    breaks = [place.end() for place in re.finditer(r"[\s_-]+", name)]
    first = max((at for at in breaks if at <= most), default=most)
    if len(name) - first <= most:
        return f"{name[:first].rstrip()}\n{name[first:]}"
    last = next((at for at in breaks if 0 < len(name) - at <= most), len(name) - most)
    return f"{name[: most - 1].rstrip()}…\n{name[last:]}"


def label(name: str) -> str:
    """The name of a parameter or response as a reader knows it, without its unit."""
    if name in RESPONSES:
        return RESPONSES[name]
    if name in PARAMETERS:
        return PARAMETERS[name][0]
    return (
        re.sub(r"_(deg_s|deg|Nm|N|J|s)$", "", name)
        .replace("jcs", "JCS")
        .replace("grf", "ground reaction")
        .replace("_", " ")
    )


FLOOR = 1e-5  # the smallest probability that a logarithmic axis shows


def on_axis(probability: float, mark: Any) -> tuple[float, Any]:
    """Where a probability is drawn on a logarithmic axis, and with which mark: one below FLOOR at the end of the axis,
    pointing beyond it."""
    return (probability, mark) if probability >= FLOOR else (FLOOR, CARETLEFT)


FORMATS = ("pdf", "svg", "png", "tiff")


def save(figure: Figure, target: Path, kinds: Sequence[str] = ("png", "svg")) -> list[Path]:
    """Writes `target`.KIND for each of the `kinds`, of FORMATS; the same figure gives the same bytes."""
    written = []
    for kind in kinds:
        written.append(target.with_name(f"{target.name}.{kind}"))
        write(written[-1], picture(figure, kind))
    return written


def picture(figure: Figure, kind: str = "svg") -> bytes:
    """The figure as a `kind` of file: letters stay letters in pdf and svg, png has 300 dots per inch, tiff 600."""
    undated: dict[str, Any] = {
        "svg": {"Date": None, "Creator": None},
        "pdf": {"CreationDate": None, "ModDate": None, "Creator": None, "Producer": None},
        "png": {"Software": None},
    }
    options: dict[str, Any] = {"pil_kwargs": {"compression": "tiff_lzw"}} if kind == "tiff" else {}
    if kind in undated:
        options["metadata"] = undated[kind]
    buffer = io.BytesIO()
    with rc_context(_style()):  # ticks are made while drawing
        if kind == "svg":  # the same bytes as by savefig, which draws twice
            FigureCanvasSVG(figure).print_svg(buffer, **options)  # type: ignore[no-untyped-call]
        else:
            figure.savefig(buffer, format=kind, dpi=600 if kind == "tiff" else 300, **options)
    return buffer.getvalue()
