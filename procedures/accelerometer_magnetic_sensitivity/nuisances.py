"""Terms beside the coefficients: encoder offset, misalignment, temperature, slow drift.

`TurnedModel` holds the columns of the model at an encoder's offset, and the alignment terms that go
with them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from procedures.estimation.alternatives import Alternative
from procedures.estimation.linear import combine
from procedures.estimation.orthogonal import (
    choose_by_information,
    independent_of,
    orthogonal_part,
    solve_by_qr,
    thin_qr,
)
from procedures.estimation.sine import legendre_columns

from .dataset import Rows
from .model import COEFFICIENTS, accelerations_by_angle, model_columns, model_columns_by_angle
from .solved import JUMP

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
INDEPENDENT_PART = 1e-3
"""A nuisance term is fitted when more than this part of its column is its own."""
WARMED_K = 0.05
"""From such a range of temperature on no criterion is asked: at 150 ppm/degC it is 7.5 µV at 1 g,
and where temperature follows the angle the coefficients take it up and leave no residual."""
FEWEST_LEFT = 3
"""So many rows must be left over, or no value is given: fewer say neither how large the noise is
nor whether the model holds. Where temperature terms would leave fewer, the criterion is asked all
the same, and what is left out is in the uncertainty."""
ARCSEC_PER_RAD = 3600.0 * 180.0 / np.pi
OFFSET, KO, KP = "encoder offset", "Ko", "Kp"
MOUNTED = (OFFSET, KO, KP)
"""What the mounting decides: the input axis from the encoder's zero, towards OA, towards PA."""
MOUNTING_RAD = 5e-4
"""A device on a machined fixture lies to half a milliradian, 100 arcsec."""
SINGULAR, SMALL_PART = 1e-9, 1e-3
"""Of columns of unit length; of a column: what a coefficient takes less of, it does not hold."""
K0_T, KI_T = "K0_T", "Ki_T"
KI_DRIFT = "Ki drift"
"""Of the scale factor, linear in time, where no thermometer says what warmed it."""
USUAL = {K0_T: 30e-6, KI_T: 100e-6}
"""Per degC and in parts of Ki: the temperature terms of quartz accelerometers with a flexure, 20 to
50 µg and 80 to 150 ppm."""
UNITS = {
    KI_DRIFT: "V/g",
    OFFSET: "arcsec",
    JUMP: "arcsec",
    KO: "V/g",
    KP: "V/g",
    K0_T: "V/degC",
    KI_T: "V/g/degC",
}
ROUNDS = 8
LARGE_RAD = 3e-4
"""The square of such an angle is 0.05 µV at 1 V/g."""


def drift_name(order: int) -> str:
    """Return the name of the drift term of an order."""
    return f"drift {order}"


def unit_of(name: str) -> str:
    """Return the unit of a nuisance term."""
    return UNITS.get(name, "V")


@dataclass(frozen=True)
class Candidates:
    """Columns of the slow terms (rows, m) and their names, temperature first, then drift."""

    names: tuple[str, ...]
    columns: Array

    def only(self, names: tuple[str, ...]) -> Candidates:
        """Return those of the given names."""
        places = [self.names.index(name) for name in names]
        return Candidates(names, self.columns[:, places])


def slow_terms(
    time_s: Array, temperature_degC: Array | None, input_g: Array, max_order: int
) -> Candidates:
    """Return the columns of temperature and drift.

    Temperature is taken from its mean over the rows, so that K0 and Ki are values at the mean
    temperature; each drift column has zero mean over the rows, so that it takes nothing of K0.
    Without a temperature the scale factor may drift, too.
    """
    names: list[str] = []
    columns: list[Array] = []
    if temperature_degC is not None and float(np.ptp(temperature_degC)) > 0.0:
        warmer = temperature_degC - float(np.mean(temperature_degC))
        names += [K0_T, KI_T]
        columns += [warmer, input_g * warmer]
    drift = legendre_columns(time_s, max_order, float(time_s[0]), float(time_s[-1]))
    if temperature_degC is None and max_order > 0:
        names.append(KI_DRIFT)
        columns.append(input_g * (drift[:, 1] - float(np.mean(drift[:, 1]))))
    for order in range(1, max_order + 1):
        names.append(drift_name(order))
        columns.append(drift[:, order] - float(np.mean(drift[:, order])))
    stack = np.column_stack(columns) if columns else np.empty((len(time_s), 0))
    return Candidates(tuple(names), stack)


def separable(fixed: Array, terms: Candidates, kept: Mask) -> Candidates:
    """Return the slow terms that the kept rows tell from the fixed columns and from each other."""
    taken = independent_of(fixed[kept], terms.columns[kept], INDEPENDENT_PART)
    return terms.only(tuple(terms.names[j] for j in taken))


def chosen(
    fixed: Array, data: Array, terms: Candidates, kept: Mask, root_weight: Array
) -> tuple[str, ...]:
    """Return the slow terms that the data ask for, by the Bayesian information criterion.

    Tried is every order of drift with no temperature term, with K0_T, and with K0_T and Ki_T; only
    with both where the temperature changed by more than `WARMED_K`. Where there is drift, one
    order more is taken than it asks for: what a criterion leaves out is small against the noise of
    all rows, but not against that of a coefficient which one plane, and so a part of the time,
    decides. `fixed` (rows, k) are the columns that are always there; only `kept` rows count.
    """
    warm = [name for name in terms.names if not name.startswith("drift")]
    drift = [name for name in terms.names if name.startswith("drift")]
    weight = root_weight[kept]
    basis = thin_qr(fixed[kept] * weight[:, None])[0]
    left = orthogonal_part(basis, data[kept] * weight)
    rows = len(left)
    models: list[tuple[str, ...]] = []
    squares: list[float] = []
    counts: list[int] = []
    sure = rows - basis.shape[1] - len(warm) >= FEWEST_LEFT and has_warmed(terms, kept)
    for first in ([warm] if sure else [[], warm[:1], warm]) if warm else [[]]:
        own, rest = basis, left
        for order in range(-len(first), len(drift) + 1):
            added = first[order] if order < 0 else (drift[order - 1] if order > 0 else None)
            if added is not None:
                column = terms.columns[kept, terms.names.index(added)] * weight
                column = orthogonal_part(own, column)
                column = column / np.linalg.norm(column)
                own = np.column_stack((own, column))
                rest = rest - column * float(column @ rest)
            if order >= 0:
                models.append((*first, *drift[:order]))
                squares.append(float(rest @ rest))
                counts.append(own.shape[1])
    best = models[choose_by_information(squares, counts, rows)]
    drift_terms = sum(name.startswith("drift") for name in best)
    return (*best, *drift[drift_terms : drift_terms + 1]) if drift_terms else best


def has_warmed(terms: Candidates, kept: Mask) -> bool:
    """Return whether the temperature of the kept rows changed by more than `WARMED_K`."""
    if K0_T not in terms.names:
        return False
    return float(np.ptp(terms.columns[kept, terms.names.index(K0_T)])) > WARMED_K


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
        self,
        rows: Rows,
        kept_names: tuple[str, ...],
        off: Mask | None = None,
        cause: Alternative | None = None,
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
        self.folded: dict[str, Array] = {}

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
            self.folded = folded(columns[decide], large[decide], taken)
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
