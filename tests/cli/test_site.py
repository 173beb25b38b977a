"""The documentation site builds without a warning, asks no other server for anything, and holds every command and
equation."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from sprain_cosim.cli import cli
from tests.docs_commands import ROOT
from tools.schemas import FILES

pytest.importorskip("mkdocs", reason="the extra [docs] is not installed")


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)]
    built = subprocess.run(
        command,
        cwd=ROOT,
        env={**os.environ, "NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert built.returncode == 0, built.stderr
    assert "WARNING" not in built.stderr
    return folder


def test_no_page_loads_from_another_server(site: Path) -> None:
    for page in site.rglob("*.html"):
        loaded = re.findall(r'(?:src|<link[^>]+href)="(https?://[^"]+)"', page.read_text("utf-8"))
        assert not [url for url in loaded if "rel=canonical" not in url], page


def test_equations_are_mathml(site: Path) -> None:
    pages = list((site / "theory").glob("*.html"))
    assert len(pages) >= 5
    for page in pages:
        text = page.read_text("utf-8")
        assert "<math" in text, page
        assert "arithmatex" not in text, page
        assert not re.findall(r"<m[a-z]+>\\[^<]*", text), "TeX that the converter does not know"


def test_every_command_is_in_the_reference(site: Path) -> None:
    text = (site / "reference" / "commands.html").read_text("utf-8")
    for name, command in cli.commands.items():
        assert f"sprain-cosim {name}" in text
        for parameter in command.params:
            for option in parameter.opts:
                assert option in text or not option.startswith("--"), (name, option)


def test_public_names_are_in_the_reference(site: Path) -> None:
    import sprain_cosim

    text = (site / "reference" / "api.html").read_text("utf-8")
    missing = [name for name in sprain_cosim.__all__ if not name.startswith("_") and name not in text]
    assert not missing


def test_every_key_of_a_file_is_in_the_reference(site: Path) -> None:
    text = (site / "reference" / "files.html").read_text("utf-8")
    assert "<!-- files -->" not in text
    for file in FILES:
        for key in file.table.names:
            assert f"<code>{key}" in text, key
