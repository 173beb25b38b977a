"""Progress of a study on stderr: a bar that renews itself on a terminal, lines otherwise, one JSON object a line for
machines."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable

from .. import terminal

BAR, LEAST = 24, 5  # characters
EVERY = 5.0  # s between lines where nothing renews itself


def reporter(kind: str) -> Callable[[int, int, int, float], None] | None:
    """A function of (finished, of, failed, seconds) for kind auto, plain, json or none."""
    if kind == "none":
        return None
    renews = kind == "auto" and sys.stderr.isatty()
    shown = -EVERY
    at_first: int | None = None

    def report(finished: int, total: int, failed: int, seconds: float) -> None:
        nonlocal shown, at_first
        at_first = finished if at_first is None else at_first
        last = finished == total
        if not (renews or last or seconds - shown >= EVERY):
            return
        shown = seconds
        rate = (finished - at_first) / seconds if seconds > 0 else 0.0
        left = (total - finished) / rate if rate > 0 else None
        if kind == "json":
            print(
                json.dumps(
                    {"finished": finished, "total": total, "failed": failed, "rate_per_s": rate, "left_s": left}
                ),
                file=sys.stderr,
                flush=True,
            )
            return
        line = f"{finished} of {total} trials, {failed} failed, {rate:.1f}/s" + (
            f", {_span(left)} left" if left is not None and not last else ""
        )
        if renews:
            line = f"\r{bar(finished / total, line, terminal.width(sys.stderr) or terminal.USUAL)}"
        print(line, end="\n" if last or not renews else "", file=sys.stderr, flush=True)

    return report


def bar(share: float, text: str, columns: int) -> str:
    """One line that covers an earlier one and leaves the last of the terminal's columns free, where a cursor stands."""
    room = min(BAR, columns - 1 - len(text) - len("[] "))
    drawn = f"[{'#' * round(room * share):.<{room}}] " if room >= LEAST else ""
    return f"{drawn + text:{columns - 1}.{columns - 1}}"


def _span(seconds: float) -> str:
    minutes, hours = round(seconds) // 60, round(seconds) // 3600
    return f"{seconds:.0f} s" if seconds < 100 else f"{minutes} min" if hours < 2 else f"{hours} h {minutes % 60} min"
