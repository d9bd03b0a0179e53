"""The error of an encoder's graduation, which comes back every turn and is no motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import chdtri

from procedures.estimation.turn_encoder import SMALLEST_WILD_DEG, Encoder

from .dataset import Array, TurnRecord

ORDERS = 2
BY_CHANCE = 1e-6
FEWEST_READINGS = 8
MOSTLY_ENCODER = 0.5
SURE = 4.0


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
