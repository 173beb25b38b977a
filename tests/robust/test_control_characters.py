"""Control characters in titles, names, units and paths are shown, not sent: to the terminal, pages, figures, tables and
mapping files."""

from __future__ import annotations

import ast
import io
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest

import sprain_cosim as sc
from sprain_cosim.brace.proposal import propose
from sprain_cosim.cli import _run
from sprain_cosim.cosim.result import Result
from sprain_cosim.errors import InputError
from sprain_cosim.fmu.component import Component
from sprain_cosim.units import Unit
from tools import fuzz

EVIL = "\x1b]0;owned\x07\x9b31m\u202etxt\x7f\x08"
TOML = EVIL.encode("unicode_escape").decode().replace("\\x", "\\u00")
CONTROL = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\u2066-\u2069]")
PACKAGE = Path(sc.__file__).parent


def test_a_title_full_of_them(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """A run, its folder under such a name, what is looked at afterwards, and the error for a wrong file."""
    file, out = tmp_path / f"{EVIL}.toml", tmp_path / f"out{EVIL}"
    file.write_text(f'base = "incline30"\ntitle = "A {TOML} title"\n[master]\nstop = "5 ms"\n')
    assert sc.load_scenario(file).heading.startswith(f"A {EVIL}")
    assert _run(["run", str(file), "--out", str(out)], []) == 0
    assert _run(["report", str(out)], []) == 0
    assert _run(["plot", str(out)], []) == 0
    assert _run(["run", str(file), "--json"], []) == 0
    assert _run(["run", str(tmp_path / f"no{EVIL}.toml")], []) == 2
    assert _run([f"no{EVIL}"], []) == 2
    assert _run(["run", "incline30", f"--no{EVIL}"], []) == 2
    printed = "".join(capfd.readouterr())
    assert printed.count("owned") > 8
    assert not CONTROL.search(printed)
    written = [p for p in out.rglob("*") if p.suffix in (".html", ".svg", ".csv", ".json", ".toml")]
    assert {p.suffix for p in written} >= {".html", ".svg", ".csv", ".json"}
    for path in written:
        assert not CONTROL.search(path.read_text("utf-8")), path.name
    assert "owned" in (out / "report.html").read_text("utf-8")


def test_names_and_units_of_a_record() -> None:
    """Names may hold commas (arrays), quotes, ends of lines; the table keeps its columns."""
    names = ("brace.R[1,2]", 'brace."x"', f"brace.{EVIL}", "brace.two\nlines", "brace.plain")
    units = (Unit("N.m"), None, Unit(f"m{EVIL}"), Unit("rad"), Unit("1"))
    values = np.arange(10.0).reshape(2, 5)
    text = Result(np.array([0.0, 0.1]), values, names, units, "completed", "", "jacobi").csv()
    assert not CONTROL.search(text)
    again = Result.read_csv(io.BytesIO(text.encode()))
    assert again.names[:2] == names[:2]
    assert again.names[4] == "brace.plain"
    assert np.array_equal(again.values, values)


def test_a_proposed_mapping_file_is_one(tmp_path: Path) -> None:
    """Whatever a vendor's names hold."""
    name = 'ankle_angle" ] &#x9b; \\ \u202e'
    text = fuzz.DESCRIPTION.replace('"subtalar_angle"', f"'{name}'").replace("subtalar_torque", "moment \x7f\u0085")
    proposal = propose(Component.read("brace", fuzz.archive(tmp_path / "v.fmu", text.encode())))
    assert tomllib.loads(proposal)["inputs"]["subtalar_angle"]["to"] == name.replace("&#x9b;", "\x9b")
    assert "\x7f" not in proposal


def test_every_error_is_one_line() -> None:
    assert str(InputError(f"a{EVIL}: \n two \nlines")) == r"a\x1b]0;owned\x07\x9b31m\u202etxt\x7f\x08: two lines"


def test_there_is_one_way_to_the_terminal() -> None:
    """click's and Python's own are called in one function of the command line, by the progress, whose texts are its
    own, and by a child, whose output is no terminal."""
    found = set()
    for path in PACKAGE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.FunctionDef):
                names = {ast.unparse(c.func) for c in ast.walk(node) if isinstance(c, ast.Call)}
                if names & {"click.echo", "click.secho", "print", "sys.stdout.write", "sys.stderr.write"}:
                    found.add(f"{path.name}:{node.name}")
    assert found == {"cli.py:_show", "progress.py:reporter", "progress.py:report", "probe.py:free"}
