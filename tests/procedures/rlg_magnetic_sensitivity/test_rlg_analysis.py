"""The analysis of the laser gyro's magnetic sensitivity: truth, pitfalls, honesty."""

from __future__ import annotations

import csv
import json
from dataclasses import replace

import numpy as np
import pytest
from places import DATA
from rlg_records import TRUTH, analysed, codes, off_in_u, record
from scipy.special import stdtrit
from scipy.stats import chi2

from procedures.rlg_magnetic_sensitivity.analysis import analyse
from procedures.rlg_magnetic_sensitivity.dataset import AXES, RlgDataset, Segment
from procedures.rlg_magnetic_sensitivity.evaluate import undriven_inputs
from procedures.rlg_magnetic_sensitivity.frequencies import Drive
from procedures.rlg_magnetic_sensitivity.gyro import plotted_spectrum, published_value
from procedures.rlg_magnetic_sensitivity.parameters import AnalysisSettings
from station.uncertainty import combine

EXAMPLES = {
    "rlg-one-axis": ({"IA": Drive(0.08, 1.2)}, 0.1, 0.0),
    "rlg-counts": ({"NA": Drive(0.16, 0.8)}, 1.0, 0.4),
    "rlg-three-axes-at-once": (
        {"IA": Drive(0.07, 1.0), "NA": Drive(0.11, 1.0), "LA": Drive(0.17, 1.0)},
        0.1,
        0.0,
    ),
}


def example(name: str) -> RlgDataset:
    drive, interval_s, pulse_arcsec = EXAMPLES[name]
    with (DATA / name / "samples.csv").open(encoding="utf-8", newline="") as file:
        table = np.array([[float(x) for x in row] for row in list(csv.reader(file))[1:]])
    rate = table[:, 1] * (pulse_arcsec / interval_s if pulse_arcsec else 1.0)
    quantum = pulse_arcsec / interval_s
    end_s, field_mT = table[:, 0], table[:, 2:5]
    middle_s = end_s - 0.5 * interval_s
    return RlgDataset((Segment(drive, interval_s, middle_s, rate, quantum, end_s, field_mT, 0.0),))


@pytest.mark.parametrize("name", list(EXAMPLES))
def test_the_example_datasets_come_out_within_tolerance_and_unflagged(name: str) -> None:
    analysis = analyse(example(name))
    truth = json.loads((DATA / name / "truth.json").read_text(encoding="utf-8"))
    found = {e.axis: e for e in analysis.estimates}
    assert sorted(found) == sorted(e["axis"] for e in truth["expected"])
    for expected in truth["expected"]:
        one = found[expected["axis"]]
        assert one.value is not None and one.standard_uncertainty is not None
        assert abs(one.value - expected["value"]) < min(
            expected["tolerance"], 2.5 * expected["crlb"]
        )
        assert one.standard_uncertainty == pytest.approx(expected["crlb"], rel=0.25)
    assert not analysis.flags


def test_the_sign_is_that_of_the_phase_against_the_measured_field() -> None:
    for truth in (0.05, -0.05):
        analysis = analysed(record(1, {"IA": truth}))
        assert off_in_u(analysis, "IA", truth) < 3.5
        assert (analysis.published[0].value or 0.0) == pytest.approx(0.05, abs=0.02)


def test_half_a_cycle_too_many_spoils_the_published_value_only() -> None:
    analysis = analysed(record(2, cycles=10.5, sigma=0.02))
    assert off_in_u(analysis, "IA", 0.05) < 3.5
    assert analysis.published[0].value == pytest.approx(0.05 * 2.0 / np.pi, abs=0.004)
    assert codes(analysis) == {"non-integer-cycles"}


def test_the_mean_of_the_output_does_not_leak_into_the_line() -> None:
    segment = record(2, cycles=10.5)
    moved = replace(segment, rate_deg_per_h=segment.rate_deg_per_h + 1000.0)
    one, other = analysed(segment).estimates[0], analysed(moved).estimates[0]
    assert one.value is not None
    assert other.value == pytest.approx(one.value, abs=1e-6)


def test_averaging_over_the_gyros_interval_is_corrected() -> None:
    quiet = record(0, drive={"IA": Drive(0.2, 1.0)}, interval_s=1.0, sigma=1e-4)
    analysis = analysed(quiet)
    assert analysis.estimates[0].value == pytest.approx(0.05, rel=2e-3)
    assert analysis.published[0].value == pytest.approx(0.05 * 0.9355, rel=5e-3)


def test_the_gaussmeters_own_averaging_is_corrected() -> None:
    drive = {"IA": Drive(0.2, 1.0)}
    analysis = analysed(record(0, drive=drive, averaging_s=1.5, sigma=1e-4))
    assert analysis.estimates[0].value == pytest.approx(0.05, rel=2e-3)
    assert "field-differs-from-commanded" not in codes(analysis)


def test_the_measured_field_counts_and_not_the_commanded_one() -> None:
    analysis = analysed(record(0, coils=1.03 * np.eye(3), sigma=1e-3))
    assert analysis.estimates[0].value == pytest.approx(0.05, rel=3e-3)
    assert analysis.published[0].value == pytest.approx(0.05 * 1.03, rel=5e-3)
    assert codes(analysis) == {"field-differs-from-commanded"}


