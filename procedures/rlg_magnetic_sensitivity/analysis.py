"""The analysis of a laser gyro's magnetic sensitivity: a pure function of the dataset."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import stdtrit

from procedures.estimation.allan import AllanDeviation, allan_deviation, noise_coefficients
from procedures.estimation.noise import grid_index
from station.findings import Estimate, Flag, Published, undetermined

from .checks import (
    beat_flags,
    collisions,
    condition_flags,
    output_flags,
    overtone_flags,
    recorder_findings,
)
from .dataset import (
    AXES,
    METHOD,
    QUANTITY,
    UNDRIVEN,
    UNIT,
    LineDetail,
    RlgAnalysis,
    RlgDataset,
    Segment,
    SegmentDetail,
    middle_of,
)
from .field import FieldFit, fit_field
from .flags import cross_axis_flags, drive_flags, field_flags, record_flags, result_flags
from .gyro import GyroFit, fit_gyro, plotted_spectrum, published_value
from .parameters import AnalysisSettings
from .response import Observed, Response, in_doubt, solve
from .steadiness import steadiness_flags

MAX_IN_DOUBT = 0.5

__all__ = ["AnalysisSettings", "RlgAnalysis", "analyse", "published_value"]


def analyse(dataset: RlgDataset, settings: AnalysisSettings | None = None) -> RlgAnalysis:
    """Estimate the magnetic sensitivity of every axis that the dataset drives.

    The frequency of each line is fitted to the measured field and held for the gyro; the gyro's
    lines are regressed beside drift and second harmonics, corrected for interval averaging, and
    divided by the measured field with all axes solved together. Deterministic; raises nothing for
    poor data: what they do not determine is None and flagged `not-identifiable`. Beside it stands
    what steps S5 to S7 of the source document give on the same samples.
    """
    settings = settings or AnalysisSettings()
    fields: list[FieldFit] = []
    observed: list[Observed | None] = []
    reasons: dict[str, str] = {}
    for segment in dataset.segments:
        field = fit_field(segment, middle_of(segment))
        fields.append(field)
        observed.append(_observe(segment, field, settings, reasons))
    segments = [
        _segment_detail(segment, field, record)
        for segment, field, record in zip(dataset.segments, fields, observed, strict=True)
    ]
    recorded, doubts = _recorder(dataset, fields, observed, segments, reasons)
    response = in_doubt(solve(observed), doubts)
    driven = tuple(a for a in AXES if any(a in s.drive for s in dataset.segments))
    for axis, known in zip(response.axes, response.determined, strict=True):
        if not known:
            reasons[axis] = "its field cannot be distinguished from that of another driven axis"
    determined = tuple(
        a for a, known in zip(response.axes, response.determined, strict=True) if known
    )
    places = [response.axes.index(a) for a in determined]
    estimates = tuple(_estimate(axis, response, determined) for axis in driven)
    lines: list[LineDetail] = []
    flags: list[Flag] = [*recorded]
    for number, segment in enumerate(dataset.segments):
        own = _lines(number, fields[number], observed[number], response, determined, settings)
        detail = segments[number]
        flags += field_flags(segment, fields[number])
        flags += record_flags(segment, detail, settings) + drive_flags(segment, own, settings)
        flags += beat_flags(segment, detail, own)
        lines += own
    flags += result_flags(estimates, lines, reasons, settings)
    flags += cross_axis_flags(estimates, settings)
    return RlgAnalysis(
        estimates=estimates,
        determined=determined,
        covariance=response.covariance[np.ix_(places, places)],
        published=_published(dataset, driven),
        flags=tuple(flags),
        lines=tuple(lines),
        segments=tuple(segments),
    )


def _recorder(
    dataset: RlgDataset,
    fields: Sequence[FieldFit],
    observed: list[Observed | None],
    details: Sequence[SegmentDetail],
    reasons: dict[str, str],
) -> tuple[list[Flag], dict[str, float]]:
    """Return the flags of what the data deny, and by axis the part of a result in doubt.

    A record of which half is in doubt is taken out of `observed`.
    """
    flags: list[Flag] = []
    doubts: dict[str, float] = {}
    for number, segment in enumerate(dataset.segments):
        detail, record = details[number], observed[number]
        flags += [*condition_flags(segment), *collisions(segment), *output_flags(segment, detail)]
        if record is None:
            continue
        recorder_flags, doubt = recorder_findings(segment, fields[number], record.gyro, detail)
        flags += [*recorder_flags, *overtone_flags(segment, record.gyro, detail)]
        middle_s = middle_of(segment)
        flags += steadiness_flags(segment, fields[number], record.gyro, record.lines, middle_s)
        if doubt > MAX_IN_DOUBT:
            reason = "its record is cut or rounded too much, see the other flags"
            reasons.update(dict.fromkeys(detail.axes, reason))
            observed[number] = None
        elif doubt > 0.0:
            doubts.update({a: max(doubts.get(a, 0.0), doubt) for a in detail.axes})
    return flags, doubts


def _observe(
    segment: Segment, field: FieldFit, settings: AnalysisSettings, reasons: dict[str, str]
) -> Observed | None:
    """Fit the gyro at the lines that it can resolve; note why the others cannot be used."""
    problems = [
        line.problem or _unresolved(segment, k, field, settings)
        for k, line in enumerate(field.lines)
    ]
    chosen = [k for k in range(len(field.lines)) if _worth_fitting(segment, field, k)]
    usable = [problems[k] is None for k in chosen]
    gyro: GyroFit | None = None
    if any(usable):
        gyro = fit_gyro(segment, [field.lines[k].frequency_Hz for k in chosen], settings)
        if gyro is None:
            short = f"{len(segment.time_s)} gyro samples are too few for the model"
            problems = [problem or short for problem in problems]
    for line, problem in zip(field.lines, problems, strict=True):
        if problem is not None:
            reasons.update(dict.fromkeys(line.axes, problem))
    if gyro is None:
        return None
    return Observed(field=field, gyro=gyro, lines=tuple(chosen), usable=tuple(usable))


def _unresolved(
    segment: Segment, k: int, field: FieldFit, settings: AnalysisSettings
) -> str | None:
    frequency_Hz = field.lines[k].frequency_Hz
    span_s = segment.span_s
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


def _worth_fitting(segment: Segment, field: FieldFit, k: int) -> bool:
    """Lines that are there but cannot be used are fitted too, to be out of the others' way."""
    frequency_Hz = field.lines[k].frequency_Hz
    resolved = 1.0 / max(segment.span_s, 1e-9) < frequency_Hz
    apart = all(
        abs(frequency_Hz - field.lines[j].frequency_Hz) * segment.span_s >= 1.0 for j in range(k)
    )
    return resolved and apart and frequency_Hz * segment.sample_interval_s < 0.49


