"""Progress of a study: a bar that renews itself on a terminal or in a notebook's cell, lines elsewhere, one JSON object
a line for machines."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from html import escape
from importlib import import_module
from typing import Any

from .. import terminal
from ..errors import InputError, ipython_shell, nearest

BAR, LEAST = 24, 5  # characters
EVERY = 5.0  # s between lines where nothing renews itself
KINDS = ("auto", "plain", "json", "none")
Progress = Callable[[int, int, int, float], None]  # finished, of, failed, seconds


def shown_to(progress: Progress | str | None) -> Progress | None:
    """What a session shows: `progress` itself where it is a function, else that of its kind; "auto" is silent where no
    terminal and no notebook would renew it. Raises InputError for a kind that there is not."""
    if progress is None or callable(progress):
        return progress
    if progress not in KINDS:
        raise InputError(f"progress = {progress!r}: no such kind{nearest(str(progress), KINDS)}, and no function")
    silent = progress == "auto" and not sys.stderr.isatty() and _display() is None
    return None if silent else reporter(progress)


def reporter(kind: str) -> Progress | None:
    """A function of (finished, of, failed, seconds) for a kind of KINDS."""
    if kind == "none":
        return None
    cell = _Cell.here() if kind == "auto" else None
    renews = kind == "auto" and sys.stderr.isatty()
    shown = -EVERY
    at_first = 0

    def report(finished: int, total: int, failed: int, seconds: float) -> None:
        nonlocal shown, at_first
        if seconds == 0.0:  # a study begins, such as that of a comparison's next brace
            shown, at_first = -EVERY, finished
        last = finished == total
        if not (cell or renews or last or seconds - shown >= EVERY):
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
        if cell:
            cell.show(finished / total, f"{finished} of {total} trials, {failed} failed" if last else line)
            return
        if renews:
            line = f"\r{bar(finished / total, line, terminal.width(sys.stderr) or terminal.USUAL)}"
        print(line, end="\n" if last or not renews else "", file=sys.stderr, flush=True)

    return report


def _display() -> Callable[..., Any] | None:
    """IPython's `display` in the kernel of a notebook; None elsewhere. Nothing is imported that is not there."""
    if getattr(ipython_shell(), "kernel", None) is None:
        return None
    display: Callable[..., Any] = import_module("IPython.display").display
    return display


class _Cell:
    """The place under a notebook's cell that renews itself."""

    def __init__(self, display: Callable[..., Any]) -> None:
        self._display, self._place = display, None

    @classmethod
    def here(cls) -> _Cell | None:
        display = _display()
        return None if display is None else cls(display)

    def show(self, share: float, text: str) -> None:
        shown = _Shown(share, text)
        if self._place is None:
            self._place = self._display(shown, display_id=True)
        else:
            self._place.update(shown)


class _Shown:
    def __init__(self, share: float, text: str) -> None:
        self.share, self.text = share, text

    def __repr__(self) -> str:
        return self.text

    def _repr_html_(self) -> str:
        return f'<progress max="1" value="{self.share:.3f}" style="width: 16em"></progress> {escape(self.text)}'


def bar(share: float, text: str, columns: int) -> str:
    """One line that covers an earlier one and leaves the last of the terminal's columns free, where a cursor stands."""
    room = min(BAR, columns - 1 - len(text) - len("[] "))
    drawn = f"[{'#' * round(room * share):.<{room}}] " if room >= LEAST else ""
    return f"{drawn + text:{columns - 1}.{columns - 1}}"


def _span(seconds: float) -> str:
    minutes, hours = round(seconds) // 60, round(seconds) // 3600
    return f"{seconds:.0f} s" if seconds < 100 else f"{minutes} min" if hours < 2 else f"{hours} h {minutes % 60} min"
