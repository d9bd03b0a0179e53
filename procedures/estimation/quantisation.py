"""Counted pulses: where their rounding error beats with the sampling, and what it does at a line.

A gyro that turns at a mean rate W gives W/q pulses a second, read every tau0. The rounding error
of the angle is a sawtooth of the phase W t / q; its harmonic h of amplitude q/(pi h) appears at
the frequency h W/q folded into the sampled band. Noise of the angle blurs it. Two places harm:
next to a driven line, and next to zero, where the error stands still and follows the signal.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

HARMONICS = range(1, 5)
LEAST_STRENGTH = 0.2
"""Of the first harmonic without noise. Monte Carlo at 23 to 23.5 pulses an interval: with 0.64 and
0.42 left of a harmonic that stands still the 95 % interval covers 92 % and 86 %, with 0.09 it
covers 95 %."""
STANDING_CYCLES, STANDING_WIDTH = 5.0, 0.1
"""A rounding error averages out that makes more turns in a record, or in this part of its width."""
NEAR_CYCLES, NEAR_WIDTH = 8.0, 0.25
"""The same for a rounding error next to a line: as far as the noise at the line is judged."""


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
        if left < LEAST_STRENGTH:
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
