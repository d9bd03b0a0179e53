"""Values as a line of small columns."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

ASIDE = 50


def sparkline(values: Sequence[float], width: int, levels: str) -> str:
    """Return values in the order of time in at most `width` characters.

    The first of `levels` stands for the least value and the last for the greatest, a fiftieth of
    either left aside: one glitch flattens no line. Where there are more values than characters,
    each stands for the mean of its share.
    """
    count = min(width, len(values))
    bounds = [len(values) * n // count for n in range(count + 1)] if count else []
    means = [sum(values[begin:end]) / (end - begin) for begin, end in pairwise(bounds)]
    usual = sorted(means)[len(means) // ASIDE : len(means) - len(means) // ASIDE]
    low, high = min(usual, default=0.0), max(usual, default=0.0)
    if high <= low:
        low, high = min(means, default=0.0), max(means, default=0.0)
    if high <= low:
        return levels[len(levels) // 2] * len(means)
    scale = (len(levels) - 1) / (high - low)
    return "".join(levels[round((min(max(mean, low), high) - low) * scale)] for mean in means)
