"""Every public name has an example in its docstring, and it runs as written, in a folder with a brace."""

from __future__ import annotations

import doctest
import shutil
from pathlib import Path
from typing import Any

import pytest

import sprain_cosim as sc
from sprain_cosim.shipped import FMUS

LONG = {"check_brace", "compare_braces"}  # pages of the documentation make the same calls
NAMES = sorted(set(sc.__all__) - {"__version__"}, key=lambda name: name != "Study")  # whose folder others look into


def run(name: str, item: Any) -> None:
    tests = [t for t in doctest.DocTestFinder().find(item, name, module=False, globs={}) if t.examples]
    assert name in [test.name for test in tests], f"{name}: its docstring has no example"
    said = list[str]()
    for test in tests:
        doctest.DocTestRunner().run(test, out=said.append)
    assert not said, "".join(said)


@pytest.mark.parametrize(
    "names",
    [[n for n in NAMES if n not in LONG], pytest.param(sorted(LONG), marks=pytest.mark.long)],
    ids=["most", "long"],
)
def test_every_public_name_has_an_example_that_runs(
    names: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copy(FMUS / "brace_bushing.fmu", tmp_path / "my_brace.fmu")
    monkeypatch.chdir(tmp_path)
    for name in names:
        run(name, getattr(sc, name))


def test_the_first_example_runs() -> None:
    said = list[str]()
    test = doctest.DocTestParser().get_doctest(sc.__doc__ or "", {}, "sprain_cosim", None, 0)
    assert doctest.DocTestRunner().run(test, out=said.append).attempted == 3
    assert not said, "".join(said)
