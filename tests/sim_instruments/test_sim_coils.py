"""The field of the simulated coils against the textbook formula, and the signs of turned frames."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.constants import mu_0
from sim_bench import BENCH, bench_with, coil

from sim_instruments.truth import SimulationError, Truth
from sim_instruments.world.coils import HelmholtzPair, field_matrix_mT_per_A, small_rotation
from sim_instruments.world.laser_gyro import LaserGyroBench

STRAIGHT = {"towards_y": "0 deg", "towards_z": "0 deg"}


def pair(**changes: Any) -> HelmholtzPair:
    truth = coil("300 mm", leans=STRAIGHT) | {"spacing_error": "0 %"} | changes
    return HelmholtzPair("x", Truth(truth, "coils.x"))


def test_the_centre_field_is_that_of_a_helmholtz_pair() -> None:
    expected_mT = 0.8**1.5 * mu_0 * 100 / 0.3 * 1e3
    field = pair().field_mT_per_A(np.zeros(3))
    np.testing.assert_allclose(field, [expected_mT, 0.0, 0.0], rtol=1e-9, atol=1e-12)


def test_the_field_on_the_axis_falls_with_the_fourth_power_of_the_distance() -> None:
    centre, off = (pair().field_mT_per_A(np.array([z, 0, 0]))[0] for z in (0.0, 0.03))
    assert 1 - off / centre == pytest.approx(1.152e-4, rel=0.02)


def test_a_wider_spacing_weakens_the_field() -> None:
    assert (
        pair(spacing_error="2 %").field_mT_per_A(np.zeros(3))[0]
        < pair().field_mT_per_A(np.zeros(3))[0]
    )


def test_a_leaning_normal_turns_the_field() -> None:
    field = pair(normal={"towards_y": "1 deg", "towards_z": "-0.5 deg"}).field_mT_per_A(np.zeros(3))
    assert field[1] / field[0] == pytest.approx(np.tan(np.deg2rad(1.0)), rel=1e-6)
    assert field[2] / field[0] == pytest.approx(np.tan(np.deg2rad(-0.5)), rel=1e-6)


def test_the_matrix_has_one_column_for_each_coil() -> None:
    world = LaserGyroBench(Truth(BENCH["simulation"], "simulation"))
    matrix = field_matrix_mT_per_A(world.pairs, np.zeros(3))
    assert (np.diag(matrix) > 0.25).all()
    assert np.abs(matrix - np.diag(np.diag(matrix))).max() < 0.01


def test_a_frame_turned_about_z_sees_x_vectors_move_towards_minus_y() -> None:
    truth = Truth({"r": {"about_x": "0 deg", "about_y": "0 deg", "about_z": "1 deg"}}, "here")
    seen = small_rotation(truth, "r") @ np.array([1.0, 0.0, 0.0])
    np.testing.assert_allclose(seen, [np.cos(np.deg2rad(1)), -np.sin(np.deg2rad(1)), 0], atol=1e-12)


@pytest.mark.parametrize("missing", ["latitude", "pulse_weight", "warm_up"])
def test_a_missing_truth_is_named_with_its_place(missing: str) -> None:
    bench = bench_with()
    del bench["simulation"]["gyro"][missing]
    with pytest.raises(SimulationError, match=rf"simulation\.gyro: '{missing}' is missing"):
        LaserGyroBench(Truth(bench["simulation"], "simulation"))


def test_a_truth_without_its_unit_is_refused() -> None:
    with pytest.raises(SimulationError, match="number with its unit"):
        LaserGyroBench(Truth(bench_with(gyro__bias=0.006)["simulation"], "simulation"))
