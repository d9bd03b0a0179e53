"""The angles that a plan must have commanded, found in the readings of its encoder."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

FINEST = 720
NEAR_DEG = 0.02
NEAR_PART = 0.02
MOST_OFF = 0.1


def commanded_angles(theta_deg: Array) -> Array:
    """Return the commanded angle of each reading (n,), in deg; NaN for one off the plan's grid.

    What a plan determines is judged on its commanded angles: an encoder that stops 0.3 arcsec
    beside each would make dependent columns look independent. Plans change the angle evenly, so the
    coarsest even division of the circle, from 0 deg, is taken whose marks lie within 0.02 deg (and
    a fiftieth of the division) of nine readings in ten. Where there is none, the readings
    themselves stand.
    """
    turn = np.mod(theta_deg, 360.0)
    for parts in range(1, FINEST + 1):
        step = 360.0 / parts
        mark = np.rint(turn / step) * step
        near = np.abs(turn - mark) <= min(NEAR_DEG, NEAR_PART * step)
        if float(np.mean(near)) >= 1.0 - MOST_OFF:
            return np.where(near, np.round(np.mod(mark, 360.0), 12), np.nan)
    return theta_deg
