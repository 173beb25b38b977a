"""What a run of the suite leaves: JSON, JUnit XML, one self-contained HTML page, and the credibility report as a text
to fill in."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from xml.etree import ElementTree

from .. import files
from ..errors import EnvironmentProblem, InputError
from ..report.html import render
from .check import FAIL, GAP, NOT_RUN, PASS, CheckOutcome
from .credibility import LABELS, NOTE, Section, markdown, sections
from .suite import Report, outcome_line, totals

FILES = ("validation.html", "validation.json", "junit.xml", "credibility.md")
TITLES: Mapping[str, str] = {  # of the groups of checks
    "code": "Code verification",
    "coupling": "Coupling",
    "numerics": "Numerical convergence",
    "plant": "The plant against OpenSim",
    "uq": "Uncertainty numerics",
    "fmi": "FMI conformance",
    "pages": "What people look at",
    "paper": "The paper's studies",
    "custom": "Your own checks",
}


def check_targets(out: Path | None, junit: Path | None) -> None:
    """Before anything runs: the folder `out` is there, `junit` can become a file. Raises InputError,
    EnvironmentProblem."""
    if out is not None:
        files.check_folder(out)
    if junit is not None and junit.is_dir():
        raise InputError(f"{junit}: is a folder; name a file with --junit")
    for folder in (out, junit and junit.parent):
        if folder is not None:
            try:
                folder.mkdir(parents=True, exist_ok=True)
            except OSError as problem:
                raise EnvironmentProblem(f"{folder}: cannot be made: {problem.strerror}") from None


def write_validation(report: Report, out: Path | None = None, xml: Path | None = None) -> None:
    """All files into the folder `out`, JUnit XML also as the file `xml`. Raises EnvironmentProblem."""
    if out is not None:
        texts = {
            "validation.html": validation_page(report),
            "validation.json": json_text(report),
            "junit.xml": junit(report),
            "credibility.md": markdown(report),
        }
        for name in FILES:
            files.write(out / name, texts[name])
    if xml is not None:
        files.write(xml, junit(report))


def json_text(report: Report) -> str:
    return json.dumps(report.as_dict(), indent=1, allow_nan=False) + "\n"


def junit(report: Report) -> str:
    """Known gaps and checks that were not run are `skipped` with their reason: neither a success nor a failure."""
    root = ElementTree.Element(
        "testsuites",
        {
            "name": "sprain-cosim validate",
            "tests": str(len(report.outcomes)),
            "failures": str(report.count(FAIL)),
            "skipped": str(report.count(GAP) + report.count(NOT_RUN)),
            "time": f"{report.seconds:.3f}",
        },
    )
    for group in dict.fromkeys(o.check.group for o in report.outcomes):
        _junit_group(root, group, [o for o in report.outcomes if o.check.group == group], report.created)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def _junit_group(root: ElementTree.Element, group: str, members: Sequence[CheckOutcome], created: str) -> None:
    skipped = [o for o in members if o.status in (GAP, NOT_RUN)]
    suite = ElementTree.SubElement(
        root,
        "testsuite",
        {
            "name": group,
            "tests": str(len(members)),
            "failures": str(sum(o.status == FAIL for o in members)),
            "errors": "0",
            "skipped": str(len(skipped)),
            "time": f"{sum(o.seconds for o in members):.3f}",
            "timestamp": created,
        },
    )
    for outcome in members:
        case = ElementTree.SubElement(
            suite,
            "testcase",
            {
                "classname": f"validate.{group}",
                "name": f"{outcome.check.id} {outcome.check.title}",
                "time": f"{outcome.seconds:.3f}",
            },
        )
        if outcome.status == FAIL:
            ElementTree.SubElement(case, "failure", {"message": outcome.reason}).text = outcome_line(outcome)
        elif outcome in skipped:
            ElementTree.SubElement(case, "skipped", {"message": f"{outcome.status}: {outcome.reason}"})


def validation_page(report: Report) -> str:
    """One HTML file without network: verdict first, then every check with its numbers, then the credibility report."""
    failed = report.count(FAIL)
    title = f"No check failed, {report.count(PASS)} passed"
    if report.of > len(report.outcomes):
        title += f"; {report.size}"
    if failed:
        title = f"Validation failed: {failed} {'check' if failed == 1 else 'checks'}"
    groups = dict.fromkeys(o.check.group for o in report.outcomes)
    return render(
        "validation.html",
        title=title,
        summary=totals(report),
        report=report,
        short=[o for o in report.outcomes if o.status in (FAIL, GAP, NOT_RUN)],
        groups=[(TITLES.get(g, g), [o for o in report.outcomes if o.check.group == g]) for g in groups],
        note=NOTE,
        sections=[(section, _entries(section)) for section in sections(report)],
    )


def _entries(section: Section) -> list[tuple[str, Sequence[str], bool]]:
    """(label, entries, unfolded) of a section of the credibility report."""
    lists = [(label, getattr(section, name), name != "shown") for name, label in LABELS]
    return [entry for entry in lists if entry[1]]
