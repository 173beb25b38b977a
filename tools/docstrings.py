"""Docstrings as the Python reference shows them: lists of fields become tables. An extension of griffe (mkdocs.yml)."""

from __future__ import annotations

import html
import re
from typing import Any

import griffe

FIELD = re.compile(r"(\S.*?)\s{2,}(\S.*)")


class Docstrings(griffe.Extension):
    """Runs over every object of the package."""

    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:
        if obj.docstring is not None:
            obj.docstring.value = as_markdown(obj.docstring.value)


def as_markdown(text: str) -> str:
    return "\n\n".join(_paragraph(part.strip("\n")) for part in re.split(r"\n\s*\n", text))


def _paragraph(part: str) -> str:
    lines = part.split("\n")
    rows: list[list[str]] = []
    for line in lines:
        field = FIELD.fullmatch(line)
        if field and not line.startswith(" "):
            rows.append([field[1], field[2]])
        elif rows and line.startswith("  "):  # goes on below the meaning
            rows[-1][1] += f" {line.strip()}"
        else:
            return part
    cells = [f"| {html.escape(name, quote=False)} | {_cell(meaning)} |" for name, meaning in rows]
    return "\n".join(["| Name | Meaning |", "|---|---|", *cells])


def _cell(text: str) -> str:
    return html.escape(text, quote=False).replace("|", "&#124;")
