"""From a record or an imported dataset to findings, with the type B inputs of the bench file.

Of a run there is one row for each finished point.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from procedures.common.homogeneity import at_device, entry
from procedures.common.inputs import Declared, cosine_u, not_known, with_unstated
from procedures.common.perturbing import with_slopes
from procedures.common.places import (
    at_points,
    gradient_inputs,
    place_flags,
    stated_gradient,
    tells_spread,
    with_gradient,
)
from procedures.common.stage_and_meter import (
    MULTIMETER,
    STAGE,
    THERMOMETER,
    USUAL_DEGC,
    gain_and_zero,
    row_of,
    what_was_read,
    with_overloads,
)
from procedures.estimation.channel import still
from station.findings import (
    Covariance,
    Estimate,
    Findings,
    InputQuantity,
    extremes,
    findings_of,
)

from .analysis import MOUNTING, analyse
from .dataset import AccelerometerAnalysis, AccelerometerDataset
from .from_import import Conditions, dataset_of_import
from .measuring import AXIS_COLUMN, FULL_TURN_DEG, GAUSSMETER, T_PER_MT
from .model import FIELD_POWER
from .nuisances import KO, KP, MOUNTING_RAD, OFFSET
from .parameters import AccelerometerParameters, AnalysisSettings, Point
from .trials import trials_of

if TYPE_CHECKING:
    from procedures.common.helmholtz import FieldAtDevice
    from station.dataset_reading import RawDataset
    from station.instruments.bench import Bench
    from station.record.folder import RunFolder

GRAVITY, WARMTH, STAGE_ANGLE = "local_gravity", "thermometer_degC", "stage_angle_rad"
COIL = "x"
"""The axis of the strong coil, of those of the probe."""
PROBE, AMBIENT = "probe_cosine", "ambient_field_T"
INPUTS: Declared = {
    "field_gain": (f"gain of {GAUSSMETER}", "1"),
    "field_offset_T": (f"zero of {GAUSSMETER}", "T"),
    "voltage_gain": (f"gain of {MULTIMETER}", "1"),
    "voltage_offset_V": (f"zero of {MULTIMETER}", "V"),
    "graduation_sine_rad": (f"graduation of {STAGE}, sine of the angle", "rad"),
    "graduation_cosine_rad": (f"graduation of {STAGE}, cosine of the angle", "rad"),
    GRAVITY: ("local gravity", "g"),
    WARMTH: (f"offset of {THERMOMETER}: the temperature that the results hold at", "degC"),
    STAGE_ANGLE: (f"zero of the angle of {STAGE}", "rad"),
    PROBE: ("probe to coil angle: cosine of the field", "1"),
    AMBIENT: ("probe to coil angle: ambient field across the coil", "T"),
}
"""What the results depend on."""
TURNED = ("graduation_sine_rad", "graduation_cosine_rad")
"""In plane `op` gravity does not turn through IA: what differs there from the other planes drift
takes up in part, and only the analysis of the data says what they do."""
GRADUATION_RAD = 5e-6
"""How far they are moved where nobody states them: 1 arcsec."""
LEANS = {
    MOUNTING[OFFSET]: "from the zero of the encoder",
    MOUNTING[KO]: "towards OA",
    MOUNTING[KP]: "towards PA",
}


def findings_of_run(
    folder: RunFolder, parameters: AccelerometerParameters, bench: Bench
) -> Findings:
    """Return what a run's finished points say, type B inputs from the bench's calibrations."""
    dataset = dataset_of_run(folder, parameters, bench)
    gradient = gradient_inputs(dataset.places, tells_spread(bench))
    stated = [*type_b_inputs(parameters, bench), *gradient]
    findings = _findings(dataset, settings(parameters), stated)
    at_device = dataset.at_device
    ratio = 1.0 if at_device is None else at_device.ratio(COIL)[0]
    measured = {
        (GAUSSMETER, "field"): extremes(dataset.field_T / T_PER_MT / ratio),
        **what_was_read(dataset.output_V, dataset.temperature_degC),
    }
    return with_overloads(replace(findings, measured=measured), folder)


def findings_of_dataset(raw: RawDataset) -> Findings:
    """Return what an imported dataset says; it brings no calibration records.

    Of type B is what its conditions state, and how the device is mounted, where the rows do not
    tell that.
    """
    dataset = dataset_of_import(raw)
    return _findings(dataset, AnalysisSettings(), stated_inputs(raw.conditions(Conditions)))


def _findings(
    dataset: AccelerometerDataset, limits: AnalysisSettings, inputs: Iterable[InputQuantity]
) -> Findings:
    """Return findings with all inputs, and the covariance of coefficients solved together."""
    analysis = analyse(dataset, limits)
    inputs = not_known(inputs, WARMTH) if analysis.temperature_lost else inputs
    analysis = replace(analysis, estimates=tuple(_by_place(analysis, dataset.at_device)))
    places = () if dataset.at_device is None else dataset.at_device.inputs
    inputs = with_unstated([*inputs, *_mounting(analysis, dataset), *places], INPUTS)
    keys = tuple((name, None) for name in analysis.identifiability.kept)
    related = Covariance(keys, tuple(map(tuple, analysis.covariance.tolist())))
    findings, trials = findings_of(analysis, dataset, inputs), trials_of(analysis, dataset, limits)
    estimates = tuple(with_gradient(findings.estimates, inputs, WARMTH))
    if "op" in dataset.plane:
        stated = {given.name: given.standard_uncertainty or GRADUATION_RAD for given in inputs}
        estimates = tuple(with_slopes(estimates, trials, {name: stated[name] for name in TURNED}))
    flags = [*findings.flags, *place_flags(dataset.places)]
    return replace(findings, estimates=estimates, covariance=related, flags=flags, trials=trials)


def _by_place(analysis: AccelerometerAnalysis, at: FieldAtDevice | None) -> Iterator[Estimate]:
    """Yield the estimates; those by the field with its correction, and what they have of that."""
    for estimate in analysis.estimates:
        power = FIELD_POWER.get(estimate.name)
        if at is None or power is None or estimate.value is None:
            yield estimate
            continue
        slopes = {
            name: -power * estimate.value * float(slope[0])
            for name, slope in at.by_input(COIL).items()
        }
        yield replace(
            estimate,
            sensitivities={**estimate.sensitivities, **slopes},
            extra={**estimate.extra, **entry(at, COIL)},
        )


def settings(parameters: AccelerometerParameters) -> AnalysisSettings:
    """Return the analysis settings of a plan."""
    return AnalysisSettings.model_construct(
        **dict(parameters.thresholds),
        window=parameters.window,
        scale_factor_V_per_g=parameters.scale_factor_V_per_g,
    )


def dataset_of_run(
    folder: RunFolder, parameters: AccelerometerParameters, bench: Bench
) -> AccelerometerDataset:
    """Return all finished points of a run, in the order in which they were measured.

    Output and field of a point are means over its burst; the calibration corrections of the bench
    file are applied to all that was read, and the field is that at the device where the bench
    states the geometry of its coil. Readings that say overload are left out where a higher
    range gave others; a point without a valid field has NaN there, which the analysis rejects and
    lists.
    """
    units = folder.finished_units()
    points = [point for point in parameters.points if point.unit in units]
    rows = [row_of_point(folder, point, parameters, bench) for point in points]
    time_s, angle_deg, field_T, output_V, temperature_degC = np.array(rows).reshape(-1, 5).T
    order = np.argsort(time_s, kind="stable")
    ranges = np.array([range_of(folder, point.unit) for point in points])
    _, group = np.unique(ranges, return_inverse=True)
    device = at_device(bench, "dc")
    if device is not None:
        field_T = field_T * device.ratio(COIL)[0]

    def commanded(name: str) -> np.ndarray:
        return np.array([getattr(point, name) for point in points])[order]

    return AccelerometerDataset(
        time_s=time_s[order],
        plane=commanded("plane"),
        theta_deg=angle_deg[order],
        theta_commanded_deg=commanded("angle_deg"),
        field_T=field_T[order],
        field_commanded_T=commanded("field_mT") * T_PER_MT,
        output_V=output_V[order],
        temperature_degC=temperature_degC[order] if parameters.temperature else None,
        noise_group=group[order],
        at_device=device,
        places=at_points(folder, [point.unit for point in points], bench, still),
        gravity_g=parameters.local_gravity_g,
    )


def row_of_point(
    folder: RunFolder, point: Point, parameters: AccelerometerParameters, bench: Bench
) -> tuple[float, float, float, float, float]:
    """Return a point's time (s), angle (deg), field (T), output (V) and temperature (degC)."""
    field = folder.rows(GAUSSMETER, point.unit)
    valid = field[AXIS_COLUMN][field["state"] == 0]
    field_T = float(valid.mean()) if valid.size else np.nan
    field_T = bench.corrected(GAUSSMETER, "field", field_T / T_PER_MT, "mT") * T_PER_MT
    time_s, angle_deg, output_V, temperature_degC = row_of(folder, point.unit, parameters, bench)
    return time_s, angle_deg, field_T, output_V, temperature_degC


