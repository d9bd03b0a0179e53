"""From data to findings: the analysis, with the gyro's bias as an input of type B."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from procedures.common.constants import ARCMIN_PER_RAD, EARTH_RATE_DEG_PER_H
from procedures.common.places import (
    gradient_inputs,
    place_flags,
    stated_gradient,
    tells_spread,
    with_gradient,
)
from station.files.faults import FaultList
from station.findings import (
    Analysis,
    Detail,
    Estimate,
    Findings,
    Flag,
    InputQuantity,
    Published,
    undetermined,
)

from .analysis import FogAnalysis, analyse
from .curve import Band, Curve
from .dataset import Drive, FogDataset
from .flags import WIDE
from .following import NAVIGATOR, ROOM_DEGC, TABLE
from .from_import import Conditions, dataset_of_import
from .navigation import ACCELEROMETER_BIAS, FIX, HEADING, LEVEL, NAMES, RUNS
from .parameters import PUBLISHED_SOAK_H, AnalysisSettings, Departure, FogParameters
from .solution import AxisFit
from .trials import LATITUDE, trials_of
from .verification import Driven, Verified

if TYPE_CHECKING:
    from station.dataset_reading import RawDataset
    from station.instruments.bench import Bench
    from station.record.folder import RunFolder

BIAS = "gyro_bias"
TABLE_ANGLE = "table_angle_deg"
CHECKS = "checks"
ABOUT_WARMTH = "offset of the gyro's thermometer, where another one compensates by the curve"
CONDITIONS = "the dataset's conditions"
WARMTH = "thermometer_degC"
BAND_POINTS = 21
WIDEST_DEGC = WIDE * AnalysisSettings().temperature_gap_degC


def findings_of_run(folder: RunFolder, parameters: FogParameters, bench: Bench) -> Findings:
    """Return what a run's finished turns say."""
    from .from_record import dataset_of_run

    dataset = dataset_of_run(folder, parameters, bench)
    analysis = analyse(dataset, settings(parameters))
    trials = trials_of(analysis, dataset, partial(_tried, settings=settings(parameters)))
    warmth = bench.stated_input((NAVIGATOR, "temperature", ROOM_DEGC, "degC"), WARMTH, ABOUT_WARMTH)
    flags = [outside_flag("; ".join(parameters.outside))] if parameters.outside else []
    flags += place_flags(dataset.places)
    drive = parameters.drive
    latitude_u_arcmin = None if drive is None else drive.latitude_uncertainty_arcmin
    more = [latitude_input(latitude_u_arcmin, "the plan")]
    if analysis.navigated is not None and drive is not None:
        more += drive_inputs(drive, "the plan")
    findings = to_findings(analysis, dataset, flags, "specification in the plan", more)
    gradient = gradient_inputs(dataset.places, tells_spread(bench))
    inputs = [*findings.inputs, *table_inputs(bench), *warmth, *gradient, *more]
    estimates = with_gradient(findings.estimates, inputs, WARMTH)
    return replace(findings, estimates=estimates, inputs=inputs, trials=trials)


def findings_of_dataset(raw: RawDataset) -> Findings:
    """Return what an imported dataset says; FaultList where it lacks the bias that it needs."""
    conditions = raw.conditions(Conditions)
    dataset = dataset_of_import(raw, conditions)
    analysis = analyse(dataset)
    single = [axis for axis, fit in analysis.fits.items() if fit.curve and not fit.paired]
    if single and dataset.gyro_bias_deg_per_h is None:
        what = (
            f"is missing: the turns about {', '.join(single)} have one sense, so the gyro's bias "
            "is in the scale factor; give its specification as a standard uncertainty"
        )
        raise FaultList([raw.document.fault(("conditions", BIAS), what)])
    flags = []
    low, high = PUBLISHED_SOAK_H
    if conditions.soak_s is not None and not low <= conditions.soak_s / 3600.0 <= high:
        soak_h = conditions.soak_s / 3600.0
        flags.append(outside_flag(f"a soak of {soak_h:g} h (published {low:g} h to {high:g} h)"))
    more = [] if analysis.navigated is None else drive_inputs(conditions, CONDITIONS)
    source = "condition gyro_bias, a specification"
    findings = to_findings(analysis, dataset, flags, source, more)
    warmth = InputQuantity.if_stated(
        WARMTH, ABOUT_WARMTH, conditions.thermometer_uncertainty_degC, "degC", CONDITIONS
    )
    latitude = latitude_input(conditions.latitude_uncertainty_arcmin)
    trials = trials_of(analysis, dataset, partial(_tried, settings=AnalysisSettings()))
    gradient = stated_gradient(conditions.device_gradient_degC)
    inputs = [*findings.inputs, warmth, latitude, *gradient, *more]
    estimates = with_gradient(findings.estimates, inputs, WARMTH)
    return replace(findings, estimates=estimates, inputs=inputs, trials=trials)


