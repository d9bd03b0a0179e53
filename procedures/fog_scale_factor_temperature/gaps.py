"""Stretches of temperature without a turn: how far the curve may be off within them.

Between two ends a polynomial of the order that the turns ask for says one thing and one of a higher
order another; nothing in the data speaks for either. The next two orders, each as large as could
have been there unseen, are in the uncertainty. In a wide stretch that is no answer, and there is
none.
"""

from __future__ import annotations

import numpy as np

from procedures.estimation.linear import combine
from procedures.estimation.orthogonal import solve_by_qr

from .axis_problem import PUBLISHED_ORDER, AxisProblem, Solved
from .curve import CHECKED, chebyshev_columns
from .dataset import Array, Mask
from .wandering_bias import Walk

Gaps = tuple[tuple[float, float], ...]

UNSEEN = 2.5
"""Standard deviations of a coefficient that the information criterion leaves out."""
FURTHER_ORDERS = 2
WIDE = 2.0
"""Times the threshold of the flag: from such a width on no value is given within."""


def gaps_of(problem: AxisProblem, kept: Mask) -> Gaps:
    """Return the stretches without a turn that are wider than the threshold, from and until."""
    heat = np.sort(problem.turns.temperature_degC[kept & problem.turns.sensing])
    wide = np.flatnonzero(np.diff(heat) > problem.settings.temperature_gap_degC)
    return tuple((float(heat[n]), float(heat[n + 1])) for n in wide)


def within(gaps: Gaps, temperature_degC: float, wider_than: float) -> bool:
    """Whether a temperature lies in a stretch wider than that."""
    return any(a < temperature_degC < b and b - a > wider_than for a, b in gaps)


def unseen_orders_ppm(problem: AxisProblem, kept: Mask, solved: Solved, noise: float) -> Array:
    """Return how far the published order is from a lower one, beyond chance, at `CHECKED` places.

    The information criterion leaves out what noise may have made; much noise hides much of a
    curve, and that is no proof that it is not there.
    """
    if solved.order >= PUBLISHED_ORDER or problem.highest_order(kept) < PUBLISHED_ORDER:
        return np.zeros(CHECKED)
    whole = problem.fit_of_order(kept, solved.domain_degC, PUBLISHED_ORDER, solved.ratio)
    grid = np.linspace(*solved.domain_degC, CHECKED)
    apart, square = np.zeros(CHECKED), np.zeros(CHECKED)
    for one, sign in ((whole, 1.0), (solved, -1.0)):
        columns = chebyshev_columns(grid, solved.domain_degC, one.order)
        count = one.order + 1
        inverse = one.fit.inverse_normal[-count:, -count:]
        apart += sign * combine(columns, one.fit.coefficients[-count:])
        square += sign * noise**2 * np.einsum("ij,jk,ik->i", columns, inverse, columns)
    return np.asarray(np.sqrt(np.maximum(apart**2 - square, 0.0)))


def unknown_in_gaps_ppm(
    problem: AxisProblem, kept: Mask, solved: Solved, noise: float, gaps: Gaps
) -> Array:
    """Return what higher orders may add at the `CHECKED` temperatures; zero outside the gaps."""
    order = solved.order + FURTHER_ORDERS
    walk = Walk(problem.course.of(kept), solved.ratio)
    design, biases = problem.design(solved.domain_degC, order)
    white = walk.whiten(design[kept])
    grid = np.linspace(*solved.domain_degC, CHECKED)
    polynomials = chebyshev_columns(grid, solved.domain_degC, order)
    square = np.zeros(CHECKED)
    for place in range(biases + solved.order + 1, biases + order + 1):
        taken = solve_by_qr(white[:, :place], white[:, place])
        left = float(np.sqrt(taken.sum_of_squares))
        shape = polynomials[:, place - biases]
        shape = shape - combine(polynomials[:, : place - biases], taken.coefficients[biases:])
        square += (UNSEEN * noise / max(left, 1e-9) * shape) ** 2
    inside = np.zeros(CHECKED, dtype=bool)
    for low, high in gaps:
        inside |= (grid > low) & (grid < high)
    return np.where(inside, np.sqrt(square), 0.0)
