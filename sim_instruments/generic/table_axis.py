"""An axis of a table whatever its controller: its encoder, and when a movement goes too far."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise

from sim_instruments.truth import Truth
from sim_instruments.world.rotation import RotationHistory


class Encoder:
    """Offset, one sine a turn, and the range of an axis that does not turn for ever.

    Truth: `encoder_offset`, `encoder_sine`, `encoder_phase`; `angle_at_start`, where the axis truly
    stands when the world has none; `unreferenced: true` for an encoder that reads zero there until
    its zero is found; `low` and `high` for an axis with end stops.
    """

    def __init__(self, truth: Truth) -> None:
        self.offset_deg = truth.quantity("encoder_offset", "deg")
        self.sine_deg = truth.quantity("encoder_sine", "deg")
        self.phase_rad = math.radians(truth.quantity("encoder_phase", "deg"))
        self.start_deg = truth.quantity("angle_at_start", "deg")
        self.referenced = not truth.switch("unreferenced")
        ends = "low" in truth or "high" in truth
        self.low_deg = truth.quantity("low", "deg") if ends else -math.inf
        self.high_deg = truth.quantity("high", "deg") if ends else math.inf
        self.lost_deg = 0.0

    @property
    def continuous(self) -> bool:
        """Whether the axis turns for ever."""
        return math.isinf(self.low_deg)

    def reads(self, true_deg: float) -> float:
        """Return what the encoder reads at a true angle, turns counted."""
        sine = self.sine_deg * math.sin(math.radians(true_deg) + self.phase_rad)
        return true_deg + self.offset_deg + sine - self.lost_deg

    def true_at(self, reading_deg: float) -> float:
        """Return the true angle at which the encoder reads an angle."""
        near_deg = reading_deg - self.offset_deg + self.lost_deg
        return near_deg - self.sine_deg * math.sin(math.radians(near_deg) + self.phase_rad)


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