def _estimate(axis: str, response: Response, determined: tuple[str, ...]) -> Estimate:
    if axis not in determined:
        return undetermined(QUANTITY, axis, UNIT, METHOD)
    a = response.axes.index(axis)
    value = float(response.sensitivity[a])
    freedom = float(response.degrees_of_freedom[a])
    return Estimate(
        QUANTITY,
        axis,
        value,
        UNIT,
        float(np.sqrt(response.covariance[a, a])),
        freedom if np.isfinite(freedom) else None,
        METHOD,
        {
            "field_gain": -value,
            "field_time_offset_s": float(response.time_slope[a]),
            "gyro_scale": value,
            **{f"{UNDRIVEN}{b}": -float(by[a]) for b, by in response.undriven.items()},
        },
    )


def _published(dataset: RlgDataset, driven: Sequence[str]) -> tuple[Published, ...]:
    """One value per axis: from the first segment that drives it, as S3 to S8 do it once."""
    first = {a: next(s for s in dataset.segments if a in s.drive) for a in driven}
    return tuple(published_value(first[axis], axis) for axis in driven)


def _segment_detail(segment: Segment, field: FieldFit, observed: Observed | None) -> SegmentDetail:
    axes = tuple(a for a in AXES if a in segment.drive)
    frequency_Hz, amplitude = plotted_spectrum(segment)
    blank = np.full(len(segment.time_s), np.nan)
    gyro = observed.gyro if observed is not None else None
    allan = _allan_of_noise(segment, gyro)
    return SegmentDetail(
        axes=axes,
        time_s=segment.time_s,
        rate_deg_per_h=segment.rate_deg_per_h,
        model_deg_per_h=gyro.model_deg_per_h if gyro else blank,
        residual_deg_per_h=gyro.residual_deg_per_h if gyro else blank,
        kept=gyro.kept if gyro else np.isfinite(segment.rate_deg_per_h),
        drift_order=gyro.drift_order if gyro else 0,
        drift_evident=gyro.drift_evident if gyro else False,
        autoregression_order=gyro.autoregression_order if gyro else 0,
        lag_one_correlation=gyro.lag_one_correlation if gyro else 0.0,
        residual_sigma_deg_per_h=gyro.residual_sigma_deg_per_h if gyro else float("nan"),
        spectrum_frequency_Hz=frequency_Hz,
        spectrum_deg_per_h=amplitude,
        noise_floor_deg_per_h=float(gyro.noise_floor_deg_per_h[0]) if gyro else None,
        field_rows_rejected=field.rows_rejected,
        allan=allan,
        noise=noise_coefficients(allan),
    )


