"""Readings that repeat: an instrument that stands still, a buffer read twice, copied rows.

Equal readings measure nothing where noise, or what was commanded between them, makes each differ
from the one before. A coarse channel repeats by itself: each rule compares with how often that
happens. What a procedure does with such rows is its own; the flag is worded here.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from station.findings import Flag

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

IN_A_ROW = 10
"""Samples with noise never repeat so many in a row by chance, nor does a thermometer."""
IN_A_SHORT_RECORD = 5
AFTER_A_COMMAND = 3
"""The same of readings before each of which a field or an angle was commanded."""
TURNS_IN_A_ROW = 6
"""The same of attitudes and temperatures around turns."""
COPIED_ROWS = 5
"""The same of whole rows that stood before elsewhere."""
USUALLY_NEW = 0.5
"""Of the other readings: a channel of which fewer differ from the one before is coarse."""
CHANCE_OF_ROWS = 1e-6
CHANCE_OF_RECORD = 1e-7
"""That sound rows, or a sound record, count as frozen."""
MIN_ROWS = 12
_FACTOR = 6364136223846793005  # odd and large: windows of values get keys that all but never meet


def equal_runs(values: NDArray[Any]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return where each run of equal values (n,) or rows (n, k) begins, and how long it is.

    NaN equals nothing.
    """
    new = np.any(values[1:] != values[:-1], axis=tuple(range(1, values.ndim)))
    starts = np.flatnonzero(np.append(True, new))
    return starts, np.diff(np.append(starts, len(values)))


def no_chance(marked: Mask) -> bool:
    """Return whether so many marked rows, (n,), stand in a row as seldom do by chance."""
    starts, lengths = equal_runs(marked)
    longest = int(np.max(lengths[marked[starts]], initial=0))
    often = (int(marked.sum()) - longest + 1) / (len(marked) - longest + 2)
    return longest >= TURNS_IN_A_ROW and len(marked) * often**longest < CHANCE_OF_ROWS


def frozen(reading: Array, fewest: int = IN_A_ROW) -> Mask:
    """Return which readings (n,) are `fewest` and more of the same in a row.

    None where half of the others repeat themselves, too: such readings are coarse.
    """
    starts, lengths = equal_runs(reading)
    frozen = np.repeat(lengths >= fewest, lengths)
    others = np.isin(np.flatnonzero(~frozen), starts)
    return frozen if not len(others) or float(others.mean()) > USUALLY_NEW else frozen & False


def _chance_of_equal(values: Array, step: float) -> float:
    """Return how often a sample meets a value to one and a half steps, given those before it.

    It then scatters like the innovation of the noise.
    """
    from scipy.special import erf

    sigma = min(
        float(np.quantile(np.abs(np.diff(values, order)), 0.9)) / 1.645 / math.sqrt(power)
        for order, power in ((2, 6.0), (3, 20.0), (4, 70.0))
    )
    chance = float(erf(1.5 * step / (math.sqrt(2.0) * sigma))) if sigma > 0.0 else 0.0
    return max(chance, 1e-3)


def stuck_rows(values: Array, step: float) -> tuple[int, int] | None:
    """Return first and last row of the longest stretch that is a straight line to the last digit.

    None where noise and the channel's steps make such a stretch by themselves.
    """
    if len(values) < 4 * MIN_ROWS:
        return None
    chance = _chance_of_equal(values, step)
    if chance > 0.9:
        return None
    needed = math.log(CHANCE_OF_RECORD / len(values)) / math.log(chance)
    straight = np.abs(np.diff(values, 2)) <= 1.01 * step
    edges = np.flatnonzero(np.diff(np.concatenate(([0], straight.astype(np.int8), [0]))))
    if not len(edges):
        return None
    lengths = edges[1::2] - edges[::2]
    longest = int(np.argmax(lengths))
    if lengths[longest] < max(needed, MIN_ROWS):
        return None
    first = int(edges[2 * longest])
    return first, first + int(lengths[longest]) + 1


