"""From data to findings: an imported dataset, its analysis, and the type B inputs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from numpy.polynomial import Chebyshev

from procedures.common.gyro_source import GYRO
from procedures.common.places import (
    gradient_inputs,
    place_flags,
    stated_gradient,
    tells_spread,
    with_gradient,
)
from procedures.estimation.direction import attitude_inputs, with_latitude
from station.findings import Estimate, Findings, InputQuantity, findings_of

from .analysis import analyse
from .dataset import (
    AnalysisSettings,
    Conditions,
    TemperatureDataset,
    dataset_of_import,
    dataset_of_run,
)
from .parameters import BiasTemperatureParameters
from .trials import CLOCK, PULSE, trials_of

if TYPE_CHECKING:
    from station.dataset_reading import RawDataset
    from station.instruments.bench import Bench
    from station.record.folder import RunFolder

WARMTH = "thermometer_degC"
PPM = 1e-6
SETTINGS = AnalysisSettings()


def findings_of_dataset(raw: RawDataset) -> Findings:
    """Return what an imported dataset says."""
    dataset, conditions = dataset_of_import(raw)
    more = [*stated_gradient(conditions.device_gradient_degC)]
    return _findings(dataset, conditions, "the dataset's conditions", more=more)


def findings_of_run(
    folder: RunFolder, parameters: BiasTemperatureParameters, bench: Bench
) -> Findings:
    """Return what a run's finished ramps and soaks say, type B inputs from plan and bench file."""
    dataset = dataset_of_run(folder, parameters, bench)
    u_clock = parameters.clock_ppm * PPM
    inputs = [InputQuantity(CLOCK, "rate of the station's clock", u_clock, "1", "the plan")]
    record = (GYRO, "scale", 1.0, "1")
    inputs += bench.stated_input(record, PULSE, "weight of a pulse", relative=True)
    inputs += gradient_inputs(dataset.places, tells_spread(bench))
    settings = AnalysisSettings(**dict(parameters.thresholds))
    findings = _findings(dataset, parameters, "the plan", settings, inputs)
    by_board = [_by_board(dataset, estimate) for estimate in findings.estimates]
    return replace(findings, estimates=by_board)


def _findings(
    dataset: TemperatureDataset,
    given: Conditions | BiasTemperatureParameters,
    source: str,
    settings: AnalysisSettings = SETTINGS,
    more: Sequence[InputQuantity] = (),
) -> Findings:
    """Return what a dataset says, with what `source` gives of uncertainties."""
    inputs = [
        *attitude_inputs(dataset.directions, given.attitude_uncertainty_arcmin, source),
        *more,
    ]
    about = "offset of the thermometer, by the slope of the bias"
    u_degC = given.thermometer_uncertainty_degC
    inputs.append(InputQuantity.if_stated(WARMTH, about, u_degC, "degC", source))
    analysis = analyse(dataset, settings)
    findings = findings_of(analysis, dataset, inputs)
    findings = replace(
        findings,
        estimates=with_gradient([*map(_by_warmth, findings.estimates)], inputs, WARMTH),
        flags=[*findings.flags, *place_flags(dataset.places)],
        trials=trials_of(analysis, dataset, settings),
    )
    u_arcmin = given.latitude_uncertainty_arcmin
    return with_latitude(findings, dataset.directions, dataset.latitude_rad, u_arcmin, source)


def _by_board(dataset: TemperatureDataset, estimate: Estimate) -> Estimate:
    """Return lags that depend on the clock, a bias on pulses and clock by all that is read."""
    if estimate.value is None:
        return estimate
    if estimate.name in ("sensor_lag", "chamber_lag"):
        return replace(estimate, sensitivities={**estimate.sensitivities, CLOCK: estimate.value})
    if estimate.name != "bias":
        return estimate
    direction = dataset.directions[estimate.axis or ""]
    whole = estimate.value + direction.earth_deg_per_h(dataset.latitude_rad)
    slopes = {PULSE: whole, CLOCK: -whole}
    return replace(estimate, sensitivities={**estimate.sensitivities, **slopes})


def _by_warmth(estimate: Estimate) -> Estimate:
    """Return a bias that depends on the thermometer by its slope at the reference temperature."""
    model = estimate.extra.get("model")
    if model is None:
        return estimate
    at_degC = float(estimate.extra["conditions"]["temperature"].removesuffix(" degC"))
    curve = Chebyshev(model["coefficients"], model["domain"])
    slopes = {WARMTH: float(curve.deriv()(at_degC))}
    return replace(estimate, sensitivities={**estimate.sensitivities, **slopes})
