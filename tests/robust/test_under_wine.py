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
from sprain_cosim.errors import InputError
from sprain_cosim.folders.landing import load_landing
from sprain_cosim.shipped import shipped_scenarios
from tests import native
from tests.wine_side import KILLS, MANY, TRIALS
from tools import windows

FOLDER = Path(os.environ.get("SPRAIN_WINDOWS", ""))
NEAR = 1e-9
HANGS = 3600.0  # s; on a busy machine only what never ends takes so long
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
    windows.end(FOLDER)
    keeper.wait()


def there(path: Path) -> str:
    """As the Windows side has it."""
    return "Z:\\" + str(path.relative_to(FOLDER)).replace("/", "\\")


def answer(what: str, work: Path) -> Any:
    code, said = windows.python(FOLDER, "-m", "tests.wine_side", what, there(work), limit=HANGS)
    assert code == 0, said[-2000:]
    return json.loads((work / f"{what}.json").read_text())


def prompt(line: str, work: Path) -> tuple[int, str]:
    """What a user types at the prompt of Windows, in the folder. With quotation marks it goes by a file: wine escapes
    those of an argument."""
    if '"' in line:
        (work / "line.bat").write_text("@" + line.replace("%", "%%") + "\r\n")
        line = "line.bat"
    return windows.run(FOLDER, "cmd", "/c", line, place="/" + str(work.relative_to(FOLDER)), limit=HANGS)


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
    numbers = own.select_dtypes("number").columns.drop("message", errors="ignore")  # empty: read as numbers
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
    with pytest.raises(InputError, match=r"made for Windows only .*Please export this FMU as FMI 2\.0"):
        sc.load_scenario("incline30").replace_fmu("brace", desk / "my_brace.fmu")


def test_ctrl_c_stops_and_keeps(work: Path) -> None:
    """A study, which goes on later, and a run whose device hangs."""
    mark = there(work / "hangs").replace("\\", "/")
    options = (f"-DFAULT_AT_START={native.FAULTS.index('hang_step')}", f'-DMARK="{mark}"')
    cross_compiled(native.compile_fmu(work / "hanging.fmu", fault="hang_step"), "faulty", *options)
    found = answer("stops", work)
    assert found["study"][0] == 130
    assert "--resume" in found["study"][1]
    assert 5 <= found["kept"] < MANY // 2
    assert (found["again"], found["finished"]) == (0, MANY)
    assert found["run"][0] == 130
    assert found["run"][1].endswith("error: interrupted")


def test_a_device_keeps_to_its_processor_time(work: Path) -> None:
    """The limit of its memory, by a job object, is one that wine takes and does not keep."""
    cross_compiled(native.compile_fmu(work / "greedy.fmu"), "faulty", "-DFAULT_AT_START=0")
    (work / "greedy.txt").write_text(json.dumps([native.FAULTS.index("spin"), 0]))
    spun, clean = answer("limits", work)
    assert spun == ["timeout", "overran its limit of processor time and was ended"]
    assert clean == ["completed", ""]


