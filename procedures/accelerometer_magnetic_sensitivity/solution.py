"""The full-data weighted solution: coefficients and nuisance terms together, wild rows rejected."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from procedures.estimation.linear import combine
from procedures.estimation.orthogonal import (
    OrthogonalFit,
    independent_of,
    keep_inliers,
    solve_by_qr,
)

from .findings import AnalysisSettings
from .model import (
    COEFFICIENTS,
    accelerations,
    accelerations_by_angle,
    model_columns,
    model_columns_by_angle,
)
from .nuisances import (
    ARCSEC_PER_RAD,
    INDEPENDENT_PART,
    KO,
    KP,
    OFFSET,
    chosen,
    separable,
    slow_terms,
)

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Names = NDArray[np.str_]

ROUNDS = 8
SETTLED_RAD = 1e-10
FEWEST_OF_A_GROUP = 20


@dataclass(frozen=True)
class Rows:
    """The usable rows, each array (rows,): encoder angle, measured field, output in V."""

    time_s: Array
    plane: Names
    theta_rad: Array
    field_T: Array
    output_V: Array
    temperature_degC: Array | None
    noise_group: NDArray[np.int64] | None
    gravity_g: float = 1.0

    def accelerations(self, offset_rad: float = 0.0) -> Array:
        """Return Ai, Ao, Ap in g (rows, 3) at an encoder offset."""
        return accelerations(self.plane, self.theta_rad + offset_rad, self.gravity_g)


@dataclass(frozen=True)
class Solution:
    """Coefficients of the kept columns first, then nuisance terms, `names` in that order.

    `offset_rad` is the encoder's error, whose column is the derivative by the angle, so that its
    own coefficient in `fit` is what is left of it. `kept` (rows,) are the rows that count;
    `covariance` holds the scale of the noise.
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


def solve_rows(rows: Rows, kept_names: tuple[str, ...], settings: AnalysisSettings) -> Solution:
    """Solve for the kept coefficients and the nuisance terms that the rows tell from them.

    Needs more rows than kept coefficients. Encoder offset and misalignment are in the model
    wherever they are independent of the kept columns; temperature and drift where the information
    criterion asks for them.
    """
    model = _Model(rows, kept_names)
    weight = np.ones(len(rows.time_s))
    columns, data = model.columns(0.0), rows.output_V
    start = model.with_misalignment(columns)
    inside = keep_inliers(start, data, settings.outlier)
    first = solve_by_qr(start[inside], data[inside]).coefficients
    model.guess(first)
    fixed_names, fixed = model.fixed(0.0)
    room = max(0, (len(data) - fixed.shape[1]) // 6)
    slow = slow_terms(
        rows.time_s,
        rows.temperature_degC,
        rows.accelerations()[:, 0],
        min(settings.max_drift_order, room),
    )
    usable = separable(fixed, slow, np.ones(len(data), dtype=bool))
    inside = keep_inliers(np.column_stack((fixed, usable.columns)), data, settings.outlier)
    usable = separable(fixed, usable, inside)
    weight = group_weights(rows, np.column_stack((fixed, usable.columns)), inside)
    terms = usable.only(chosen(fixed, data, usable, inside, weight))
    offset, kept = 0.0, inside
    for n in range(ROUNDS):
        _, fixed = model.fixed(offset)
        design = np.column_stack((fixed, terms.columns))
        kept = keep_inliers(design, data, settings.outlier, weight) if n < 3 else kept
        fit = solve_by_qr(design[kept], data[kept], weight[kept])
        model.guess(fit.coefficients)
        if OFFSET not in fixed_names:
            break
        step = float(fit.coefficients[fixed_names.index(OFFSET)])
        offset += step
        if abs(step) < SETTLED_RAD and n:
            break
    lost = [name for name in slow.names if name not in usable.names]
    return _solution(
        model, design, data, fit, kept, weight, (*fixed_names, *terms.names), offset, tuple(lost)
    )


class _Model:
    """The columns of the model at an encoder offset, and which alignment terms go with them."""

    def __init__(self, rows: Rows, kept_names: tuple[str, ...]) -> None:
        self.rows = rows
        self.names = kept_names
        self._places = [COEFFICIENTS.index(name) for name in kept_names]
        self._guess = np.zeros(len(COEFFICIENTS))
        self._alignment: tuple[str, ...] | None = None
        self.not_separable: tuple[str, ...] = ()

    def columns(self, offset_rad: float) -> Array:
        """Return the kept columns (rows, k)."""
        columns = model_columns(self.rows.accelerations(offset_rad), self.rows.field_T)
        return np.asarray(columns[:, self._places])

    def with_misalignment(self, columns: Array) -> Array:
        """Return columns with Ao and Ap beside them as far as those are independent."""
        other = self.rows.accelerations()[:, 1:]
        taken = independent_of(columns, other, INDEPENDENT_PART)
        return np.column_stack((columns, other[:, list(taken)]))

    def guess(self, coefficients: Array) -> None:
        """Take the kept coefficients as those of the next derivative by the angle."""
        self._guess[self._places] = coefficients[: len(self._places)]

    def fixed(self, offset_rad: float) -> tuple[tuple[str, ...], Array]:
        """Return names and columns of coefficients and alignment terms."""
        rows = self.rows
        acceleration_g = rows.accelerations(offset_rad)
        turned = rows.theta_rad + offset_rad
        change = accelerations_by_angle(rows.plane, turned, rows.gravity_g)
        columns = model_columns(acceleration_g, rows.field_T)[:, self._places]
        slope = model_columns_by_angle(acceleration_g, change, rows.field_T)
        slope = combine(slope, self._guess)
        other = np.column_stack((slope, acceleration_g[:, 1], acceleration_g[:, 2]))
        known = (OFFSET, KO, KP)
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
    offset_rad: float,
    lost: tuple[str, ...],
) -> Solution:
    freedom = int(kept.sum()) - design.shape[1]
    variance = fit.sum_of_squares / freedom if freedom > 0 else float("nan")
    coefficients, factor = fit.coefficients.copy(), np.ones(len(names))
    if OFFSET in names:
        place = names.index(OFFSET)
        coefficients[place] = offset_rad * ARCSEC_PER_RAD
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
    )
