"""Files that are larger, longer or deeper than any of their kind: refused in one line before they take memory or
time. Sparse files cost the disk nothing."""

from __future__ import annotations

import gzip
import json
import os
import resource
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from tools import fuzz

HUGE = 3 << 30
SECONDS, MEGABYTES = 4.0, 500
MANY = 850_000  # variables that just fit into the largest description
SIGNALS = "time [s],plant.subtalar_angle [rad]\n0,0.1\n0.1,0.2\n"


def sparse(path: Path, head: str = "", size: int = HUGE) -> Path:
    path.write_text(head)
    os.truncate(path, size)
    return path


def described(place: Path, old: str, new: str) -> object:
    from sprain_cosim.mapping import read_component

    content = fuzz.DESCRIPTION.replace(old, new).encode()
    return read_component("brace", fuzz.archive(place / "x.fmu", content), None)


def scenario(path: Path) -> object:
    from sprain_cosim.scenario import load_scenario

    return load_scenario(path)


def study(path: Path) -> object:
    from sprain_cosim.study.file import load_study

    return load_study(path)


def mapping(path: Path) -> object:
    from sprain_cosim.mapping import load_mapping

    return load_mapping(path)


def curves(path: Path) -> object:
    from sprain_cosim.brace.from_csv import read_curves

    return read_curves(path)


def inputs(path: Path) -> object:
    from sprain_cosim.study.file import load_study

    return load_study("study4").with_inputs(path)


def fmu(path: Path) -> object:
    from sprain_cosim.mapping import read_component

    return read_component("brace", path, None)


def signals(path: Path) -> object:
    from sprain_cosim.cosim.result import Result

    return Result.read_csv(path)


def trials(path: Path) -> object:
    from sprain_cosim.study.folder import read_trials

    return read_trials(path.parent)


def summary(path: Path) -> object:
    from sprain_cosim.folders.run import read_run

    return read_run(path.parent)


def text(path: Path, content: str) -> Path:
    path.write_text(content)
    return path


def bomb(path: Path) -> Path:
    """A record that is a thousand times as large as its file."""
    with gzip.open(path, "wb", compresslevel=1) as file:
        file.write(SIGNALS.encode())
        for _ in range(260):
            file.write(b"0.2,0.3\n" * (1 << 17))
    return path


DEEP = 100_000
CASES: dict[str, tuple[Callable[[Path], object], str]] = {
    "scenario of 3 GB": (lambda p: scenario(sparse(p / "x.toml")), "3072 MB; at most"),
    "study of 3 GB": (lambda p: study(sparse(p / "x.toml")), "3072 MB; at most"),
    "mapping of 3 GB": (lambda p: mapping(sparse(p / "x.toml")), "3072 MB; at most"),
    "curves of 3 GB": (lambda p: curves(sparse(p / "x.csv", fuzz.TABLE)), "3072 MB; at most"),
    "inputs of 1 GB": (lambda p: inputs(sparse(p / "x.csv", fuzz.INPUTS, 1 << 30)), "a line is longer than"),
    "FMU of 3 GB": (lambda p: fmu(sparse(p / "x.fmu", "PK\3\4")), "3072 MB; at most"),
    "FMU of 100 MB": (lambda p: fmu(sparse(p / "x.fmu", "PK\3\4", 100 << 20)), "not a readable zip archive"),
    "summary of 3 GB": (lambda p: summary(sparse(p / "summary.json")), "3072 MB; at most"),
    "trials of 3 GB": (lambda p: trials(sparse(p / "trials.csv", "trial,status\n0,completed\n")), "zero bytes"),
    "signals of 3 GB": (lambda p: signals(sparse(p / "signals.csv", SIGNALS)), "3072 MB; at most"),
    "signals of 200 MB": (lambda p: signals(sparse(p / "signals.csv", SIGNALS, 200 << 20)), "zero bytes"),
    "signals that unpack to 260 MB": (lambda p: signals(bomb(p / "000000.csv.gz")), "unpacked it has more than"),
    "nested TOML": (lambda p: scenario(text(p / "x.toml", f"a = {'[' * DEEP}{']' * DEEP}")), "nested too deeply"),
    "a key of many parts": (lambda p: scenario(text(p / "x.toml", ".".join("a" * DEEP) + " = 1")), "64 parts"),
    "a table of many parts": (lambda p: scenario(text(p / "x.toml", f"[{' . '.join('a' * DEEP)}]\nb = 1")), "64 parts"),
    "nested JSON": (lambda p: summary(text(p / "summary.json", "[" * DEEP)), "nested too deeply"),
    "nested objects": (lambda p: summary(text(p / "summary.json", '{"a":' * DEEP)), "nested too deeply"),
    "nested XML": (
        lambda p: described(p, "</UnitDefinitions>", f"</UnitDefinitions>{'<a>' * DEEP}{'</a>' * DEEP}"),
        "not valid",
    ),
    "10⁶ variables": (
        lambda p: described(
            p,
            "</ModelVariables>",
            "".join(
                f'<ScalarVariable name="a{i}" valueReference="{i + 9}"><Real/></ScalarVariable>' for i in range(MANY)
            )
            + "</ModelVariables>",
        ),
        "some 850004 variables; at most 100000",
    ),
}


