"""How long each step is expected to take, in s of bench time."""

from __future__ import annotations

from collections.abc import Sequence

from .measuring import FIELD_LOOK_S, LOOK_S, burst_s, group_by_angle
from .parameters import AccelerometerParameters, Point

HOMING_S, DEGAUSS_S, TURN_S, RAMP_S = 10.0, 14.0, 0.75, 0.4
RAMP_MT_PER_S, TURN_DEG_PER_S = 25.0, 20.0
"""A supply of 5 A/s at a coil of 5 mT/A; a stage of the usual rate."""


def points_s(
    parameters: AccelerometerParameters, points: Sequence[Point], before: Point | None = None
) -> float:
    """Return the expected time of points one after another, with what leads from each to the next.

    `before` is the point before the first one; None where the bench stands at its zeros.
    """
    still_s = parameters.dwell.at_least_s + FIELD_LOOK_S + burst_s(parameters) + LOOK_S
    whole_s = 0.0
    for point in points:
        whole_s += still_s + RAMP_S + turn_s(before, point)
        whole_s += abs(point.field_mT - (before.field_mT if before else 0.0)) / RAMP_MT_PER_S
        if before is not None and before.plane != point.plane and parameters.degauss:
            whole_s += DEGAUSS_S
        before = point
    return whole_s


def turn_s(before: Point | None, point: Point) -> float:
    """Return the expected time of the turn from a point to the next; none where both are alike."""
    way_deg = abs(point.angle_deg - (before.angle_deg if before else 0.0))
    return TURN_S + way_deg / TURN_DEG_PER_S if way_deg else 0.0


def set_up_s(parameters: AccelerometerParameters) -> float:
    """Return the expected time of step (2)."""
    return HOMING_S + parameters.warm_up_s + (DEGAUSS_S if parameters.degauss else 0.0)


def first_point_s(parameters: AccelerometerParameters) -> float:
    """Return the expected time of step (3)."""
    return points_s(parameters, parameters.points[:1])


def first_group_s(parameters: AccelerometerParameters) -> float:
    """Return the expected time of step (4)."""
    first, *others = group_by_angle(parameters.points)[0]
    return points_s(parameters, others, first)


def second_turn_s(parameters: AccelerometerParameters) -> float:
    """Return the expected time of step (5)."""
    first, *later = group_by_angle(parameters.points)
    return turn_s(first[-1], later[0][0]) if later else 0.0


def second_group_s(parameters: AccelerometerParameters) -> float:
    """Return the expected time of step (6): the turn was step (5)."""
    first, *later = group_by_angle(parameters.points)
    if not later:
        return 0.0
    return points_s(parameters, later[0], first[-1]) - second_turn_s(parameters)


def remaining_s(parameters: AccelerometerParameters) -> float:
    """Return the expected time of step (7), re-mounting aside."""
    groups = group_by_angle(parameters.points)
    done = [point for group in groups[:2] for point in group]
    return points_s(parameters, parameters.points[len(done) :], done[-1]) + RAMP_S