def _tried(dataset: FogDataset, settings: AnalysisSettings) -> Analysis:
    """Return the results of a trial."""
    findings = to_findings(analyse(dataset, settings), dataset, [], "")
    return Analysis(findings.estimates, findings.published, findings.flags)


def drive_inputs(conditions: Departure, source: str) -> list[InputQuantity]:
    """Return how well the rest of a navigated drive is known."""
    rows = (
        (ACCELEROMETER_BIAS, "bias of each accelerometer", conditions.accelerometer_bias_ug, "ug"),
        (
            HEADING,
            "heading in which the drive began",
            conditions.initial_heading_uncertainty_arcmin,
            "arcmin",
        ),
        (
            LEVEL,
            "pitch and roll in which the drive began",
            conditions.initial_level_uncertainty_arcsec,
            "arcsec",
        ),
        (
            FIX,
            "positions of the reference",
            conditions.reference_position_uncertainty_mm,
            "mm",
        ),
    )
    return [InputQuantity.if_stated(*row, source) for row in rows]


def latitude_input(u_arcmin: float | None, source: str = CONDITIONS) -> InputQuantity:
    """Return how well the latitude is known, by which the earth's rate is taken off a drive."""
    u_rad = None if u_arcmin is None else u_arcmin / ARCMIN_PER_RAD
    return InputQuantity.if_stated(LATITUDE, "latitude of the drive", u_rad, "rad", source)


def table_inputs(bench: Bench) -> Iterator[InputQuantity]:
    """Yield the table's angle; it stands in the budget with no contribution.

    A whole turn ends at the angle, and so with the error, that it began with.
    """
    about = "angle of the table (the same at both ends of a whole turn)"
    yield from bench.stated_input((TABLE, "angle", 360.0, "deg"), TABLE_ANGLE, about)


def settings(parameters: FogParameters) -> AnalysisSettings:
    """Return the analysis settings of a plan."""
    return AnalysisSettings.model_construct(**dict(parameters.thresholds))


def outside_flag(said: str) -> Flag:
    """Return the flag of what was done outside the published ranges."""
    return Flag("outside-published-range", f"Outside the published range: {said}.")


