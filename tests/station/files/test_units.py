"""Quantities are a number, a blank and a unit of a closed table."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from station.units import (
    UNITS,
    Quantity,
    UnitError,
    convert,
    dimension_of,
    format_quantity,
    parse_as,
    parse_quantity,
)

UNITS_OF_THE_CONTRACT = """
    T mT uT nT G nT/cm A mA V mV uV ohm Hz kHz MHz s ms us min h deg arcmin arcsec rad deg/s deg/h
    rad/s deg/s^2 deg/sqrt(h) deg/h/mT m/s^2 g mg ug degC K degC/min degC/h deg/h^2 deg/h/degC A/s
    mH W mT/A nT/V Hz/nT mm d ppm % 1 V/g V/g^2 V/g^3 V/T V/T^2 V/g/T
"""


KNOWN = st.sampled_from(UNITS)
FINITE = st.floats(allow_nan=False, allow_infinity=False)
USABLE = FINITE.filter(lambda value: value == 0.0 or 1e-9 < abs(value) < 1e9)
"""Not beyond what a bench can set or measure, in any unit of a dimension."""


def test_every_unit_of_the_contract_is_known() -> None:
    assert set(UNITS_OF_THE_CONTRACT.split()) <= set(UNITS)


@given(FINITE, KNOWN)
def test_a_written_quantity_loses_nothing(value: float, unit: str) -> None:
    assert parse_quantity(format_quantity(value, unit)) == Quantity(value, unit)


@given(USABLE, KNOWN, KNOWN)
def test_a_quantity_is_converted_there_and_back_or_refused(
    value: float, unit: str, other: str
) -> None:
    text = format_quantity(value, unit)
    if dimension_of(unit) != dimension_of(other):
        with pytest.raises(UnitError, match="expected a"):
            parse_as(text, other)
        with pytest.raises(UnitError, match="expected a"):
            convert(value, unit, other)
        return
    for difference in (False, True):
        there = parse_as(text, other, difference=difference)
        back = convert(there, other, unit, difference=difference)
        assert back == pytest.approx(value, rel=1e-15, abs=1e-12 if unit in "degC K" else 0.0)


@pytest.mark.parametrize(
    ("text", "unit", "expected"),
    [
        ("0.5 mT", "T", 0.0005),
        ("1 G", "mT", 0.1),
        ("100 ms", "s", 0.1),
        ("5 h", "s", 18000.0),
        ("1 d", "h", 24.0),
        ("1 deg/s", "deg/h", 3600.0),
        ("15 deg/h", "deg/s", 15 / 3600),
        ("30 arcmin", "deg", 0.5),
        ("1 g", "m/s^2", 9.80665),
        ("25 degC", "K", 298.15),
        ("273.15 K", "degC", 0.0),
        ("0.5 %", "ppm", 5000.0),
        ("60 degC/h", "degC/min", 1.0),
        ("  2   A ", "mA", 2000.0),
        ("+.5e1 V", "V", 5.0),
    ],
)
def test_a_quantity_is_converted_without_a_rounding_of_its_own(
    text: str, unit: str, expected: float
) -> None:
    assert parse_as(text, unit) == expected


def test_a_radian_is_180_over_pi_degrees() -> None:
    assert convert(math.pi, "rad", "deg") == pytest.approx(180.0, rel=1e-15)


def test_a_temperature_has_a_zero_point_and_a_temperature_difference_has_none() -> None:
    assert parse_as("300 K", "degC") == pytest.approx(26.85)
    assert parse_as("3 K", "degC", difference=True) == 3.0
    assert Quantity(3.0, "degC").to("K", difference=True) == 3.0


def test_angle_is_a_dimension_of_its_own() -> None:
    assert dimension_of("deg/s") != dimension_of("Hz")
    with pytest.raises(UnitError, match="is a frequency, expected an angular rate such as"):
        parse_as("10 Hz", "deg/s")
    with pytest.raises(UnitError, match="is an angle, expected a ratio"):
        parse_as("1 rad", "1")


@pytest.mark.parametrize(
    ("text", "unit", "sentence", "hint"),
    [
        ("0.5 mt", "mT", "unit that is not known, 'mt'", "'0.5 mT'"),
        ("5 µT", "mT", "not known", "'5 uT'"),
        ("25 °C", "degC", "not known", "'25 degC'"),
        ("3 dps", "deg/s", "not known", "'3 deg/s'"),
        ("2 deg/s²", "deg/s^2", "not known", "'2 deg/s^2'"),
        (0.5, "mT", "has no unit, expected a magnetic field such as '0.5 mT'", "'0.5 mT'"),
        ("0.5", "mT", "has no unit", "'0.5 mT'"),
        ("0.5mT", "mT", "lacks the blank", "'0.5 mT'"),
        ("0,5 mT", "mT", "is not a number with a unit", "'0.5 mT'"),
        ("−40 degC", "degC", "is not a number with a unit", "'-40 degC'"),
    ],
)
def test_a_slip_of_the_keyboard_is_answered_with_what_was_meant(
    text: object, unit: str, sentence: str, hint: str
) -> None:
    with pytest.raises(UnitError) as caught:
        parse_as(text, unit)
    assert sentence in caught.value.what
    assert caught.value.hint == hint
    assert str(caught.value).endswith(f"; did you mean {hint}")


@pytest.mark.parametrize(
    "text",
    ["", "mT", "inf mT", "nan mT", "1e999 mT", "1 2 mT", "1_0 mT", None, True, [1], {}, math.nan],
)
def test_what_is_no_finite_quantity_is_refused(text: object) -> None:
    with pytest.raises(UnitError, match=r"expected a magnetic field such as '0\.5 mT'"):
        parse_as(text, "mT")


def test_a_unit_of_another_dimension_is_never_suggested() -> None:
    with pytest.raises(UnitError) as caught:
        parse_as("2 mG", "mT")
    assert caught.value.hint is None


def test_only_a_plain_ratio_may_stand_without_a_unit() -> None:
    assert parse_as(1.5, "1") == 1.5
    assert parse_as("1.5 1", "1") == 1.5
    with pytest.raises(UnitError, match="has no unit"):
        parse_as(50, "ppm")


def test_a_written_quantity_is_short() -> None:
    assert format_quantity(20.0, "s") == "20 s"
    assert format_quantity(0.1, "Hz") == "0.1 Hz"


def test_milli_and_mega_are_never_taken_for_each_other() -> None:
    assert parse_as("100 mHz", "Hz") == 0.1
    assert parse_as("0.1 Hz", "mHz") == 100.0
    for written, meant in (
        ("mhz", "'1 mHz'"),
        ("Mhz", "'1 MHz'"),
        ("MT", None),
        ("MIN", "'1 min'"),
    ):
        with pytest.raises(UnitError) as caught:
            parse_quantity(f"1 {written}")
        assert caught.value.hint == meant


def test_no_two_units_but_milli_and_mega_differ_in_case_only_within_a_dimension() -> None:
    seen = {
        (dimension_of(unit), unit[0] if unit[0] in "mM" else "", unit.lower()) for unit in UNITS
    }
    assert len(seen) == len(UNITS)
