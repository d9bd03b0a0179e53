"""The shared estimators: what each promises, on data whose answer is known."""

from __future__ import annotations

import numpy as np
import pytest

from procedures.estimation.linear import least_squares, reject_outliers, robust_sigma
from procedures.estimation.noise import (
    LocalNoise,
    fit_autoregression,
    grid_index,
    lag_one_correlation,
    local_noise,
    noise_near_line,
    periodogram,
    whiten,
)
from procedures.estimation.sine import (
    amplitude_spectrum,
    averaging_factor,
    coarse_frequency,
    drift_order,
    legendre_columns,
    line_columns,
    peak_near,
    phasors,
    refine_frequency,
)


def test_least_squares_agrees_with_the_library_and_counts_what_each_column_brings() -> None:
    generator = np.random.default_rng(0)
    design, data = generator.standard_normal((200, 5)), generator.standard_normal(200)
    fit = least_squares(design, data)
    expected = np.linalg.lstsq(design, data, rcond=None)
    assert fit.coefficients == pytest.approx(expected[0], rel=1e-8)
    assert fit.sum_of_squares == pytest.approx(float(expected[1][0]))
    fewer = least_squares(design[:, :4], data)
    assert fit.gains[4] == pytest.approx(fewer.sum_of_squares - fit.sum_of_squares, abs=1e-8)


def test_columns_that_repeat_each_other_do_not_break_the_fit() -> None:
    column = np.linspace(-1.0, 1.0, 50)
    fit = least_squares(np.column_stack((column, column)), 3.0 * column)
    assert fit.coefficients.sum() == pytest.approx(3.0, rel=1e-6)


def test_legendre_columns_are_nearly_orthogonal_over_their_span() -> None:
    time_s = np.linspace(10.0, 20.0, 2001)
    columns = legendre_columns(time_s, 4, 10.0, 20.0)
    normal = columns.T @ columns / len(time_s)
    assert np.diag(normal) == pytest.approx(1.0 / (2.0 * np.arange(5) + 1.0), rel=5e-3)
    assert np.abs(normal - np.diag(np.diag(normal))).max() < 2e-3


def test_the_drift_order_is_that_of_the_drift_and_zero_for_noise() -> None:
    time_s = np.arange(1000.0)
    columns = legendre_columns(time_s, 4, 0.0, 999.0)
    for true in (0, 1, 2, 3):
        generator = np.random.default_rng(true)
        data = generator.standard_normal(1000) + columns[:, true] * (2.0 if true else 0.0)
        sums = [least_squares(columns[:, : p + 1], data).sum_of_squares for p in range(5)]
        assert drift_order(np.array(sums), 1000, 2.0) == true


def test_spikes_are_rejected_and_quantised_samples_are_not() -> None:
    generator = np.random.default_rng(3)
    design = legendre_columns(np.arange(500.0), 1, 0.0, 499.0)
    data = generator.standard_normal(500)
    data[[7, 100, 101, 400]] += [40.0, -1e4, 25.0, 1e6]
    kept = reject_outliers(design, data, 5.0)
    assert list(np.flatnonzero(~kept)) == [7, 100, 101, 400]
    counts = np.zeros(500)
    counts[::9] = 1.0
    assert robust_sigma(counts) == 0.0
    assert reject_outliers(design, counts, 5.0, floor=0.6).all()


def test_grid_numbers_skip_missing_rows_and_survive_a_clock_that_is_off() -> None:
    time_s = np.delete(np.arange(3000) * 0.1 * 1.0004, [5, 6, 1000])
    index = grid_index(time_s, 0.1)
    assert list(index) == list(np.delete(np.arange(3000), [5, 6, 1000]))


def test_whitening_removes_the_colour_across_gaps() -> None:
    generator = np.random.default_rng(4)
    noise = np.zeros(4000)
    for n in range(2, 4000):
        noise[n] = 0.6 * noise[n - 1] - 0.3 * noise[n - 2] + generator.standard_normal()
    index = np.delete(np.arange(4000), np.r_[100:150, 2000, 3000:3003]).astype(np.int64)
    model = fit_autoregression(noise[index], index, 12)
    assert model.order == 2
    assert model.coefficients[2] == pytest.approx([0.6, -0.3], abs=0.04)
    white = whiten(noise[index][:, None], index, model)[:, 0]
    assert len(white) == len(index)
    assert abs(lag_one_correlation(white, index)) < 0.05
    assert lag_one_correlation(noise[index], index) > 0.4


