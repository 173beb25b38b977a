"""Numbers in sentences: neither finer nor surer than what is known."""

from __future__ import annotations

import math

import pytest

from sprain_cosim.report.words import ends, interval, percent, rounded, signed
from sprain_cosim.study.summary import Probability
from sprain_cosim.units import RARE, percentage_ends


@pytest.mark.parametrize(
    ("p", "text"),
    [
        (None, "–"),
        (0.0, "0 %"),
        (4.5e-7, "< 0.01 %"),
        (9.9e-5, "< 0.01 %"),
        (1e-4, "0.01 %"),
        (0.0158, "1.6 %"),
        (0.0996, "10 %"),
        (0.824, "82 %"),
        (0.9949, "99 %"),
        (0.9999997, "> 99.5 %"),
        (1.0, "100 %"),
    ],
)
def test_probabilities(p: float | None, text: str) -> None:
    assert percent(p) == text


def test_the_interval_of_a_small_probability_is_as_fine_as_the_probability() -> None:
    assert percentage_ends(1e-8, 3e-3) == ("< 0.01 … 0.3",)
    assert percentage_ends(None, None) == ()


def test_a_probability_is_as_fine_as_its_interval() -> None:
    """1.6 % stood beside 1.55 … 1.59 %."""
    assert percent(0.0157, interval=(0.0155, 0.0159)) == "1.57 %"
    assert percent(0.02, interval=(0.0182, 0.0216)) == "2 %"
    assert percent(0.83, interval=(0.733, 0.936)) == "83 %"
    assert percent(0.83, interval=(None, 0.936)) == "83 %"


def test_an_interval_has_a_third_figure_only_where_two_do_not_tell_its_ends_apart() -> None:
    assert percentage_ends(0.0208, 0.0243) == ("2.1 … 2.4",)
    assert percentage_ends(0.0208, 0.0212) == ("2.08 … 2.12",)
    assert percentage_ends(0.122, 0.1243) == ("12.2 … 12.4",)
    assert percentage_ends(0.0, 0.0) == ("0 … 0",)
    assert percentage_ends(2.14e-5, 3.1e-5, RARE) == ("0.0021 … 0.0031",), "what a search found is no sample's share"


def test_numbers() -> None:
    assert [rounded(v) for v in (12345.6, -12.34, 1.234, 0.0123, 1e-9, -1e-9, math.nan, None, "x")] == [
        "12346", "−12.3", "1.23", "0.012", "0.00", "0.00", "–", "–", "–",
    ]  # fmt: skip
    assert [rounded(v) for v in (-0.003, -0.0004, -0.0)] == ["−0.003", "0.00", "0.00"]  # the first had lost its sign
    assert [signed(v, 2) for v in (-0.001, -0.0)] == ["+0.00", "+0.00"]
    assert [signed(v, 2) for v in (0.001, -1.0, None)] == ["+0.00", "−1.00", "–"]
    assert (ends(0.5, None), ends(None, 0.5), ends(None, None)) == (("0.50 … open",), ("open … 0.50",), ())
    assert ends(0.5, 0.75, 10) == ("5.00 … 7.50",)
    assert interval(Probability("e", 0.5, -0.2, -0.1), 10, "°", negate=True) == " (95 % interval 1.00 … 2.00°)"
