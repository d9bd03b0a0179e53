"""Terms beside the coefficients: encoder offset, misalignment, temperature, slow drift.

`TurnedModel` holds the columns of the model at an encoder's offset, and the alignment terms that go
with them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from procedures.estimation.alternatives import Alternative
from procedures.estimation.linear import combine
from procedures.estimation.orthogonal import (
    choose_by_information,
    independent_of,
    solve_by_qr,
    thin_qr,
)
from procedures.estimation.sine import legendre_columns
from procedures.estimation.slow_terms import (
    DRIFT,
    K0_T,
    KI_T,
    USUAL,
    Terms,
    candidates,
    has_warmed,
    stacked,
)

from .dataset import Rows
from .model import COEFFICIENTS, accelerations_by_angle, model_columns, model_columns_by_angle

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
INDEPENDENT_PART = 1e-3
"""A nuisance term is fitted when more than this part of its column is its own."""
ARCSEC_PER_RAD = 3600.0 * 180.0 / np.pi
OFFSET, KO, KP, JUMP = "encoder offset", "Ko", "Kp", "encoder jump"
ENCODER_JUMP = "encoder-jump"
"""The code of the cause whose column says in which rows the encoder is off."""
ANGLES = (OFFSET, JUMP)
MOUNTED = (OFFSET, KO, KP)
"""What the mounting decides: the input axis from the encoder's zero, towards OA, towards PA."""
MOUNTING_RAD = 5e-4
"""A device on a machined fixture lies to half a milliradian, 100 arcsec."""
SINGULAR, SMALL_PART = 1e-9, 1e-3
"""Of columns of unit length; of a column: what a coefficient takes less of, it does not hold."""
KI_DRIFT = "Ki drift"
"""Of the scale factor, linear in time, where no thermometer says what warmed it."""
USUAL_DRIFT_PER_H = 250e-6
"""In parts of Ki, 250 µg/h: an accelerometer that has not warmed up yet."""
UNITS = {
    KI_DRIFT: "V/g",
    OFFSET: "arcsec",
    JUMP: "arcsec",
    KO: "V/g",
    KP: "V/g",
    K0_T: "V/degC",
    KI_T: "V/g/degC",
}
"""Of nuisance terms; those of drift are in V."""
ROUNDS = 8
LARGE_RAD = 3e-4
"""The square of such an angle is 0.05 µV at 1 V/g."""


def slow_terms(rows: Rows, max_order: int) -> dict[str, Array]:
    """Return the columns of temperature and drift.

    Temperature is taken from its mean over the rows, so that K0 and Ki are values at the mean
    temperature; each drift column has zero mean over the rows, so that it takes nothing of K0.
    Without a temperature the scale factor may drift, too.
    """
    time_s, warm, input_g = rows.time_s, rows.temperature_degC, rows.accelerations()[:, 0]
    drift = legendre_columns(time_s, max_order, float(time_s[0]), float(time_s[-1]))
    drift = drift - drift.mean(axis=0)
    terms: dict[str, Array] = {}
    if warm is not None and float(np.ptp(warm)) > 0.0:
        warmer = warm - float(np.mean(warm))
        terms = {K0_T: warmer, KI_T: input_g * warmer}
    if warm is None and max_order > 0:
        terms[KI_DRIFT] = input_g * drift[:, 1]
    return terms | {f"{DRIFT}{order}": drift[:, order] for order in range(1, max_order + 1)}


def separable(fixed: Array, terms: Terms, kept: Mask) -> dict[str, Array]:
    """Return the slow terms that the kept rows tell from the fixed columns and from each other."""
    columns = stacked(terms, len(kept))[kept]
    taken = independent_of(fixed[kept], columns, INDEPENDENT_PART)
    return {name: terms[name] for n, name in enumerate(terms) if n in taken}


def chosen(
    fixed: Array, data: Array, terms: Terms, kept: Mask, root_weight: Array
) -> dict[str, Array]:
    """Return the slow terms that the data ask for, by the Bayesian information criterion.

    Where there is drift, one order more is taken than it asks for: what a criterion leaves out is
    small against the noise of all rows, but not against that of a coefficient which one plane, and
    so a part of the time, decides. With these terms wild rows and causes are looked for; what the
    coefficients are is an average of all `candidates`.
    """
    models = candidates(fixed, terms, kept)
    # What any of these leaves of the data is in the triangle of all columns and the data.
    count, width = int(kept.sum()), fixed.shape[1]
    whole = np.column_stack((fixed, stacked(terms, len(kept)), data))[kept]
    triangle = thin_qr(whole * root_weight[kept, None])[1]
    scaled = triangle[:, :-1] / np.linalg.norm(triangle[:, :-1], axis=0)
    squares = []
    for model in models:
        places = [*range(width), *(width + list(terms).index(name) for name in model)]
        taken = np.linalg.lstsq(scaled[:, places], triangle[:, -1], rcond=None)[0]
        squares.append(float(np.sum((triangle[:, -1] - scaled[:, places] @ taken) ** 2)))
    best = models[choose_by_information(squares, [width + len(m) for m in models], count)]
    drift = [name for name in terms if name.startswith(DRIFT)]
    order = sum(name in drift for name in best)
    return {name: terms[name] for name in (*best, *drift[order : order + bool(order)])}


