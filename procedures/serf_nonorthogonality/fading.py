"""Whether the tones fade alike from the first shot to the last."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
COLUMNS = 3


def fading_trend(omega: Array, decay: Array, decay_u: Array) -> tuple[float, float]:
    """Return by how much tones fade faster in the last shot than in the first, relative, and its u.

    Arguments (shots,) in rad/s and 1/s, in the order of the shots. Beside a relaxation and a
    broadening that goes with the square of the frequency, which all shots share; u is enlarged
    where they do not agree. (0, inf) with too few shots.
    """
    count = len(decay)
    if count <= COLUMNS:
        return 0.0, np.inf
    # The column of the order runs over one: its coefficient is the change from first to last.
    order = np.linspace(-0.5, 0.5, count)
    columns = np.column_stack([np.ones(count), (omega / np.max(omega)) ** 2, order])
    design, usual = columns / decay_u[:, None], float(np.median(decay))
    if np.linalg.matrix_rank(design) < COLUMNS or usual <= 0.0:
        return 0.0, np.inf
    inverse = np.linalg.inv(design.T @ design)
    solved = inverse @ (design.T @ (decay / decay_u))
    left = decay / decay_u - design @ solved
    scatter = max(1.0, float(left @ left) / (count - COLUMNS))
    return float(solved[-1]) / usual, float(np.sqrt(inverse[-1, -1] * scatter)) / usual
