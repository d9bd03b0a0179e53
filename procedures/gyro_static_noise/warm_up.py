"""What is left of the warm-up in the means of the switch-ons, by how each record begins.

Each switch-on begins cold, so that the tail A exp(-t/T) is the same in all of them and does not
show in their spread. The first, long record ends without it; short ones hold it whole.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from procedures.estimation.rate_spectrum import coefficients, noise_variances

from .dataset import Array

TIME_CONSTANTS_S = (300.0, 600.0, 1200.0, 2400.0, 4800.0)
BY_CHANCE = 0.05
"""So seldom noise shows a tail that is taken for one."""


@dataclass(frozen=True)
class Unbroken:
    """A record (n,) without gaps, the time in s from the end of its warm-up to its start, and the
    columns (n, p) that it may have beside its mean."""

    rate: Array
    since_s: float
    columns: Array


def tail_in_mean(records: Sequence[Unbroken], interval_s: float, theta: Array) -> float:
    """Return by how much in deg/h a tail moves the mean of the records' means; 0 for none seen.

    `theta` (4,) are the squares of the noise. Of several time constants the likeliest counts.
    """
    best_gain, moved = float(chdtri(1, BY_CHANCE / len(TIME_CONSTANTS_S))), 0.0
    made_white = [_white(record, interval_s, theta) for record in records]
    for constant_s in TIME_CONSTANTS_S:
        normal, right, means = 0.0, 0.0, []
        for record, (sigma, data, beside) in zip(records, made_white, strict=True):
            time_s = record.since_s + (np.arange(len(record.rate)) + 0.5) * interval_s
            tail = np.exp(-time_s / constant_s)
            means.append(float(tail.mean()))
            own = coefficients(tail) / sigma
            own = own - beside @ (beside.T @ own)
            normal += float(own @ own)
            right += float(own @ data)
        gain = right**2 / normal if normal > 0.0 else 0.0
        if gain > best_gain:
            best_gain, moved = gain, right / normal * float(np.mean(means))
    return abs(moved)


def _white(record: Unbroken, interval_s: float, theta: Array) -> tuple[Array, Array, Array]:
    """Return the standard deviations of a record's coefficients (n - 1,), these coefficients over
    them, and an orthonormal basis (n - 1, p) of the columns beside."""
    sigma = np.sqrt(theta @ noise_variances(len(record.rate), interval_s))
    columns = coefficients(record.columns) / sigma[:, None]
    return sigma, coefficients(record.rate) / sigma, np.linalg.qr(columns)[0]
