"""What each set of turns says by itself: a scale-factor error, and how sure that is.

Turns of both senses, or a turn and a wait, tell the bias of their set from its scale factor, if
nothing came between them: over a gap the bias changes.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from .axis_turns import SAME_COMMAND_DEG, AxisTurns
from .dataset import Array, Index, Mask
from .turning import FULL_TURN_DEG


@dataclass(frozen=True)
class SetOfTurns:
    """Rows of one set, (k,), and its scale-factor error in ppm; `u` is in noises of a turn."""

    rows: Index
    error_ppm: float
    u: float
    bias_deg_per_h: float


def sets_that_tell_the_bias(turns: AxisTurns, rows: Mask, data_ppm: Array) -> Iterator[SetOfTurns]:
    """Yield the sets of these rows that tell their bias, which is taken off of `data_ppm` (n,).

    A set that was interrupted for longer than from one set to the next counts as several.
    """
    for own in _uninterrupted(turns, rows):
        scale = turns.turns[own]
        if float(np.ptp(scale)) * FULL_TURN_DEG > SAME_COMMAND_DEG:
            design = np.column_stack((scale, turns.by_bias_ppm[own]))
            inverse = np.linalg.inv(design.T @ design)
            found = inverse @ (design.T @ data_ppm[own])
            u = float(np.sqrt(inverse[0, 0]))
            yield SetOfTurns(own, float(found[0]), u, float(found[1]))


def _uninterrupted(turns: AxisTurns, rows: Mask) -> Iterator[Index]:
    """Yield the rows of each set, and of each part of an interrupted one, in the order of time."""
    for number in np.unique(turns.set_number[rows]):
        own = np.flatnonzero(rows & (turns.set_number == number))
        own = own[np.argsort(turns.middle_s[own], kind="stable")]
        gaps = np.diff(turns.middle_s[own]) > turns.set_interval_s
        yield from np.split(own, np.flatnonzero(gaps) + 1)


def noise_of_sets(
    turns: AxisTurns, rows: Mask, left_ppm: Array, columns: int
) -> tuple[float, float] | None:
    """Return the noise of a turn as the sets scatter about a curve, and its degrees of freedom.

    A table that wanders slowly has the same error at the end of a turn and at the beginning of the
    one back: it adds in their scale factor and cancels in their bias, so that residuals of single
    turns tell too little. None where no more sets are left than the curve has `columns`.
    """
    found = [one.error_ppm / one.u for one in sets_that_tell_the_bias(turns, rows, left_ppm)]
    free = len(found) - columns
    if free < 1:
        return None
    return float(np.sqrt(np.sum(np.square(found)) / free)), float(free)
