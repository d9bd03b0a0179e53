"""Soaks of a record: where the set-point stands, and what the gyro reads at their ends."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .dataset import Array, TemperatureDataset

AT_THE_END_S = 1800.0
PART = 0.5
"""Of a soak that is shorter than twice that time."""


@dataclass(frozen=True)
class Soak:
    """The end of a soak: `rows` of the record, the mean temperature there in degC."""

    rows: slice
    temperature_degC: float


def soaks_of(dataset: TemperatureDataset, temperature: Array) -> tuple[Soak, ...]:
    """Return the end of each soak; `temperature` (n,) is that of the rows."""
    moved = np.diff(dataset.set_point_degC, prepend=np.nan) != 0.0
    changed = moved | (np.diff(dataset.soaking.astype(float), prepend=np.nan) != 0.0)
    begins = np.flatnonzero(changed)
    longest = max(1, round(AT_THE_END_S / dataset.sample_interval_s))
    soaks = []
    for start, stop in zip(begins.tolist(), [*begins[1:].tolist(), len(temperature)], strict=True):
        if dataset.soaking[start]:
            rows = slice(stop - min(longest, max(1, int(PART * (stop - start)))), stop)
            soaks.append(Soak(rows, float(np.mean(temperature[rows]))))
    return tuple(soaks)
