"""From data to findings: imported or recorded positions, their analysis, the type B inputs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from procedures.common.constants import ARCSEC_PER_RAD, FULL_TURN_DEG
from procedures.common.inputs import not_known
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
from station.findings import Findings, InputQuantity, findings_of

from .analysis import analyse
from .dataset import AnalysisSettings, Conditions, TumbleDataset, dataset_of_import
from .parameters import TumbleParameters
from .solution import ENCODER, MOUNTING
from .trials import trials_of

if TYPE_CHECKING:
    from station.dataset_reading import RawDataset
    from station.instruments.bench import Bench
    from station.record.folder import RunFolder

SOURCE = "the dataset's conditions"
WARMTH = "thermometer_degC"
GRADUATION = ("graduation", FULL_TURN_DEG, "arcsec")
"""What the stage's record states of its encoder within a turn."""


def findings_of_dataset(raw: RawDataset) -> Findings:
    """Return what an imported dataset says."""
    dataset, conditions = dataset_of_import(raw)
    gradient = stated_gradient(conditions.device_gradient_degC)
    return _findings(dataset, AnalysisSettings(), [*inputs_of(conditions), *gradient])


def findings_of_run(folder: RunFolder, parameters: TumbleParameters, bench: Bench) -> Findings:
    """Return what a run's finished positions say, type B inputs from plan and bench file."""
    conditions, sources = conditions_of_run(parameters, bench)
    dataset = dataset_of_run(folder, parameters, bench, conditions)
    inputs = list(inputs_of(conditions, "the plan", sources))
    about = f"zero of the angle of {STAGE}"
    inputs += bench.stated_input((STAGE, "angle", 0.0, "rad"), "encoder_zero", about)
    inputs += gradient_inputs(dataset.places, tells_spread(bench))
    settings = AnalysisSettings(**dict(parameters.thresholds))
    findings = _findings(dataset, settings, inputs)
    measured = what_was_read(dataset.output_V, dataset.temperature_degC)
    return with_overloads(replace(findings, measured=measured), folder)


def _findings(
    dataset: TumbleDataset, settings: AnalysisSettings, inputs: list[InputQuantity]
) -> Findings:
    analysis = analyse(dataset, settings)
    inputs = not_known(inputs, WARMTH) if analysis.temperature_lost else inputs
    findings = findings_of(analysis, dataset, inputs)
    estimates = with_gradient(findings.estimates, inputs, WARMTH)
    flags = [*findings.flags, *place_flags(dataset.places)]
    trials = trials_of(analysis, dataset, settings)
    return replace(findings, estimates=estimates, flags=flags, trials=trials)


def dataset_of_run(
    folder: RunFolder, parameters: TumbleParameters, bench: Bench, conditions: Conditions
) -> TumbleDataset:
    """Return the finished positions of a run, a row each, in the order of time.

    The output is the mean of a position's burst; the bench file's corrections are applied.
    """
    units = folder.finished_units()
    points = [point for point in parameters.points if point.unit in units]
    rows = [row_of(folder, point.unit, parameters, bench) for point in points]
    time_s, angle_deg, output_V, temperature_degC = np.array(rows).reshape(-1, 4).T
    order = np.argsort(time_s, kind="stable")

    def of_settings(name: str) -> NDArray[Any]:
        return np.array([getattr(point.setting, name) for point in points])[order]

    return TumbleDataset(
        time_s=time_s[order],
        plane=of_settings("plane"),
        reverse=1.0 - 2.0 * of_settings("reversed"),
        head_rad=np.deg2rad(of_settings("head_deg")),
        commanded_rad=np.deg2rad(np.array([point.angle_deg for point in points])[order]),
        encoder_rad=np.deg2rad(angle_deg[order]),
        output_V=output_V[order],
        temperature_degC=temperature_degC[order] if parameters.temperature else None,
        gravity_g=conditions.local_gravity_g,
        encoder_accuracy_rad=conditions.encoder_accuracy_arcsec / ARCSEC_PER_RAD,
        mounting_rad=conditions.mounting_repeatability_arcsec / ARCSEC_PER_RAD,
        places=at_points(folder, [point.unit for point in points], bench, still),
    )


def conditions_of_run(
    parameters: TumbleParameters, bench: Bench
) -> tuple[Conditions, Mapping[str, str]]:
    """Return the conditions of a run, and by input what states them beside the plan."""
    largest_V = parameters.scale_factor_V_per_g
    gain, zero, meter = gain_and_zero(bench, MULTIMETER, "voltage", largest_V, "V")
    warmth, pt100 = bench.stated(THERMOMETER, "temperature", USUAL_DEGC, "degC") or (0.0, "")
    encoder, stage = parameters.encoder_accuracy_arcsec, "the plan"
    if encoder is None:
        encoder, stage = bench.stated(STAGE, *GRADUATION) or (0.0, "")
    conditions = Conditions.model_construct(
        local_gravity_g=parameters.local_gravity_g,
        local_gravity_uncertainty_g=parameters.local_gravity_uncertainty_g,
        encoder_accuracy_arcsec=encoder,
        mounting_repeatability_arcsec=parameters.mounting_repeatability_arcsec,
        thermometer_uncertainty_degC=warmth,
        multimeter_gain_ppm=(gain or 0.0) * 1e6,
        multimeter_zero_V=zero or 0.0,
    )
    sources = {ENCODER: stage, WARMTH: pt100}
    return conditions, {**sources, "multimeter_gain": meter, "multimeter_zero": meter}


def inputs_of(
    conditions: Conditions, source: str = SOURCE, sources: Mapping[str, str] | None = None
) -> Iterator[InputQuantity]:
    """Yield the type B inputs that the conditions state, by a `source` unless `sources` has it.

    The sensitivities to encoder and mountings are those to one stated standard deviation of each
    harmonic and of each mounting, added in quadrature; their u here is one of these.
    """
    encoder, mounting = conditions.encoder_accuracy_arcsec, conditions.mounting_repeatability_arcsec
    stated = (
        (ENCODER, f"harmonics of the encoder, {encoder:g} arcsec each", float(encoder > 0), "1"),
        (MOUNTING, f"mountings, {mounting:g} arcsec each", float(mounting > 0), "1"),
        ("local_gravity", "local gravity", conditions.local_gravity_uncertainty_g, "g"),
        (
            WARMTH,
            "offset of the thermometer: the temperature that the results hold at",
            conditions.thermometer_uncertainty_degC,
            "degC",
        ),
        ("multimeter_gain", "gain of the multimeter", conditions.multimeter_gain_ppm * 1e-6, "1"),
        ("multimeter_zero", "zero of the multimeter", conditions.multimeter_zero_V, "V"),
    )
    for name, description, u, unit in stated:
        value = conditions.local_gravity_g if name == "local_gravity" else 0.0
        by = (sources or {}).get(name, source)
        yield InputQuantity.if_stated(name, description, u, unit, by, value=value)
