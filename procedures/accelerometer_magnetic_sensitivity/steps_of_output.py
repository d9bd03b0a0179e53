"""An output that steps: from which row on, and whether the data speak for it.

A step of the output has the same size at every angle and field, an encoder that jumps the size of
the slope. Both are tried, and the information criterion says which it was.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from procedures.estimation.linear import combine
from procedures.estimation.orthogonal import solve_by_qr

from .jump import Suspects, small_jumps
from .solved import Solved

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

PERHAPS = 4.0
"""Beyond so many standard deviations of the noise a step is tried."""


def steps_to_try(solved: Solved, still: Array, data: Array, suspects: Suspects) -> tuple[int, ...]:
    """Return the rows from which on the output may have stepped; none where nothing looks like it.

    `still` (rows, k) are the columns without slow terms: drift takes a step's place, so it is
    looked for with drift and without. All rows are looked at, and those that the solution keeps.
    """
    found = solved.solution
    if found.degrees_of_freedom < 2:
        return ()
    begins = np.arange(len(suspects.order) + len(suspects.begins)) < len(suspects.order)
    rows: list[int] = []
    for columns in (np.column_stack((still, solved.slow)), still)[: 1 + solved.slow.shape[1]]:
        for inside in (found.kept, np.ones(len(data), dtype=bool)):
            there = inside.astype(np.float64)
            design = columns * there[:, None]
            fit = solve_by_qr(columns[inside], data[inside])
            residual = (data - combine(columns, fit.coefficients)) * there
            enough, _ = suspects.kinds(inside)
            gains = small_jumps(suspects, design, there, residual)[0]
            gains = np.where(begins & enough, gains, 0.0)
            best = int(np.argmax(gains))
            left = max(fit.sum_of_squares - float(gains[best]), 0.0)
            free = max(int(inside.sum()) - columns.shape[1] - 1, 1)
            if float(gains[best]) > PERHAPS**2 * left / free and best not in rows:
                rows.append(best)
    return tuple(rows)
