"""A scale factor that drifts while the gyro is turned, seen by how the output runs within records.

From record to record a drift of K cannot be distinguished from a nonlinearity: the rates follow one
another. Within a record the output of a drifting K runs off in proportion to the rate, W K' t: in
opposite ways for the two senses of a rate, one after the other, where a bias that drifts or warms
up runs off alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc

from procedures.common.constants import SECONDS_PER_HOUR

from .dataset import Array
from .noise import Within
from .screening import Kept

RARE = 1e-4
"""Chance of noise alone below which a drift is solved for."""
TRIED = 2
"""One drift for all switch-ons, and one for each of them."""
FEWEST = 5


@dataclass(frozen=True)
class Runs:
    """How outputs run within records, less the mean of the same rate in both senses.

    `slope` and its `u` (r,) are in deg/h per h, u infinite for records that are too short; `rate`
    (r,) is what a drift of 1 per h makes of it. `chance` is that of noise making so much.
    """

    slope: Array
    rate: Array
    u: Array
    chance: float


def runs_of(records: Sequence[Kept], within: Within, interval_s: float) -> Runs:
    """Return how the output less K times the table's rate runs within the records."""
    amplitude = np.linalg.solve(within.normal, within.right)
    sample = within.squares[1] / interval_s + 2.0 * within.squares[0] / interval_s**2
    slope, u = np.zeros(len(records)), np.full(len(records), np.inf)
    for number, kept in enumerate(records):
        time_h = (kept.index - kept.index.mean()) * interval_s / SECONDS_PER_HOUR
        square = float(time_h @ time_h)
        if len(time_h) >= FEWEST and sample > 0.0:
            slope[number] = float(time_h @ (kept.residual - kept.waves @ amplitude)) / square
            u[number] = float(np.sqrt(sample / square))
    repeats = np.array([kept.record.repeat for kept in records])
    sizes = np.array([abs(kept.record.commanded_deg_per_s) for kept in records])
    rate = np.array([kept.table if kept.record.commanded_deg_per_s else 0.0 for kept in records])
    for repeat in np.unique(repeats):
        for size in np.unique(sizes):
            own = (repeats == repeat) & (sizes == size)
            weight = 1.0 / u[own] ** 2
            total = float(weight.sum())
            for values in (slope, rate):
                values[own] -= float(weight @ values[own]) / total if total > 0.0 else values[own]
    return Runs(slope, rate, u, _chance(repeats, slope / u, rate / u))


def _chance(repeats: Array, slope: Array, rate: Array) -> float:
    """Return how seldom noise makes runs, over their u, so much in proportion to the rates."""
    own = repeats == np.unique(repeats)[:, None]
    right, information = own @ (slope * rate), own @ rate**2
    if not bool((information > 0.0).all()):
        return 1.0
    shared = float(right.sum() ** 2 / information.sum())
    each = float(np.sum(right**2 / information))
    tried = TRIED if len(right) > 1 else 1
    return tried * min(float(chdtrc(1, shared)), float(chdtrc(len(right), each)))