def test_white_noise_needs_no_autoregression() -> None:
    orders = []
    for seed in range(50):
        noise = np.random.default_rng(seed).standard_normal(800)
        orders.append(fit_autoregression(noise, np.arange(800), 16).order)
    assert sum(order > 0 for order in orders) <= 3


def test_local_noise_is_the_variance_of_white_noise_and_sees_a_bulge() -> None:
    values, freedoms = [], []
    for seed in range(200):
        noise = 2.0 * np.random.default_rng(seed).standard_normal(500)
        spectrum = periodogram(noise, np.arange(500), 1.0)
        near = local_noise(spectrum, 0.1, [], 0.01, 0.49, 16)
        assert near is not None
        values.append(near.variance)
        freedoms.append(near.degrees_of_freedom)
    assert np.mean(values) == pytest.approx(4.0, rel=0.06)
    # The stated freedom is that of the scatter: var/mean^2 = 2/nu.
    assert 2.0 / (np.std(values) / np.mean(values)) ** 2 == pytest.approx(freedoms[0], rel=0.3)
    time_s = np.arange(500.0)
    bulge = 2.0 * np.random.default_rng(0).standard_normal(500)
    for k in (46.4, 47.9, 52.2, 53.6):
        bulge += np.cos(2.0 * np.pi * k / 500.0 * time_s + k)
    spectrum = periodogram(bulge, np.arange(500), 1.0)
    chosen = noise_near_line(spectrum, 0.1, [], 0.01, 0.49, LocalNoise(4.0, 490.0))
    assert chosen.variance > 8.0
    assert chosen.degrees_of_freedom < 40.0


def test_no_local_noise_where_there_is_no_room() -> None:
    spectrum = periodogram(np.random.default_rng(0).standard_normal(12), np.arange(12), 1.0)
    assert local_noise(spectrum, 0.25, [0.1, 0.4], 0.1, 0.4, 16) is None


def test_phasors_come_out_as_they_went_in() -> None:
    time_s = np.linspace(-50.0, 50.0, 1001)
    truth = np.array([0.3 - 0.4j, -1.0 + 2.0j])
    data = sum(
        np.real(x * np.exp(2j * np.pi * f * time_s))
        for x, f in zip(truth, (0.07, 0.2), strict=True)
    )
    fit = least_squares(line_columns(time_s, [0.07, 0.2]), np.asarray(data))
    assert phasors(fit.coefficients) == pytest.approx(truth, abs=1e-9)


@pytest.mark.parametrize("offset", [0.0, 3e-4, -0.006])
def test_the_frequency_is_found_in_drift_and_noise_within_its_uncertainty(offset: float) -> None:
    pulls = []
    for seed in range(40):
        generator = np.random.default_rng(seed)
        time_s = np.sort(generator.uniform(0.0, 200.0, 900))
        truth = 0.1 + offset
        data = 0.04 + 1e-4 * time_s + np.sin(2.0 * np.pi * truth * time_s + seed)
        data += 0.01 * generator.standard_normal(900)
        start = coarse_frequency(time_s, data, 0.1, 0.01)
        found, u = refine_frequency(time_s, data, [start], 0, 2)
        pulls.append((found - truth) / u)
    assert np.mean(np.square(pulls)) == pytest.approx(1.0, abs=0.6)
    assert np.max(np.abs(pulls)) < 4.5


def test_averaging_shrinks_a_sine_by_the_sinc() -> None:
    assert averaging_factor(0.2, 1.0) == pytest.approx(0.9355, abs=1e-4)
    assert averaging_factor(0.2, 0.0) == 1.0


def test_the_published_spectrum_doubles_every_line_but_the_two_without_an_image() -> None:
    time_s = np.arange(100) * 0.1
    samples = 9.6 + 0.5 * np.cos(2.0 * np.pi * 1.0 * time_s) + 0.25 * np.cos(np.pi * np.arange(100))
    frequency_Hz, amplitude = amplitude_spectrum(samples, 0.1)
    assert len(amplitude) == 51
    assert frequency_Hz[10] == pytest.approx(1.0)
    assert amplitude[[0, 10, 50]] == pytest.approx([9.6, 0.5, 0.25])
    assert peak_near(frequency_Hz, amplitude, 1.04) == pytest.approx(0.5)
    assert peak_near(frequency_Hz, amplitude, 0.12) == pytest.approx(0.0, abs=1e-12)
    assert peak_near(frequency_Hz, amplitude, 7.0) is None
    assert peak_near(frequency_Hz, amplitude, 0.01) is None
