"""From an imported dataset folder to the dataset of the analysis."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import Field, ValidationInfo, field_validator

from procedures.common.conditions import OfGyros, OfRateOrCounts
from procedures.estimation.direction import Direction
from station.dataset_checks import switch_ons
from station.dataset_reading import Table
from station.fields import InputAxis, Unit

from .dataset import Record, StaticDataset

if TYPE_CHECKING:
    from station.dataset_reading import RawDataset

TO_MIDDLE = {"interval-start": 0.5, "interval-middle": 0.0, "interval-end": -0.5}
OUTPUTS = {"counts": "counts", "rate": "rate_deg_per_h"}


class Conditions(OfGyros, OfRateOrCounts):
    """The conditions of a record of gyros at rest; what decides a sign has no default."""

    sample_interval_s: Annotated[float, Unit("s"), Field(gt=0)]
    timestamp: Literal["interval-start", "interval-middle", "interval-end"]
    output_bandwidth_Hz: Annotated[float, Unit("Hz"), Field(gt=0)] | None = None
    warm_up_s: Annotated[float, Unit("s"), Field(ge=0)] = 0.0

    @field_validator("input_axis")
    @classmethod
    def counts_of_one(cls, value: dict[str, InputAxis], info: ValidationInfo) -> object:
        """Require IA where the output is counts."""
        if "IA" not in value and info.data.get("gyro_output") == "counts":
            raise ValueError("an output in counts has the input axis IA")
        return value


def dataset_of_import(raw: RawDataset) -> tuple[StaticDataset, Conditions]:
    """Return the records of an imported folder; FaultList names file, row and reason."""
    conditions = raw.conditions(Conditions)
    raw.require_files(("samples",))
    columns = [f"g{axis.lower()}_deg_per_h" for axis in conditions.input_axis]
    if "IA" in conditions.input_axis:
        columns = [OUTPUTS[conditions.gyro_output]]
    table = raw.read_table("samples", ("switch_on", "t_s", *columns))
    counts = conditions.gyro_output == "counts"
    pulse = (conditions.pulse_weight_arcsec or 0.0) if counts else 0.0
    scale = pulse / conditions.sample_interval_s if counts else 1.0
    dataset = StaticDataset(
        directions={
            name: Direction(np.deg2rad(direction.azimuth_deg), np.deg2rad(direction.elevation_deg))
            for name, direction in conditions.input_axis.items()
        },
        latitude_rad=float(np.deg2rad(conditions.latitude_deg)),
        sample_interval_s=conditions.sample_interval_s,
        pulse_arcsec=pulse,
        output_bandwidth_Hz=conditions.output_bandwidth_Hz,
        records=tuple(_records(table, columns, scale, conditions)),
    )
    return dataset, conditions


def _records(
    table: Table, columns: list[str], scale: float, conditions: Conditions
) -> Iterator[Record]:
    number, time_s = table["switch_on"], table["t_s"]
    begins = switch_ons(table, "switch_on", conditions.sample_interval_s)
    rate = np.column_stack([table[column] for column in columns]) * scale
    middle_s = time_s + TO_MIDDLE[conditions.timestamp] * conditions.sample_interval_s
    for start, stop in zip(begins, [*begins[1:], len(number)], strict=True):
        warm = start + np.flatnonzero(middle_s[start:stop] >= conditions.warm_up_s)
        if len(warm):
            yield Record(int(number[start]), middle_s[warm], rate[warm])
