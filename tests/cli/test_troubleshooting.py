"""The page on troubleshooting quotes messages that the program has: `…` stands for what differs from case to case."""

from __future__ import annotations

import ast
import re

import pytest

from tests.docs_commands import PACKAGE, ROOT

PAGE = ROOT / "docs" / "troubleshooting.md"
CODE = re.compile(r"(`+) ?(.+?) ?\1")


def quoted() -> list[str]:
    """The first cell of every row of the tables whose head is `Message`."""
    found, inside = [], False
    for line in PAGE.read_text("utf-8").splitlines():
        if not line.startswith("|"):
            inside = False
        elif line.startswith("| Message |"):
            inside = True
        elif inside and not line.startswith("|---"):
            match = CODE.match(line.removeprefix("| "))
            assert match, line
            found.append(match[2])
    return found


@pytest.fixture(scope="module")
def texts() -> str:
    """All texts of the code with `…` in place of what is put in, one a line."""
    return "\n".join(
        text
        for file in PACKAGE.rglob("*.py")
        for node in ast.walk(ast.parse(file.read_text("utf-8")))
        if (text := _text(node))
    )


def _text(node: ast.AST) -> str:
    if isinstance(node, ast.JoinedStr):
        return "".join(str(part.value) if isinstance(part, ast.Constant) else "…" for part in node.values)
    return node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else ""


def test_there_are_messages() -> None:
    assert len(quoted()) > 40
    assert len(set(quoted())) == len(quoted())


@pytest.mark.parametrize("message", quoted())
def test_a_message_of_the_page_is_one_of_the_program(message: str, texts: str) -> None:
    assert len(message.replace("…", "").split()) >= 4, "too short to be told apart"
    assert message in texts
