"""From an imported dataset folder to the dataset of the analysis."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import Field

from station.dataset_reading import Table, refuse
from station.fields import StrictModel, Unit
from station.files.faults import Fault

from .dataset import TumbleDataset
from .model import PLANES, Array

if TYPE_CHECKING:
    from station.dataset_reading import RawDataset

COLUMNS = (
    "t_s",
    "plane",
    "reversed",
    "head_deg",
    "commanded_deg",
    "theta_deg",
    "output_V",
)
TEMPERATURE = "temperature_degC"
FAR_DEG = 1.0
"""How far a stage stops from its commanded angle at most."""
SELDOM = 0.1
"""Part of the readings whose encoder may be wild before its column is in doubt."""
FULL_TURN_RAD = 6.3
LARGEST_V = 100.0
"""No accelerometer gives so much: such a number is in mV."""


class Conditions(StrictModel):
    """The conditions of a tumble test."""

    # On the ground it is 0.9957 g to 1.0028 g.
    local_gravity_g: Annotated[float, Unit("g"), Field(ge=0.99, le=1.01)]
    encoder_accuracy_arcsec: Annotated[float, Unit("arcsec"), Field(ge=0, le=3600)]
    mounting_repeatability_arcsec: Annotated[float, Unit("arcsec"), Field(ge=0, le=3600)]
    local_gravity_uncertainty_g: Annotated[float, Unit("g"), Field(ge=0, le=0.01)] = 0.0
    thermometer_uncertainty_degC: Annotated[float, Unit("degC", True), Field(ge=0)] = 0.0
    multimeter_gain_ppm: Annotated[float, Unit("ppm"), Field(ge=0)] = 0.0
    multimeter_zero_V: Annotated[float, Unit("V"), Field(ge=0)] = 0.0


def dataset_of_import(raw: RawDataset) -> tuple[TumbleDataset, Conditions]:
    """Return the readings of an imported folder; FaultList names file, row and reason."""
    conditions = raw.conditions(Conditions)
    raw.require_files(("positions",))
    table = raw.read_table("positions", COLUMNS, (TEMPERATURE,), text=("plane",), rising="t_s")
    refuse(table.unknown_words("plane", PLANES))
    refuse(list(_unknown_reversal(table)))
    refuse(list(_angles(table)))
    refuse(list(_outputs(table)))
    dataset = TumbleDataset(
        time_s=table["t_s"],
        plane=table["plane"],
        reverse=1.0 - 2.0 * table["reversed"],
        head_rad=np.deg2rad(table["head_deg"]),
        commanded_rad=np.deg2rad(table["commanded_deg"]),
        encoder_rad=np.deg2rad(table["theta_deg"]),
        output_V=table["output_V"],
        temperature_degC=table.get(TEMPERATURE),
        gravity_g=conditions.local_gravity_g,
        encoder_accuracy_rad=float(np.deg2rad(conditions.encoder_accuracy_arcsec / 3600.0)),
        mounting_rad=float(np.deg2rad(conditions.mounting_repeatability_arcsec / 3600.0)),
    )
    return dataset, conditions


def _unknown_reversal(table: Table) -> Iterator[Fault]:
    for row in np.flatnonzero(~np.isin(table["reversed"], (0.0, 1.0))).tolist():
        what = f"is {table['reversed'][row]:g}; it is 1 where the unit is turned about IA, else 0"
        yield table.fault(row, "reversed", what)


def _angles(table: Table) -> Iterator[Fault]:
    """Yield the fault of angles in another unit, and of an encoder beside its commands."""
    commanded, encoder = table["commanded_deg"], table["theta_deg"]
    if 0.0 < float(np.max(np.abs(commanded))) <= FULL_TURN_RAD and len(np.unique(commanded)) > 2:
        what = "all positions lie within 6.3 deg of 0; angles are in deg"
        yield table.fault(0, "commanded_deg", what)
        return
    far = np.flatnonzero(np.abs(_wrapped(encoder - commanded)) > FAR_DEG)
    if len(far) > max(SELDOM * len(commanded), 1.0):
        row = int(far[0])
        what = (
            f"reads {encoder[row]:g} deg where {commanded[row]:g} deg were commanded, and "
            f"{len(far) - 1} more rows are off; both are in deg and of one sense"
        )
        yield table.fault(row, "theta_deg", what)


def _outputs(table: Table) -> Iterator[Fault]:
    """Yield the fault of an output in another unit; a single wild reading is left to analysis."""
    size = np.abs(table["output_V"])
    if float(np.median(size)) > LARGEST_V:
        what = f"half of the readings are beyond {LARGEST_V:g} V; the column is in V"
        yield table.fault(int(np.argmax(size > LARGEST_V)), "output_V", what)


def _wrapped(angle_deg: Array) -> Array:
    return np.mod(angle_deg + 180.0, 360.0) - 180.0
