"""Terms beside the coefficients: encoder offset, misalignment, temperature, slow drift."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from procedures.estimation.drift import legendre_columns
from procedures.estimation.orthogonal import (
    choose_by_information,
    independent_of,
    orthogonal_part,
    thin_qr,
)

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
OFFSET, JUMP, KO, KP = "encoder offset", "encoder jump", "Ko", "Kp"
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
    found = sum(name.startswith("drift") for name in best)
    return (*best, *drift[found : found + 1]) if found else best


def has_warmed(terms: Candidates, kept: Mask) -> bool:
    """Return whether the temperature of the kept rows changed by more than `WARMED_K`."""
    if K0_T not in terms.names:
        return False
    return float(np.ptp(terms.columns[kept, terms.names.index(K0_T)])) > WARMED_K
