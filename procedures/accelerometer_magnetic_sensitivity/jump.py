"""An encoder that is off, from a row on or at one angle: in which rows, and by what angle.

To look costs a second, so `may_be_off` asks first whether it might explain what a solution left.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from procedures.estimation.alternatives import SEARCHED
from procedures.estimation.linear import combine, cross_products
from procedures.estimation.orthogonal import (
    choose_by_information,
    orthogonal_part,
    project,
    solve_by_qr,
    thin_qr,
)

from .model import Names
from .nuisances import FEWEST_LEFT, KO, KP
from .parameters import AnalysisSettings
from .solved import Jump, Solved

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
FEWEST_ROWS = 2
"""One row that is off is left out as a wild one."""
LARGEST_DEG, STEP_DEG = 12.0, 1.0
"""How far a jump is looked for, and how finely at first."""
FINER_DEG = (0.1, 0.005)
"""The square of the last is 0.004 µV at 1 V/g: from there on the solution finds the angle."""
MAX_POLISHED = 4
SAME_ANGLE_DEG = 0.05
TOLD_PART = 1e-6
"""A jump whose column has less of its own cannot be distinguished from the coefficients."""
RIDGE = 1e-12
"""Of each column's squares: a decomposition of none left fails otherwise."""
MANY_STRAYS = 0.1
"""So many wild rows are no accident."""
PERHAPS = 4.0
"""Beyond so many standard deviations of the noise a jump is looked for."""
HIGH_ORDER = 6
"""What such a polynomial follows may be a step."""
TILTED = 2e-3
"""Of Ki: so much of a misalignment that its square, 2 µV at 1 V/g, tells it from a jump between two
planes."""


@dataclass(frozen=True)
class Suspects:
    """Rows that may be off together: from each row on, and at each angle of each plane.

    `order` (rows,) sorts the rows by angle, each of which begins at one of `begins` in that order.
    """

    order: NDArray[np.int64]
    begins: NDArray[np.int64]

    @classmethod
    def of(cls, plane: Names, theta_rad: Array) -> Suspects:
        """Number the angles at which rows stand."""
        turn_deg = np.mod(np.degrees(theta_rad) + 1.0, 360.0)
        order = np.lexsort((turn_deg, plane))
        other = np.diff(turn_deg[order], prepend=turn_deg[order[:1]]) > SAME_ANGLE_DEG
        other[1:] |= plane[order][1:] != plane[order][:-1]
        other[0] = True
        return cls(order, np.flatnonzero(other))

    def sums(self, values: Array) -> Array:
        """Return the sums of values (rows, ...) over the rows of each suspect."""
        later = np.cumsum(values[::-1], axis=0)[::-1]
        return np.concatenate((later, np.add.reduceat(values[self.order], self.begins, axis=0)))

    def rows(self, suspect: int) -> Mask:
        """Return the rows (rows,) of a suspect."""
        count = len(self.order)
        if suspect < count:
            return np.asarray(np.arange(count) >= suspect)
        at_angle = np.zeros(count, dtype=bool)
        at_angle[np.split(self.order, self.begins[1:])[suspect - count]] = True
        return at_angle

    def kinds(self, inside: Mask) -> tuple[Mask, Mask]:
        """Return which suspects begin at a row and which are an angle, where rows are `inside`."""
        sizes = self.sums(inside.astype(np.float64))
        enough = (sizes >= FEWEST_ROWS) & (sizes <= sizes[0] - FEWEST_ROWS)
        begins = np.arange(len(sizes)) < len(self.order)
        return np.asarray(enough & begins), np.asarray(enough & ~begins)


def small_jumps(
    suspects: Suspects, design: Array, slope: Array, residual: Array
) -> tuple[Array, Array]:
    """Return by how much the squares fall with each suspect off by a small angle, and the angles.

    `design` (rows, k) are the columns of the solution, `slope` (rows,) the derivative of the output
    by the angle, `residual` (rows,) what the solution left.
    """
    q = thin_qr(design)[0]
    left = orthogonal_part(q, residual)
    shared = suspects.sums(q * slope[:, None])
    along = suspects.sums(slope * left) - shared @ project(q, left)
    whole = suspects.sums(slope**2)
    own = whole - np.einsum("ij,ij->i", shared, shared)
    known = np.logical_or(*suspects.kinds(np.ones(len(slope), dtype=bool)))
    usable = known & (own > TOLD_PART * whole)
    angle_rad = np.where(usable, along, 0.0) / np.where(usable, own, 1.0)
    return angle_rad * along, angle_rad


def find_jumps(
    suspects: Suspects,
    columns_at: Callable[[Array], Array],
    slope: Array,
    data: Array,
    inside: Mask,
) -> list[Jump]:
    """Return the jump from a row on and the one at an angle that leave the smallest squares.

    `columns_at` gives the columns (rows, k) for what is added to the encoder's angle in each row,
    (rows,) in rad. A small jump is found by the derivative; one of a degree bends every column, so
    all suspects are tried at angles near enough to each other for a parabola between them. The best
    of both are then tried by themselves. Only rows `inside` count.
    """
    still = columns_at(np.zeros(len(data))) * inside[:, None]
    counted = data * inside
    residual = counted - combine(still, solve_by_qr(still, counted).coefficients)
    gain, small_rad = small_jumps(suspects, still, slope * inside, residual)
    tried = np.radians(np.arange(-LARGEST_DEG, LARGEST_DEG + 0.5 * STEP_DEG, STEP_DEG))
    lowest, large_rad = _parabolas(tried, _table(suspects, columns_at, data, inside, tried))
    jumps = []
    for kind in suspects.kinds(inside):
        polished = []
        for order, angle_rad in ((-gain, small_rad), (lowest, large_rad)):
            best = np.argsort(np.where(kind, order, np.inf))
            for suspect in best[: min(MAX_POLISHED, int(kind.sum()))]:
                rows = suspects.rows(int(suspect))

                def squares(added_rad: float, rows: Mask = rows) -> float:
                    columns = columns_at(np.where(rows, added_rad, 0.0))[inside]
                    return solve_by_qr(columns, data[inside]).sum_of_squares

                polished.append((*_polish(squares, float(angle_rad[suspect])), int(suspect)))
        if polished:
            _, best_rad, suspect = min(polished)
            jumps.append(Jump(suspects.rows(suspect), best_rad))
    return jumps


