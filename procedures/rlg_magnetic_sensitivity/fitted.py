"""Records with what was fitted to them, and the outcome that is made of them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from procedures.estimation.allan import (
    AllanDeviation,
    NoiseCoefficients,
    allan_deviation,
    noise_coefficients,
)
from procedures.estimation.noise import grid_index
from station.findings import Analysis

from .dataset import AXES, Array, Segment
from .field import FieldFit, FieldLine, fit_field
from .gyro import GyroFit, fit_gyro, no_fit
from .parameters import AnalysisSettings


@dataclass(frozen=True)
class FittedRecord:
    """A segment with the fits of its field and of its output, which has the field's lines first.

    `usable[k]` says whether line k may speak for the sensitivity or was fitted only to be out of
    the way of the others; where `fitted` is false no line was.
    """

    segment: Segment
    field: FieldFit
    gyro: GyroFit
    usable: tuple[bool, ...]

    @property
    def fitted(self) -> bool:
        """Whether there is a fit of the output."""
        return len(self.gyro.phasor_deg_per_h) > 0

    @property
    def axes(self) -> tuple[str, ...]:
        """The driven axes."""
        return tuple(axis for axis in AXES if axis in self.segment.drive)

    @property
    def axis(self) -> str | None:
        """The driven axis, None where several are."""
        return self.axes[0] if len(self.axes) == 1 else None

    @property
    def named(self) -> str:
        """The driven axes as a sentence names them."""
        return " and ".join(self.axes)

    @cached_property
    def allan(self) -> AllanDeviation:
        """The Allan deviation of the output without the fitted lines, drift and all."""
        interval_s, kept = self.segment.sample_interval_s, self.gyro.kept
        if not self.fitted or not kept.any():
            return allan_deviation(np.zeros(0), interval_s)
        noise = self.segment.rate_deg_per_h - self.gyro.lines_deg_per_h
        index = grid_index(self.segment.time_s, interval_s)[kept]
        return allan_deviation(noise[kept], interval_s, index - index[0])

    @cached_property
    def noise(self) -> NoiseCoefficients | None:
        """What the Allan deviation is made of."""
        return noise_coefficients(self.allan)

    @property
    def random_walk_deg_per_sqrt_h(self) -> float:
        """The angle random walk of the output, 0 where it is not known."""
        return self.noise.angle_random_walk_deg_per_sqrt_h if self.noise else 0.0

    @property
    def mean_deg_per_h(self) -> float:
        """The mean of the samples that the fit used."""
        used = self.segment.rate_deg_per_h[self.gyro.kept]
        return float(np.mean(used)) if len(used) else 0.0


@dataclass(frozen=True)
class LineDetail:
    """One driven axis of one segment: its line in the field and in the gyro's output.

    Phasors are Re(X exp(2 pi j f (t - segment middle))), both corrected for interval averaging.
    `slope` and `quadrature` (deg/h/mT) are the parts of the gyro phasor, other axes taken off,
    along and across the field; `quadratic` (deg/h/mT^2) is the axis's second-order term from all
    lines at 2f. `upper_bound` (95 %, one-sided, on |S|) is given where the axis is not significant.
    """

    segment: int
    axis: str
    field: FieldLine
    ambient_field_mT: Array
    gyro_phasor_deg_per_h: complex | None = None
    noise_floor_deg_per_h: float | None = None
    slope: float | None = None
    slope_uncertainty: float | None = None
    quadrature: float | None = None
    quadrature_uncertainty: float | None = None
    quadratic: float | None = None
    quadratic_uncertainty: float | None = None
    quadratic_corrected: bool = False
    significance: float | None = None
    upper_bound: float | None = None

    @property
    def frequency_Hz(self) -> float:
        """The frequency as it was fitted to the field."""
        return self.field.frequency_Hz

    @property
    def own_field_mT(self) -> complex:
        """The phasor of the field on the axis."""
        return complex(self.field.phasor_mT[AXES.index(self.axis)])

    @property
    def field_phase_deg(self) -> float:
        """The phase of the field on the axis."""
        return float(np.degrees(np.angle(self.own_field_mT)))


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
    segments: tuple[FittedRecord, ...]


def fit_record(
    segment: Segment, settings: AnalysisSettings, reasons: dict[str, str]
) -> FittedRecord:
    """Fit a segment's field, and its output at the field's lines; note why some cannot be used."""
    field = fit_field(segment)
    problems = [line.problem or _unresolved(segment, line, settings) for line in field.lines]
    gyro: GyroFit | None = None
    if None in problems:
        gyro = fit_gyro(segment, [line.frequency_Hz for line in field.lines], settings)
        if gyro is None:
            short = f"{len(segment.time_s)} gyro samples are too few for the model"
            problems = [problem or short for problem in problems]
    for line, problem in zip(field.lines, problems, strict=True):
        if problem is not None:
            reasons.update(dict.fromkeys(line.axes, problem))
    usable = tuple(problem is None for problem in problems)
    return FittedRecord(segment, field, gyro or no_fit(segment), usable)


def _unresolved(segment: Segment, line: FieldLine, settings: AnalysisSettings) -> str | None:
    frequency_Hz, span_s = line.frequency_Hz, segment.span_s
    if frequency_Hz * segment.sample_interval_s >= settings.highest_frequency:
        return (
            f"{frequency_Hz:.4g} Hz is too close to half the sampling rate of the gyro "
            f"(limit {settings.highest_frequency:g} of the rate)"
        )
    if frequency_Hz * span_s < settings.fewest_cycles:
        return (
            f"the record holds only {frequency_Hz * span_s:.3g} cycles of the field, "
            f"{settings.fewest_cycles:g} are needed"
        )
    if float(np.ptp(segment.rate_deg_per_h)) == 0.0:
        return "the gyro's output never changes"
    start_s = max(float(segment.time_s[0]), float(segment.field_time_s[0]))
    stop_s = min(float(segment.time_s[-1]), float(segment.field_time_s[-1]))
    if stop_s - start_s < 0.5 * span_s:
        return "the field was measured during less than half of the gyro record"
    return None
