"""The package in a Windows Python under wine (`make windows`, which sets SPRAIN_WINDOWS): the same numbers as on this
machine, the same studies, faults that cost their trial. Wine is not Windows."""

from __future__ import annotations

import json
import os
import subprocess
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

import sprain_cosim as sc
from sprain_cosim.shipped import shipped_scenarios
from tests import native
from tests.wine_side import KILLS, MANY, TRIALS
from tools import windows

FOLDER = Path(os.environ.get("SPRAIN_WINDOWS", ""))
NEAR = 1e-9
FAULTS = {"none": "completed", "segfault": "crashed", "exit": "crashed", "hang_step": "timeout"}

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(not os.environ.get("SPRAIN_WINDOWS"), reason="SPRAIN_WINDOWS is not set (make windows)"),
]


@pytest.fixture(scope="module")
def work() -> Iterator[Path]:
    """A fresh folder that both sides see, as this side has it."""
    place = FOLDER / "work" / f"tests-{os.getpid()}"
    place.mkdir(parents=True)
    keeper = windows.start(FOLDER, "ping", "-n", "100000", "127.0.0.1")  # else wine starts its services each time
    yield place
    keeper.kill()
    keeper.wait()


def there(path: Path) -> str:
    """As the Windows side has it."""
    return "Z:\\" + str(path.relative_to(FOLDER)).replace("/", "\\")


def answer(what: str, work: Path, limit: float = 1500.0) -> Any:
    code, said = windows.python(FOLDER, "-m", "tests.wine_side", what, there(work), limit=limit)
    assert code == 0, said[-2000:]
    return json.loads((work / f"{what}.json").read_text())


def prompt(line: str, work: Path, limit: float = 400.0) -> tuple[int, str]:
    """What a user types at the prompt of Windows, in the folder."""
    place = "/" + str(work.relative_to(FOLDER))
    (FOLDER / "python/sprain-cosim.bat").write_text("@Z:\\python\\python.exe -m sprain_cosim %*\r\n")
    line = line.replace("sprain-cosim", "Z:\\python\\sprain-cosim.bat", 1)
    return windows.run(FOLDER, "cmd", "/c", line, place=place, limit=limit)


def cross_compiled(fmu: Path, source: str, *options: str) -> Path:
    """The FMU with a library for Windows in the place of its own, from tests/sources/`source`.c."""
    library = fmu.with_suffix(".dll")
    sources = [str(native.SOURCES / f"{name}.c") for name in source.split()]
    head = ["-include", str(native.SOURCES / "windows.h"), f"-I{native.HEADERS}"]
    command = [
        windows.MINGW,
        "-shared",
        "-static",
        "-Wl,--export-all-symbols",
        "-O1",
        "-w",
        *head,
        *options,
        "-o",
        str(library),
        *sources,
        "-lm",
    ]
    subprocess.run(command, check=True)
    with zipfile.ZipFile(fmu) as archive:
        description = archive.read("modelDescription.xml")
    with zipfile.ZipFile(fmu, "w") as archive:
        archive.writestr("modelDescription.xml", description)
        archive.write(library, f"binaries/win64/{source.split()[0]}.dll")
    return fmu


def near(one: dict[str, float], other: dict[str, float]) -> bool:
    return one.keys() == other.keys() and all(abs(v - other[k]) <= NEAR * max(1.0, abs(v)) for k, v in one.items())


def test_the_scenarios_are_those_of_this_machine(work: Path) -> None:
    found = answer("scenarios", work)
    assert list(found) == shipped_scenarios()
    for name, metrics in found.items():
        assert near(dict(sc.load_scenario(name).run().metrics), metrics), name


def test_a_study_is_that_of_this_machine_whatever_its_workers(work: Path, tmp_path: Path) -> None:
    assert answer("studies", work) == [TRIALS, TRIALS]
    assert (work / "1/trials.csv").read_bytes() == (work / "2/trials.csv").read_bytes()
    sc.load_study("study6").run(trials=TRIALS, workers=1, out=tmp_path / "own")
    own, theirs = (pd.read_csv(folder / "trials.csv") for folder in (tmp_path / "own", work / "1"))
    assert list(own) == list(theirs)
    assert (own["status"] == theirs["status"]).all()
    numbers = own.select_dtypes("number").columns
    assert ((own[numbers] - theirs[numbers]).abs() <= NEAR * own[numbers].abs().clip(lower=1.0)).all().all()


