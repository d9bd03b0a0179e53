"""From data to findings: an imported dataset, its analysis, and the type B inputs."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from procedures.common.gyro_source import GYRO
from procedures.common.inputs import Declared, with_unstated
from procedures.estimation.direction import attitude_inputs, with_latitude
from station.findings import Findings, InputQuantity, findings_of

from .analysis import analyse
from .dataset import AnalysisSettings, StaticDataset, dataset_of_import, dataset_of_run
from .parameters import StaticParameters
from .trials import trials_of

if TYPE_CHECKING:
    from station.dataset_reading import RawDataset
    from station.instruments.bench import Bench
    from station.record.folder import RunFolder

PPM = 1e-6
OF_RATE: Declared = {"clock": ("rate of the clock", "1")}
OF_COUNTS: Declared = {**OF_RATE, "pulse_weight": ("weight of a pulse", "1")}
"""What the results depend on, beside the attitude and the latitude."""


def findings_of_dataset(raw: RawDataset) -> Findings:
    """Return what an imported dataset says."""
    dataset, conditions = dataset_of_import(raw)
    u_arcmin, source = conditions.attitude_uncertainty_arcmin, "the dataset's conditions"
    inputs = list(attitude_inputs(dataset.directions, u_arcmin, source))
    u_latitude = conditions.latitude_uncertainty_arcmin
    declared = OF_COUNTS if dataset.pulse_arcsec else OF_RATE
    findings = _findings(dataset, AnalysisSettings(), with_unstated(inputs, declared))
    return with_latitude(findings, dataset.directions, dataset.latitude_rad, u_latitude, source)


def findings_of_run(folder: RunFolder, parameters: StaticParameters, bench: Bench) -> Findings:
    """Return what a run's finished switch-ons say, type B inputs from plan and bench file."""
    dataset = dataset_of_run(folder, parameters, bench)
    settings = AnalysisSettings(**dict(parameters.thresholds))
    u_clock = parameters.clock_ppm * PPM
    inputs = [InputQuantity("clock", "rate of the station's clock", u_clock, "1", "the plan")]
    if parameters.source == GYRO:
        about = "weight of a pulse"
        scale = (GYRO, "scale", 1.0, "1")
        inputs += bench.stated_input(scale, "pulse_weight", about, relative=True)
    if not dataset.earth_in_output:
        return _findings(dataset, settings, inputs)
    u_arcmin = parameters.attitude_uncertainty_arcmin
    inputs = [*attitude_inputs(dataset.directions, u_arcmin, "the plan"), *inputs]
    findings = _findings(dataset, settings, inputs)
    u_arcmin = parameters.latitude_uncertainty_arcmin
    return with_latitude(findings, dataset.directions, dataset.latitude_rad, u_arcmin, "the plan")


def _findings(
    dataset: StaticDataset, settings: AnalysisSettings, inputs: list[InputQuantity]
) -> Findings:
    analysis = analyse(dataset, settings)
    findings = findings_of(analysis, dataset, inputs)
    return replace(findings, trials=trials_of(analysis, dataset, settings))
