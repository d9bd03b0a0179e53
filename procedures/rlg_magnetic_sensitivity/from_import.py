"""From an imported dataset folder to the dataset of the analysis."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import Field, ValidationInfo, field_validator

from procedures.common.conditions import OfRateOrCounts
from station.fields import StrictModel, Unit

from .averaged import shortened
from .dataset import RlgDataset, Segment
from .frequencies import LARGEST_UNDRIVEN, Drive
from .from_record import TO_MIDDLE
from .parameters import Axis

if TYPE_CHECKING:
    from station.dataset_reading import RawDataset

FIELD_COLUMNS = ("b_ia_mT", "b_na_mT", "b_la_mT")
TIMESTAMP = Literal["interval-start", "interval-middle", "interval-end"]


class ImportedDrive(StrictModel):
    """The sine that a coil axis was commanded to make."""

    frequency_Hz: Annotated[float, Unit("Hz"), Field(gt=0)]
    amplitude_mT: Annotated[float, Unit("mT"), Field(gt=0)]


class Conditions(OfRateOrCounts):
    """The conditions of a laser-gyro dataset; what decides a sign or a phase has no default."""

    drive: Annotated[dict[Axis, ImportedDrive], Field(min_length=1)]
    sample_interval_s: Annotated[float, Unit("s"), Field(gt=0)]
    timestamp: TIMESTAMP
    field_timestamp: Literal["interval-start", "interval-middle", "interval-end", "instantaneous"]
    field_averaging_s: Annotated[float, Unit("s"), Field(gt=0)] | None = Field(
        default=None, validate_default=True
    )

    undriven_sensitivity_deg_per_h_per_mT: Annotated[float, Unit("deg/h/mT"), Field(ge=0)] = (
        LARGEST_UNDRIVEN
    )

    @field_validator("field_averaging_s")
    @classmethod
    def averaging_where_averaged(cls, value: float | None, info: ValidationInfo) -> float | None:
        """Require the averaging time of a field that is not instantaneous."""
        stamp = info.data.get("field_timestamp")
        if value is None and stamp not in (None, "instantaneous"):
            raise ValueError("a field that is not instantaneous needs field_averaging, a time")
        if value is not None and stamp == "instantaneous":
            raise ValueError("an instantaneous field has no field_averaging")
        return value


def dataset_of_import(raw: RawDataset) -> RlgDataset:
    """Return the one segment of an imported folder; FaultList names file, row and reason."""
    conditions = raw.conditions(Conditions)
    output = "counts" if conditions.gyro_output == "counts" else "rate_deg_per_h"
    table = raw.read_table("samples", ("t_s", output, *FIELD_COLUMNS), rising="t_s")
    interval_s = conditions.sample_interval_s
    quantum = 0.0
    rate = table[output]
    if conditions.pulse_weight_arcsec is not None and output == "counts":
        quantum = conditions.pulse_weight_arcsec / interval_s
        rate = rate * quantum
    averaging_s = conditions.field_averaging_s or 0.0
    shift_s = TO_MIDDLE.get(conditions.field_timestamp, 0.0) * averaging_s
    segment = Segment(
        drive={
            axis: Drive(drive.frequency_Hz, drive.amplitude_mT)
            for axis, drive in conditions.drive.items()
        },
        sample_interval_s=interval_s,
        time_s=table["t_s"] + TO_MIDDLE[conditions.timestamp] * interval_s,
        rate_deg_per_h=rate,
        quantum_deg_per_h=quantum,
        field_time_s=table["t_s"] + shift_s,
        field_mT=np.column_stack([table[name] for name in FIELD_COLUMNS]),
        field_averaging_s=averaging_s,
    )
    return RlgDataset((shortened(segment),))
