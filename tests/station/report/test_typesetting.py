"""Units on paper have their signs; what is typed stays as it is."""

from __future__ import annotations

import pytest

from station import units
from station.decision import Limit
from station.plots import Axis, Line, Panel, Plot
from station.report.drawing import figure_of
from station.report.numbers import format_limit
from station.report.sheet import Section, Sheet, grid
from station.report.sheet_html import render_sheet
from station.report.typesetting import with_signs
from station.texts import Texts


@pytest.mark.parametrize(
    ("text", "typeset"),
    [
        ("V/g^2", "V/g²"),
        ("deg/sqrt(h)", "deg/√h"),
        ("ug/g^2", "µg/g²"),
        ("deg/h/(degC/min)", "deg/h/(°C/min)"),
        ("100 ohm at 25.3 degC", "100 Ω at 25.3 °C"),
        ("gyro temperature, degC", "gyro temperature, °C"),
        ("B^2/(2 pi f), 10^-4 of it", "B²/(2 pi f), 10⁻⁴ of it"),
        ("a drift of 4.6e-05 V", "a drift of 4.6·10⁻⁵ V"),
        ("SN-4e+05x of 1e5", "SN-4e+05x of 1e5"),
        ("5 us in 50 uT", "5 µs in 50 µT"),
        ("it lets us hug an ohmic house", "it lets us hug an ohmic house"),
        ("`rate: 1 degC/h` in temperature_degC", "`rate: 1 degC/h` in temperature_degC"),
    ],
)
def test_a_unit_is_typeset_and_no_other_word(text: str, typeset: str) -> None:
    assert with_signs(text) == typeset


def test_no_unit_of_the_table_is_left_in_ascii() -> None:
    for _, _, sizes in units._DIMENSIONS.values():
        for unit in sizes:
            typeset = with_signs(f"1 {unit}")
            assert not {"^", "_"} & {*typeset} and "sqrt" not in typeset, unit
            assert not any(word in typeset for word in ("degC", "ohm", " u")), unit


def test_table_page_and_plot_show_them_in_both_languages() -> None:
    sheet = Sheet(
        "K", "T", "N", "", "", "", (Section("S", (grid(["temperature, degC"], [["V/g^2"]]),)),)
    )
    plot = Plot("P", "", (Panel((Line([0, 1], [0, 1], label="in ug"),), y=Axis("bias, ug/g^2")),))
    for texts in (Texts("en"), Texts("zh")):
        page = render_sheet(sheet.translated(texts))
        assert "V/g²" in page and "°C" in page and "degC" not in page
        (block,) = sheet.translated(texts).to_data()["sections"][0]["blocks"]
        assert block["rows"] == (("V/g²",),)
        (axes,) = figure_of(plot, texts).axes
        assert axes.get_ylabel().endswith("µg/g²")


def test_a_limit_has_all_its_digits() -> None:
    assert format_limit(Limit(max=1.0000125)) == "≤ 1.0000125"
    assert format_limit(Limit(min=2.5e-9)) == "≥ 2.5·10⁻⁹"
    assert format_limit(Limit(max=0.1 + 0.2)) == "≤ 0.3"
