"""Whatever a file holds, its reader gives an object or one error of ours in one line: the files that people write,
descriptions of FMUs, typed options, and the folders that runs, studies and comparisons leave.

Texts are valid files with random edits: near misses reach deeper than noise. Noise comes too. tools/fuzz.py does the
same for longer, by what code an input reaches; what it once found is among its seeds."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import sprain_cosim as sc
from sprain_cosim.brace.from_csv import read_curves
from sprain_cosim.errors import SprainError
from sprain_cosim.mapping import load_mapping, read_component
from sprain_cosim.scenario import load_scenario
from sprain_cosim.shipped import scenario_folder
from sprain_cosim.study.study import Study
from tests.native import device
from tools import fuzz
from tools.fuzz import INPUTS, MAPPING, SCENARIO, STUDY, TABLE, TOKENS

EDITS = st.lists(
    st.tuples(
        st.sampled_from(["insert", "cut", "replace", "double", "swap"]),
        st.floats(0, 1),
        st.integers(1, 40),
        st.sampled_from(TOKENS) | st.text(max_size=6) | st.floats().map(repr) | st.integers().map(str),
    ),
    max_size=5,
)


def edited(text: str, edits: list[tuple[str, float, int, str]]) -> str:
    for kind, place, length, token in edits:
        at = int(place * len(text))
        if kind == "insert":
            text = text[:at] + token + text[at:]
        elif kind == "cut":
            text = text[:at] + text[at + length :]
        elif kind == "double":  # a line
            end = text.find("\n", at) + 1 or len(text)
            start = text.rfind("\n", 0, at) + 1
            text = text[:end] + text[start:end] + text[end:]
        else:  # a value: what stands behind =, or between commas
            start = max(text.rfind("=", 0, at), text.rfind(",", 0, at), text.rfind("\n", 0, at)) + 1
            ends = [k for k in (text.find(c, max(at, start)) for c in ",\n}") if k >= 0]
            text = (
                text[:start]
                + (token if kind == "replace" else text[start : start + length][::-1])
                + text[min(ends, default=len(text)) :]
            )
    return text


def holds(path: Path, data: bytes, parse: Callable[[Path], object]) -> None:
    path.write_bytes(data)
    problem = None
    try:
        parse(path)
    except SprainError as caught:
        problem = caught
    if problem is not None:
        assert problem.exit_code == 2, problem
        assert str(problem).strip()
        assert "\n" not in str(problem)


@lru_cache
def study() -> Study:
    return sc.load_study("study4")


CASES: dict[str, tuple[str, str, Callable[[Path], object]]] = {
    "scenario": ("x.toml", SCENARIO, lambda path: load_scenario(path).system()),
    "study": ("x.toml", STUDY, lambda path: sc.load_study(path).checked().sample()),
    "mapping": ("x.toml", MAPPING, lambda path: read_component("brace", path.parent / "vendor.fmu", path)),
    "mapping alone": ("x.toml", MAPPING, load_mapping),
    "table": ("x.csv", TABLE, read_curves),
    "inputs": ("x.csv", INPUTS, lambda path: study().with_inputs(path)),
}


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("fuzz")
    device(made / "vendor.fmu", names=("In1_InvAngle", "M_out"))
    shutil.copy(scenario_folder() / "incline30.toml", made / "incline30.toml")
    return made


@pytest.mark.parametrize("kind", CASES)
def test_edited_files(kind: str, place: Path) -> None:
    name, text, parse = CASES[kind]

    @settings(max_examples=120, deadline=None, derandomize=True, database=None, suppress_health_check=list(HealthCheck))
    @given(edits=EDITS)
    def run(edits: list[tuple[str, float, int, str]]) -> None:
        holds(place / name, edited(text, edits).encode("utf-8", "surrogatepass"), parse)

    run()


@pytest.mark.parametrize("kind", CASES)
def test_noise(kind: str, place: Path) -> None:
    name, text, parse = CASES[kind]

    @settings(max_examples=40, deadline=None, derandomize=True, database=None, suppress_health_check=list(HealthCheck))
    @given(before=st.integers(0, 400), noise=st.binary(max_size=60))
    def run(before: int, noise: bytes) -> None:
        whole = text.encode()
        holds(place / name, whole[:before] + noise + whole[before:], parse)
        holds(place / name, noise, parse)

    run()


@pytest.mark.parametrize("kind", CASES)
def test_the_text_itself_is_accepted(kind: str, place: Path) -> None:
    """Otherwise the edits would prove nothing. (The mapping names a second input that the FMU lacks.)"""
    name, text, parse = CASES[kind]
    (place / name).write_text(text.replace('subtalar_velocity = "In2_InvVel"\n', ""))
    parse(place / name)


@pytest.fixture(scope="module")
def parsers(tmp_path_factory: pytest.TempPathFactory) -> dict[str, fuzz.Target]:
    return fuzz.parsers(tmp_path_factory.mktemp("parsers"))


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> dict[str, fuzz.Target]:
    return fuzz.folder_readers(tmp_path_factory.mktemp("folders"))


TYPED = ("checks", "description", "unit", "option")
FILES = ("scenario", "study", "mapping", "table", "inputs", *TYPED)
FOLDERS = ("folder-run", "folder-study", "folder-compared")
EVERY_FOLDER = (
    *(*FOLDERS, "folder-search", "folder-before-run", "folder-before-study", "folder-before-search"),
    *("folder-before-form", "folder-before-light", "folder-before-comparison"),
)
A_MINUTE = float(os.environ.get("SPRAIN_FUZZ_SECONDS", "60"))


def fuzzed(name: str, targets: dict[str, fuzz.Target], seconds: float = 60.0, most: int = 60) -> fuzz.Findings:
    """From the kept seeds on: no other exception, nothing over 2 s or 500 MB."""
    findings, target = fuzz.Findings(None), targets[name]
    fuzz.at_random(name, target, [*target.seeds, *fuzz.kept().get(name, [])], seconds, 0, findings, most)
    assert not findings.kinds
    assert findings.longest < fuzz.MOST_TIME
    assert findings.largest_memory < fuzz.MOST_MEMORY
    return findings


@pytest.mark.parametrize("name", TYPED)
def test_parsers(name: str, parsers: dict[str, fuzz.Target]) -> None:
    assert fuzzed(name, parsers).inputs >= 60


@pytest.mark.parametrize("name", FOLDERS)
def test_edited_folders(name: str, folders: dict[str, fuzz.Target]) -> None:
    assert fuzzed(name, folders).inputs >= 60


@pytest.mark.long
@pytest.mark.parametrize("name", FILES)
def test_every_parser_for_a_minute(name: str, parsers: dict[str, fuzz.Target]) -> None:
    assert fuzzed(name, parsers, A_MINUTE, 1 << 60).inputs > 60
    assert set(parsers) == set(FILES)


@pytest.mark.long
@pytest.mark.parametrize("name", EVERY_FOLDER)
def test_every_folder_for_a_minute(name: str, folders: dict[str, fuzz.Target]) -> None:
    assert fuzzed(name, folders, A_MINUTE, 1 << 60).inputs > 60
    assert {f for f in folders if not f.startswith(("folder-compared-", "folder-before-comparison-"))} == {
        *EVERY_FOLDER
    }
