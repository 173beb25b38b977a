"""Every command in the documentation and the README names commands, options and values that the command line has, those
of blocks that are not run, that are no shell, or that run in the long tests only included; nothing is executed."""

from __future__ import annotations

import contextlib
import re
import shlex
from itertools import takewhile
from pathlib import Path

import click
import pytest

from sprain_cosim import __version__
from sprain_cosim.cli import cli
from tests.docs_commands import ROOT, blocks

PAGES = sorted([ROOT / "README.md", *(ROOT / "docs").rglob("*.md"), *(ROOT / "fmus").rglob("*.md")])


def documented(page: Path) -> list[tuple[int, list[str]]]:
    """(line of the block, words) of each call of sprain-cosim in a block of shell commands, or of plain text."""
    found = []
    for block in blocks(page):
        if block.language in ("sh", "bash", "text", ""):
            numbers = re.sub(r"\$\(\(.*?\)\)", "1", block.text)  # what the shell computes
            for line in re.sub(r"\\\n\s*", " ", numbers).splitlines():
                if re.match(r"\s*(\S*/)?sprain-cosim ", line):
                    found.append((block.line, shlex.split(line, comments=True)[1:]))
    return found


def parsed(words: list[str]) -> None:
    """Raises click's own error for a word that is not understood."""
    command: click.Command = cli
    with click.Context(cli) as context:
        while isinstance(command, click.Group) and words and not words[0].startswith("-"):
            _, found, words = command.resolve_command(context, words)
            assert found is not None
            command = found
        with contextlib.suppress(click.exceptions.Exit):  # --help, --version
            command.make_context(command.name, list(words), parent=context)


@pytest.mark.parametrize("page", [p for p in PAGES if documented(p)], ids=lambda p: str(p.relative_to(ROOT)))
def test_what_a_page_types_is_understood(page: Path) -> None:
    for line, words in documented(page):
        own = list(takewhile(lambda word: word not in ("|", ">", "&&", "&"), words))
        try:
            parsed(own)
        except click.ClickException as problem:
            raise AssertionError(f"{page.name}:{line}: {shlex.join(words)}: {problem.format_message()}") from None


def test_a_word_that_is_not_understood_is_seen() -> None:
    for words in (
        ["ran", "incline30"],
        ["run", "incline30", "--steps", "1 ms"],
        ["study", "study6", "--trials", "few"],
    ):
        with pytest.raises(click.ClickException):
            parsed(words)
    parsed(["brace", "new", "my_brace", "--lang", "c"])


def test_the_workflow_types_what_there_is() -> None:
    """Commands, and targets of the Makefile, of the public CI, which no test can run."""
    lines = re.findall(
        r"^      - run: (.+?)(?: # .*)?$", (ROOT / ".github/workflows/tests.yml").read_text("utf-8"), re.M
    )
    commands = [shlex.split(line) for line in lines]
    targets = set(re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text("utf-8"), re.M))
    for program, *words in commands:
        if program == "sprain-cosim":
            parsed(words)
        elif program == "make":
            assert set(words) <= targets
    assert {"make", "sprain-cosim"} <= {program for program, *_ in commands}


def test_the_citation_names_this_version() -> None:
    assert f"\nversion: {__version__}\n" in (ROOT / "CITATION.cff").read_text("utf-8")
