"""The notebooks of docs/notebooks, run from the first cell to the last, and as pages of the site with what they show.
In the repository they have no outputs, so that a change of one can be read."""

from __future__ import annotations

import base64
import hashlib
import os
import platform
import re
import tempfile
from collections.abc import Iterator
from importlib.metadata import distributions
from pathlib import Path
from typing import Any

import nbformat
from nbclient import NotebookClient

from sprain_cosim import processor

ROOT = Path(__file__).parent.parent
FOLDER = ROOT / "docs" / "notebooks"
KEPT = ROOT / "build" / "notebooks"  # what was run for the site, by what it depends on
CHOSEN = "SPRAIN_NOTEBOOKS"  # names of those that the site runs, separated by commas; not set: all
LIMIT = 300  # s for a cell
COLOUR = re.compile(r"\x1b\[[0-9;]*m")


def executed(path: Path) -> nbformat.NotebookNode:
    """The notebook with its outputs, in a folder of its own. Raises nbclient's CellExecutionError for a cell that
    fails, unless it has the tag raises-exception."""
    notebook = nbformat.read(path, 4)
    with tempfile.TemporaryDirectory() as folder:
        NotebookClient(
            notebook,
            timeout=LIMIT,
            kernel_name="python3",
            resources={"metadata": {"path": folder}},
            extra_arguments=["--Application.log_level=ERROR", "--InlineBackend.figure_formats=retina"],
        ).execute()
    return notebook


def state() -> bytes:
    """What the outputs of every notebook depend on: the package with its FMUs and scenarios, this module, each
    installed version, the interpreter and the machine. Where one byte of it differs, nothing kept is taken."""
    found = hashlib.sha256(f"{platform.python_version()} {platform.platform()} {processor.level()}".encode())
    for line in sorted(f"{one.name} {one.version}" for one in distributions()):
        found.update(f"{line}\n".encode())
    files = (p for folder in ("sprain_cosim", "scenarios") for p in (ROOT / folder).rglob("*") if p.is_file())
    for path in sorted(p for p in [*files, Path(__file__)] if "__pycache__" not in p.parts):
        found.update(f"{path.relative_to(ROOT)} {hashlib.sha256(path.read_bytes()).hexdigest()}\n".encode())
    return found.digest()


def kept(path: Path, of: bytes) -> nbformat.NotebookNode:
    """The notebook with its outputs, run only where it or the `state()` changed since it was run last."""
    name = f"{path.stem}-{hashlib.sha256(of + path.read_bytes()).hexdigest()[:20]}.ipynb"
    if not (KEPT / name).is_file():
        notebook = executed(path)
        KEPT.mkdir(parents=True, exist_ok=True)
        for old in KEPT.glob(f"{path.stem}-*.ipynb"):
            old.unlink(missing_ok=True)
        part = KEPT / f"{name}.{os.getpid()}"
        nbformat.write(notebook, part)
        part.replace(KEPT / name)
    return nbformat.read(KEPT / name, 4)


def pages() -> Iterator[tuple[str, str | bytes]]:
    """(name, content) of the files of the site: each notebook as Markdown, the pictures beside it."""
    chosen = os.environ.get(CHOSEN)
    of = state()
    for path in sorted(FOLDER.glob("*.ipynb")):
        run = chosen is None or path.stem in chosen.split(",")
        notebook = kept(path, of) if run else nbformat.read(path, 4)
        pictures: dict[str, bytes] = {}
        yield f"{path.stem}.md", "\n".join(_lines(notebook, path.stem, pictures))
        yield from pictures.items()


def _lines(notebook: nbformat.NotebookNode, stem: str, pictures: dict[str, bytes]) -> Iterator[str]:
    """Of the page; its pictures are added to `pictures`."""
    for k, cell in enumerate(notebook.cells):
        if cell.cell_type == "markdown":
            yield f"{cell.source}\n"
        else:
            yield f"```python\n{cell.source}\n```\n"
            for output in cell.outputs:
                yield f'<div class="shown" markdown>\n\n{_shown(output, cell.source, stem, pictures)}\n\n</div>\n'
        if k == 0:
            yield f"[This notebook]({stem}.ipynb){{ download }} runs in Jupyter as it is.\n"


def _shown(output: Any, source: str, stem: str, pictures: dict[str, bytes]) -> str:
    if output.output_type == "stream":
        return _text(output.text)
    if output.output_type == "error":
        return _text(COLOUR.sub("", "\n".join(output.traceback)))
    if "image/png" in output.data:
        name = f"{stem}-{len(pictures) + 1}.png"
        pictures[name] = base64.b64decode(output.data["image/png"])
        drawn = source.splitlines()[-1].translate(str.maketrans("[]", "()"))
        return f"![what {drawn} draws]({name})"
    if "text/html" in output.data:  # without blank lines, which would end it for Markdown, and styles of its own
        shown = re.sub(r"\n\s*", " ", re.sub(r"<style.*?</style>", "", output.data["text/html"], flags=re.DOTALL))
        return re.sub(r"(?<=</t[dhr]>)|(?<=</caption>)", " ", shown)  # words of two cells stay two for the search
    return _text(output.data.get("text/plain", ""))


def _text(text: str) -> str:
    return f"````text\n{text.rstrip()}\n````"
