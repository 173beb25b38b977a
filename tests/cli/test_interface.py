"""The public names that scripts, CI and users rely on: commands and options of the command line, names of the package.
Changing one breaks users."""

from __future__ import annotations

import importlib

import pytest

import sprain_cosim
from sprain_cosim.cli import cli

COMMANDS = {
    "run": "--fmu --map --set --scheme --step --check-coupling --isolate --in-process --out --json",
    "study": "--method --trials --seed --inputs --fmu --map --set --workers --scheduler --resume --shard --max-failed "
    "--progress --out --json",
    "merge": "",
    "trial": "",
    "reproduce": "",
    "check": "--map --json",
    "compare": "--brace --map",
    "plot": "--out",
    "report": "--out",
    "animate": "--trial --out",
    "scenarios": "",
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
