"""`validate` on the command line: listing, one check, JSON, exit codes."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from sprain_cosim.cli import _run, cli


def call(*arguments: str):
    return CliRunner().invoke(cli, ["validate", *arguments], standalone_mode=False)


def test_list_runs_nothing() -> None:
    result = call("--list")
    assert result.return_value == 0
    assert "coupling-01" in result.stdout
    assert "against" not in result.stdout.splitlines()[0]


def test_quick_checks_pass_and_are_written(tmp_path: Path) -> None:
    result = call(
        "--only",
        "uq-0[1-8]",
        "--only",
        "code-03",
        "--quick",
        "--json",
        "--out",
        str(tmp_path / "v"),
        "--junit",
        str(tmp_path / "j.xml"),
    )
    assert result.return_value == 0
    data = json.loads(result.stdout)
    assert data["counts"] == {"pass": 9, "known gap": 0, "fail": 0, "not run": 0}
    assert json.loads((tmp_path / "v" / "validation.json").read_text()) == data
    assert (tmp_path / "j.xml").read_text() == (tmp_path / "v" / "junit.xml").read_text()


def test_a_known_gap_is_shown_and_fails_only_a_strict_run() -> None:
    """The 5 % level of AMV in study 6 misses the authors' by half a degree."""
    result = call("--only", "paper-11", "--workers", "1")
    assert result.return_value == 0
    assert result.stdout.startswith("known gap  paper-11")
    assert "0 pass, 1 known gap" in result.stdout
    assert call("--only", "paper-11", "--workers", "1", "--strict").return_value == 1


def test_a_failing_check_of_a_user_exits_1(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(
        '[[check]]\nid = "hopeless"\ntitle = "No brace holds this"\nscenario = "incline30"\nmetric = '
        '"peak_subtalar_angle_deg"\n'
        'expected = 5\ntolerance = 1\nwhy = "hope"\nsource = "none"\n'
    )
    result = call("--checks", str(tmp_path), "--only", "custom")
    assert result.return_value == 1
    assert "peak_subtalar_angle_deg 49.6" in result.stdout


@pytest.mark.parametrize("arguments", [["--only", "nothing"], ["--checks", "no/such/folder"]])
def test_bad_input_is_one_line(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert _run(["validate", *arguments], []) == 2
    assert capsys.readouterr().err.count("error: ") == 1


@pytest.mark.long
def test_the_quick_suite_fails_nowhere(tmp_path: Path) -> None:
    result = call("--quick", "--workers", "2", "--out", str(tmp_path))
    assert result.return_value == 0, result.stdout
