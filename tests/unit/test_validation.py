"""The validation suite itself: how outcomes are judged, what is never counted as passed, what is written, a user's own
checks."""

from __future__ import annotations

import json
import re
from pathlib import Path
from xml.etree import ElementTree

import pytest

from sprain_cosim.errors import InputError
from sprain_cosim.validation import suite
from sprain_cosim.validation import writers as output
from sprain_cosim.validation.check import Check, CheckRow, Gap, judge
from sprain_cosim.validation.checks import user_files as custom
from sprain_cosim.validation.laboratory import NEEDS, Laboratory


def check(name: str = "unit-01", *rows: CheckRow, **more) -> Check:
    return Check(name, "a <title> & more", "because", "nowhere", lambda _: list(rows), **more)


def explode(_: Laboratory) -> list[CheckRow]:
    raise ZeroDivisionError("on purpose")


WITHIN, OUTSIDE = CheckRow("in", 1.04, 1.0, 0.05, "deg"), CheckRow("out", 1.3, 1.0, 0.05, "deg")


def test_status_is_that_of_the_worst_row() -> None:
    assert judge(check(), [WITHIN]).status == "pass"
    failed = judge(check(), [WITHIN, OUTSIDE])
    assert failed.status == "fail"
    assert failed.reason == "1 of 2 outside: out 1.3 against 1 ± 0.05 deg"
    assert failed.worst is OUTSIDE
    assert judge(check(), [CheckRow("nan", float("nan"), 0.0, 1.0)]).status == "fail"
    assert judge(check(), []).status == "fail"
    assert judge(check(), [CheckRow("edge", 0.0, 0.0, 0.0)]).status == "pass"


def test_a_known_gap_has_a_limit_of_its_own() -> None:
    known = check(gaps={"out": Gap(0.31, "documented")})
    outcome = judge(known, [WITHIN, OUTSIDE])
    assert outcome.status == "known gap"
    assert outcome.reason == "out 1.3 against 1 ± 0.05 deg: documented"
    assert judge(known, [CheckRow("out", 1.32, 1.0, 0.05)]).status == "fail"
    assert judge(known, [CheckRow("out", 1.01, 1.0, 0.05)]).status == "pass"
    assert judge(known, [OUTSIDE, CheckRow("other", 1.3, 1.0, 0.05)]).status == "fail"


@pytest.fixture
def report(monkeypatch: pytest.MonkeyPatch) -> suite.Report:
    monkeypatch.setitem(NEEDS, "a unicorn", lambda _: "no unicorn on this machine")
    checks = [
        check("unit-01", WITHIN),
        check("unit-02", OUTSIDE, gaps={"out": Gap(0.31, "documented")}),
        check("unit-03", WITHIN, needs=("a unicorn",)),
        check("unit-04", WITHIN, quick=False),
    ]
    return suite.run_checks(checks, Laboratory(quick=True))


def test_neither_gaps_nor_what_was_not_run_count_as_passed(report: suite.Report) -> None:
    assert report.counts == {"pass": 1, "known gap": 1, "fail": 0, "not run": 2}
    assert [o.reason for o in report.outcomes[2:]] == ["no unicorn on this machine", "left out of --quick"]
    assert report.passes()
    assert not report.passes(strict=True)
    assert "1 pass, 1 known gap, 0 fail, 2 not run" in suite.totals(report)


def test_a_choice_of_checks_is_not_taken_for_all() -> None:
    """A page of four checks said that none failed, and nothing of the others."""
    report = suite.run_checks([check("unit-01", WITHIN)], Laboratory(), of=150)
    assert suite.totals(report).startswith("1 of 150 checks (--only) with 1 numbers")
    page = output.validation_page(report)
    assert "<h1>No check failed, 1 passed; 1 of 150 checks (--only)</h1>" in page
    assert "1 of 150 checks (--only)" in output.markdown(report)
    assert json.loads(output.json_text(report))["of"] == 150
    assert "Every check of this run passed." in page


def test_a_check_that_cannot_be_measured_fails() -> None:
    broken = Check("unit-05", "broken", "-", "-", explode)
    report = suite.run_checks([broken, check("unit-06", WITHIN)], Laboratory())
    assert [o.status for o in report.outcomes] == ["fail", "pass"]
    assert report.outcomes[0].reason == "could not be measured: ZeroDivisionError: on purpose"
    assert not report.passes()


def test_what_is_written(report: suite.Report, tmp_path: Path) -> None:
    output.check_targets(tmp_path / "v", None)
    output.write_validation(report, tmp_path / "v")
    assert {p.name for p in (tmp_path / "v").iterdir()} == set(output.FILES)
    data = json.loads((tmp_path / "v" / "validation.json").read_text())
    assert data["status"] == "passed"
    assert [c["status"] for c in data["checks"]] == ["pass", "known gap", "not run", "not run"]
    assert data["checks"][0]["rows"] == [
        {"label": "in", "value": 1.04, "expected": 1.0, "tolerance": 0.05, "unit": "deg", "status": "pass"}
    ]
    root = ElementTree.parse(tmp_path / "v" / "junit.xml").getroot()
    assert (root.get("tests"), root.get("failures"), root.get("skipped")) == ("4", "0", "3")
    assert [[e.tag for e in case] for case in root.iter("testcase")] == [[], ["skipped"], ["skipped"], ["skipped"]]
    page = (tmp_path / "v" / "validation.html").read_text()
    assert "a &lt;title&gt; &amp; more" in page
    assert "<h1>No check failed, 1 passed</h1>" in page
    assert not re.search(r"(src|href)=(?!.data:,)|https?://|@import|url\(", page), "self-contained"
    text = (tmp_path / "v" / "credibility.md").read_text()
    assert (
        text.index("context of use")
        < text.index("Quantities of interest")
        < text.index("Model risk")
        < text.index("4a Verification")
        < text.index("5a Validation")
        < text.index("6 Uncertainty")
        < text.index("7 Applicability")
    )
    assert "unit-02 KNOWN GAP" in text.partition("8 What falls short")[2]
    assert "the domain in which the numerics were checked" not in text, "nothing is shown that was not run"
    with pytest.raises(InputError, match="is a file"):
        output.check_targets(tmp_path / "v" / "junit.xml", None)
    with pytest.raises(InputError, match="is a folder"):
        output.check_targets(None, tmp_path)


