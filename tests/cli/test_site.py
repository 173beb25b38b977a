"""The documentation site builds without a warning (links and anchors included), asks no other server for anything,
holds every command, parameter, response and equation, can be searched when it is opened from the disk, and fits a
phone."""

from __future__ import annotations

import html
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from sprain_cosim.catalogue import catalogue, parameters_of
from sprain_cosim.cli import cli
from sprain_cosim.scenario import load_scenario
from tests.docs_commands import ROOT, blocks
from tools.notebooks import CHOSEN
from tools.schemas import FILES

pytest.importorskip("mkdocs", reason="the extra [docs] is not installed")
CHROMIUM = next((p for n in ("chromium", "chromium-browser", "google-chrome") if (p := shutil.which(n))), None)
BESIDE = sorted([*ROOT.glob("*.md"), *(ROOT / "fmus").rglob("*.md")])  # pages that are not part of the site
# shows every page in a frame of a phone's width
LOOK = """<!doctype html><iframe style="width:390px;height:900px;border:0"></iframe><pre id="found"></pre><script>
const frame = document.querySelector("iframe"), wide = [];
(async () => {
  for (const page of %s) {
    await new Promise((done) => { frame.onload = done; frame.src = page; });
    const shown = frame.contentDocument, of = shown.documentElement;
    if (!shown.querySelector("h1") || of.scrollWidth > frame.clientWidth) wide.push(page);
  }
  document.getElementById("found").textContent = "wide: " + wide.join(" ");
})();
</script>"""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)]
    built = subprocess.run(
        command,
        cwd=ROOT,
        env={**os.environ, "NO_MKDOCS_2_WARNING": "1", CHOSEN: "first-landing"},
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
        assert "wbr" not in "".join(re.findall(r"<math.*?</math>", text, re.DOTALL)), page
        assert not re.search(r"</math>[,.;:?)\]]+(?!</span>|[,.;:?)\]])", text), "a line may begin with a comma"


def test_pages_are_made_for_a_phone_too(site: Path) -> None:
    """A table with sentences is read row by row, one of numbers beside its names; options stay whole, links inside
    tables too; formulas may stand below each other; a figure opens in its own size."""
    names = (site / "reference" / "names.html").read_text("utf-8")
    assert '<table data-shape="rows">' in names
    assert '<td data-head="Meaning">' in names
    assert '<table data-shape="numbers">' in (site / "validation.html").read_text("utf-8")
    assert '<span class="option">--trials</span>' in (site / "study.html").read_text("utf-8")
    assert 'href="brace-contract.html#axes-and-signs"' in (site / "index.html").read_text("utf-8")
    assert (site / "theory" / "jcs.html").read_text("utf-8").count('<div class="formulas">') == 3
    hour = (site / "first-hour.html").read_text("utf-8")
    assert '<a href="figures/landing.png" title=' in hour
    printed = re.search(r'<code style="--narrow: (\d+)">(.*?subtalar supination.*?)</code>', hour, re.DOTALL)
    assert printed and int(printed[1]) < 60
    assert re.search(r'<span class="sentence">30° slope, no brace.* wall time</span>', printed[2])
    assert re.search(r'<span class="sentence">doubt of the step .* at half the step</span>', printed[2])
    commands = (site / "reference" / "commands.html").read_text("utf-8")
    assert "[coordinates|<wbr>states|<wbr>forces" in commands and "P(peak_<wbr>inversion_<wbr>" in commands


@pytest.mark.parametrize("page", ["first-hour", "vendor-tutorial", "ci", "studies", "architecture"])
def test_what_a_program_printed_is_shown_whole(page: str, site: Path) -> None:
    """The columns that a phone draws nearer to each other lose no letter."""
    shown = "".join(re.findall(r"<code[^>]*>(.*?)</code>", (site / f"{page}.html").read_text("utf-8"), re.DOTALL))
    text = html.unescape(re.sub(r"<[^>]+>", "", shown))
    for block in blocks(ROOT / "docs" / f"{page}.md"):
        if block.language in ("", "text"):
            assert block.text.rstrip() in text, block.text


def test_the_colours_follow_the_system_and_can_be_chosen(site: Path) -> None:
    text = (site / "index.html").read_text("utf-8")
    media = re.findall(r'data-md-color-media="([^"]*)"', text)
    assert media == ["(prefers-color-scheme)", "(prefers-color-scheme: light)", "(prefers-color-scheme: dark)"]
    assert len(re.findall(r'<label class="md-header__button[^"]*" title="[^"]+"', text)) == 3


def test_no_list_runs_on_as_a_paragraph(site: Path) -> None:
    """An item behind an indented paragraph needs an empty line before it."""
    for page in site.rglob("*.html"):
        for paragraph in re.findall(r"<p>(.*?)</p>", page.read_text("utf-8"), re.DOTALL):
            assert not re.search(r"\n\s*(-|\*|\d+\.) ", paragraph), (page.name, paragraph[:80])


def test_no_list_of_fields_runs_on_as_a_paragraph(site: Path) -> None:
    """Name and meaning of a docstring's fields are two blanks apart, also behind the longest name."""
    for paragraph in re.findall(r"<p>(.*?)</p>", (site / "reference" / "api.html").read_text("utf-8"), re.DOTALL):
        assert not re.search(r"^\S+ {2,}\S", paragraph, re.MULTILINE), paragraph[:80]


def test_a_line_that_would_not_fit_is_shown_in_smaller_letters(site: Path) -> None:
    """Output, programs and sessions say how wide they are; commands, settings and messages wrap."""
    shown = (site / "first-hour.html").read_text("utf-8")
    assert shown.count('<div class="language-text highlight" style="--columns: ') == 2
    assert "--columns: 98" in shown and 'language-sh highlight" style' not in shown


def test_a_notebook_is_shown_with_its_outputs(site: Path) -> None:
    """And the source beside it, without; the long tests run the others."""
    text = (site / "notebooks" / "first-landing.html").read_text("utf-8")
    assert "Result: completed" in text and "49.60 ±" in text and "plant.drop_height" in text
    assert "InputError: plant.drop_height = " in text and "scenario.py" not in text
    for picture in re.findall(r'src="(first-landing-\d.png)"', text):
        assert (site / "notebooks" / picture).read_bytes()[:4] == b"\x89PNG"
    assert text.count('class="shown"') >= 10
    assert 'href="how-sure.html"' in text and 'href="first-landing.ipynb"' in text
    assert (site / "notebooks" / "first-landing.ipynb").is_file()


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
    text = (site / "reference" / "files.html").read_text("utf-8").replace("<wbr>", "")
    assert "<!-- files -->" not in text
    for file in FILES:
        for key in file.table.names:
            assert f"<code>{key}" in text, key


def test_every_parameter_and_response_is_in_the_reference(site: Path) -> None:
    text = (site / "reference" / "names.html").read_text("utf-8").replace("<wbr>", "")
    bare = load_scenario("incline30")
    braced = [bare.replace_fmu("brace", record["name"]) for record in catalogue("braces")]
    for chosen in (bare.with_subject("female, 1.63 m, 62 kg"), *braced):
        for parameter in parameters_of(chosen):
            assert f"<code>{parameter.name}</code>" in text, parameter.name
            assert parameter.meaning, parameter.name
    for record in catalogue("responses"):
        assert f"<code>{record['name']}</code>" in text, record


@pytest.mark.parametrize("page", BESIDE, ids=lambda p: str(p.relative_to(ROOT)))
def test_links_of_a_page_beside_the_site(page: Path, site: Path) -> None:
    """Files exist, anchors of documentation pages too."""
    for link in re.findall(r"\]\(([^)\s]+)\)|(?:src|href)=\"([^\"]+)\"", page.read_text("utf-8")):
        target, _, anchor = (link[0] or link[1]).partition("#")
        if target and not target.startswith(("http:", "https:", "mailto:")):
            file = (page.parent / target).resolve()
            assert file.exists(), (page.name, target)
            if anchor and file.is_relative_to(ROOT / "docs"):
                built = (site / file.relative_to(ROOT / "docs")).with_suffix(".html").read_text("utf-8")
                assert f'id="{anchor}"' in built, (page.name, target, anchor)


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine; `make browser` installs it")
def test_search_from_the_disk(site: Path, tmp_path: Path) -> None:
    """A page that was opened as a file finds pages: no server, no worker, no other address."""
    page = (site / "theory" / "jcs.html").as_uri() + "?q=supination"
    shown = _shown(page, tmp_path, "--virtual-time-budget=8000")
    found = re.search(r"(\d+) matching documents", shown)
    assert found
    assert int(found[1]) >= 5


@pytest.mark.long
@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine; `make browser` installs it")
def test_no_page_scrolls_sideways_on_a_phone(site: Path, tmp_path: Path) -> None:
    pages = [path.relative_to(site).as_posix() for path in sorted(site.rglob("*.html"))]
    look = site / "look.html"
    look.write_text(LOOK % json.dumps(pages), "utf-8")
    shown = _shown(look.as_uri(), tmp_path, "--allow-file-access-from-files", "--virtual-time-budget=60000")
    look.unlink()
    found = re.search(r"wide: ([^<]*)<", shown)
    assert found
    assert not found[1]


def _shown(page: str, folder: Path, *options: str) -> str:
    """The page as Chromium leaves it."""
    command = [str(CHROMIUM), "--headless", "--no-sandbox", "--disable-dev-shm-usage", f"--user-data-dir={folder}"]
    return subprocess.run(
        [*command, *options, "--dump-dom", page], capture_output=True, text=True, timeout=300, check=False
    ).stdout
