"""What the analysis of the magnetic sensitivity needs, whoever recorded it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from procedures.common.helmholtz import FieldAtDevice
from procedures.estimation.noise import grid_index

from .frequencies import Drive

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Mask = NDArray[np.bool_]

AXES = ("IA", "NA", "LA")
QUANTITY = "magnetic_sensitivity"
UNIT = "deg/h/mT"
UNDRIVEN = "undriven_"
"""Begins the name of the input quantity that is the sensitivity of an axis not driven."""
METHOD = "least-squares"


@dataclass(frozen=True)
class Averaged:
    """A record as it was before its samples were averaged in groups of `group`.

    `samples` of its `places` were there, `rejected` of them wild; `gaps` and the longest of them in
    s are those between samples; `rejected_field_rows` are wild readings of the field.
    `amplitude_deg_per_h` is what the published formula reads by axis, None where it cannot run.
    """

    group: int
    sample_interval_s: float
    samples: int
    places: int
    rejected: int
    gaps: int
    longest_gap_s: float
    rejected_field_rows: int
    amplitude_deg_per_h: Mapping[str, float | None]


@dataclass(frozen=True)
class Segment:
    """One uninterrupted stretch of recording with one or several coil axes driven, or none.

    A drive with an amplitude of zero names a line that is only looked for.

    `time_s` (n,) is the middle of each gyro averaging interval, ascending, gaps possible;
    `rate_deg_per_h` (n,) is the interval's mean; `quantum_deg_per_h` is one pulse expressed as a
    rate, 0 when the output is not counts. `field_mT` (m, 3) is the field on the gyro's axes
    IA, NA, LA, ambient field included, at `field_time_s` (m,), the middle of the gaussmeter's
    averaging over `field_averaging_s` (0 = instantaneous). All this describes the record as it is
    here; where it was longer, `averaged` says what it was before.
    """

    drive: Mapping[str, Drive]
    sample_interval_s: float
    time_s: Array
    rate_deg_per_h: Array
    quantum_deg_per_h: float
    field_time_s: Array
    field_mT: Array
    field_averaging_s: float
    averaged: Averaged | None = None

    @property
    def places(self) -> int:
        """The samples that the record would have without gaps."""
        if not len(self.time_s):
            return 0
        return int(grid_index(self.time_s, self.sample_interval_s)[-1]) + 1

    @property
    def middle_s(self) -> float:
        """The middle of the samples in s, where phasors have their phase."""
        time_s = self.time_s[np.isfinite(self.time_s) & np.isfinite(self.rate_deg_per_h)]
        return 0.5 * float(time_s[0] + time_s[-1]) if len(time_s) else 0.0

    @property
    def span_s(self) -> float:
        """The length of the record as it is here."""
        return self.places * self.sample_interval_s

    @property
    def recorded_span_s(self) -> float:
        """The length of the record as it was recorded."""
        before = self.averaged
        return self.span_s if before is None else before.places * before.sample_interval_s


@dataclass(frozen=True)
class RlgDataset:
    """All segments of one gyro: one per driven axis of a run, or one imported record.

    Their fields are those at the gyro by `at_device`; without it, as they were measured beside it.
    """

    segments: tuple[Segment, ...]
    at_device: FieldAtDevice | None = None