FIRST = [  # the first commands of the README and of docs/platforms.md, as the prompt of Windows has them
    ("sprain-cosim doctor", 0, "there is a sandbox on Linux alone"),
    (r"sprain-cosim run incline30 --out out\incline30", 0, "49.60"),
    (r"sprain-cosim run incline30_brace --out out\incline30_brace", 0, "29.84"),
    (r"sprain-cosim plot out\incline30 out\incline30_brace --out out", 0, r"out\figures"),
    ("sprain-cosim run incline30 --fmu brace=my_brace.fmu", 0, "subtalar moment of the brace"),
    (r"sprain-cosim compare incline30 --brace mine=my_brace.fmu --brace paper=brace_bushing --out out\swap", 0, "mine"),
    (r"sprain-cosim report out\swap", 0, "report.html"),
    (r"sprain-cosim animate out\incline30 out\incline30_brace --slow 2 --out out\landing.webp", 0, "landing.webp"),
    ('sprain-cosim run incline30_brace --set brace.angle_scale=1.5 --set plant.drop_height="0.35 m"', 0, "subtalar"),
    ("sprain-cosim list", 0, "incline30"),
    ("sprain-cosim list parameters incline30_brace", 0, "angle_scale"),
    ("sprain-cosim check my_brace.fmu", 0, "fits"),
]
MORE = [
    (r"sprain-cosim export out\incline30 --speeds -o out\landing.mot", 0, "landing.mot"),
    (r"sprain-cosim motion out\landing.mot -o again.toml", 0, "again.toml"),
    ("sprain-cosim run again.toml", 0, "49.60"),
    ("sprain-cosim ssp export incline30_brace -o landing.ssp", 0, "landing.ssp"),
    ("sprain-cosim ssp check landing.ssp", 0, "landing.ssp"),
    ("sprain-cosim run landing.ssp", 0, "29.84"),
    ("sprain-cosim brace from-csv table.csv -o table.fmu", 0, "table.fmu"),
    ("sprain-cosim anatomy from-csv table.csv -o my_ankle.toml", 0, "my_ankle.toml"),
    (r"sprain-cosim design study6 --vary brace.angle_scale=0.5..3 --landings 100 --out out\design "
     '--goal "P(peak_subtalar_angle_deg > 40 deg) <= 50 %"', 0, "angle_scale"),
    ("sprain-cosim brace new my_device --lang c", 0, "next: sprain-cosim brace build my_device"),
    ("sprain-cosim brace build my_device", 4, "install the Build Tools for Visual Studio"),
    ("sprain-cosim brace new my_spring --lang python", 0, "my_spring"),
    ("sprain-cosim brace build my_spring", 4, "no compiler for win64"),
    ("sprain-cosim validate --quick", 0, " checks with "),
]  # fmt: skip
WRONG = [
    ("sprain-cosim run incline30 --set plant.drop_height=0.35", 2, "error: "),
    ("sprain-cosim run incline30 --out aux", 2, "the name of a device on Windows"),
    ("sprain-cosim run incline30 --out NUL", 2, "the name of a device on Windows"),
    ("sprain-cosim study study6 --trials 2 --out nul", 2, "the name of a device on Windows"),
    ("sprain-cosim compare incline30 --brace a=brace_linear --out nul", 2, "the name of a device on Windows"),
    ("sprain-cosim plot NUL", 2, "the name of a device on Windows"),
    ("sprain-cosim study study6 --inputs CON", 2, "the name of a device on Windows"),
    ("sprain-cosim run aux.toml", 2, "aux.toml: "),
    ("sprain-cosim run CON", 2, "CON"),
    ("sprain-cosim check NUL", 2, "NUL: no such "),
    (r"sprain-cosim run incline30 --out Q:\nowhere\out", 4, "Q:"),
    (r"sprain-cosim run sub\nothing", 2, "no such scenario file"),
    (
        "sprain-cosim check linux.fmu",
        2,
        'made for Linux only (linux64); ask its maker: "Please export this FMU as FMI 2.0 co-simulation for win64',
    ),
    ("sprain-cosim run incline30 --fmu brace=linux.fmu", 2, "made for Linux only (linux64); ask its maker"),
]


@pytest.fixture(scope="module")
def desk(work: Path) -> Path:
    """A user's folder with an FMU for Windows, one for Linux, and a table."""
    place = work / "My désk"
    place.mkdir()
    native.device(place / "linux.fmu")
    options = ("-DFMI=2", "-DSIGN=1.0", "-DANGLE_UNIT=1.0", "-DTORQUE_UNIT=1.0")
    cross_compiled(native.device(place / "my_brace.fmu"), "device stubs", *options)
    angles = range(-30, 45, 5)
    rows = "".join(f"{angle},{angle / 1.5 + (angle / 20.0) ** 3:.2f}\n" for angle in angles)
    (place / "table.csv").write_text(f"angle [deg],subtalar_resistance [N.m]\n{rows}", encoding="utf-8", newline="\r\n")
    return place


