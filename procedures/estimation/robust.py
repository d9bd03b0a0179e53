"""Outlier rejection that survives wild values and quantised data."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .columns import Columns
from .linear import least_squares

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MAD_TO_SIGMA = 1.4826


def robust_sigma(residuals: Array, floor: float = 0.0) -> float:
    """Return 1.4826 times the median absolute deviation, at least `floor`.

    On quantised data more than half of the residuals may be equal and the deviation is then zero:
    the floor (0.6 of one quantum) keeps honest samples from being thrown out.
    """
    deviation = np.median(np.abs(residuals - np.median(residuals)))
    return max(MAD_TO_SIGMA * float(deviation), floor)


def reject_outliers(
    design: Array | Columns,
    data: Array,
    threshold: float,
    floor: float = 0.0,
    slack: float = 0.0,
    rounds: int = 20,
) -> Mask:
    """Return which samples of `data` are within `threshold` robust sigmas and `slack` of the fit.

    Fit, reject, fit again without the rejected, until nothing changes. A rejected sample comes back
    when the better fit explains it. Stops early rather than leave fewer samples than the model
    needs. Quantised data have a slack of one quantum: rounding moves an honest sample that far, and
    the median deviation does not see it.
    """
    whole = Columns.of(design) if isinstance(design, np.ndarray) else design
    kept = np.ones(len(data), dtype=bool)
    columns = whole.width
    for _ in range(rounds):
        samples = int(kept.sum())
        everything = samples == len(data)
        fit = least_squares(whole if everything else whole.where(kept), data[kept])
        residuals = fit.residuals if everything else data - whole.times(fit.coefficients)
        # The fit has taken some of the scatter away: give it back before judging.
        widen = np.sqrt(samples / max(samples - columns, 1))
        inner = fit.residuals * widen
        sigma = robust_sigma(inner, floor)
        fresh = np.abs(residuals) <= threshold * sigma + slack if sigma > 0.0 else kept
        if int(fresh.sum()) < columns + 3 or bool(np.array_equal(fresh, kept)):
            break
        kept = fresh
    return kept
