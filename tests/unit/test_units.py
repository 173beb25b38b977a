"""Units: names, dimensions, quantities."""

from __future__ import annotations

import contextlib
import math
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sprain_cosim.errors import InputError
from sprain_cosim.units import SYMBOLS, Unit, quantity, shown_unit, unit


@pytest.mark.parametrize(
    ("text", "value", "dimension"),
    [
        ("N.m/rad", 1.0, "kg.m2/(s2.rad)"),
        ("N*m", 1.0, "kg.m2/s2"),
        ("N.mm", 1e-3, "kg.m2/s2"),
        ("lbf.in", 0.45359237 * 9.80665 * 0.0254, "kg.m2/s2"),
        ("deg/s", math.pi / 180, "rad/s"),
        ("MPa/m", 1e6, "kg/(m2.s2)"),
        ("kg.m^2", 1.0, "kg.m2"),
        ("m/s2", 1.0, "m/s2"),
        ("W/(m.K)", 1.0, "kg.m/(s3.K)"),
        ("%", 0.01, "1"),
        ("ms", 1e-3, "s"),
        ("min", 60.0, "s"),
    ],
)
def test_factor_and_dimension(text: str, value: float, dimension: str) -> None:
    assert unit(text).factor == pytest.approx(value, rel=1e-14)
    assert unit(text).dimension() == dimension


@pytest.mark.parametrize(
    ("text", "same"),
    [
        ("N⋅m", "N.m"),
        ("N·m/rad", "N.m/rad"),
        ("N-m", "N.m"),
        ("N-mm/deg", "N.mm/deg"),
        ("in-lbf", "lbf.in"),
        ("Nmm", "N.mm"),
        ("Ncm", "N.cm"),
        ("º", "deg"),
        ("º/s", "deg/s"),
        ("degrees", "deg"),
        ("Degrees/sec", "deg/s"),
        ("deg/sec", "deg/s"),
        ("radians", "rad"),
        ("rad⁻¹", "rad-1"),
        ("N·m·rad⁻¹", "N.m/rad"),
        ("m/s²", "m/s2"),
        ("μm", "µm"),
    ],
)
def test_the_spellings_that_people_use(text: str, same: str) -> None:
    assert unit(text).exponents == unit(same).exponents
    assert unit(text).factor == pytest.approx(unit(same).factor, rel=1e-14)
    assert unit(text).name == text


def test_units_of_other_trades() -> None:
    assert unit("rpm").factor == pytest.approx(2 * math.pi / 60)
    assert unit("rpm").dimension() == "rad/s"
    assert unit("ozf.in").factor == pytest.approx(0.00706155181, rel=1e-8)
    assert quantity("90 degrees", unit("rad"), "angle") == pytest.approx(math.pi / 2)


@pytest.mark.parametrize("text", ["furlong", "N.", "m//s", "", "m/s/s", "degC/s", "kkg"])
def test_unknown_units_are_refused(text: str) -> None:
    with pytest.raises(InputError, match="unit"):
        unit(text)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("Nm/Grad", "two meanings; write deg"),  # German degrees; was a thousand million radians, and the brace void
        ("grad", "two meanings; write deg"),
        ("Mm", "write mm or m"),  # a table in capitals; was a million metres
        ("N.Mm", "write mm or m"),
        ("Ms", "write ms or s"),
        ("Mrad/s", "write mrad or rad"),
        ("Mg", "write mg or g"),
        ("10 N", "cannot read '10'"),  # was 1 N
        ("12 N", "cannot read '12'"),
        ("1-1", "cannot read '1-1'"),
        ("g0", "cannot read 'g0'"),  # standard gravity; was the pure number 1
        ("m^0", "cannot read"),
        ("Nm/rad.s", "has two readings; write Nm.s/rad or Nm/(rad.s)"),  # was the second one
        ("N.m/rad s", "write N.m.s/rad or N.m/(rad.s)"),
        ("1/rad*s", "write s/rad or 1/(rad.s)"),
        ("J/kg.K", "write J.K/kg or J/(kg.K)"),
        ("m/s^-2", "s^-2 below a slash has two readings; write /s2 or .s^-2"),  # was m.s2
        ("N.m/rad⁻¹", "write /rad or .rad-1"),
        ("krad", "is no measure of an angle here; write mrad, rad or deg"),
        ("crad/s", "is no measure of an angle here"),
    ],
)
def test_what_would_be_read_wrongly_is_refused(text: str, said: str) -> None:
    with pytest.raises(InputError, match=re.escape(said)):
        unit(text)


