"""Flags that several procedures raise, worded once: gaps, stiff models, fields.

A result holds for the measured field, so that a small difference from the commanded one spoils
nothing. Beyond the bound nobody knows what the device was exposed to, and nothing is decided.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station.findings import NOT_IDENTIFIABLE, Flag

LARGEST_ERROR = 0.5
"""Part of the commanded field by which the measured one may differ."""
SEEN = 0.1
"""Part of the commanded field below which a coil makes none."""


MAX_LISTED = 12


@dataclass(frozen=True)
class Gaps:
    """Gaps of records: how many, samples that are missing in them, and the longest in s."""

    count: int = 0
    missing: int = 0
    longest_s: float = 0.0

    def __add__(self, other: Gaps) -> Gaps:
        return Gaps(
            self.count + other.count,
            self.missing + other.missing,
            max(self.longest_s, other.longest_s),
        )

    @property
    def details(self) -> dict[str, object]:
        """What stands beside the flag of the gaps."""
        return {"count": self.count, "missing_samples": self.missing, "longest_s": self.longest_s}

    def flags(
        self, subject: str, nominal_s: float, consequence: str, axis: str | None = None
    ) -> list[Flag]:
        """Return the flag of the gaps, or none; the subject is such as `The rows have`."""
        if not self.count:
            return []
        gap_text = (
            f"{subject} {counted(self.count, 'gap')}, the longest {self.longest_s:g} s for a "
            f"nominal interval of {nominal_s:g} s; {consequence}."
        )
        return [Flag("gap", gap_text, axis, self.details)]


def gaps_of(time_s: NDArray[np.float64], nominal_s: float, wider: float) -> Gaps:
    """Return the intervals between times (n,) that are longer than `wider` nominal ones."""
    steps_s = np.diff(time_s)
    wide_s = steps_s[steps_s > wider * nominal_s]
    if not len(wide_s):
        return Gaps()
    missing = int(np.sum(np.rint(wide_s / nominal_s) - 1.0))
    return Gaps(len(wide_s), missing, float(wide_s.max()))


def not_identifiable(
    message: str, coefficients: Sequence[str], axis: str | None = None, **details: object
) -> Flag:
    """Return the flag of quantities that the data do not determine."""
    return Flag(NOT_IDENTIFIABLE, message, axis, {"coefficients": [*coefficients], **details})


def too_stiff(
    lag_one: float,
    of: str = "",
    follows: str = "the model does not follow the output",
    axis: str | None = None,
) -> Flag:
    """Return the flag of a model whose residuals are correlated; `of` is such as ` of a shot`."""
    stiff_text = f"Neighbouring residuals{of} are correlated by {lag_one:.2f}: {follows}."
    return Flag("model-too-stiff", stiff_text, axis, {"lag_one_correlation": lag_one})


def counted(count: int, noun: str) -> str:
    """Return a number of things: `1 gap`, `2 gaps`."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def rows_listed(rows: Sequence[int]) -> str:
    """Return the first rows as text, `rows 3, 7, 12 and more, counted from 0`."""
    shown = ", ".join(str(row) for row in rows[:MAX_LISTED])
    more = " and more" if len(rows) > MAX_LISTED else ""
    return f"rows {shown}{more}, counted from 0"


def excitation_flags(
    coil: str,
    own: str,
    seen: Mapping[str, float],
    commanded: tuple[float, str],
    axis: str | None = None,
) -> list[Flag]:
    """Return the flag of a coil whose field is missing or wrong by more than the bound, or none.

    `seen` holds the measured field over the commanded one by axis, with a sign where that is known,
    and without the axes that were not measured or that another coil drives alike; `own` is the axis
    of the coil, `commanded` its field with the unit.
    """
    share = seen[own]
    if abs(share - 1.0) <= LARGEST_ERROR:
        return []
    details: dict[str, object] = {"coil": coil, "relative_difference": share - 1.0}
    elsewhere = {other: abs(size) for other, size in seen.items() if other != own}
    most = max(elsewhere, key=lambda other: elsewhere[other], default=own)
    if elsewhere and elsewhere[most] >= max(1.0 - LARGEST_ERROR, abs(share)):
        details["appears_on"] = most
        what = f"appears on axis {most}"
        why = (
            f"are the coils or the supplies of {own} and {most} exchanged? Look at the cables and "
            "at the addresses in the bench file"
        )
    elif share <= LARGEST_ERROR - 1.0:
        what = "is reversed"
        why = "exchange the two leads of the coil, or turn the probe that measures the field"
    elif max(abs(share), elsewhere.get(most, 0.0)) < SEEN:
        what = "appears on no axis" if elsewhere else "is missing"
        why = (
            "are two supplies exchanged? Look whether the coil is connected, at the output of its "
            "supply, and at what measures the field"
        )
    else:
        what = "is too weak" if share < 1.0 else "is too strong"
        why = (
            "look at the coil's constant and the supply's voltage limit in the bench file, at the "
            "coil's cable, for a field that nobody commanded, and at what measures the field: its "
            "unit, its range"
        )
    field, unit = commanded
    return [
        Flag(
            "wrong-excitation",
            f"The field of coil {coil} {what}: {share * field:.3g} {unit} of the commanded "
            f"{field:.5g} {unit} was measured on its own axis. There is no verdict on the device; "
            f"{why}.",
            axis,
            details,
        )
    ]
