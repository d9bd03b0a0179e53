"""When a movement that is already planned will be too fast or too far."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise

from sim_instruments.world.rotation import RotationHistory


def pieces(
    plan: RotationHistory, from_s: float
) -> Iterator[tuple[float, float, float, float, float]]:
    """Yield begin, end (s), angle (deg), rate (deg/s), acceleration of each piece of a plan."""
    edges = [from_s, *plan.breakpoints(from_s, math.inf).tolist(), math.inf]
    for begin_s, end_s in pairwise(edges):
        if end_s <= begin_s:
            continue
        angle, rate = plan.now_at(begin_s)
        slope = 0.0
        if math.isfinite(end_s):
            slope = (plan.now_at(end_s)[1] - rate) / (end_s - begin_s)
        yield begin_s, end_s, angle, rate, slope


def too_fast_from_s(plan: RotationHistory, from_s: float, largest: float) -> float:
    """Return when the rate first exceeds `largest` in magnitude; infinite if never."""
    for begin_s, end_s, _, rate, slope in pieces(plan, from_s):
        if abs(rate) > largest:
            return begin_s
        if slope:
            after_s = (math.copysign(largest, slope) - rate) / slope
            if begin_s + after_s < end_s - 1e-9:
                return begin_s + after_s
    return math.inf


def too_far_from_s(plan: RotationHistory, from_s: float, low: float, high: float) -> float:
    """Return when the angle first leaves its range; infinite if never."""
    for begin_s, end_s, angle, rate, slope in pieces(plan, from_s):
        if not low <= angle <= high:
            return begin_s
        after = [
            begin_s + root
            for limit in (low, high)
            for root in roots(0.5 * slope, rate, angle - limit)
            if root > 1e-9 and begin_s + root < end_s - 1e-9
        ]
        if after:
            return min(after)
    return math.inf


def roots(square: float, linear: float, constant: float) -> list[float]:
    """Return where a parabola, or a line, is zero."""
    if square == 0.0:
        return [] if linear == 0.0 else [-constant / linear]
    inside = linear**2 - 4 * square * constant
    if inside <= 0.0:
        return []
    return [(-linear + sign * math.sqrt(inside)) / (2 * square) for sign in (-1.0, 1.0)]
