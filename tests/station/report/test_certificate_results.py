"""What a certificate states of results: no convention, nothing undetermined, no certainty."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import pytest
from pydantic import ValidationError

from station.decision import Limit, Rule
from station.errors import InputError
from station.findings import Estimate, Findings, Flag, InputQuantity, undetermined
from station.instruments.laboratory import Laboratory
from station.report.certificate_cmc import not_below_cmc
from station.report.certificate_curves import curves_of
from station.report.certificate_results import (
    convention_row,
    left_out,
    measured,
    probability_text,
    result_row,
    upper_limits,
    verdict_sentence,
)
from station.results import ResultDocument, conclude


def estimate(axis: str, value: float, u: float, extra: Mapping[str, Any] | None = None) -> Estimate:
    return Estimate("coil_factor", axis, value, "1", u, None, "least-squares", {}, extra or {})


WHOLE = (
    estimate("x", 1.0, 0.0),
    estimate("y", 1.01127, 0.0001),
    undetermined("coil_factor", "z", "1", "least-squares"),
    undetermined("residual_field", "x", "nT", "least-squares"),
)
LIMITS = {("coil_factor", axis): Limit(min=0.9, max=1.1) for axis in "yz"}


def laboratory(cmc: dict[str, str | float]) -> Laboratory:
    return Laboratory(name="L", address="A", cmc=cmc)


def document(
    *estimates: Estimate,
    limits: Mapping[Any, Limit] = LIMITS,
    flags: tuple[str, ...] = (),
    rule: Rule = "guarded",
) -> ResultDocument:
    findings = Findings(estimates, [], [Flag(code, code) for code in flags], [], None)
    return conclude("p", findings, limits, rule)


def test_what_was_set_by_convention_stands_apart_and_what_is_not_determined_is_named() -> None:
    whole = document(*WHOLE)
    (row,) = map(result_row, measured(whole))
    assert row[:4] == ("coil factor", "y", "1.01127", "0.00020")
    conventions = [convention_row(result) for result in whole.results if result.by_convention]
    assert conventions == [("coil factor", "x", "1", "1")]
    assert list(left_out(whole)) == [
        "Not determined by these data, and so not stated: coil factor of axis z; residual field of "
        "axis x.",
        "Nothing can be held against the limit of coil factor of axis z.",
    ]
    assert verdict_sentence(whole) == (
        "Not decided. 2 results have a limit: 1 within, 1 undecided."
    )


def test_several_axes_of_a_result_that_is_not_determined_are_named_together() -> None:
    missing = (undetermined("coil_factor", axis, "1", "weighted") for axis in "xyz")
    (sentence,) = left_out(document(*missing, limits={}))
    assert sentence == "Not determined by these data, and so not stated: coil factor of axes x y z."


def test_no_result_is_within_above_a_whole_that_something_denies() -> None:
    limits = {("coil_factor", "y"): LIMITS["coil_factor", "y"]}
    (plain,) = map(result_row, measured(document(WHOLE[1], limits=limits)))
    assert plain[-2:] == ("within", "> 99.9 %")
    denied = document(WHOLE[1], limits=limits, flags=("uncalibrated",))
    (row,) = map(result_row, measured(denied))
    assert row[-2:] == ("not decided: not calibrated", "")
    assert verdict_sentence(denied) == "Not decided. 1 result has a limit: 1 undecided."


@pytest.mark.parametrize(
    ("probability", "text"),
    [
        (None, ""),
        (1.0, "> 99.9 %"),
        (0.9995, "> 99.9 %"),
        (0.98765, "98.8 %"),
        (0.5, "50.0 %"),
        (0.0016, "0.2 %"),
        (0.0009, "< 0.1 %"),
        (0.0, "< 0.1 %"),
    ],
)
def test_a_probability_of_conformity_is_never_certain(probability: float | None, text: str) -> None:
    assert probability_text(probability) == text


@pytest.mark.parametrize(
    ("rule", "decided"),
    [("simple", ("within", "pass")), ("guarded", ("within, but", "inconclusive"))],
)
def test_no_u_is_below_the_cmc_and_what_is_decided_follows_it(
    rule: Rule, decided: tuple[str, str]
) -> None:
    limits = {("coil_factor", "y"): Limit(max=1.0115)}
    plain = document(*WHOLE[:2], limits=limits, rule=rule)
    raised, (sentence,) = not_below_cmc(plain, laboratory({"coil_factor": "0.1 %"}), rule)
    (row,) = map(result_row, measured(raised))
    assert row[2:5] == ("1.0113", "0.0010", "1.96")
    assert row[7].startswith(decided[0]) and raised.verdict == decided[1]
    assert plain.verdict == "pass"
    assert row[8] == "67.4 %"
    assert sentence.endswith("for: coil factor of axis y.")


def test_a_u_is_not_below_the_cmc_in_its_two_digits_either() -> None:
    for cmc, printed in (
        (1.04e-3, "0.0011"),
        (1.0e-3, "0.0010"),
        (2.01e-3, "0.0021"),
        ("0.11 %", "0.0011"),
    ):
        raised, _ = not_below_cmc(document(*WHOLE), laboratory({"coil_factor": cmc}), "simple")
        (row, *_) = map(result_row, measured(raised))
        assert row[3] == printed


def test_a_u_above_the_cmc_stays_and_so_does_a_result_without_one() -> None:
    whole = document(*WHOLE)
    for cmc in ({"coil_factor": 1e-4}, {"bias": "1 deg/h"}, {}):
        assert not_below_cmc(whole, laboratory(cmc), "guarded") == (whole, ())
    assert not_below_cmc(whole, None, "guarded") == (whole, ())


def test_a_cmc_of_another_dimension_or_of_nothing_is_refused() -> None:
    with pytest.raises(InputError, match=r"laboratory\.cmc\.coil_factor.*is an angle"):
        not_below_cmc(document(*WHOLE), laboratory({"coil_factor": "1 deg"}), "simple")
    for text in ("0 ppm", "-1 ppm", "5", "5 furlong"):
        with pytest.raises(ValidationError):
            laboratory({"coil_factor": text})


def test_a_curve_has_its_formula_and_a_table_with_u_where_it_is_known() -> None:
    model = {"basis": "chebyshev", "domain": [-20.0, 60.0], "unit": "degC"}
    heat = [-20.0, 20.0, 60.0]
    band = {
        "temperature_degC": heat,
        "standard_uncertainty": [0.1, 0.1, 0.1],
        "expanded_uncertainty": [0.2, 0.2, 0.2],
    }
    extra = {
        "model": {**model, "coefficients": [10.0, -5.0, 2.0]},
        "band": band,
        "conditions": {"temperature": "20 degC"},
    }
    curve = estimate("x", 8.0, 0.1, extra)
    warmth = InputQuantity("thermometer_degC", "thermometer", 0.1, "degC", "a certificate")
    whole = conclude(
        "p",
        Findings(
            [replace(curve, sensitivities={"thermometer_degC": -0.125})], [], [], [warmth], None
        ),
        {},
        "simple",
    )
    (row,) = map(result_row, measured(whole))
    assert row[0] == "coil factor at 20 degC"
    (curves,) = curves_of(whole)
    formula, table = curves.tables()
    # 10 - 5 t + 2 (2 t² - 1)
    assert formula[2] == (("x", "8.000 − 5.000 t + 4.000 t^2", "t = (T − 20)/40", "−20.0 … 60.0"),)
    assert table[1] == ("T in degC", "x", "U(x)")
    assert [line[0] for line in table[2]] == ["−20", "−10", "0", "10", "20", "30", "40", "50", "60"]
    assert table[2][4] == ("20", "8.00", "0.20")
    # At t = -1 the slope is (-5 - 8)/40 per degC.
    assert table[2][0] == ("−20", "17.00", "0.21")
    (curves,) = curves_of(whole, laboratory({"coil_factor": 0.208}))
    _, raised = curves.tables()
    assert (raised[2][0][2], raised[2][4][2]) == ("0.21", "0.21")
    (curves,) = curves_of(whole, laboratory({"coil_factor": 0.5}))
    _, raised = curves.tables()
    assert {line[2] for line in raised[2]} == {"0.50"}


def test_u_of_a_curve_is_that_of_the_result_where_that_is_stated_and_holds_the_whole_budget() -> (
    None
):
    model = {"basis": "chebyshev", "domain": [0.0, 40.0], "coefficients": [10.0, 0.0, 1e-9]}
    band = {
        "temperature_degC": [0.0, 40.0],
        "standard_uncertainty": [0.3, 0.3],
        "expanded_uncertainty": [0.9, 0.9],
    }
    extra = {"model": model, "band": band, "conditions": {"temperature": "20 degC"}}
    other = InputQuantity("gain", "gain of the table", 0.4, "1", "a certificate")
    curve = Estimate("bias", "x", 10.0, "mg", 0.29, 5.0, "least-squares", {"gain": 1.0}, extra)
    whole = conclude("p", Findings([curve], [], [], [other], None), {}, "simple")
    (curves,) = curves_of(whole)
    (formula, values), (result,) = curves.tables(), whole.results
    assert formula[2][0][1] == "10.000", "no term that is zero as printed"
    points = {point.temperature_degC: point for point in curves.curves[0].points}
    assert result.combined is not None
    assert points[20.0].expanded == result.combined.expanded_uncertainty
    # 0.3 (5 degrees of freedom) and 0.4 make 0.5, with 5 · 0.5⁴/0.3⁴ = 38.6 of them.
    assert points[10.0].expanded == pytest.approx(2.02 * 0.5, rel=0.01)
    assert values[2][0][1:] == ("10.0", "1.0")


def test_a_curve_without_u_says_so() -> None:
    model = {"basis": "chebyshev", "domain": [0.0, 40.0], "coefficients": [10.0, 1.0]}
    (curves,) = curves_of(document(estimate("x", 10.0, 0.1, {"model": model}), limits={}))
    ((_, _, _, caption),) = curves.tables()
    assert caption.endswith("not along the curve.")


def test_what_is_noise_alone_has_its_upper_limit() -> None:
    noise = estimate("x", 0.0015, 0.001, {"upper_limit": 0.00331})
    known = estimate("y", 1.0, 0.001, {"upper_limit": 1.002})
    flag = Flag("not-significant", "noise", "x", {"coefficients": ["coil_factor"]})
    whole = replace(document(noise, known, limits={}), flags=[flag])
    assert list(upper_limits(whole)) == ["coil factor of axis x: the upper limit (95 %) is 0.0033."]