def range_of(folder: RunFolder, unit: str) -> float:
    """Return the voltmeter's range in V in which a point was measured in the end."""
    wider = [
        float(event.details["next_range_V"])
        for event in folder.events_of("overload")
        if event.details["unit"] == unit
    ]
    return wider[-1] if wider else float(folder.finished_units()[unit]["range_V"])


def type_b_inputs(parameters: AccelerometerParameters, bench: Bench) -> Iterator[InputQuantity]:
    """Yield what the data cannot determine: gain and offset of gaussmeter and voltmeter, angles."""
    for instrument, quantity, largest, unit, offset_unit, factor in (
        (GAUSSMETER, "field", parameters.largest_field_mT, "mT", "T", T_PER_MT),
        (MULTIMETER, "voltage", parameters.scale_factor_V_per_g, "V", "V", 1.0),
    ):
        gain, zero, source = gain_and_zero(bench, instrument, quantity, largest, unit)
        yield _input(f"{quantity}_gain", gain, f"{source}, at {largest:g} {unit}")
        offset = None if zero is None else zero * factor
        yield _input(f"{quantity}_offset_{offset_unit}", offset, source)
    for name, instrument, quantity, at, unit in (
        (STAGE_ANGLE, STAGE, "angle", 0.0, "rad"),
        (WARMTH, THERMOMETER, "temperature", USUAL_DEGC, "degC"),
        ("graduation_sine_rad", STAGE, "graduation", FULL_TURN_DEG, "deg"),
        ("graduation_cosine_rad", STAGE, "graduation", FULL_TURN_DEG, "deg"),
    ):
        u, source = bench.stated(instrument, quantity, at, unit) or (None, "")
        in_rad = u is not None and unit == "deg"
        yield _input(name, math.radians(u or 0.0) if in_rad else u, source)
    leans_rad, source = bench.stated(GAUSSMETER, "angle", 0.0, "rad") or (None, "")
    ambient_mT, gravity_u_g = parameters.ambient_field_mT, parameters.local_gravity_uncertainty_g
    ambient_T = None if ambient_mT is None else ambient_mT * T_PER_MT
    yield from _probe_inputs(leans_rad, source, ambient_T)
    yield _input(GRAVITY, gravity_u_g, "the plan", parameters.local_gravity_g)


