"""Output that is cut off: it stands at its largest value more often than by itself."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from procedures.common.frozen import IN_A_SHORT_RECORD

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

FEWEST_AT_LIMIT = 4
STUCK = 0.3
NEXT_LEVEL = 0.2


def stands_at_top(own: Array, slower: Sequence[Array]) -> bool:
    """Return whether output (n,) stands at its largest value as records of `slower` rates do not.

    NaN is no sample; records of slower rates that have none are not among them.
    """
    usual = float(np.median([_at_the_top(rate) for rate in slower])) if slower else 1.0
    share = _at_the_top(own)
    below = _at_the_top(own[np.abs(own) < np.nanmax(np.abs(own))]) * (1.0 - share)
    if below > NEXT_LEVEL * share:
        return False  # What is cut off has one level; coarse output has others as full beside it.
    enough = share * float(np.isfinite(own).sum()) >= IN_A_SHORT_RECORD
    return share > STUCK and enough and usual < 0.5 * STUCK


def _at_the_top(own: Array) -> float:
    """Return the share of samples that have the largest magnitude."""
    size = np.abs(own[np.isfinite(own)])
    return float(np.mean(size == size.max())) if len(size) else 0.0


def at_a_limit(output: Array) -> Mask:
    """Return which readings (n,) stand at one same limit of a meter or a device.

    Four and more that are the largest magnitude of one sign to the last digit, where readings are
    not so coarse that others repeat as often.
    """
    at_limit = np.zeros(len(output), dtype=bool)
    values, count = np.unique(output[np.isfinite(output)], return_counts=True)
    if len(values) < 3:
        return at_limit
    for end, others in ((0, count[1:]), (-1, count[:-1])):
        if count[end] >= FEWEST_AT_LIMIT and count[end] > 2 * int(others[1:-1].max(initial=1)):
            at_limit |= output == values[end]
    return at_limit
