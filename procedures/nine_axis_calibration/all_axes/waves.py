"""Means, and waves round the turn, of every channel of a mounting; with the rate and without."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtrc

from procedures.estimation.channel import smallest_step
from procedures.estimation.turn_encoder import unwrap
from procedures.nine_axis_calibration.means import QUANTUM_PART, good_samples, interval_of
from procedures.nine_axis_calibration.turning import round_the_turn

from .channels import OUTLIER, Steps, steps_of
from .stands import Array, Mounted, OtherAxes

SURE = 1e-3
"""Noise seldom leaves more than this: then something else does."""
ROUNDS = 3
LEVER_G = 0.02
"""g per (rad/s)^2: an accelerometer 0.2 m from the axis, as the largest that is expected."""
LEAN_RAD = 1e-3
"""An input axis leans so much from the sensor's: along the axis a lever arm is felt by it, and by
what the mounting leans."""
WHITE = 12.0**-0.5
"""The standard deviation of rounding, in steps: that of a sample is no less."""
HALF = 0.5


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


@dataclass(frozen=True)
class Response:
    """The gyros' output per rate `gain` (3,) with u, and the records (r,) that it comes from.

    `rate_deg_per_s` (r,), `mean_deg_per_s` and `mean_u` (r, 3) of the three gyros.
    `nonlinearity` (3,) is the scatter of single rates' gains, over the gain, that noise does not
    explain; NaN where the records cannot show one.
    """

    gain: Array
    gain_u: Array
    rate_deg_per_s: Array
    mean_deg_per_s: Array
    mean_u: Array
    nonlinearity: Array


def swept(data: OtherAxes, what: str) -> tuple[Mapping[str, Sequence[Wave]], Steps]:
    """Return the waves of `FORCE` or `FIELD` by mounting, and the steps in all its records."""
    waves = {}
    for mounting in data.mountings:
        own = [getattr(record, what) for record in mounting.records]
        if all(samples is not None for samples in own):
            waves[mounting.name] = waves_of(mounting, own)
    records = data.records(what)
    residuals = [samples for _, turned, samples in records if not turned]
    residuals += [wave.residual for own in waves.values() for wave in own]
    return waves, steps_of([samples for _, _, samples in records], residuals)


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
                step = smallest_step(samples[good, channel])
                good = good_samples(steady, OUTLIER, QUANTUM_PART * step)
        rate = float(np.radians(encoder.mean_rate_deg_per_s))
        waves.append(Wave(rate, value, inverse, sigma, residual))
    return [wave for wave in waves if np.isfinite(wave.rate_rad_per_s)]


def at_rest(samples: Array, steps: Steps) -> tuple[Array, Array]:
    """Return mean and standard uncertainty of each channel (3,) of a stand at rest, NaN of none."""
    mean, u = np.full(3, np.nan), np.full(3, np.nan)
    for channel in range(3):
        step = float(steps.step[channel])
        good = good_samples(samples[:, channel], OUTLIER, QUANTUM_PART * step)
        values = samples[good, channel]
        if len(values) > 1:
            noise = max(float(values.std(ddof=1)), WHITE * step)
            size = float(np.hypot(noise / np.sqrt(len(values)), steps.rounding[channel]))
            # What never changes, in no record, has measured nothing.
            if size > 0.0:
                mean[channel], u[channel] = values.mean(), size
    return mean, u


def without_rate(mounting: Mounted, waves: Sequence[Wave], steps: Steps) -> tuple[Array, Array]:
    """Return what three channels read at no rate, and its u (3,), NaN of none.

    A lever arm feels the square of the rate: its slope is free, along the axis within a little.
    """
    square = np.array([wave.rate_rad_per_s**2 for wave in waves])
    value, u = np.full(3, np.nan), np.full(3, np.nan)
    for channel in range(3):
        own = np.array([wave.value[0, channel] for wave in waves])
        noise = np.array([wave.sigma[channel] for wave in waves])
        noise = np.maximum(noise, WHITE * steps.step[channel])
        rounding = steps.rounding[channel]
        size = np.hypot([np.sqrt(wave.inverse[0, 0]) for wave in waves] * noise, rounding)
        good = np.isfinite(own) & (size > 0.0)
        if not bool(good.any()):
            continue
        along = abs(mounting.up[channel]) > 0.99
        slope_u = LEVER_G * (float(np.hypot(LEAN_RAD, mounting.u_rad)) if along else 1.0)
        design = np.column_stack((np.ones(int(good.sum())), square[good])) / size[good, None]
        inverse = np.linalg.inv(design.T @ design + np.diag([0.0, 1.0 / slope_u**2]))
        value[channel] = (inverse @ (design.T @ (own[good] / size[good])))[0]
        # Records of one mounting stand at the same place of a step: that does not average out.
        u[channel] = max(float(np.sqrt(inverse[0, 0])), rounding)
    return value, u


def response_of(mounting: Mounted) -> Response | None:
    """Return the gyros' response; None where the mounting was not turned in both senses.

    What grows with the magnitude of the rate, an asymmetry, is free.
    """
    outputs = [record.turn.rate_deg_per_s for record in mounting.records]
    waves = waves_of(mounting, outputs)
    rate = np.degrees(np.array([wave.rate_rad_per_s for wave in waves]))
    if not (bool((rate > 0.0).any()) and bool((rate < 0.0).any())):
        return None
    steps = steps_of(outputs, [wave.residual for wave in waves])
    # What never changes has measured nothing of the turns.
    rounding = np.where(steps.step > 0.0, steps.rounding, np.nan)
    mean = np.array([wave.value[0] for wave in waves])
    noise = np.array([wave.sigma * np.sqrt(wave.inverse[0, 0]) for wave in waves])
    size = _alike(rate, np.hypot(noise, rounding))
    gain, u, bent = np.full(3, np.nan), np.full(3, np.nan), np.full(3, np.nan)
    free = len(np.unique(np.round(np.abs(rate), 1))) > 1
    columns = np.column_stack([rate, np.ones(len(rate)), *([np.abs(rate)] if free else [])])
    for gyro in range(3):
        good = np.isfinite(mean[:, gyro]) & (size[:, gyro] > 0.0)
        freedom = int(good.sum()) - columns.shape[1]
        if freedom < 0:
            continue
        design = columns[good] / size[good, gyro, None]
        inverse = np.linalg.pinv(design.T @ design)
        solved = inverse @ (design.T @ (mean[good, gyro] / size[good, gyro]))
        gain[gyro], u[gyro] = solved[0], np.sqrt(inverse[0, 0])
        if freedom:
            left = mean[good, gyro] - columns[good] @ solved
            explained = chdtrc(freedom, float(np.sum((left / size[good, gyro]) ** 2))) >= SURE
            relative = np.sum((left / (rate[good] * solved[0])) ** 2) / freedom
            bent[gyro] = 0.0 if explained else float(np.sqrt(relative))
    return Response(gain, u, rate, mean, size, bent)


def _alike(rate: Array, size: Array) -> Array:
    """Return u of means (r, 3), both senses of a rate alike.

    What a gyro's gain differs from rate to rate would not drop out between unlike weights.
    """
    pooled = size.copy()
    for magnitude in np.unique(np.round(np.abs(rate), 1)):
        own = np.round(np.abs(rate), 1) == magnitude
        pooled[own] = np.sqrt(np.mean(size[own] ** 2, axis=0))
    return pooled


def with_nonlinearity(responses: Sequence[Response | None]) -> list[Response | None]:
    """Return responses whose u hold by how much a gyro's gain differs from rate to rate.

    Mountings were turned at different rates; what the gyro along the table's axis showed at
    several of them holds for it in all mountings.
    """
    bent = np.zeros(3)
    for response in responses:
        if response is not None:
            along = np.abs(response.gain) > HALF
            bent = np.fmax(bent, np.where(along, response.nonlinearity, np.nan))
    return [
        response and replace(response, gain_u=np.hypot(response.gain_u, bent * response.gain))
        for response in responses
    ]
