"""Scenario files: schema and parser agree, bases, overrides, replaced devices."""

from __future__ import annotations

import contextlib
import json
import tomllib
from pathlib import Path

import jsonschema
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from sprain_cosim.cosim.coupling import SCHEMES
from sprain_cosim.errors import InputError, SprainError
from sprain_cosim.scenario import load_scenario
from sprain_cosim.shipped import PACKAGE, scenario_folder, shipped_scenarios
from sprain_cosim.study.file import load_study

SCHEMA = json.loads((PACKAGE / "scenario.schema.json").read_text())


@pytest.mark.parametrize("name", shipped_scenarios())
def test_shipped_scenarios_fit_the_schema(name: str) -> None:
    jsonschema.validate(tomllib.loads((scenario_folder() / f"{name}.toml").read_text()), SCHEMA)
    assert load_scenario(name).system().check() == []


def test_the_schema_knows_the_schemes() -> None:
    assert SCHEMA["properties"]["master"]["properties"]["scheme"]["enum"] == ["auto", *SCHEMES]


@pytest.mark.parametrize(
    "text",
    [
        "titel = 'x'",
        "base = 'incline30'\n[components.b]\nfile = 'x'",
        "base = 'incline30'\n[master]\nstop = 0.15",
        "base = 'incline30'\n[parameters]\nplant.drop_height = '1 m'",
        "base = 'incline30'\n[connections]\n'a.b' = 3",
    ],
)
def test_what_the_schema_refuses_the_parser_refuses(text: str, tmp_path: Path) -> None:
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(tomllib.loads(text), SCHEMA)
    (tmp_path / "x.toml").write_text(text)
    with pytest.raises(SprainError):
        load_scenario(tmp_path / "x.toml")


def test_a_base_is_merged_key_by_key() -> None:
    scenario = load_scenario("incline30_mixed")
    assert list(scenario.fmus) == ["plant", "controller", "brace"]
    assert scenario.parameters["plant.drop_height"] == "0.30 m"
    assert scenario.parameters["brace.angle_scale"] == 1.5
    assert scenario.master.communication_step == pytest.approx(5e-4)


def test_override_leaves_the_original_alone() -> None:
    scenario = load_scenario("incline30")
    changed = scenario.override("plant.drop_height", "35 cm")
    assert scenario.parameters["plant.drop_height"] == "0.30 m"
    assert changed.system().parameters["plant.drop_height"] == pytest.approx(0.35)
    assert changed.initial_pose() == "touching"
    assert changed.override("plant.initial_pose", "published").initial_pose() == "published"


def test_replacing_a_device_makes_its_connections_anew(tmp_path: Path) -> None:
    text = (
        "base = 'incline30'\n[components.brace]\nfmu = 'brace_bushing'\n[connections]\n'brace.rotation_x_angle' = "
        "'plant.rotation_y_angle'"
    )
    (tmp_path / "y.toml").write_text(text)
    scenario = load_scenario(tmp_path / "y.toml")
    assert scenario.system().connections["brace.rotation_x_angle"] == "plant.rotation_y_angle"
    replaced = scenario.replace_fmu("brace", "brace_bushing")
    assert replaced.system().connections["brace.rotation_x_angle"] == "plant.rotation_x_angle"


def test_a_base_may_have_a_base(tmp_path: Path) -> None:
    """The nearest file wins; paths begin at the file that names them; a circle is named."""
    (tmp_path / "a.toml").write_text("base = 'incline30_brace'\n[parameters]\n'plant.drop_height' = '0.4 m'")
    (tmp_path / "b.toml").write_text("base = 'a'\n[parameters]\n'brace.angle_scale' = 2")
    scenario = load_scenario(tmp_path / "b.toml")
    assert scenario.heading == "30° slope, 200 % brace, ankle muscles off"
    assert scenario.parameters["plant.drop_height"] == "0.4 m"
    assert scenario.parameters["brace.angle_scale"] == 2
    assert list(scenario.fmus) == list(load_scenario("incline30_brace").fmus)
    (tmp_path / "c.toml").write_text("base = 'd'")
    (tmp_path / "d.toml").write_text("base = 'e'")
    (tmp_path / "e.toml").write_text("base = 'd'")
    with pytest.raises(SprainError, match=r"e\.toml: base 'd': the bases form a circle \(d -> e -> d\)"):
        load_scenario(tmp_path / "c.toml")


VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=12),
    lambda inner: st.lists(inner, max_size=3),
    max_leaves=4,
)


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    key=st.sampled_from(["title", "base", "master", "components", "parameters", "connections", "x"]),
    name=st.text(max_size=12),
    value=VALUES,
)
def test_no_file_breaks_the_parser(key: str, name: str, value: object, tmp_path: Path) -> None:
    def toml(v: object) -> str:
        if isinstance(v, bool):
            return str(v).lower()
        if isinstance(v, list):
            return "[" + ", ".join(toml(x) for x in v) + "]"
        return json.dumps(v) if isinstance(v, (str, int, float)) else '""'

    for text in (f"{key} = {toml(value)}", f"base = 'incline30'\n[{key}]\n{json.dumps(name)} = {toml(value)}"):
        (tmp_path / "x.toml").write_bytes(text.encode("utf-8", "surrogatepass"))
        with contextlib.suppress(SprainError):
            load_scenario(tmp_path / "x.toml").system()


def test_a_study_is_no_scenario_and_a_scenario_no_study(tmp_path: Path) -> None:
    scenario, study = tmp_path / "one.toml", tmp_path / "many.toml"
    scenario.write_text('base = "incline30"\n')
    study.write_text('scenario = "one.toml"\n[marginals]\n[study]\ntrials = 5\n')
    with pytest.raises(
        InputError, match=rf"many.toml: is a study, many landings; `sprain-cosim study {study}` runs it"
    ):
        load_scenario(study)
    spaced = tmp_path / "my study.toml"
    study.rename(spaced)
    with pytest.raises(InputError, match=r"`sprain-cosim study '/.*/my study.toml'` runs it"):
        load_scenario(spaced)
    with pytest.raises(
        InputError, match=rf'one.toml: is a scenario, one landing; .*run {scenario}.* names it: scenario = "one.toml"'
    ):
        load_study(scenario)
