"""The coupled model of an accelerometer in a magnetic field, and what of it a plan determines.

    Y = K0 + Ki Ai + Kii Ai^2 + Kiii Ai^3 + Kio Ai Ao + Kip Ai Ap + Koo Ao^2 + Kpp Ap^2
      + Km Am + Kmm Am^2 + Kim Ai Am + Kom Ao Am + Kpm Ap Am

Y in V; Ai, Ao, Ap the acceleration along input, output and pendulous axis in g; Am the field in T.
Equation (2) of the source document; the formula is missing from the text at hand and was
reconstructed from its list of symbols and from the model (1) of IEEE Std 836 and 1293.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from procedures.estimation.folding import folded_terms, tidy
from station.findings import combination_text

Array = NDArray[np.float64]
Names = NDArray[np.str_]
UNITS = {
    "K0": "V",
    "Ki": "V/g",
    "Kii": "V/g^2",
    "Kiii": "V/g^3",
    "Kio": "V/g^2",
    "Kip": "V/g^2",
    "Koo": "V/g^2",
    "Kpp": "V/g^2",
    "Km": "V/T",
    "Kmm": "V/T^2",
    "Kim": "V/g/T",
    "Kom": "V/g/T",
    "Kpm": "V/g/T",
}
COEFFICIENTS = tuple(UNITS)
"""The order in which columns are judged."""
FIELD_POWER = {"Km": 1, "Kmm": 2, "Kim": 1, "Kom": 1, "Kpm": 1}
"""By which power of the field each column grows; the others do not."""
GRAVITY_POWER = dict.fromkeys(("Ki", "Kim", "Kom", "Kpm"), 1) | {
    **dict.fromkeys(("Kii", "Kio", "Kip", "Koo", "Kpp"), 2),
    "Kiii": 3,
}
"""By which power of gravity."""
PLANES = ("io", "ip", "op", "level")
"""The plane of IA, OA, PA that gravity turns in; `level`: the axis of rotation is vertical."""
MOVED = 1e-4
"""The noise of a gaussmeter moves no combination by so much."""


def accelerations(plane: Names, theta_rad: Array, gravity_g: float = 1.0) -> Array:
    """Return Ai, Ao, Ap in g as columns (n, 3).

    The axis of rotation is horizontal and theta the angle of the table: `io` turns about PA with
    Ai = sin, Ao = cos; `ip` about OA with Ai = sin, Ap = cos; `op` about IA with Ao = sin,
    Ap = cos. In `level` it is vertical: Ap = 1 whatever theta. All times the local gravity.
    """
    sine, cosine = np.sin(theta_rad), np.cos(theta_rad)
    return gravity_g * _by_plane(plane, sine, cosine, 1.0)


def accelerations_by_angle(plane: Names, theta_rad: Array, gravity_g: float = 1.0) -> Array:
    """Return the derivatives of Ai, Ao, Ap by theta, g/rad, as columns (n, 3)."""
    return gravity_g * _by_plane(plane, np.cos(theta_rad), -np.sin(theta_rad), 0.0)


def _by_plane(plane: Names, first: Array, second: Array, level: float) -> Array:
    result = np.zeros((len(first), 3))
    in_io, in_ip, in_op = plane == "io", plane == "ip", plane == "op"
    result[:, 0] = np.where(in_io | in_ip, first, 0.0)
    result[:, 1] = np.where(in_io, second, np.where(in_op, first, 0.0))
    result[:, 2] = np.where(in_ip | in_op, second, np.where(plane == "level", level, 0.0))
    return result


def model_columns(acceleration_g: Array, field: Array) -> Array:
    """Return the thirteen columns (n, 13), in the order of `COEFFICIENTS`, for a field (n,)."""
    i, o, p = acceleration_g.T
    ones = np.ones(len(field))
    still = (ones, i, i**2, i**3, i * o, i * p, o**2, p**2)
    magnetic = (field, field**2, i * field, o * field, p * field)
    return np.column_stack((*still, *magnetic))


def model_columns_by_angle(acceleration_g: Array, change_g_per_rad: Array, field: Array) -> Array:
    """Return the derivatives of the thirteen columns by theta, per rad, (n, 13)."""
    i, o, p = acceleration_g.T
    di, do, dp = change_g_per_rad.T
    zero = np.zeros(len(field))
    still = (zero, di, 2 * i * di, 3 * i**2 * di, di * o + i * do, di * p + i * dp)
    square = (2 * o * do, 2 * p * dp)
    magnetic = (zero, zero, di * field, do * field, dp * field)
    return np.column_stack((*still, *square, *magnetic))


def field_scales(largest_T: float, names: Sequence[str] = COEFFICIENTS) -> Array:
    """Return what a column for the field over its largest magnitude is divided by, (k,)."""
    return np.array([largest_T ** FIELD_POWER.get(name, 0) for name in names])


@dataclass(frozen=True)
class Identifiability:
    """What a plan determines.

    `terms` maps each kept coefficient to the combination that it really measures, in the units of
    the coefficients: {"K0": {"K0": 1, "Kpp": 1}}. `folded` are the others; of them `unexcited`
    stand in no combination, because their columns are zero.
    """

    terms: Mapping[str, Mapping[str, float]]
    folded: tuple[str, ...]
    unexcited: tuple[str, ...]

    @property
    def kept(self) -> tuple[str, ...]:
        """The kept coefficients, in the order of the columns."""
        return tuple(self.terms)

    @property
    def rank(self) -> int:
        """How many independent combinations the plan determines."""
        return len(self.terms)

    @property
    def alone(self) -> tuple[str, ...]:
        """The coefficients that are determined alone."""
        return tuple(name for name, terms in self.terms.items() if len(terms) == 1)

    @property
    def not_alone(self) -> tuple[str, ...]:
        """The coefficients that are not: folded ones, and kept ones that stand for several."""
        return tuple(name for name in COEFFICIENTS if name not in self.alone)

    def as_measured(self, shares: Array, largest_T: float) -> Identifiability:
        """Return the combinations that the measured fields and angles make of the same columns.

        `shares` (rank, 13) are what the solution takes of each column, in the units of the
        coefficients. A term stays as commanded where it is moved by less than `MOVED`, the field
        taken over its largest magnitude.
        """
        scale = field_scales(largest_T)
        terms: dict[str, dict[str, float]] = {}
        for row, (name, commanded) in enumerate(self.terms.items()):
            own = dict(commanded)
            for folded in self.folded:
                j = COEFFICIENTS.index(folded)
                share = float(shares[row, j])
                moved = abs(share - own.get(folded, 0.0)) * scale[COEFFICIENTS.index(name)]
                if moved > MOVED * scale[j]:
                    own[folded] = tidy(float(f"{share:.9g}"))
            terms[name] = own
        return Identifiability(terms, self.folded, self.unexcited)


def judge(
    plane: Names, theta_deg: Array, field_T: Array, gravity_g: float = 1.0
) -> Identifiability:
    """Judge the commanded rows of a plan, each argument of shape (rows,).

    Thirteen columns, accelerations in g, field over its largest magnitude, nuisance terms aside;
    in the order of `COEFFICIENTS` each is kept that is independent of those kept before it; the
    others fold into the kept ones.
    """
    if not len(theta_deg):
        return Identifiability({}, COEFFICIENTS, COEFFICIENTS)
    largest_T = float(np.max(np.abs(field_T))) or 1.0
    acceleration_g = accelerations(plane, np.radians(theta_deg), gravity_g)
    columns = model_columns(acceleration_g, field_T / largest_T)
    terms = folded_terms(COEFFICIENTS, columns, field_scales(largest_T))
    folded = tuple(name for name in COEFFICIENTS if name not in terms)
    held = {name for own in terms.values() for name in own}
    return Identifiability(terms, folded, tuple(name for name in folded if name not in held))


def describe(determined: Identifiability) -> tuple[str, ...]:
    """Return in sentences what a plan determines and what it does not, and why."""
    together = [combination_text(own) for own in determined.terms.values() if len(own) > 1]
    sentences = [
        f"{determined.rank} of the thirteen combinations are determined.",
        f"Alone: {listed(determined.alone)}."
        if determined.alone
        else "No coefficient is determined alone.",
    ]
    if together:
        sentences.append(f"Only together: {listed(together)}.")
    if determined.unexcited:
        sentences.append(
            f"Not at all: {listed(determined.unexcited)}; their terms are zero, or the same, "
            "throughout."
        )
    if {"K0", "Koo", "Kpp"} & set(determined.not_alone) and determined.rank:
        sentences.append(
            "At rest the three accelerations always make 1 g (Ai² + Ao² + Ap² = 1): K0 and the "
            "square terms can never all be distinguished without a centrifuge."
        )
    return tuple(sentences)


def listed(names: Sequence[str]) -> str:
    """Return names as a list in a sentence."""
    return names[0] if len(names) == 1 else ", ".join(names[:-1]) + " and " + names[-1]
