"""What a page is made of, as plain data; templates/blocks.html draws each kind. Texts are escaped by the template; only
a `Markup`, made by `rich`, carries tags."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

from markupsafe import Markup

from ..folders.comparison import MeanEstimate
from ..units import percentage_ends, percentage_within


def rich(text: str, **values: Any) -> Markup:
    """The text, whose tags are ours, with `values` in it, which are escaped."""
    return Markup(text).format(**values)


@dataclass(frozen=True)
class Cell:
    """A cell of a table.

    text   in full size
    notes  one small line each below it
    name   small too, in the letters of code: what the text is called in files
    code   the text itself in the letters of code
    """

    text: str = ""
    notes: tuple[str, ...] = ()
    name: str = ""
    code: bool = False


Row = Sequence[str | Cell]


def probability_cell(e: MeanEstimate | None, shapes: tuple[float, float] | None) -> str | Cell:
    """A probability in percent, with what the landings leave open and what the shape of its threshold does."""
    if e is None or e.value is None:
        return ""
    return Cell(percentage_within(e.value, e.ci_low, e.ci_high), tuple(probability_doubts(e, shapes)))


def probability_doubts(e: MeanEstimate, shapes: tuple[float, float] | None) -> list[str]:
    """In percent, a text each: what the landings leave open of a probability, and what the shape of its threshold
    does."""
    doubts = [f"landings {line}" for line in percentage_ends(e.ci_low, e.ci_high)]
    return doubts + [f"threshold's shape {line}" for line in percentage_ends(*(shapes or (None, None)))]


@dataclass(frozen=True)
class PageTable:
    """`heads` may be empty texts throughout: then there is no head. `css` is the class of the table."""

    kind: ClassVar[str] = "table"
    heads: Sequence[str]
    rows: Sequence[Row]
    css: str = ""


@dataclass(frozen=True)
class Paragraph:
    """`css` "about" for what explains a table."""

    kind: ClassVar[str] = "paragraph"
    text: str | Markup
    css: str = ""


@dataclass(frozen=True)
class Heading:
    """A heading inside a section."""

    kind: ClassVar[str] = "heading"
    text: str


@dataclass(frozen=True)
class Verdict:
    """A sentence or more; `name` of the result that it is about; `warn` where something is wrong; `headline`, the
    answer in one line, above it."""

    kind: ClassVar[str] = "verdict"
    text: str | Markup
    name: str = ""
    warn: bool = False
    headline: str | Markup = ""


@dataclass(frozen=True)
class Folded:
    """Tables of several results under their names, the first open."""

    kind: ClassVar[str] = "folded"
    parts: Sequence[tuple[str, PageTable]]


@dataclass(frozen=True)
class Picture:
    """`data` is the content of the image, as base64; `media` its type; `name` may be empty."""

    title: str
    caption: str
    media: str
    data: str
    name: str = ""


@dataclass(frozen=True)
class Pictures:
    """Pictures side by side."""

    kind: ClassVar[str] = "pictures"
    pictures: Sequence[Picture]


@dataclass(frozen=True)
class Chart:
    """A place that chart.js draws in: `content` is what it reads."""

    kind: ClassVar[str] = "chart"
    content: Mapping[str, Any]


@dataclass(frozen=True)
class Bullets:
    """A list."""

    kind: ClassVar[str] = "bullets"
    lines: Sequence[str | Markup]


@dataclass(frozen=True)
class Download:
    """A table of `rows` lines under `name`, its content `data` as base64, in words `about`."""

    kind: ClassVar[str] = "download"
    name: str
    about: str
    rows: int
    data: str


@dataclass(frozen=True)
class Hero:
    """What is seen first: the answer in words, one figure, a landing to turn.

    frame    a picture of the landing, WebP as base64, for paper and for browsers that draw nothing; may be empty
    alt      what it shows
    missing  why there is no landing, and how to get one; empty where there is one
    """

    blocks: Sequence[Block]
    picture: Picture | None
    frame: str = ""
    alt: str = ""
    missing: str = ""


Block = PageTable | Paragraph | Heading | Verdict | Folded | Pictures | Chart | Bullets | Download


@dataclass(frozen=True)
class PageSection:
    """A part of the page with a heading; `key` is its anchor."""

    key: str
    title: str
    blocks: Sequence[Block] = field(default_factory=list)