def to_findings(
    analysis: FogAnalysis,
    dataset: FogDataset,
    flags: list[Flag],
    source: str,
    stated: Sequence[InputQuantity] = (),
) -> Findings:
    """Return an analysis in the station's own terms; `source` says where the bias comes from.

    `stated` are further inputs, on which a navigated drive depends.
    """
    estimates: list[Estimate] = []
    published: list[Published] = []
    asked = dataset.reference_temperature_degC
    for axis, fit in analysis.fits.items():
        estimates += [
            _at_reference(fit, dataset, WIDEST_DEGC),
            _largest(fit, WIDEST_DEGC),
        ]
        paper = analysis.published[axis]
        at = paper is not None and paper.holds(asked)
        published.append(
            Published(
                "scale_factor_error",
                axis,
                _value(paper, asked) if paper is not None and at else None,
                "ppm",
                "polynomial",
            )
        )
        largest = None if paper is None else abs(_value(paper, paper.largest_at_degC()))
        published.append(
            Published("largest_scale_factor_error", axis, largest, "ppm", "polynomial")
        )
    estimates += [
        _verified(verified, analysis.fits[axis]) for axis, verified in analysis.verified.items()
    ]
    estimates += _driven(analysis.driven, dataset.drive, analysis.fits.get("z"))
    known = {quantity.name: quantity.standard_uncertainty or 0.0 for quantity in stated}
    known[BIAS] = dataset.gyro_bias_deg_per_h or 0.0
    known |= {f"{CHECKS}_{axis}": 1.0 for axis in analysis.fits}
    estimates += _navigated(analysis, dataset.drive, known)
    inputs = []
    if dataset.gyro_bias_deg_per_h:
        inputs.append(
            InputQuantity(
                BIAS, "gyro bias during the turn", dataset.gyro_bias_deg_per_h, "deg/h", source
            )
        )
    inputs += [
        InputQuantity(
            f"{CHECKS}_{axis}", f"what checks of the curve of {axis} show", 1.0, "1", "these data"
        )
        for axis, fit in analysis.fits.items()
        if fit.curve is not None and fit.curve.check is not None
    ]
    flags = [*analysis.flags, *flags]
    return Findings(estimates, published, flags, inputs, Detail(analysis, dataset))


def model_data(curve: Curve) -> dict[str, Any]:
    """Return a curve in the form that other programs rely on."""
    return {
        "basis": "chebyshev",
        "domain": [float(end) for end in curve.domain_degC],
        "unit": "degC",
        "coefficients": [float(coefficient) for coefficient in curve.coefficients_ppm],
    }


def band_data(band: Band) -> dict[str, Any]:
    """Return a curve at temperatures over its domain, how well each is known, and the whole."""
    grid = band.curve.temperatures_degC(BAND_POINTS)
    return {
        "temperature_degC": grid.tolist(),
        "value": band.curve.error_ppm(grid).tolist(),
        "standard_uncertainty": band.standard_ppm(grid).tolist(),
        "expanded_uncertainty": band.expanded_ppm(grid).tolist(),
        "whole_curve_uncertainty": band.whole_ppm(grid).tolist(),
        "whole_curve_factor": band.whole_factor,
    }


def _value(curve: Curve, temperature_degC: float) -> float:
    return float(curve.error_ppm(np.array([temperature_degC]))[0])


def _estimate(
    name: str, fit: AxisFit, temperature_degC: float, magnitude: bool, extra: dict[str, Any]
) -> Estimate:
    curve = fit.curve
    if curve is None:
        return undetermined(name, fit.axis, "ppm", "weighted", extra)
    at = np.array([temperature_degC])
    value = _value(curve, temperature_degC)
    sign = -1.0 if magnitude and value < 0.0 else 1.0
    by_bias = sign * float(curve.error_by_bias_ppm(at)[0])
    check = float(curve.check_ppm(at)[0])
    sensitivities = {TABLE_ANGLE: 0.0} | ({BIAS: by_bias} if by_bias else {})
    if check:
        sensitivities[f"{CHECKS}_{fit.axis}"] = check
    if not magnitude:
        sensitivities[WARMTH] = curve.slope_ppm_per_degC(temperature_degC)
    return Estimate(
        name,
        fit.axis,
        sign * value,
        "ppm",
        float(curve.standard_uncertainty_ppm(at)[0]),
        curve.degrees_of_freedom,
        "weighted",
        sensitivities,
        extra,
    )


def _at_reference(fit: AxisFit, dataset: FogDataset, widest_degC: float) -> Estimate:
    asked = dataset.reference_temperature_degC
    curve = fit.curve
    extra: dict[str, Any] = {
        "reference_temperature": asked,
        "conditions": {"temperature": f"{asked:g} degC"},
        "model": None if curve is None else model_data(curve),
        "rejected_rows": fit.rejected_rows,
    }
    if curve is None:
        return _estimate("scale_factor_error", fit, asked, False, extra)
    band = Band(curve, dataset.gyro_bias_deg_per_h or 0.0)
    extra |= {"order": curve.order, "turn_noise": fit.noise_ppm, "band": band_data(band)}
    estimate = _estimate("scale_factor_error", fit, asked, False, extra)
    if curve.holds(asked) and not fit.in_gap(asked, widest_degC):
        return estimate
    return undetermined(
        estimate.name, estimate.axis, estimate.unit, estimate.method, estimate.extra
    )


