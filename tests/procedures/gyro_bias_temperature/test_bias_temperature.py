"""Bias over temperature: the example within tolerance, truth recovered, the report."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from bias_records import CASES, Gyro, errors_in_u, record
from numpy.polynomial import chebyshev
from places import DATA

from procedures.gyro_bias_temperature import UNITS
from procedures.gyro_bias_temperature.analysis import TemperatureAnalysis, analyse
from procedures.gyro_bias_temperature.evaluate import findings_of_dataset
from procedures.gyro_bias_temperature.figures import draw_parts
from procedures.gyro_bias_temperature.model import lagged, loop
from station.dataset_reading import read_dataset
from station.findings import Estimate, Findings
from station.runner.evaluation import evaluate_dataset

EXAMPLE = DATA / "gyro-bias-temperature"


@pytest.fixture(scope="module")
def example() -> Findings:
    return findings_of_dataset(read_dataset(EXAMPLE))


def estimates(analysis: Findings | TemperatureAnalysis) -> dict[str, Estimate]:
    return {one.name: one for one in analysis.estimates}


def codes(analysis: Findings | TemperatureAnalysis) -> set[str]:
    return {one.code for one in analysis.flags}


def test_the_example_comes_out_within_its_tolerance(example: Findings) -> None:
    truth = json.loads((EXAMPLE / "truth.json").read_text(encoding="utf-8"))
    came = estimates(example)
    for expected in truth["expected"]:
        one = came[expected["name"]]
        assert (one.axis, one.unit) == (expected["axis"], expected["unit"])
        assert one.value is not None and one.standard_uncertainty is not None
        assert abs(one.value - expected["value"]) < expected["tolerance"], one
        assert one.standard_uncertainty > expected["u_min"]
    (curve,) = truth["model_curves"]
    model: Any = came["bias"].extra["model"]
    low, high = model["domain"]
    scaled = (2.0 * np.array(curve["x"]) - low - high) / (high - low)
    off = chebyshev.chebval(scaled, model["coefficients"]) - curve["value"]
    assert np.all(np.abs(off) < curve["tolerance"])
    assert codes(example) == set()
    published = {one.name: one.value for one in example.published}
    assert published["bias"] == pytest.approx(0.148, abs=0.001)  # the hysteresis is in it


@pytest.mark.campaign
def test_truth_comes_out_in_its_uncertainty() -> None:
    for case, seed in (("fibre-optic", 1), ("noisy", 2), ("no hysteresis, no lag", 3)):
        pairs = errors_in_u(CASES[case], seed)
        assert len(pairs) == 7
        for name, (error, u) in pairs.items():
            assert abs(error) < 4.0 * u, (case, name)


@pytest.mark.campaign
def test_what_the_order_and_the_slow_noise_leave_open_is_in_u() -> None:
    """With one order and one noise the steepest soak was 4.2 u off."""
    for case in ("fibre-optic", "noisy"):
        for name, (error, u) in errors_in_u(CASES[case], 5004).items():
            assert abs(error) < 3.6 * u, (case, name)


@pytest.mark.campaign
def test_a_quiet_gyro_shows_every_part_of_the_model() -> None:
    pairs = errors_in_u(Gyro(N=1e-4, B=0.0, K=0.0), 5)
    closest = {"sensor_lag": 15.0, "chamber_lag": 1.0}
    for name, (error, u) in pairs.items():
        assert abs(error) < closest.get(name, 3e-3) and abs(error) < 4.0 * u, (name, error, u)


@pytest.mark.parametrize("gyro", [Gyro(), Gyro(thermometer=False)])
def test_one_wild_thermometer_row_moves_nothing(gyro: Gyro) -> None:
    dataset = record(gyro, 7)
    clean = estimates(analyse(dataset))
    for value in (850.0, -200.0):
        readings = dataset.temperature_degC.copy()
        readings[500] = value
        both = replace(dataset, gyro_degC=readings), replace(dataset, chamber_degC=readings)
        analysis = analyse(both[0] if gyro.thermometer else both[1])
        assert "outliers-rejected" in codes(analysis)
        for result, one in estimates(analysis).items():
            if one.value is not None:
                before = clean[result]
                assert before.value is not None and before.standard_uncertainty is not None
                assert abs(one.value - before.value) < 0.2 * before.standard_uncertainty, result


def test_what_a_board_that_stood_still_missed_is_not_taken_for_the_curve() -> None:
    gyro = Gyro()
    dataset = record(gyro, 7)
    clean = estimates(analyse(dataset))
    rate = dataset.rate_deg_per_h.copy()
    rate[500:530], rate[530] = 0.0, rate[500:531].sum(axis=0)
    analysis = analyse(replace(dataset, rate_deg_per_h=rate))
    assert codes(analysis) == {"outliers-rejected", "overload"}
    for name, one in estimates(analysis).items():
        before = clean[name]
        assert one.value is not None and before.value is not None
        assert before.standard_uncertainty is not None
        assert abs(one.value - before.value) < 2.0 * before.standard_uncertainty, name


def test_a_lag_that_is_stated_to_be_none_is_said_to_rest_on_that() -> None:
    sure = replace(record(Gyro(), 7), sensor_lag_prior_s=0.0)
    (flag,) = [flag for flag in analyse(sure).flags if flag.code == "lag-by-prior"]
    assert flag.details["prior_s"] == 0.0


def test_a_set_point_that_stands_while_the_chamber_moves_is_named() -> None:
    dataset = record(Gyro(), 7)
    assert "contradicts-statement" not in codes(analyse(dataset))
    standing = replace(dataset, set_point_degC=np.full(len(dataset.time_s), 23.0))
    (flag,) = [one for one in analyse(standing).flags if one.code == "contradicts-statement"]
    assert flag.details["statement"] == "set_point_degC"


def test_with_the_chambers_thermometer_alone_the_lag_is_found_from_the_data() -> None:
    for case, seed in (("chamber alone", 1), ("chamber alone, one lag", 2)):
        pairs = errors_in_u(CASES[case], seed)
        assert set(pairs) == set(UNITS) - {"chamber_lag"}
        for name, (error, u) in pairs.items():
            assert abs(error) < 4.0 * u, (case, name)


def test_what_the_lag_behind_a_chamber_does_not_show_is_null() -> None:
    """A lag beyond those of gyros: nothing that rests on it is guessed."""
    slow = Gyro(thermometer=False, chamber_lag_s=12000.0, sensor_lag_s=0.0)
    came = estimates(analyse(record(slow, 3)))
    for name in ("sensor_lag", "bias_rate_sensitivity", "hysteresis"):
        assert came[name].value is None, name


def test_a_noisy_thermometer_does_not_take_the_rate_sensitivity_away() -> None:
    dataset = record(Gyro(), 3)
    assert dataset.gyro_degC is not None
    noise = np.random.default_rng(3).normal(0.0, 0.5, len(dataset.time_s))
    own = estimates(analyse(replace(dataset, gyro_degC=dataset.gyro_degC + noise)))
    s = own["bias_rate_sensitivity"]
    assert s.value is not None and s.standard_uncertainty is not None
    assert abs(s.value - 0.4) < 4.0 * s.standard_uncertainty


@pytest.mark.parametrize("rows", [5, 10, -20])
def test_an_output_in_other_rows_is_named_by_its_rows(rows: int) -> None:
    dataset = record(Gyro(soak_h=1.0), 201)
    rate = np.roll(dataset.rate_deg_per_h, rows, axis=0)
    found = analyse(replace(dataset, rate_deg_per_h=rate))
    (named,) = (flag for flag in found.flags if "rows" in flag.details)
    assert (named.code, named.details["rows"]) == ("contradicts-statement", rows)
    assert estimates(found)["bias_rate_sensitivity"].value is None


def test_the_lag_behind_the_chamber_is_found_from_both_sides_of_a_long_gap() -> None:
    dataset = record(Gyro(soak_h=1.0), 201)
    assert dataset.gyro_degC is not None
    kept = np.ones(len(dataset.time_s), dtype=bool)
    kept[100:130] = False
    fewer = replace(
        dataset,
        time_s=dataset.time_s[kept],
        soaking=dataset.soaking[kept],
        rate_deg_per_h=dataset.rate_deg_per_h[kept],
        gyro_degC=dataset.gyro_degC[kept],
        chamber_degC=dataset.chamber_degC[kept],
        set_point_degC=dataset.set_point_degC[kept],
    )
    lag = estimates(analyse(fewer))["chamber_lag"]
    assert lag.value is not None and lag.standard_uncertainty is not None
    assert abs(lag.value - 2100.0) < 3.0 * lag.standard_uncertainty


def test_a_lag_is_no_half_interval_late_and_a_loop_has_two_sides() -> None:
    ramp = np.arange(2000.0)
    behind = ramp - lagged(ramp, 300.0, 60.0)
    assert behind[-1] == pytest.approx(300.0 / 60.0, rel=1e-6)
    there = np.r_[np.linspace(0.0, 10.0, 50), np.linspace(10.0, 0.0, 50)]
    side = loop(there, 2.0)
    assert (side[49], side[99]) == (1.0, -1.0) and side[0] == 0.0


def test_the_report_has_curve_record_residuals_and_a_table() -> None:
    document, findings = evaluate_dataset(read_dataset(EXAMPLE))
    titles = [part.title for part in draw_parts(findings, document)]
    assert titles == [
        "Bias over the record, IA",
        "Bias over temperature, IA",
        "Residuals over the record, IA",
        "Compensation, IA",
    ]


@pytest.mark.parametrize("rows", [0, 1, 20])
def test_of_a_few_rows_nothing_is_known_and_nothing_breaks(rows: int) -> None:
    whole = record(Gyro(soak_h=1.0), 202)
    columns = ("time_s", "soaking", "set_point_degC", "rate_deg_per_h", "gyro_degC", "chamber_degC")
    few = replace(whole, **{name: getattr(whole, name)[:rows] for name in columns})
    analysis = analyse(few)
    assert [one.name for one in analysis.estimates] == [*UNITS]
    assert all(one.value is None for one in analysis.estimates)
    assert codes(analysis) == {"not-identifiable"}
