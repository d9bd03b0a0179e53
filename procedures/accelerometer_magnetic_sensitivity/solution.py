"""The full-data weighted solution: coefficients and nuisance terms together, wild rows rejected."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, stdtrit

from procedures.estimation.linear import combine
from procedures.estimation.orthogonal import (
    OrthogonalFit,
    keep_inliers,
    solve_by_qr,
)

from .findings import AnalysisSettings
from .jump import jump_begin, jump_place
from .nuisances import (
    ARCSEC_PER_RAD,
    JUMP,
    OFFSET,
    chosen,
    separable,
    slow_terms,
)
from .rows import Rows
from .turned_model import ROUNDS, TurnedModel

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

SETTLED_RAD = 1e-10
FEWEST_OF_A_GROUP = 20
ENOUGH_LEFT = 12
MANY_STRAYS = 0.1
"""So many wild rows are no accident."""
PERHAPS, SURELY = 4.0, 6.0
"""Beyond so many standard deviations of the noise a jump is tried, and believed."""
QUIETER = 0.7
ANGLES = (OFFSET, JUMP)


@dataclass(frozen=True)
class Solution:
    """Coefficients of the kept columns first, then nuisance terms, `names` in that order.

    Offset and jump of the encoder are in arcsec; `jump_row` is the row from which it is off.
    `kept` (rows,) are the rows that count; `covariance` holds the scale of the noise.
    """

    names: tuple[str, ...]
    coefficients: Array
    covariance: Array
    kept: Mask
    residual_V: Array
    degrees_of_freedom: int
    noise_V: float
    condition: float
    not_separable: tuple[str, ...]
    jump_row: int | None

    @property
    def sum_of_squares(self) -> float:
        """The weighted squares that the solution left, in V²."""
        return self.degrees_of_freedom * self.noise_V**2

    @property
    def lag_one_correlation(self) -> float:
        """The correlation of neighbouring residuals of the rows that count."""
        left = self.residual_V[self.kept]
        square = float(left @ left)
        return float(left[1:] @ left[:-1]) / square if square > 0.0 else 0.0


def solve_rows(rows: Rows, kept_names: tuple[str, ...], settings: AnalysisSettings) -> Solution:
    """Solve for the kept coefficients and the nuisance terms that the rows tell from them.

    Needs more rows than kept coefficients. Encoder offset and misalignment are in the model
    wherever they are independent of the kept columns; temperature and drift where the information
    criterion asks for them; a jump of the encoder where the model follows the rows badly without
    it and well with it.
    """
    first = _solve(rows, kept_names, settings, None)
    found = first.solution
    strays = float(np.mean(~found.kept))
    place = jump_place(first.design, first.slope, found.residual_V)
    if place is None or OFFSET not in found.names:
        return found
    if strays < MANY_STRAYS and found.lag_one_correlation < settings.model_too_stiff:
        # So that a few wild rows make no jump, each counts for no more than one at the threshold.
        most_V = settings.outlier * found.noise_V
        tamed = jump_place(first.design, first.slope, np.clip(found.residual_V, -most_V, most_V))
        if tamed is None:
            return found
        left = max(found.sum_of_squares - tamed[1], 0.0) / max(found.degrees_of_freedom - 1, 1)
        if tamed[1] < PERHAPS**2 * left:
            return found
    model = TurnedModel(rows, kept_names, None)
    row, angle_rad = jump_begin(
        lambda added: model.with_misalignment(model.columns(added)), rows.output_V, place[0]
    )
    second = _solve(rows, kept_names, settings, row, {JUMP: angle_rad}).solution
    fall = found.sum_of_squares - second.sum_of_squares
    quieter = second.noise_V < QUIETER * found.noise_V
    quieter |= fall > SURELY**2 * second.noise_V**2 and second.kept.sum() >= found.kept.sum()
    fewer = float(np.mean(~second.kept)) < strays - 0.5 * MANY_STRAYS
    worse = second.noise_V > found.noise_V / QUIETER
    worse |= second.lag_one_correlation > settings.too_stiff_beyond(len(rows.time_s))
    evident = JUMP in second.names and (quieter or fewer) and not worse
    return second if evident else found


@dataclass(frozen=True)
class _Solved:
    """A solution, its design (rows, k) and the output's derivative by the angle."""

    solution: Solution
    design: Array
    slope: Array


