"""What the analysis of a tumble test needs, and how it is read from an imported folder."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from procedures.common.conditions import OverDevice
from procedures.common.constants import ARCSEC_PER_RAD
from procedures.common.places import AtPlaces
from station.dataset_reading import Table, refuse
from station.fields import Unit
from station.files.faults import Fault
from station.findings import FlagThresholds

from .model import PLANES, Array, Names, model_columns

if TYPE_CHECKING:
    from station.dataset_reading import RawDataset

Mask = NDArray[np.bool_]

COLUMNS = ("t_s", "plane", "reversed", "head_deg", "commanded_deg", "theta_deg", "output_V")
TEMPERATURE = "temperature_degC"
STOPPED_FAR_DEG = 1.0
"""How far a stage stops from its commanded angle at most."""
SELDOM = 0.1
"""Part of the readings whose encoder may be wild before its column is in doubt."""
FULL_TURN_RAD = 6.3
LARGEST_V = 100.0
"""No accelerometer gives so much: such a number is in mV."""


@dataclass(frozen=True)
class TumbleDataset:
    """Readings (n,) of an accelerometer in positions on a rotary stage, in the order of time.

    `reverse` is -1 where the unit is turned about its input axis, else 1; `head_rad` how far the
    fixture is turned on the head, `encoder_rad` the stage's encoder: their sum is theta.
    `temperature_degC` is None where there is no thermometer. `encoder_accuracy_rad` and
    `mounting_rad` are standard uncertainties: of each of the encoder's first and second harmonics,
    and of the angle at which the unit or the fixture is set down. `places` has what a thermometer
    with places read, none where there was none.
    """

    time_s: Array
    plane: Names
    reverse: Array
    head_rad: Array
    commanded_rad: Array
    encoder_rad: Array
    output_V: Array
    temperature_degC: Array | None
    gravity_g: float
    encoder_accuracy_rad: float
    mounting_rad: float
    places: tuple[AtPlaces, ...] = ()

    @property
    def theta_rad(self) -> Array:
        """The angles that the encoder shows (n,)."""
        return self.encoder_rad + self.head_rad

    @property
    def columns(self) -> Array:
        """The model's columns at these angles (n, 12)."""
        return model_columns(self.plane, self.reverse, self.theta_rad, self.gravity_g)

    @property
    def mounting(self) -> NDArray[np.int64]:
        """The number of the mounting that each reading belongs to (n,), counted from 0."""
        new = (
            (self.plane[1:] != self.plane[:-1])
            | (np.diff(self.reverse) != 0.0)
            | (np.diff(self.head_rad) != 0.0)
        )
        return np.cumsum(np.append(False, new))

    @property
    def far(self) -> Mask:
        """Whether the encoder is not where the stage was sent (n,)."""
        off = _wrapped(np.rad2deg(self.encoder_rad - self.commanded_rad))
        return np.asarray(np.abs(off) > STOPPED_FAR_DEG)

    def only(self, rows: Mask) -> TumbleDataset:
        """Return some of the readings."""
        arrays = {name: own for name, own in vars(self).items() if isinstance(own, np.ndarray)}
        taken: dict[str, Any] = {name: own[rows] for name, own in arrays.items()}
        return replace(self, **taken)


@dataclass(frozen=True)
class AnalysisSettings(FlagThresholds):
    """Thresholds of the flags; `nuisance` in standard deviations of what was stated."""

    nuisance: float = 4.5
    max_drift_order: int = 3


class Conditions(OverDevice):
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
    refuse(list(_faults(table)))
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
        encoder_accuracy_rad=conditions.encoder_accuracy_arcsec / ARCSEC_PER_RAD,
        mounting_rad=conditions.mounting_repeatability_arcsec / ARCSEC_PER_RAD,
    )
    return dataset, conditions


def _faults(table: Table) -> Iterator[Fault]:
    """Yield the faults of columns that are not what they are called; not of wild rows."""
    for row in np.flatnonzero(~np.isin(table["reversed"], (0.0, 1.0))).tolist():
        what = f"is {table['reversed'][row]:g}; it is 1 where the unit is turned about IA, else 0"
        yield table.fault(row, "reversed", what)
    commanded, encoder = table["commanded_deg"], table["theta_deg"]
    if 0.0 < float(np.max(np.abs(commanded))) <= FULL_TURN_RAD and len(np.unique(commanded)) > 2:
        what = "all positions lie within 6.3 deg of 0; angles are in deg"
        yield table.fault(0, "commanded_deg", what)
        return
    far = np.flatnonzero(np.abs(_wrapped(encoder - commanded)) > STOPPED_FAR_DEG)
    if len(far) > max(SELDOM * len(commanded), 1.0):
        row = int(far[0])
        what = (
            f"reads {encoder[row]:g} deg where {commanded[row]:g} deg were commanded, and "
            f"{len(far) - 1} more rows are off; both are in deg and of one sense"
        )
        yield table.fault(row, "theta_deg", what)
    size = np.abs(table["output_V"])
    if float(np.median(size)) > LARGEST_V:
        what = f"half of the readings are beyond {LARGEST_V:g} V; the column is in V"
        yield table.fault(int(np.argmax(size > LARGEST_V)), "output_V", what)


def _wrapped(angle_deg: Array) -> Array:
    return np.mod(angle_deg + 180.0, 360.0) - 180.0
