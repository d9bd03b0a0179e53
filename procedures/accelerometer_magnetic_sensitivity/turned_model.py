"""The columns of the model at an encoder's offset, and which alignment terms go with them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from procedures.estimation.linear import combine
from procedures.estimation.orthogonal import independent_of, solve_by_qr

from .model import (
    COEFFICIENTS,
    accelerations_by_angle,
    model_columns,
    model_columns_by_angle,
)
from .nuisances import (
    INDEPENDENT_PART,
    JUMP,
    KO,
    KP,
    OFFSET,
    USUAL,
    Candidates,
    has_warmed,
)
from .rows import Rows
from .solved import Cause

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

ROUNDS = 8
LARGE_RAD = 3e-4
"""The square of such an angle is 0.05 µV at 1 V/g."""


class TurnedModel:
    """The columns of the model at an encoder offset, and which alignment terms go with them."""

    def __init__(
        self,
        rows: Rows,
        kept_names: tuple[str, ...],
        off: Mask | None = None,
        cause: Cause | None = None,
    ) -> None:
        """Take the rows, in which of them the encoder is `off`, and what else moved the output."""
        self.rows = rows
        self.slope = np.zeros(len(rows.time_s))
        self._off = self.slope.copy() if off is None else off.astype(np.float64)
        self._more = np.zeros((len(rows.time_s), 0)) if cause is None else cause.columns
        self._more_names = () if cause is None else cause.names
        self.names = kept_names
        self._places = [COEFFICIENTS.index(name) for name in kept_names]
        self._guess = np.zeros(len(COEFFICIENTS))
        self._alignment: tuple[str, ...] | None = None
        self._misalignment: list[int] | None = None
        self.not_separable: tuple[str, ...] = ()

    def correction_rad(self, angles: Mapping[str, float]) -> Array:
        """Return what is added to the encoder's angle in each row."""
        jump_rad = angles.get(JUMP, 0.0) * self._off
        return np.asarray(angles.get(OFFSET, 0.0) + jump_rad)

    def columns(self, offset_rad: Array | float) -> Array:
        """Return the kept columns (rows, k)."""
        columns = model_columns(self.rows.accelerations(offset_rad), self.rows.field_T)
        return np.asarray(columns[:, self._places])

    def with_misalignment(self, offset_rad: Array | float) -> Array:
        """Return the kept columns with Ao, Ap and the encoder's zero as far as independent.

        Three planes tell the zero from misalignment; without it one of them would look wild.
        """
        if self._misalignment is None:
            still, other = self.columns(0.0), self._aligned(0.0)
            self._misalignment = list(independent_of(still, other, INDEPENDENT_PART))
        other = self._aligned(offset_rad)[:, self._misalignment]
        return np.column_stack((self.columns(offset_rad), other, self._more))

    def _aligned(self, offset_rad: Array | float) -> Array:
        rows, telling = self.rows, float("Ki" in self.names)
        turned = rows.theta_rad + offset_rad
        change = accelerations_by_angle(rows.plane, turned, rows.gravity_g)[:, :1]
        return np.column_stack((rows.accelerations(offset_rad)[:, 1:], change * telling))

    def without_large_offset(self, begin_rad: Array, inside: Mask) -> Array:
        """Return the correction of the encoder's angle with a large offset already in it.

        The square of one would look like drift or temperature when those are chosen.
        """
        for _ in range(ROUNDS):
            names, design = self.fixed(begin_rad, inside)
            if OFFSET not in names:
                break
            fit = solve_by_qr(design[inside], self.rows.output_V[inside])
            self.guess(fit.coefficients)
            step_rad = float(fit.coefficients[names.index(OFFSET)])
            if abs(step_rad) < LARGE_RAD:
                break
            begin_rad = begin_rad + step_rad
        return begin_rad

    @property
    def coefficients(self) -> Array:
        """All thirteen coefficients as they were last taken, zero where they are folded."""
        return self._guess

    def guess(self, coefficients: Array) -> None:
        """Take the kept coefficients as those of the next derivative by the angle."""
        self._guess[self._places] = coefficients[: len(self._places)]

    def fixed(self, offset_rad: Array, inside: Mask | None = None) -> tuple[tuple[str, ...], Array]:
        """Return names and columns of coefficients and alignment terms.

        At first the rows `inside` decide which terms these are; all rows where it is not given.
        """
        rows = self.rows
        acceleration_g = rows.accelerations(offset_rad)
        turned = rows.theta_rad + offset_rad
        change = accelerations_by_angle(rows.plane, turned, rows.gravity_g)
        columns = model_columns(acceleration_g, rows.field_T)[:, self._places]
        slope = model_columns_by_angle(acceleration_g, change, rows.field_T)
        # Without input acceleration the encoder's zero turns only what is too small to tell it.
        telling = float("Ki" in self.names)
        slope = combine(slope, self._guess) * telling
        self.slope = slope
        misaligned = acceleration_g[:, 1:]
        other = np.column_stack((slope, misaligned, slope * self._off))
        known = (OFFSET, KO, KP, JUMP)
        if self._alignment is None:
            decide = np.ones(len(columns), dtype=bool) if inside is None else inside
            # By the large part of the derivative: a poor first guess would make columns of small
            # coefficients, and an offset that misalignment cancels, look like something to find.
            large = np.column_stack((change[:, 0] * telling, other[:, 1:]))
            taken = independent_of(columns[decide], large[decide], INDEPENDENT_PART)
            self._alignment = tuple(known[j] for j in taken)
            self.not_separable = tuple(
                name for j, name in enumerate(known) if j not in taken and np.any(other[:, j])
            )
        places = [known.index(name) for name in self._alignment]
        names = (*self.names, *self._alignment, *self._more_names)
        return names, np.column_stack((columns, other[:, places], self._more))

    def unfitted_warmth(self, usable: Candidates, taken: tuple[str, ...], kept: Mask) -> Array:
        """Return the columns (kept rows, m), in V, of a warming that too few rows could fit.

        Each is one standard deviation of what warms an accelerometer of the usual class.
        """
        if not has_warmed(usable, kept) or set(taken) & set(USUAL):
            return np.zeros((int(kept.sum()), 0))
        names = [name for name in usable.names if name in USUAL]
        ki = abs(float(self._guess[COEFFICIENTS.index("Ki")])) if "Ki" in self.names else 1.0
        columns = usable.only(tuple(names)).columns * [USUAL[name] * ki for name in names]
        return np.asarray(columns[kept])
