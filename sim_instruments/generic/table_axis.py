"""An axis of a table whatever its controller: its encoder, and when a movement goes too far."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from itertools import pairwise
from typing import Protocol

import numpy as np

from sim_instruments.faults.lasting import FollowingError, LastingFault, Stuck
from sim_instruments.instrument import Setting
from sim_instruments.truth import SimulationError, Truth
from sim_instruments.world.rotation import RotationHistory


class TableData:
    """What the axes of a table have in common; truth of the bench file.

    `maximum_rate`, `maximum_acceleration`; `rate_error` of the controller's clock; `rate_noise` of
    a reading; `encoder_noise` (rms) and `resolution`; `tracking_delay`, how late an axis follows
    its profile.
    """

    def __init__(self, truth: Truth) -> None:
        self.largest_rate = truth.positive("maximum_rate", "deg/s")
        self.largest_acceleration = truth.positive("maximum_acceleration", "deg/s^2")
        self.rate_error = truth.quantity("rate_error", "1")
        self.rate_noise = truth.quantity("rate_noise", "deg/s")
        self.encoder_noise_deg = truth.quantity("encoder_noise", "deg")
        self.resolution_deg = truth.positive("resolution", "deg")
        self.delay_s = self.time_s(truth, "tracking_delay")

    @staticmethod
    def time_s(truth: Truth, name: str) -> float:
        """Return a time of the truth, in s; SimulationError for one below zero."""
        seconds = truth.quantity(name, "s")
        if seconds < 0:
            raise SimulationError(f"{truth.where}: times must not be negative")
        return seconds


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


class EncodedAxis:
    """Where an axis truly is, a `RotationHistory` of the world, and what its controller reads."""

    def __init__(
        self,
        data: TableData,
        encoder: Encoder,
        rotation: RotationHistory | None,
        rng: np.random.Generator,
        now: Callable[[], float],
    ) -> None:
        self._data, self.encoder, self._rng, self._now = data, encoder, rng, now
        self.rotation = rotation if rotation is not None else RotationHistory(encoder.start_deg)
        if not encoder.referenced:
            encoder.lost_deg = encoder.reads(self.true_deg(now()))

    def true_deg(self, time_s: float) -> float:
        """Return the true angle at a time, turns counted."""
        return self.rotation.now_at(time_s)[0]

    def reading_deg(self) -> float:
        """Return a reading of the encoder, turns counted."""
        noise_deg = self._data.encoder_noise_deg * float(self._rng.standard_normal())
        step_deg = self._data.resolution_deg
        reads_deg = self.encoder.reads(self.true_deg(self._now()))
        return round((reads_deg + noise_deg) / step_deg) * step_deg

    def rate_deg_per_s(self) -> float:
        """Return the rate as the controller measures it, by its own clock."""
        _, true = self.rotation.now_at(self._now())
        noise = self._data.rate_noise * float(self._rng.standard_normal())
        return true / (1 + self._data.rate_error) + noise

    def turns(self) -> bool:
        """Return whether the axis truly turns, or will without another command."""
        return self._now() < self.rotation.at_rest_from_s


class Faulted(Protocol):
    """An axis on which the faults of a table act."""

    falls_behind: bool

    def fall_behind(self, time_s: float) -> None:
        """Fall behind the profile."""

    def stick(self, time_s: float, stuck: bool) -> None:
        """Be blocked where it stands, or free again."""


def let_faults_act(setting: Setting, axes: Iterable[Faulted]) -> None:
    """Let following errors and blocks of a table act on all its axes, from when they are there."""
    every = [*axes]

    def behind(time_s: float, fault: LastingFault | None) -> None:
        for axis in every:
            axis.falls_behind = False
            if fault is not None:
                axis.fall_behind(time_s)

    def stuck(time_s: float, fault: LastingFault | None) -> None:
        for axis in every:
            axis.stick(time_s, fault is not None)

    setting.faults.when_changed(FollowingError.kind, behind)
    setting.faults.when_changed(Stuck.kind, stuck)


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
