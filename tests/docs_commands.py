"""Plays the commands of a documentation page, in order, in one folder: what a reader would type is what is tested.

Every ```sh block of a page is run line by line (continuation lines joined, `# comments` dropped) and every ```python
block as a script, in a folder that holds a reader's own files: `my_brace.fmu` and `table.csv`. A comment on the line
before a block changes that:

    <!-- long -->                 only in the long tests
    <!-- not run: why -->         never; the reason is compulsory
    <!-- exit 1 -->               the last command of the block ends with this code
    <!-- file: my.toml -->        before a block of any language: it is written to that file before anything runs
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parent.parent
PACKAGE = ROOT / "sprain_cosim"
FENCE = re.compile(
    r"^(?P<indent> *)```(?P<language>\w*)[^\n]*\n(?P<text>.*?)^(?P=indent)```\s*$", re.MULTILINE | re.DOTALL
)
MARK = re.compile(r"<!--\s*(long|not run: .+|exit \d+|file: \S+)\s*-->\s*\Z")
OWN = ("sprain-cosim", "python")  # what a block may call; anything else is marked `not run`


@dataclass(frozen=True)
class Block:
    """A fenced block: `line` of its fence counted from 1, `mark` the comment before it or ''."""

    page: Path
    line: int
    language: str
    text: str
    mark: str

    @property
    def commands(self) -> list[str]:
        """What is to be run of it, as shell commands."""
        if self.language not in ("sh", "bash", "python") or self.mark.startswith(("not run", "file")):
            return []
        if self.language == "python":
            return [f"python -c {shlex.quote(self.text)}"]
        lines = re.sub(r"\\\n\s*", " ", self.text).splitlines()
        return [
            " ".join(map(shlex.quote, words)) for words in (shlex.split(line, comments=True) for line in lines) if words
        ]


def blocks(page: Path) -> list[Block]:
    text, found = page.read_text("utf-8"), []
    for match in FENCE.finditer(text):
        mark = MARK.search(text[: match.start()].rstrip(" "))
        found.append(
            Block(
                page, text.count("\n", 0, match.start()) + 1, match["language"], match["text"], mark[1] if mark else ""
            )
        )
    return found


def play(page: Path, folder: Path, long: bool = False) -> int:
    """Runs the page's commands in `folder` and returns how many; AssertionError names page, line, command and what it
    printed."""
    shutil.copy(PACKAGE / "_fmus" / "brace_bushing.fmu", folder / "my_brace.fmu")
    (folder / "table.csv").write_text("plant.drop_height [m],brace.angle_scale\n0.25,1.5\n0.35,1.4\n", "utf-8")
    env = {
        **os.environ,
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
        "MPLBACKEND": "agg",
        "COLUMNS": "120",
    }
    done, found = 0, blocks(page)
    for block in found:
        if block.mark.startswith("file: "):
            target = folder / block.mark.removeprefix("file: ")
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_text(block.text, "utf-8")
    for block in found:
        if long or block.mark != "long":
            expected = int(block.mark.removeprefix("exit ")) if block.mark.startswith("exit ") else 0
            for k, command in enumerate(block.commands):
                where = f"{page.relative_to(ROOT) if page.is_relative_to(ROOT) else page}:{block.line}: {command}"
                assert command.split()[0] in OWN, (
                    f"{where}: not a command of the project; mark the block `not run: why`"
                )
                ended = subprocess.run(
                    command, shell=True, cwd=folder, env=env, capture_output=True, text=True, timeout=900, check=False
                )
                wanted = expected if k == len(block.commands) - 1 else 0
                assert ended.returncode == wanted, (
                    f"{where}: exit code {ended.returncode}, expected {wanted}\n{ended.stdout}\n{ended.stderr}"
                )
                done += 1
    return done
