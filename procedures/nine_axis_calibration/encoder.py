"""The table's encoder, its turns counted: the error of its graduation, and where the table was.

`without_graduation` takes off the error that comes back every turn and is no motion, `track` says
where the table was between the readings of a run.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtri

from procedures.estimation.turn_encoder import SMALLEST_WILD_DEG, Encoder

from .dataset import Array, TurnRecord

ORDERS = 2
BY_CHANCE = 1e-6
FEWEST_READINGS = 8
MOSTLY_ENCODER = 0.5
SURE = 4.0
FEWEST_FOR_TRACK = 10
FEWEST_TURNS = 0.9
SHORT_S = 1e-4
"""Below it all readings are as sure as each other."""
WANDERS = 2.0
"""Scatter about the line over that of neighbours, as variances, beyond which the table wanders."""


def without_graduation(
    records: Sequence[TurnRecord],
    outputs: Sequence[Array],
    encoders: Sequence[Encoder],
    interval_s: float,
) -> tuple[list[Encoder], float]:
    """Return the encoders of one axis without their error once and twice a turn, and its size.

    All records share the error; each has its own rate. A table that truly turns unevenly moves the
    gyro, `outputs` (n,) in deg/s, too: what the gyro does not feel is the encoder's. The size is
    the amplitude in deg, 0 where there is none to be seen.
    """
    used = [
        n
        for n, encoder in enumerate(encoders)
        if np.isfinite(encoder.angle_deg).all()
        and not bool(encoder.unsteady.any())
        and len(encoder.angle_deg) >= FEWEST_READINGS
    ]
    if not used:
        return list(encoders), 0.0
    left, waves = [], []
    for n in used:
        # A line of its own takes up each record's start and rate.
        straight = np.vander(records[n].time_s - records[n].time_s[0], 2)
        both = np.column_stack((encoders[n].angle_deg, _waves(encoders[n].angle_deg)))
        solved, *_ = np.linalg.lstsq(straight, both, rcond=None)
        flat = both - straight @ solved
        left.append(flat[:, 0])
        waves.append(flat[:, 1:])
    stacked, error = np.vstack(waves), np.concatenate(left)
    amplitude, _, rank, _ = np.linalg.lstsq(stacked, error, rcond=None)
    freedom = len(error) - 2 * len(used) - 2 * ORDERS
    size = float(np.linalg.norm(amplitude))
    if rank < 2 * ORDERS or freedom < 1 or size < 0.1 * SMALLEST_WILD_DEG:
        return list(encoders), 0.0
    noise = float(np.sum((error - stacked @ amplitude) ** 2)) / freedom
    taken = float(np.sum((stacked @ amplitude) ** 2))
    if taken < noise * float(chdtri(2 * ORDERS, BY_CHANCE)):
        return list(encoders), 0.0
    felt, felt_u = _felt([outputs[n] for n in used], [w @ amplitude for w in waves], interval_s)
    if not (felt < MOSTLY_ENCODER and felt_u < MOSTLY_ENCODER / SURE):
        return list(encoders), 0.0
    mended = list(encoders)
    for n, encoder in enumerate(encoders):
        angle_deg = encoder.angle_deg - _waves(encoder.angle_deg) @ amplitude
        mended[n] = _retimed(encoder, angle_deg, records[n].time_s)
    return mended, size


def _waves(angle_deg: Array) -> Array:
    angle = np.radians(angle_deg)[:, None] * np.arange(1, ORDERS + 1)
    return np.column_stack((np.cos(angle), np.sin(angle)))


def _felt(
    outputs: Sequence[Array], waves: Sequence[Array], interval_s: float
) -> tuple[float, float]:
    """Return how much of the unevenness the gyro felt, 1 for all of it, with its u."""
    moved, read = [], []
    for output, wave in zip(outputs, waves, strict=True):
        rate, value = np.diff(wave) / interval_s, output[1:]
        there = np.isfinite(value)
        if int(there.sum()) < FEWEST_READINGS:
            continue
        far = np.abs(value - np.median(value[there]))
        there &= far <= 6.0 * max(float(np.median(far[there])), 1e-12)
        moved.append(rate[there] - rate[there].mean())
        read.append(value[there] - value[there].mean())
    if not moved:
        return 0.0, np.inf
    x, y = np.concatenate(moved), np.concatenate(read)
    square = max(float(x @ x), 1e-300)
    slope = float(x @ y) / square
    return slope, float(np.sqrt(np.mean((y - slope * x) ** 2) / square))


def _retimed(encoder: Encoder, angle_deg: Array, time_s: Array) -> Encoder:
    """Return an encoder with other angles, and the rates that follow from them."""
    if len(time_s) < 2:
        return encoder
    mean = float((angle_deg[-1] - angle_deg[0]) / (time_s[-1] - time_s[0]))
    rates = np.concatenate(([mean], np.diff(angle_deg) / np.diff(time_s)))
    return replace(encoder, angle_deg=angle_deg, rate_deg_per_s=rates, mean_rate_deg_per_s=mean)


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
