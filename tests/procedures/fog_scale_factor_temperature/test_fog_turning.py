"""Turn errors from headings and attitudes: wrapping, senses, and the axis that points up."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fog_records import record
from numpy.typing import NDArray

from procedures.fog_scale_factor_temperature.dataset import (
    TurnTable,
    rotation_to_navigation,
    turn_errors_deg,
    wrapped_deg,
)

Array = NDArray[np.float64]
UP = {"x": (0.0, 90.0, 0.0), "y": (0.0, 0.0, -90.0), "z": (0.0, 0.0, 180.0)}
"""Attitudes in which a body axis (x forward, y right, z down) points up."""


def attitude_of(matrix: Array) -> list[float]:
    """Return heading, pitch and roll in deg of C_b^n, as a navigator computes them."""
    heading = np.degrees(np.arctan2(matrix[1, 0], matrix[0, 0])) % 360.0
    pitch = np.degrees(np.arcsin(np.clip(-matrix[2, 0], -1.0, 1.0)))
    return [heading, pitch, np.degrees(np.arctan2(matrix[2, 1], matrix[2, 2]))]


def about_down(angle_deg: float) -> Array:
    s, c = np.sin(np.radians(angle_deg)), np.cos(np.radians(angle_deg))
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def turned_table(axis: str, commanded_deg: float, error_deg: float, seed: int = 0) -> TurnTable:
    """Return one turn about an axis that points nearly up, positive about the axis."""
    generator = np.random.default_rng(seed)
    heading, pitch, roll = UP[axis]
    tilt = generator.normal(0.0, 0.005, 2)
    first = np.array([[heading + generator.uniform(0, 360), pitch + tilt[0], roll + tilt[1]]])
    before = rotation_to_navigation(first)[0]
    after = about_down(-(commanded_deg + error_deg)) @ before
    one = record(0, (360,), sets=1).turns
    return replace(
        one,
        axis=np.array([axis]),
        commanded_deg=np.array([commanded_deg]),
        attitude_before_deg=np.array([attitude_of(before)]),
        attitude_after_deg=np.array([attitude_of(after)]),
    )


@pytest.mark.parametrize("axis", ["x", "y", "z"])
@pytest.mark.parametrize("commanded", [360.0, -360.0, 0.0])
def test_full_attitude_tells_a_turn_about_whatever_axis_points_up(
    axis: str, commanded: float
) -> None:
    table = turned_table(axis, commanded, 0.123)
    error = turn_errors_deg(table, "about-up", full_attitude=True)
    assert error == pytest.approx(0.123, abs=1e-6)


def test_each_upward_attitude_is_one() -> None:
    for axis, attitude in UP.items():
        column = "xyz".index(axis)
        down = rotation_to_navigation(np.array([attitude]))[0][2, column]
        assert down == pytest.approx(-1.0)


def test_the_sense_of_turns_decides_the_sign() -> None:
    table = turned_table("z", 360.0, 0.2)
    about_up = turn_errors_deg(table, "about-up", full_attitude=True)
    heading = turn_errors_deg(table, "heading", full_attitude=True)
    assert heading == pytest.approx(-about_up)


def test_headings_that_pass_north_are_wrapped() -> None:
    table = record(0, (360,), sets=1).turns
    before, after = np.array([[359.98, 0.0, 0.0]]), np.array([[0.03, 0.0, 0.0]])
    passing = replace(table, attitude_before_deg=before, attitude_after_deg=after)
    assert turn_errors_deg(passing, "heading", full_attitude=False) == pytest.approx(0.05)
    assert turn_errors_deg(passing, "about-up", full_attitude=False) == pytest.approx(-0.05)


def test_wrapping_leaves_half_a_turn_as_it_is() -> None:
    given = np.array([-540.0, -180.0, -0.1, 0.0, 180.0, 359.0, 720.5])
    assert wrapped_deg(given) == pytest.approx([180.0, 180.0, -0.1, 0.0, 180.0, -1.0, 0.5])
