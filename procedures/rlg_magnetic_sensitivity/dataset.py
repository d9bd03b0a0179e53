"""What the analysis of the magnetic sensitivity needs, whoever recorded it, and what it returns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from procedures.estimation.allan import AllanDeviation, NoiseCoefficients
from procedures.estimation.noise import grid_index
from station.findings import Analysis

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
    """All segments of one gyro: one per driven axis of a run, or one imported record."""

    segments: tuple[Segment, ...]


@dataclass(frozen=True)
class LineDetail:
    """One driven axis of one segment: its line in the field and in the gyro's output.

    Phasors are Re(X exp(2 pi j f (t - segment middle))), both corrected for interval averaging:
    the gyro's in deg/h, the field's amplitude in mT and phase in deg; `field_uncertainty_mT` (3,)
    is the standard uncertainty of a part, real or imaginary, of each. `slope` and `quadrature`
    (deg/h/mT) are the parts of the gyro phasor, other axes taken off, along and across the field;
    `quadratic` (deg/h/mT^2) is the axis's second-order term from all lines at 2f.
    `upper_bound` (95 %, one-sided, on |S|) is given where the axis is not significant.
    """

    segment: int
    axis: str
    frequency_Hz: float
    frequency_uncertainty_Hz: float
    field_amplitude_mT: float
    field_phase_deg: float
    field_phasors_mT: Complex
    field_uncertainty_mT: Array
    ambient_field_mT: Array
    gyro_phasor_deg_per_h: complex | None
    gyro_phase_deg: float | None
    slope: float | None
    slope_uncertainty: float | None
    quadrature: float | None
    quadrature_uncertainty: float | None
    quadratic: float | None
    quadratic_uncertainty: float | None
    quadratic_corrected: bool
    significance: float | None
    upper_bound: float | None
    noise_floor_deg_per_h: float | None


@dataclass(frozen=True)
class SegmentDetail:
    """What the report plots of one segment.

    `kept` marks the samples that the fit used. `spectrum_*` is the published amplitude spectrum for
    k = 0..N/2 (about the mean, missing samples left out, where rows are missing);
    `noise_floor_deg_per_h` is its expected root mean square ordinate next to the first driven line
    if there were no line. `drift_order` is the order of the fit; `drift_evident` says whether the
    data prove any drift. The drift and lines are in `model_deg_per_h`. `allan` is the Allan
    deviation of the output without the fitted lines, `noise` what it is made of.
    """

    axes: tuple[str, ...]
    time_s: Array
    rate_deg_per_h: Array
    model_deg_per_h: Array
    residual_deg_per_h: Array
    kept: Mask
    drift_order: int
    drift_evident: bool
    autoregression_order: int
    lag_one_correlation: float
    residual_sigma_deg_per_h: float
    spectrum_frequency_Hz: Array
    spectrum_deg_per_h: Array
    noise_floor_deg_per_h: float | None
    field_rows_rejected: int
    allan: AllanDeviation
    noise: NoiseCoefficients | None

    @property
    def axis(self) -> str | None:
        """The driven axis, None where several are."""
        return self.axes[0] if len(self.axes) == 1 else None


@dataclass(frozen=True)
class RlgAnalysis(Analysis):
    """The whole outcome; `covariance` (k, k, type A) is that of the estimates `determined`.

    Sensitivities of the estimates are derivatives by `field_gain` and `gyro_scale` (relative
    errors), `field_time_offset_s` (s, of the field's time stamps) and `undriven_NA` and so on, the
    sensitivity of an axis that was not driven.
    """

    determined: tuple[str, ...]
    covariance: Array
    lines: tuple[LineDetail, ...]
    segments: tuple[SegmentDetail, ...]


def middle_of(record: Segment | SegmentDetail) -> float:
    """Return the middle of a record in s, where its phasors have their phase."""
    finite = np.isfinite(record.time_s) & np.isfinite(record.rate_deg_per_h)
    time_s = record.time_s[finite]
    return 0.5 * float(time_s[0] + time_s[-1]) if len(time_s) else 0.0