def stated_inputs(conditions: Conditions) -> Iterator[InputQuantity]:
    """Yield what the conditions of a dataset state."""
    source, gravity_g = "the dataset's conditions", conditions.local_gravity_g
    yield _input(GRAVITY, conditions.local_gravity_uncertainty_g, source, gravity_g)
    yield _input(WARMTH, conditions.thermometer_uncertainty_degC, source)
    yield from stated_gradient(conditions.device_gradient_degC)
    yield from _probe_inputs(conditions.probe_angle_rad, source, conditions.ambient_field_T)


def _probe_inputs(
    angle_u_rad: float | None, source: str, ambient_T: float | None
) -> Iterator[InputQuantity]:
    """Yield what a probe reads that leans from the coil's axis: less of its field, some ambient."""
    across_T = None if angle_u_rad is None or ambient_T is None else angle_u_rad * ambient_T
    yield _input(PROBE, cosine_u(angle_u_rad), source)
    yield _input(AMBIENT, across_T, source)


def _input(name: str, u: float | None, source: str, value: float = 0.0) -> InputQuantity:
    about, unit = INPUTS[name]
    return InputQuantity.if_stated(name, about, u, unit, source, value=value)


def _mounting(
    analysis: AccelerometerAnalysis, dataset: AccelerometerDataset
) -> Iterator[InputQuantity]:
    """Yield how the input axis leans, for what the rows do not tell apart from that."""
    used = {name for estimate in analysis.estimates for name in estimate.sensitivities}
    stated = dataset.mounting_rad
    source = "assumed, nobody states it" if stated is None else "conditions, mounting"
    for name, where in LEANS.items():
        if name in used:
            about, u_rad = f"mounting: input axis {where}", stated or MOUNTING_RAD
            yield InputQuantity(name, about, u_rad, "rad", source)
