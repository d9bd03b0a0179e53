"""From data to findings: an imported dataset, its analysis, and the type B inputs."""

from __future__ import annotations

from typing import TYPE_CHECKING

from procedures.estimation.direction import attitude_inputs
from station.findings import Findings, findings_of

from .analysis import analyse
from .from_import import dataset_of_import

if TYPE_CHECKING:
    from station.dataset_reading import RawDataset


def findings_of_dataset(raw: RawDataset) -> Findings:
    """Return what an imported dataset says."""
    dataset, conditions = dataset_of_import(raw)
    u_arcmin = conditions.attitude_uncertainty_arcmin
    inputs = list(attitude_inputs(dataset.directions, u_arcmin, "the dataset's conditions"))
    return findings_of(analyse(dataset), dataset, inputs)
