"""Which turns of an axis are wild, and how sure that is.

A stiff first look takes a feature of the curve for wild turns, a soft one a wild turn at the end of
the range for the curve. So several compete, and the likeliest of their ends counts; where another
is nearly as likely, what it makes of the curve is in the uncertainty.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from procedures.estimation.linear import combine
from procedures.estimation.orthogonal import CHARGE, keep_inliers, solve_by_qr

from .axis_problem import AxisProblem, Solved, Walk, deleted_residuals
from .curve import CHECKED, chebyshev_columns
from .dataset import Array, Index, Mask

START_BIAS_ORDER = 6
START_THRESHOLD = 1.6
"""Of the rejection's: the first look has no model of the bias's walk."""
START_ORDERS = (4, 9, 20)
WILD_SHARE = 0.05
ROUNDS = 25


@dataclass(frozen=True)
class End:
    """The rows that a look ends with, (rows,), their solution, and how much they surprise."""

    kept: Mask
    solved: Solved | None
    surprise: float


def first_look(problem: AxisProblem, order: int) -> Mask:
    """Return the rows that a look by least magnitudes, of this order, does not throw out."""
    kept: Mask = problem.candidates.copy()
    highest = problem.highest_order(kept)
    if highest < 0:
        return kept
    order = min(order, highest, max(int(kept.sum()) // 5, 1))
    design, _ = problem.design(problem.domain(kept), order, START_BIAS_ORDER)
    inside = keep_inliers(
        design[kept], problem.data[kept], START_THRESHOLD * problem.settings.outlier
    )
    near = np.zeros(len(kept), dtype=bool)
    near[np.flatnonzero(kept)] = inside
    # Quantised data may have a robust deviation of nothing: never reject within the floor.
    if problem.floor_ppm > 0.0:
        solved = solve_by_qr(design[near], problem.data[near]).coefficients
        reach = START_THRESHOLD * problem.settings.outlier * problem.floor_ppm
        near |= kept & (np.abs(problem.data - design @ solved) <= reach)
    return near


def reject(problem: AxisProblem) -> list[End]:
    """Return the choices of rows that agree with what the others foretell, the likeliest first.

    From first looks of several orders, and the likeliest of their ends without a turn of the
    coldest or the warmest set, where another order is chosen without it: there a curve of high
    order follows one wild turn, and no neighbour denies it.
    """
    ends: dict[bytes, End] = {}
    begun: set[bytes] = set()

    def end(kept: Mask, solved: Solved | None) -> None:
        if kept.tobytes() not in ends:
            ends[kept.tobytes()] = End(kept, solved, _surprise(problem, kept, solved))

    def begin(kept: Mask) -> None:
        if kept.tobytes() not in begun:
            begun.add(kept.tobytes())
            end(*_settle(problem, kept))

    for order in START_ORDERS:
        begin(first_look(problem, order))
    best = min(ends.values(), key=lambda end: end.surprise)
    if best.solved is not None:
        for row in _outermost(problem, best.kept):
            without = best.kept.copy()
            without[row] = False
            if problem.order_of(without, best.solved) != best.solved.order:
                end(without, problem.solve(without))
    return sorted(ends.values(), key=lambda end: end.surprise)


def _outermost(problem: AxisProblem, kept: Mask) -> Index:
    """Return the rows of the coldest and of the warmest set."""
    turns = problem.turns
    own = np.flatnonzero(kept & turns.sensing)
    heat = turns.temperature_degC[own]
    ends = turns.set_number[own[[int(np.argmin(heat)), int(np.argmax(heat))]]]
    return np.flatnonzero(kept & np.isin(turns.set_number, ends))


def other_ends_ppm(ends: list[End]) -> Array:
    """Return how far the curves of other ends are from the likeliest's, at `CHECKED` places, rms.

    Each counts by its likelihood.
    """
    first = ends[0].solved
    if first is None:
        return np.zeros(CHECKED)
    grid = np.linspace(*first.domain_degC, CHECKED)
    curves, weights = [], []
    for end in ends:
        if end.solved is not None:
            order = end.solved.order
            columns = chebyshev_columns(grid, end.solved.domain_degC, order)
            curves.append(combine(columns, end.solved.fit.coefficients[-order - 1 :]))
            weights.append(np.exp(-0.5 * (end.surprise - ends[0].surprise)))
    weight = np.array(weights) / np.sum(weights)
    apart = np.array(curves) - curves[0]
    return np.asarray(np.sqrt(np.einsum("m,mn->n", weight, apart**2)))


def _surprise(problem: AxisProblem, kept: Mask, solved: Solved | None) -> float:
    """Return minus twice the logarithm of the likelihood, wild turns and columns charged.

    A wild turn may lie anywhere within the span of the data, and is as seldom as `WILD_SHARE`.
    """
    if solved is None:
        return float("inf")
    count = int(kept.sum())
    wild = int(problem.candidates.sum()) - count
    span = float(np.ptp(problem.data[problem.candidates])) or 1.0
    noise = max(solved.fit.noise, problem.floor_ppm, 1e-9 * span)
    walk = Walk(problem.turn_times.of(kept), solved.ratio)
    surprise = count * (np.log(2.0 * np.pi * noise**2) + 1.0)
    surprise += walk.log_determinant
    surprise += CHARGE * (solved.order + 1) * np.log(count)
    return float(surprise + 2.0 * wild * np.log(span * (1.0 - WILD_SHARE) / WILD_SHARE))


def _settle(problem: AxisProblem, kept: Mask) -> tuple[Mask, Solved | None]:
    """Return the rows that stay when wild ones are left out and good ones taken back.

    One row of a set is taken or given back at a time: of a pair the good turn looks as wrong as
    the bad one until one of them is gone.
    """
    solved = problem.solve(kept)
    seen = {kept.tobytes()}
    for _ in range(ROUNDS):
        if solved is None:
            break
        design, _ = problem.design(solved.domain_degC, solved.order)
        far = np.abs(
            deleted_residuals(
                design[problem.candidates],
                problem.data[problem.candidates],
                problem.turn_times.of(problem.candidates),
                solved.ratio,
                kept[problem.candidates],
            )
        )
        size = np.zeros(len(kept))
        size[problem.candidates] = far
        sigma = max(solved.fit.noise, problem.floor_ppm)
        changed = _changed(problem, kept, size, problem.settings.outlier * sigma)
        if changed.tobytes() in seen or problem.highest_order(changed) < 0:
            break
        again = problem.solve(changed)
        if again is None:
            break
        seen.add(changed.tobytes())
        kept, solved = changed, again
    return kept, solved


def _changed(problem: AxisProblem, kept: Mask, size: Array, threshold: float) -> Mask:
    changed = kept.copy()
    far = kept & (size > threshold)
    back = problem.candidates & ~kept & (size <= threshold)
    for number in np.unique(problem.turns.set_number[far | back]):
        own = problem.turns.set_number == number
        if bool((own & far).any()):
            changed[np.flatnonzero(own & far)[np.argmax(size[own & far])]] = False
        else:
            changed[np.flatnonzero(own & back)[np.argmin(size[own & back])]] = True
    return changed