def measure(name: str, place: Path) -> tuple[str, float, int]:
    """(message, s of processor time, MB of memory beyond what this process has)"""
    from sprain_cosim.errors import SprainError

    before, began, message = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.process_time(), "was accepted"
    try:
        CASES[name][0](place)
    except SprainError as problem:
        message = f"{problem.exit_code} {problem}"
    took = time.process_time() - began
    return message, took, (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) >> 10


def measure_all(place: Path) -> None:
    """Each in a process of its own; prints one line of JSON."""
    for name in CASES:
        if not os.fork():
            resource.setrlimit(resource.RLIMIT_AS, (6 << 30, 6 << 30))
            print(json.dumps([name, *measure(name, place)]), flush=True)
            os._exit(0)
        os.wait()


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[str, float, int]]:
    place = str(tmp_path_factory.mktemp("sizes"))
    code = f"from pathlib import Path; from {__name__} import measure_all; measure_all(Path({place!r}))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=240)
    return {name: (message, took, grew) for name, message, took, grew in map(json.loads, done.stdout.splitlines())}


@pytest.mark.parametrize("name", CASES)
def test_refused_before_it_costs_anything(name: str, measured: dict[str, tuple[str, float, int]]) -> None:
    message, took, grew = measured[name]
    assert message.startswith("2 "), message
    assert CASES[name][1] in message
    assert "\n" not in message
    assert len(message) < 400
    assert took < SECONDS
    assert grew < MEGABYTES


STUDY = Path(__file__).parent.parent / "folders_0_1" / "study"


@pytest.mark.long
def test_the_report_of_100_000_trials(tmp_path: Path) -> None:
    """At most 5 MB and 10 s of processor time; curves go through 2000 landings, which the page says."""
    from sprain_cosim.folders.read import read_folders
    from sprain_cosim.report.page import report_page

    folder, n, rng = tmp_path / "s", 100_000, np.random.default_rng(0)
    shutil.copytree(STUDY, folder)
    some = pd.read_csv(folder / "trials.csv", dtype={"message": str}, keep_default_na=False)
    table = some.iloc[rng.integers(0, len(some), n)].reset_index(drop=True)
    for column in table.columns[3:]:
        table[column] = table[column].astype(float) * (1.0 + 0.01 * rng.standard_normal(n))
    table.assign(trial=np.arange(n), status="completed").to_csv(folder / "trials.csv", index=False)
    summary = json.loads((folder / "summary.json").read_text())
    (folder / "summary.json").write_text(json.dumps(summary | {"n_requested": n, "n_completed": n, "n_failed": 0}))
    began = time.process_time()
    page = report_page(read_folders([folder]))
    took = time.process_time() - began
    print(f"{len(page.encode()) / 1e6:.2f} MB, {took:.1f} s")
    assert len(page.encode()) <= 5_000_000
    assert took <= 10.0
    assert "Curves go through 2000 landings" in page
