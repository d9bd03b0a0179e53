"""Where the table was between readings of its encoder, and how well that is known.

A reading comes with the time at which it was asked for and answered: at 100 deg/s a millisecond is
0.1 deg, far more than the encoder's own error. A table that keeps its rate is a straight line
through all readings, which averages that; one that wanders is followed from reading to reading.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

FEWEST_FOR_LINE = 10
FEWEST_TURNS = 0.9
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

    def angle_deg(self, time_s: Array) -> Array:
        """Return the angle at each time, (n,)."""
        if self.readings is not None:
            return np.asarray(np.interp(time_s, *self.readings))
        return np.asarray(self.start_deg + self.rate_deg_per_s * (time_s - self.start_s))


def track(time_s: Array, angle_deg: Array) -> Track:
    """Return the track of readings (n,) at times (n,), turns counted; n is 2 or more.

    Beside the line one sine and cosine of the angle take the encoder's graduation error off: over a
    few turns they are no part of the rate.
    """
    since_s, span_s = time_s - time_s[0], float(time_s[-1] - time_s[0])
    ends = float(angle_deg[-1] - angle_deg[0])
    count = len(time_s)
    if count < FEWEST_FOR_LINE or abs(ends) < FEWEST_TURNS * 360.0:
        return _joined(time_s, angle_deg, ends / span_s, 0.0)
    turned = np.radians(angle_deg)
    design = np.column_stack(
        (np.ones(count), since_s / span_s, np.cos(turned), np.sin(turned)),
    )
    solved, *_ = np.linalg.lstsq(design, angle_deg - angle_deg[0], rcond=None)
    left = angle_deg - angle_deg[0] - design @ solved
    variance = float(left @ left) / (count - design.shape[1])
    neighbours = float(np.mean(np.diff(left) ** 2)) / 2.0
    if variance > WANDERS * neighbours:
        return _joined(time_s, angle_deg, ends / span_s, float(np.sqrt(neighbours)))
    u = float(np.sqrt(variance * np.linalg.inv(design.T @ design)[1, 1]))
    start_deg = float(angle_deg[0] + solved[0])
    return Track(float(time_s[0]), start_deg, float(solved[1]) / span_s, u / np.sqrt(2.0))


def _joined(time_s: Array, angle_deg: Array, rate: float, u_deg: float) -> Track:
    return Track(float(time_s[0]), float(angle_deg[0]), rate, u_deg, (time_s, angle_deg))
