"""The angles that a plan must have commanded, found in the readings of its encoder."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

FINEST = 720
NEAR_DEG = 0.02
NEAR_PART = 0.02
MOST_OFF = 0.1
LARGEST_OFFSET_DEG = 1.0


def commanded_angles(theta_deg: Array) -> Array:
    """Return the commanded angle of each reading (n,), in deg; NaN for one off the plan's grid.

    What a plan determines is judged on its commanded angles: an encoder that stops 0.3 arcsec
    beside each would make dependent columns look independent. Plans change the angle evenly, so the
    coarsest even division of the circle, from 0 deg, is taken whose marks lie within 0.02 deg (and
    a fiftieth of the division) of nine readings in ten. Where there is none, the same with the
    encoder's zero off by up to 1 deg; where there is none even so, the readings themselves stand.
    """
    for with_offset in (False, True):
        for parts in range(1, FINEST + 1):
            found = _on_marks(theta_deg, 360.0 / parts, with_offset)
            if found is not None:
                return found
    return theta_deg


def _on_marks(theta_deg: Array, step_deg: float, with_offset: bool) -> Array | None:
    """Return the marks of a division that the readings stand for, None where too few do."""
    turn = np.mod(theta_deg, 360.0)
    if with_offset:
        off = np.mod(turn + 0.5 * step_deg, step_deg) - 0.5 * step_deg
        offset = float(np.median(off))
        if abs(offset) > min(LARGEST_OFFSET_DEG, 0.25 * step_deg):
            return None
        turn = turn - offset
    mark = np.rint(turn / step_deg) * step_deg
    near = np.abs(turn - mark) <= min(NEAR_DEG, NEAR_PART * step_deg)
    if float(np.mean(near)) < 1.0 - MOST_OFF:
        return None
    return np.where(near, np.round(np.mod(mark, 360.0), 12), np.nan)