def test_a_field_source_with_its_own_clock_is_followed() -> None:
    segment = record(0, drive={"IA": Drive(0.1 * (1 + 2e-3), 1.0)}, cycles=60.0, sigma=1e-3)
    told = replace(segment, drive={"IA": Drive(0.1, 1.0)})
    analysis = analysed(told)
    assert analysis.lines[0].frequency_Hz == pytest.approx(0.1002, rel=1e-5)
    assert off_in_u(analysis, "IA", 0.05) < 3.5


def test_a_delay_shows_in_quadrature() -> None:
    analysis = analysed(record(0, delay_s=1.0, sigma=0.02))
    assert codes(analysis) == {"quadrature-significant"}
    line = analysis.lines[0]
    assert line.quadrature == pytest.approx(-0.05 * np.sin(0.2 * np.pi), rel=0.1)
    slope = analysis.estimates[0].sensitivities["field_time_offset_s"]
    shifted = record(0, delay_s=1.0, sigma=0.02)
    shifted = replace(shifted, field_time_s=shifted.field_time_s + 1e-3)
    moved, base = analysed(shifted).estimates[0].value, analysis.estimates[0].value
    assert moved is not None and base is not None
    assert (moved - base) / 1e-3 == pytest.approx(slope, rel=0.02)


def test_type_b_sensitivities_are_the_derivatives_of_the_value() -> None:
    segment = record(5)
    base = analysed(segment).estimates[0]
    assert base.value is not None
    gained = analysed(replace(segment, field_mT=segment.field_mT * 1.001)).estimates[0].value
    scaled = analysed(replace(segment, rate_deg_per_h=segment.rate_deg_per_h * 1.001))
    assert gained is not None and scaled.estimates[0].value is not None
    gain, scale = base.sensitivities["field_gain"], base.sensitivities["gyro_scale"]
    assert (gained - base.value) / 1e-3 == pytest.approx(gain, rel=3e-3)
    assert (scaled.estimates[0].value - base.value) / 1e-3 == pytest.approx(scale, rel=3e-3)


COILS = np.array([[1.0, 0.02, -0.0175], [0.015, 0.99, 0.01], [-0.0175, 0.02, 1.01]])


def test_three_axes_in_turn_are_freed_of_the_coils_misalignment() -> None:
    segments = [
        record(k, TRUTH, {axis: Drive(0.1, 1.0)}, sigma=1e-3, coils=COILS)
        for k, axis in enumerate(AXES)
    ]
    analysis = analysed(*segments)
    assert analysis.determined == AXES
    for one in analysis.estimates:
        assert one.value == pytest.approx(TRUTH[one.axis], abs=1.5e-4)
        assert off_in_u(analysis, one.axis, TRUTH[one.axis]) < 3.5
    alone = analysed(segments[2]).estimates[0]
    assert alone.value is not None and abs(alone.value - TRUTH["LA"]) > 5e-4
    deviations = [e.standard_uncertainty for e in analysis.estimates]
    assert np.sqrt(np.diag(analysis.covariance)) == pytest.approx(deviations)


def test_three_axes_at_once_do_too() -> None:
    drive = {"IA": Drive(0.07, 1.0), "NA": Drive(0.11, 1.0), "LA": Drive(0.17, 1.0)}
    analysis = analysed(record(1, TRUTH, drive, cycles=14.0, sigma=1e-3, coils=COILS))
    for one in analysis.estimates:
        assert one.value == pytest.approx(TRUTH[one.axis], abs=2e-4)


LEAN = float(np.tan(np.radians(2.0)))


def leaning() -> np.ndarray:
    """Coils of which that of IA leans by 2 deg towards LA."""
    coils = np.eye(3)
    coils[0, 2] = LEAN
    return coils


def on_one_axis(
    sensitivity: float, seed: int = 0, coils: np.ndarray | None = None, stated: float = 3.0
) -> tuple[float, float, list[str]]:
    """Return error over u, u and flag codes of IA, driven alone beside a sensitivity of LA."""
    settings = AnalysisSettings(undriven_sensitivity=stated)
    drive = {"IA": Drive(0.1, 1.0)}
    truth = {"IA": 0.05, "LA": sensitivity}
    segment = record(seed, truth, drive, 50.0, coils=leaning() if coils is None else coils)
    found = analyse(RlgDataset((segment,)), settings)
    (one,) = found.estimates
    inputs = list(undriven_inputs(found.estimates, settings))
    (total,) = combine(found.estimates, inputs)
    assert one.value is not None
    assert total is not None
    error = one.value - truth["IA"]
    u = total.standard_uncertainty
    return error / u, u, [flag.code for flag in found.flags]


