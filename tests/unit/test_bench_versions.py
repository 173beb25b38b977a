"""The table of speeds, old and new: what is missed says so, and an old version that cannot be built leaves its column
empty."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent.parent / "tools"))

from bench_versions import ROWS, least, table

KEYS = ("direct", "braced", "direct_session", "braced_session", "peak", "command", "command_wall", "first_worker")
NEW = dict.fromkeys((*KEYS, "worker", "memory", "study", "each"), 0.01)


def test_what_is_missed_says_so() -> None:
    old = NEW | {"direct": 0.027, "braced": 0.0299}
    lines = table(old, NEW).splitlines()
    assert lines[2] == "| scenario.run(), no brace | 27 ms | 10 ms | 2.70 | 2.7 |"
    assert lines[3] == "| scenario.run(), with a brace | 29.9 ms | 10 ms | 2.99 | 3, missed |"
    assert len(lines) == 2 + len(ROWS)


def test_without_an_old_version_its_column_is_empty() -> None:
    assert table(None, NEW).splitlines()[2] == "| scenario.run(), no brace | – | 10 ms |  | 2.7 |"


def test_the_least_of_the_rounds_counts() -> None:
    assert least([{"a": 2.0, "b": 1.0}, {"a": 1.0, "b": 3.0}]) == {"a": 1.0, "b": 1.0}
