"""Least squares by QR, independent columns, and rows that do not belong."""

from __future__ import annotations

import numpy as np
import pytest

from procedures.estimation.orthogonal import (
    choose_by_information,
    independent_of,
    keep_inliers,
    solve_by_qr,
    split_columns,
    thin_qr,
)


def test_split_columns_makes_the_others_of_the_kept() -> None:
    generator = np.random.default_rng(0)
    first = generator.standard_normal((40, 3))
    columns = np.column_stack((first, first[:, 0] - 2.0 * first[:, 2], np.zeros(40)))
    split = split_columns(columns, 1e-6)
    assert split.kept == (0, 1, 2)
    assert split.folds[:, 3] == pytest.approx([1.0, 0.0, -2.0])
    assert split.folds[:, 4] == pytest.approx(0.0)


def test_a_row_that_carries_a_column_alone_is_not_rejected() -> None:
    design = np.column_stack((np.ones(20), np.eye(20)[:, 4]))
    data = np.ones(20) + 1e-3 * np.random.default_rng(0).standard_normal(20)
    data[4] += 100.0
    data[9] += 100.0
    assert np.flatnonzero(~keep_inliers(design, data, 5.0)).tolist() == [9]
    assert solve_by_qr(design, data).condition == pytest.approx(1.0, abs=1.0)


def test_blocks_of_rows_make_the_same_decomposition() -> None:
    columns = np.random.default_rng(3).standard_normal((1000, 12))
    q, r = thin_qr(columns)
    assert q @ r == pytest.approx(columns, abs=1e-12)
    assert q.T @ q == pytest.approx(np.eye(12), abs=1e-13)
    assert np.allclose(r, np.triu(r))


def test_columns_are_taken_in_order_as_long_as_they_bring_something_of_their_own() -> None:
    generator = np.random.default_rng(4)
    columns = generator.standard_normal((50, 2))
    fresh = generator.standard_normal(50)
    candidates = np.column_stack((columns[:, 0], fresh, 2.0 * fresh - columns[:, 1], np.zeros(50)))
    assert independent_of(columns, candidates, 1e-3) == (1,)


def test_noise_asks_for_no_further_column() -> None:
    generator = np.random.default_rng(5)
    taken = 0
    for _ in range(400):
        noise = generator.standard_normal(60)
        squares = [float(noise @ noise) - float(noise[:n] @ noise[:n]) for n in range(4)]
        taken += choose_by_information(squares, [1, 2, 3, 4], 60) > 0
    assert taken <= 12


def test_weights_count_as_rows_that_repeat() -> None:
    generator = np.random.default_rng(6)
    design, data = generator.standard_normal((30, 3)), generator.standard_normal(30)
    times = generator.integers(1, 4, 30)
    weighed = solve_by_qr(design, data, np.sqrt(times))
    repeated = solve_by_qr(np.repeat(design, times, axis=0), np.repeat(data, times))
    assert weighed.coefficients == pytest.approx(repeated.coefficients)
    assert weighed.inverse_normal == pytest.approx(repeated.inverse_normal)
