"""Every command on the documentation pages and in the README runs as written."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

import pytest

from tests.docs_commands import ROOT, blocks, play

PAGES = sorted([ROOT / "README.md", *(ROOT / "docs").rglob("*.md")])
WITH_COMMANDS = [page for page in PAGES if any(b.commands for b in blocks(page))]
HEAVY = [page for page in WITH_COMMANDS if any(b.mark == "long" and b.commands for b in blocks(page))]


@pytest.fixture(scope="module")
def played(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[dict[Path, Future[int]]]:
    """The pages under test, two at a time: each is a story of its own in a folder of its own."""
    pages = [
        item.callspec.params["page"]
        for item in request.session.items
        if getattr(item, "function", None) is test_commands_of_a_page
    ]
    with ThreadPoolExecutor(2) as pool:
        yield {page: pool.submit(play, page, tmp_path_factory.mktemp(page.stem)) for page in pages}


@pytest.mark.parametrize("page", WITH_COMMANDS, ids=lambda p: p.name)
def test_commands_of_a_page(page: Path, played: dict[Path, Future[int]]) -> None:
    played[page].result()


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
    page.write_text(
        f"<!-- file: a.txt -->\n{fence}\nhello\n{fence}\n\n<!-- exit 2 -->\n{fence}sh\nsprain-cosim run \\\n  a.txt   "
        f"# no scenario\n{fence}\n"
    )
    assert play(page, tmp_path) == 1
    assert (tmp_path / "a.txt").read_text() == "hello\n"
    page.write_text(f"{fence}sh\nsprain-cosim run a.txt\n{fence}\n")
    with pytest.raises(AssertionError, match=r"page\.md:1: sprain-cosim run a\.txt: exit code 2, expected 0"):
        play(page, tmp_path)
    page.write_text(f"<!-- not run: -->\n{fence}sh\nrm -rf nothing\n{fence}\n")
    with pytest.raises(AssertionError, match="not a command of the project"):
        play(page, tmp_path)
