"""From data to findings: imported or recorded turns, their analysis, and the type B inputs."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from procedures.common.constants import ARCMIN_PER_RAD
from procedures.common.gyro_source import GYRO, IMU, NAVIGATOR
from procedures.common.inputs import cosine_u
from procedures.estimation.direction import Direction, with_latitude
from station.findings import Findings, InputQuantity, findings_of

from .dataset import AnalysisSettings, RateTableDataset, dataset_of_import, dataset_of_run
from .parameters import RateTableParameters
from .trials import analysed, trials_of

if TYPE_CHECKING:
    from station.dataset_reading import RawDataset
    from station.instruments.bench import Bench
    from station.record.folder import RunFolder

PPM = 1e-6
PULSE = "weight of a pulse"
UPWARDS = Direction(0.0, math.pi / 2.0)


def findings_of_dataset(raw: RawDataset) -> Findings:
    """Return what an imported dataset says."""
    dataset, conditions = dataset_of_import(raw)
    source = "the dataset's conditions"
    inputs = list(mounting_inputs(conditions.alignment_arcmin, conditions.level_arcmin, source))
    if conditions.gyro_output == "rate":
        inputs.append(clock_input(conditions.clock_ppm, source))
    else:
        inputs.append(InputQuantity.if_stated("pulse_weight", PULSE, None, "1", source))
    findings = _findings({dataset.axis: dataset}, AnalysisSettings(), inputs)
    u_arcmin = conditions.latitude_uncertainty_arcmin
    return with_latitude(findings, {"IA": UPWARDS}, dataset.latitude_rad, u_arcmin, source)


def findings_of_run(folder: RunFolder, parameters: RateTableParameters, bench: Bench) -> Findings:
    """Return what a run's finished switch-ons say, type B inputs from plan and bench file.

    Pulses over an angle need no clock; the encoder's error is in the records' own uncertainty.
    """
    settings = AnalysisSettings(**dict(parameters.thresholds))
    inputs = list(mounting_inputs(parameters.alignment_arcmin, parameters.level_arcmin, "the plan"))
    if parameters.source == GYRO:
        scale = (GYRO, "scale", 1.0, "1")
        inputs += bench.stated_input(scale, "pulse_weight", PULSE, relative=True)
    if parameters.source == IMU:
        inputs.append(clock_input(parameters.clock_ppm, "the plan"))
    datasets: dict[str, RateTableDataset] = {}
    for axis in parameters.axes:
        datasets[axis] = dataset_of_run(folder, parameters, bench, axis)
    findings = _findings(datasets, settings, inputs)
    if parameters.source == NAVIGATOR:
        return findings
    u_arcmin = parameters.latitude_uncertainty_arcmin
    latitude_rad = math.radians(parameters.latitude_deg)
    upwards: dict[str, Direction] = dict.fromkeys(parameters.axes, UPWARDS)
    return with_latitude(findings, upwards, latitude_rad, u_arcmin, "the plan")


def _findings(
    datasets: Mapping[str, RateTableDataset],
    settings: AnalysisSettings,
    inputs: list[InputQuantity],
) -> Findings:
    analysis = analysed(datasets, settings)
    findings = findings_of(analysis, datasets, inputs)
    return replace(findings, trials=trials_of(analysis, datasets, settings))


def clock_input(u_ppm: float, source: str) -> InputQuantity:
    """Return the rate of the clock by which angles become rates; pulses need none."""
    about = "rate of the clock that stamps the angles"
    return InputQuantity.if_stated("clock", about, u_ppm * PPM, "1", source)


def mounting_inputs(
    alignment_arcmin: float, level_arcmin: float, source: str
) -> Iterator[InputQuantity]:
    """Yield how well the input axis lies along the table's, and that along the vertical.

    A lean takes 1 - cos of it off the scale factor.
    """
    about = "input axis along the table's"
    if alignment_arcmin:
        about = f"input axis along the table's within {alignment_arcmin:g} arcmin"
    u = cosine_u(alignment_arcmin / ARCMIN_PER_RAD)
    yield InputQuantity.if_stated("alignment", about, u, "1", source)
    about = "table's axis vertical"
    if level_arcmin:
        about = f"table's axis vertical within {level_arcmin:g} arcmin"
    u = level_arcmin / ARCMIN_PER_RAD
    yield InputQuantity.if_stated("level", about, u, "rad", source)
