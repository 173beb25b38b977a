"""Does what people look at open where they look at it? The report of a landing in a headless browser."""

from __future__ import annotations

import re
from pathlib import Path
from tempfile import TemporaryDirectory

from ...errors import EnvironmentProblem
from ...figures.landings import leave_run
from ...folders.read import read_folders
from ...folders.run import RunSummary
from ...process import run_program
from ...report.page import write_report
from ..check import Check, CheckRow
from ..laboratory import Laboratory, browser, scenario

SECONDS = 120


def report_of_a_landing(_: Laboratory) -> list[CheckRow]:
    """Messages on the console, and whether the page's own script has drawn the curve of the landing."""
    with TemporaryDirectory() as folder:
        run, chosen = Path(folder) / "run", scenario("incline30_brace")
        result = Laboratory.land(chosen)
        leave_run(run, result, RunSummary.of(chosen, result))
        page = write_report(read_folders([run]), Path(folder) / "report.html")
        text = page.read_text("utf-8")
        command = [
            browser(),
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--disable-dev-shm-usage",
            f"--user-data-dir={folder}/profile",
        ]
        options = ["--enable-logging=stderr", "--virtual-time-budget=4000", "--dump-dom", page.as_uri()]
        done = run_program([*command, *options], limit=SECONDS)
    if done.returncode:
        raise EnvironmentProblem(f"{command[0]} ended with {done.returncode}: {done.stderr.strip()[-200:]}")
    return [
        CheckRow("messages on the console", float(len(re.findall(r":CONSOLE[:(]", done.stderr))), 0, 0),
        CheckRow("curves drawn by the page", float(len(re.findall(r'<path[^>]*class="series', done.stdout))), 1, 0),
        CheckRow("requests to a server", float(len(re.findall(r'(?:src|<link[^>]+href)="https?://', text))), 0, 0),
    ]


CHECKS = (
    Check(
        "pages-01",
        "The report of a landing in a headless browser",
        "counts",
        "by definition",
        report_of_a_landing,
        needs=("browser",),
    ),
)
