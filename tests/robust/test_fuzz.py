"""Whatever a file holds, its parser gives an object or one error of ours in one line: scenario, study, mapping, the two
kinds of CSV (R3).

Texts are valid files with random edits: near misses reach deeper than noise. Noise comes too."""

from __future__ import annotations

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

SCENARIO = """
base = "incline30"
title = "A brace"
[components.brace]
fmu = "brace_bushing"
[parameters]
"brace.angle_scale" = 2.4
"plant.drop_height" = "0.30 m"
"plant.initial_pose" = "touching"
[connections]
"brace.rotation_x_angle" = "plant.rotation_x_angle"
[master]
communication_step = "0.5 ms"
scheme = "auto"
stop = "150 ms"
"""
STUDY = """
scenario = "incline30_mixed"
title = "A study"
[parameters]
"plant.initial_pose" = "published"
[marginals]
"plant.drop_height" = { lognormal = { mean = "0.30 m", sd = "0.05 m" }, low = "0.1 m" }
"controller.coactivation" = { uniform = { low = 0.1, high = 0.3 } }
"plant.talocrural_angle_at_contact" = { normal = { mean = "-34 deg", sd = "5 deg" } }
[grid]
"controller.reflex_gain" = [0, 5, 10]
[correlation]
"plant.drop_height, controller.coactivation" = 0.3
[study]
method = "monte-carlo"
trials = 16
seed = 20211208
responses = ["peak_subtalar_angle_deg"]
levels = [0.05, 0.5]
threshold = "35 deg"
replicates = 8
space = "x"
step = 0.1
difference = "forward"
[published]
source = "here"
"""
MAPPING = """
active = true
step = "1 ms"
reset = true
[inputs]
subtalar_angle = { to = "In1_InvAngle", unit = "deg", offset = 2.0 }
subtalar_velocity = "In2_InvVel"
[outputs]
subtalar_torque = { from = "M_out", factor = -1, unit = "N.mm" }
"""
TABLE = """angle [deg],subtalar_resistance_loading [N.m],subtalar_resistance_unloading [N.m],talocrural_torque [lbf.in]
-30,-8,-7.5,70
-10,-2,-1.5,
0,0,0,0
10,2,1.5,-12
30,8,7.5,-80
"""
INPUTS = """trial,plant.drop_height [m],controller.coactivation,plant.talocrural_angle_at_contact [deg],status
0,0.30,0.2,-34,completed
1,0.25,0.21,-30,failed
7,0.35,0.19,-31,
"""
TOKENS = [
    *(
        "",
        "0",
        "-1",
        "1e400",
        "1e-400",
        "nan",
        "inf",
        "-inf",
        "true",
        "false",
        "99999999999999999999999",
        "0x7fffffffffffffff",
        "9223372036854775808",
    ),
    *(
        '""',
        '"',
        "'",
        "'''",
        '"""',
        "[",
        "]",
        "[[",
        "{",
        "}",
        "{}",
        "[]",
        "=",
        ",",
        ".",
        "\n",
        "\r",
        "\t",
        "#",
        "\\",
        "\\u0000",
        "\0",
        "\ufeff",
        "\u202e",
    ),
    *(
        "é",
        "𝔘",
        "1979-05-27",
        "07:32:00",
        '"0.3"',
        '"0.3 furlong"',
        '"1 m"',
        '"nan m"',
        '"1e999 m"',
        '"deg"',
        '" "',
        "[1, [2, [3]]]",
        "{ a = { b = { c = 1 } } }",
    ),
    *(
        '"../../../etc/passwd"',
        '"/dev/null"',
        '"."',
        '"m"',
        '"N.m"',
        '"rad^9999999999"',
        '"m/m/m"',
        '"1/0"',
        "subtalar_angle",
        "%s",
        "{0}",
        "a" * 300,
    ),
    *(
        "brace",
        "plant",
        "component",
        "low",
        "mean",
        "unit",
        "factor",
        "to",
        "from",
        "fmu",
        "map",
        "base",
        "scheme",
        "subtalar_torque",
    ),
]
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
