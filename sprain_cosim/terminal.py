"""Text where the terminal or the pipe has no sign for it, such as on a Windows console of code page 437 or 1252."""

from __future__ import annotations

import codecs
import io
import os
import re
import shutil
import sys
import textwrap
import unicodedata
from collections.abc import Sequence

NAME = "sprain-cosim"
RAISED = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻⁺", "0123456789-+")
RAISED_RUN = re.compile("[⁰¹²³⁴⁵⁶⁷⁸⁹⁻⁺]+")
PLAIN = {
    **{
        "°": " deg",
        "·": ".",
        "⋅": ".",
        "∙": ".",
        "−": "-",
        "–": "-",
        "±": "+/-",
        "∓": "-/+",
        "…": "...",
        "×": "x",
        "⁄": "/",
        "∕": "/",
        "√": "sqrt",
    },
    **{"≤": "<=", "≥": ">=", "≈": "~", "→": "->", "←": "<-", "↑": "^", "∂": "d", "∇": "grad", "‖": "||", "µ": "u"},
    **{"“": '"', "”": '"', "─": "-", "│": "|", "├": "+", "└": "+", "•": "*", "●": "*", "\xa0": " "},
}


def make_readable() -> None:
    """What the streams of this process cannot encode goes out in plain letters from here on; never an error, never a
    mark in the place of a sign that has a name."""
    codecs.register_error(NAME, replacement)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=NAME)


def replacement(problem: UnicodeError) -> tuple[str, int]:
    """The handler of encoding errors, see codecs.register_error."""
    assert isinstance(problem, UnicodeEncodeError)
    text = RAISED_RUN.sub(lambda run: f"^{run[0].translate(RAISED)}", problem.object[problem.start : problem.end])
    return "".join(map(_plain, text)), problem.end


def _plain(sign: str) -> str:
    if sign.isascii():
        return sign
    if sign in PLAIN:
        return PLAIN[sign]
    name = unicodedata.name(sign, "")
    if name.startswith("GREEK ") and " LETTER " in name:
        word = name.rpartition(" LETTER ")[2].partition(" ")[0]
        return word.lower() if "SMALL" in name else word.capitalize()
    letters = "".join(c for c in unicodedata.normalize("NFKD", sign) if c.isascii())
    return letters or "?"


GAP = 2  # blanks between two columns
READABLE = 28  # the least width of a column of running text


def width() -> int | None:
    """Columns of the terminal that stdout goes to, or as COLUMNS says; None for a pipe or a file, whose lines are as
    long as they need."""
    if not (sys.stdout is not None and sys.stdout.isatty()) and not os.environ.get("COLUMNS"):
        return None
    return max(20, shutil.get_terminal_size().columns)


def fitted_table(head: Sequence[str], rows: Sequence[Sequence[str]], columns: int | None) -> str:
    """Rows under their heads within that many `columns` (None: one line a row). The last column is running text; where
    it has no room beside the others it goes under them, and where these have none every cell stands under the first,
    behind its head."""
    sizes = [max(map(len, cells)) for cells in zip(head, *rows, strict=True)][:-1]
    taken = sum(sizes) + GAP * len(sizes)
    room = None if columns is None else columns - taken
    if room is None or room >= min(READABLE, max(len(row[-1]) for row in rows)):
        return "\n".join(line for row in (head, *rows) for line in _line(row, sizes, " " * taken, room))
    assert columns is not None
    if taken <= columns:
        return "\n".join(
            line
            for row in (head, *rows)
            for line in (*_line((*row[:-1], ""), sizes, "", None), *_wrapped(row[-1], columns, "    "))
        )
    return "\n".join(
        line
        for row in rows
        for line in (
            row[0],
            *_wrapped(", ".join(f"{h} {c}" for h, c in zip(head[1:-1], row[1:-1], strict=True) if c), columns, "    "),
            *_wrapped(row[-1], columns, "    "),
        )
    )


def _line(row: Sequence[str], sizes: Sequence[int], indent: str, room: int | None) -> list[str]:
    texts = [row[-1]] if room is None else textwrap.wrap(row[-1], room, break_on_hyphens=False) or [""]
    first = "".join(f"{cell:{size + GAP}}" for cell, size in zip(row[:-1], sizes, strict=True))
    return [(first + texts[0]).rstrip(), *(indent + text for text in texts[1:])]


def _wrapped(text: str, columns: int, indent: str) -> list[str]:
    return textwrap.wrap(text, columns, initial_indent=indent, subsequent_indent=indent, break_on_hyphens=False)
