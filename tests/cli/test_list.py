"""The first minute: what may be typed is listed, found by the shell and grouped in the help, whatever the width of the
terminal."""

from __future__ import annotations

import io
import json
from collections.abc import Iterator
from pathlib import Path

import click
import pytest
from click.shell_completion import ShellComplete

from sprain_cosim import load_scenario, metrics, terminal
from sprain_cosim.catalogue import parameters_of
from sprain_cosim.cli import _run, cli
from sprain_cosim.cosim.coupling import SCHEMES
from sprain_cosim.guidance import EXAMPLES, LISTED, SECTIONS
from sprain_cosim.mapping import read_component
from sprain_cosim.shipped import FMUS, shipped_fmus, shipped_scenarios, shipped_studies
from sprain_cosim.study.methods import METHODS
from sprain_cosim.terminal import fitted, fitted_table

WIDTHS = (60, 80, 120)
Typed = pytest.CaptureFixture[str]


def commands(group: click.Group = cli, path: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    yield path
    for name, command in group.commands.items():
        yield from commands(command, (*path, name)) if isinstance(command, click.Group) else [(*path, name)]


def typed(capsys: Typed, *arguments: str) -> str:
    assert _run(list(arguments), []) == 0
    return capsys.readouterr().out


# ---- list


def test_parameters_are_all_that_the_fmus_have() -> None:
    for name in ("incline30_mixed", "ankle_chronic_instability"):
        scenario = load_scenario(name)
        system = scenario.system()
        listed = {p.name: p for p in parameters_of(scenario)}
        of_fmus = {f"{c.name}.{n}" for c in system.components for n in c.parameters}
        assert len(of_fmus) > 40
        assert of_fmus == {n for n, p in listed.items() if not p.input}
        fed = {*system.connections, *system.undeclared}
        inputs = {f"{c.name}.{n}" for c in system.components for n in c.inputs}
        assert inputs - fed == {n for n, p in listed.items() if p.input}
        for full, parameter in listed.items():
            connector = system.find(full)
            assert (parameter.unit or None) == (connector.unit.name if connector.unit else None)
            assert parameter.meaning == connector.description != ""
            if connector.start is not None and not connector.items:
                assert parameter.default == connector.start


def test_parameters_say_value_range_and_choices(capsys: Typed) -> None:
    found = json.loads(typed(capsys, "list", "parameters", "incline30_brace", "--json"))
    assert found["scenario"] == "incline30_brace"
    by_name = {record["name"]: record for record in found["parameters"]}
    assert by_name["brace.angle_scale"]["value"] == 2.4
    incline = by_name["plant.platform_incline"]
    assert (incline["unit"], incline["value"]) == ("rad", "30 deg")
    assert incline["minimum"] < 0.5235987755982988 < incline["maximum"]
    pose = by_name["plant.initial_pose"]
    assert (pose["default"], pose["value"]) == ("touching", None)
    assert {"touching", "published"} <= set(pose["choices"])
    table = typed(capsys, "list", "parameters", "incline30_brace")
    row = next(line for line in table.splitlines() if line.startswith("plant.platform_incline"))
    assert row.split()[1:8] == ["deg", "-60", "...", "60", "30", "30", "deg"]


def test_parameters_of_another_device(capsys: Typed) -> None:
    found = json.loads(typed(capsys, "list", "parameters", "incline30", "--fmu", "brace=brace_linear", "--json"))
    own = {r["name"].removeprefix("brace.") for r in found["parameters"] if r["name"].startswith("brace.")}
    assert own == set(read_component("brace", FMUS / "brace_linear.fmu").parameters) != set()


def test_lists_hold_what_ships(capsys: Typed) -> None:
    found = json.loads(typed(capsys, "list", "--json"))
    assert [r["name"] for r in found["scenarios"]] == shipped_scenarios()
    assert [r["name"] for r in found["studies"]] == shipped_studies()
    assert all(r["heading"] and r["method"] in METHODS for r in found["studies"])
    assert [r["name"] for r in found["braces"]] == [n for n in shipped_fmus() if n.startswith("brace_")]
    assert all(r["description"] for r in found["braces"])
    assert [r["name"] for r in found["responses"]] == list(metrics.NAMES)
    assert set(metrics.MEANINGS) == set(metrics.NAMES)
    assert all(r["unit"] for r in found["responses"])
    old = json.loads(typed(capsys, "scenarios", "--json"))
    assert old["scenarios"] == {r["name"]: r["heading"] for r in found["scenarios"]}


def test_a_list_that_cannot_be_given(capsys: Typed) -> None:
    for arguments, words in (
        (["parameters"], "name a scenario"),
        (["responses", "incline30"], "only `list parameters` takes a SCENARIO"),
        (["parameters", "incline31"], "did you mean"),
        (["parameter"], "is not one of"),
    ):
        assert _run(["list", *arguments], []) == 2
        said = capsys.readouterr()
        assert (said.out, said.err.count("\n"), words in said.err) == ("", 1, True), said.err


# ---- widths


@pytest.mark.parametrize("columns", WIDTHS)
def test_no_line_of_help_or_list_is_wrapped(columns: int, capsys: Typed, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", str(columns))  # of help
    monkeypatch.setattr(terminal, "width", lambda *_: columns)
    monkeypatch.setenv("NO_COLOR", "1")
    calls = [[*path, "--help"] for path in commands()]
    calls += [["list", kind] for kind in LISTED if kind != "parameters"]
    calls += [["list", "parameters", "incline30_mixed"], ["list"], ["scenarios"]]
    for call in calls:
        text = typed(capsys, *call)
        assert "\x1b" not in text
        assert [line for line in text.splitlines() if len(line) > columns] == [], call


def test_a_pipe_has_one_line_a_name(capsys: Typed, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "40")
    assert len(typed(capsys, "list", "responses").splitlines()) == 1 + len(metrics.NAMES)


def test_a_table_in_little_room() -> None:
    rows = [("a_long_name", "deg", "of the foot relative to the shank, all through the landing")]
    assert fitted_table(("name", "unit", "meaning"), rows, None).splitlines()[1].startswith("a_long_name  deg   of the")
    wide = fitted_table(("name", "unit", "meaning"), rows, 50).splitlines()
    assert wide[0] == "name         unit  meaning"
    assert {line[:19].strip() for line in wide[2:]} == {""}
    under = fitted_table(("name", "unit", "meaning"), rows, 40).splitlines()
    assert under[2:] == ["a_long_name  deg", "    of the foot relative to the shank,", "    all through the landing"]
    assert fitted_table(("name", "unit", "meaning"), rows, 15).splitlines()[:2] == ["a_long_name", "    unit deg"]


SHORT = ("--stop", "10 ms")


def test_no_line_of_a_result_is_wrapped(tmp_path: Path, capsys: Typed, monkeypatch: pytest.MonkeyPatch) -> None:
    many = ("--workers", "1", "--progress", "none", "--out")
    monkeypatch.chdir(tmp_path)
    for call in (
        ("run", "incline30_mixed", *SHORT),
        ("study", "study6", "--trials", "4", *SHORT, *many, "s"),
    ):
        text = typed(capsys, *call)
        for columns in WIDTHS:
            lines = fitted(text, columns).splitlines()
            assert [line for line in lines if len(line) > columns and not line.startswith("written:")] == [], call
            assert {*text.split()} == {*" ".join(lines).split()}
        assert fitted(text, None) == text
    monkeypatch.setattr(terminal, "width", lambda *_: 60)
    assert max(map(len, typed(capsys, "run", "incline30", *SHORT).splitlines())) <= 60


def test_a_wide_table_is_divided_between_its_columns() -> None:
    table = (
        "name        first   second\n  one         1.0      2.0\n  two                  3.0\nnext: sprain-cosim run x"
    )
    assert fitted(table, 18).splitlines() == [
        *("name   first", "  one    1.0"),
        *("name   second", "  one     2.0", "  two     3.0"),
        "next: sprain-cosim run x",
    ]
    assert fitted(table, 26) == table


def test_a_long_last_cell_hangs_under_itself_and_what_is_copied_stays_whole() -> None:
    assert fitted(f"  note:  {'some words ' * 8}", 40).splitlines()[:2] == [
        "  note:  some words some words some",
        "         words some words some words",
    ]
    for line in ("next: sprain-cosim run incline30 --fmu brace=x", '{"peak": 1.0, "unit": "deg", "n": 4}'):
        assert fitted(line, 20) == line


@pytest.mark.parametrize(
    "call", [("doctor",), ("check", str(FMUS / "brace_linear.fmu")), ("subject", "female, 1.63 m, 62 kg"), ("run", "x")]
)
def test_no_command_writes_beyond_its_terminal(
    call: tuple[str, ...], capsys: Typed, monkeypatch: pytest.MonkeyPatch
) -> None:
    """But for what is copied: commands, paths, hashes."""
    monkeypatch.setattr(terminal, "width", lambda *_: 60)
    monkeypatch.setenv("NO_COLOR", "1")
    _run(list(call), [])
    printed = capsys.readouterr()
    lines = [line for text in printed for line in text.splitlines() if " " in line.strip()]
    assert lines
    assert [line for line in lines if len(line) > 60 and not line.startswith(terminal.COPIED)] == []


def test_the_width_is_that_of_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "77")
    assert terminal.width(io.StringIO()) is None
    stream = io.StringIO()
    monkeypatch.setattr(stream, "isatty", lambda: True, raising=False)
    assert terminal.width(stream) == 77
    monkeypatch.delenv("COLUMNS")
    assert terminal.width(stream) == terminal.USUAL  # it has no descriptor to ask


# ---- help


@pytest.mark.parametrize("group", [path for path in commands() if path in ((), ("brace",), ("anatomy",), ("ssp",))])
def test_a_bare_group_shows_its_help(group: tuple[str, ...], capsys: Typed) -> None:
    assert _run(list(group), []) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.startswith("Usage: sprain-cosim")
    assert "error" not in said.err
    examples = said.err.partition("Examples:")[2].splitlines()[1:]
    assert len(examples) >= 2
    assert said.err.rstrip("\n") == typed(capsys, *group, "--help").rstrip("\n")


def test_every_command_has_its_subject_and_examples_their_commands() -> None:
    known = {name for names in SECTIONS["sprain-cosim"].values() for name in names}
    assert {n for n, c in cli.commands.items() if not c.hidden} == known
    for lines in EXAMPLES.values():
        for line in lines:
            assert len(line) <= 56
            command: click.Command = cli
            for word in line.split()[1:]:
                if isinstance(command, click.Group):
                    command = command.commands[word]
                elif word.startswith("-"):
                    assert word in {o for p in command.params for o in p.opts}, line


# ---- completion


def completed(*arguments: str, begun: str = "") -> list[str]:
    found = ShellComplete(cli, {}, "sprain-cosim", "_SPRAIN_COSIM_COMPLETE").get_completions(list(arguments), begun)
    return [item.value for item in found if item.type == "plain"]


def test_names_are_completed(tmp_path: Path) -> None:
    assert completed("run", begun="incline30_m") == ["incline30_mixed"]
    assert completed("list", "parameters") == shipped_scenarios()
    assert completed("study", begun="study") == [f"study{n}" for n in range(1, 7)]
    assert set(completed("compare")) == {*shipped_scenarios(), *shipped_studies()}
    assert completed("run", "incline30", "--scheme") == ["auto", *SCHEMES]
    assert completed("study", "study1", "--method", begun="am") == ["amv", "amv+"]
    assert completed("run", "incline30", "--fmu", begun="br") == ["brace="]
    assert completed("compare", "level", "--brace", begun="soft=brace_l") == ["soft=brace_linear"]
    assert completed("run", begun=str(tmp_path)) == []


@pytest.mark.parametrize("columns", range(46, 75))
def test_folded_lines_keep_a_percentage_whole_and_leave_no_blank_line(columns: int) -> None:
    heading = "a landing on a slope of 30° with a 150 % brace, 20 % of co-activation and a reflex of some gain"
    rows = [
        "  450 landings about the design point  coefficient of variation 1 %",
        "  first order                       0.0207, beta 2.040",
        "  second order                      Breitung 0.0158, Hohenbichler-Rackwitz 0.0151",
    ]
    lines = fitted("\n".join([heading, *rows]), columns).split("\n")
    assert not [line for line in lines if len(line) > columns or not line.strip() or line.lstrip().startswith("%")]
    assert " ".join(heading.split()) in " ".join(" ".join(lines).split())