def test_a_failure_reaches_every_output() -> None:
    report = suite.run_checks([check("unit-01", OUTSIDE)], Laboratory())
    assert json.loads(output.json_text(report))["status"] == "failed"
    assert "<failure" in output.junit(report)
    assert "<h1>Validation failed: 1 check</h1>" in output.validation_page(report)


def test_an_interrupt_keeps_what_is_known() -> None:
    def interrupt(_: Laboratory) -> list[CheckRow]:
        raise KeyboardInterrupt

    kept: list[suite.Report] = []
    checks = [check("unit-01", WITHIN), Check("unit-02", "t", "w", "s", interrupt), check("unit-03", WITHIN)]
    with pytest.raises(KeyboardInterrupt):
        suite.run_checks(checks, Laboratory(), keep=kept.append)
    swallowed = [check("unit-01", WITHIN), Check("unit-02", "t", "w", "s", explode), check("unit-03", WITHIN)]
    with pytest.raises(KeyboardInterrupt):
        suite.run_checks(swallowed, Laboratory(), keep=kept.append, interrupted=iter([False, True]).__next__)
    for report in kept:
        assert [(o.status, o.reason) for o in report.outcomes] == [
            ("pass", ""),
            ("not run", "interrupted"),
            ("not run", "interrupted"),
        ]


def test_the_suite_is_numbered_and_says_why() -> None:
    checks = suite.suite()
    assert len({c.id for c in checks}) == len(checks) > 60
    for c in checks:
        assert re.fullmatch(r"[a-z]+-\d\d", c.id)
        assert c.title and c.why and c.source, c.id
        assert set(c.needs) <= set(NEEDS)


def test_selection() -> None:
    checks = suite.suite()
    assert [c.id for c in suite.select(checks, ["coupling-01"])] == ["coupling-01"]
    assert {c.group for c in suite.select(checks, ["uq"])} == {"uq"}
    assert len(suite.select(checks, ["uq-0*", "code-01"])) == 10
    with pytest.raises(InputError, match=r"--only papr: no check of that id or group \(did you mean paper\?\)"):
        suite.select(checks, ["papr"])


def test_numbers_that_the_project_carries() -> None:
    """About two hundred figures, each landing with its peak, each group with a source."""
    figures = Laboratory().figures
    assert len(figures["landing"]) == 33
    assert all("peak_subtalar_angle_deg" in e for e in figures["landing"])
    assert len(figures["muscle"]) == 8


MINE = """[[check]]
id = "short"
title = "A short run"
scenario = "mine.toml"
set = { "plant.drop_height" = "0.25 m" }
metric = "peak_vertical_grf_N"
between = [0, 1e6]
why = "any landing"
source = "none"
"""


def test_a_users_own_checks(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(MINE)
    scenarios = tmp_path / "scenarios"
    scenarios.mkdir()
    (scenarios / "mine.toml").write_text('base = "incline30"\n[master]\nstop = "10 ms"\n')
    (tmp_path / "mine.toml").write_text(MINE.replace('"mine.toml"', '"scenarios/mine.toml"'))
    (found,) = custom.read_checks(tmp_path)
    assert found.id == "custom-short"
    report = suite.run_checks([found], Laboratory())
    assert report.outcomes[0].status == "pass"
    assert report.outcomes[0].rows[0].unit == "N"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (('why = "any landing"\n', ""), r"mine.toml, check 1: why: needed, as text"),
        (("between = [0, 1e6]", "between = [3, 1]"), r"between: must be \[low, high\]"),
        (("between = [0, 1e6]", "expected = 3"), r"needs expected and tolerance"),
        (("metric =", "metrik ="), r"unknown key 'metrik' \(did you mean metric\?\)"),
        (('scenario = "mine.toml"', 'scenario = "incline"'), r"check 1: scenario 'incline'"),
        (('"0.25 m"', "0.25"), r"plant.drop_height"),
        (("[[check]]", "[[check]"), r"mine.toml: "),
        (('scenario = "mine.toml"', 'scenario = "incline30"\ntrials = 3'), r"trials: belongs to a study"),
        (('scenario = "mine.toml"', 'study = "study6"'), r"statistic: needed with study"),
    ],
)
def test_mistakes_in_a_users_own_checks(change: tuple[str, str], message: str, tmp_path: Path) -> None:
    text = MINE.replace(*change).replace('"mine.toml"', '"incline30"')
    (tmp_path / "mine.toml").write_text(text)
    with pytest.raises(InputError, match=message) as problem:
        custom.read_checks(tmp_path)
    assert "\n" not in str(problem.value)


def test_two_checks_of_one_id_and_an_empty_folder(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="holds no"):
        custom.read_checks(tmp_path)
    (tmp_path / "mine.toml").write_text(MINE.replace("mine.toml", "incline30") * 2)
    with pytest.raises(InputError, match="'custom-short' is used twice"):
        custom.read_checks(tmp_path)
