"""The published rule: heading difference over 360 deg, a polynomial of the fourth order.

Source: fog-scale-factor-temperature document, step 3. Plain least squares on every turn of the
published sense; it knows no bias and leaves out no turn. Fitted in scaled temperature, which gives
the same polynomial as powers of the temperature without their loss of digits.
"""

from __future__ import annotations

import numpy as np

from procedures.estimation.orthogonal import solve_by_qr

from .axis_turns import AxisTurns
from .curve import Curve, chebyshev_columns
from .findings import PublishedFit


def published_fit(turns: AxisTurns, order: int) -> PublishedFit:
    """Return the published polynomial of one axis; its curve is None with too few turns."""
    forward = turns.sensing & (turns.commanded_deg > 0.0)
    if not bool(forward.any()):
        forward = turns.sensing
    rows = forward & np.isfinite(turns.error_deg) & np.isfinite(turns.temperature_degC)
    heat = turns.temperature_degC[rows]
    if len(np.unique(heat)) <= order:
        return PublishedFit(turns.axis, None)
    domain = (float(heat.min()), float(heat.max()))
    error_ppm = turns.data_ppm[rows] / turns.turns[rows]
    fit = solve_by_qr(chebyshev_columns(heat, domain, order), error_ppm)
    free = len(heat) - order - 1
    variance = fit.sum_of_squares / free if free > 0 else 0.0
    curve = Curve(
        domain,
        fit.coefficients,
        variance * fit.inverse_normal,
        float(free),
        np.zeros(order + 1),
    )
    return PublishedFit(turns.axis, curve)
