"""What a run of the suite leaves: JSON, JUnit XML, one self-contained HTML page, and the credibility report as a text
to fill in."""

from __future__ import annotations

import html
import json
from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree

from .. import files
from ..errors import EnvironmentProblem, InputError
from .check import FAIL, GAP, NOT_RUN, PASS, Outcome
from .credibility import LABELS, NOTE, markdown, sections
from .suite import Report, line, summary

FILES = ("validation.html", "validation.json", "junit.xml", "credibility.md")
COLOURS = {
    "pass": "#1b7f4b",
    "known gap": "#9a6700",
    "fail": "#b42318",
    "not run": "#57606a",
}  # readable on white, and never the only sign
STYLE = """
:root { font: 16px/1.5 system-ui, sans-serif; color: #1c2733; background: #fff }
body { max-width: 62rem; margin: 0 auto; padding: 1rem }
h1 { font-size: 1.6rem } h2 { font-size: 1.2rem; margin-top: 2rem }
table { border-collapse: collapse; width: 100%; font-size: .9rem }
th, td { text-align: left; padding: .3rem .5rem; border-bottom: 1px solid #d8dee4; vertical-align: top }
td.n, th.n { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap }
.tag { color: #fff; border-radius: .3rem; padding: .05rem .4rem; font-size: .8rem; white-space: nowrap }
details > summary { cursor: pointer; padding: .15rem 0 } td.id { white-space: nowrap }
.why { color: #57606a; font-size: .85rem } .scroll { overflow-x: auto }
.tiles { display: flex; flex-wrap: wrap; gap: .6rem; margin: 1rem 0 }
.tile { border: 1px solid #d8dee4; border-radius: .4rem; padding: .4rem .8rem }
.tile b { font-size: 1.4rem; display: block }
@media print { details { break-inside: avoid }
.tag { border: 1px solid #000; color: #000; background: none !important } }
"""


def check_targets(out: Path | None, junit: Path | None) -> None:
    """Before anything runs: the folder `out` is there, `junit` can become a file. Raises InputError,
    EnvironmentProblem."""
    if out is not None and out.exists() and not out.is_dir():
        raise InputError(f"{out}: is a file; name a folder with --out")
    if junit is not None and junit.is_dir():
        raise InputError(f"{junit}: is a folder; name a file with --junit")
    for folder in (out, junit and junit.parent):
        if folder is not None:
            try:
                folder.mkdir(parents=True, exist_ok=True)
            except OSError as problem:
                raise EnvironmentProblem(f"{folder}: cannot be made: {problem.strerror}") from None


def write(report: Report, out: Path | None = None, xml: Path | None = None) -> None:
    """All files into the folder `out`, JUnit XML also as the file `xml`. Raises EnvironmentProblem."""
    if out is not None:
        texts = {
            "validation.html": page(report),
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
        members = [o for o in report.outcomes if o.check.group == group]
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
                "timestamp": report.created,
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
                ElementTree.SubElement(case, "failure", {"message": outcome.reason}).text = line(outcome)
            elif outcome in skipped:
                ElementTree.SubElement(case, "skipped", {"message": f"{outcome.status}: {outcome.reason}"})
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def page(report: Report) -> str:
    """One HTML file without network: verdict first, then every check with its numbers, then the credibility report."""
    esc = html.escape
    failed = report.count(FAIL)
    verdict = (
        f"Validation failed: {failed} {'check' if failed == 1 else 'checks'}"
        if failed
        else f"No check failed, {report.count(PASS)} passed"
    )
    kind = "quick run" if report.quick else "full run"
    tiles = "".join(
        f'<div class="tile"><b style="color:{COLOURS[s]}">{n}</b>{s}</div>' for s, n in report.counts.items()
    )
    facts = " · ".join(f"{esc(k)} {esc(v)}" for k, v in report.environment.items())
    body = [
        f"<h1>{verdict}</h1><p>{esc(summary(report))} ({kind}, {esc(report.created)})</p><div "
        f"class='tiles'>{tiles}</div>",
        "<p>A known gap is a miss whose size and reason are documented; it does not fail the run and is not counted "
        "as passed. "
        "A check that this machine or this kind of run could not carry out is not run, and not passed either.</p>",
        f"<p class='why'>{facts}</p>",
    ]
    short = [o for o in report.outcomes if o.status in (FAIL, GAP, NOT_RUN)]
    if short:
        body.append(
            "<h2>What did not pass</h2><div class='scroll'><table>"
            + "".join(_brief(o) for o in short)
            + "</table></div>"
        )
    for group in dict.fromkeys(o.check.group for o in report.outcomes):
        body.append(f"<h2>{esc(TITLES.get(group, group))}</h2>")
        body += [_details(o) for o in report.outcomes if o.check.group == group]
    body.append(f"<h1>Credibility report</h1><p>In the order of ASME V&amp;V 40. {esc(NOTE)}</p>")
    for section in sections(report):
        body.append(f"<h2>{esc(section.title)}</h2><p>{esc(section.intro)}</p>")
        for name, label in LABELS:
            entries = getattr(section, name)
            if entries:
                body.append(
                    f"<details {'open' if name != 'shown' else ''}><summary><b>{label}</b> "
                    f"({len(entries)})</summary><ul>"
                )
                body.append("".join(f"<li>{esc(entry)}</li>" for entry in entries) + "</ul></details>")
    head = (
        "<meta charset='utf-8'><meta name='viewport' content='width=device-width, "
        f"initial-scale=1'><title>{verdict}</title><style>{STYLE}</style>"
    )
    return f"<!doctype html>\n<html lang='en'><head>{head}</head><body>\n" + "\n".join(body) + "\n</body></html>\n"


TITLES: Mapping[str, str] = {
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


def _tag(status: str) -> str:
    return f"<span class='tag' style='background:{COLOURS[status]}'>{status}</span>"


def _brief(outcome: Outcome) -> str:
    title, reason = html.escape(outcome.check.title), html.escape(outcome.reason)
    return (
        f"<tr><td>{_tag(outcome.status)}</td><td class='id'>{outcome.check.id}</td><td>{title}<br><span "
        f"class='why'>{reason}</span></td></tr>"
    )


def _details(outcome: Outcome) -> str:
    esc, check = html.escape, outcome.check
    rows = "".join(
        f"<tr><td>{_tag(outcome.status_of(r))}</td><td>{esc(r.label)}</td><td class='n'>{r.value:.5g}</td><td "
        f"class='n'>{r.expected:.5g}</td>"
        f"<td class='n'>± {r.tolerance:.2g}</td><td>{esc(r.unit)}</td></tr>"
        for r in outcome.rows
    )
    table = (
        "<tr><th></th><th></th><th class='n'>value</th><th class='n'>expected</th><th "
        "class='n'>tolerance</th><th></th></tr>"
    )
    return (
        f"<details><summary>{_tag(outcome.status)} <b>{esc(check.id)}</b> {esc(check.title)} <span "
        f"class='why'>{outcome.seconds:.1f} s</span></summary>"
        f"<p class='why'>Tolerance: {esc(check.why)}. Source: "
        f"{esc(check.source)}.{f' {esc(outcome.reason)}' if outcome.reason else ''}</p>"
        f"<div class='scroll'><table>{table}{rows}</table></div></details>"
    )
