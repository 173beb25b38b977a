"""The notebooks of docs/notebooks, run from the first cell to the last, and as pages of the site with what they show.

In the repository they have no outputs, so that a change of one can be read."""

from __future__ import annotations

import base64
import html
import re
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import nbformat
from nbclient import NotebookClient

FOLDER = Path(__file__).parent.parent / "docs" / "notebooks"
LIMIT = 300  # s for a cell
COLOUR = re.compile(r"\x1b\[[0-9;]*m")


@dataclass(frozen=True)
class Page:
    """A notebook as a page.

    text      Markdown
    pictures  {name: PNG}, beside it
    """

    text: str
    pictures: dict[str, bytes]


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
            extra_arguments=["--Application.log_level=ERROR"],
        ).execute()
    return notebook


def page(notebook: nbformat.NotebookNode, stem: str) -> Page:
    lines, pictures = [f"[Download this notebook]({stem}.ipynb){{ .md-button }}", ""], dict[str, bytes]()
    for cell in notebook.cells:
        if cell.cell_type == "markdown":
            lines += [cell.source, ""]
            continue
        lines += ["```python", cell.source, "```", ""]
        for output in cell.outputs:
            lines += [*_shown(output, stem, pictures), ""]
    heading, *rest = lines[2:]
    return Page("\n".join([heading, *lines[:2], *rest]), pictures)


def _shown(output: Any, stem: str, pictures: dict[str, bytes]) -> list[str]:
    """One output of a cell in Markdown; its picture is added to `pictures`."""
    if output.output_type == "stream":
        return _text(output.text)
    if output.output_type == "error":
        return _text(COLOUR.sub("", "\n".join(output.traceback)))
    data = output.data
    if "image/png" in data:
        name = f"{stem}-{len(pictures) + 1}.png"
        pictures[name] = base64.b64decode(data["image/png"])
        return [f"![what the cell above draws]({name}){{ .of-notebook }}"]
    if "text/html" in data:
        return [f'<div class="of-notebook">{_one_block(data["text/html"])}</div>']
    return _text(data.get("text/plain", ""))


def _text(text: str) -> list[str]:
    return [f'<pre class="of-notebook"><code>{html.escape(text.rstrip())}</code></pre>'.replace("\n", "&#10;")]


def _one_block(text: str) -> str:
    """HTML without blank lines, which would end it for Markdown, and without styles of its own."""
    return re.sub(r"\n\s*", " ", re.sub(r"<style.*?</style>", "", text, flags=re.DOTALL))