def test_a_fault_costs_its_trial(work: Path) -> None:
    cross_compiled(native.compile_fmu(work / "faulty.fmu"), "faulty", "-DFAULT_AT_START=0")
    order = [name for fault in FAULTS for name in (fault, "none")]
    (work / "faults.txt").write_text(json.dumps([native.FAULTS.index(name) for name in order]))
    found = answer("faults", work)
    assert [status for status, _, _ in found] == [FAULTS[name] for name in order]
    assert "access violation" in found[2][1]
    assert "limit of wall time (10 s: as stated)" in found[6][1]
    clean = [metrics for (_, _, metrics), name in zip(found, order, strict=True) if name == "none"]
    assert all(metrics == clean[0] for metrics in clean)


def test_no_row_is_lost_when_the_driver_is_killed(work: Path) -> None:
    found = answer("kills", work)
    assert (found["lost"], found["finished"], found["code"]) == (0, MANY, 0)
    assert len(found["kept"]) == KILLS


def test_a_vendor_s_brace_is_that_of_this_machine(desk: Path) -> None:
    """Both built from one source; in a process of its own there as here."""
    ended, said = prompt("sprain-cosim run incline30 --fmu brace=my_brace.fmu --json", desk)
    assert ended == 0, said[-1500:]
    found = json.loads(next(line for line in said.splitlines() if line.startswith("{")))
    own = sc.load_scenario("incline30").replace_fmu("brace", desk / "linux.fmu").run()
    assert near(dict(own.metrics), found["metrics"])


COMMANDS = [  # those of the README and of the first pages, as the prompt of Windows has them
    ("sprain-cosim doctor", 0, "landing"),
    ("sprain-cosim scenarios", 0, "incline30"),
    (r"sprain-cosim run incline30 --out out\incline30", 0, "49.60"),
    (r"sprain-cosim run incline30_brace --out out\incline30_brace", 0, "29.84"),
    (r"sprain-cosim plot out\incline30 out\incline30_brace --out out", 0, r"out\figures"),
    ("sprain-cosim run incline30 --fmu brace=my_brace.fmu", 0, "subtalar moment of the brace"),
    (r"sprain-cosim compare incline30 --brace mine=my_brace.fmu --brace paper=brace_bushing --out out\swap", 0, "mine"),
    (r"sprain-cosim report out\swap", 0, "report.html"),
    ("sprain-cosim check my_brace.fmu", 0, "fits"),
    (r"sprain-cosim export out\incline30 -o out\landing.mot", 0, "landing.mot"),
    (r"sprain-cosim animate out\incline30 --slow 2 --out out\landing.webp", 0, "landing.webp"),
    ("sprain-cosim brace new my_device --lang c", 0, "my_device"),
    ("sprain-cosim brace from-csv table.csv -o table.fmu", 0, "table.fmu"),
    ('sprain-cosim run incline30 --set plant.drop_height="0.35 m"', 0, "subtalar"),
    ("sprain-cosim run incline30 --set plant.drop_height=0.35", 2, "error: "),
    ("sprain-cosim run incline30 --out aux", 2, "the name of a device on Windows"),
    (
        "sprain-cosim check linux.fmu",
        2,
        'made for Linux only (linux64); ask its maker: "Please export this FMU as FMI 2.0 co-simulation for win64',
    ),
]


@pytest.fixture(scope="module")
def desk(work: Path) -> Path:
    """A user's folder with an FMU for Windows, one for Linux, and a table."""
    place = work / "desk"
    place.mkdir()
    native.device(place / "linux.fmu")
    options = ("-DFMI=2", "-DSIGN=1.0", "-DANGLE_UNIT=1.0", "-DTORQUE_UNIT=1.0")
    cross_compiled(native.device(place / "my_brace.fmu"), "device stubs", *options)
    (place / "table.csv").write_text(
        "angle [deg],subtalar_resistance [N.m]\n-30,-20\n0,0\n30,20\n", encoding="utf-8", newline="\r\n"
    )
    return place


@pytest.mark.parametrize(("line", "code", "words"), COMMANDS, ids=[line[13:60] for line, _, _ in COMMANDS])
def test_a_line_at_the_prompt(desk: Path, line: str, code: int, words: str) -> None:
    ended, said = prompt(line, desk)
    assert ended == code, said[-1500:]
    assert words in said, said[-1500:]
    assert "Traceback" not in said
