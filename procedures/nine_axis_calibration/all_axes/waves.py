"""Means, and waves round the turn, of every channel of a mounting; with the rate and without."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from procedures.estimation.turn_encoder import unwrap
from procedures.nine_axis_calibration.means import good_samples, interval_of
from procedures.nine_axis_calibration.turning import round_the_turn

from .stands import Array, Mounted, Rest

THRESHOLD = 5.0
ROUNDS = 3
LEVER_G = 0.02
"""g per (rad/s)^2: an accelerometer 0.2 m from the axis, as the largest that is expected."""
ALONG_G = 2e-5
"""The same along the axis: of 0.2 m by an input axis that leans 1 mrad."""


@dataclass(frozen=True)
class Wave:
    """One record of turns: `value` (3, c) is mean, cosine and sine of each channel by the table's
    angle, `inverse` (3, 3) its covariance for noise of one, `sigma` (c,) that of a sample."""

    rate_rad_per_s: float
    value: Array
    inverse: Array
    sigma: Array


def waves_of(mounting: Mounted, channels: Sequence[Array]) -> list[Wave]:
    """Return the wave of each record; `channels` hold its samples (n, c), NaN where none came."""
    interval_s = interval_of([record.turn.time_s for record in mounting.records])
    waves = []
    for record, samples in zip(mounting.records, channels, strict=True):
        turn = record.turn
        encoder = unwrap(turn.time_s, turn.encoder_deg, turn.commanded_deg_per_s, interval_s)
        columns = np.column_stack((np.ones(len(samples)), round_the_turn(encoder, interval_s)))
        count = samples.shape[1]
        value, sigma = np.full((3, count), np.nan), np.full(count, np.nan)
        inverse = np.full((3, 3), np.nan)
        for channel in range(count):
            good = np.isfinite(samples[:, channel]) & ~encoder.unsteady
            for _ in range(ROUNDS):
                if int(good.sum()) < 6:
                    break
                used = columns[good]
                inverse = np.linalg.pinv(used.T @ used)
                fitted = inverse @ (used.T @ samples[good, channel])
                left = samples[:, channel] - columns @ fitted
                value[:, channel] = fitted
                sigma[channel] = np.sqrt(np.sum(left[good] ** 2) / max(int(good.sum()) - 3, 1))
                good = good_samples(np.where(encoder.unsteady, np.nan, left), THRESHOLD)
        rate = float(np.radians(encoder.mean_rate_deg_per_s))
        waves.append(Wave(rate, value, inverse, sigma))
    return [wave for wave in waves if np.isfinite(wave.rate_rad_per_s)]


def at_rest(rest: Rest, samples: Array) -> tuple[Array, Array]:
    """Return mean and standard uncertainty of each channel (3,) of a stand at rest."""
    mean, u = np.full(3, np.nan), np.full(3, np.nan)
    for channel in range(3):
        good = good_samples(samples[:, channel], THRESHOLD)
        values = samples[good, channel]
        if len(values) > 1:
            mean[channel] = values.mean()
            u[channel] = values.std(ddof=1) / np.sqrt(len(values))
    return mean, u


def without_rate(mounting: Mounted, waves: Sequence[Wave], first: int) -> tuple[Array, Array]:
    """Return what three channels from `first` on read at no rate, and its covariance (3, 3).

    A lever arm feels the square of the rate: its slope is free, along the axis within a little.
    """
    square = np.array([wave.rate_rad_per_s**2 for wave in waves])
    value, u = np.full(3, np.nan), np.full(3, np.nan)
    for channel in range(3):
        own = np.array([wave.value[0, first + channel] for wave in waves])
        size = np.array(
            [wave.sigma[first + channel] * np.sqrt(wave.inverse[0, 0]) for wave in waves]
        )
        good = np.isfinite(own) & (size > 0.0)
        if not bool(good.any()):
            continue
        slope_u = ALONG_G if abs(mounting.up[channel]) > 0.99 else LEVER_G
        design = np.column_stack((np.ones(int(good.sum())), square[good])) / size[good, None]
        normal = design.T @ design + np.diag([0.0, 1.0 / slope_u**2])
        inverse = np.linalg.inv(normal)
        value[channel] = (inverse @ (design.T @ (own[good] / size[good])))[0]
        u[channel] = np.sqrt(inverse[0, 0])
    return value, np.diag(u**2)
