"""Which turns of an axis are wild: knocked tables, navigators that jumped."""

from __future__ import annotations

import numpy as np

from procedures.estimation.orthogonal import keep_inliers, solve_by_qr

from .axis_problem import AxisProblem, Solved
from .dataset import Array, Mask
from .wandering_bias import Walk, deleted_residuals

START_BIAS_ORDER = 6
START_THRESHOLD = 1.6
"""Of the rejection's: the first look has no model of the bias's walk."""
START_ORDERS = (4, 9, 20)
WILD_SHARE = 0.05
ROUNDS = 25


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
        found = solve_by_qr(design[near], problem.data[near]).coefficients
        reach = START_THRESHOLD * problem.settings.outlier * problem.floor_ppm
        near |= kept & (np.abs(problem.data - design @ found) <= reach)
    return near


def reject(problem: AxisProblem) -> tuple[Mask, Solved | None]:
    """Return the rows that agree with what the others foretell, and their solution.

    From several first looks: a stiff one takes a feature of the curve for wild turns, a soft
    one a wild turn at the end of the range for the curve. The likeliest of their ends counts.
    """
    ends: dict[bytes, tuple[Mask, Solved | None]] = {}
    begun: set[bytes] = set()
    for order in START_ORDERS:
        kept = first_look(problem, order)
        if kept.tobytes() not in begun:
            begun.add(kept.tobytes())
            found = _settle(problem, kept)
            ends.setdefault(found[0].tobytes(), found)
    return min(ends.values(), key=lambda end: _surprise(problem, end))


def _surprise(problem: AxisProblem, end: tuple[Mask, Solved | None]) -> float:
    """Return minus twice the logarithm of the likelihood, wild turns and columns charged.

    A wild turn may lie anywhere within the span of the data, and is as seldom as `WILD_SHARE`.
    """
    kept, solved = end
    if solved is None:
        return float("inf")
    count = int(kept.sum())
    wild = int(problem.candidates.sum()) - count
    span = float(np.ptp(problem.data[problem.candidates])) or 1.0
    noise = max(solved.fit.noise, problem.floor_ppm, 1e-9 * span)
    walk = Walk(problem.course.of(kept), solved.ratio)
    told = count * (np.log(2.0 * np.pi * noise**2) + 1.0)
    told += walk.log_determinant
    told += (solved.order + 1) * np.log(count)
    return float(told + 2.0 * wild * np.log(span * (1.0 - WILD_SHARE) / WILD_SHARE))


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
                problem.course.of(problem.candidates),
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
