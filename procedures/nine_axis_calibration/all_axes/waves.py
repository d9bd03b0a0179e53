"""Means, and waves round the turn, of every channel of a mounting; with the rate and without."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from procedures.estimation.turn_encoder import unwrap
from procedures.nine_axis_calibration.means import QUANTUM_PART, good_samples, interval_of
from procedures.nine_axis_calibration.turning import round_the_turn

from .channels import Steps, step_of, steps_of
from .stands import Array, Mounted, OtherAxes

THRESHOLD = 5.0
ROUNDS = 3
LEVER_G = 0.02
"""g per (rad/s)^2: an accelerometer 0.2 m from the axis, as the largest that is expected."""
LEAN_RAD = 1e-3
"""An input axis leans so much from the sensor's: along the axis a lever arm is felt by it, and by
what the mounting leans."""
WHITE = 12.0**-0.5
"""The standard deviation of rounding, in steps: that of a sample is no less."""


@dataclass(frozen=True)
class Wave:
    """One record of turns: `value` (3, c) is mean, cosine and sine of each channel by the table's
    angle, `inverse` (3, 3) its covariance for noise of one, `sigma` (c,) that of a sample,
    `residual` (n, c) what it leaves of the samples."""

    rate_rad_per_s: float
    value: Array
    inverse: Array
    sigma: Array
    residual: Array


def steps_at(data: OtherAxes, sensor: str) -> Steps:
    """Return the steps of a sensor's channels, `acceleration_g` or `field_nT`, in all records."""
    records, residuals = [], []
    for rest in data.rests:
        samples = getattr(rest, sensor)
        if samples is not None:
            records.append(samples)
            residuals.append(samples)
    for mounting in data.mountings:
        own = [getattr(record, sensor) for record in mounting.records]
        if any(samples is None for samples in own):
            continue
        records += own
        residuals += [wave.residual for wave in waves_of(mounting, own)]
    return steps_of(records, residuals)


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
        inverse = np.asarray(np.linalg.pinv(columns.T @ columns), dtype=np.float64)
        residual = np.full(samples.shape, np.nan)
        for channel in range(count):
            good = np.isfinite(samples[:, channel]) & ~encoder.unsteady
            for _ in range(ROUNDS):
                if int(good.sum()) < 6:
                    break
                used = columns[good]
                inverse = np.asarray(np.linalg.pinv(used.T @ used), dtype=np.float64)
                fitted = inverse @ (used.T @ samples[good, channel])
                left = samples[:, channel] - columns @ fitted
                value[:, channel], residual[:, channel] = fitted, np.where(good, left, np.nan)
                sigma[channel] = np.sqrt(np.sum(left[good] ** 2) / max(int(good.sum()) - 3, 1))
                steady = np.where(encoder.unsteady, np.nan, left)
                step = step_of([samples[good, channel]])
                good = good_samples(steady, THRESHOLD, QUANTUM_PART * step)
        rate = float(np.radians(encoder.mean_rate_deg_per_s))
        waves.append(Wave(rate, value, inverse, sigma, residual))
    return [wave for wave in waves if np.isfinite(wave.rate_rad_per_s)]


def at_rest(samples: Array, steps: Steps) -> tuple[Array, Array]:
    """Return mean and standard uncertainty of each channel (3,) of a stand at rest, NaN of none."""
    mean, u = np.full(3, np.nan), np.full(3, np.nan)
    for channel in range(3):
        step = float(steps.step[channel])
        good = good_samples(samples[:, channel], THRESHOLD, QUANTUM_PART * step)
        values = samples[good, channel]
        if len(values) > 1:
            mean[channel] = values.mean()
            noise = max(float(values.std(ddof=1)), WHITE * step)
            size = float(np.hypot(noise / np.sqrt(len(values)), steps.rounding[channel]))
            # What never changes, in no record, has measured nothing.
            if size <= 0.0:
                mean[channel] = np.nan
                continue
            u[channel] = size
    return mean, u


def without_rate(
    mounting: Mounted, waves: Sequence[Wave], first: int, steps: Steps
) -> tuple[Array, Array]:
    """Return what three channels from `first` on read at no rate, and its u (3,).

    A lever arm feels the square of the rate: its slope is free, along the axis within a little.
    """
    square = np.array([wave.rate_rad_per_s**2 for wave in waves])
    value, u = np.full(3, np.nan), np.full(3, np.nan)
    for channel in range(3):
        own = np.array([wave.value[0, first + channel] for wave in waves])
        noise = np.array([wave.sigma[first + channel] for wave in waves])
        noise = np.maximum(noise, WHITE * steps.step[channel])
        rounding = steps.rounding[channel]
        size = np.hypot([np.sqrt(wave.inverse[0, 0]) for wave in waves] * noise, rounding)
        good = np.isfinite(own) & (size > 0.0)
        if not bool(good.any()):
            continue
        along = abs(mounting.up[channel]) > 0.99
        slope_u = LEVER_G * (float(np.hypot(LEAN_RAD, mounting.u_rad)) if along else 1.0)
        design = np.column_stack((np.ones(int(good.sum())), square[good])) / size[good, None]
        normal = design.T @ design + np.diag([0.0, 1.0 / slope_u**2])
        inverse = np.linalg.inv(normal)
        value[channel] = (inverse @ (design.T @ (own[good] / size[good])))[0]
        # Records of one mounting stand at the same place of a step: that does not average out.
        u[channel] = max(float(np.sqrt(inverse[0, 0])), rounding)
    return value, u
