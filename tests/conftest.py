"""Fixtures for all tests, and one line that says what was skipped for want of the reference numbers."""

from __future__ import annotations

import os

import pytest

from tools.reference import FOLDER


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    missing = [r for r in terminalreporter.stats.get("skipped", []) if "reference numbers not found" in str(r.longrepr)]
    if missing:
        terminalreporter.write_line(
            f"{len(missing)} tests skipped: no reference numbers in {FOLDER} (set SPRAIN_REFERENCE)"
        )


@pytest.fixture
def every_row_is_committed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Studies of this process commit and tell their progress after each trial, not after 0.25 s, in which a fast
    machine finishes them."""
    monkeypatch.setattr("sprain_cosim.study.dispatch.COMMIT", -1.0)


@pytest.fixture(scope="session", autouse=True)
def cache(tmp_path_factory: pytest.TempPathFactory):
    """Unpacked FMUs go to a fresh folder."""
    from pathlib import Path

    fresh = tmp_path_factory.mktemp("cache")
    before = os.environ.get("SPRAIN_COSIM_CACHE")
    os.environ["SPRAIN_COSIM_CACHE"] = str(fresh)
    yield Path(fresh)
    if before is None:
        del os.environ["SPRAIN_COSIM_CACHE"]
    else:
        os.environ["SPRAIN_COSIM_CACHE"] = before
