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
    independent_of,
    keep_inliers,
    solve_by_qr,
)

from .findings import AnalysisSettings
from .jump import jump_begin, jump_place
from .model import (
    COEFFICIENTS,
    accelerations_by_angle,
    model_columns,
    model_columns_by_angle,
)
from .nuisances import (
    ARCSEC_PER_RAD,
    INDEPENDENT_PART,
    JUMP,
    KO,
    KP,
    OFFSET,
    chosen,
    separable,
    slow_terms,
)
from .rows import Rows

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

ROUNDS = 8
SETTLED_RAD = 1e-10
LARGE_RAD = 3e-4
"""The square of such an angle is 0.05 µV at 1 V/g."""
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
    well = strays < MANY_STRAYS and found.lag_one_correlation < settings.model_too_stiff
    left = max(found.sum_of_squares - place[1], 0.0) / max(found.degrees_of_freedom - 1, 1)
    if well and place[1] < PERHAPS**2 * left:
        return found
    model = _Model(rows, kept_names, None)
    row, angle_rad = jump_begin(
        lambda added: model.with_misalignment(model.columns(added)), rows.output_V, place[0]
    )
    second = _solve(rows, kept_names, settings, row, {JUMP: angle_rad}).solution
    fall = found.sum_of_squares - second.sum_of_squares
    quieter = second.noise_V < QUIETER * found.noise_V
    quieter |= fall > SURELY**2 * second.noise_V**2 and second.kept.sum() >= found.kept.sum()
    fewer = float(np.mean(~second.kept)) < strays - 0.5 * MANY_STRAYS
    worse = second.noise_V > found.noise_V / QUIETER
    worse |= second.lag_one_correlation > beyond_chance(settings, len(rows.time_s))
    evident = JUMP in second.names and (quieter or fewer) and not worse
    return second if evident else found


def beyond_chance(settings: AnalysisSettings, rows: int) -> float:
    """Return the correlation of neighbouring residuals above which the model is too stiff.

    With few rows a correlation as large as the threshold is no rarity.
    """
    return max(settings.model_too_stiff, 3.0 / float(np.sqrt(rows)))


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
    model = _Model(rows, kept_names, jump_row)
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
    solution = _solution(model, design, data, fit, kept, weight, names, angles, lost)
    return _Solved(solution, design, model.slope)


def far(design: Array, sigmas: float) -> float:
    """Return beyond how many robust standard deviations a row is wild, `sigmas` for many rows.

    Few rows tell their own noise badly: as seldom as a normal deviate lies beyond `sigmas`, one of
    Student's t with the rows left over lies beyond this.
    """
    left = max(design.shape[0] - design.shape[1], 1)
    return sigmas if left >= ENOUGH_LEFT else float(-stdtrit(left, ndtr(-sigmas)))


class _Model:
    """The columns of the model at an encoder offset, and which alignment terms go with them."""

    def __init__(self, rows: Rows, kept_names: tuple[str, ...], jump_row: int | None) -> None:
        self.rows = rows
        self.jump_row = jump_row
        self.slope = np.zeros(len(rows.time_s))
        later = np.arange(len(rows.time_s)) >= (len(rows.time_s) if jump_row is None else jump_row)
        self._later = later.astype(np.float64)
        self.names = kept_names
        self._places = [COEFFICIENTS.index(name) for name in kept_names]
        self._guess = np.zeros(len(COEFFICIENTS))
        self._alignment: tuple[str, ...] | None = None
        self.not_separable: tuple[str, ...] = ()

    def correction_rad(self, angles: Mapping[str, float]) -> Array:
        """Return what is added to the encoder's angle in each row."""
        jump_rad = angles.get(JUMP, 0.0) * self._later
        return np.asarray(angles.get(OFFSET, 0.0) + jump_rad)

    def columns(self, offset_rad: Array) -> Array:
        """Return the kept columns (rows, k)."""
        columns = model_columns(self.rows.accelerations(offset_rad), self.rows.field_T)
        return np.asarray(columns[:, self._places])

    def with_misalignment(self, columns: Array) -> Array:
        """Return columns with Ao and Ap beside them as far as those are independent."""
        other = self.rows.accelerations()[:, 1:]
        taken = independent_of(columns, other, INDEPENDENT_PART)
        return np.column_stack((columns, other[:, list(taken)]))

    def without_large_offset(self, begin_rad: Array, inside: Mask) -> Array:
        """Return the correction of the encoder's angle with a large offset already in it.

        The square of one would look like drift or temperature when those are chosen.
        """
        for _ in range(ROUNDS):
            names, design = self.fixed(begin_rad)
            if OFFSET not in names:
                break
            fit = solve_by_qr(design[inside], self.rows.output_V[inside])
            self.guess(fit.coefficients)
            step_rad = float(fit.coefficients[names.index(OFFSET)])
            if abs(step_rad) < LARGE_RAD:
                break
            begin_rad = begin_rad + step_rad
        return begin_rad

    def guess(self, coefficients: Array) -> None:
        """Take the kept coefficients as those of the next derivative by the angle."""
        self._guess[self._places] = coefficients[: len(self._places)]

    def fixed(self, offset_rad: Array) -> tuple[tuple[str, ...], Array]:
        """Return names and columns of coefficients and alignment terms."""
        rows = self.rows
        acceleration_g = rows.accelerations(offset_rad)
        turned = rows.theta_rad + offset_rad
        change = accelerations_by_angle(rows.plane, turned, rows.gravity_g)
        columns = model_columns(acceleration_g, rows.field_T)[:, self._places]
        slope = model_columns_by_angle(acceleration_g, change, rows.field_T)
        # Without input acceleration the encoder's zero turns only what is too small to tell it.
        slope = combine(slope, self._guess) * ("Ki" in self.names)
        self.slope = slope
        misaligned = acceleration_g[:, 1:]
        other = np.column_stack((slope, misaligned, slope * self._later))
        known = (OFFSET, KO, KP, JUMP)
        if self._alignment is None:
            taken = independent_of(columns, other, INDEPENDENT_PART)
            self._alignment = tuple(known[j] for j in taken)
            self.not_separable = tuple(
                name for j, name in enumerate(known) if j not in taken and np.any(other[:, j])
            )
        places = [known.index(name) for name in self._alignment]
        return (*self.names, *self._alignment), np.column_stack((columns, other[:, places]))


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
    model: _Model,
    design: Array,
    data: Array,
    fit: OrthogonalFit,
    kept: Mask,
    weight: Array,
    names: tuple[str, ...],
    angles: Mapping[str, float],
    lost: tuple[str, ...],
) -> Solution:
    freedom = int(kept.sum()) - design.shape[1]
    variance = fit.sum_of_squares / freedom if freedom > 0 else float("nan")
    coefficients, factor = fit.coefficients.copy(), np.ones(len(names))
    for name, angle_rad in angles.items():
        place = names.index(name)
        coefficients[place] = angle_rad * ARCSEC_PER_RAD
        factor[place] = ARCSEC_PER_RAD
    return Solution(
        names=names,
        coefficients=coefficients,
        covariance=variance * fit.inverse_normal * np.outer(factor, factor),
        kept=kept,
        residual_V=data - combine(design, fit.coefficients),
        degrees_of_freedom=freedom,
        noise_V=float(np.sqrt(variance)),
        condition=fit.condition,
        not_separable=(*model.not_separable, *lost),
        jump_row=model.jump_row,
    )
