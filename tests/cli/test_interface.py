"""The public names that scripts, CI and users rely on: commands and options of the command line, names of the package.
Changing one breaks users."""

from __future__ import annotations

import importlib
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

import sprain_cosim
from sprain_cosim.brace import compare
from sprain_cosim.cli import _run, cli
from sprain_cosim.errors import InputError, SimulationError
from sprain_cosim.signals import Interrupted
from sprain_cosim.study.study import Study

COMMANDS = {
    "run": "--fmu --map --set --scheme --step --check-coupling --isolate --in-process --out --json",
    "study": "--method --trials --seed --inputs --fmu --map --set --workers --scheduler --resume --shard --max-failed "
    "--progress --out --json",
    "design": "--vary --goal --find --landings --seed --fmu --map --set --workers --scheduler --resume --out --json",
    "merge": "",
    "trial": "",
    "reproduce": "",
    "check": "--map --json",
    "compare": "--brace --map --decide",
    "plot": "--out",
    "report": "--out",
    "animate": "--trial --out",
    "list": "--fmu --map --json",
    "scenarios": "--json",
    "build": "",
    "validate": "--quick --list --only --out --junit",
    "doctor": "",
}
NAMES = {
    "sprain_cosim": "load_scenario load_study check_brace",
    "sprain_cosim.uq": "Normal LogNormal Uniform Fixed",
    "sprain_cosim.uq.reliability": "mean_value amv amv_plus hmv form",
    "sprain_cosim.uq.sensitivity": "sensitivity_factors pearson sobol_indices",
}


@pytest.mark.parametrize("name", COMMANDS)
def test_command_and_its_options(name: str) -> None:
    command = cli.commands[name]
    assert set(COMMANDS[name].split()) <= {option for parameter in command.params for option in parameter.opts}


def test_making_braces() -> None:
    brace = cli.commands["brace"]
    assert {"new", "from-csv"} <= set(brace.commands)  # type: ignore[attr-defined]
    assert "--lang" in {o for p in brace.commands["new"].params for o in p.opts}  # type: ignore[attr-defined]
    assert "-o" in {o for p in brace.commands["from-csv"].params for o in p.opts}  # type: ignore[attr-defined]


@pytest.mark.parametrize("module", NAMES)
def test_names_of_the_package(module: str) -> None:
    found = importlib.import_module(module)
    assert [n for n in NAMES[module].split() if not hasattr(found, n)] == []
    assert set(sprain_cosim.__all__) <= set(dir(sprain_cosim))


def commands(group: click.Group = cli) -> Iterator[click.Command]:
    for command in group.commands.values():
        yield from commands(command) if isinstance(command, click.Group) else [command]


def test_every_command_spells_where_it_writes_alike() -> None:
    places = [p for command in commands() for p in command.params if {"--out", "--output", "-o"} & set(p.opts)]
    assert len(places) >= 13
    assert {tuple(p.opts) for p in places} == {("-o", "--out")}


def test_every_option_says_what_it_is_for() -> None:
    options = [(c.name, p) for c in (cli, *commands()) for p in c.params if isinstance(p, click.Option)]
    assert len(options) > 100
    assert [f"{name} {option.opts[-1]}" for name, option in options if not option.help] == []