def folded(columns: Array, alignment: Array, taken: Sequence[int]) -> dict[str, Array]:
    """Return what the coefficients (k,) take of each alignment term that is not fitted.

    `columns` (rows, k), `alignment` (rows, m) those of `MOUNTED` first; `taken` are fitted.
    """
    both = np.column_stack((columns, alignment[:, list(taken)]))
    size = np.linalg.norm(both, axis=0)
    taken_up = {}
    for j, name in enumerate(MOUNTED):
        if j in taken or not alignment[:, j].any():
            continue
        parts = np.linalg.lstsq(both / size, alignment[:, j], rcond=SINGULAR)[0]
        parts = np.where(np.abs(parts) > SMALL_PART * np.linalg.norm(alignment[:, j]), parts, 0.0)
        shares = (parts / size)[: columns.shape[1]]
        if shares.any():
            taken_up[name] = np.asarray(shares)
    return taken_up


class TurnedModel:
    """The columns of the model at an encoder offset, and which alignment terms go with them."""

    def __init__(
        self, rows: Rows, kept_names: tuple[str, ...], cause: Alternative | None = None
    ) -> None:
        """Take the rows and what else moved the output, the encoder in some rows or another."""
        self.rows, self.names = rows, kept_names
        self.off = self.slope = np.zeros(len(rows.time_s))
        self._more = np.zeros((len(rows.time_s), 0))
        self._more_names: tuple[str, ...] = ()
        if cause is not None and cause.code == ENCODER_JUMP:
            self.off = cause.columns[:, 0]
        elif cause is not None:
            self._more, self._more_names = cause.columns, cause.names
        self._places = [COEFFICIENTS.index(name) for name in kept_names]
        self.coefficients = np.zeros(len(COEFFICIENTS))
        """All thirteen as they were last taken, zero where they are folded."""
        # Without input acceleration the encoder's zero turns only what is too small to tell it.
        self.coefficients[COEFFICIENTS.index("Ki")] = self._telling = float("Ki" in kept_names)
        self._alignment: tuple[str, ...] = ()
        self.not_separable: tuple[str, ...] = ()
        self.folded: dict[str, Array] = {}

    def correction_rad(self, angles: Mapping[str, float]) -> Array:
        """Return what is added to the encoder's angle in each row."""
        return np.asarray(angles.get(OFFSET, 0.0) + angles.get(JUMP, 0.0) * self.off)

    def guess(self, coefficients: Array) -> None:
        """Take the kept coefficients as those of the next derivative by the angle."""
        self.coefficients[self._places] = coefficients[: len(self._places)]

    def fixed(self, offset_rad: Array, decide: Mask | None = None) -> tuple[tuple[str, ...], Array]:
        """Return names and columns of coefficients and alignment terms.

        The rows to `decide` by, where they are given, say which terms these are.
        """
        rows = self.rows
        acceleration_g = rows.accelerations(offset_rad)
        turned = rows.theta_rad + offset_rad
        change = accelerations_by_angle(rows.plane, turned, rows.gravity_g)
        columns = model_columns(acceleration_g, rows.field_T)[:, self._places]
        slope = model_columns_by_angle(acceleration_g, change, rows.field_T)
        self.slope = slope = combine(slope, self.coefficients) * self._telling
        other = np.column_stack((slope, acceleration_g[:, 1:], slope * self.off))
        known = (*MOUNTED, JUMP)
        if decide is not None:
            # By the large part of the derivative: a poor first guess would make columns of small
            # coefficients, and an offset that misalignment cancels, look like something to find.
            large = np.column_stack((change[:, 0] * self._telling, other[:, 1:]))
            taken = independent_of(columns[decide], large[decide], INDEPENDENT_PART)
            self._alignment = tuple(known[j] for j in taken)
            self.not_separable = tuple(
                name for j, name in enumerate(known) if j not in taken and np.any(other[:, j])
            )
            self.folded = folded(columns[decide], large[decide], taken)
        places = [known.index(name) for name in self._alignment]
        names = (*self.names, *self._alignment, *self._more_names)
        return names, np.column_stack((columns, other[:, places], self._more))

    def without_large_angles(self, angles: dict[str, float], inside: Mask) -> dict[str, float]:
        """Return the angles with a large offset and a large jump already in them.

        The square of one would look like drift or temperature when those are chosen.
        """
        for _ in range(ROUNDS):
            names, design = self.fixed(self.correction_rad(angles))
            fit = solve_by_qr(design[inside], self.rows.output_V[inside])
            self.guess(fit.coefficients)
            steps = {n: float(fit.coefficients[names.index(n)]) for n in ANGLES if n in names}
            if all(abs(step) < LARGE_RAD for step in steps.values()):
                break
            angles = angles | {name: angles.get(name, 0.0) + steps[name] for name in steps}
        return angles

    def unfitted(self, slow: Terms, usable: Terms, taken: Sequence[str], kept: Mask) -> Array:
        """Return the columns (kept rows, m), in V, of what moves the output and no row tells.

        Each is one standard deviation of what an accelerometer of the usual class does: of a
        warming that too few rows could fit beside the terms `taken`; of a drift that cannot be
        distinguished from the coefficients at all.
        """
        ki = abs(float(self.coefficients[COEFFICIENTS.index("Ki")])) if self._telling else 1.0
        sizes: dict[str, float] = {}
        if has_warmed(usable, kept) and not set(taken) & set(USUAL):
            sizes = {name: size for name, size in USUAL.items() if name in usable}
        linear = f"{DRIFT}1"
        if linear in slow and linear not in usable:
            sizes[linear] = 0.5 * USUAL_DRIFT_PER_H * float(np.ptp(self.rows.time_s)) / 3600.0
        return stacked({name: slow[name] * ki * size for name, size in sizes.items()}, len(kept))[
            kept
        ]
