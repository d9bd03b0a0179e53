"""The analysis of a laser gyro's magnetic sensitivity: a pure function of the dataset."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.special import stdtrit

from station.findings import Estimate, Flag, undetermined

from .checks import beat_flags, collisions, record_flags, recorder_findings, statement_flags
from .dataset import AXES, METHOD, QUANTITY, UNDRIVEN, UNIT, RlgDataset
from .fitted import FittedRecord, LineDetail, RlgAnalysis, fit_record
from .flags import cross_axis_flags, drive_flags, field_flags, result_flags
from .gyro import published_value
from .parameters import AnalysisSettings
from .response import AxisResponse, Response, solve
from .steadiness import steadiness_flags

MAX_IN_DOUBT = 0.5


def analyse(dataset: RlgDataset, settings: AnalysisSettings | None = None) -> RlgAnalysis:
    """Estimate the magnetic sensitivity of every axis that the dataset drives.

    The frequency of each line is fitted to the measured field and held for the gyro; the gyro's
    lines are regressed beside drift and second harmonics, corrected for interval averaging, and
    divided by the measured field with all axes solved together. Deterministic; raises nothing for
    poor data: what they do not determine is None and flagged `not-identifiable`. Beside it stands
    what steps S5 to S7 of the source document give on the same samples.
    """
    settings = settings or AnalysisSettings()
    reasons: dict[str, str] = {}
    records = [fit_record(segment, settings, reasons) for segment in dataset.segments]
    flags: list[Flag] = []
    doubts: dict[str, float] = {}
    for number, record in enumerate(records):
        recorder_flags, doubt = recorder_findings(record)
        flags += [*statement_flags(record), *collisions(record.segment)]
        flags += [*recorder_flags, *steadiness_flags(record)]
        if doubt > MAX_IN_DOUBT:
            reason = "its record is cut or rounded too much, see the other flags"
            reasons |= dict.fromkeys(record.axes, reason)
            records[number] = replace(record, usable=(False,) * len(record.usable))
        else:
            doubts |= {axis: max(doubts.get(axis, 0.0), doubt) for axis in record.axes}
    response = solve(records, doubts)
    entangled = "its field cannot be distinguished from that of another driven axis"
    reasons |= dict.fromkeys(response.entangled, entangled)
    driven = [axis for axis in AXES if any(axis in s.drive for s in dataset.segments)]
    estimates = tuple(_estimate(axis, response.axes.get(axis)) for axis in driven)
    lines: list[LineDetail] = []
    for number, record in enumerate(records):
        own = [
            _line(number, k, axis, record, response, settings)
            for axis in AXES
            for k, line in enumerate(record.field.lines)
            if axis in line.axes
        ]
        flags += [*field_flags(record), *record_flags(record, settings)]
        flags += [*drive_flags(record.segment, own, settings), *beat_flags(record)]
        lines += own
    flags += result_flags(estimates, lines, reasons, settings)
    flags += cross_axis_flags(estimates, settings)
    # As S3 to S8 do it once: from the first segment that drives an axis.
    first = {axis: next(s for s in dataset.segments if axis in s.drive) for axis in driven}
    return RlgAnalysis(
        estimates=estimates,
        determined=tuple(response.axes),
        covariance=response.covariance,
        published=tuple(published_value(segment, axis) for axis, segment in first.items()),
        flags=tuple(flags),
        lines=tuple(lines),
        segments=tuple(records),
    )


def _estimate(axis: str, solved: AxisResponse | None) -> Estimate:
    if solved is None:
        return undetermined(QUANTITY, axis, UNIT, METHOD)
    value, freedom = solved.sensitivity, solved.degrees_of_freedom
    return Estimate(
        QUANTITY,
        axis,
        value,
        UNIT,
        solved.uncertainty,
        freedom if np.isfinite(freedom) else None,
        METHOD,
        {
            "field_gain": -value,
            "field_time_offset_s": solved.time_slope,
            "gyro_scale": value,
            **{f"{UNDRIVEN}{other}": -share for other, share in solved.undriven.items()},
        },
    )


def _line(
    number: int,
    k: int,
    axis: str,
    record: FittedRecord,
    response: Response,
    settings: AnalysisSettings,
) -> LineDetail:
    line = LineDetail(number, axis, record.field.lines[k], record.field.ambient_mT)
    if record.fitted:
        line = replace(
            line,
            gyro_phasor_deg_per_h=complex(record.gyro.phasor_deg_per_h[k]),
            noise_floor_deg_per_h=float(record.gyro.noise_floor_deg_per_h[k]),
        )
    solved = response.axes.get(axis)
    if solved is None:
        return line
    value, u = solved.sensitivity, solved.uncertainty
    bound = None
    if abs(value) < settings.not_significant * u:
        bound = abs(value) + float(stdtrit(min(solved.degrees_of_freedom, 1e6), 0.95)) * u
    line = replace(
        line,
        quadratic=solved.quadratic,
        quadratic_uncertainty=solved.quadratic_uncertainty,
        quadratic_corrected=solved.quadratic_corrected,
        significance=abs(value) / u if u else None,
        upper_bound=bound,
    )
    residual = response.residuals.get((number, k, axis))
    if residual is None:
        return line
    tested = residual.quadrature_uncertainty is not None
    return replace(
        line,
        slope=value + residual.slope,
        slope_uncertainty=residual.slope_uncertainty,
        quadrature=residual.quadrature if tested else None,
        quadrature_uncertainty=residual.quadrature_uncertainty,
    )
