"""Records of known gyros: results at the bound, the scatter of switch-ons, the curve."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rate_records import CASES, bounds, made, trials, without

from procedures.gyro_rate_table.analysis import RateTableAnalysis, analyse

PPM = 1e6


def codes(analysis: RateTableAnalysis) -> set[str]:
    return {one.code for one in analysis.flags}


@pytest.mark.parametrize("case", ["white", "drifting", "part turns, axis 1 deg off"])
def test_scale_factor_and_asymmetry_reach_the_bound(case: str) -> None:
    found, bound = trials(CASES[case], 3), bounds(CASES[case])
    for name, factor in (("scale_factor", PPM), ("asymmetry", 1.0)):
        u = float(np.median(found[name].u)) * factor
        # The walk is not well known, and taken larger in u.
        assert 0.9 < u / bound[name] < 1.5, name
        assert np.all(np.abs(found[name].errors) < 4.0 * found[name].u)


def test_switch_ons_that_scatter_are_in_the_uncertainty() -> None:
    case = made(np.random.default_rng(3), CASES["four switch-ons"])
    analysis = analyse(case.dataset)
    spread = analysis.estimate("scale_factor_repeatability", "IA").value
    scale = analysis.estimate("scale_factor", "IA")
    assert spread == pytest.approx(case.truth["scale_factor_repeatability"], abs=0.3)
    assert spread is not None and scale.standard_uncertainty is not None
    assert scale.standard_uncertainty == pytest.approx(spread / PPM / 2.0, rel=0.05)
    assert scale.degrees_of_freedom == pytest.approx(3.0, abs=0.3)


def test_a_scale_factor_that_drifts_is_no_nonlinearity() -> None:
    """Rates follow one another: by their means alone a drift looks like a curve and asymmetry."""
    found = trials(CASES["scale factor drifts"], 3)
    for name in ("scale_factor", "nonlinearity_of_full_scale", "asymmetry"):
        assert np.all(np.abs(found[name].errors) < 4.0 * found[name].u), name
    analysis = analyse(made(np.random.default_rng(4), CASES["scale factor drifts"]).dataset)
    drifts = [flag.details.get("drift_ppm_per_h") for flag in analysis.flags]
    (drift,) = [value for value in drifts if value is not None]
    # 40 ppm over a switch-on, which takes half an hour.
    assert 50.0 < drift < 120.0
    for case in ("drifting", "nonlinear", "four switch-ons"):
        steady = analyse(made(np.random.default_rng(4), CASES[case]).dataset)
        assert not any("drift_ppm_per_h" in flag.details for flag in steady.flags), case


def test_a_scale_factor_that_drifts_shows_beside_a_curve_of_the_response() -> None:
    found = trials(CASES["curved, scale factor drifts"], 3)
    for name in ("scale_factor", "nonlinearity_of_full_scale", "asymmetry"):
        assert np.all(np.abs(found[name].errors) < 4.0 * found[name].u), name
    analysis = analyse(made(np.random.default_rng(4), CASES["curved, scale factor drifts"]).dataset)
    assert any("drift_ppm_per_h" in flag.details for flag in analysis.flags)
    cubic = replace(CASES["curved, scale factor drifts"], drift_ppm=0.0)
    steady = analyse(made(np.random.default_rng(4), cubic).dataset)
    assert not any("drift_ppm_per_h" in flag.details for flag in steady.flags)


def test_full_scale_is_the_range_where_it_is_stated() -> None:
    dataset = made(np.random.default_rng(5), CASES["nonlinear"]).dataset
    ranged = replace(dataset, range_deg_per_s=300.0)
    name = "nonlinearity_of_full_scale"
    by_input, by_range = (analyse(one).estimate(name, "IA") for one in (dataset, ranged))
    assert by_input.value is not None and by_range.value is not None
    # The table turned by at most 100 deg/s.
    assert by_range.value == pytest.approx(by_input.value / 3.0, rel=1e-6)
    assert by_range.standard_uncertainty == pytest.approx(
        (by_input.standard_uncertainty or 0.0) / 3.0, rel=1e-6
    )


def test_a_nonlinear_gyro_shows_its_curve_and_a_perfect_one_none() -> None:
    case = made(np.random.default_rng(5), CASES["nonlinear"])
    analysis = analyse(case.dataset)
    for name in ("nonlinearity", "nonlinearity_of_full_scale", "asymmetry"):
        one = analysis.estimate(name, "IA")
        assert one.value is not None and one.standard_uncertainty is not None
        assert abs(one.value - case.truth[name]) < 4.0 * one.standard_uncertainty
    assert "not-significant" not in codes(analysis)
    perfect = analyse(made(np.random.default_rng(5), CASES["white"]).dataset)
    (flag,) = [one for one in perfect.flags if one.code == "not-significant"]
    assert {"nonlinearity", "asymmetry"} <= set(flag.details["coefficients"])
    one = perfect.estimate("nonlinearity", "IA")
    assert one.value is not None and one.value < 2.0 * (one.standard_uncertainty or 0.0)


def test_without_standing_records_the_published_rule_has_nothing_to_take_off() -> None:
    case = made(np.random.default_rng(8), CASES["white"])
    analysis = analyse(without(case.dataset, 0.0))
    assert all(one.value is None for one in analysis.published)
    assert analysis.estimate("scale_factor", "IA").value is not None


def test_coarse_output_is_cut_off_only_where_it_falls_short() -> None:
    sound = made(np.random.default_rng((49, 1)), CASES["navigator"]).dataset
    assert "overload" not in codes(analyse(sound))
    limited = [
        replace(record, rate_deg_per_s=np.clip(record.rate_deg_per_s, -99.9, 99.9))
        for record in sound.records
    ]
    cut = analyse(replace(sound, records=tuple(limited)))
    (over,) = [flag for flag in cut.flags if flag.code == "overload"]
    assert over.details["rates"] == [-100.0, 100.0] or over.details["rates"] == [100.0, -100.0]