def test_a_unit_that_an_fmu_defines_itself_is_taken_as_it_is_written() -> None:
    own = Unit("Nm/rad.s", unit("N.m.s/rad").exponents)
    assert quantity("0.3 Nm/rad.s", own, "damping") == 0.3


def test_a_number_behind_a_number_is_no_unit() -> None:
    with pytest.raises(InputError, match="cannot read '10'"):
        quantity("5 10 m", unit("m"), "drop")
    assert quantity("5 1/s", unit("Hz"), "rate") == 5.0


def test_a_difference_of_temperatures_has_no_zero() -> None:
    kelvin, celsius = unit("K"), unit("degC")
    assert quantity("5 degC", kelvin, "sd", difference=True) == 5.0
    assert quantity("5 K", celsius, "sd", difference=True) == 5.0
    assert quantity("5 degC", kelvin, "mean") == 278.15


def test_quantity_converts() -> None:
    assert quantity("0.5 ms", unit("s"), "step") == pytest.approx(5e-4)
    assert quantity("30deg", unit("rad"), "angle") == pytest.approx(math.pi / 6)
    assert quantity("20 %", unit("1"), "share") == pytest.approx(0.2)
    assert quantity("20 degC", unit("K"), "t") == pytest.approx(293.15)
    assert quantity("4.5 N.m", unit("N.mm"), "torque") == pytest.approx(4500.0)


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (0.3, 'needs a unit, for example "0.3 m"'),
        ("0.3", 'needs a unit, for example "0.3 m"'),
        ("0.3 rad", "has the dimension rad, expected m"),
        ("0.3 mn", "unknown symbol 'mn'"),
        ("tall", "expected a number and a unit"),
        (True, "expected a number"),
        ("nan m", "expected a number"),
        (float("inf"), "must be finite"),
        ("1e999 m", "must be finite"),
    ],
)
def test_quantity_says_what_is_wrong(value: object, words: str) -> None:
    with pytest.raises(InputError) as problem:
        quantity(value, unit("m"), "plant.drop_height")
    assert words in str(problem.value)
    assert str(problem.value).startswith("plant.drop_height")


def test_the_example_for_an_angle_is_in_degrees() -> None:
    with pytest.raises(InputError, match='needs a unit, for example "30 deg"'):
        quantity(30.0, unit("rad"), "plant.platform_incline")


def test_the_example_for_a_time_is_in_milliseconds_unless_seconds_are_usual() -> None:
    for proposed, shown in (("", "ms"), ("s", "s")):
        with pytest.raises(InputError, match=f'needs a unit, for example "20 {shown}"'):
            quantity("20", unit("s"), "--trial-limit", proposed)


@given(st.floats(-1e6, 1e6), st.sampled_from(sorted(SYMBOLS)))
def test_there_and_back(value: float, symbol: str) -> None:
    u = unit(symbol)
    assert u.from_base(u.to_base(value)) == pytest.approx(value, rel=1e-12, abs=1e-9)


@given(st.text(max_size=20))
def test_any_text_gives_a_unit_or_an_input_error(text: str) -> None:
    with contextlib.suppress(InputError):
        assert isinstance(unit(text), Unit)


def test_a_unit_that_an_fmu_alone_defines_is_read_in_its_own_name() -> None:
    """A message proposed "1 degF" for such a parameter, which was refused as unknown."""
    fahrenheit = Unit("degF", unit("K").exponents, 5 / 9, 255.3722222222222)
    assert quantity("68 degF", fahrenheit, "t") == 68.0
    assert quantity("293.15 K", fahrenheit, "t") == pytest.approx(68.0)
    assert quantity("10 K", fahrenheit, "t.sd", difference=True) == pytest.approx(18.0)
    assert shown_unit("degF") == (1.0, "degF")
