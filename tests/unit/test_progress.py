"""What a study says of its progress: a bar on a terminal, lines elsewhere, JSON for machines."""

from __future__ import annotations

import json
import sys

import pytest

from sprain_cosim.study.progress import BAR, bar, reporter


def said(kind: str, terminal: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> str:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: terminal)
    report = reporter(kind)
    assert report is not None
    for finished, failed, seconds in (
        (100, 0, 0.0),
        (550, 3, 10.0),
        (551, 3, 10.1),
        (1000, 4, 20.0),
    ):  # 100 were there before
        report(finished, 1000, failed, seconds)
    return capsys.readouterr().err


def test_bar_renews_itself(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    shown = said("auto", True, monkeypatch, capsys).split("\r")[1:]
    assert len(shown) == 4
    assert shown[1].startswith(f"[{'#' * 13}{'.' * (BAR - 13)}] 550 of 1000 trials, 3 failed, 45.0/s, 10 s left")
    assert "\n" not in "".join(shown[:-1])
    assert shown[-1].startswith(f"[{'#' * BAR}] 1000 of 1000 trials, 4 failed, 45.0/s ")
    assert shown[-1].endswith("\n")


def test_lines_elsewhere_not_more_often_than_every_five_seconds(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = said("auto", False, monkeypatch, capsys).splitlines()
    assert [line.split()[0] for line in lines] == ["100", "550", "1000"]


def test_json_a_line(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    lines = [json.loads(line) for line in said("json", True, monkeypatch, capsys).splitlines()]
    assert lines[1] == {"finished": 550, "total": 1000, "failed": 3, "rate_per_s": 45.0, "left_s": 10.0}


def test_long_times_are_in_minutes_and_hours(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    report = reporter("plain")
    assert report is not None
    report(0, 10_000, 0, 0.0)
    report(10, 10_000, 0, 10.0)
    assert capsys.readouterr().err.splitlines()[1:] == ["10 of 10000 trials, 0 failed, 1.0/s, 2 h 46 min left"]


def test_each_study_of_a_comparison_has_lines_and_a_rate_of_its_own(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The second one's began when it had taken longer than the first, and its rate counted from the first's trials."""
    report = reporter("plain")
    assert report is not None
    for finished, seconds in ((200, 0.0), (50, 0.0), (60, 10.0), (200, 150.0)):
        report(finished, 200, 0, seconds)
    lines = capsys.readouterr().err.splitlines()
    assert [line.split(",")[0].split()[0] for line in lines] == ["200", "50", "60", "200"]
    assert lines[2] == "60 of 200 trials, 0 failed, 1.0/s, 2 min left"


def test_none_says_nothing() -> None:
    assert reporter("none") is None


@pytest.mark.parametrize("columns", [20, 40, 60, 80, 120])
def test_the_bar_never_fills_the_terminals_line(columns: int) -> None:
    for text in ("7 of 9 trials, 0 failed, 0.1/s", "100000 of 100000 trials, 1234 failed, 1000.0/s, 12 h 31 min left"):
        shown = bar(0.5, text, columns)
        assert len(shown) == columns - 1
        assert text in shown or len(text) > columns - 1
    assert bar(0.5, "x", 60).startswith(f"[{'#' * 12}{'.' * 12}] x ")
    assert bar(1.0, "x" * 40, 60).startswith(f"[{'#' * 16}] x")