@pytest.mark.parametrize(
    ("line", "code", "words"), [*FIRST, *MORE, *WRONG], ids=[line[13:60] for line, *_ in (*FIRST, *MORE, *WRONG)]
)
def test_a_line_at_the_prompt(desk: Path, line: str, code: int, words: str) -> None:
    ended, said = prompt(line, desk)
    assert ended == code, said[-1500:]
    assert words in said, said[-1500:]
    assert "Traceback" not in said
    if code:
        assert [one for one in said.splitlines() if one.startswith("error: ")] == [said.splitlines()[-1]]


def test_a_folder_from_windows_is_read_here(desk: Path) -> None:
    """What was simulated there is drawn and filmed here."""
    folder = desk / "out" / "incline30"
    assert sc.open_folder(folder).plot().axes
    assert load_landing(folder).label.endswith("out/incline30")


@pytest.mark.parametrize("page", ["cp437", "cp1252"])
def test_a_console_of_a_code_page_reads_words(desk: Path, page: str) -> None:
    """No sign of another alphabet, and no question mark in the place of one."""
    ended, said = prompt(f"set PYTHONIOENCODING={page}&& sprain-cosim run incline30_brace", desk)
    assert ended == 0, said
    assert "?" not in said
    assert ("30° slope" if page == "cp1252" else "30\xf8 slope") in said  # the byte of ° in cp437, as cp1252 reads it


def test_a_file_that_another_program_holds_open(desk: Path) -> None:
    """As Excel does: the line says so, and the next try is good."""
    held = desk / "out" / "incline30" / "signals.csv"
    before = held.read_bytes()
    arguments = ["run", "level", "--out", there(held.parent), "--force"]
    code = f"f = open({there(held)!r}); from sprain_cosim.cli import main; main({arguments!r})"
    ended, said = windows.python(FOLDER, "-c", code)
    assert ended == 4, said
    assert "signals.csv: cannot be written: " in said.splitlines()[-1]
    assert held.read_bytes() == before
    assert prompt(r"sprain-cosim run incline30 --out out\incline30 --force", desk)[0] == 0
    assert held.read_bytes() == before


def test_a_folder_that_cannot_be_written(desk: Path) -> None:
    closed = desk / "closed"
    closed.mkdir()
    if subprocess.run(["chattr", "+i", str(closed)]).returncode:  # root may write everywhere else
        pytest.skip("this file system has no immutable folders")
    try:
        for line in ("run incline30 --out closed", "study study6 --trials 2 --out closed"):
            ended, said = prompt(f"sprain-cosim {line}", desk)
            assert ended == 4, said
            assert "cannot be written: " in said.splitlines()[-1], said
    finally:
        subprocess.run(["chattr", "-i", str(closed)], check=True)


def test_long_paths(desk: Path) -> None:
    """Refused as long as Windows has them switched off, used when it has not."""
    deep = "\\".join(["a folder of many letters"] * 9)
    ended, said = prompt(rf'sprain-cosim run incline30 --out "{deep}"', desk)
    assert ended == 2, said
    assert "characters with the files in it, more than the 259 that Windows accepts" in said.splitlines()[-1]
    key = [r"HKLM\SYSTEM\CurrentControlSet\Control\FileSystem", "/v", "LongPathsEnabled"]
    windows.run(FOLDER, "reg", "add", *key, "/t", "REG_DWORD", "/d", "1", "/f")
    try:
        ended, said = prompt(rf'sprain-cosim run incline30 --out "{deep}\\{deep}"', desk)
        assert ended == 0, said
    finally:
        windows.run(FOLDER, "reg", "delete", *key, "/f")


def test_a_user_whose_name_is_not_english(desk: Path) -> None:
    """Foreign FMUs are unpacked below the user's folder, and their children work among the temporary files."""
    user = desk / "Jörg Müller λ"
    (user / "Temp").mkdir(parents=True)
    variables = "".join(f"set {name}={there(user / 'Temp')}&& " for name in ("TEMP", "TMP", "LOCALAPPDATA"))
    ended, said = prompt(f"{variables}sprain-cosim run incline30 --fmu brace=my_brace.fmu --json", desk)
    assert ended == 0, said[-1500:]
    assert list((user / "Temp" / "sprain-cosim").rglob("*.dll"))
