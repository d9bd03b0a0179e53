"""How many samples of a long record are averaged, and what that costs; known before it is made."""

from __future__ import annotations

import math

MOST_ROWS = 2**19
"""A record with no more samples than this is taken as it is: 14.5 h at 0.1 s."""
MOST_CYCLES = 0.1
"""Of the fastest line in an averaged interval: the mean then takes 1.6 % of the line away."""


def group_size(samples: int, interval_s: float, highest_Hz: float) -> int:
    """Return how many samples are averaged: 1 for a record that is short enough.

    Never so many that the fastest line would suffer: a record that is longer still has more rows.
    """
    if samples <= MOST_ROWS:
        return 1
    allowed = MOST_CYCLES / max(highest_Hz * interval_s, MOST_CYCLES / samples)
    return max(min(math.ceil(samples / MOST_ROWS), math.floor(allowed + 1e-9)), 1)


def averaged_rows(samples: int, interval_s: float, highest_Hz: float) -> int:
    """Return the rows that are left of a record."""
    return math.ceil(samples / group_size(samples, interval_s, highest_Hz))


def loss(group: int, interval_s: float, highest_Hz: float) -> float:
    """Return the relative growth of the standard uncertainty of a line by averaging."""
    return left(highest_Hz * interval_s) / left(highest_Hz * interval_s * group) - 1.0


def left(cycles: float) -> float:
    """Return the part of a line that a mean over so many of its cycles leaves."""
    return math.sin(math.pi * cycles) / (math.pi * cycles) if cycles else 1.0
