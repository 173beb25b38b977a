"""Text where the terminal or the pipe has no sign for it, such as on a Windows console of code page 437 or 1252."""

from __future__ import annotations

import codecs
import io
import re
import sys
import unicodedata

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
