"""The accelerometer analysis on small or odd records: warming, few rows, no input."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from accelerometer_records import INTERVAL_S, SIX_FIELDS_T, TRUTH, off_in_u, points, record
from numpy.typing import NDArray
from scipy.special import stdtrit

from procedures.accelerometer_magnetic_sensitivity.analysis import analyse
from procedures.accelerometer_magnetic_sensitivity.dataset import AccelerometerDataset


def test_a_warming_that_follows_the_angle_is_not_taken_for_the_coefficients() -> None:
    count = len(points(("io",), 12, SIX_FIELDS_T)[0])
    warm = 23.0 + 0.5 * (1.0 - np.exp(-3.0 * np.arange(count) / count))
    dataset = record(
        16, ("io",), 12, SIX_FIELDS_T, temperature_degC=warm, K0_per_K=3e-5, Ki_per_K=1e-4
    )
    assert max(off_in_u(analyse(dataset)).values()) < 4.0


def test_without_input_acceleration_no_offset_of_the_encoder_is_sought() -> None:
    for seed in range(4):
        analysis = analyse(record(seed, ("op",), 7, (0.0, 0.05)))
        assert "encoder offset" not in {one.name for one in analysis.nuisances}


def test_few_rows_are_told_with_the_uncertainty_they_have_or_not_at_all() -> None:
    fields_T = (0.0, 0.05)
    warm = 23.0 + 0.5 * (1.0 - np.exp(-np.arange(14) / 5.0))
    off: list[float] = []
    for seed in range(12):
        for temperature in (None, warm):
            whole = record(seed, ("io",), 7, fields_T, temperature_degC=temperature, K0_per_K=3e-5)
            for count in range(9, 15):
                rows = np.sort(np.random.default_rng([seed, count]).permutation(14)[:count])
                analysis = analyse(some_rows(whole, rows))
                # Seven angles at two fields have eight columns, and that of the misalignment.
                assert all(one.value is None for one in analysis.estimates) or count >= 12
                warmer_K = 0.0 if temperature is None else float(np.mean(warm[rows]) - warm.mean())
                true = {**TRUTH, "K0": TRUTH["K0"] + 3e-5 * warmer_K}
                freedom = analysis.estimates[0].degrees_of_freedom
                if freedom is not None:
                    limit = stdtrit(freedom, 0.975)
                    off += [one / limit for one in off_in_u(analysis, true).values()]
    assert np.mean(np.array(off) < 1.0) > 0.88
    assert max(off) < 3.0


@pytest.mark.parametrize("fields_T", [SIX_FIELDS_T, (0.0, 0.05), (-0.05, 0.0, 0.05)])
@pytest.mark.parametrize("planes", [("io", "ip"), ("io",)])
def test_a_drift_is_in_the_uncertainties_of_few_positions(
    planes: tuple[str, ...], fields_T: tuple[float, ...]
) -> None:
    """In one plane of five positions, once each, no row tells a linear drift from the rest."""
    hours = INTERVAL_S * np.arange(len(points(planes, 5, fields_T)[0])) / 3600.0
    squares, inside = [], []
    for drift_V_per_h in (0.0, 20e-6, 60e-6, 200e-6, 600e-6 if len(planes) > 1 else 300e-6):
        for seed in range(5000, 5012):
            analysis = analyse(record(seed, planes, 5, fields_T, drift_V=drift_V_per_h * hours))
            truth = {**TRUTH, "K0": TRUTH["K0"] + drift_V_per_h * float(hours.mean())}
            off = list(off_in_u(analysis, truth).values())
            freedom = analysis.estimates[0].degrees_of_freedom
            limit = stdtrit(freedom, 0.975) if freedom else 1.0
            squares += [(one / limit * 1.96) ** 2 for one in off]
            inside += [one < limit for one in off]
    if squares or len(planes) > 1 or len(fields_T) > 2:
        assert float(np.sqrt(np.mean(squares))) < 1.2
        assert np.mean(inside) > 0.9


def some_rows(dataset: AccelerometerDataset, rows: NDArray[np.int64]) -> AccelerometerDataset:
    arrays = {name: one for name, one in vars(dataset).items() if isinstance(one, np.ndarray)}
    return replace(dataset, **{name: one[rows] for name, one in arrays.items()})


def test_an_encoder_that_turned_on_by_two_marks_is_solved_for() -> None:
    clean = record(3, ("io", "op", "ip"), 12)
    slipped = 60.0 * (np.arange(len(clean)) >= len(clean) // 3)
    analysis = analyse(replace(clean, theta_deg=clean.theta_deg + slipped))
    assert "encoder-jump" in {flag.code for flag in analysis.flags}
    assert max(off_in_u(analysis).values()) < 5.0


def test_an_angle_of_the_other_sign_gives_no_result() -> None:
    clean = record(3, ("io", "op", "ip"), 12)
    analysis = analyse(replace(clean, theta_deg=-clean.theta_deg))
    assert {flag.code for flag in analysis.flags} & {"wrong-position", "contradicts-statement"}
    assert all(estimate.value is None for estimate in analysis.estimates)


def test_a_step_of_the_output_leaves_the_offset_of_the_mean_over_all_rows() -> None:
    clean = record(5, ("io",), 36, (-0.05, 0.0, 0.05))
    later = np.arange(len(clean)) >= 40
    analysis = analyse(replace(clean, output_V=clean.output_V + 1e-3 * later))
    assert "output-step" in {flag.code for flag in analysis.flags}
    truth = {**TRUTH, "K0": TRUTH["K0"] + 1e-3 * float(later.mean())}
    assert max(off_in_u(analysis, truth).values()) < 5.0


@pytest.mark.parametrize("beside", [-2, 1, 3])
def test_a_step_with_a_wild_row_beside_it_is_found_in_its_row(beside: int) -> None:
    for seed, step_V in ((5, 1e-3), (6, 1e-2)):
        clean = record(seed, ("io", "ip"), 24, SIX_FIELDS_T)
        later = np.arange(len(clean)) >= 100
        wild = 5e-2 * (np.arange(len(clean)) == 100 + beside)
        analysis = analyse(replace(clean, output_V=clean.output_V + step_V * later + wild))
        step = next(flag for flag in analysis.flags if flag.code == "output-step")
        assert step.details["row"] == 100
        truth = {**TRUTH, "K0": TRUTH["K0"] + step_V * float(later.mean())}
        assert max(off_in_u(analysis, truth).values()) < 4.0


def test_a_step_that_one_row_between_wild_ones_tells_is_not_one_of_the_scale_factor() -> None:
    clean = record(103, ("io", "level"), 12)
    later = np.arange(len(clean)) >= 31
    output_V = clean.output_V + 4e-5 * later
    output_V[28:34] -= 1e-5 * np.array([289, 489, 802, 467, 732, 12])
    analysis = analyse(replace(clean, output_V=output_V))
    step = next(flag for flag in analysis.flags if flag.code == "output-step")
    assert step.details["what"] == "output"
    truth = {**TRUTH, "K0": TRUTH["K0"] + 4e-5 * float(later.mean())}
    assert max(off_in_u(analysis, truth).values()) < 4.0


@pytest.mark.parametrize("seed", range(100, 104))
def test_a_shape_over_angle_beside_a_drift_is_a_misfit(seed: int) -> None:
    clean = record(seed, ("io",), 12)
    time = np.linspace(-1.0, 1.0, len(clean))
    shape_V = 3e-5 * np.sign(np.sin(2.0 * np.radians(clean.theta_deg) + 1.0))
    moved = replace(clean, output_V=clean.output_V + shape_V + 1e-3 * (time**3 + time))
    assert {"angle", "field"} & {
        flag.details.get("what") for flag in analyse(moved).flags if flag.code == "misfit"
    }
