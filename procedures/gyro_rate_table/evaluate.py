"""From data to findings: an imported dataset, its analysis, and the type B inputs."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

from station.findings import Findings, InputQuantity, findings_of

from .analysis import analyse
from .from_import import dataset_of_import

if TYPE_CHECKING:
    from station.dataset_reading import RawDataset

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


def clock_input(u_ppm: float, source: str) -> Iterator[InputQuantity]:
    """Yield the rate of the clock by which angles become rates; pulses need none."""
    if u_ppm > 0.0:
        said = "rate of the clock that stamps the angles"
        yield InputQuantity("clock", said, u_ppm * PPM, "1", source)


def mounting_inputs(
    alignment_arcmin: float, level_arcmin: float, source: str
) -> Iterator[InputQuantity]:
    """Yield how well the input axis lies along the table's, and that along the vertical.

    A lean takes 1 - cos of it off the scale factor.
    """
    if alignment_arcmin > 0.0:
        said = f"input axis along the table's within {alignment_arcmin:g} arcmin"
        u = 1.0 - math.cos(alignment_arcmin / ARCMIN_PER_RAD)
        yield InputQuantity("alignment", said, u, "1", source)
    if level_arcmin > 0.0:
        said = f"table's axis vertical within {level_arcmin:g} arcmin"
        yield InputQuantity("level", said, level_arcmin / ARCMIN_PER_RAD, "rad", source)
