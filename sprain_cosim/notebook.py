"""How a result shows itself: a line in a shell, a small table in a notebook."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from .errors import EnvironmentProblem, visible

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LONGEST = 400  # characters of a line
LONGEST_VALUE = 160
Rows = Sequence[tuple[str, str]]


class Card:
    """Base of what a session shows in brief: `card` gives the heading, and what is known as (label, value) rows. A
    dataclass must be declared with repr=False to keep it."""

    def card(self) -> tuple[str, Rows]:
        raise NotImplementedError

    def __repr__(self) -> str:
        heading, rows = self.card()
        line = "; ".join(f"{label} {shortened(value)}" for label, value in rows)
        return shortened(visible(f"{type(self).__name__}({shortened(heading)}: {line}"), LONGEST - 1) + ")"

    def _repr_html_(self) -> str:
        from html import escape

        heading, rows = self.card()
        lines = "".join(
            f'<tr><th scope="row" style="text-align:left">{escape(label)}</th>'
            f'<td style="text-align:left">{escape(shortened(visible(value), LONGEST))}</td></tr>'
            for label, value in rows
        )
        name = f"{type(self).__name__}: {shortened(visible(heading))}"
        return f'<table><caption style="text-align:left">{escape(name)}</caption><tbody>{lines}</tbody></table>'


class Plottable(Card):
    """Base of what can draw itself."""

    def plot(self, kind: str = "") -> Figure:
        """A matplotlib figure of the `kind` that `sprain-cosim plot` calls so, such as landing, cdf, tornado or paired;
        empty: the first of them. Nothing is simulated. Raises InputError for a kind that it does not allow."""
        return draw(self, kind)


def _unset(item: Plottable, kind: str) -> Figure:
    raise EnvironmentProblem("sprain_cosim is loaded in part; import sprain_cosim")


draw: Callable[[Plottable, str], Figure] = _unset  # the package sets it: the figures lie above what is drawn


def shortened(text: str, longest: int = LONGEST_VALUE) -> str:
    return text if len(text) <= longest else text[: longest - 3] + "..."


def with_interval(value: float | None, low: float | None, high: float | None, unit: str) -> str:
    """ "27.3 deg (95 %: 26.9 ... 27.8)"; says so where there is no interval, or too few landings close an end."""
    if value is None:
        return "not known"
    ends = ["open" if end is None else f"{end:.4g}" for end in (low, high)]
    doubt = "no interval" if low is None and high is None else f"95 %: {' ... '.join(ends)}"
    return f"{value:.4g}{f' {unit}' if unit else ''} ({doubt})"


def with_doubt(value: float | None, doubt: float | None, unit: str) -> str:
    """ "27.31 ± 0.02 deg"; says so where the doubt of the communication step is not known."""
    if value is None:
        return "not known"
    if doubt is None:
        return f"{value:z.2f} {unit} (what the communication step leaves open is not known)"
    return f"{value:z.2f} ± {doubt:.2g} {unit} (communication step)"


def coupling_share(share: float | None) -> str:
    return (
        "not known (nothing was exchanged, or it was not judged)"
        if share is None
        else f"{100.0 * share:.2g} % of the exchanged energy"
    )
