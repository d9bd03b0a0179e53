"""What each set of turns says by itself: a scale-factor error, and how sure that is.

Turns of both senses, or a turn and a wait, tell the bias of their set from its scale factor.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from .axis_turns import SAME_COMMAND_DEG, AxisTurns
from .dataset import Array, Mask
from .turning import FULL_TURN_DEG


@dataclass(frozen=True)
class SetOfTurns:
    """The rows of a set, (n,), and its scale-factor error in ppm; `u` is in noises of a turn."""

    rows: Mask
    error_ppm: float
    u: float


def sets_that_tell_the_bias(turns: AxisTurns, rows: Mask, data_ppm: Array) -> Iterator[SetOfTurns]:
    """Yield the sets of these rows that tell their bias, which is taken off of `data_ppm` (n,)."""
    for number in np.unique(turns.set_number[rows]):
        own = rows & (turns.set_number == number)
        scale = turns.turns[own]
        if float(np.ptp(scale)) * FULL_TURN_DEG > SAME_COMMAND_DEG:
            design = np.column_stack((scale, turns.by_bias_ppm[own]))
            inverse = np.linalg.inv(design.T @ design)
            found = inverse @ (design.T @ data_ppm[own])
            yield SetOfTurns(own, float(found[0]), float(np.sqrt(inverse[0, 0])))


def noise_of_sets(
    turns: AxisTurns, rows: Mask, left_ppm: Array, columns: int
) -> tuple[float, float] | None:
    """Return the noise of a turn as the sets scatter about a curve, and its degrees of freedom.

    A table that wanders slowly has the same error at the end of a turn and at the beginning of the
    one back: it adds in their scale factor and cancels in their bias, so that residuals of single
    turns tell too little. A set that was interrupted for longer than from one set to the next is no
    measure of noise, as its bias changed. None where no more sets are left than the curve has
    `columns`.
    """
    found = [
        one.error_ppm / one.u
        for one in sets_that_tell_the_bias(turns, rows, left_ppm)
        if float(np.ptp(turns.middle_s[one.rows])) < turns.set_interval_s
    ]
    free = len(found) - columns
    if free < 1:
        return None
    return float(np.sqrt(np.sum(np.square(found)) / free)), float(free)
