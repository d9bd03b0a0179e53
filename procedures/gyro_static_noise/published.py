"""The textbook: coefficients read off the slopes of the Allan deviation, and plain spreads.

Each slope's line is laid through the point of the curve whose own slope comes nearest to it, and
read at the averaging time where the coefficient stands (practice after IEEE Std 952).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from procedures.estimation.allan import AllanDeviation, allan_deviation, pooled_deviation
from station.findings import Published

from .dataset import PER_SQRT_H, SECONDS_PER_HOUR, Array
from .parameters import UNITS

METHOD = "allan-slopes"
READINGS = {
    "quantisation_noise": (-1.0, np.sqrt(3.0), 1.0),
    "angle_random_walk": (-0.5, 1.0, 1.0 / PER_SQRT_H),
    "bias_instability": (0.0, 1.0, 1.0 / np.sqrt(2.0 * np.log(2.0) / np.pi)),
    "rate_random_walk": (0.5, 3.0, PER_SQRT_H),
    "rate_ramp": (1.0, np.sqrt(2.0), SECONDS_PER_HOUR),
}
"""Slope, averaging time in s at which its line is read, and the factor to the result's unit."""
FEWEST_POINTS = 3


def curve_of(pieces: Sequence[Array], interval_s: float) -> AllanDeviation:
    """Return the overlapping Allan deviation of the records, pooled where they are equally long.

    Of records of different lengths it is that of the longest ones.
    """
    longest = max(len(piece) for piece in pieces)
    return pooled_deviation(
        [allan_deviation(piece, interval_s) for piece in pieces if len(piece) == longest]
    )


def published_values(axis: str, curve: AllanDeviation, means: Array) -> list[Published]:
    """Return what the rules give on the same data, None where they cannot run."""
    values = {name: _read(curve, *how) for name, how in READINGS.items()}
    values["allan_minimum"] = float(curve.deviation.min()) if len(curve.tau_s) else None
    values["bias_repeatability"] = float(np.std(means, ddof=1)) if len(means) > 1 else None
    methods = {"bias_repeatability": "standard-deviation"}
    return [
        Published(name, axis, values[name], UNITS[name], methods.get(name, METHOD))
        for name in UNITS
        if name in values
    ]


def _read(curve: AllanDeviation, slope: float, at_s: float, factor: float) -> float | None:
    if len(curve.tau_s) < FEWEST_POINTS or not bool(np.all(curve.deviation > 0.0)):
        return None
    tau, deviation = np.log(curve.tau_s), np.log(curve.deviation)
    own = np.diff(deviation) / np.diff(tau)
    nearest = int(np.argmin(np.abs(own - slope)))
    line = deviation[nearest] + slope * (np.log(at_s) - tau[nearest])
    return float(np.exp(line) * factor)
