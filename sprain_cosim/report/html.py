"""Pages from templates. The engine escapes every text that is put in, and control characters are shown; a name that a
template lacks is an error."""

from __future__ import annotations

from functools import cache
from importlib import resources
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from ..errors import visible

LONG, PIECE = 24, 12  # letters of a word, and of its parts


@cache
def _environment() -> Environment:
    engine = Environment(
        loader=PackageLoader("sprain_cosim.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    engine.globals["style"] = asset("style.css")
    engine.filters["breakable"] = breakable
    return engine


def breakable(text: str) -> Markup:
    """A text in which words that are longer than a column of a table may break."""
    words = (
        Markup("<wbr>").join(word[k : k + PIECE] for k in range(0, len(word), PIECE)) if len(word) > LONG else word
        for word in str(text).split(" ")
    )
    return Markup(" ").join(words)


def asset(name: str) -> Markup:
    """A file of this package that goes into a page as it is."""
    return Markup((resources.files(__package__) / name).read_text("utf-8"))


def render(template: str, **values: Any) -> str:
    """The page that a template of templates/ makes of `values`."""
    return visible(_environment().get_template(template).render(values))