def _solve(
    rows: Rows,
    kept_names: tuple[str, ...],
    settings: AnalysisSettings,
    jump_row: int | None,
    angles: Mapping[str, float] | None = None,
) -> _Solved:
    """Solve with the encoder's offset changed from `jump_row` on, or unchanged where it is None.

    `angles` are offset and jump to begin with, in rad.
    """
    model = TurnedModel(rows, kept_names, jump_row)
    begin = model.correction_rad(angles or {})
    columns, data = model.columns(begin), rows.output_V
    start = model.with_misalignment(columns)
    inside = keep_inliers(start, data, far(start, settings.outlier))
    model.guess(solve_by_qr(start[inside], data[inside]).coefficients)
    begin = model.without_large_offset(begin, inside)
    fixed_names, fixed = model.fixed(begin)
    room = max(0, (len(data) - fixed.shape[1]) // 6)
    slow = slow_terms(
        rows.time_s,
        rows.temperature_degC,
        rows.accelerations()[:, 0],
        min(settings.max_drift_order, room),
    )
    usable = separable(fixed, slow, np.ones(len(data), dtype=bool))
    whole = np.column_stack((fixed, usable.columns))
    inside = keep_inliers(whole, data, far(whole, settings.outlier))
    usable = separable(fixed, usable, inside)
    weight = group_weights(rows, np.column_stack((fixed, usable.columns)), inside)
    terms = usable.only(chosen(fixed, data, usable, inside, weight))
    angles = {name: (angles or {}).get(name, 0.0) for name in ANGLES if name in fixed_names}
    if OFFSET in angles:
        angles[OFFSET] = float(begin[0])
    kept = inside
    for n in range(ROUNDS):
        _, fixed = model.fixed(model.correction_rad(angles))
        design = np.column_stack((fixed, terms.columns))
        threshold = far(design, settings.outlier)
        kept = keep_inliers(design, data, threshold, weight) if n < 3 else kept
        fit = solve_by_qr(design[kept], data[kept], weight[kept])
        model.guess(fit.coefficients)
        steps = {name: float(fit.coefficients[fixed_names.index(name)]) for name in angles}
        angles = {name: angles[name] + steps[name] for name in angles}
        if all(abs(step) < SETTLED_RAD for step in steps.values()) and (n or not angles):
            break
    lost = tuple(name for name in slow.names if name not in usable.names)
    names = (*fixed_names, *terms.names)
    warmth = model.unfitted_warmth(usable, terms.names, kept) * weight[kept, None] ** 2
    solution = _solution(model, design, data, fit, kept, names, angles, lost, warmth)
    return _Solved(solution, design, model.slope)


def far(design: Array, sigmas: float) -> float:
    """Return beyond how many robust standard deviations a row is wild, `sigmas` for many rows.

    Few rows tell their own noise badly: as seldom as a normal deviate lies beyond `sigmas`, one of
    Student's t with the rows left over lies beyond this.
    """
    left = max(design.shape[0] - design.shape[1], 1)
    return sigmas if left >= ENOUGH_LEFT else float(-stdtrit(left, ndtr(-sigmas)))


def group_weights(rows: Rows, design: Array, kept: Mask) -> Array:
    """Return one over the noise of each row's group, relative to all; ones without groups.

    The noise of a group is told by its own residuals where there are enough of them.
    """
    weight = np.ones(len(kept))
    if rows.noise_group is None or len(np.unique(rows.noise_group)) < 2:
        return weight
    for _ in range(3):
        fit = solve_by_qr(design[kept], rows.output_V[kept], weight[kept])
        left = (rows.output_V - combine(design, fit.coefficients))[kept]
        share = np.maximum(1.0 - fit.leverage, 1e-6)
        group = rows.noise_group[kept]
        for one in np.unique(group):
            inside = group == one
            if int(inside.sum()) >= FEWEST_OF_A_GROUP:
                variance = float(np.sum(left[inside] ** 2) / np.sum(share[inside]))
                weight[rows.noise_group == one] = 1.0 / np.sqrt(max(variance, 1e-300))
        unknown = ~np.isin(rows.noise_group, group) | (weight == 1.0)
        known = weight[~unknown]
        weight[unknown] = float(np.median(known)) if len(known) else 1.0
    return np.asarray(weight / float(np.median(weight)))


def _solution(
    model: TurnedModel,
    design: Array,
    data: Array,
    fit: OrthogonalFit,
    kept: Mask,
    names: tuple[str, ...],
    angles: Mapping[str, float],
    lost: tuple[str, ...],
    warmth: Array,
) -> Solution:
    freedom = int(kept.sum()) - design.shape[1]
    variance = fit.sum_of_squares / freedom if freedom > 0 else float("nan")
    moved = fit.inverse_normal @ design[kept].T @ warmth
    coefficients, factor = fit.coefficients.copy(), np.ones(len(names))
    for name, angle_rad in angles.items():
        place = names.index(name)
        coefficients[place] = angle_rad * ARCSEC_PER_RAD
        factor[place] = ARCSEC_PER_RAD
    return Solution(
        names=names,
        coefficients=coefficients,
        covariance=(variance * fit.inverse_normal + moved @ moved.T) * np.outer(factor, factor),
        kept=kept,
        residual_V=data - combine(design, fit.coefficients),
        degrees_of_freedom=freedom,
        noise_V=float(np.sqrt(variance)),
        condition=fit.condition,
        not_separable=(*model.not_separable, *lost),
        jump_row=model.jump_row,
    )