@pytest.mark.parametrize(
    ("source", "said"),
    [
        ("study6", "continue with: sprain-cosim compare study6 --resume"),
        ("incline30", "begin again with: sprain-cosim compare incline30"),
    ],
)
def test_an_interrupted_comparison_names_a_command_that_helps(
    source: str, said: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """One landing a brace has nothing to continue."""

    def stop(*_: object, **__: object) -> None:
        raise Interrupted

    monkeypatch.setattr(compare, "compare_braces", stop)
    monkeypatch.setattr(sys, "argv", ["sprain-cosim", "compare", source])
    with pytest.raises(Interrupted):
        cli.main(["compare", source], standalone_mode=False)
    assert capsys.readouterr().err == f"{said}\n"


@pytest.mark.parametrize(
    ("study", "end", "said"),
    [
        ("study6", Interrupted(), "continue with: sprain-cosim study study6 --resume"),
        ("study6", SimulationError("more than --max-failed 1 % allows"), "--resume --max-failed 100%"),
        ("amv6", Interrupted(), "continue with: sprain-cosim study amv6 --resume"),
        ("amv6", SimulationError("more than --max-failed 1 % allows"), None),  # a search needs all its trials
    ],
)
def test_a_study_that_ends_early_names_a_command_that_helps(
    study: str,
    end: Exception,
    said: str | None,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def stop(*_: object, **__: object) -> None:
        raise end

    monkeypatch.setattr(Study, "run", stop)
    monkeypatch.setattr(sys, "argv", ["sprain-cosim", "study", study])
    with pytest.raises(type(end)):
        cli.main(["study", study], standalone_mode=False)
    told = [line for line in capsys.readouterr().err.splitlines() if line.startswith("continue")]
    assert told == [] if said is None else said in told[0]


def test_a_command_without_resume_does_not_propose_it(tmp_path: Path) -> None:
    place = tmp_path / "study"
    sprain_cosim.load_study("study6").with_master(None, None, "5 ms").run(trials=2, workers=1, out=place)
    for command in (
        ["merge", str(place), "--out", str(place)],
        ["reproduce", str(place), "--out", str(tmp_path / "b")],
    ):
        (tmp_path / "b").mkdir(exist_ok=True)
        shutil.copy(place / "ledger.sqlite", tmp_path / "b")
        outcome = CliRunner().invoke(cli, command)
        assert isinstance(outcome.exception, InputError) or outcome.exit_code == 2
        said = outcome.stderr + str(outcome.exception)
        assert "holds a study already; name a new folder with --out" in said and "--resume" not in said


def test_every_command_that_overwrites_an_edited_file_takes_force() -> None:
    brace, anatomy = cli.commands["brace"], cli.commands["anatomy"]
    assert isinstance(brace, click.Group)
    assert isinstance(anatomy, click.Group)
    for command in (
        *(cli.commands[name] for name in ("run", "trial", "motion")),
        *(brace.commands["calibrate"], anatomy.commands["from-csv"]),
    ):
        assert "--force" in {o for p in command.params for o in p.opts}, command.name


def test_an_old_spelling_works_with_a_warning(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = tmp_path / "t.csv"
    table.write_text("angle [deg],subtalar_torque [N.m]\n-10,2\n0,0\n10,-2\n")
    for spelling in (["--output", str(tmp_path / "a.fmu")], [f"--output={tmp_path / 'b.fmu'}"]):
        assert _run(["brace", "from-csv", str(table), *spelling], []) == 0
        warning = "warning: --output is called --out now; the next version no longer takes it\n"
        assert capsys.readouterr().err == warning
    assert _run(["brace", "from-csv", str(table), "-o", str(tmp_path / "c.fmu")], []) == 0
    assert capsys.readouterr().err == ""
    assert {p.name for p in tmp_path.glob("*.fmu")} == {"a.fmu", "b.fmu", "c.fmu"}


def test_a_trial_is_written_like_a_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Over an earlier one with a warning or by --force; never into a folder that holds something else."""
    study, out = tmp_path / "s", tmp_path / "r"
    made = sprain_cosim.load_study("study2").with_master(stop="5 ms")
    made.run(trials=1, workers=1, out=study, trajectories=0)
    arguments = ["trial", str(study), "0", "--out", str(out)]
    for more, warned in (([], False), ([], True), (["--force"], False)):
        assert _run([*arguments, *more], []) == 0
        assert (
            "its earlier run is overwritten; the next version asks for --force" in capsys.readouterr().err
        ) == warned
    assert _run(["trial", str(study), "0", "--out", str(study)], []) == 2
    assert "holds other files" in capsys.readouterr().err