def repeated_rows(values: Array, step: float) -> tuple[int, int, int] | None:
    """Return two first rows and the length of the longest stretch that is there twice.

    None where noise and the channel's steps make such a stretch by themselves.
    """
    if len(values) < 4 * MIN_ROWS or step == 0.0:
        return None
    chance = _chance_of_equal(values, step)
    if chance > 0.9:
        return None
    width = math.ceil(math.log(CHANCE_OF_RECORD / len(values) ** 2) / math.log(chance))
    width = max(width, MIN_ROWS)
    if len(values) < 4 * width:
        return None
    level = np.rint((values - np.min(values)) / step).astype(np.uint64)
    key = np.zeros(len(values) - width + 1, dtype=np.uint64)
    for k in range(width):
        key = key * np.uint64(_FACTOR) + level[k : k + len(key)]
    _, first, back = np.unique(key, return_index=True, return_inverse=True)
    twice = np.flatnonzero(first[back] != np.arange(len(key)))
    if not len(twice):
        return None
    row = int(twice[0])
    return int(first[back[row]]), row, width - 1 + len(twice)


def repeated_windows(columns: Sequence[Array]) -> list[Mask]:
    """Return for each column (n,) which samples belong to ten in a row that were there before.

    Of a column of five to nine samples, to all of it.
    """
    masks = [np.zeros(len(column), dtype=bool) for column in columns]
    long = [n for n, column in enumerate(columns) if len(column) >= IN_A_SHORT_RECORD]
    if not long:
        return masks
    # Odd numbers: two windows of samples with the same sum of products are nearly always the same.
    hash_of = np.cumprod(np.full(IN_A_ROW, _FACTOR, dtype=np.uint64))
    hashes, finite, begins, widths = [], [], [], []
    ends = np.cumsum([len(columns[n]) for n in long])
    for n, end in zip(long, ends, strict=True):
        wide = min(IN_A_ROW, len(columns[n]))
        bits = np.ascontiguousarray(columns[n]).view(np.uint64)
        bits = bits ^ (bits >> np.uint64(29))  # single precision leaves the lower ones zero
        hashed = (sliding_window_view(bits, wide) * hash_of[:wide]).sum(axis=1)
        hashes.append(hashed)
        finite.append(sliding_window_view(np.isfinite(columns[n]), wide).all(axis=1))
        begins.append(end - len(columns[n]) + np.arange(len(hashed)))
        widths.append(np.full(len(hashed), wide))
    _, first, same = np.unique(np.concatenate(hashes), return_index=True, return_inverse=True)
    again = np.concatenate(finite)
    again[first] = False
    values, begin, width = map(np.concatenate, ([columns[n] for n in long], begins, widths))
    own, before = np.flatnonzero(again), first[same[again]]
    # Two sums may be alike by chance: the samples decide.
    for k in range(IN_A_ROW):
        alike = values[np.minimum(begin[own] + k, len(values) - 1)]
        alike = alike == values[np.minimum(begin[before] + k, len(values) - 1)]
        kept = (width[own] == width[before]) & (alike | (k >= width[own]))
        own, before = own[kept], before[kept]
    for start in begin[own].tolist():
        place = int(np.searchsorted(ends, start, side="right"))
        at = start - (int(ends[place - 1]) if place else 0)
        masks[long[place]][at : at + IN_A_ROW] = True
    return masks


def frozen_flag(
    reading: str,
    extent: str,
    source: str,
    then: str,
    details: Mapping[str, object],
    axis: str | None = None,
    though: str = "",
) -> Flag:
    """Return the flag of a reading that repeats, in an extent such as `7 rows`, and its source.

    `then` is what was done with these rows or is to be done, `though` such as ` though it turned`.
    """
    frozen_text = (
        f"{reading} repeats to the last digit in {extent}{though}: {source} or its recorder stood "
        f"still, or rows were copied or filled in. {then}"
    )
    return Flag("frozen", frozen_text, axis, details)
