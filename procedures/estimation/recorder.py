"""What a recorder does to a channel: steps of its values, limits, stretches that stand still."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.special import erf, ndtr

from .robust import MAD_TO_SIGMA

Array = NDArray[np.float64]

CHANCE = 1e-7
"""That a sound record is called stuck."""
LEAST_ROWS = 12
JUMP_SIGMAS = 8.0


def resolution(values: Array) -> float:
    """Return the least difference of two values (n,) of a channel, 0 where all are equal."""
    steps = np.diff(np.unique(values))
    # What a unit's factor leaves of equal values is no step.
    steps = steps[steps > 1e-9 * float(np.max(np.abs(values), initial=0.0))]
    return float(steps.min()) if len(steps) else 0.0


def part_at_limits(values: Array, expected: Array | None = None, sigma: float = 0.0) -> float:
    """Return the part of the values (n,) that stand at the highest or lowest one, if too many.

    Where the channel is fine, it comes to the limit too often if it does so five times more than
    five times as often as to the values next to it: a sine without noise does three times as often.
    With a model `expected` (n,) and the noise `sigma` about it, too many are also ten more than
    these put there, beyond chance.
    """
    step = resolution(values)
    if step == 0.0:
        return 0.0
    part = 0.0
    for side in (1.0, -1.0):
        below = np.rint((np.max(side * values) - side * values) / step)
        count, visits = int(np.sum(below == 0)), _visits(below == 0)
        beside = _visits((below >= 1) & (below <= 3)) / 3.0
        many = np.ptp(values) > 30.0 * step and visits > 5.0 * beside + 5.0
        if expected is not None and sigma > 0.5 * step and visits > 5:
            reach = np.max(side * values) - 0.5 * step - side * expected
            chance = float(np.sum(ndtr(-reach / sigma)))
            many = many or count > chance + 6.0 * math.sqrt(chance) + 10.0
        if many:
            part += count / len(values)
    return part


def _visits(here: NDArray[np.bool_]) -> int:
    return int(here[0]) + int(np.sum(here[1:] & ~here[:-1]))


def stuck_rows(values: Array) -> tuple[int, int] | None:
    """Return first and last row of the longest stretch that is a straight line to the last digit.

    None where noise and the channel's steps make such a stretch by themselves.
    """
    step = resolution(values)
    if len(values) < 4 * LEAST_ROWS:
        return None
    # Conditional on those before, a sample scatters like the innovation of the noise.
    sigma = min(
        float(np.quantile(np.abs(np.diff(values, order)), 0.9)) / 1.645 / math.sqrt(power)
        for order, power in ((2, 6.0), (3, 20.0), (4, 70.0))
    )
    chance = float(erf(1.5 * step / (math.sqrt(2.0) * sigma))) if sigma > 0.0 else 0.0
    if chance > 0.9:
        return None
    needed = math.log(CHANCE / len(values)) / math.log(max(chance, 1e-3))
    straight = np.abs(np.diff(values, 2)) <= 1.01 * step
    edges = np.flatnonzero(np.diff(np.concatenate(([0], straight.astype(np.int8), [0]))))
    if not len(edges):
        return None
    lengths = edges[1::2] - edges[::2]
    longest = int(np.argmax(lengths))
    if lengths[longest] < max(needed, LEAST_ROWS):
        return None
    first = int(edges[2 * longest])
    return first, first + int(lengths[longest]) + 1


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
