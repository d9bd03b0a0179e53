"""From data to findings: imported or recorded turns, their analysis, and the type B inputs."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

from station.findings import Findings, InputQuantity, findings_of

from .analysis import analyse
from .dataset import AnalysisSettings
from .from_import import dataset_of_import
from .from_record import dataset_of_run
from .parameters import RateTableParameters
from .steps import GYRO

if TYPE_CHECKING:
    from station.dataset_reading import RawDataset
    from station.instruments.bench import Bench
    from station.record.folder import RunFolder

PPM = 1e-6
ARCMIN_PER_RAD = 60.0 * 180.0 / math.pi


def findings_of_dataset(raw: RawDataset) -> Findings:
    """Return what an imported dataset says."""
    dataset, conditions = dataset_of_import(raw)
    source = "the dataset's conditions"
    inputs = list(mounting_inputs(conditions.alignment_arcmin, conditions.level_arcmin, source))
    if conditions.gyro_output == "rate":
        inputs += clock_input(conditions.clock_ppm, source)
    return findings_of(analyse(dataset), dataset, inputs)


def findings_of_run(folder: RunFolder, parameters: RateTableParameters, bench: Bench) -> Findings:
    """Return what a run's finished switch-ons say, type B inputs from plan and bench file.

    Pulses over an angle need no clock; the encoder's error is in the records' own uncertainty.
    """
    dataset = dataset_of_run(folder, parameters, bench)
    settings = AnalysisSettings(**dict(parameters.thresholds))
    inputs = list(mounting_inputs(parameters.alignment_arcmin, parameters.level_arcmin, "the plan"))
    about = "weight of a pulse"
    inputs += bench.stated_input((GYRO, "scale", 1.0, "1"), "pulse_weight", about, relative=True)
    return findings_of(analyse(dataset, settings), dataset, inputs)


def clock_input(u_ppm: float, source: str) -> Iterator[InputQuantity]:
    """Yield the rate of the clock by which angles become rates; pulses need none."""
    if u_ppm > 0.0:
        about = "rate of the clock that stamps the angles"
        yield InputQuantity("clock", about, u_ppm * PPM, "1", source)


def mounting_inputs(
    alignment_arcmin: float, level_arcmin: float, source: str
) -> Iterator[InputQuantity]:
    """Yield how well the input axis lies along the table's, and that along the vertical.

    A lean takes 1 - cos of it off the scale factor.
    """
    if alignment_arcmin > 0.0:
        about = f"input axis along the table's within {alignment_arcmin:g} arcmin"
        u = 1.0 - math.cos(alignment_arcmin / ARCMIN_PER_RAD)
        yield InputQuantity("alignment", about, u, "1", source)
    if level_arcmin > 0.0:
        about = f"table's axis vertical within {level_arcmin:g} arcmin"
        yield InputQuantity("level", about, level_arcmin / ARCMIN_PER_RAD, "rad", source)
