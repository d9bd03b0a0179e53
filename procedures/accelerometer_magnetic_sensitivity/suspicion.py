"""Whether an encoder that is off might explain what a solution left; to look costs a second."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from procedures.estimation.linear import combine
from procedures.estimation.orthogonal import choose_by_information, solve_by_qr

from .findings import AnalysisSettings
from .jump import Suspects, small_jumps
from .nuisances import FEWEST_LEFT, KO, KP
from .solved import PLACE, Solved

Array = NDArray[np.float64]

MANY_STRAYS = 0.1
"""So many wild rows are no accident."""
PERHAPS = 4.0
"""Beyond so many standard deviations of the noise a jump is looked for."""
HIGH_ORDER = 6
"""What such a polynomial follows may be a step."""
TILTED = 2e-3
"""Of Ki: so much of a misalignment that its square, 2 µV at 1 V/g, tells it from a jump between two
planes."""


def may_be_off(solved: Solved, data: Array, suspects: Suspects, settings: AnalysisSettings) -> bool:
    """Return whether a jump might explain what a solution without one left, or its drift."""
    found = solved.solution
    if found.degrees_of_freedom <= PLACE + FEWEST_LEFT:
        return False
    values = dict(zip(found.names, found.coefficients, strict=True))
    tilted = max(abs(values.get(name, 0.0)) for name in (KO, KP)) > TILTED * abs(values["Ki"])
    stiff = found.lag_one_correlation > settings.too_stiff_beyond(len(data))
    if tilted or stiff or float(np.mean(~found.kept)) >= MANY_STRAYS:
        return True
    # So that a few wild rows make no jump, each counts for no more than one at the threshold, and
    # for nothing where its angle is looked at by itself.
    most_V = settings.outlier * found.noise_V
    tamed = np.clip(found.residual_V, -most_V, most_V)
    gains = []
    for kind, residual in zip(
        suspects.kinds(found.kept), (tamed, found.kept * found.residual_V), strict=True
    ):
        every = small_jumps(suspects, solved.design, solved.slope, residual)[0]
        gains.append(float(np.max(every, where=kind, initial=0.0)))
    left = max(found.sum_of_squares - max(gains), 0.0) / (found.degrees_of_freedom - 1)
    if max(gains) >= PERHAPS**2 * left:
        return True
    if found.drift_order >= HIGH_ORDER:
        return True
    if not found.drift_order:
        return False
    fixed = solved.design[:, : solved.design.shape[1] - solved.slow.shape[1]]
    fit = solve_by_qr(fixed[found.kept], data[found.kept])
    residual = np.where(found.kept, data - combine(fixed, fit.coefficients), 0.0)
    gain = float(small_jumps(suspects, fixed, solved.slope, residual)[0].max())
    squares = (found.sum_of_squares, max(fit.sum_of_squares - gain, 0.0))
    prices = (found.price, found.price - solved.slow.shape[1] + 1)
    return choose_by_information(squares, prices, len(data)) == 1