def _table(
    suspects: Suspects,
    columns_at: Callable[[Array], Array],
    data: Array,
    inside: Mask,
    tried_rad: Array,
) -> Array:
    """Return the squares (angles, suspects) that are left with each suspect off by each angle."""
    nowhere = np.zeros(len(data))
    still = columns_at(nowhere)
    fitted = solve_by_qr(still[inside], data[inside]).coefficients
    scale = np.sqrt(np.einsum("ij,ij->j", still, still))
    size = float(np.linalg.norm((data - combine(still, fitted))[inside])) or 1.0

    def scaled(added_rad: Array) -> Array:
        columns = columns_at(added_rad)
        left = (data - combine(columns, fitted)) / size
        return np.column_stack((columns / scale, left)) * inside[:, None]

    first = scaled(nowhere)
    places = np.arange(first.shape[1])
    squares = []
    for angle_rad in tried_rad:
        second = scaled(nowhere + angle_rad)
        change = second[:, :, None] * second[:, None, :] - first[:, :, None] * first[:, None, :]
        products = cross_products(first) + suspects.sums(change)
        products[:, places, places] += RIDGE
        squares.append(np.linalg.cholesky(products)[:, -1, -1] ** 2)
    return np.asarray(squares)


def _parabolas(angles_rad: Array, table: Array) -> tuple[Array, Array]:
    """Return the lowest of the parabolas through a table (angles, suspects), and at which angle."""
    middle = np.clip(np.argmin(table, axis=0), 1, len(angles_rad) - 2)
    every = np.arange(table.shape[1])
    before, here, after = (table[middle + step, every] for step in (-1, 0, 1))
    with np.errstate(invalid="ignore"):
        bend = np.maximum(before - 2.0 * here + after, 1e-300)
        way = np.clip(0.5 * (before - after) / bend, -1.0, 1.0)
        lowest = here + way * 0.5 * (after - before) + 0.5 * way**2 * bend
    step_rad = float(angles_rad[1] - angles_rad[0])
    return np.nan_to_num(lowest, nan=np.inf), angles_rad[middle] + way * step_rad


def _polish(squares: Callable[[float], float], angle_rad: float) -> tuple[float, float]:
    """Return the smallest squares near an angle, and the angle."""
    for step_deg in FINER_DEG:
        near = angle_rad + np.radians(step_deg) * np.array([-1.0, 0.0, 1.0])
        lowest, at = _parabolas(near, np.array([[squares(float(tried_rad))] for tried_rad in near]))
        angle_rad = float(at[0])
    return float(lowest[0]), angle_rad


def may_be_off(solved: Solved, data: Array, suspects: Suspects, settings: AnalysisSettings) -> bool:
    """Return whether a jump might explain what a solution without one left, or its drift."""
    solution = solved.solution
    if solution.degrees_of_freedom <= SEARCHED + FEWEST_LEFT:
        return False
    values = dict(zip(solution.names, solution.coefficients, strict=True))
    tilted = max(abs(values.get(name, 0.0)) for name in (KO, KP)) > TILTED * abs(values["Ki"])
    stiff = solution.lag_one_correlation > settings.too_stiff_beyond(len(data))
    if tilted or stiff or float(np.mean(~solution.kept)) >= MANY_STRAYS:
        return True
    # So that a few wild rows make no jump, each counts for no more than one at the threshold, and
    # for nothing where its angle is looked at by itself.
    most_V = settings.outlier * solution.noise_V
    tamed = np.clip(solution.residual_V, -most_V, most_V)
    gains = []
    for kind, residual in zip(
        suspects.kinds(solution.kept), (tamed, solution.kept * solution.residual_V), strict=True
    ):
        every = small_jumps(suspects, solved.design, solved.slope, residual)[0]
        gains.append(float(np.max(every, where=kind, initial=0.0)))
    left = max(solution.sum_of_squares - max(gains), 0.0) / (solution.degrees_of_freedom - 1)
    if max(gains) >= PERHAPS**2 * left:
        return True
    if solution.drift_order >= HIGH_ORDER:
        return True
    if not solution.drift_order:
        return False
    fixed = solved.design[:, : solved.design.shape[1] - solved.slow.shape[1]]
    fit = solve_by_qr(fixed[solution.kept], data[solution.kept])
    residual = np.where(solution.kept, data - combine(fixed, fit.coefficients), 0.0)
    gain = float(small_jumps(suspects, fixed, solved.slope, residual)[0].max())
    squares = (solution.sum_of_squares, max(fit.sum_of_squares - gain, 0.0))
    prices = (solution.price, solution.price - solved.slow.shape[1] + 1)
    return choose_by_information(squares, prices, len(data)) == 1
