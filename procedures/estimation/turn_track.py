"""Where a table was between the readings of its encoder, and how well its rate is known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

FEWEST_FOR_TRACK = 10
FEWEST_TURNS = 0.9
SHORT_S = 1e-4
"""Below it all readings are as sure as each other."""
WANDERS = 2.0
"""Scatter about the line over that of neighbours, as variances, beyond which the table wanders."""


@dataclass(frozen=True)
class Track:
    """The table's angle over time: `rate` and, where it wanders, the readings themselves.

    `end_u_deg` is the standard uncertainty of the angle at each end of the record that makes up
    that of its mean rate.
    """

    start_s: float
    start_deg: float
    rate_deg_per_s: float
    end_u_deg: float
    readings: tuple[Array, Array] | None = None

    def known(self, from_s: float, until_s: float) -> tuple[float, float]:
        """Return in which part of a record the angle is known: a table that keeps its rate, in all.

        Of another one nothing is known before the first and after the last reading.
        """
        if self.readings is None:
            return from_s, until_s
        read_s, _ = self.readings
        return max(from_s, float(read_s[0])), min(until_s, float(read_s[-1]))

    def angle_deg(self, time_s: Array) -> Array:
        """Return the angle at each time, (n,), within what is `known`."""
        if self.readings is not None:
            return np.asarray(np.interp(time_s, *self.readings))
        return np.asarray(self.start_deg + self.rate_deg_per_s * (time_s - self.start_s))


def track(time_s: Array, angle_deg: Array, took_s: Array | None = None) -> Track:
    """Return the track of readings (n,) at times (n,), turns counted; n is 2 or more.

    A reading comes with the time at which it was asked for and answered: at 100 deg/s a millisecond
    is 0.1 deg, far more than the encoder's own error. A table that keeps its rate is a straight
    line through all readings, which averages that; one that wanders is followed from reading to
    reading.

    `took_s` (n,) is how long each reading took: it was made some time within, so that one that took
    long counts less. Over a turn and more one sine and cosine of the angle beside the line take the
    encoder's graduation error off: they are no part of the rate.
    """
    span_s, ends = float(time_s[-1] - time_s[0]), float(angle_deg[-1] - angle_deg[0])
    count = len(time_s)
    sure = np.ones(count) if took_s is None else 1.0 / (took_s + SHORT_S)
    sure = sure / np.sqrt(np.mean(sure**2))
    columns = [np.ones(count), (time_s - time_s[0]) / span_s]
    if count >= FEWEST_FOR_TRACK and abs(ends) >= FEWEST_TURNS * 360.0:
        columns += [np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))]
    if count <= len(columns):
        return _joined(time_s, angle_deg, ends / span_s, 0.0)
    design, aim = np.column_stack(columns) * sure[:, None], (angle_deg - angle_deg[0]) * sure
    solved, *_ = np.linalg.lstsq(design, aim, rcond=None)
    left = aim - design @ solved
    variance = float(left @ left) / (count - design.shape[1])
    neighbours = float(np.mean(np.diff(left) ** 2)) / 2.0
    if count < FEWEST_FOR_TRACK or variance > WANDERS * neighbours:
        variance_used = variance if count < FEWEST_FOR_TRACK else neighbours
        of_the_ends = 0.5 * (sure[0] ** -2 + sure[-1] ** -2)
        return _joined(
            time_s, angle_deg, ends / span_s, float(np.sqrt(variance_used * of_the_ends))
        )
    u = float(np.sqrt(variance * np.linalg.inv(design.T @ design)[1, 1]))
    start_deg = float(angle_deg[0] + solved[0])
    return Track(float(time_s[0]), start_deg, float(solved[1]) / span_s, u / np.sqrt(2.0))


def _joined(time_s: Array, angle_deg: Array, rate: float, u_deg: float) -> Track:
    return Track(float(time_s[0]), float(angle_deg[0]), rate, u_deg, (time_s, angle_deg))
