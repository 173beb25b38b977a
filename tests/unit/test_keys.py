"""Tables of keys: one table gives the reader, the schema that ships and the page of the reference."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from sprain_cosim import keys, load_study
from sprain_cosim.errors import InputError
from sprain_cosim.keys import MISSING, File, Key, Named, Short, Table, Tables
from sprain_cosim.shipped import PACKAGE, scenario_folder, shipped_studies
from sprain_cosim.study.file import FILE as STUDY
from sprain_cosim.units import unit
from sprain_cosim.validation.checks.user_files import FILE as CHECK
from sprain_cosim.validation.checks.user_files import read_checks
from tools.schemas import FILES, text

INNER = Table(
    (
        Key("name", keys.text(), "a name", needs="needs a name"),
        Key("span", keys.measured(unit("s"), above_zero=True), "how long", "1 s"),
        Key("way", keys.choice(("up", "down")), "where to"),
        Key("count", keys.whole(1), "how many", "1"),
        Key("share", keys.positive(), "of the whole"),
        Key("on", keys.flag(), "whether"),
    )
)
EXAMPLE = File(
    "example files",
    "example",
    "An example.",
    Table(
        (
            Key("one", INNER, "a table"),
            Key("short", Short("name", INNER), "a table, or its name"),
            Key("many", Tables(INNER), "tables"),
            Key(
                "named",
                Named("NAME", keys.number(), known=("aa", "bb"), strange="{at}.{name}: is none{hint}"),
                "by name",
            ),
        )
    ),
)


def read(content: Any) -> tuple[Any, list[str]]:
    problems: list[str] = []
    return EXAMPLE.table.read(content, "", problems), problems


def test_values_are_read_in_the_units_of_the_program() -> None:
    found, problems = read(
        {"one": {"name": "x", "span": "2 ms"}, "short": "y", "many": [{"name": "z"}], "named": {"aa": 3}}
    )
    assert problems == []
    assert found == {
        "one": {"name": "x", "span": 0.002},
        "short": {"name": "y"},
        "many": [{"name": "z"}],
        "named": {"aa": 3.0},
    }


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        ({"oen": {}}, "unknown key 'oen' (did you mean one?)"),
        ({"one": 3}, "one: must be a table, [one]"),
        ({"one": {}}, "one: needs a name"),
        ({"one": {"name": 3}}, "one.name: must be text"),
        ({"one": {"name": "x", "nmae": 1}}, "one: unknown key 'nmae' (did you mean name?)"),
        ({"one": {"name": "x", "span": 3}}, 'one.span = 3: needs a unit, for example "3 ms"'),
        ({"one": {"name": "x", "way": "left"}}, "one.way = 'left': must be up or down"),
        ({"one": {"name": "x", "count": True}}, "one.count = True: must be a whole number, not negative"),
        ({"one": {"name": "x", "share": 0}}, "one.share = 0: must be a positive number"),
        ({"one": {"name": "x", "on": 1}}, "one.on: must be true or false"),
        ({"short": 3}, "short: must be a table, [short]"),
        ({"many": {}}, "many: must be tables, [[many]]"),
        ({"many": [{"name": "x"}, {}]}, "many 2: needs a name"),
        ({"named": {"c": 1}}, "named.c: is none (known: aa, bb)"),
        ({"named": {"aa": "1"}}, "named.aa: must be a finite number"),
    ],
)
def test_a_mistake_is_one_line_with_its_place(content: dict[str, Any], problem: str) -> None:
    assert read(content)[1] == [problem]
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(content, EXAMPLE.schema())


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        ({"one": {"name": "x", "span": "0 s"}}, "one.span = '0 s': must be positive"),
        ({"one": {"name": "x", "share": float("nan")}}, "one.share = nan: must be a positive number"),
        ({"named": {"aa": 10**400}}, "named.aa: must be a finite number"),
    ],
)
def test_mistakes_that_no_schema_can_know(content: dict[str, Any], problem: str) -> None:
    assert read(content)[1] == [problem]


def test_all_mistakes_are_found_at_once() -> None:
    found, problems = read({"one": {"name": 3, "way": "left", "x": 1}, "named": 4, "y": 1})
    assert len(problems) == 5
    assert found == {"one": {}}
    assert EXAMPLE.table.read([], "here", problems) is MISSING


def paths(schema: dict[str, Any], before: str = "") -> Iterator[str]:
    """All keys that a schema names, as the reference writes them."""
    for name, inner in schema.get("properties", {}).items():
        yield f"{before}{name}"
        yield from paths(inner, f"{before}{name}.")
    if isinstance(schema.get("additionalProperties"), dict):
        yield from paths(schema["additionalProperties"], f"{before}*.")
    for alternative in schema.get("anyOf", ()):
        yield from paths(alternative, before)
    if "items" in schema:
        yield from paths(schema["items"], before)


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.name)
def test_the_schema_that_ships_is_the_table(file: File) -> None:
    path = PACKAGE / f"{file.name}.schema.json"
    assert path.read_text("utf-8") == text(file), "run python tools/schemas.py"
    jsonschema.Draft202012Validator.check_schema(json.loads(path.read_text("utf-8")))


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.name)
def test_the_reference_has_every_key_with_its_meaning(file: File) -> None:
    rows = [line.split(" | ") for line in file.reference().splitlines() if line.startswith("| `")]
    shown = {row[0].removeprefix("| ").strip("`").rpartition(".")[2] for row in rows}
    assert {path.rpartition(".")[2] for path in paths(file.schema())} - {"*"} <= shown | {
        name for row in rows for name in row[0].strip("| `").split(".")
    }
    assert all(row[-1].strip(" |") for row in rows), "a key without a meaning"


@pytest.mark.parametrize("name", shipped_studies())
def test_shipped_studies_fit_the_schema(name: str) -> None:
    path = scenario_folder() / "studies" / f"{name}.toml"
    jsonschema.validate(tomllib.loads(path.read_text("utf-8")), STUDY.schema())


@pytest.mark.parametrize(
    "text",
    [
        "titel = 'x'",
        "[study]\ntrails = 3",
        "[study]\ntrials = -3",
        "[study]\nspace = 'z'",
        "[study]\nlevels = [5, 50]",
        "[study]\nresponses = 'x'",
        "[marginals]\n'plant.drop_height' = { normal = { mean = '1 m' } }",
        "[marginals]\n'plant.drop_height' = { normal = { mean = '1 m', sd = '1 m' }, fixed = '1 m' }",
        "[marginals]\n'plant.drop_height' = { nromal = { mean = '1 m', sd = '1 m' } }",
        "[grid]\n'plant.drop_height' = []",
        "title = 3",
    ],
)
def test_what_the_schema_of_studies_refuses_the_reader_refuses(text: str, tmp_path: Path) -> None:
    full = "scenario = 'incline30'\n" * ("scenario" not in text) + text
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(tomllib.loads(full), STUDY.schema())
    (tmp_path / "x.toml").write_text(full)
    with pytest.raises(InputError):
        load_study(tmp_path / "x.toml")


def test_a_study_needs_a_scenario(tmp_path: Path) -> None:
    (tmp_path / "x.toml").write_text("titel = 'x'\n[study]\nseed = 0.5")
    with pytest.raises(InputError, match="3 problems: ") as refused:
        load_study(tmp_path / "x.toml")
    for problem in ("did you mean title?", "needs scenario =", "study.seed = 0.5: must be a whole number"):
        assert problem in str(refused.value)


GOOD = {
    "id": "hold-01",
    "title": "Brace A holds",
    "scenario": "incline30_brace",
    "metric": "peak_subtalar_angle_deg",
    "expected": 29.0,
    "tolerance": 0.5,
    "why": "twice the SD",
    "source": "bench",
}


@pytest.mark.parametrize(
    "change",
    [
        {"id": "a b"},
        {"title": " "},
        {"why": None},
        {"study": "study6"},
        {"trials": 0, "scenario": None, "study": "study6", "statistic": "mean"},
        {"scenario": None, "study": "study6", "statistic": "median"},
        {"scenario": None, "study": "study6"},
        {"tolerance": -1},
        {"between": [1, 2]},
        {"fmu": "x"},
        {"sett": {}},
    ],
)
def test_what_the_schema_of_checks_refuses_the_reader_refuses(change: dict[str, Any], tmp_path: Path) -> None:
    jsonschema.validate({"check": [GOOD]}, CHECK.schema())
    entry = {k: v for k, v in (GOOD | change).items() if v is not None}
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate({"check": [entry]}, CHECK.schema())
    lines = [f"{k} = {json.dumps(v)}" for k, v in entry.items() if v != {}] + ["sett = {}"] * ("sett" in entry)
    (tmp_path / "x.toml").write_text("\n".join(["[[check]]", *lines]))
    with pytest.raises(InputError):
        read_checks(tmp_path)
