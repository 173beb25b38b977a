"""Every command on the documentation pages and in the README runs as written."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.docs_commands import ROOT, blocks, play

PAGES = sorted([ROOT / "README.md", *(ROOT / "docs").rglob("*.md")])
WITH_COMMANDS = [page for page in PAGES if any(b.commands for b in blocks(page))]
HEAVY = [page for page in WITH_COMMANDS if any(b.mark == "long" and b.commands for b in blocks(page))]


@pytest.mark.parametrize("page", WITH_COMMANDS, ids=lambda p: p.name)
def test_commands_of_a_page(page: Path, tmp_path: Path) -> None:
    play(page, tmp_path)


@pytest.mark.long
@pytest.mark.parametrize("page", HEAVY, ids=lambda p: p.name)
def test_commands_of_a_page_with_the_long_ones(page: Path, tmp_path: Path) -> None:
    play(page, tmp_path, long=True)


def test_the_first_minute_has_commands() -> None:
    assert ROOT / "README.md" in WITH_COMMANDS


def test_marks_and_failures(tmp_path: Path) -> None:
    """A wrong exit code, an unknown program and a mark without a reason are seen."""
    page = tmp_path / "page.md"
    fence = "`" * 3
    page.write_text(f"<!-- file: a.txt -->\n{fence}\nhello\n{fence}\n\n<!-- exit 2 -->\n{fence}sh\nsprain-cosim run \\\n  a.txt   # no scenario\n{fence}\n")
    assert play(page, tmp_path) == 1
    assert (tmp_path / "a.txt").read_text() == "hello\n"
    page.write_text(f"{fence}sh\nsprain-cosim run a.txt\n{fence}\n")
    with pytest.raises(AssertionError, match=r"page\.md:1: sprain-cosim run a\.txt: exit code 2, expected 0"):
        play(page, tmp_path)
    page.write_text(f"<!-- not run: -->\n{fence}sh\nrm -rf nothing\n{fence}\n")
    with pytest.raises(AssertionError, match="not a command of the project"):
        play(page, tmp_path)