def test_the_leak_of_an_undriven_axis_is_in_u_and_flagged() -> None:
    """A coil that leans by 2 deg, an axis that is not driven and 60 times as sensitive."""
    ratio, u, said = on_one_axis(3.0)
    assert abs(ratio) < 3.5
    assert "cross-axis" in said
    assert u == pytest.approx(LEAN * 3.0 / np.sqrt(3.0), rel=0.05)
    # A gyro whose undriven axes are as sensitive as stated is covered as often as it should be.
    drawn = np.random.default_rng(5).uniform(-0.4, 0.4, 40)
    ratios = [on_one_axis(one, seed, stated=0.4)[0] for seed, one in enumerate(drawn)]
    low, high = chi2.ppf([0.001, 0.999], len(ratios)) / len(ratios)
    assert low < np.mean(np.square(ratios)) < high


def test_an_undriven_axis_costs_nothing_where_the_coil_stands_true_or_all_are_driven() -> None:
    _, u, said = on_one_axis(0.05, coils=np.eye(3))
    _, least, _ = on_one_axis(0.05, coils=np.eye(3), stated=0.0)
    assert u == pytest.approx(least, rel=1e-3)
    assert said == []
    truth = {"IA": 0.05, "NA": -0.02, "LA": 3.0}
    segments = [
        record(k, truth, {axis: Drive(0.1, 1.0)}, 50.0, coils=leaning())
        for k, axis in enumerate(truth)
    ]
    found = analysed(*segments)
    assert "cross-axis" not in {flag.code for flag in found.flags}
    for one in found.estimates:
        assert abs(one.value - truth[one.axis]) < 3.5 * one.standard_uncertainty


def test_a_second_order_term_is_found_and_the_ambient_field_does_not_pass_for_slope() -> None:
    analysis = analysed(record(0, quadratic=0.1, ambient_mT=(0.05, 0.0, 0.0), sigma=0.01))
    line = analysis.lines[0]
    assert line.quadratic == pytest.approx(0.1, abs=4 * (line.quadratic_uncertainty or 0.0))
    assert line.quadratic_corrected
    assert off_in_u(analysis, "IA", 0.05) < 3.5
    # Without the correction the slope would read 2 S2 B0 = 0.01 too high.
    assert (analysis.published[0].value or 0.0) > 0.058


def test_a_gyro_without_sensitivity_gets_a_bound_and_no_false_value() -> None:
    values = []
    for seed in range(40):
        analysis = analysed(record(seed, {"IA": 0.0}))
        values.append(analysis.estimates[0].value or 0.0)
        flags = [f for f in analysis.flags if f.code == "not-significant"]
        if flags:
            bound = analysis.lines[0].upper_bound
            u = analysis.estimates[0].standard_uncertainty
            assert bound is not None and u is not None
            assert 1.6 * u < bound < 3.8 * u
    assert abs(np.mean(values)) < 3.5 * np.std(values) / np.sqrt(40)


def test_a_wild_field_reading_changes_nothing() -> None:
    segment = record(0)
    field = segment.field_mT.copy()
    field[[10, 700]] = [[50.0, -3.0, 1.0], [0.0, 300.0, -9.0]]
    clean, wild = analysed(segment), analysed(replace(segment, field_mT=field))
    assert wild.segments[0].field.wild.sum() == 2
    assert wild.estimates[0].value == pytest.approx(clean.estimates[0].value, rel=1e-3)


@pytest.mark.campaign
def test_a_clean_record_raises_no_flag_and_its_intervals_hold_the_truth() -> None:
    flagged, inside, square, runs = 0, 0, 0.0, 250
    for seed in range(runs):
        analysis = analysed(record(seed, cycles=10.0))
        one = analysis.estimates[0]
        assert one.value is not None and one.standard_uncertainty is not None
        pull = (one.value - 0.05) / one.standard_uncertainty
        inside += int(abs(pull) <= stdtrit(one.degrees_of_freedom or 1e9, 0.975))
        square += pull**2 / runs
        flagged += bool(analysis.flags)
    assert flagged <= 0.05 * runs
    # 250 runs: the standard error of the coverage is 1.4 %.
    assert 0.91 <= inside / runs <= 0.99
    assert 0.75 <= square <= 1.3


def test_thresholds_are_the_callers() -> None:
    segment = record(0, coils=1.008 * np.eye(3))
    assert "field-differs-from-commanded" not in codes(analysed(segment))
    strict = analyse(RlgDataset((segment,)), AnalysisSettings(field_differs_from_commanded=0.005))
    assert "field-differs-from-commanded" in codes(strict)


def test_the_report_finds_what_it_plots() -> None:
    segment = record(6)
    gyro = analysed(segment).segments[0].gyro
    assert gyro.model_deg_per_h + gyro.residual_deg_per_h == pytest.approx(segment.rate_deg_per_h)
    assert gyro.kept.all()
    frequency_Hz, amplitude = plotted_spectrum(segment)
    assert frequency_Hz[20] == pytest.approx(0.1)
    assert published_value(segment, "IA").value == pytest.approx(amplitude[20], rel=1e-9)
    floor = float(np.sqrt(np.mean(amplitude[50:900] ** 2)))
    assert gyro.noise_floor_deg_per_h[0] == pytest.approx(floor, rel=0.15)


def test_the_same_data_give_the_same_numbers() -> None:
    one, other = analyse(example("rlg-counts")), analyse(example("rlg-counts"))
    assert one.estimates == other.estimates
