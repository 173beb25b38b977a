"""What a terminal shows: signs that it has, lines within its width, colours where it takes them."""

from __future__ import annotations

import codecs
import io
import itertools
import os
import re
import sys
import textwrap
import unicodedata
from collections.abc import Sequence
from typing import Any, TextIO

NAME = "sprain-cosim"
RAISED = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻⁺", "0123456789-+")
RAISED_RUN = re.compile("[⁰¹²³⁴⁵⁶⁷⁸⁹⁻⁺]+")
PLAIN = {
    **{
        "°": " deg",
        "’": "'",
        "′": "'",
        "″": '"',
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
    **{"“": '"', "”": '"', "─": "-", "│": "|", "├": "+", "└": "+", "•": "*", "●": "*", "、": ",", "\xa0": " "},
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
USUAL = 80
CELLS = re.compile(r"\S {2,}\S|^ {8,}\S")  # in a line of a table
COPIED = ("next:", "written:", "continue with:", "{", "[")  # a line that is copied or read by a program
COLOURS = {"error:": "red", "problem": "red", "warning:": "yellow", "next:": "green"}
ATTENTION = re.compile(rf"^ *(?:{'|'.join(COLOURS)})(?=\s)", re.MULTILINE)
READABLE = 28  # the least width of a column of running text


def width(stream: TextIO | None = None) -> int | None:
    """Columns of the terminal that `stream` (default stdout) goes to; None for a pipe or a file, whose lines are as
    long as they need."""
    stream = sys.stdout if stream is None else stream
    try:
        if stream is None or not stream.isatty():
            return None
        columns = int(os.environ.get("COLUMNS") or os.get_terminal_size(stream.fileno()).columns)
    except (OSError, ValueError):
        return USUAL
    return max(20, columns or USUAL)


def coloured(text: str, columns: int | None) -> str:
    """The first word of a line that asks for attention in colour; as it is in a pipe (`columns` None), where NO_COLOR
    is set, and on a terminal without colours."""
    if columns is None or os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb":
        return text
    import click

    return ATTENTION.sub(lambda word: click.style(word[0], fg=COLOURS[word[0].strip()], bold=True), text)


def fitted(text: str, columns: int | None) -> str:
    """A listing within that many columns (None: as it is). A table that is too wide is divided: the first column again
    with the columns that had no room; single lines that are too long go on below. Commands, paths and JSON stay whole,
    for they are copied."""
    if columns is None or all(len(line) <= columns for line in text.split("\n")):
        return text
    lines = list[str]()
    for of_table, run in itertools.groupby(text.split("\n"), lambda line: bool(CELLS.search(line))):
        lines += (_divided if of_table else _all_folded)(list(run), columns)
    return "\n".join(lines)


def _divided(table: list[str], columns: int) -> list[str]:
    """Aligned lines, divided between columns where half of them or more are too long."""
    if len(table) < 2 or 2 * sum(len(line) > columns for line in table) < len(table):
        return _all_folded(table, columns)
    longest = max(map(len, table))
    blank = "".join(" " if all(line[k : k + 1] in (" ", "") for line in table) else "x" for k in range(longest))
    spans = [cell.span() for cell in re.finditer(r"^ *\S+(?: \S+)*|\S+(?: \S+)*", blank)]
    parts = [[spans[0]]]
    for span in spans[1:]:
        if len(parts[-1]) > 1 and sum(end - start + GAP for start, end in (*parts[-1], span)) - GAP > columns:
            parts.append([spans[0]])
        parts[-1].append(span)
    return [row for part in parts for k, line in enumerate(table) for row in _cut(line, part, columns, k == 0)]


def _cut(line: str, part: Sequence[tuple[int, int]], columns: int, head: bool) -> list[str]:
    """The cells of a line within a part of the table; none where only its name is left, unless it is the head."""
    name, *cells = [f"{line[start:end]:{end - start}}" for start, end in part]
    rest = (" " * GAP).join(cells).rstrip()
    if not rest.strip() and not head and name.strip() != line.strip():
        return []
    whole = f"{name}{' ' * GAP}{rest}".rstrip()
    if len(whole) <= columns or columns - _hanging(whole) >= READABLE:
        return _folded(whole, columns)
    return _all_folded([name.rstrip(), *([f"    {rest.strip()}"] if rest.strip() else [])], columns)


def _all_folded(lines: list[str], columns: int) -> list[str]:
    return [part for line in lines for part in _folded(line, columns)]


def _folded(line: str, columns: int) -> list[str]:
    if len(line) <= columns or line.startswith(COPIED):
        return [line]
    hanging = _hanging(line)
    indent = " " * (hanging if columns - hanging >= READABLE else len(line) - len(line.lstrip()) + 4)
    return _words_wrapped(line, columns, subsequent_indent=indent, break_long_words=False)


def _words_wrapped(text: str, columns: int, **options: Any) -> list[str]:
    """In lines within that many columns, "150 %" in one of them."""
    lines = textwrap.wrap(text.replace(" %", "\u00a0%"), columns, break_on_hyphens=False, **options)
    return [line.replace("\u00a0%", " %") for line in lines]


def _hanging(line: str) -> int:
    """Where a line goes on: under its last cell, or a little to the right of its beginning."""
    cell = re.match(r".*\S {2,}(?=\S)", line)
    return cell.end() if cell else len(line) - len(line.lstrip()) + 4


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
    texts = [row[-1]] if room is None else _words_wrapped(row[-1], room) or [""]
    first = "".join(f"{cell:{size + GAP}}" for cell, size in zip(row[:-1], sizes, strict=True))
    return [(first + texts[0]).rstrip(), *(indent + text for text in texts[1:])]


def _wrapped(text: str, columns: int, indent: str) -> list[str]:
    return _words_wrapped(text, columns, initial_indent=indent, subsequent_indent=indent)
