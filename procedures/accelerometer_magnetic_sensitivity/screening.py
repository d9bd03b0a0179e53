"""Rows that are no measurement: overload, readings of field or temperature that cannot be."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .dataset import AccelerometerDataset
from .findings import LeftOut

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

WILD_FIELD = 0.25
"""Of the largest commanded field: a reading further from the others cannot be the coil's field."""
WILD_TEMPERATURE_K = 5.0
"""From the median of the rows around it: no accelerometer warms up so fast."""
WILD_SPREADS = 20.0
NEIGHBOURS = 5
FEWEST_FROZEN = 10
USUALLY_NEW = 0.5
"""Of the other readings: a thermometer that repeats itself anyway is coarse, and not frozen."""


def screen(dataset: AccelerometerDataset) -> tuple[Mask, tuple[LeftOut, ...]]:
    """Return which rows (n,) can be used at all, and why the others cannot.

    A wild reading of field or temperature must be found here: its row bends the model towards
    itself and leaves no residual. What is wrong by less shows in the residual of the output.
    """
    reasons: dict[int, str] = {}

    def note(rows: Mask, reason: str) -> None:
        for row in np.flatnonzero(rows):
            reasons.setdefault(int(row), reason)

    note(dataset.overloaded, "overload of the voltmeter")
    note(~np.isfinite(dataset.theta_deg), "no angle")
    note(~np.isfinite(dataset.theta_commanded_deg), "angle off the plan's grid")
    note(~np.isfinite(dataset.field_T), "no reading of the field")
    note(wild_field(dataset.field_T, dataset.field_commanded_T), "wild reading of the field")
    if dataset.temperature_degC is not None:
        note(wild_temperature(dataset.temperature_degC), "wild reading of the temperature")
    good = np.ones(len(dataset), dtype=bool)
    good[list(reasons)] = False
    return good, tuple(LeftOut(row, reasons[row]) for row in sorted(reasons))


def wild_field(field_T: Array, commanded_T: Array) -> Mask:
    """Return which readings lie far from what the others say of the commanded field, (n,)."""
    finite = np.isfinite(field_T)
    if not bool(finite.any()):
        return ~finite
    largest_T = float(np.max(np.abs(commanded_T)))
    strong = finite & (np.abs(commanded_T) > 0.2 * largest_T)
    gain = float(np.median(field_T[strong] / commanded_T[strong])) if bool(strong.any()) else 1.0
    off = field_T - gain * commanded_T
    middle = float(np.median(off[finite]))
    spread = float(np.median(np.abs(off[finite] - middle)))
    far = np.abs(off - middle) > max(WILD_FIELD * largest_T, WILD_SPREADS * spread)
    return ~finite | (far & (largest_T > 0.0))


def wild_temperature(temperature_degC: Array) -> Mask:
    """Return which readings lie far from those before and after them, (n,)."""
    finite = np.isfinite(temperature_degC)
    if not bool(finite.any()):
        return ~finite
    padded = np.pad(temperature_degC, NEIGHBOURS, mode="reflect") if len(finite) > 5 else None
    if padded is None:
        around = np.full(len(finite), float(np.nanmedian(temperature_degC)))
    else:
        around = np.nanmedian(
            np.lib.stride_tricks.sliding_window_view(padded, 2 * NEIGHBOURS + 1), axis=1
        )
    off = np.abs(temperature_degC - around)
    spread = float(np.nanmedian(off))
    wild = ~finite | (off > max(WILD_TEMPERATURE_K, WILD_SPREADS * spread))
    return np.asarray(wild, dtype=np.bool_)


def frozen_temperature(temperature_degC: Array) -> Mask:
    """Return which readings (n,) repeat the one before to the last digit, ten and more in a row.

    A thermometer that stands still measures nothing, and what warms the device goes unseen.
    """
    frozen = np.zeros(len(temperature_degC), dtype=bool)
    if len(frozen) < FEWEST_FROZEN:
        return frozen
    new = np.append(True, temperature_degC[1:] != temperature_degC[:-1])
    starts = np.flatnonzero(new)
    for start, length in zip(starts, np.diff(np.append(starts, len(new))), strict=True):
        if length >= FEWEST_FROZEN:
            frozen[start : start + length] = True
    others = new[~frozen]
    return frozen if not len(others) or float(others.mean()) > USUALLY_NEW else frozen & False
