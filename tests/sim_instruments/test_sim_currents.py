"""The current in a simulated coil against the answers of mathematics."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from sim_instruments.world.currents import CurrentHistory, mean_products

RESISTANCE_OHM, INDUCTANCE_H = 1.2, 0.018
TAU_S = INDUCTANCE_H / RESISTANCE_OHM


def history() -> CurrentHistory:
    return CurrentHistory(RESISTANCE_OHM, INDUCTANCE_H, lambda: None)


def sine_points(amplitude_A: float, dwell_s: float) -> tuple[np.ndarray, np.ndarray]:
    levels = amplitude_A * np.sin(2 * np.pi * np.arange(1000) / 1000)
    return levels, np.full(1000, dwell_s)


def test_a_step_follows_the_exponential_of_its_time_constant() -> None:
    coil = history()
    coil.hold(1.0, 2.0)
    times = np.array([0.5, 1.0, 1.0 + TAU_S, 1.0 + 3 * TAU_S, 2.0])
    expected = np.array([0.0, 0.0, 2 * (1 - np.exp(-1)), 2 * (1 - np.exp(-3)), 2.0])
    np.testing.assert_allclose(coil.current(times), expected, atol=1e-12)


def test_the_current_decays_with_its_time_constant_when_the_level_goes_to_zero() -> None:
    coil = history()
    coil.hold(0.0, 3.0)
    coil.hold(1.0, 0.0)
    assert coil.current(np.array([1.0 + TAU_S]))[0] == pytest.approx(3.0 * np.exp(-1), rel=1e-9)


def test_a_staircase_agrees_with_a_numerical_solution_of_the_circuit() -> None:
    coil = history()
    levels, dwells = np.array([0.0, 1.0, -2.0, 0.5]), np.array([0.01, 0.02, 0.005, 0.03])
    coil.run(0.0, [(levels, dwells, 3)], 0.25)
    times = np.linspace(0.001, 0.4, 400)
    edges = np.concatenate(([0.0], np.cumsum(np.tile(dwells, 3))))

    def slope(time_s: float, current: np.ndarray) -> np.ndarray:
        step = np.searchsorted(edges, time_s, side="right") - 1
        level = levels[step % 4] if step < 12 else 0.25
        return (level - current) / TAU_S

    solved = solve_ivp(slope, (0, 0.4), [0.0], t_eval=times, max_step=2e-4, rtol=1e-9, atol=1e-11)
    np.testing.assert_allclose(coil.current(times), solved.y[0], atol=2e-3)


def test_interval_means_equal_a_dense_average_of_the_current() -> None:
    coil = history()
    levels, dwells = sine_points(3.0, 0.01)
    coil.run(0.3, [(levels, dwells, 0)], 0.0)
    edges = np.arange(0.0, 25.0, 0.1)
    dense = np.linspace(edges[:-1], edges[1:], 4001)
    weights = np.full(4001, 1.0)
    weights[[0, -1]] = 0.5
    averaged = (weights[:, None] * coil.current(dense)).sum(axis=0) / weights.sum()
    assert np.abs(coil.mean_current(edges) - averaged).max() < 3e-5


def test_products_of_two_currents_equal_a_dense_average() -> None:
    first, second = history(), CurrentHistory(1.0, 0.03, lambda: None)
    first.run(0.0, [(*sine_points(3.0, 0.0050001), 0)], 0.0)
    second.run(0.2, [(*sine_points(2.0, 0.0070003), 0)], 0.0)
    edges = np.array([1.0, 1.1, 1.35, 2.0])
    exact = mean_products([first, second], edges)
    for n, (begin, end) in enumerate(pairwise(edges)):
        middles = begin + (np.arange(200_000) + 0.5) / 200_000 * (end - begin)
        currents = np.stack([first.current(middles), second.current(middles)])
        np.testing.assert_allclose(exact[n], currents @ currents.T / middles.size, rtol=1e-6)


def test_the_later_passes_may_leave_out_the_first_points() -> None:
    coil = history()
    all_points, later = np.array([9.0, 1.0, 2.0]), np.array([1.0, 2.0])
    end_s = coil.run(0.0, [(all_points, np.ones(3), 1), (later, np.ones(2), 2)], 0.0)
    assert end_s == 7.0
    middles = np.arange(8) + 0.5
    np.testing.assert_array_equal(coil.level(middles), [9, 1, 2, 1, 2, 1, 2, 0])


def test_a_stopped_list_has_no_future() -> None:
    coil = history()
    coil.run(0.0, [(np.array([1.0, -1.0]), np.array([0.1, 0.1]), 5)], 7.0)
    coil.hold(0.25, 0.5)
    np.testing.assert_array_equal(
        coil.level(np.array([0.05, 0.15, 0.22, 0.3, 5.0])), [1.0, -1.0, 1.0, 0.5, 0.5]
    )


def test_every_change_is_announced() -> None:
    seen: list[int] = []
    coil = CurrentHistory(1.0, 0.01, lambda: seen.append(1))
    coil.hold(0.0, 1.0)
    coil.run(1.0, [(np.array([1.0]), np.array([1.0]), 1)], 0.0)
    assert len(seen) == 2
