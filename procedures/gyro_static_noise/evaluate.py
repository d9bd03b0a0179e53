"""From data to findings: an imported dataset, its analysis, and the type B inputs."""

from __future__ import annotations

from typing import TYPE_CHECKING

from procedures.estimation.direction import attitude_inputs
from station.findings import Findings, InputQuantity, findings_of

from .analysis import analyse
from .dataset import AnalysisSettings
from .from_import import dataset_of_import
from .from_record import dataset_of_run
from .parameters import StaticParameters
from .steps import GYRO

if TYPE_CHECKING:
    from station.dataset_reading import RawDataset
    from station.instruments.bench import Bench
    from station.record.folder import RunFolder

PPM = 1e-6


def findings_of_dataset(raw: RawDataset) -> Findings:
    """Return what an imported dataset says."""
    dataset, conditions = dataset_of_import(raw)
    u_arcmin = conditions.attitude_uncertainty_arcmin
    inputs = list(attitude_inputs(dataset.directions, u_arcmin, "the dataset's conditions"))
    return findings_of(analyse(dataset), dataset, inputs)


def findings_of_run(folder: RunFolder, parameters: StaticParameters, bench: Bench) -> Findings:
    """Return what a run's finished switch-ons say, type B inputs from plan and bench file."""
    dataset = dataset_of_run(folder, parameters, bench)
    settings = AnalysisSettings(**dict(parameters.thresholds))
    inputs = list(
        attitude_inputs(dataset.directions, parameters.attitude_uncertainty_arcmin, "the plan")
    )
    u_clock = parameters.clock_ppm * PPM
    inputs.append(InputQuantity("clock", "rate of the station's clock", u_clock, "1", "the plan"))
    about = "weight of a pulse"
    inputs += bench.stated_input((GYRO, "scale", 1.0, "1"), "pulse_weight", about, relative=True)
    return findings_of(analyse(dataset, settings), dataset, inputs)