def _held_at(temperature_degC: float) -> dict[str, Any]:
    """Return the temperature of a largest value, as a number and as people read it."""
    text = f"{temperature_degC:.1f} degC"
    return {"temperature": temperature_degC, "conditions": {"temperature": text}}


def _largest(fit: AxisFit, widest_degC: float) -> Estimate:
    at = 0.0 if fit.curve is None else fit.curve.largest_at_degC()
    extra = {} if fit.curve is None else _held_at(at)
    if any(until - since > widest_degC for since, until in fit.gaps_degC):
        return undetermined("largest_scale_factor_error", fit.axis, "ppm", "weighted")
    return _estimate("largest_scale_factor_error", fit, at, True, extra)


def _verified(verified: Verified, fit: AxisFit) -> Estimate:
    worst = verified.worst
    by_bias = float(verified.by_bias_ppm[worst])
    return Estimate(
        "residual_scale_factor_error",
        verified.axis,
        abs(float(verified.after_ppm[worst])),
        "ppm",
        float(verified.u_ppm[worst]),
        fit.curve.degrees_of_freedom if fit.curve is not None else None,
        "weighted",
        {TABLE_ANGLE: 0.0} | ({BIAS: by_bias} if by_bias else {}),
        {
            **_held_at(float(verified.temperature_degC[worst])),
            "turns": len(verified.after_ppm),
            "rms_before": float(np.sqrt(np.mean(verified.before_ppm**2))),
            "rms_after": float(np.sqrt(np.mean(verified.after_ppm**2))),
        },
    )


def _driven(driven: Driven | None, drive: Drive | None, fit: AxisFit | None) -> list[Estimate]:
    if driven is None or drive is None:
        return []
    level = EARTH_RATE_DEG_PER_H * math.cos(math.radians(drive.latitude_deg))
    by_latitude = level * driven.duration_h
    extra = {"turned_deg": driven.turned_deg}
    dof = fit.curve.degrees_of_freedom if fit is not None and fit.curve is not None else None
    return [
        Estimate(
            "heading_error_uncompensated",
            None,
            driven.raw_error_deg,
            "deg",
            driven.noise_u_deg,
            None,
            "least-squares",
            {BIAS: driven.duration_h, LATITUDE: by_latitude},
            extra,
        ),
        Estimate(
            "heading_error_compensated",
            None,
            driven.compensated_error_deg,
            "deg",
            float(np.hypot(driven.noise_u_deg, driven.model_u_deg)),
            dof,
            "least-squares",
            {BIAS: driven.duration_h - driven.by_bias_deg, LATITUDE: by_latitude},
            extra,
        ),
    ]


def _navigated(
    analysis: FogAnalysis, drive: Drive | None, stated: Mapping[str, float]
) -> list[Estimate]:
    if drive is None or (drive.specific_force_m_per_s2 is None and drive.reference is None):
        return []
    journey = analysis.navigated
    curves = {axis: fit.curve for axis, fit in analysis.fits.items() if fit.curve is not None}
    estimates = []
    for name in NAMES:
        unit = "m/s" if name == "velocity_error" else "m"
        for number, run in enumerate(RUNS):
            if journey is None:
                estimates.append(undetermined(f"{name}_{run}", None, unit, "least-squares"))
                continue
            size = journey.size(curves, name, number, stated)
            estimates.append(
                Estimate(
                    f"{name}_{run}",
                    None,
                    size.value,
                    unit,
                    size.u,
                    size.degrees_of_freedom,
                    "least-squares",
                    size.sensitivities,
                    {"time_s": size.at_s},
                )
            )
    return estimates
