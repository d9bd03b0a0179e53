"""From data to findings: imported positions, their analysis, and the type B inputs."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from station.findings import Findings, InputQuantity, findings_of

from .analysis import analyse
from .dataset import Conditions, dataset_of_import
from .solution import ENCODER, MOUNTING

if TYPE_CHECKING:
    from station.dataset_reading import RawDataset

SOURCE = "the dataset's conditions"


def findings_of_dataset(raw: RawDataset) -> Findings:
    """Return what an imported dataset says."""
    dataset, conditions = dataset_of_import(raw)
    return findings_of(analyse(dataset), dataset, list(inputs_of(conditions)))


def inputs_of(conditions: Conditions) -> Iterator[InputQuantity]:
    """Yield the type B inputs that the conditions state.

    The sensitivities to encoder and mountings are those to one stated standard deviation of each
    harmonic and of each mounting, added in quadrature; their u here is one of these.
    """
    encoder, mounting = conditions.encoder_accuracy_arcsec, conditions.mounting_repeatability_arcsec
    stated = (
        (ENCODER, f"harmonics of the encoder, {encoder:g} arcsec each", float(encoder > 0), "1"),
        (MOUNTING, f"mountings, {mounting:g} arcsec each", float(mounting > 0), "1"),
        ("local_gravity", "local gravity", conditions.local_gravity_uncertainty_g, "g"),
        (
            "thermometer_degC",
            "offset of the thermometer: the temperature that the results hold at",
            conditions.thermometer_uncertainty_degC,
            "degC",
        ),
        ("multimeter_gain", "gain of the multimeter", conditions.multimeter_gain_ppm * 1e-6, "1"),
        ("multimeter_zero", "zero of the multimeter", conditions.multimeter_zero_V, "V"),
    )
    for name, description, u, unit in stated:
        value = conditions.local_gravity_g if name == "local_gravity" else 0.0
        yield InputQuantity.if_stated(name, description, u, unit, SOURCE, value=value)