def _allan_of_noise(segment: Segment, gyro: GyroFit | None) -> AllanDeviation:
    """Return the Allan deviation of the output without the fitted lines, drift and all."""
    if gyro is None or not bool(gyro.kept.any()):
        return allan_deviation(np.zeros(0), segment.sample_interval_s)
    noise = segment.rate_deg_per_h - gyro.lines_deg_per_h
    index = grid_index(segment.time_s, segment.sample_interval_s)[gyro.kept]
    return allan_deviation(noise[gyro.kept], segment.sample_interval_s, index - index[0])


def _lines(
    number: int,
    field: FieldFit,
    observed: Observed | None,
    response: Response,
    determined: tuple[str, ...],
    settings: AnalysisSettings,
) -> list[LineDetail]:
    result = []
    for axis in AXES:
        for k, line in enumerate(field.lines):
            if axis in line.axes:
                result.append(
                    _line(number, k, axis, field, observed, response, determined, settings)
                )
    return result


def _line(
    number: int,
    k: int,
    axis: str,
    field: FieldFit,
    observed: Observed | None,
    response: Response,
    determined: tuple[str, ...],
    settings: AnalysisSettings,
) -> LineDetail:
    line = field.lines[k]
    own = complex(line.phasor_mT[AXES.index(axis)])
    slot = observed.lines.index(k) if observed is not None and k in observed.lines else None
    phasor: complex | None = None
    floor: float | None = None
    if observed is not None and slot is not None:
        phasor = complex(observed.gyro.phasor_deg_per_h[slot])
        floor = float(observed.gyro.noise_floor_deg_per_h[slot])
    left = response.residuals.get((number, slot, axis)) if slot is not None else None
    known = axis in determined
    a = response.axes.index(axis) if known else -1
    value = float(response.sensitivity[a]) if known else None
    u = float(np.sqrt(response.covariance[a, a])) if known else None
    bound: float | None = None
    if value is not None and u is not None and abs(value) < settings.not_significant * u:
        freedom = min(float(response.degrees_of_freedom[a]), 1e6)
        bound = abs(value) + float(stdtrit(freedom, 0.95)) * u
    has_quadratic = known and bool(np.isfinite(response.quadratic[a]))
    tested = left is not None and left.quadrature_uncertainty is not None and known
    return LineDetail(
        segment=number,
        axis=axis,
        frequency_Hz=line.frequency_Hz,
        frequency_uncertainty_Hz=line.frequency_uncertainty_Hz,
        field_amplitude_mT=abs(own),
        field_phase_deg=float(np.degrees(np.angle(own))),
        field_phasors_mT=line.phasor_mT,
        field_uncertainty_mT=np.sqrt(line.variance_mT2),
        ambient_field_mT=field.ambient_mT,
        gyro_phasor_deg_per_h=phasor,
        gyro_phase_deg=float(np.degrees(np.angle(phasor))) if phasor is not None else None,
        slope=value + left.slope if value is not None and left is not None else None,
        slope_uncertainty=left.slope_uncertainty if known and left is not None else None,
        quadrature=left.quadrature if tested and left is not None else None,
        quadrature_uncertainty=left.quadrature_uncertainty if tested and left else None,
        quadratic=float(response.quadratic[a]) if has_quadratic else None,
        quadratic_uncertainty=(float(response.quadratic_uncertainty[a]) if has_quadratic else None),
        quadratic_corrected=bool(response.quadratic_corrected[a]) if known else False,
        significance=abs(value) / u if value is not None and u else None,
        upper_bound=bound,
        noise_floor_deg_per_h=floor,
    )
