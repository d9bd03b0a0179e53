"""What a recorder does to a channel: steps, limits, jumps, counted pulses.

A gyro that turns at a mean rate W gives W/q pulses a second, read every tau0. The rounding error
of the angle is a sawtooth of the phase W t / q; its harmonic h of amplitude q/(pi h) appears at
the frequency h W/q folded into the sampled band. Noise of the angle blurs it. Two places harm:
next to a driven line, and next to zero, where the error stands still and follows the signal.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from .linear import MAD_TO_SIGMA

Array = NDArray[np.float64]

JUMP_SIGMAS = 8.0
MANY = 5.0
"""Times as often as to the values beside it, and visits at least: a channel comes to a limit."""
HARMONICS = range(1, 5)
MIN_STRENGTH = 0.2
"""Of the first harmonic without noise. Monte Carlo at 23 to 23.5 pulses an interval: with 0.64 and
0.42 left of a harmonic that stands still the 95 % interval covers 92 % and 86 %, with 0.09 it
covers 95 %."""
STANDING_CYCLES, STANDING_WIDTH = 5.0, 0.1
"""A rounding error averages out that makes more turns in a record, or in this part of its width."""
NEAR_CYCLES, NEAR_WIDTH = 8.0, 0.25
"""The same for a rounding error next to a line: as far as the noise at the line is judged."""


def resolution(values: Array) -> float:
    """Return the least difference of two values (n,) of a channel, 0 where all are equal.

    Where most samples share theirs with another one only such values count: a few that were made up
    between a channel's steps make no finer steps.
    """
    levels, counts = np.unique(values, return_counts=True)
    if 2 * int(counts[counts > 1].sum()) > len(values) and int(np.sum(counts > 1)) > 1:
        levels = levels[counts > 1]
    steps = np.diff(levels)
    # What a unit's factor leaves of equal values is no step.
    steps = steps[steps > 1e-9 * float(np.max(np.abs(values), initial=0.0))]
    return float(steps.min()) if len(steps) else 0.0


def piled_up(
    values: Array, step: float, sigma: float, expected: Array | None = None
) -> tuple[float, float]:
    """Return the parts of the values (n,) at the outermost ones, and at one inside, if too many.

    `step` is the channel's, `sigma` what a model leaves of the values. Where that is more than two
    steps, the channel comes to a value too often if it does so five times, inside fifteen times,
    more than five times as often as to those next to it. With the model `expected` (n,), too many
    are also more than it and normal noise put there, beyond chance: ten at a limit, a twentieth of
    all at a value inside.
    """
    if step == 0.0:
        return 0.0, 0.0
    level = np.rint((values - np.min(values)) / step).astype(np.int64)
    levels, counts = np.unique(level, return_counts=True)
    top, mode = int(levels[-1]), int(levels[np.argmax(counts)])
    parts = {0: 0.0, mode: 0.0, top: 0.0}
    for part in parts:
        away = level - part
        count, often = int(np.sum(away == 0)), visits(away == 0)
        sides = 1 if part in (0, top) else 2
        beside = visits((away != 0) & (np.abs(away) <= 3)) / (3.0 * sides)
        many = sigma > 2.0 * step and often > MANY * beside + MANY * (1.0 if sides == 1 else 3.0)
        if expected is not None and sigma > 0.5 * step * sides and often > MANY:
            from_model = np.min(values) + part * step - expected
            upper = ndtr((from_model + 0.5 * step) / sigma) if part < top else 1.0
            lower = ndtr((from_model - 0.5 * step) / sigma) if part > 0 else 0.0
            chance = float(np.sum(upper - lower))
            slack = 10.0 if sides == 1 else 0.05 * len(values)
            many = many or count > chance + 6.0 * math.sqrt(chance) + slack
        parts[part] = count / len(values) if many else 0.0
    inside = parts[mode] if 0 < mode < top else 0.0
    return parts[0] + (parts[top] if top else 0.0), inside


def visits(here: NDArray[np.bool_]) -> int:
    """Return how often a channel comes to where it is `here` (n,)."""
    return int(here[0]) + int(np.sum(here[1:] & ~here[:-1]))


def largest_jump(residuals: Array, period: float, step: float) -> tuple[int, float] | None:
    """Return row and size of the largest jump of the mean, None where none stands out.

    The means of equal stretches, whole periods (in rows) of a line long, before and after each row
    are compared, and their difference with all others: noise of any colour and slow drift have none
    that stands out. The rounding of counts to a `step` makes four steps over a stretch at most.
    """
    width = round(math.ceil(max(len(residuals) // 40, 8) / period) * period)
    if len(residuals) < 8 * width:
        return None
    total = np.concatenate(([0.0], np.cumsum(residuals)))
    jumps = (total[2 * width :] - 2.0 * total[width:-width] + total[: -2 * width]) / width
    sigma = MAD_TO_SIGMA * float(np.median(np.abs(jumps - np.median(jumps))))
    row = int(np.argmax(np.abs(jumps)))
    if abs(jumps[row]) <= JUMP_SIGMAS * sigma + 4.0 * step / width or sigma == 0.0:
        return None
    return row + width, float(jumps[row])


@dataclass(frozen=True)
class Beat:
    """A harmonic of the rounding error where it does harm.

    `frequency_Hz` is where it appears, `line_Hz` the driven line there, None where it stands still;
    `amplitude_deg_per_h` what it adds to the output at the line or, standing still, may hide of it.
    """

    harmonic: int
    frequency_Hz: float
    line_Hz: float | None
    amplitude_deg_per_h: float


def folded_Hz(frequency_Hz: float, interval_s: float) -> float:
    """Return where a frequency appears in samples of an interval."""
    return abs(frequency_Hz - round(frequency_Hz * interval_s) / interval_s)


def strength(harmonic: int, pulse_arcsec: float, noise_arcsec: float) -> float:
    """Return what noise of the angle over one interval leaves of a harmonic, over the first."""
    blur = 2.0 * math.pi * harmonic * noise_arcsec / pulse_arcsec
    return math.exp(-0.5 * blur**2) / harmonic


def find_beat(
    rate_deg_per_h: float,
    pulse_arcsec: float,
    interval_s: float,
    walk_deg_per_sqrt_h: float,
    lines_Hz: Iterable[float],
    span_s: float,
) -> Beat | None:
    """Return the strongest harmonic of the rounding error that harms a line, None if there is none.

    `rate_deg_per_h` is the mean output (1 deg/h is 1 arcsec/s), `walk_deg_per_sqrt_h` the angle
    random walk without the rounding, `span_s` the length of the record.
    """
    noise_arcsec = 60.0 * walk_deg_per_sqrt_h * math.sqrt(interval_s)
    for harmonic in HARMONICS:
        left = strength(harmonic, pulse_arcsec, noise_arcsec)
        if left < MIN_STRENGTH:
            continue
        at_Hz = folded_Hz(harmonic * rate_deg_per_h / pulse_arcsec, interval_s)
        blur = 2.0 * math.pi * harmonic * noise_arcsec / pulse_arcsec
        width_Hz = blur**2 / (2.0 * math.pi * interval_s)
        for line_Hz in lines_Hz:
            step = 2.0 * math.sin(math.pi * line_Hz * interval_s) / interval_s
            amplitude = left * pulse_arcsec / math.pi * step
            if at_Hz < max(STANDING_CYCLES / span_s, STANDING_WIDTH * width_Hz):
                return Beat(harmonic, at_Hz, None, amplitude)
            if abs(at_Hz - line_Hz) < max(NEAR_CYCLES / span_s, NEAR_WIDTH * width_Hz):
                return Beat(harmonic, at_Hz, line_Hz, amplitude)
    return None
