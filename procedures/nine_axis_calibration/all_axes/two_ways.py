"""The magnetometer in the earth's field and in the coil: how the two ways compare."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from scipy.special import ndtri

from procedures.nine_axis_calibration.dataset import AXES
from station.findings import Estimate, Flag, FlagThresholds, InputQuantity, contradiction

from .stands import CoilRecord

COVERAGE = 2.0
"""Of the expanded uncertainties in a normalised error."""
DENIED = -float(ndtri(0.0005))
"""Standard uncertainties that chance exceeds once in a thousand."""
DENIES = {
    "magnetometer_offset": (
        "gaussmeter_zero",
        "the zero of the gaussmeter, and for a field fixed to what turned",
    ),
    "magnetometer_scale_factor": (
        "gaussmeter_gain",
        "the gaussmeter's gain, and at the magnitude of the earth's field as stated",
    ),
    "magnetometer_misalignment": (
        "coil_alignment",
        "how sensor and probe lie in the coil, and at the order and signs of their axes",
    ),
}
"""By result: the statement that a difference denies, and where to look."""


@dataclass(frozen=True)
class Compared:
    """A result by both ways; `of_turns_u` is the whole standard uncertainty, `in_coil_parts` what
    each input adds to that in the coil, with `repeatability`."""

    of_turns: Estimate
    of_turns_u: float
    in_coil: Estimate
    in_coil_parts: Mapping[str, float]

    @property
    def in_coil_u(self) -> float:
        """The whole standard uncertainty in the coil."""
        return math.hypot(*self.in_coil_parts.values())

    @property
    def difference(self) -> float:
        """That in the coil less that by the turns."""
        return (self.in_coil.value or 0.0) - (self.of_turns.value or 0.0)

    @property
    def u(self) -> float:
        """The standard uncertainty of the difference: the ways have nothing in common."""
        return math.hypot(self.of_turns_u, self.in_coil_u)

    @property
    def normalised_error(self) -> float:
        """The difference over its expanded uncertainty, E_n of ISO 13528."""
        return self.difference / (COVERAGE * self.u)

    @property
    def agrees(self) -> bool:
        """Whether chance gives such a difference more often than once in a thousand."""
        return abs(self.difference) <= DENIED * self.u

    def to_data(self) -> Mapping[str, object]:
        """Return what the result holds of it."""
        return {
            "value": self.in_coil.value,
            "standard_uncertainty": self.in_coil_u,
            "contributions": dict(self.in_coil_parts),
            "difference": self.difference,
            "difference_uncertainty": self.u,
            "normalised_error": self.normalised_error,
            **self.in_coil.extra,
        }


def compare(
    of_turns: Sequence[Estimate], in_coil: Sequence[Estimate], inputs: Sequence[InputQuantity]
) -> list[Compared]:
    """Return each result that both ways determine; `inputs` are those of the coil."""
    own = {(e.name, e.axis): e for e in of_turns if e.value is not None}
    size = {known.name: known.standard_uncertainty or 0.0 for known in inputs}
    compared = []
    for estimate in in_coil:
        by_turns = own.get((estimate.name, estimate.axis))
        if by_turns is not None:
            parts = {name: size[name] * abs(by) for name, by in estimate.sensitivities.items()}
            parts["repeatability"] = estimate.standard_uncertainty or 0.0
            u = by_turns.standard_uncertainty or 0.0
            compared.append(Compared(by_turns, u, estimate, parts))
    return compared


def disagreements(compared: Sequence[Compared]) -> Iterator[Flag]:
    """Yield a flag for each kind of result in which the two ways deny each other."""
    for name, (statement, look) in DENIES.items():
        off = [c for c in compared if c.of_turns.name == name and not c.agrees]
        if off:
            values = ", ".join(f"{c.of_turns.axis} {c.normalised_error:.1f}" for c in off)
            text = (
                f"{name.replace('_', ' ').capitalize()} in the coil and by the turns in the "
                "earth's field differ by more than their uncertainties allow; difference over "
                f"its expanded uncertainty: {values}. Look at {look}."
            )
            largest = max((c.normalised_error for c in off), key=abs)
            axes = [c.of_turns.axis for c in off]
            yield contradiction(statement, text, axes=axes, normalised_error=largest)


def not_as_commanded(record: CoilRecord) -> Iterator[Flag]:
    """Yield a flag for each coil whose field, as it was read, is not what was commanded."""
    if record.commanded_nT is None:
        return
    for k, axis in enumerate(AXES):
        commanded = record.commanded_nT[:, k]
        driven = commanded - commanded.mean()
        if not driven.any():
            continue
        off = float(driven @ record.applied_nT[:, k] / (driven @ driven)) - 1.0
        if abs(off) > FlagThresholds.field_differs_from_commanded:
            text = (
                f"The field of coil {axis.lower()} differs by {100.0 * off:+.3g} % from what was "
                "commanded, as the gaussmeter reads it; the results use what was read. Check the "
                "coil constant in the bench file, the coil's supply, and the gaussmeter."
            )
            yield Flag("field-differs-from-commanded", text, axis, {"relative_difference": off})
