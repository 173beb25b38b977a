"""Progress of a study on stderr: one line that renews itself on a terminal, lines otherwise, JSON for machines."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable

EVERY = 5.0  # s between lines where nothing renews itself


def reporter(kind: str) -> Callable[[int, int, int, float], None] | None:
    """A function of (finished, of, failed, seconds) for kind auto, plain, json or none."""
    if kind == "none":
        return None
    renews = kind == "auto" and sys.stderr.isatty()
    said = -EVERY
    begun: int | None = None

    def report(finished: int, total: int, failed: int, seconds: float) -> None:
        nonlocal said, begun
        begun = finished if begun is None else begun
        last = finished == total
        if not (renews or last or seconds - said >= EVERY):
            return
        said = seconds
        rate = (finished - begun) / seconds if seconds > 0 else 0.0
        left = (total - finished) / rate if rate > 0 else None
        if kind == "json":
            print(json.dumps({"finished": finished, "total": total, "failed": failed, "rate_per_s": rate, "left_s": left}), file=sys.stderr, flush=True)
            return
        line = f"{finished} of {total} trials, {failed} failed, {rate:.1f}/s" + (f", {left:.0f} s left" if left is not None and not last else "")
        print(f"\r{line:70}" if renews else line, end="\n" if last or not renews else "", file=sys.stderr, flush=True)

    return report
